"""What stands in halls and entries. Sizes are common ones, from memory, unless a rule sets them."""

from __future__ import annotations

import math

from ...rectangle import Rectangle
from .joinery import BOARD, Joinery, furniture


@furniture("coat_rack")
def make_coat_rack(made: Joinery, *, width: float = 0.9) -> None:
    """Make a board with hooks on the wall, some coats and a bag; within reach of a seated person by rule."""
    half, high = 0.5 * width, min(made.rules.figure("wardrobe_rail_height"), 1.65)
    made.box((0.0, -half, high - 0.08), (0.02, half, high + 0.08), "wood")
    count = max(3, round(width / 0.2))
    coats = ("fabric", "rug", "", "wood_dark", "", "leaf")
    for k in range(count):
        y, coat = -half + (k + 0.5) * width / count, coats[k % len(coats)]
        made.rod([(0.02, y, high), (0.08, y, high), (0.1, y, high + 0.05)], 0.008, "metal_dark")
        if coat:
            _hang_coat(made, y, high, min(0.95, high - 0.3) - 0.06 * (k % 3), coat)
    made.frame("hook", (0.08, -half + 2.5 * width / count, high), "a free hook")


def _hang_coat(made: Joinery, y: float, high: float, length: float, material: str) -> None:
    """Hang a coat, flat, with shoulders and sleeves, on a hook at `y`; it gives way."""
    shoulder = high - 0.13
    skirt = ((0.2, high - length), (0.17, shoulder - 0.25), (0.19, shoulder))
    outline = (*skirt, (0.08, high - 0.05), (0.05, high + 0.01))
    made.lathe((0.1, y, 0.0), outline, material, scale=(0.36, 0.75, 1.0))
    for sign in (-1, 1):
        sleeve = [(0.11, y + 0.12 * sign, shoulder), (0.13, y + 0.15 * sign, shoulder - 0.5)]
        made.rod(sleeve, 0.045, material)


@furniture("shoe_bench")
def make_shoe_bench(made: Joinery, *, width: float = 0.9) -> None:
    """Make a bench to put on shoes, with a shelf of shoes below."""
    half, top = 0.5 * width, made.ruled("seat_height")
    under = top - 0.06
    made.sides((0.0, -half, 0.0), (0.36, half, under), BOARD, "wood")
    for z in (0.03, 0.2):
        made.box((0.0, -half + BOARD, z), (0.36, half - BOARD, z + BOARD), "wood")
    made.box((0.0, -half, under - BOARD), (0.36, half, under), "wood")
    made.box((0.0, -half, under), (0.36, half, top), "fabric_light", bevel=0.025)
    count = int((width - 0.1) / 0.25)
    for level, z in enumerate((0.03 + BOARD, 0.2 + BOARD)):
        for k in range(count):
            material = ("wood_dark", "rug", "black", "white", "fabric")[(2 * k + level) % 5]
            for shift in (0.0, 0.105):
                y = -half + 0.07 + 0.25 * k + shift
                made.show((0.06, y, z), (0.33, y + 0.09, z + 0.045), material)
                made.show((0.06, y + 0.01, z + 0.045), (0.18, y + 0.08, z + 0.09), material)
    made.frame("seat", (0.18, 0.0, top), "middle of the seat")
    made.stand_zone(-half, half, 0.5, x=0.36)


@furniture("console_table")
def make_console_table(made: Joinery, *, width: float = 1.0) -> None:
    """Make a narrow table for keys and post, with a drawer, a bowl and a vase."""
    half, deep, top, wide = 0.5 * width, 0.32, 0.8, min(0.45, width - 0.1)
    under, low, front, y = top - 0.022, top - 0.13, deep - 0.02, 0.5 * wide
    made.box((0.0, -half, under), (deep, half, top), "wood")
    feet = Rectangle(0.01, -half + 0.01, deep - 0.01, half - 0.01)
    made.legs(feet, under, 0.035, "wood")
    for side in (-0.5 * wide - BOARD, y):
        made.box((0.02, side, low), (front, side + BOARD, under), "wood")
    made.box((0.01, -half + 0.045, low), (0.022, half - 0.045, under), "wood")
    made.drawer("drawer", (0.03, -y, low), (front, y, under), "wood_light")
    made.box((0.02, -half + 0.02, 0.15), (front, half - 0.02, 0.17), "wood")
    bowl = ((0.03, 0.0), (0.09, 0.05), (0.084, 0.05), (0.025, 0.008))
    made.lathe((0.18, -0.25 * width, top), bowl, "ceramic")
    vase, at = ((0.04, 0.0), (0.06, 0.09), (0.03, 0.19), (0.04, 0.22)), 0.33 * width
    made.lathe((0.15, at, top), vase, "blanket")
    for k in range(5):
        angle, colour = 2 * math.pi * k / 5, ("rug", "accent", "linen")[k % 3]
        x, y = 0.15 + 0.09 * math.cos(angle), at + 0.09 * math.sin(angle)
        made.rod([(0.15, at, top + 0.2), (x, y, top + 0.42)], 0.004, "leaf")
        made.post((x, y, top + 0.4), top + 0.43, 0.022, colour)
    made.frame("tabletop", (0.5 * deep, 0.0, top), "free part of the top")
    made.stand_zone(-0.5 * wide, 0.5 * wide, 0.5, x=deep)
