"""What stands in closets, pantries and workshops. Sizes are our own choice, unless a rule sets them."""

from __future__ import annotations

import math

from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from ..piece import Piece, Setting, maker
from .bedroom import hang_clothes
from .joinery import BOARD, Joinery

_JARS = ("rug", "accent", "leaf", "paper", "clay", "linen", "brass", "wood_dark")


def _height(setting: Setting) -> float:
    """Return how high shelves go: from level 2 on, the highest is within reach of who sits [m]."""
    return 1.9 if setting.rules.level == 1 else 1.2


def _rack(
    piece: Joinery, span: tuple[float, float], deep: float, high: float, count: int
) -> list[float]:
    """Add an open rack of `count` shelves from the floor to `high`; return the tops of the shelves [m]."""
    for y in (span[0], span[1] - BOARD):
        piece.box((0.0, y, 0.0), (deep, y + BOARD, high), "wood_light")
    tops = []
    for k in range(count):
        z = 0.06 + k * (high - 0.06 - BOARD) / (count - 1)
        piece.box((0.0, span[0] + BOARD, z), (deep, span[1] - BOARD, z + BOARD), "wood_light")
        tops.append(z + BOARD)
    return tops


@maker("closet_shelves")
def make_closet_shelves(setting: Setting, *, width: float = 1.6) -> Piece:
    """Make an open closet: a rail with clothes on the left, shelves with folded linen on the right."""
    closet, half, deep = Joinery("closet_shelves", setting), 0.5 * width, 0.5
    rail = setting.rules.figure("wardrobe_rail_height")
    middle = -half + 0.4 * width
    high = rail + 0.15
    for k, z in enumerate(_rack(closet, (-half, middle), deep, high, 5)[:-1]):
        y = -half + 0.05
        while y + 0.24 < middle:
            count, material = (
                2 + (k + int(10 * abs(y))) % 3,
                ("towel", "linen", "blanket", "rug")[(k + int(20 * abs(y))) % 4],
            )
            for n in range(count):
                closet.box(
                    (0.06, y, z + 0.05 * n),
                    (0.4, y + 0.22, z + 0.05 * n + 0.045),
                    material,
                    solid=False,
                )
            y += 0.25
    closet.box((0.0, middle, high - BOARD), (deep, half, high), "wood_light")
    closet.box((0.0, half - BOARD, 0.0), (deep, half, high - BOARD), "wood_light")
    closet.rod([(0.27, middle, rail), (0.27, half - BOARD, rail)], 0.0125, "metal", solid=True)
    hang_clothes(closet, (middle + 0.05, half - 0.2), rail)
    closet.box((0.1, middle + 0.1, high), (0.42, middle + 0.5, high + 0.2), "paper", solid=False)
    closet.measures["wardrobe_rail_height"] = rail
    closet.frame("rail", (0.27, 0.5 * (middle + half), rail), "middle of the rail")
    closet.stand_zone(-half, half, 0.6, x=deep)
    return closet.piece()


@maker("pantry_shelves")
def make_pantry_shelves(setting: Setting, *, width: float = 1.0) -> Piece:
    """Make shelves with jars, tins and boxes; from level 2 on none is higher than a seated person reaches."""
    pantry, half, deep = Joinery("pantry_shelves", setting), 0.5 * width, 0.35
    high = _height(setting)
    count = 5 if high > 1.5 else 4
    for k, z in enumerate(_rack(pantry, (-half, half), deep, high, count)[:-1]):
        y, n = -half + 0.06, k
        while y < half - 0.1:
            material = _JARS[(3 * n + 2 * k) % len(_JARS)]
            if (n + k) % 3 == 2:
                pantry.box((0.08, y - 0.03, z), (0.28, y + 0.05, z + 0.2), material, solid=False)
            else:
                tall = 0.11 + 0.02 * ((n + k) % 4)
                pantry.rod([(0.2, y, z), (0.2, y, z + tall)], 0.04, material)
                pantry.rod([(0.2, y, z + tall), (0.2, y, z + tall + 0.012)], 0.036, "metal")
            y, n = y + 0.13, n + 1
        pantry.box((0.08, -half + 0.03, z), (0.28, half - 0.05, z + 0.12), "", seen=False)
    pantry.stand_zone(-half, half, 0.6, x=deep)
    return pantry.piece()


