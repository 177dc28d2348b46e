"""What hangs before windows and beside doors. Sizes are our own choice where nothing else is said."""

from __future__ import annotations

from .joinery import Joinery, furniture

# Plates of rocker switches are 2 3/4 by 4 1/2 in: common US sizes, from memory [m].
PLATE = (0.07, 0.115, 0.006)  # wide, high, thick
_ROCKER = (0.033, 0.066, 0.006)


@furniture("curtain_window")
def make_curtains(
    made: Joinery, *, width: float = 1.4, head: float = 2.1, low: float = 0.04
) -> None:
    """Make two curtains, drawn back to the sides of a window, on a rod.

    The window is `width` [m] wide with its upper edge at `head` [m]; they end `low` [m] over the floor.
    """
    reach, rod = 0.5 * width + 0.3, head + 0.12
    made.rod([(0.09, -reach, rod), (0.09, reach, rod)], 0.012, "metal_dark")
    for y in (-reach, reach):
        made.rod([(0.09, y - 0.02, rod), (0.09, y + 0.02, rod)], 0.022, "metal_dark")
        made.rod([(0.0, 0.96 * y, rod), (0.09, 0.96 * y, rod)], 0.008, "metal_dark")
    for sign in (-1, 1):
        for fold in range(6):  # round folds; cloth gives way, so it is for the eye only
            x, y = 0.09 + 0.018 * (fold % 2), sign * (reach - 0.05 - 0.052 * fold)
            spread = sign * 0.012 * (2.5 - fold)
            made.rod([(x, y + spread, low), (x, y, rod - 0.015)], 0.034, "curtain")
    made.blocks = False


@furniture("blind")
def make_blind(made: Joinery, *, width: float = 1.2, head: float = 2.1, drop: float = 1.2) -> None:
    """Make a panel blind: half drawn at rest; the lower panel comes down behind the upper one.

    The window is `width` wide and `drop` high, with its upper edge at `head` [m].
    """
    half, size, top = 0.5 * width + 0.04, 0.5 * drop, head + 0.06
    high = top - 0.05
    low = high - size
    made.box((0.0, -half - 0.02, high), (0.07, half + 0.02, top + 0.02), "trim")
    made.show((0.04, -half, low), (0.046, half, high), "curtain")
    density = 0.5 / (0.012 * 2 * half * (size + 0.02))
    # It weighs half a kilogram; the friction of its roll holds that.
    at, way = (0.025, 0.0, low), 0.92 * size
    panel = made.joint(
        "panel", at, "-z", way, slides=True, density=density, damping=8.0, friction=8.0
    )
    y, z = half - 0.01, low - 0.03
    panel.box((0.019, -half + 0.01, low - 0.02), (0.031, y, low + size), "fabric_light")
    panel.show((0.014, -half + 0.01, low - 0.035), (0.036, y, low - 0.012), "trim")
    panel.post((0.03, 0.0, z), low - 0.12, 0.004, "paper")
    panel.post((0.03, 0.0, low - 0.16), low - 0.12, 0.01, "wood", solid=True)
    made.frame("handle_panel", (0.03, 0.0, low - 0.14), "toggle on the lower edge")
    made.blocks = False


@furniture("light_switch")
def make_light_switch(made: Joinery) -> None:
    """Make a light switch with a rocker, at the height that the level wants.

    It has no solid shape: nobody bumps into a plate of 6 mm.
    """
    z, (wide, high, thick), (a, b, c) = made.ruled("switch_height"), PLATE, _ROCKER
    made.slab((0.5 * thick, 0.0, z), (thick, wide, high), "trim", solid=False)
    made.slab((thick + 0.5 * c, 0.0, z), (c, a, b), "white", solid=False)
    made.frame("rocker", (thick + c, 0.0, z), "to press, x out of the wall")
    made.outline(thick + c, 0.5 * wide, z + 0.5 * high)
    made.blocks = False
