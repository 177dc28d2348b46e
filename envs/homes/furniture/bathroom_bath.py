"""Bathtubs, and showers: a cabin, one to transfer into, one to roll into."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Triple

from ...rectangle import Rectangle
from ..piece import Zone
from .bathroom import bar_figures
from .joinery import Corners, Joinery, front_zone, furniture
from .plumbing import drain, grab_bar, hand_shower, tap, tiled_panel

_WALL = 0.07  # [m] thick, with its rim; common, from memory
_RIM = 0.035  # [m], radius of the rim
_FLOOR = 0.12  # [m] over the floor of the room; common, from memory
_RIM_ELSE = 0.45  # [m], where the rules of a level know no bath
_SEAT_DEPTH = 0.4  # [m]: ADA 610.2, 15 to 16 in
_SEAT_BOARD = 0.03  # [m] thick
_SLOPE = 0.24  # [m] by which the head end leans
_TAP_AT, _SHOWER_AT = -0.5, -0.66  # [m] along the wall
_BAR = (-0.33, 0.66)  # [m], ends of the bars along the wall
_PANEL = 0.04  # [m], thickness of tiled walls; own choice
_HIGH = 2.02  # [m], of walls and curtain rails; own choice
_OUT: Triple = (1.0, 0.0, 0.0)
_SEAT_ELSE = 0.45  # [m], height where the rules of a level want no seat
_TRANSFER = 0.915  # [m]: ADA 608.2.1, 36 in, inside, both ways
_ROLL_IN = (1.83, 1.22)  # [m], width and depth where the rules of a level want none
_HINGE = 0.06  # [m], of a seat, from its wall: ADA 610.3, 2 1/2 in at most


@furniture("bathtub")
def bathtub(made: Joinery, *, length: float = 1.52, width: float = 0.76) -> None:
    """Make a bathtub, hollow, with its long side at the wall, its tap and a hand shower.

    It is `length` [m] long and stands out by `width` [m].
    """
    rim = _tub(made, length, width)
    _slope(made, rim, length, width)


@furniture("bathtub_with_seat")
def bathtub_with_seat(made: Joinery, *, length: float = 1.52, width: float = 0.76) -> None:
    """Make a bathtub with a seat across its head end, to slide onto, and two bars on the wall.

    It is `length` [m] long and stands out by `width` [m].
    """
    rim = _tub(made, length, width)
    _seat(made, length, width)
    height, diameter, gap = bar_figures(made.rules)
    # ADA 607.4: one bar at the usual height, one 8 to 10 in over the rim.
    for top in (height, rim + 0.23):
        z = top - 0.5 * diameter
        ends = ((0.0, _BAR[0], z), (0.0, _BAR[1], z))
        grab_bar(made, *ends, (1.0, 0.0, 0.0), diameter=diameter, gap=gap)
    made.measures.update(grab_bar_height=height, grab_bar_diameter=diameter, grab_bar_gap=gap)
    middle = (gap + 0.5 * diameter, 0.5 * (_BAR[0] + _BAR[1]), height - 0.5 * diameter)
    made.frame("grab_bar", middle, "middle of the upper bar")


def _tub(made: Joinery, length: float, width: float) -> float:
    """Add floor, walls and rim, tap and drain, and say what floor it needs; return its rim's height [m]."""
    rim = made.ruled("bathtub_rim_height", _RIM_ELSE)
    half, top, level = 0.5 * length, rim - _RIM, made.rules.level
    made.box((0.0, -half, 0.0), (width, half, _FLOOR), "ceramic")
    hollow = Rectangle(_WALL, _WALL - half, width - _WALL, half - _WALL)
    for wall in Rectangle(0.0, -half, width, half).without(hollow):
        made.show((wall.x0, wall.y0, _FLOOR), (wall.x1, wall.y1, top), "ceramic")
        made.block((wall.x0, wall.y0, _FLOOR), (wall.x1, wall.y1, rim))
    start, (a, b), (c, d) = (_RIM, 0.0, top), (_RIM, width - _RIM), (_RIM - half, half - _RIM)
    corners = ((a, d, top), (b, d, top), (b, c, top), (a, c, top))
    made.rod((start, *corners, start), _RIM, "ceramic", bend=0.09)
    for x in (_WALL, width - _WALL):  # fillets where wall and floor meet
        made.rod(((x, _WALL - half, _FLOOR), (x, half - _WALL, _FLOOR)), 0.03, "ceramic")
    for y in (_WALL - half, half - _WALL):
        for x in (_WALL, width - _WALL):
            made.post((x, y, _FLOOR), top, 0.025, "ceramic")
    # A panel in front, set back a little, and its foot.
    front = width + 0.006
    made.show((width, 0.04 - half, 0.06), (front, half - 0.04, top - 0.045), "plastic")
    drain(made, (0.5 * width, 0.25 - half, _FLOOR), radius=0.03)
    tap(made, (0.04, _TAP_AT, rim - 0.004), reach=0.16)
    hand_shower(made, (0.0, _SHOWER_AT, 0.0), (1.0, 0.0, 0.0), low=1.0, high=1.65)
    lying = (0.5 * width, 0.1, _FLOOR)
    made.frame("bath", lying, "middle of the bottom; the head is at the left", yaw_deg=-90.0)
    made.frame("rim", (width - _RIM, 0.0, rim), "middle of the front rim")
    free = 0.6 if level == 1 else 0.76  # ADA 607.2: 30 in along the whole bath; level 1: own choice
    made.outline(front, half, 1.66, front_zone(front, 0.45 if level == 1 else half, free))
    return rim


