"""What stands in halls and entries. Sizes are common ones, from memory, unless a rule sets them."""

from __future__ import annotations

import math

from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from ..piece import Piece, Setting, maker
from .joinery import BOARD, Joinery


@maker("coat_rack")
def make_coat_rack(setting: Setting, *, width: float = 0.9) -> Piece:
    """Make a board with hooks on the wall, some coats and a bag; within reach of a seated person by rule."""
    rack, half = Joinery("coat_rack", setting), 0.5 * width
    high = min(setting.rules.figure("wardrobe_rail_height"), 1.65)
    rack.box((0.0, -half, high - 0.08), (0.02, half, high + 0.08), "wood")
    count = max(3, round(width / 0.2))
    coats = ("fabric", "rug", "", "wood_dark", "", "leaf")
    for k in range(count):
        y = -half + (k + 0.5) * width / count
        rack.rod([(0.02, y, high), (0.08, y, high), (0.1, y, high + 0.05)], 0.008, "metal_dark")
        coat = coats[k % len(coats)]
        if not coat:
            continue
        length = min(0.95, high - 0.3) - 0.06 * (k % 3)
        _hang_coat(rack, y, high, length, coat)
    rack.frame("hook", (0.08, -half + 2.5 * width / count, high), "a free hook")
    return rack.piece()


def _hang_coat(rack: Joinery, y: float, high: float, length: float, material: str) -> None:
    """Hang a coat, flat, with shoulders and sleeves, on a hook at `y`; it gives way."""
    shoulder = high - 0.13
    outline = (
        (0.2, high - length),
        (0.17, shoulder - 0.25),
        (0.19, shoulder),
        (0.08, high - 0.05),
        (0.05, high + 0.01),
    )
    rack.draw(
        Shape(
            kind="lathe",
            material=material,
            at=(0.1, y, 0.0),
            scale=(0.36, 0.75, 1.0),
            profile=outline,
        )
    )
    for sign in (-1, 1):
        sleeve = [(0.11, y + 0.12 * sign, shoulder), (0.13, y + 0.15 * sign, shoulder - 0.5)]
        rack.rod(sleeve, 0.045, material)


@maker("shoe_bench")
def make_shoe_bench(setting: Setting, *, width: float = 0.9) -> Piece:
    """Make a bench to put on shoes, with a shelf of shoes below."""
    bench, half, top = (
        Joinery("shoe_bench", setting),
        0.5 * width,
        setting.rules.figure("seat_height"),
    )
    for y in (-half, half - BOARD):
        bench.box((0.0, y, 0.0), (0.36, y + BOARD, top - 0.06), "wood")
    for z in (0.03, 0.2):
        bench.box((0.0, -half + BOARD, z), (0.36, half - BOARD, z + BOARD), "wood")
    bench.box((0.0, -half, top - 0.06 - BOARD), (0.36, half, top - 0.06), "wood")
    bench.box((0.0, -half, top - 0.06), (0.36, half, top), "fabric_light", bevel=0.025)
    count = int((width - 0.1) / 0.25)
    for level, z in enumerate((0.03 + BOARD, 0.2 + BOARD)):
        for k in range(count):
            y = -half + 0.07 + 0.25 * k
            material = ("wood_dark", "rug", "black", "white", "fabric")[(2 * k + level) % 5]
            for shift in (0.0, 0.105):
                bench.box(
                    (0.06, y + shift, z), (0.33, y + shift + 0.09, z + 0.045), material, solid=False
                )
                bench.box(
                    (0.06, y + shift + 0.01, z + 0.045),
                    (0.18, y + shift + 0.08, z + 0.09),
                    material,
                    solid=False,
                )
    bench.measures["seat_height"] = top
    bench.frame("seat", (0.18, 0.0, top), "middle of the seat")
    bench.stand_zone(-half, half, 0.5, x=0.36)
    return bench.piece()


