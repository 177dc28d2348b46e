"""What stands in laundries: machines, a sink, racks, an ironing board."""

from __future__ import annotations

import math

from rcare_marl.model.shape import Shape, Triple

from ...rectangle import Rectangle
from ..piece import Zone
from .joinery import Joinery, front_zone, furniture
from .plumbing import drain, tap, trap

_SIDE, _HIGH = 0.6, 0.85  # [m], width and depth, height of machines; common, from memory
_PANEL = 0.13  # [m], height of the strip with knob and drawer
_PORT = 0.45  # [m], height of the middle of the door
_HOLE = 0.16  # [m], half the square hole behind the door
_RING = 0.245  # [m], radius of the rim of the door: it covers the corners of the hole
_FRONT_SPACE = (0.75, 0.92, 1.22)  # [m]: ADA 611.2 wants 30 by 48 in; level 1, 2: own choice
_TURN: Triple = (0.0, math.pi / 2, 0.0)  # what is turned has its axis, z, along x


@furniture("washing_machine")
def washing_machine(made: Joinery) -> None:
    """Make a washing machine with a round door, a drawer for soap and a knob."""
    _machine(made, "leaf")


@furniture("dryer")
def dryer(made: Joinery) -> None:
    """Make a tumble dryer with a round door, a drawer for water and a knob."""
    _machine(made, "accent")


def _machine(made: Joinery, display: str) -> None:
    half, front, z0 = 0.5 * _SIDE, _SIDE - 0.02, 0.04
    back, strip = front - 0.02, _HIGH - _PANEL
    made.sides((0.0, -half, z0), (back, half, _HIGH - 0.02), 0.015, "white")
    made.box((0.0, 0.015 - half, z0), (0.015, half - 0.015, _HIGH - 0.02), "white")
    made.box((0.0, -half, _HIGH - 0.02), (front, half, _HIGH), "white")
    made.box((0.015, 0.015 - half, z0), (back, half - 0.015, z0 + 0.015), "metal_dark")
    for x in (0.06, front - 0.08):
        for y in (0.06 - half, half - 0.06):
            made.post((x, y, 0.0), z0, 0.025, "rubber")
    made.block((0.04, 0.04 - half, 0.0), (front - 0.06, half - 0.04, z0))
    low, high = _PORT - _HOLE, _PORT + _HOLE
    for a, b in (
        ((-half, z0), (half, low)),
        ((-half, high), (half, strip)),
        ((-half, low), (-_HOLE, high)),
        ((_HOLE, low), (half, high)),
    ):
        made.box((back, *a), (front, *b), "white")
    _strip(made, front, strip, half, display)
    _drum(made, front)
    _round_door(made, front)
    end, free = front + 0.055, _FRONT_SPACE[made.rules.level - 1]
    sweep = Zone(Rectangle(front, -half, front + 2 * _RING, half + 0.05), "sweep")
    made.frame("top", (0.5 * front, 0.0, _HIGH), "middle of the top")
    made.outline(end, half, _HIGH, front_zone(end, half, free), sweep)


def _strip(made: Joinery, front: float, low: float, half: float, display: str) -> None:
    """Add the strip of controls: a drawer at the left, a knob, a display."""
    edge, top, middle = half - 0.2, _HIGH - 0.02, low + 0.055
    made.box((front - 0.02, -half, low), (front, edge, top), "plastic")
    made.show((front, -0.25, low + 0.035), (front + 0.002, -0.1, top - 0.03), "black")
    made.show((front, -0.2, low + 0.06), (front + 0.003, -0.15, low + 0.075), display)
    for i in range(3):
        at = (front + 0.003, -0.08 + 0.03 * i - 0.2, low + 0.018)
        made.disc(at, 0.007, 0.006, "metal", along="x")
    a, b = (front - 0.26, edge + 0.002, low + 0.002), (front, half, top)
    made.drawer("drawer", a, b, "plastic", travel=0.2, inner="plastic")
    at = (front + 0.014, 0.01, middle)
    made.disc((front + 0.002, 0.01, middle), 0.038, 0.004, "metal", along="x")
    fills = ((front, -0.02, low + 0.025), (front + 0.028, 0.04, low + 0.085))
    knob = made.joint("knob", at, "x", 1.5 * math.pi, mass=0.08, fills=fills, slowing=0.05)
    knob.disc(at, 0.03, 0.024, "metal", along="x")
    knob.show((front + 0.026, 0.008, low + 0.06), (front + 0.0275, 0.012, low + 0.084), "black")
    knob.solid(Shape("cylinder", at=at, rpy=_TURN, radius=0.03, length=0.026))
    knob.frame("handle_knob", (front + 0.028, 0.01, low + 0.085), "rim of the knob")