def _slope(made: Joinery, rim: float, length: float, width: float) -> None:
    """Lean the head end back, to lie against."""
    end, rise, thick = 0.5 * length - _WALL, rim - _FLOOR - 0.02, 0.03
    tilt = math.atan2(_SLOPE, rise)
    y, z = end - 0.5 * _SLOPE, _FLOOR + 0.5 * rise
    # Its inner face runs from the foot of the slope to the rim.
    at = (0.5 * width, y + 0.5 * thick * math.cos(tilt), z - 0.5 * thick * math.sin(tilt))
    size = (width - 2 * _WALL, thick, math.hypot(_SLOPE, rise))
    made.slab(at, size, "ceramic", rpy=(-tilt, 0.0, 0.0))


def _seat(made: Joinery, length: float, width: float) -> None:
    """Add a seat of four boards that lies within the rim."""
    top = made.ruled("bath_seat_height", _RIM_ELSE)
    back = 0.5 * length - _WALL
    x0, x1, low = _WALL - 0.01, width - _WALL + 0.01, top - _SEAT_BOARD
    each = _SEAT_DEPTH / 4
    for i in range(4):
        y = back - each * (i + 1)
        made.show((x0, y + 0.006, low), (x1, y + each - 0.006, top), "wood_light")
    made.block((x0, back - _SEAT_DEPTH, low), (x1, back, top))
    z = low - 0.012
    for x in (x0 + 0.06, x1 - 0.06):
        made.rod(((x, back - _SEAT_DEPTH, z), (x, back, z)), 0.012, "metal")
    seat = (0.5 * width, back - 0.5 * _SEAT_DEPTH, top)
    made.frame("seat", seat, "middle of the seat, facing the tap", yaw_deg=-90.0)