@maker("console_table")
def make_console_table(setting: Setting, *, width: float = 1.0) -> Piece:
    """Make a narrow table for keys and post, with a drawer, a bowl and a vase."""
    table, half, deep, top = Joinery("console_table", setting), 0.5 * width, 0.32, 0.8
    table.box((0.0, -half, top - 0.022), (deep, half, top), "wood")
    table.legs(Rectangle(0.01, -half + 0.01, deep - 0.01, half - 0.01), top - 0.022, 0.035, "wood")
    wide = min(0.45, width - 0.1)
    low = top - 0.13
    for y in (-0.5 * wide - BOARD, 0.5 * wide):
        table.box((0.02, y, low), (deep - 0.02, y + BOARD, top - 0.022), "wood")
    table.box((0.01, -half + 0.045, low), (0.022, half - 0.045, top - 0.022), "wood")
    table.drawer(
        "drawer", (0.03, -0.5 * wide, low), (deep - 0.02, 0.5 * wide, top - 0.022), "wood_light"
    )
    table.box((0.02, -half + 0.02, 0.15), (deep - 0.02, half - 0.02, 0.17), "wood")
    bowl = ((0.03, 0.0), (0.09, 0.05), (0.084, 0.05), (0.025, 0.008))
    table.draw(Shape(kind="lathe", material="ceramic", at=(0.18, -0.25 * width, top), profile=bowl))
    vase = ((0.04, 0.0), (0.06, 0.09), (0.03, 0.19), (0.04, 0.22))
    table.draw(Shape(kind="lathe", material="blanket", at=(0.15, 0.33 * width, top), profile=vase))
    for k in range(5):
        angle = 2 * math.pi * k / 5
        x, y = 0.15 + 0.09 * math.cos(angle), 0.33 * width + 0.09 * math.sin(angle)
        table.rod([(0.15, 0.33 * width, top + 0.2), (x, y, top + 0.42)], 0.004, "leaf")
        table.rod([(x, y, top + 0.4), (x, y, top + 0.43)], 0.022, ("rug", "accent", "linen")[k % 3])
    table.frame("tabletop", (0.5 * deep, 0.0, top), "free part of the top")
    table.stand_zone(-0.5 * wide, 0.5 * wide, 0.5, x=deep)
    return table.piece()


@maker("mirror_wall")
def make_mirror(
    setting: Setting, *, width: float = 0.5, height: float = 1.3, low: float = 0.5
) -> Piece:
    """Make a framed mirror on the wall, from `low` up [m]; low enough for a person who sits."""
    mirror, half = Joinery("mirror_wall", setting), 0.5 * width
    mirror.box((0.0, -half, low), (0.022, half, low + height), "wood_dark")
    mirror.box(
        (0.022, -half + 0.03, low + 0.03),
        (0.026, half - 0.03, low + height - 0.03),
        "mirror",
        solid=False,
    )
    mirror.frame("mirror", (0.026, 0.0, low + 0.5 * height), "middle of the glass, x out of it")
    return mirror.piece(blocks=False)


@maker("umbrella_stand")
def make_umbrella_stand(setting: Setting) -> Piece:
    """Make an open stand with two umbrellas and a walking stick in it."""
    stand, x, radius, high = Joinery("umbrella_stand", setting), 0.14, 0.11, 0.5
    wall = (
        (0.0, 0.0),
        (radius, 0.0),
        (radius, high),
        (radius - 0.012, high),
        (radius - 0.012, 0.015),
        (0.0, 0.015),
    )
    stand.draw(Shape(kind="lathe", material="metal_dark", at=(x, 0.0, 0.0), profile=wall))
    stand.solid(Shape(kind="cylinder", at=(x, 0.0, 0.0075), radius=radius, length=0.015))
    for k in range(8):  # staves, so that it is hollow
        angle = 2 * math.pi * k / 8
        at = (
            x + (radius - 0.006) * math.cos(angle),
            (radius - 0.006) * math.sin(angle),
            0.5 * high,
        )
        size = (0.012, 2 * radius * math.tan(math.pi / 8), high)
        stand.solid(Shape(kind="box", at=at, rpy=(0.0, 0.0, angle), size=size))
    for dx, dy, material in ((0.04, 0.03, "rug"), (-0.03, 0.05, "fabric")):
        foot, tip = (x - 0.4 * dx, -0.6 * dy, 0.02), (x + dx, dy, 0.86)
        stand.rod([foot, tip], 0.006, "wood_dark")
        middle = (x + 0.5 * dx, 0.5 * dy, 0.68)
        stand.rod([(x - 0.1 * dx, -0.3 * dy, 0.25), middle], 0.026, material)
        stand.rod(
            [
                tip,
                (tip[0], tip[1], 0.9),
                (tip[0] + 0.07, tip[1], 0.9),
                (tip[0] + 0.07, tip[1], 0.86),
            ],
            0.01,
            "wood",
            bend=0.03,
        )
    stand.rod(
        [(x + 0.02, -0.05, 0.02), (x - 0.03, -0.07, 0.88), (x - 0.03, 0.02, 0.9)],
        0.011,
        "wood",
        bend=0.05,
    )
    return stand.piece()
