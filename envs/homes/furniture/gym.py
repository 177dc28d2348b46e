"""What stands in a room for exercise. Sizes are common ones, from memory."""

from __future__ import annotations

from rcare_marl.errors import ConfigError

from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker
from .joinery import Joinery

_COLOURS = ("rubber", "fabric", "rug", "rubber", "blanket")


@maker("treadmill")
def make_treadmill(setting: Setting) -> Piece:
    """Make a treadmill; who walks on it faces the wall."""
    mill, half, long = Joinery("treadmill", setting), 0.4, 1.75
    mill.box((0.05, -half, 0.02), (long, half, 0.14), "metal_dark")
    mill.box((0.3, -0.25, 0.14), (long - 0.03, 0.25, 0.155), "rubber")
    for y in (-half, half - 0.13):
        mill.box((0.3, y, 0.14), (long - 0.03, y + 0.13, 0.165), "metal")
    mill.box((0.02, -half, 0.02), (0.32, half, 0.24), "black", bevel=0.04)
    for y in (-half + 0.05, half - 0.05):
        mill.rod([(0.2, y, 0.2), (0.3, y, 1.15), (0.75, y, 0.98)], 0.025, "metal", bend=0.1)
        for low, high in (
            ((0.17, y - 0.03, 0.2), (0.33, y + 0.03, 1.15)),
            ((0.3, y - 0.025, 0.96), (0.76, y + 0.025, 1.1)),
        ):
            mill.box(low, high, "", seen=False)
    mill.slab((0.3, 0.0, 1.18), (0.06, 2 * half, 0.24), "black", rpy=(0.0, -0.6, 0.0), bevel=0.02)
    mill.slab((0.332, 0.0, 1.2), (0.004, 0.4, 0.16), "blanket", rpy=(0.0, -0.6, 0.0), solid=False)
    mill.frame(
        "belt", (1.0, 0.0, 0.155), "middle of the belt, x against the way one walks", yaw_deg=180.0
    )
    mill.stand_zone(-half, half, 0.9, x=long)
    return mill.piece()


@maker("exercise_mat")
def make_mat(setting: Setting, *, length: float = 1.8, width: float = 0.65) -> Piece:
    """Make a mat on the floor; thin and soft, so that it is for the eye only."""
    mat, half = Joinery("exercise_mat", setting), 0.5 * width
    mat.box((0.0, -half, 0.0), (length, half, 0.01), "blanket", solid=False)
    for y in (-half, half - 0.03):
        mat.box((0.0, y, 0.01), (length, y + 0.03, 0.011), "towel", solid=False)
    mat.frame("mat", (0.5 * length, 0.0, 0.0), "middle of the mat")
    return mat.piece(blocks=False)


@maker("dumbbell_rack")
def make_dumbbell_rack(setting: Setting) -> Piece:
    """Make a rack of dumbbells in two rows, the heavy ones below."""
    rack, half = Joinery("dumbbell_rack", setting), 0.55
    for y in (-half, half - 0.05):
        rack.box((0.06, y, 0.0), (0.11, y + 0.05, 0.78), "metal_dark")
        rack.box((0.0, y, 0.0), (0.5, y + 0.05, 0.04), "metal_dark")
    for z, x, size in ((0.68, 0.11, 0.04), (0.32, 0.16, 0.055)):
        rack.slab((x + 0.11, 0.0, z), (0.26, 2 * half, 0.015), "metal", rpy=(0.0, 0.25, 0.0))
        for k in range(5):
            y = -half + 0.14 + 0.205 * k
            r = size * (1.0 - 0.07 * k)
            top = z + 0.01 + r
            rack.rod([(x + 0.03, y, top + 0.02), (x + 0.21, y, top - 0.026)], 0.014, "metal")
            for a, b in ((0.02, 0.075), (0.165, 0.22)):
                ends = [(x + d, y, top + 0.023 - 0.26 * d) for d in (a, b)]
                rack.rod(ends, r, _COLOURS[k])
        rack.slab(
            (x + 0.11, 0.0, z + size),
            (0.24, 2 * half - 0.06, 1.6 * size),
            "",
            rpy=(0.0, 0.25, 0.0),
            seen=False,
        )
    rack.stand_zone(-half, half, 0.6, x=0.5)
    return rack.piece()


@maker("parallel_bars")
def make_parallel_bars(
    setting: Setting, *, length: float = 2.5, gap: float = 0.6, height: float = 0.86
) -> Piece:
    """Make parallel bars to learn to walk between.

    Args:
        setting: What they are made for.
        length: Of the bars [m].
        gap: Free width between them [m].
        height: Of their top [m].

    Raises:
        ConfigError: If nobody could walk between them.
    """
    if gap < 0.4:
        raise ConfigError(f"nobody walks between bars {gap} m apart; 0.4 m is the least")
    bars, radius = Joinery("parallel_bars", setting), 0.02
    y = 0.5 * gap + radius
    for sign in (-1, 1):
        ends = (0.0, sign * y, height - radius), (length, sign * y, height - radius)
        bars.rod(ends, radius, "wood_light", solid=True)
        for x in (0.25, length - 0.25):
            bars.rod(
                [(x, sign * y, 0.0), (x, sign * y, height - 2 * radius)], 0.022, "metal", solid=True
            )
            bars.rod([(x, sign * y, 0.0), (x, sign * y, 0.45)], 0.03, "metal_dark")
            foot = sorted((sign * (y - 0.03), sign * (y + 0.2)))
            bars.box((x - 0.15, foot[0], 0.0), (x + 0.15, foot[1], 0.015), "metal_dark")
    bars.box((0.0, -0.45 * gap, 0.0), (length, 0.45 * gap, 0.004), "rubber", solid=False)
    for side, sign in (("left", 1), ("right", -1)):
        bars.frame(f"bar_{side}", (0.5 * length, sign * y, height), "top of a bar")
    bars.frame("start", (length + 0.1, 0.0, 0.0), "floor where one starts to walk", yaw_deg=180.0)
    bars.zones.append(Zone(Rectangle(length, -y, length + 0.9, y)))
    return bars.piece()
