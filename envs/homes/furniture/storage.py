"""What stands in closets, pantries and workshops. Sizes are our own choice, unless a rule sets them."""

from __future__ import annotations

import math

from ...rectangle import Rectangle
from .bedroom import hang_clothes
from .joinery import BOARD, Joinery, furniture

_JARS = ("rug", "accent", "leaf", "paper", "clay", "linen", "brass", "wood_dark")


def _rack(
    made: Joinery, span: tuple[float, float], deep: float, high: float, count: int
) -> list[float]:
    """Add an open rack of `count` shelves up to `high`; return the tops of all but the highest [m]."""
    low, far = span
    made.sides((0.0, low, 0.0), (deep, far, high), BOARD, "wood_light")
    tops = []
    for k in range(count):
        z = 0.06 + k * (high - 0.06 - BOARD) / (count - 1)
        made.box((0.0, low + BOARD, z), (deep, far - BOARD, z + BOARD), "wood_light")
        tops.append(z + BOARD)
    return tops[:-1]


@furniture("closet_shelves")
def make_closet_shelves(made: Joinery, *, width: float = 1.6) -> None:
    """Make an open closet: a rail with clothes on the left, shelves with folded linen on the right."""
    half, deep, rail = 0.5 * width, 0.5, made.ruled("wardrobe_rail_height")
    middle, high = -half + 0.4 * width, rail + 0.15
    for k, z in enumerate(_rack(made, (-half, middle), deep, high, 5)):
        y = -half + 0.05
        while y + 0.24 < middle:
            material = ("towel", "linen", "blanket", "rug")[(k + int(20 * abs(y))) % 4]
            for n in range(2 + (k + int(10 * abs(y))) % 3):
                low = z + 0.05 * n
                made.show((0.06, y, low), (0.4, y + 0.22, low + 0.045), material)
            y += 0.25
    made.box((0.0, middle, high - BOARD), (deep, half, high), "wood_light")
    made.box((0.0, half - BOARD, 0.0), (deep, half, high - BOARD), "wood_light")
    made.rod([(0.27, middle, rail), (0.27, half - BOARD, rail)], 0.0125, "metal", solid=True)
    hang_clothes(made, (middle + 0.05, half - 0.2), rail)
    made.show((0.1, middle + 0.1, high), (0.42, middle + 0.5, high + 0.2), "paper")
    made.frame("rail", (0.27, 0.5 * (middle + half), rail), "middle of the rail")
    made.stand_zone(-half, half, 0.6, x=deep)


@furniture("pantry_shelves")
def make_pantry_shelves(made: Joinery, *, width: float = 1.0) -> None:
    """Make shelves with jars, tins and boxes; from level 2 on none is higher than a seated person reaches."""
    half, deep, is_high = 0.5 * width, 0.35, made.rules.level == 1
    shelves = _rack(made, (-half, half), deep, 1.9 if is_high else 1.2, 5 if is_high else 4)
    for k, z in enumerate(shelves):
        y, n = -half + 0.06, k
        while y < half - 0.1:
            material, top = _JARS[(3 * n + 2 * k) % len(_JARS)], z + (0.11 + 0.02 * ((n + k) % 4))
            if (n + k) % 3 == 2:
                made.show((0.08, y - 0.03, z), (0.28, y + 0.05, z + 0.2), material)
            else:
                made.post((0.2, y, z), top, 0.04, material)
                made.post((0.2, y, top), top + 0.012, 0.036, "metal")
            y, n = y + 0.13, n + 1
        made.block((0.08, -half + 0.03, z), (0.28, half - 0.05, z + 0.12))
    made.stand_zone(-half, half, 0.6, x=deep)


