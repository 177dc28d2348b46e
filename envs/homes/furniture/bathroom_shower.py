"""Showers: a cabin, one to transfer into, one to roll into."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Triple

from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker
from .bathroom_bar import bar_figures
from .joinery import Joinery
from .plumbing import disc, drain, grab_bar, hand_shower, tiled_panel
from .stock import box, rod, solid_rods

_PANEL = 0.04  # [m], thickness of tiled walls; own choice
_HIGH = 2.02  # [m], of walls and curtain rails; own choice
_OUT: Triple = (1.0, 0.0, 0.0)
_SEAT_ELSE = 0.45  # [m], height where the rules of a level want no seat
_TRANSFER = 0.915  # [m]: ADA 608.2.1, 36 in, inside, both ways
_ROLL_IN = (1.83, 1.22)  # [m], width and depth where the rules of a level want none
_HINGE = 0.06  # [m], of a seat, from its wall: ADA 610.3, 2 1/2 in at most


def _seat_height(made: Joinery) -> float:
    rules = made.setting.rules
    height = rules.figure("bath_seat_height") if rules.has("bath_seat_height") else _SEAT_ELSE
    made.measures["bath_seat_height"] = height
    return height


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
    top, thick, half = _seat_height(made), 0.03, 0.5 * width

    def span(
        near: float, far: float, low: float, high: float, side: float
    ) -> tuple[Triple, Triple]:
        """Return the corners of a box by its distances from the wall, heights and half width."""
        a = (x + near * dx - side * dy, y + near * dy - side * dx, low)
        b = (x + far * dx + side * dy, y + far * dy + side * dx, high)
        return (
            (min(a[0], b[0]), min(a[1], b[1]), low),
            (max(a[0], b[0]), max(a[1], b[1]), high),
        )

    low, high = span(_HINGE, depth, top - thick, top, half)
    # Down from the wall is about z × out; folded, it leans five degrees back.
    down: Triple = (-dy, dx, 0.0) if folded else (dy, -dx, 0.0)
    hinge = (x + _HINGE * dx, y + _HINGE * dy, top - 0.5 * thick)
    made.moving(
        "seat",
        "revolute",
        hinge,
        down,
        math.radians(95),
        mass=4.0,
        fills=(low, high),
        slowing=0.12,
        drawn_open=folded,
    )
    count = 5
    each = (depth - _HINGE) / count
    for i in range(count):
        near = _HINGE + each * i
        slat = span(near + 0.005, near + each - 0.005, top - 0.018, top, half)
        made.draw(box("wood_light", *slat), link="seat")
    for side in (-0.7 * half, 0.7 * half):
        aside = (-side * dy, side * dx)
        start = (hinge[0] + aside[0], hinge[1] + aside[1], top - 0.024)
        end = (x + depth * dx + aside[0], y + depth * dy + aside[1], top - 0.024)
        made.draw(rod("metal", 0.012, start, end), link="seat")
    made.solid(box("", low, high), link="seat")
    plate = span(0.0, 0.03, top - 0.08, top, 0.85 * half)
    made.box(*plate, "metal")
    arms = span(0.03, _HINGE, top - 0.03, top - 0.012, 0.75 * half)
    made.draw(box("metal", *arms))
    front = (x + depth * dx, y + depth * dy, top - 0.5 * thick)
    made.frame("handle_seat", front, "front edge", link="seat")
    seat = (x + 0.5 * (depth + _HINGE) * dx, y + 0.5 * (depth + _HINGE) * dy, top)
    yaw = math.degrees(math.atan2(dy, dx))
    made.frame("seat", seat, "middle of the seat when it is down, facing out", yaw_deg=yaw)


def _curtain(made: Joinery, x: float, half: float, covered: float) -> None:
    """Add a rail between two walls and a curtain, drawn to one side; the curtain is to see only."""
    z = _HIGH - 0.06
    made.draw(rod("metal", 0.012, (x, -half, z), (x, half, z)))
    made.solid(*solid_rods(0.012, (x, -half, z), (x, half, z)))
    count = max(int(covered / 0.055), 3)
    for i in range(count):
        y, aside = -half + 0.03 + covered * i / count, 0.016 if i % 2 else -0.016
        made.draw(rod("curtain", 0.034, (x + aside, y, 0.12), (x + 0.5 * aside, y, z - 0.03)))


def _bars(made: Joinery, ends: tuple[tuple[Triple, Triple, Triple], ...]) -> None:
    """Add bars at the usual height, each from one point of a wall to another, out of it."""
    height, diameter, gap = bar_figures(made.setting.rules)
    z = height - 0.5 * diameter
    for i, (start, end, out) in enumerate(ends):
        a, b = (start[0], start[1], z), (end[0], end[1], z)
        grab_bar(made, a, b, out, diameter=diameter, gap=gap)
        away = gap + 0.5 * diameter
        middle = (
            0.5 * (a[0] + b[0]) + away * out[0],
            0.5 * (a[1] + b[1]) + away * out[1],
            z,
        )
        made.frame(f"grab_bar_{i + 1}", middle, "middle of the bar")
    made.measures |= {
        "grab_bar_height": height,
        "grab_bar_diameter": diameter,
        "grab_bar_gap": gap,
    }


@maker("transfer_shower")
def transfer_shower(setting: Setting, *, seat: str = "left") -> Piece:
    """Return a shower to transfer into: a seat at one side, bars, water at the other.

    Args:
        setting: What it is made for.
        seat: Side of the seat, as seen from the wall behind: `left` or `right`.

    Raises:
        ConfigError: If `seat` is neither.
    """
    if seat not in ("left", "right"):
        raise ConfigError(f"seat must be left or right, got {seat!r}")
    made = Joinery("transfer_shower", setting)
    side, half, deep = (1.0 if seat == "left" else -1.0), 0.5 * _TRANSFER, _TRANSFER
    for sign in (-1.0, 1.0):
        near, far = sorted((sign * half, sign * (half + _PANEL)))
        tiled_panel(made, (0.0, near, 0.0), (deep, far, _HIGH))
    step = min(setting.rules.figure("shower_threshold"), 0.012)  # ADA 608.7, at any level
    made.measures["shower_threshold"] = step
    made.draw(box("wall_tile", (0.0, -half, 0.0), (deep, half, 0.004)))
    if step > 0:
        made.box((deep - 0.04, -half, 0.0), (deep, half, step), "metal")
    drain(made, (0.5 * deep, -side * 0.1, 0.004), radius=0.05)
    inward: Triple = (0.0, -side, 0.0)
    fold_seat(made, (0.45, side * half, 0.0), inward, width=0.55, depth=0.4, folded=False)
    away: Triple = (0.0, side, 0.0)
    control = -side * half
    # ADA 608.3.1: across the wall of the controls and the wall behind to 18 in from it.
    _bars(
        made,
        (
            ((0.05, control, 0.0), (0.66, control, 0.0), away),
            ((0.0, control + side * 0.08, 0.0), (0.0, control + side * 0.54, 0.0), _OUT),
        ),
    )
    hand_shower(made, (0.76, control, 0.0), away, low=1.05, high=1.75)
    _curtain(made, deep - 0.05, half, 0.3)
    # ADA 608.2.1: 36 by 48 in along the open side, from the wall of the controls.
    low, high = sorted((-side * half, side * (1.22 - half)))
    use = Rectangle(deep, low, deep + 0.915, high)
    whole = half + _PANEL
    return made.piece(Rectangle(0.0, -whole, deep, whole), _HIGH + 0.012, zones=(Zone(use),))


@maker("roll_in_shower")
def roll_in_shower(setting: Setting, *, ends: str = "none") -> Piece:
    """Return a shower to roll into: a wet floor as high as the room's, a seat that folds, bars.

    Its floor is room for knees: nothing on it stands in a wheelchair's way while the seat is up.

    Args:
        setting: What it is made for.
        ends: Where walls of the house stand at its ends, so that it needs none of its own: `none`,
            `left`, `right` or `both`.

    Raises:
        ConfigError: If `ends` is none of these.
    """
    if ends not in ("none", "left", "right", "both"):
        raise ConfigError(f"ends must be one of none, left, right, both, got {ends!r}")
    rules = setting.rules
    made = Joinery("roll_in_shower", setting)
    width, deep = _ROLL_IN
    if rules.has("shower_width"):
        width, deep = rules.figure("shower_width"), rules.figure("shower_depth")
    half = 0.5 * width
    made.measures |= {"shower_width": width, "shower_depth": deep, "shower_threshold": 0.0}
    own = {"none": (1.0, -1.0), "left": (-1.0,), "right": (1.0,), "both": ()}[ends]
    for sign in own:
        near, far = sorted((sign * half, sign * (half + _PANEL)))
        tiled_panel(made, (0.0, near, 0.0), (deep, far, _HIGH))
    made.draw(
        box("wall_tile", (0.0, -half, 0.0), (deep, half, 0.004)),
        box("metal", (0.06, 0.1 - half, 0.0), (0.12, half - 0.1, 0.006)),
        box("metal_dark", (0.085, 0.12 - half, 0.0), (0.095, half - 0.12, 0.007)),
    )
    made.frame("drain", (0.09, 0.0, 0.0), "drain line")
    made.frame("floor", (0.5 * deep + 0.1, -0.25, 0.0), "where a wheelchair stands in it")
    seat_at, seat_wide = half - 0.36, 0.5
    fold_seat(made, (0.0, seat_at, 0.0), _OUT, width=seat_wide, depth=0.42, folded=True)
    water = seat_at - 0.5 * seat_wide - 0.14
    hand_shower(made, (0.0, water, 0.0), _OUT, low=1.0, high=1.7)
    _bars(
        made,
        (
            ((0.0, 0.08 - half, 0.0), (0.0, water - 0.15, 0.0), _OUT),
            ((0.12, half, 0.0), (deep - 0.12, half, 0.0), (0.0, -1.0, 0.0)),
            ((0.12, -half, 0.0), (deep - 0.12, -half, 0.0), (0.0, 1.0, 0.0)),
        ),
    )
    _curtain(made, deep - 0.05, half, 0.5)
    left = half + (_PANEL if 1.0 in own else 0.0)
    right = half + (_PANEL if -1.0 in own else 0.0)
    use = Rectangle(deep, -half, deep + 0.76, half)  # ADA 608.2.2: 30 in along the open side
    made.knee += (Rectangle(0.0, -half, deep, half),)
    return made.piece(Rectangle(0.0, -right, deep, left), _HIGH + 0.012, zones=(Zone(use),))


@maker("shower_cabin")
def shower_cabin(setting: Setting, *, width: float = 0.9, depth: float = 0.9) -> Piece:
    """Return a shower of glass on a tray with a rim, with a hinged door.

    Args:
        setting: What it is made for.
        width: Along the wall [m].
        depth: Out of the wall [m].
    """
    made = Joinery("shower_cabin", setting)
    half, rim, high = 0.5 * width, setting.rules.figure("shower_threshold"), 1.98
    made.measures["shower_threshold"] = rim
    floor = min(0.03, 0.5 * rim)
    edge = 0.045
    if rim > 0:
        made.box((0.0, -half, 0.0), (depth, half, floor), "ceramic")
        made.box((0.0, -half, floor), (edge, half, rim), "ceramic")
        made.box((depth - edge, -half, floor), (depth, half, rim), "ceramic")
        for y in (-half, half - edge):
            made.box((edge, y, floor), (depth - edge, y + edge, rim), "ceramic")
    else:
        made.draw(box("wall_tile", (0.0, -half, 0.0), (depth, half, 0.004)))
    drain(made, (0.5 * depth, 0.0, max(floor, 0.004)), radius=0.04)
    pane = 0.008
    low, top, fixed = rim + 0.005, high, 0.28
    for y in (-half + 0.01, half - 0.01 - pane):
        made.draw(box("glass", (0.0, y, low), (depth - 0.02, y + pane, top)))
        made.solid(box("", (0.0, y - 0.002, low), (depth - 0.02, y + pane + 0.002, top)))
    split, face = half - fixed, depth - 0.02
    made.draw(box("glass", (face - pane, split, low), (face, half - 0.015, top)))
    made.solid(box("", (face - 0.012, split, low), (face, half - 0.015, top)))
    for y in (-half + 0.014, half - 0.014, split):
        made.draw(
            rod("metal", 0.012, (face - 0.004, y, low - 0.004), (face - 0.004, y, top + 0.01))
        )
    for y in (-half + 0.014, half - 0.014):
        made.draw(rod("metal", 0.01, (0.0, y, top + 0.005), (face, y, top + 0.005)))
    made.draw(
        rod("metal", 0.01, (face, -half + 0.014, top + 0.005), (face, half - 0.014, top + 0.005))
    )
    _glass_door(made, face, split - 0.014, 0.03 - half, low + 0.01, top - 0.01)
    hand_shower(made, (0.0, -0.15, 0.0), _OUT, low=1.15, high=1.85)
    made.draw(disc("metal", (0.06, -0.15, 1.86), 0.016, 0.03))
    made.frame("floor", (0.5 * depth, 0.0, floor), "where one stands")
    long = split - 0.014 + half
    zones = (
        Zone(Rectangle(depth, -0.35, depth + 0.6, 0.35)),
        Zone(Rectangle(depth, -half, depth + long, split), "sweep"),
    )
    return made.piece(Rectangle(0.0, -half, depth + 0.03, half), high + 0.02, zones=zones)


def _glass_door(
    made: Joinery, face: float, hinge: float, free: float, low: float, high: float
) -> None:
    """Add a door of glass in the plane `face`, hinged at the left, that opens outwards."""
    corner, far = (face - 0.008, free, low), (face, hinge, high)
    made.moving(
        "door",
        "revolute",
        (face, hinge, low),
        (0.0, 0.0, 1.0),
        math.radians(95),
        mass=2500 * 0.008 * (hinge - free) * (high - low),
        fills=(corner, far),
        slowing=0.15,
    )
    made.draw(box("glass", corner, far), link="door")
    made.solid(box("", (face - 0.012, free, low), far), link="door")
    y, x = free + 0.06, face + 0.035
    made.rod(((x, y, 0.95), (x, y, 1.25)), 0.008, "metal", link="door", solid=True)
    for z in (0.98, 1.22):
        made.draw(rod("metal", 0.006, (face, y, z), (x, y, z)), link="door")
    made.draw(rod("metal", 0.006, (face, free, low), (face, free, high)), link="door")
    made.frame("handle_door", (x, y, 1.1), "bar handle", link="door")