def fold_seat(
    made: Joinery, wall: Triple, out: Triple, *, width: float, depth: float, folded: bool
) -> None:
    """Add a seat that folds up against its wall, joint `seat`, with slats.

    Args:
        made: What it is part of.
        wall: Point of the wall behind its middle, on the floor [m].
        out: Direction out of the wall, a unit vector along x or y.
        width: Along the wall [m].
        depth: From the wall to its front edge [m].
        folded: Whether it rests folded up; the joint moves it down then, else up.
    """
    (x, y, _), (dx, dy, _) = wall, out
    top, thick, half = made.ruled("bath_seat_height", _SEAT_ELSE), 0.03, 0.5 * width

    def span(near: float, far: float, low: float, high: float, side: float) -> Corners:
        """Return the corners of a box by its distances from the wall, heights and half width."""
        xs = sorted((x + near * dx - side * dy, x + far * dx + side * dy))
        ys = sorted((y + near * dy - side * dx, y + far * dy + side * dx))
        return (xs[0], ys[0], low), (xs[1], ys[1], high)

    board = span(_HINGE, depth, top - thick, top, half)
    # Down from the wall is about z × out; folded, it leans five degrees back.
    down: Triple = (-dy, dx, 0.0) if folded else (dy, -dx, 0.0)
    hinge = (x + _HINGE * dx, y + _HINGE * dy, top - 0.5 * thick)
    turn = math.radians(95)
    seat = made.joint(
        "seat", hinge, down, turn, mass=4.0, fills=board, slowing=0.12, drawn_open=folded
    )
    count = 5
    each = (depth - _HINGE) / count
    for i in range(count):
        near = _HINGE + each * i
        slat = span(near + 0.005, near + each - 0.005, top - 0.018, top, half)
        seat.show(*slat, "wood_light")
    z = top - 0.024
    for side in (-0.7 * half, 0.7 * half):
        a, b = -side * dy, side * dx
        end = (x + depth * dx + a, y + depth * dy + b, z)
        seat.rod(((hinge[0] + a, hinge[1] + b, z), end), 0.012, "metal")
    seat.block(*board)
    made.box(*span(0.0, 0.03, top - 0.08, top, 0.85 * half), "metal")
    made.show(*span(0.03, _HINGE, top - 0.03, top - 0.012, 0.75 * half), "metal")
    front = (x + depth * dx, y + depth * dy, top - 0.5 * thick)
    seat.frame("handle_seat", front, "front edge")
    middle = (x + 0.5 * (depth + _HINGE) * dx, y + 0.5 * (depth + _HINGE) * dy, top)
    yaw = math.degrees(math.atan2(dy, dx))
    made.frame("seat", middle, "middle of the seat when it is down, facing out", yaw_deg=yaw)


def _curtain(made: Joinery, x: float, half: float, covered: float) -> None:
    """Add a rail between two walls and a curtain, drawn to one side; the curtain is to see only."""
    z = _HIGH - 0.06
    made.rod(((x, -half, z), (x, half, z)), 0.012, "metal", solid=True)
    count = max(int(covered / 0.055), 3)
    for i in range(count):
        y, aside = -half + 0.03 + covered * i / count, 0.016 if i % 2 else -0.016
        made.rod(((x + aside, y, 0.12), (x + 0.5 * aside, y, z - 0.03)), 0.034, "curtain")


def _bars(made: Joinery, *ends: tuple[tuple[float, float], tuple[float, float], Triple]) -> None:
    """Add bars at the usual height, each from one point of a wall to another, out of it."""
    height, diameter, gap = bar_figures(made.rules)
    z, away = height - 0.5 * diameter, gap + 0.5 * diameter
    for i, (a, b, out) in enumerate(ends):
        grab_bar(made, (*a, z), (*b, z), out, diameter=diameter, gap=gap)
        x, y = (0.5 * (p + q) + away * d for p, q, d in zip(a, b, out, strict=False))
        made.frame(f"grab_bar_{i + 1}", (x, y, z), "middle of the bar")
    made.measures.update(grab_bar_height=height, grab_bar_diameter=diameter, grab_bar_gap=gap)


def _walls(made: Joinery, half: float, deep: float, signs: tuple[float, ...]) -> None:
    """Add the floor and tiled walls at the sides along y."""
    for sign in signs:
        near, far = sorted((sign * half, sign * (half + _PANEL)))
        tiled_panel(made, (0.0, near, 0.0), (deep, far, _HIGH))
    made.show((0.0, -half, 0.0), (deep, half, 0.004), "wall_tile")


