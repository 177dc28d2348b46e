"""What hangs before windows. Sizes are our own choice."""

from __future__ import annotations

from ..piece import Piece, Setting, maker
from .joinery import Joinery


@maker("curtain_window")
def make_curtains(
    setting: Setting, *, width: float = 1.4, head: float = 2.1, low: float = 0.04
) -> Piece:
    """Make two curtains, drawn back to the sides of a window, on a rod.

    Args:
        setting: What it is made for.
        width: Of the window [m].
        head: Height of its upper edge [m].
        low: How far over the floor they end [m].
    """
    curtains, reach, rod = Joinery("curtain_window", setting), 0.5 * width + 0.3, head + 0.12
    curtains.rod([(0.09, -reach, rod), (0.09, reach, rod)], 0.012, "metal_dark")
    for y in (-reach, reach):
        curtains.rod([(0.09, y - 0.02, rod), (0.09, y + 0.02, rod)], 0.022, "metal_dark")
        curtains.rod([(0.0, 0.96 * y, rod), (0.09, 0.96 * y, rod)], 0.008, "metal_dark")
    for sign in (-1, 1):
        for fold in range(6):  # round folds; cloth gives way, so it is for the eye only
            y = sign * (reach - 0.05 - 0.052 * fold)
            x = 0.09 + 0.018 * (fold % 2)
            spread = sign * 0.012 * (2.5 - fold)
            curtains.rod([(x, y + spread, low), (x, y, rod - 0.015)], 0.034, "curtain")
    return curtains.piece(blocks=False)


@maker("blind")
def make_blind(
    setting: Setting, *, width: float = 1.2, head: float = 2.1, drop: float = 1.2
) -> Piece:
    """Make a panel blind: half drawn at rest; the lower panel comes down behind the upper one.

    Args:
        setting: What it is made for.
        width: Of the window [m].
        head: Height of its upper edge [m].
        drop: Height of the window [m].
    """
    blind, half, panel = Joinery("blind", setting), 0.5 * width + 0.04, 0.5 * drop
    top = head + 0.06
    blind.box((0.0, -half - 0.02, top - 0.05), (0.07, half + 0.02, top + 0.02), "trim")
    blind.box((0.04, -half, top - 0.05 - panel), (0.046, half, top - 0.05), "curtain", solid=False)
    low = top - 0.05 - panel
    # It weighs half a kilogram; the friction of its roll holds that.
    blind.moving(
        "panel",
        "prismatic",
        (0.025, 0.0, low),
        (0.0, 0.0, -1.0),
        0.92 * panel,
        density=0.5 / (0.012 * 2 * half * (panel + 0.02)),
        damping=8.0,
        friction=8.0,
    )
    blind.box(
        (0.019, -half + 0.01, low - 0.02),
        (0.031, half - 0.01, low + panel),
        "fabric_light",
        link="panel",
    )
    blind.box(
        (0.014, -half + 0.01, low - 0.035),
        (0.036, half - 0.01, low - 0.012),
        "trim",
        link="panel",
        solid=False,
    )
    blind.rod([(0.03, 0.0, low - 0.03), (0.03, 0.0, low - 0.12)], 0.004, "paper", link="panel")
    blind.rod(
        [(0.03, 0.0, low - 0.16), (0.03, 0.0, low - 0.12)], 0.01, "wood", link="panel", solid=True
    )
    blind.frame("handle_panel", (0.03, 0.0, low - 0.14), "toggle on the lower edge")
    return blind.piece(blocks=False)
