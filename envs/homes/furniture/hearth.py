"""What warms a room. Sizes are common ones, from memory."""

from __future__ import annotations

import math

from .joinery import Joinery, furniture


@furniture("fireplace")
def make_fireplace(made: Joinery, *, width: float = 1.4) -> None:
    """Make a fireplace with a stone surround, a mantel and logs on the grate."""
    half, high, deep, gap = 0.5 * width, 1.1, 0.32, 0.4
    front, under, top = deep + 0.02, high - 0.08, high + 0.05
    for y0, y1 in ((-half, -gap), (gap, half)):
        made.box((0.0, y0, 0.0), (deep, y1, high), "trim")
        made.show((deep, y0 + 0.05, 0.0), (front, y1 - 0.05, under), "trim")
    made.box((0.0, -gap, 0.7), (deep, gap, high), "trim")
    made.show((deep, -gap + 0.02, 0.74), (front, gap - 0.02, under), "trim")
    made.box((0.0, -half - 0.07, high), (deep + 0.07, half + 0.07, top), "wood_dark")
    made.box((0.0, -gap, 0.0), (0.03, gap, 0.7), "black")
    made.sides((0.03, -gap, 0.03), (deep - 0.03, gap, 0.7), 0.012, "metal_dark", solid=False)
    made.box((0.03, -half, 0.0), (deep + 0.35, half, 0.03), "paving")
    _logs(made)
    for y in (-0.5 * half, -0.35 * half):
        made.post((0.18, y, top), high + 0.23, 0.018, "linen")
        made.post((0.18, y, top), high + 0.06, 0.04, "brass")
    y, z = 0.35 * half, high + 0.17
    made.show((0.12, y, top), (0.2, y + 0.2, high + 0.27), "wood")
    made.rod([(0.2, y + 0.1, z), (0.203, y + 0.1, z)], 0.075, "white")
    made.stand_zone(-half, half, 0.6, x=deep + 0.35)


def _logs(made: Joinery) -> None:
    """Lay logs with a small flame on a grate; all of it is solid as one box."""
    for y in (-0.2, 0.0, 0.2):
        made.show((0.08, y - 0.01, 0.03), (0.28, y + 0.01, 0.1), "metal_dark")
    for x, z, turn in ((0.13, 0.14, 0.05), (0.23, 0.14, -0.06), (0.18, 0.22, 0.1)):
        made.rod([(x - turn, -0.25, z), (x + turn, 0.25, z)], 0.042, "wood_dark")
    for y, tall in ((-0.08, 0.2), (0.03, 0.3), (0.12, 0.18)):
        flame = ((0.0, 0.0), (0.05, 0.06), (0.03, 0.5 * tall), (0.0, tall))
        made.lathe((0.18, y, 0.24), flame, "accent")
    made.block((0.08, -0.28, 0.03), (0.28, 0.28, 0.26))


@furniture("radiator")
def make_radiator(made: Joinery, *, width: float = 1.0, height: float = 0.6) -> None:
    """Make a ribbed radiator under a window, with a valve that turns."""
    half, low, high = 0.5 * width, 0.12, 0.12 + height
    count = max(3, round(width / 0.09))
    for k in range(count):
        y = -half + (k + 0.5) * width / count
        made.show((0.04, y - 0.03, low), (0.13, y + 0.03, high), "trim")
    for z in (low + 0.05, high - 0.05):
        made.show((0.06, -half, z - 0.02), (0.11, half, z + 0.02), "trim")
    made.block((0.0, -half, low), (0.13, half, high))
    x, y = 0.085, half + 0.04
    made.post((x, y, 0.0), 0.2, 0.01, "metal", solid=True)
    made.rod([(x, half, 0.17), (x, y, 0.17)], 0.01, "metal")
    valve = made.joint("valve", (x, y, 0.225), "z", math.radians(270.0), damping=0.01)
    valve.box((0.06, y - 0.014, 0.2), (0.11, y + 0.014, 0.25), "white", bevel=0.008)
    note = "rim of the valve, turned along y"
    made.frame("handle_valve", (0.11, y, 0.225), note, yaw_deg=90.0)