@maker("workbench")
def make_workbench(setting: Setting, *, width: float = 1.6) -> Piece:
    """Make a workbench with a vice, a drawer and tools on the wall; one can sit at it from level 2 on."""
    rules, half, deep = setting.rules, 0.5 * width, 0.65
    top = 0.9 if rules.level == 1 else rules.figure("table_height")
    bench = Joinery("workbench", setting)
    bench.box((0.0, -half, top - 0.04), (deep, half, top), "wood")
    bench.legs(
        Rectangle(0.02, -half + 0.02, deep - 0.04, half - 0.02), top - 0.04, 0.08, "wood_light"
    )
    low, y0, y1 = top - 0.2, half - 0.6, half - 0.1
    for y in (y0, y1 - BOARD):
        bench.box((0.1, y, low), (deep - 0.03, y + BOARD, top - 0.04), "wood_light")
    bench.drawer(
        "drawer", (0.1, y0 + BOARD, low), (deep - 0.03, y1 - BOARD, top - 0.04), "wood_light"
    )
    bench.box((0.03, -half + 0.1, 0.12), (0.33, half - 0.1, 0.12 + BOARD), "wood_light")
    for k, material in enumerate(("clay", "metal_dark", "blanket")):
        bench.box(
            (0.06, 0.12 + 0.2 * k - 0.3, 0.138),
            (0.26, 0.27 + 0.2 * k - 0.3, 0.3),
            material,
            solid=False,
        )
    bench.box(
        (deep - 0.02, -half + 0.15, top - 0.12), (deep + 0.04, -half + 0.37, top), "metal_dark"
    )
    bench.rod(
        [(deep + 0.04, -half + 0.26, top - 0.06), (deep + 0.13, -half + 0.26, top - 0.06)],
        0.012,
        "metal",
    )
    bench.rod(
        [(deep + 0.12, -half + 0.16, top - 0.06), (deep + 0.12, -half + 0.36, top - 0.06)],
        0.007,
        "metal",
    )
    _tools(bench, half, top)
    bench.knee.append(Rectangle(0.33, -half + 0.4, deep, y0))
    bench.frame("tabletop", (0.5 * deep, 0.0, top), "middle of the top")
    bench.stand_zone(-half, half, 0.7, x=deep)
    return bench.piece()


def _tools(bench: Joinery, half: float, top: float) -> None:
    """Hang tools on a board over the bench, for the eye only."""
    low = top + 0.25
    bench.box((0.0, -half + 0.1, low), (0.015, half - 0.1, low + 0.6), "wood_light")
    for k in range(3):  # hammers
        y = -half + 0.25 + 0.14 * k
        bench.rod([(0.03, y, low + 0.18), (0.03, y, low + 0.46)], 0.012, "wood")
        bench.box(
            (0.018, y - 0.05, low + 0.45), (0.042, y + 0.05, low + 0.48), "metal_dark", solid=False
        )
    bench.slab(
        (0.022, 0.1, low + 0.33), (0.004, 0.42, 0.1), "metal", rpy=(0.12, 0.0, 0.0), solid=False
    )
    bench.box((0.016, 0.3, low + 0.3), (0.036, 0.4, low + 0.42), "wood", solid=False)
    for k in range(4):  # screwdrivers
        y = half - 0.2 - 0.06 * k
        bench.rod([(0.028, y, low + 0.2), (0.028, y, low + 0.36)], 0.004, "metal")
        bench.rod(
            [(0.028, y, low + 0.36), (0.028, y, low + 0.46)],
            0.012,
            ("accent", "rug", "blanket")[k % 3],
        )


@maker("plant_stand")
def make_plant_stand(setting: Setting, *, width: float = 0.8) -> Piece:
    """Make a stand of two steps with potted plants."""
    stand, half = Joinery("plant_stand", setting), 0.5 * width
    for y in (-half, half - 0.03):
        stand.box((0.02, y, 0.0), (0.05, y + 0.03, 0.6), "wood_dark")
        stand.box((0.45, y, 0.0), (0.48, y + 0.03, 0.3), "wood_dark")
        stand.box((0.05, y, 0.25), (0.45, y + 0.03, 0.28), "wood_dark")
    stand.box((0.0, -half, 0.6), (0.28, half, 0.62), "wood_dark")
    stand.box((0.28, -half, 0.3), (0.52, half, 0.32), "wood_dark")
    for x, z, places in ((0.17, 0.62, (-0.25, 0.25)), (0.4, 0.32, (-0.25, 0.25))):
        for k, share in enumerate(places):
            y = share * width
            pot = ((0.055, 0.0), (0.08, 0.12), (0.07, 0.12), (0.06, 0.1))
            stand.draw(
                Shape(kind="lathe", material=("clay", "ceramic")[k % 2], at=(x, y, z), profile=pot)
            )
            stand.solid(Shape(kind="cylinder", at=(x, y, z + 0.06), radius=0.075, length=0.12))
            for leaf in range(7):
                turn, lean = 2.4 * leaf + k, 0.12 + 0.07 * leaf
                tall = (0.3 - 0.012 * leaf) * (1.2 if z > 0.5 else 0.9)
                out, up = 0.5 * tall * math.sin(lean), 0.5 * tall * math.cos(lean)
                at = (x + out * math.cos(turn), y + out * math.sin(turn), z + 0.1 + up)
                stand.slab(at, (0.005, 0.035, tall), "leaf", rpy=(0.0, lean, turn), solid=False)
    return stand.piece()