@furniture("transfer_shower")
def transfer_shower(made: Joinery, *, seat: str = "left") -> None:
    """Make a shower to transfer into: a seat at one side, bars, water at the other.

    `seat` is its side as seen from the wall behind, `left` or `right`; ConfigError if it is neither.
    """
    if seat not in ("left", "right"):
        raise ConfigError(f"seat must be left or right, got {seat!r}")
    side, half, deep = (1.0 if seat == "left" else -1.0), 0.5 * _TRANSFER, _TRANSFER
    _walls(made, half, deep, (-1.0, 1.0))
    step = min(made.rules.figure("shower_threshold"), 0.012)  # ADA 608.7, at any level
    made.measures["shower_threshold"] = step
    if step > 0:
        made.box((deep - 0.04, -half, 0.0), (deep, half, step), "metal")
    drain(made, (0.5 * deep, -side * 0.1, 0.004), radius=0.05)
    inward: Triple = (0.0, -side, 0.0)
    fold_seat(made, (0.45, side * half, 0.0), inward, width=0.55, depth=0.4, folded=False)
    away: Triple = (0.0, side, 0.0)
    control = -side * half
    # ADA 608.3.1: across the wall of the controls and the wall behind to 18 in from it.
    behind = (0.0, control + side * 0.08), (0.0, control + side * 0.54), _OUT
    _bars(made, ((0.05, control), (0.66, control), away), behind)
    hand_shower(made, (0.76, control, 0.0), away, low=1.05, high=1.75)
    _curtain(made, deep - 0.05, half, 0.3)
    # ADA 608.2.1: 36 by 48 in along the open side, from the wall of the controls.
    low, high = sorted((-side * half, side * (1.22 - half)))
    use = Zone(Rectangle(deep, low, deep + 0.915, high))
    made.outline(deep, half + _PANEL, _HIGH + 0.012, use)


@furniture("roll_in_shower")
def roll_in_shower(made: Joinery, *, ends: str = "none") -> None:
    """Make a shower to roll into: a wet floor as high as the room's, a seat that folds, bars.

    Its floor is room for knees: nothing on it stands in a wheelchair's way while the seat is up. `ends` is
    where walls of the house stand, so that it needs none of its own there: `none`, `left`, `right` or
    `both`; ConfigError if it is none of these.
    """
    if ends not in ("none", "left", "right", "both"):
        raise ConfigError(f"ends must be one of none, left, right, both, got {ends!r}")
    width, deep = _ROLL_IN
    if made.rules.has("shower_width"):
        width, deep = made.rules.figure("shower_width"), made.rules.figure("shower_depth")
    half = 0.5 * width
    made.measures.update(shower_width=width, shower_depth=deep, shower_threshold=0.0)
    own = {"none": (1.0, -1.0), "left": (-1.0,), "right": (1.0,), "both": ()}[ends]
    _walls(made, half, deep, own)
    made.show((0.06, 0.1 - half, 0.0), (0.12, half - 0.1, 0.006), "metal")
    made.show((0.085, 0.12 - half, 0.0), (0.095, half - 0.12, 0.007), "metal_dark")
    made.frame("drain", (0.09, 0.0, 0.0), "drain line")
    made.frame("floor", (0.5 * deep + 0.1, -0.25, 0.0), "where a wheelchair stands in it")
    seat_at, seat_wide = half - 0.36, 0.5
    fold_seat(made, (0.0, seat_at, 0.0), _OUT, width=seat_wide, depth=0.42, folded=True)
    water = seat_at - 0.5 * seat_wide - 0.14
    hand_shower(made, (0.0, water, 0.0), _OUT, low=1.0, high=1.7)
    _bars(
        made,
        ((0.0, 0.08 - half), (0.0, water - 0.15), _OUT),
        ((0.12, half), (deep - 0.12, half), (0.0, -1.0, 0.0)),
        ((0.12, -half), (deep - 0.12, -half), (0.0, 1.0, 0.0)),
    )
    _curtain(made, deep - 0.05, half, 0.5)
    made.knee.append(Rectangle(0.0, -half, deep, half))
    # ADA 608.2.2: 30 in along the open side
    made.outline(deep, half, _HIGH + 0.012, front_zone(deep, half, 0.76))
    left, right = (half + (_PANEL if sign in own else 0.0) for sign in (1.0, -1.0))
    made.footprint = Rectangle(0.0, -right, deep, left)