@furniture("workbench")
def make_workbench(made: Joinery, *, width: float = 1.6) -> None:
    """Make a workbench with a vice, a drawer and tools on the wall; one can sit at it from level 2 on."""
    half, deep = 0.5 * width, 0.65
    top = 0.9 if made.rules.level == 1 else made.rules.figure("table_height")
    under, low, y0, y1 = top - 0.04, top - 0.2, half - 0.6, half - 0.1
    made.box((0.0, -half, under), (deep, half, top), "wood")
    feet = Rectangle(0.02, -half + 0.02, deep - 0.04, half - 0.02)
    made.legs(feet, under, 0.08, "wood_light")
    made.sides((0.1, y0, low), (deep - 0.03, y1, under), BOARD, "wood_light")
    a, b = (0.1, y0 + BOARD, low), (deep - 0.03, y1 - BOARD, under)
    made.drawer("drawer", a, b, "wood_light")
    made.box((0.03, -half + 0.1, 0.12), (0.33, half - 0.1, 0.12 + BOARD), "wood_light")
    for k, material in enumerate(("clay", "metal_dark", "blanket")):
        y = 0.12 + 0.2 * k - 0.3
        made.show((0.06, y, 0.138), (0.26, 0.27 + 0.2 * k - 0.3, 0.3), material)
    y, z, face = -half + 0.26, top - 0.06, deep + 0.04  # a vice
    made.box((deep - 0.02, -half + 0.15, top - 0.12), (face, -half + 0.37, top), "metal_dark")
    made.rod([(face, y, z), (deep + 0.13, y, z)], 0.012, "metal")
    made.rod([(deep + 0.12, -half + 0.16, z), (deep + 0.12, -half + 0.36, z)], 0.007, "metal")
    _tools(made, half, top)
    made.knee.append(Rectangle(0.33, -half + 0.4, deep, y0))
    made.frame("tabletop", (0.5 * deep, 0.0, top), "middle of the top")
    made.stand_zone(-half, half, 0.7, x=deep)


def _tools(made: Joinery, half: float, top: float) -> None:
    """Hang tools on a board over the bench, for the eye only."""
    low = top + 0.25
    made.box((0.0, -half + 0.1, low), (0.015, half - 0.1, low + 0.6), "wood_light")
    for k in range(3):  # hammers
        y = -half + 0.25 + 0.14 * k
        made.post((0.03, y, low + 0.18), low + 0.46, 0.012, "wood")
        made.show((0.018, y - 0.05, low + 0.45), (0.042, y + 0.05, low + 0.48), "metal_dark")
    saw = (0.022, 0.1, low + 0.33)
    made.slab(saw, (0.004, 0.42, 0.1), "metal", rpy=(0.12, 0.0, 0.0), solid=False)
    made.show((0.016, 0.3, low + 0.3), (0.036, 0.4, low + 0.42), "wood")
    for k in range(4):  # screwdrivers
        y, material = half - 0.2 - 0.06 * k, ("accent", "rug", "blanket")[k % 3]
        made.post((0.028, y, low + 0.2), low + 0.36, 0.004, "metal")
        made.post((0.028, y, low + 0.36), low + 0.46, 0.012, material)


@furniture("plant_stand")
def make_plant_stand(made: Joinery, *, width: float = 0.8) -> None:
    """Make a stand of two steps with potted plants."""
    half = 0.5 * width
    for y in (-half, half - 0.03):
        made.box((0.02, y, 0.0), (0.05, y + 0.03, 0.6), "wood_dark")
        made.box((0.45, y, 0.0), (0.48, y + 0.03, 0.3), "wood_dark")
        made.box((0.05, y, 0.25), (0.45, y + 0.03, 0.28), "wood_dark")
    made.box((0.0, -half, 0.6), (0.28, half, 0.62), "wood_dark")
    made.box((0.28, -half, 0.3), (0.52, half, 0.32), "wood_dark")
    pot = ((0.055, 0.0), (0.08, 0.12), (0.07, 0.12), (0.06, 0.1))
    for x, z, growth in ((0.17, 0.62, 1.2), (0.4, 0.32, 0.9)):
        for k, material in enumerate(("clay", "ceramic")):
            y = (0.5 * k - 0.25) * width
            made.lathe((x, y, z), pot, material)
            made.cylinder((x, y, z + 0.06), 0.075, 0.12)
            for leaf in range(7):
                turn, lean = 2.4 * leaf + k, 0.12 + 0.07 * leaf
                tall = (0.3 - 0.012 * leaf) * growth
                out, up = 0.5 * tall * math.sin(lean), 0.5 * tall * math.cos(lean)
                at = (x + out * math.cos(turn), y + out * math.sin(turn), z + 0.1 + up)
                made.slab(at, (0.005, 0.035, tall), "leaf", rpy=(0.0, lean, turn), solid=False)
