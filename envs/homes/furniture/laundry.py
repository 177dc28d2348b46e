"""What stands in laundries: machines, a sink, racks, an ironing board."""

from __future__ import annotations

import math

from rcare_marl.model.shape import Shape, Triple

from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker
from .joinery import Joinery
from .plumbing import disc, drain, tap, trap
from .stock import box, rod

_SIDE, _HIGH = 0.6, 0.85  # [m], width and depth, height of machines; common, from memory
_PANEL = 0.13  # [m], height of the strip with knob and drawer
_PORT = (0.0, 0.45)  # [m], middle of the door: y, z
_HOLE = 0.16  # [m], half the square hole behind the door
_RING = 0.245  # [m], radius of the rim of the door: it covers the corners of the hole
_FRONT_SPACE = (0.75, 0.92, 1.22)  # [m]: ADA 611.2 wants 30 by 48 in; level 1, 2: own choice


@maker("washing_machine")
def washing_machine(setting: Setting) -> Piece:
    """Return a washing machine with a round door, a drawer for soap and a knob."""
    return _machine(Joinery("washing_machine", setting), is_washer=True)


@maker("dryer")
def dryer(setting: Setting) -> Piece:
    """Return a tumble dryer with a round door, a drawer for water and a knob."""
    return _machine(Joinery("dryer", setting), is_washer=False)


def _machine(made: Joinery, *, is_washer: bool) -> Piece:
    half, front, z0 = 0.5 * _SIDE, _SIDE - 0.02, 0.04
    strip = _HIGH - _PANEL
    for y in (-half, half - 0.015):
        made.box((0.0, y, z0), (front - 0.02, y + 0.015, _HIGH - 0.02), "white")
    made.box((0.0, 0.015 - half, z0), (0.015, half - 0.015, _HIGH - 0.02), "white")
    made.box((0.0, -half, _HIGH - 0.02), (front, half, _HIGH), "white")
    made.box((0.015, 0.015 - half, z0), (front - 0.02, half - 0.015, z0 + 0.015), "metal_dark")
    for x in (0.06, front - 0.08):
        for y in (0.06 - half, half - 0.06):
            made.draw(rod("rubber", 0.025, (x, y, 0.0), (x, y, z0)))
    made.solid(box("", (0.04, 0.04 - half, 0.0), (front - 0.06, half - 0.04, z0)))
    y, z = _PORT
    low, high = (y - _HOLE, z - _HOLE), (y + _HOLE, z + _HOLE)
    for a, b in (
        ((-half, z0), (half, low[1])),
        ((-half, high[1]), (half, strip)),
        ((-half, low[1]), (low[0], high[1])),
        ((high[0], low[1]), (half, high[1])),
    ):
        made.box((front - 0.02, *a), (front, *b), "white")
    _strip(made, front, strip, half, is_washer=is_washer)
    _drum(made, front, z)
    _round_door(made, front, y, z)
    free = _FRONT_SPACE[made.setting.rules.level - 1]
    end = front + 0.055
    zones = (
        Zone(Rectangle(end, -half, end + free, half)),
        Zone(Rectangle(front, -half, front + 2 * _RING, half + 0.05), "sweep"),
    )
    made.frame("top", (0.5 * front, 0.0, _HIGH), "middle of the top")
    return made.piece(Rectangle(0.0, -half, end, half), _HIGH, zones=zones)