@furniture("shower_cabin")
def shower_cabin(made: Joinery, *, width: float = 0.9, depth: float = 0.9) -> None:
    """Make a shower of glass on a tray with a rim, with a hinged door.

    It is `width` [m] wide along the wall and stands out by `depth` [m].
    """
    half, rim, top = 0.5 * width, made.ruled("shower_threshold"), 1.98
    floor, edge = min(0.03, 0.5 * rim), 0.045
    if rim > 0:
        made.box((0.0, -half, 0.0), (depth, half, floor), "ceramic")
        made.box((0.0, -half, floor), (edge, half, rim), "ceramic")
        made.box((depth - edge, -half, floor), (depth, half, rim), "ceramic")
        made.sides((edge, -half, floor), (depth - edge, half, rim), edge, "ceramic")
    else:
        made.show((0.0, -half, 0.0), (depth, half, 0.004), "wall_tile")
    drain(made, (0.5 * depth, 0.0, max(floor, 0.004)), radius=0.04)
    low, pane, split, face = rim + 0.005, 0.008, half - 0.28, depth - 0.02
    for y in (-half + 0.01, half - 0.01 - pane):
        made.show((0.0, y, low), (face, y + pane, top), "glass")
        made.block((0.0, y - 0.002, low), (face, y + pane + 0.002, top))
    made.show((face - pane, split, low), (face, half - 0.015, top), "glass")
    made.block((face - 0.012, split, low), (face, half - 0.015, top))
    side, over = half - 0.014, top + 0.005
    for y in (-half + 0.014, side, split):
        made.post((face - 0.004, y, low - 0.004), top + 0.01, 0.012, "metal")
    for y in (-half + 0.014, side):
        made.rod(((0.0, y, over), (face, y, over)), 0.01, "metal")
    made.rod(((face, -half + 0.014, over), (face, side, over)), 0.01, "metal")
    _glass_door(made, face, split - 0.014, 0.03 - half, low + 0.01, top - 0.01)
    hand_shower(made, (0.0, -0.15, 0.0), _OUT, low=1.15, high=1.85)
    made.disc((0.06, -0.15, 1.86), 0.016, 0.03, "metal")
    made.frame("floor", (0.5 * depth, 0.0, floor), "where one stands")
    sweep = Rectangle(depth, -half, depth + (split - 0.014 + half), split)
    use = front_zone(depth, 0.35, 0.6)
    made.outline(depth + 0.03, half, top + 0.02, use, Zone(sweep, "sweep"))


def _glass_door(
    made: Joinery, face: float, hinge: float, free: float, low: float, high: float
) -> None:
    """Add a door of glass in the plane `face`, hinged at the left, that opens outwards."""
    pane = (face - 0.008, free, low), (face, hinge, high)
    mass, swing = 2500 * 0.008 * (hinge - free) * (high - low), math.radians(95)
    door = made.joint("door", (face, hinge, low), "z", swing, mass=mass, fills=pane, slowing=0.15)
    door.show(*pane, "glass")
    door.block((face - 0.012, free, low), pane[1])
    y, x = free + 0.06, face + 0.035
    door.post((x, y, 0.95), 1.25, 0.008, "metal", solid=True)
    for z in (0.98, 1.22):
        door.rod(((face, y, z), (x, y, z)), 0.006, "metal")
    door.post((face, free, low), high, 0.006, "metal")
    door.frame("handle_door", (x, y, 1.1), "bar handle")