def _drum(made: Joinery, front: float) -> None:
    """Add the drum, open to the front: a cup to see, its floor and back to collide with."""
    back, z, low, high = 0.12, _PORT, front - 0.004, front + 0.001
    cup = ((0.16, front), (0.165, front - 0.05), (0.235, front - 0.08), (0.235, back), (0.0, back))
    made.lathe((0.0, 0.0, z), (*cup, cup[0]), "metal", rpy=_TURN)
    collar = ((0.158, low), (0.235, low), (0.235, high), (0.158, high), (0.158, low))
    made.lathe((0.0, 0.0, z), collar, "plastic", rpy=_TURN)
    made.block((back - 0.015, -0.25, z - 0.25), (back, 0.25, z + 0.25))
    made.block((back, -0.16, z - 0.23), (front - 0.06, 0.16, z - 0.2))
    made.frame("drum", (0.5 * (front + back), 0.0, z - 0.2), "bottom of the drum")


def _round_door(made: Joinery, front: float) -> None:
    """Add the round door, hinged at the left, with its glass."""
    z, pivot = _PORT, (front + 0.022, _RING, _PORT)
    fills = (front + 0.002, -_RING, z - _RING), (front + 0.045, _RING, z + _RING)
    swing = math.radians(115)
    door = made.joint("door", pivot, "z", swing, mass=2.2, fills=fills, slowing=0.15)
    ring = ((0.15, 0.002), (_RING, 0.002), (_RING - 0.005, 0.03), (0.18, 0.045), (0.15, 0.03))
    glass = ((0.15, 0.02), (0.1, -0.005), (0.0, -0.015), (0.0, 0.005), (0.15, 0.024), (0.15, 0.02))
    door.lathe((front, 0.0, z), (*ring, ring[0]), "metal", rpy=_TURN)
    door.lathe((front, 0.0, z), glass, "glass", rpy=_TURN)
    at = (front + 0.02, 0.0, z)
    door.solid(Shape("cylinder", at=at, rpy=_TURN, radius=_RING, length=0.036))
    door.post((front + 0.04, -0.212, z - 0.06), z + 0.06, 0.008, "metal_dark", solid=True)
    door.frame("handle_door", (front + 0.045, -0.21, z), "grip at the edge of the door")


@furniture("laundry_sink")
def laundry_sink(made: Joinery, *, width: float = 0.6, depth: float = 0.52) -> None:
    """Make a deep sink on legs with a tap, `width` [m] wide, that stands out by `depth` [m]."""
    rules, half, rim = made.rules, 0.5 * width, made.ruled("basin_rim_height")
    # Knees go under a shallow one; a deep one at level 1; own choice.
    under = rules.figure("basin_knee_height", rim - 0.3)
    floor, wall, ledge = under + 0.02, 0.025, 0.11
    outer = Rectangle(0.0, -half, depth, half)
    inner = Rectangle(ledge, wall - half, depth - wall, half - wall)
    made.ring(outer, inner, (under, rim), "plastic")
    made.box((inner.x0, inner.y0, under), (inner.x1, inner.y1, floor), "plastic")
    side, low, end = half + 0.008, rim - 0.03, depth + 0.008
    made.show((depth - 0.01, -side, low), (end, side, rim), "white")
    made.show((0.0, -side, low), (depth, 0.01 - half, rim), "white")
    made.show((0.0, half - 0.01, low), (depth, side, rim), "white")
    for x in (0.05, depth - 0.05):
        for y in (0.05 - half, half - 0.05):
            made.post((x, y, 0.0), under, 0.014, "metal", solid=True)
    middle = 0.5 * (ledge + depth - wall)
    drain(made, (middle, 0.0, floor))
    trap(made, (middle, 0.0, under), sleeve=rules.level > 1)
    made.frame("basin", (middle, 0.0, floor), "bottom of the sink")
    tap(made, (0.055, 0.0, rim), reach=0.15)
    made.box((0.02, half - 0.14, rim), (0.09, half - 0.06, rim + 0.03), "blanket")
    if rules.has("basin_knee_height"):
        made.measures["basin_knee_height"] = under
        made.knee.append(Rectangle(0.18, 0.07 - half, depth, half - 0.07))
    use = front_zone(end, half, (0.6, 0.8, 0.92)[rules.level - 1])
    made.outline(end, side, rim + 0.2, use)
