"""What warms a room. Sizes are common ones, from memory."""

from __future__ import annotations

import math

from rcare_marl.model.shape import Shape

from ..piece import Piece, Setting, maker
from .joinery import Joinery


@maker("fireplace")
def make_fireplace(setting: Setting, *, width: float = 1.4) -> Piece:
    """Make a fireplace with a stone surround, a mantel and logs on the grate."""
    fire, half, high, deep, gap = Joinery("fireplace", setting), 0.5 * width, 1.1, 0.32, 0.4
    for y0, y1 in ((-half, -gap), (gap, half)):
        fire.box((0.0, y0, 0.0), (deep, y1, high), "trim")
        fire.box((deep, y0 + 0.05, 0.0), (deep + 0.02, y1 - 0.05, high - 0.08), "trim", solid=False)
    fire.box((0.0, -gap, 0.7), (deep, gap, high), "trim")
    fire.box((deep, -gap + 0.02, 0.74), (deep + 0.02, gap - 0.02, high - 0.08), "trim", solid=False)
    fire.box((0.0, -half - 0.07, high), (deep + 0.07, half + 0.07, high + 0.05), "wood_dark")
    fire.box((0.0, -gap, 0.0), (0.03, gap, 0.7), "black")
    for y in (-gap, gap - 0.012):
        fire.box((0.03, y, 0.03), (deep - 0.03, y + 0.012, 0.7), "metal_dark", solid=False)
    fire.box((0.03, -half, 0.0), (deep + 0.35, half, 0.03), "paving")
    _logs(fire)
    for y in (-0.5 * half, -0.35 * half):
        fire.rod([(0.18, y, high + 0.05), (0.18, y, high + 0.23)], 0.018, "linen")
        fire.rod([(0.18, y, high + 0.05), (0.18, y, high + 0.06)], 0.04, "brass")
    fire.box(
        (0.12, 0.35 * half, high + 0.05), (0.2, 0.35 * half + 0.2, high + 0.27), "wood", solid=False
    )
    fire.rod(
        [(0.2, 0.35 * half + 0.1, high + 0.17), (0.203, 0.35 * half + 0.1, high + 0.17)],
        0.075,
        "white",
    )
    fire.stand_zone(-half, half, 0.6, x=deep + 0.35)
    return fire.piece()


def _logs(fire: Joinery) -> None:
    """Lay logs with a small flame on a grate; all of it is solid as one box."""
    for y in (-0.2, 0.0, 0.2):
        fire.box((0.08, y - 0.01, 0.03), (0.28, y + 0.01, 0.1), "metal_dark", solid=False)
    for x, z, turn in ((0.13, 0.14, 0.05), (0.23, 0.14, -0.06), (0.18, 0.22, 0.1)):
        fire.rod([(x - turn, -0.25, z), (x + turn, 0.25, z)], 0.042, "wood_dark")
    for y, tall in ((-0.08, 0.2), (0.03, 0.3), (0.12, 0.18)):
        flame = ((0.0, 0.0), (0.05, 0.06), (0.03, 0.5 * tall), (0.0, tall))
        fire.draw(Shape(kind="lathe", material="accent", at=(0.18, y, 0.24), profile=flame))
    fire.box((0.08, -0.28, 0.03), (0.28, 0.28, 0.26), "", seen=False)


@maker("radiator")
def make_radiator(setting: Setting, *, width: float = 1.0, height: float = 0.6) -> Piece:
    """Make a ribbed radiator under a window, with a valve that turns."""
    radiator, half, low = Joinery("radiator", setting), 0.5 * width, 0.12
    count = max(3, round(width / 0.09))
    for k in range(count):
        y = -half + (k + 0.5) * width / count
        radiator.box((0.04, y - 0.03, low), (0.13, y + 0.03, low + height), "trim", solid=False)
    for z in (low + 0.05, low + height - 0.05):
        radiator.box((0.06, -half, z - 0.02), (0.11, half, z + 0.02), "trim", solid=False)
    radiator.box((0.0, -half, low), (0.13, half, low + height), "", seen=False)
    y = half + 0.04
    radiator.rod([(0.085, y, 0.0), (0.085, y, 0.2)], 0.01, "metal", solid=True)
    radiator.rod([(0.085, half, 0.17), (0.085, y, 0.17)], 0.01, "metal")
    radiator.moving(
        "valve", "revolute", (0.085, y, 0.225), (0.0, 0.0, 1.0), math.radians(270.0), damping=0.01
    )
    radiator.box(
        (0.06, y - 0.014, 0.2), (0.11, y + 0.014, 0.25), "white", link="valve", bevel=0.008
    )
    radiator.frame(
        "handle_valve", (0.11, y, 0.225), "rim of the valve, turned along y", yaw_deg=90.0
    )
    return radiator.piece()
