"""What stands in a room for exercise. Sizes are common ones, from memory."""

from __future__ import annotations

from rcare_marl.errors import ConfigError

from ...rectangle import Rectangle
from ..piece import Zone
from .joinery import Joinery, furniture

_COLOURS = ("rubber", "fabric", "rug", "rubber", "blanket")


@furniture("treadmill")
def make_treadmill(made: Joinery) -> None:
    """Make a treadmill; who walks on it faces the wall."""
    half, long, lean = 0.4, 1.75, (0.0, -0.6, 0.0)
    made.box((0.05, -half, 0.02), (long, half, 0.14), "metal_dark")
    made.box((0.3, -0.25, 0.14), (long - 0.03, 0.25, 0.155), "rubber")
    made.sides((0.3, -half, 0.14), (long - 0.03, half, 0.165), 0.13, "metal")
    made.box((0.02, -half, 0.02), (0.32, half, 0.24), "black", bevel=0.04)
    for y in (-half + 0.05, half - 0.05):
        made.rod([(0.2, y, 0.2), (0.3, y, 1.15), (0.75, y, 0.98)], 0.025, "metal", bend=0.1)
        made.block((0.17, y - 0.03, 0.2), (0.33, y + 0.03, 1.15))
        made.block((0.3, y - 0.025, 0.96), (0.76, y + 0.025, 1.1))
    made.slab((0.3, 0.0, 1.18), (0.06, 2 * half, 0.24), "black", rpy=lean, bevel=0.02)
    made.slab((0.332, 0.0, 1.2), (0.004, 0.4, 0.16), "blanket", rpy=lean, solid=False)
    note = "middle of the belt, x against the way one walks"
    made.frame("belt", (1.0, 0.0, 0.155), note, yaw_deg=180.0)
    made.stand_zone(-half, half, 0.9, x=long)


@furniture("exercise_mat")
def make_mat(made: Joinery, *, length: float = 1.8, width: float = 0.65) -> None:
    """Make a mat on the floor; thin and soft, so that it is for the eye only."""
    half = 0.5 * width
    made.show((0.0, -half, 0.0), (length, half, 0.01), "blanket")
    made.sides((0.0, -half, 0.01), (length, half, 0.011), 0.03, "towel", solid=False)
    made.frame("mat", (0.5 * length, 0.0, 0.0), "middle of the mat")
    made.blocks = False


@furniture("dumbbell_rack")
def make_dumbbell_rack(made: Joinery) -> None:
    """Make a rack of dumbbells in two rows, the heavy ones below."""
    half, lean = 0.55, (0.0, 0.25, 0.0)
    for y in (-half, half - 0.05):
        made.box((0.06, y, 0.0), (0.11, y + 0.05, 0.78), "metal_dark")
        made.box((0.0, y, 0.0), (0.5, y + 0.05, 0.04), "metal_dark")
    for z, x, size in ((0.68, 0.11, 0.04), (0.32, 0.16, 0.055)):
        made.slab((x + 0.11, 0.0, z), (0.26, 2 * half, 0.015), "metal", rpy=lean)
        for k, colour in enumerate(_COLOURS):
            y, r = -half + 0.14 + 0.205 * k, size * (1.0 - 0.07 * k)
            top = z + 0.01 + r
            made.rod([(x + 0.03, y, top + 0.02), (x + 0.21, y, top - 0.026)], 0.014, "metal")
            for a, b in ((0.02, 0.075), (0.165, 0.22)):
                made.rod([(x + d, y, top + 0.023 - 0.26 * d) for d in (a, b)], r, colour)
        whole = (0.24, 2 * half - 0.06, 1.6 * size)
        made.slab((x + 0.11, 0.0, z + size), whole, "", rpy=lean, seen=False)
    made.stand_zone(-half, half, 0.6, x=0.5)


@furniture("parallel_bars")
def make_parallel_bars(
    made: Joinery, *, length: float = 2.5, gap: float = 0.6, height: float = 0.86
) -> None:
    """Make parallel bars to learn to walk between, `length` [m] long, their tops at `height` [m].

    Between them are `gap` [m]; ConfigError if nobody could walk there.
    """
    if gap < 0.4:
        raise ConfigError(f"nobody walks between bars {gap} m apart; 0.4 m is the least")
    radius, wide = 0.02, 0.45 * gap
    aside = 0.5 * gap + radius
    for side, sign in (("right", -1), ("left", 1)):
        y, z = sign * aside, height - radius
        made.rod(((0.0, y, z), (length, y, z)), radius, "wood_light", solid=True)
        low, high = sorted((sign * (aside - 0.03), sign * (aside + 0.2)))
        for x in (0.25, length - 0.25):
            made.post((x, y, 0.0), height - 2 * radius, 0.022, "metal", solid=True)
            made.post((x, y, 0.0), 0.45, 0.03, "metal_dark")
            made.box((x - 0.15, low, 0.0), (x + 0.15, high, 0.015), "metal_dark")
        made.frame(f"bar_{side}", (0.5 * length, y, height), "top of a bar")
    made.show((0.0, -wide, 0.0), (length, wide, 0.004), "rubber")
    made.frame("start", (length + 0.1, 0.0, 0.0), "floor where one starts to walk", yaw_deg=180.0)
    made.zones.append(Zone(Rectangle(length, -aside, length + 0.9, aside)))
