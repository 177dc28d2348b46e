"""What makes a room a home: lamps, rugs, pictures, clocks, plants."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from ..piece import Piece, Setting, maker
from .joinery import Joinery, wall_strip

PICTURE_HEIGHT = 1.5  # [m] of the middle of pictures; common, from memory
LAMP_BOTTOM = 1.9  # [m]; heads pass below it
CEILING = 2.5  # [m]


@maker("pendant_lamp")
def pendant_lamp(
    setting: Setting, *, bottom: float = LAMP_BOTTOM, ceiling: float = CEILING
) -> Piece:
    """Return a lamp that hangs from the ceiling; its frame is on the floor at the back of its shade.

    Args:
        setting: What it is made for.
        bottom: Height of its lower edge, at least 1.9 [m].
        ceiling: Height of the ceiling [m].

    Raises:
        ConfigError: If heads would strike it, or the ceiling is too low.
    """
    if not LAMP_BOTTOM <= bottom <= ceiling - 0.3:
        raise ConfigError(
            f"a pendant lamp hangs between {LAMP_BOTTOM} m and 0.3 m under the ceiling, got {bottom!r}"
        )
    add = Joinery("pendant_lamp", setting)
    x = 0.19
    shade = (
        (0.19, 0.0),
        (0.17, 0.08),
        (0.06, 0.19),
        (0.03, 0.21),
        (0.02, 0.2),
        (0.16, 0.07),
        (0.18, 0.0),
    )
    add.draw(Shape("lathe", "accent", (x, 0.0, bottom), profile=shade))
    add.draw(Shape("sphere", "lamp", (x, 0.0, bottom + 0.07), radius=0.05))
    add.rod(((x, 0.0, bottom + 0.2), (x, 0.0, ceiling - 0.02)), 0.004, "black")
    add.rod(((x, 0.0, ceiling - 0.025), (x, 0.0, ceiling)), 0.05, "white")
    body = Shape("cylinder", at=(x, 0.0, bottom + 0.1), radius=0.17, length=0.2)
    add.solid(body)
    add.frame("light", (x, 0.0, bottom + 0.07), note="the bulb")
    return add.piece(wall_strip(0.38, 0.38), ceiling, blocks=False)


@maker("rug")
def rug(setting: Setting, *, width: float = 2.0, depth: float = 1.4) -> Piece:
    """Return a rug, `width` [m] along y and `depth` [m] along x; for the eye only, nothing trips over it."""
    if not (0.3 <= width <= 5 and 0.3 <= depth <= 5):
        raise ConfigError(f"a rug is 0.3 to 5 m wide and deep, got {width!r} by {depth!r}")
    add = Joinery("rug", setting)
    half, z = 0.5 * width, 0.004
    add.box((0.0, -half, 0.0), (depth, half, z), "rug", solid=False)
    edge = 0.08 * min(width, depth)
    layers = ((edge, "paper"), (1.35 * edge, "rug"), (2.6 * edge, "clay"), (2.9 * edge, "rug"))
    for k, (inset, material) in enumerate(layers):
        low, high = (inset, -half + inset, z), (depth - inset, half - inset, z + 0.0006 * (k + 1))
        add.box(low, high, material, solid=False)
    for k in (-1, 0, 1):
        size, y = 0.16 * min(width, depth), k * 0.25 * width
        a, b = (
            (0.5 * (depth - size), y - 0.5 * size, z),
            (0.5 * (depth + size), y + 0.5 * size, z + 0.003),
        )
        add.box(a, b, "paper", solid=False)
        c = 0.3 * size
        a = (0.5 * depth - c, y - c, z)
        add.box(a, (0.5 * depth + c, y + c, z + 0.0036), "accent", solid=False)
    return add.piece(wall_strip(depth, width), 0.008, blocks=False)


@maker("picture")
def picture(setting: Setting, *, width: float = 0.6, height: float = 0.45, motif: int = 0) -> Piece:
    """Return a picture in its frame, to hang on a wall with its middle at 1.5 m.

    Args:
        setting: What it is made for.
        width: Of the frame, 0.15 to 2 [m].
        height: Of the frame, 0.15 to 1.6 [m].
        motif: Which of three motifs, counted round: hills, fields of colour, a still life.

    Raises:
        ConfigError: If the size is out of range.
    """
    if not (0.15 <= width <= 2.0 and 0.15 <= height <= 1.6):
        raise ConfigError(
            f"a picture is 0.15 to 2 m wide, to 1.6 m high, got {width!r} by {height!r}"
        )
    add = Joinery("picture", setting)
    half, low, rim = 0.5 * width, PICTURE_HEIGHT - 0.5 * height, 0.025
    high = low + height
    add.box((0.0, -half, low), (0.012, half, high), "paper")
    for y0, y1 in ((-half, -half + rim), (half - rim, half)):
        add.box((0.0, y0, low), (0.03, y1, high), "wood_dark", solid=False)
    for z0, z1 in ((low, low + rim), (high - rim, high)):
        add.box((0.0, -half, z0), (0.03, half, z1), "wood_dark", solid=False)
    margin = rim + 0.06 * min(width, height)
    area = (-half + margin, low + margin, half - margin, high - margin)
    (_hills, _fields, _still_life)[motif % 3](add, area)
    return add.piece(wall_strip(0.03, width), high, blocks=False)


Area = tuple[float, float, float, float]


def _patch(add: Joinery, area: Area, part: Area, material: str, layer: int) -> None:
    """Paint a part of the area, given in shares of it; higher layers cover lower ones."""
    y0, z0, y1, z1 = area
    a = (0.012, y0 + part[0] * (y1 - y0), z0 + part[1] * (z1 - z0))
    b = (0.0125 + 0.0006 * layer, y0 + part[2] * (y1 - y0), z0 + part[3] * (z1 - z0))
    add.box(a, b, material, solid=False)


def _hills(add: Joinery, area: Area) -> None:
    _patch(add, area, (0.0, 0.0, 1.0, 1.0), "blanket", 0)
    _patch(add, area, (0.66, 0.62, 0.8, 0.82), "lamp", 1)
    steps = 12
    for k in range(steps):
        a, b = k / steps, (k + 1) / steps
        far = 0.45 + 0.12 * math.sin(5.0 * a + 0.6)
        near = 0.25 + 0.1 * math.sin(6.5 * a + 2.4)
        _patch(add, area, (a, 0.0, b, far), "towel", 2)
        _patch(add, area, (a, 0.0, b, near), "leaf", 3)


def _fields(add: Joinery, area: Area) -> None:
    _patch(add, area, (0.0, 0.0, 1.0, 1.0), "linen", 0)
    _patch(add, area, (0.08, 0.1, 0.48, 0.6), "accent", 1)
    _patch(add, area, (0.52, 0.1, 0.92, 0.38), "blanket", 1)
    _patch(add, area, (0.52, 0.44, 0.92, 0.9), "clay", 1)
    _patch(add, area, (0.08, 0.66, 0.48, 0.9), "wood_dark", 1)
    _patch(add, area, (0.3, 0.3, 0.66, 0.5), "paper", 2)


def _still_life(add: Joinery, area: Area) -> None:
    _patch(add, area, (0.0, 0.0, 1.0, 1.0), "fabric_light", 0)
    _patch(add, area, (0.0, 0.0, 1.0, 0.3), "wood", 1)
    _patch(add, area, (0.42, 0.22, 0.6, 0.6), "fabric", 2)
    _patch(add, area, (0.47, 0.6, 0.55, 0.68), "fabric", 2)
    for y, z, material in ((0.4, 0.78, "rug"), (0.52, 0.86, "accent"), (0.62, 0.76, "lamp")):
        _patch(add, area, (y - 0.05, z - 0.07, y + 0.05, z + 0.07), material, 3)
        _patch(add, area, (0.49, 0.66, 0.52, z - 0.07), "leaf", 2)
    _patch(add, area, (0.66, 0.2, 0.78, 0.34), "accent", 3)
    _patch(add, area, (0.74, 0.18, 0.86, 0.31), "leaf", 2)


@maker("wall_clock")
def wall_clock(setting: Setting, *, height: float = 1.8) -> Piece:
    """Return a round clock, its middle at `height` [m]; it shows ten past ten."""
    add = Joinery("wall_clock", setting)
    add.rod(((0.0, 0.0, height), (0.03, 0.0, height)), 0.16, "wood_dark", solid=True)
    add.rod(((0.03, 0.0, height), (0.034, 0.0, height)), 0.14, "white")
    for k in range(12):
        turn = k * math.pi / 6
        y, z = 0.12 * math.sin(turn), height + 0.12 * math.cos(turn)
        half = 0.006 if k % 3 else 0.01
        add.box((0.034, y - half, z - half), (0.036, y + half, z + half), "black", solid=False)
    # Seen from the room, y runs to the right.
    for turn, length in ((math.radians(-55), 0.07), (math.radians(60), 0.105)):
        end = (0.038, length * math.sin(turn), height + length * math.cos(turn))
        add.rod(((0.038, 0.0, height), end), 0.004, "black")
    return add.piece(wall_strip(0.042, 0.32), height + 0.16, blocks=False)


@maker("plant")
def plant(setting: Setting, *, size: str = "large") -> Piece:
    """Return a plant in a pot, `large` for the floor or `small` for a sill or table.

    Raises:
        ConfigError: If `size` is neither.
    """
    if size not in ("small", "large"):
        raise ConfigError(f"a plant is 'small' or 'large', got {size!r}")
    add = Joinery("plant", setting)
    s = 1.0 if size == "large" else 0.36
    x, tall = 0.26 * s, 0.34 * s
    pot = (
        (0.12 * s, 0.0),
        (0.17 * s, tall),
        (0.15 * s, tall),
        (0.145 * s, tall - 0.03 * s),
        (0.0, tall - 0.03 * s),
    )
    add.draw(Shape("lathe", "clay", (x, 0.0, 0.0), profile=pot))
    body = Shape("cylinder", at=(x, 0.0, 0.5 * tall), radius=0.16 * s, length=tall)
    add.solid(body)
    for k in range(14):
        turn, lean = 2.399963 * k, 0.25 + 0.05 * k  # leaves turn by the golden angle
        long = (0.85 - 0.03 * k) * s
        c, d = math.cos(turn), math.sin(turn)
        out = min(long * math.sin(lean), 0.24 * s)
        up = long * math.cos(lean)
        a = (x + 0.03 * s * c, 0.03 * s * d, tall - 0.03 * s)
        mid = (x + 0.45 * out * c, 0.45 * out * d, tall + 0.65 * up)
        tip = (x + out * c, out * d, tall + up)
        add.rod((a, mid), 0.006 * s, "leaf")
        middle = (0.5 * (mid[0] + tip[0]), 0.5 * (mid[1] + tip[1]), 0.5 * (mid[2] + tip[2]))
        reach = math.hypot(tip[0] - mid[0], tip[1] - mid[1])
        pitch = math.atan2(mid[2] - tip[2], reach)
        length = math.dist(mid, tip) * 1.3
        leaf = (length, 0.075 * s, 0.008 * s)
        add.draw(Shape("box", "leaf", middle, (0.0, pitch, turn), size=leaf))
    crown = Shape("cylinder", "leaf", (x, 0.0, tall - 0.02 * s), radius=0.1 * s, length=0.01 * s)
    add.draw(crown)
    height = tall + 0.95 * s
    reach = 0.3 * s
    return add.piece(Rectangle(x - reach, -reach, x + reach, reach), height)