def _strip(made: Joinery, front: float, low: float, half: float, *, is_washer: bool) -> None:
    """Add the strip of controls: a drawer at the left, a knob, a display."""
    edge, top = half - 0.2, _HIGH - 0.02
    made.box((front - 0.02, -half, low), (front, edge, top), "plastic")
    made.draw(
        box("black", (front, -0.25, low + 0.035), (front + 0.002, -0.1, top - 0.03)),
        box(
            "leaf" if is_washer else "accent",
            (front, -0.2, low + 0.06),
            (front + 0.003, -0.15, low + 0.075),
        ),
    )
    for i in range(3):
        made.draw(
            disc(
                "metal",
                (front + 0.003, -0.08 + 0.03 * i - 0.2, low + 0.018),
                0.007,
                0.006,
                along="x",
            )
        )
    a, b = (front - 0.26, edge + 0.002, low + 0.002), (front, half, top)
    made.drawer("drawer", a, b, "plastic", travel=0.2, inner="plastic")
    at: Triple = (front + 0.014, 0.01, low + 0.055)
    made.draw(disc("metal", (front + 0.002, 0.01, low + 0.055), 0.038, 0.004, along="x"))
    made.moving(
        "knob",
        "revolute",
        at,
        (1.0, 0.0, 0.0),
        1.5 * math.pi,
        mass=0.08,
        fills=((front, -0.02, low + 0.025), (front + 0.028, 0.04, low + 0.085)),
        slowing=0.05,
    )
    made.draw(
        disc("metal", at, 0.03, 0.024, along="x"),
        box("black", (front + 0.026, 0.008, low + 0.06), (front + 0.0275, 0.012, low + 0.084)),
        link="knob",
    )
    made.solid(
        Shape(kind="cylinder", at=at, rpy=(0.0, math.pi / 2, 0.0), radius=0.03, length=0.026),
        link="knob",
    )
    made.frame("handle_knob", (front + 0.028, 0.01, low + 0.085), "rim of the knob", link="knob")


def _drum(made: Joinery, front: float, z: float) -> None:
    """Add the drum, open to the front: a cup to see, its floor and back to collide with."""
    turn: Triple = (0.0, math.pi / 2, 0.0)  # its axis, z, along x
    back = 0.12
    cup = ((0.16, front), (0.165, front - 0.05), (0.235, front - 0.08), (0.235, back), (0.0, back))
    made.draw(
        Shape(kind="lathe", material="metal", at=(0.0, 0.0, z), rpy=turn, profile=(*cup, cup[0]))
    )
    low, high = front - 0.004, front + 0.001
    collar = ((0.158, low), (0.235, low), (0.235, high), (0.158, high), (0.158, low))
    made.draw(Shape(kind="lathe", material="plastic", at=(0.0, 0.0, z), rpy=turn, profile=collar))
    made.solid(
        box("", (back - 0.015, -0.25, z - 0.25), (back, 0.25, z + 0.25)),
        box("", (back, -0.16, z - 0.23), (front - 0.06, 0.16, z - 0.2)),
    )
    made.frame("drum", (0.5 * (front + back), 0.0, z - 0.2), "bottom of the drum")


def _round_door(made: Joinery, front: float, y: float, z: float) -> None:
    """Add the round door, hinged at the left, with its glass."""
    turn: Triple = (0.0, math.pi / 2, 0.0)
    made.moving(
        "door",
        "revolute",
        (front + 0.022, y + _RING, z),
        (0.0, 0.0, 1.0),
        math.radians(115),
        mass=2.2,
        fills=((front + 0.002, y - _RING, z - _RING), (front + 0.045, y + _RING, z + _RING)),
        slowing=0.15,
    )
    ring = ((0.15, 0.002), (_RING, 0.002), (_RING - 0.005, 0.03), (0.18, 0.045), (0.15, 0.03))
    glass = ((0.15, 0.02), (0.1, -0.005), (0.0, -0.015), (0.0, 0.005), (0.15, 0.024), (0.15, 0.02))
    made.draw(
        Shape(kind="lathe", material="metal", at=(front, y, z), rpy=turn, profile=(*ring, ring[0])),
        Shape(kind="lathe", material="glass", at=(front, y, z), rpy=turn, profile=glass),
        link="door",
    )
    made.solid(
        Shape(kind="cylinder", at=(front + 0.02, y, z), rpy=turn, radius=_RING, length=0.036),
        link="door",
    )
    grip: Triple = (front + 0.045, y - 0.21, z)
    made.rod(
        ((front + 0.04, y - 0.212, z - 0.06), (front + 0.04, y - 0.212, z + 0.06)),
        0.008,
        "metal_dark",
        link="door",
        solid=True,
    )
    made.frame("handle_door", grip, "grip at the edge of the door", link="door")


