"""What makes a room a home: rugs, pictures, clocks, plants."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from .joinery import Joinery, furniture

PICTURE_HEIGHT = 1.5  # [m] of the middle of pictures; common, from memory


@furniture("rug")
def rug(made: Joinery, *, width: float = 2.0, depth: float = 1.4) -> None:
    """Make a rug, `width` [m] along y and `depth` [m] along x; for the eye only, nothing trips over it."""
    if not (0.3 <= width <= 5 and 0.3 <= depth <= 5):
        raise ConfigError(f"a rug is 0.3 to 5 m wide and deep, got {width!r} by {depth!r}")
    half, z, least = 0.5 * width, 0.004, min(width, depth)
    made.show((0.0, -half, 0.0), (depth, half, z), "rug")
    edge = 0.08 * least
    layers = ((edge, "paper"), (1.35 * edge, "rug"), (2.6 * edge, "clay"), (2.9 * edge, "rug"))
    for k, (inset, material) in enumerate(layers):
        top = z + 0.0006 * (k + 1)
        made.show((inset, -half + inset, z), (depth - inset, half - inset, top), material)
    size = 0.16 * least
    for k in (-1, 0, 1):
        y, c = k * 0.25 * width, 0.3 * size
        low, high = 0.5 * (depth - size), 0.5 * (depth + size)
        made.show((low, y - 0.5 * size, z), (high, y + 0.5 * size, z + 0.003), "paper")
        made.show((0.5 * depth - c, y - c, z), (0.5 * depth + c, y + c, z + 0.0036), "accent")
    made.outline(depth, half, 0.008)
    made.blocks = False


@furniture("picture")
def picture(made: Joinery, *, width: float = 0.6, height: float = 0.45, motif: int = 0) -> None:
    """Make a picture in its frame, to hang on a wall with its middle at 1.5 m.

    The frame is `width` [m] wide, 0.15 to 2, and `height` [m] high, 0.15 to 1.6; ConfigError if it is not.
    `motif` chooses one of three, counted round: hills, fields of colour, a still life.
    """
    if not (0.15 <= width <= 2.0 and 0.15 <= height <= 1.6):
        raise ConfigError(
            f"a picture is 0.15 to 2 m wide, to 1.6 m high, got {width!r} by {height!r}"
        )
    half, low, rim = 0.5 * width, PICTURE_HEIGHT - 0.5 * height, 0.025
    high = low + height
    made.box((0.0, -half, low), (0.012, half, high), "paper")
    for y0, y1 in ((-half, -half + rim), (half - rim, half)):
        made.show((0.0, y0, low), (0.03, y1, high), "wood_dark")
    for z0, z1 in ((low, low + rim), (high - rim, high)):
        made.show((0.0, -half, z0), (0.03, half, z1), "wood_dark")
    margin = rim + 0.06 * min(width, height)
    (y0, z0), (y1, z1) = (-half + margin, low + margin), (half - margin, high - margin)
    for (a, b, c, d), material, layer in (_hills(), _FIELDS, _STILL_LIFE)[motif % 3]:
        made.show(
            (0.012, y0 + a * (y1 - y0), z0 + b * (z1 - z0)),
            (0.0125 + 0.0006 * layer, y0 + c * (y1 - y0), z0 + d * (z1 - z0)),
            material,
        )
    made.outline(0.03, half, high)
    made.blocks = False


# Patches of paint: their corners in shares of the picture, colour, layer; higher layers cover lower.
_Patch = tuple[tuple[float, float, float, float], str, int]


def _hills() -> list[_Patch]:
    out: list[_Patch] = [((0, 0, 1, 1), "blanket", 0), ((0.66, 0.62, 0.8, 0.82), "lamp", 1)]
    for k in range(12):
        a, b = k / 12, (k + 1) / 12
        out.append(((a, 0.0, b, 0.45 + 0.12 * math.sin(5.0 * a + 0.6)), "towel", 2))
        out.append(((a, 0.0, b, 0.25 + 0.1 * math.sin(6.5 * a + 2.4)), "leaf", 3))
    return out


_FIELDS: list[_Patch] = [
    ((0, 0, 1, 1), "linen", 0),
    ((0.08, 0.1, 0.48, 0.6), "accent", 1),
    ((0.52, 0.1, 0.92, 0.38), "blanket", 1),
    ((0.52, 0.44, 0.92, 0.9), "clay", 1),
    ((0.08, 0.66, 0.48, 0.9), "wood_dark", 1),
    ((0.3, 0.3, 0.66, 0.5), "paper", 2),
]
_STILL_LIFE: list[_Patch] = [
    ((0, 0, 1, 1), "fabric_light", 0),
    ((0.0, 0.0, 1.0, 0.3), "wood", 1),
    ((0.42, 0.22, 0.6, 0.6), "fabric", 2),
    ((0.47, 0.6, 0.55, 0.68), "fabric", 2),
    *(
        patch
        for y, z, paint in ((0.4, 0.78, "rug"), (0.52, 0.86, "accent"), (0.62, 0.76, "lamp"))
        for patch in (
            ((y - 0.05, z - 0.07, y + 0.05, z + 0.07), paint, 3),
            ((0.49, 0.66, 0.52, z - 0.07), "leaf", 2),
        )
    ),
    ((0.66, 0.2, 0.78, 0.34), "accent", 3),
    ((0.74, 0.18, 0.86, 0.31), "leaf", 2),
]


@furniture("wall_clock")
def wall_clock(made: Joinery, *, height: float = 1.8) -> None:
    """Make a round clock, its middle at `height` [m]; it shows ten past ten."""
    middle = (0.038, 0.0, height)
    made.rod(((0.0, 0.0, height), (0.03, 0.0, height)), 0.16, "wood_dark", solid=True)
    made.rod(((0.03, 0.0, height), (0.034, 0.0, height)), 0.14, "white")
    for k in range(12):
        turn, half = k * math.pi / 6, 0.006 if k % 3 else 0.01
        y, z = 0.12 * math.sin(turn), height + 0.12 * math.cos(turn)
        made.show((0.034, y - half, z - half), (0.036, y + half, z + half), "black")
    # Seen from the room, y runs to the right.
    for turn, length in ((math.radians(-55), 0.07), (math.radians(60), 0.105)):
        end = (0.038, length * math.sin(turn), height + length * math.cos(turn))
        made.rod((middle, end), 0.004, "black")
    made.outline(0.042, 0.16, height + 0.16)
    made.blocks = False


@furniture("plant")
def plant(made: Joinery, *, size: str = "large") -> None:
    """Make a plant in a pot, `large` for the floor or `small` for a sill or table; else a ConfigError."""
    if size not in ("small", "large"):
        raise ConfigError(f"a plant is 'small' or 'large', got {size!r}")
    s = 1.0 if size == "large" else 0.36
    x, tall = 0.26 * s, 0.34 * s
    earth = tall - 0.03 * s
    pot = ((0.12 * s, 0.0), (0.17 * s, tall), (0.15 * s, tall), (0.145 * s, earth), (0.0, earth))
    made.lathe((x, 0.0, 0.0), pot, "clay")
    made.cylinder((x, 0.0, 0.5 * tall), 0.16 * s, tall)
    for k in range(14):
        turn, lean = 2.399963 * k, 0.25 + 0.05 * k  # leaves turn by the golden angle
        long, c, d = (0.85 - 0.03 * k) * s, math.cos(turn), math.sin(turn)
        out, up = min(long * math.sin(lean), 0.24 * s), long * math.cos(lean)
        a = (x + 0.03 * s * c, 0.03 * s * d, earth)
        mid = (x + 0.45 * out * c, 0.45 * out * d, tall + 0.65 * up)
        tip = (x + out * c, out * d, tall + up)
        made.rod((a, mid), 0.006 * s, "leaf")
        middle = (0.5 * (mid[0] + tip[0]), 0.5 * (mid[1] + tip[1]), 0.5 * (mid[2] + tip[2]))
        pitch = math.atan2(mid[2] - tip[2], math.hypot(tip[0] - mid[0], tip[1] - mid[1]))
        leaf = (math.dist(mid, tip) * 1.3, 0.075 * s, 0.008 * s)
        made.slab(middle, leaf, "leaf", rpy=(0.0, pitch, turn), solid=False)
    crown = (x, 0.0, tall - 0.02 * s)
    made.draw(Shape("cylinder", "leaf", crown, radius=0.1 * s, length=0.01 * s))
    reach = 0.3 * s
    made.footprint, made.height = Rectangle(x - reach, -reach, x + reach, reach), tall + 0.95 * s