@maker("laundry_sink")
def laundry_sink(setting: Setting, *, width: float = 0.6, depth: float = 0.52) -> Piece:
    """Return a deep sink on legs with a tap.

    Args:
        setting: What it is made for.
        width: Along the wall [m].
        depth: Out of the wall [m].
    """
    rules = setting.rules
    made = Joinery("laundry_sink", setting)
    half, rim = 0.5 * width, rules.figure("basin_rim_height")
    # Knees go under a shallow one; a deep one at level 1; own choice.
    under = rules.figure("basin_knee_height") if rules.has("basin_knee_height") else rim - 0.3
    made.measures["basin_rim_height"] = rim
    floor, wall, ledge = under + 0.02, 0.025, 0.11
    made.box((0.0, -half, under), (ledge, half, rim), "plastic")
    made.box((depth - wall, -half, under), (depth, half, rim), "plastic")
    for y in (-half, half - wall):
        made.box((ledge, y, under), (depth - wall, y + wall, rim), "plastic")
    made.box((ledge, wall - half, under), (depth - wall, half - wall, floor), "plastic")
    made.draw(
        box("white", (depth - 0.01, -half - 0.008, rim - 0.03), (depth + 0.008, half + 0.008, rim)),
        box("white", (0.0, -half - 0.008, rim - 0.03), (depth, 0.01 - half, rim)),
        box("white", (0.0, half - 0.01, rim - 0.03), (depth, half + 0.008, rim)),
    )
    for x in (0.05, depth - 0.05):
        for y in (0.05 - half, half - 0.05):
            made.rod(((x, y, 0.0), (x, y, under)), 0.014, "metal", solid=True)
    middle = 0.5 * (ledge + depth - wall)
    drain(made, (middle, 0.0, floor))
    trap(made, (middle, 0.0, under), sleeve=rules.level > 1)
    made.frame("basin", (middle, 0.0, floor), "bottom of the sink")
    tap(made, (0.055, 0.0, rim), style=rules.choice("tap"), reach=0.15)
    made.box((0.02, half - 0.14, rim), (0.09, half - 0.06, rim + 0.03), "blanket")
    knee: tuple[Rectangle, ...] = ()
    if rules.has("basin_knee_height"):
        made.measures["basin_knee_height"] = under
        knee = (Rectangle(0.18, 0.07 - half, depth, half - 0.07),)
    end = depth + 0.008
    use = Rectangle(end, -half, end + (0.6, 0.8, 0.92)[rules.level - 1], half)
    area = Rectangle(0.0, -half - 0.008, end, half + 0.008)
    made.knee += knee
    return made.piece(area, rim + 0.2, zones=(Zone(use),))


@maker("drying_rack")
def drying_rack(setting: Setting, *, length: float = 1.1) -> Piece:
    """Return a rack that stands open, with clothes over its bars; the clothes are to see only.

    Args:
        setting: What it is made for.
        length: Of its bars [m].
    """
    made = Joinery("drying_rack", setting)
    high, deep, half = 0.95, 0.55, 0.5 * length
    for y in (-half, half):
        made.rod(((0.02, y, 0.01), (deep - 0.02, y, high)), 0.009, "white", solid=True)
        made.rod(((deep - 0.02, y, 0.01), (0.02, y, high)), 0.009, "white", solid=True)
    count = 7
    spots = [0.02 + (deep - 0.04) * i / (count - 1) for i in range(count)]
    for x in spots:
        made.draw(rod("white", 0.004, (x, -half, high), (x, half, high)))
    for y in (-half, half):
        made.draw(rod("white", 0.008, (0.02, y, high), (deep - 0.02, y, high)))
        made.draw(rod("rubber", 0.012, (0.02, y, 0.0), (0.02, y, 0.02)))
        made.draw(rod("rubber", 0.012, (deep - 0.02, y, 0.0), (deep - 0.02, y, 0.02)))
    made.solid(box("", (0.01, -half, high - 0.008), (deep - 0.01, half, high + 0.008)))
    for x, low, wide, long, colour in (
        (spots[1], -0.45, 0.4, 0.5, "towel"),
        (spots[3], -0.1, 0.5, 0.35, "linen"),
        (spots[5], -0.4, 0.3, 0.45, "rug"),
        (spots[6], 0.05, 0.35, 0.55, "blanket"),
    ):
        made.draw(
            rod(colour, 0.011, (x, low, high + 0.002), (x, low + wide, high + 0.002)),
            box(colour, (x + 0.005, low, high - long), (x + 0.011, low + wide, high)),
            box(colour, (x - 0.011, low, high - 0.8 * long), (x - 0.005, low + wide, high)),
        )
    area = Rectangle(0.0, -half - 0.012, deep, half + 0.012)
    use = Rectangle(deep, -0.4, deep + 0.6, 0.4)
    made.frame("bars", (0.5 * deep, 0.0, high), "middle of the bars")
    return made.piece(area, high + 0.015, zones=(Zone(use),))


@maker("ironing_board")
def ironing_board(setting: Setting) -> Piece:
    """Return an ironing board on crossed legs, along the wall, with an iron on it."""
    made = Joinery("ironing_board", setting)
    high, deep, half = (0.9, 0.8, 0.74)[setting.rules.level - 1], 0.38, 0.6  # as who sits needs it
    middle = 0.5 * deep
    made.box((0.0, 0.35 - half, high - 0.03), (deep, half, high), "linen")
    nose = Shape(  # the round end
        kind="lathe",
        material="linen",
        at=(middle, 0.35 - half, high - 0.015),
        profile=((middle, -0.015), (middle, 0.015)),
        scale=(1.0, 1.8, 1.0),
    )
    made.draw(
        nose,
        box(
            "blanket", (-0.001, half - 0.3, high - 0.031), (deep + 0.001, half - 0.26, high + 0.001)
        ),
    )
    made.solid(box("", (0.05, 0.03 - half, high - 0.03), (deep - 0.05, 0.35 - half, high)))
    for start, end in ((-0.42, 0.36), (0.42, -0.36)):
        made.rod(((middle, start, 0.02), (middle, end, high - 0.03)), 0.011, "metal", solid=True)
        made.rod(((0.03, start, 0.012), (deep - 0.03, start, 0.012)), 0.011, "metal", solid=True)
    y = half - 0.16
    made.draw(
        box("metal", (middle - 0.055, y - 0.11, high), (middle + 0.055, y + 0.11, high + 0.012)),
        box(
            "fabric",
            (middle - 0.045, y - 0.08, high + 0.012),
            (middle + 0.045, y + 0.1, high + 0.05),
        ),
        rod(
            "black",
            0.014,
            (middle, y - 0.07, high + 0.05),
            (middle, y - 0.05, high + 0.1),
            (middle, y + 0.09, high + 0.1),
            (middle, y + 0.09, high + 0.05),
            bend=0.03,
        ),
    )
    made.solid(box("", (middle - 0.055, y - 0.1, high), (middle + 0.055, y + 0.1, high + 0.11)))
    made.frame("tabletop", (middle, 0.0, high), "middle of the board")
    made.frame("iron", (middle, y, high + 0.1), "handle of the iron")
    area = Rectangle(0.0, -half, deep, half)
    use = Rectangle(deep, -0.4, deep + 0.6, 0.4)
    return made.piece(area, high + 0.115, zones=(Zone(use),))
