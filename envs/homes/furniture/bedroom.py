"""What stands in bedrooms. Sizes are common ones, from memory, unless a rule sets them."""

from __future__ import annotations

import math
from typing import Literal

from rcare_marl.errors import ConfigError

from ...rectangle import Rectangle
from ..piece import Zone
from .joinery import BOARD, Joinery, furniture

_MATTRESS = 0.2  # [m] thick
_PILLOW = (0.4, 0.62, 0.11)  # [m]; soft, so it is for the eye only, as the blanket is
_WIDE_SWING = math.radians(100.0)  # where no wall is beside the hinge; own choice
_SHORT_SWING = math.radians(80.0)
_CLOTHES = ("blanket", "rug", "fabric_light", "fabric", "accent", "towel", "linen", "wood_dark")
Sides = Literal["both", "left", "right"]


@furniture("bed")
def make_bed(
    made: Joinery, *, width: float = 0.95, length: float = 2.0, sides: Sides = "both"
) -> None:
    """Make a bed with its head against the wall.

    The mattress is `width` by `length` [m]; from a width of 1.3 on there are two pillows. `sides` says where
    one can get in at level 1; at levels 2 and 3 both sides are free. ConfigError if it has no such sides,
    or is too small for anybody.
    """
    if sides not in ("both", "left", "right"):
        raise ConfigError(f"the free sides of a bed are both, left or right, got {sides!r}")
    if width < 0.7 or length < 1.4:
        raise ConfigError(f"a bed of {width} m by {length} m is too small")
    top, half, head = made.ruled("bed_height"), 0.5 * width, 0.05
    end, base, wide = head + length, top - _MATTRESS, half + 0.025
    rail = min(base - 0.08, 0.22)  # below it stays open, so that the legs of a lift go under it
    for sign in (-1, 1):
        low, high = sorted((sign * half, sign * wide))
        made.box((head, low, rail), (end, high, base + 0.05), "wood")
    made.box((head, -half, base - 0.03), (end, half, base), "wood_light")
    made.box((end, -half - 0.025, rail), (end + 0.03, wide, base + 0.08), "wood")
    made.legs(Rectangle(head, -half - 0.025, end + 0.03, wide), rail, 0.06, "wood_dark")
    made.box((0.0, -half - 0.03, 0.0), (head, half + 0.03, top + 0.4), "wood", bevel=0.015)
    made.box((head, -half, base), (end, half, top), "linen", bevel=0.05)
    _dress(made, half, end, top)
    _bed_places(made, half, end, top, sides)


def _dress(made: Joinery, half: float, end: float, top: float) -> None:
    """Lay pillows and a blanket, folded back, on a mattress."""
    deep, wide, thick = _PILLOW
    pillows = (-0.5 * half, 0.5 * half) if half >= 0.65 else (0.0,)
    for y in pillows:
        at = (0.09 + 0.5 * deep, y, top + 0.42 * thick)
        size = (deep, min(wide, 1.7 * half / len(pillows)), thick)
        made.slab(at, size, "white", rpy=(0.0, 0.12, 0.0), bevel=0.054, solid=False)
    fold, over = 0.85, half + 0.035
    low, high = (fold, -over, top - 0.19), (end - 0.015, over, top + 0.03)
    made.show(low, high, "blanket", bevel=0.045)
    low, high = (fold - 0.08, -over - 0.004, top - 0.17), (fold + 0.22, over + 0.004, top + 0.045)
    made.show(low, high, "fabric_light", bevel=0.03)


def _bed_places(made: Joinery, half: float, end: float, top: float, sides: Sides) -> None:
    space, edge = made.ruled("bed_side_space"), half + 0.04  # the blanket hangs over
    made.frame("mattress", (0.05 + 0.5 * (end - 0.05), 0.0, top), "middle of the mattress' top")
    pillow = (0.09 + 0.5 * _PILLOW[0], 0.0 if half < 0.65 else 0.5 * half, top)
    made.frame("pillow", pillow, "mattress under the head; the pillow gives way")
    for side, sign in (("left", 1), ("right", -1)):
        at, note = (0.55 * end, sign * half, top), "edge to sit on, x outwards"
        made.frame(f"edge_{side}", at, note, yaw_deg=sign * 90.0)
        if made.rules.level > 1 or sides in ("both", side):
            low, high = sorted((sign * edge, sign * (edge + space)))
            made.zones.append(Zone(Rectangle(0.5, low, end, high)))


@furniture("nightstand")
def make_nightstand(made: Joinery, *, width: float = 0.45, lamp: bool = True) -> None:
    """Make a nightstand with a drawer over a shelf, and a lamp on it if `lamp`."""
    high, deep, half = 0.55, 0.4, 0.5 * width
    inner, under, shelf = half - BOARD, high - BOARD, high - 0.2
    made.sides((0.0, -half, 0.0), (deep, half, under), BOARD, "wood")
    made.box((0.0, -half, under), (deep, half, high), "wood")
    made.box((0.0, -half + BOARD, 0.1), (deep, inner, 0.1 + BOARD), "wood")
    made.box((0.0, -half + BOARD, 0.1 + BOARD), (0.012, inner, under), "wood")
    made.box((0.012, -half + BOARD, shelf - BOARD), (deep, inner, shelf), "wood")
    made.drawer("drawer", (0.02, -half + BOARD, shelf), (deep, inner, under), "wood_light")
    for k, material in enumerate(("rug", "paper", "fabric")):
        z = 0.1 + BOARD + 0.03 * k
        made.show((0.1, -0.1, z), (0.28, 0.03 + 0.01 * k, z + 0.028), material)
    if lamp:
        table_lamp(made, 0.15, 0.0, high)
    made.frame("top", (0.5 * deep, 0.0, high), "middle of the top")
    made.stand_zone(-half, half, 0.45, x=deep)


def table_lamp(made: Joinery, x: float, y: float, z: float) -> None:
    """Put a table lamp on a piece, its foot at (x, y, z) [m]."""
    foot = ((0.06, 0.0), (0.065, 0.012), (0.02, 0.02), (0.035, 0.08))
    made.lathe((x, y, z), (*foot, (0.03, 0.13), (0.01, 0.15), (0.008, 0.22)), "clay")
    made.lathe((x, y, z), ((0.1, 0.2), (0.065, 0.36)), "lamp")
    made.cylinder((x, y, z + 0.28), 0.085, 0.16)
    made.cylinder((x, y, z + 0.1), 0.035, 0.2)


@furniture("wardrobe")
def make_wardrobe(made: Joinery, *, width: float = 1.5) -> None:
    """Make a wardrobe with a rail, clothes and a shelf: hinged doors at level 1, sliding ones else.

    ConfigError if it is narrower than two doors need, 0.7 m.
    """
    if width < 0.7:
        raise ConfigError(f"a wardrobe {width} m wide has no room for two doors")
    deep, high, half, plinth = 0.6, 2.05, 0.5 * width, 0.07
    rail, side = made.ruled("wardrobe_rail_height"), half - BOARD
    inner = deep - 0.08  # doors slide in front of it
    made.sides((0.0, -half, 0.0), (deep, half, high), BOARD, "wood_light")
    for z in (plinth, rail + 0.07, high - BOARD):
        front = deep if z > high - 0.1 else inner
        made.box((0.0, -half + BOARD, z), (front, side, z + BOARD), "wood_light")
    made.box((0.0, -half + BOARD, plinth), (0.012, side, high), "wood_light")
    made.box((inner - 0.02, -half + BOARD, 0.0), (inner, side, plinth), "wood_light")
    made.rod(((0.28, -half + BOARD, rail), (0.28, side, rail)), 0.0125, "metal", solid=True)
    hang_clothes(made, (0.06 - half, half - 0.06), rail)
    is_hinged = made.rules.level == 1
    if is_hinged:
        _hinged_doors(made, half, plinth, high, deep)
    else:
        _sliding_doors(made, half, plinth, high, inner)
    made.frame("rail", (0.28, 0.0, rail), "middle of the rail")
    made.stand_zone(-half, half, 0.6 if is_hinged else 0.76, x=deep)


def hang_clothes(made: Joinery, span: tuple[float, float], rail: float) -> None:
    """Hang shirts and dresses on a rail, from `span[0]` to `span[1]` along y, `rail` high [m].

    They are soft, for the eye only.
    """
    start, end = span
    count = int((end - start) / 0.075)
    for k in range(count):
        y = start + (k + 0.5) * (end - start) / count
        material = _CLOTHES[(3 * k + k // 4) % len(_CLOTHES)]
        low = rail - (0.75, 0.95, 0.82, 1.05)[k % 4] * min(1.0, (rail - 0.2) / 1.05)
        made.show((0.07, y - 0.02, low), (0.49, y + 0.02, rail - 0.05), material)


def _hinged_doors(made: Joinery, half: float, low: float, high: float, deep: float) -> None:
    """Hang two doors, or four on a wardrobe from 1.2 m on, hinged to the outer and middle posts."""
    pairs = 1 if half < 0.6 else 2
    span, last = 2 * half / pairs, pairs - 1
    for pair in range(pairs):
        y0, y1 = -half + pair * span, -half + (pair + 1) * span
        middle = 0.5 * (y0 + y1)
        if pair:
            post = (deep, y0 + 0.5 * BOARD, high - BOARD)
            made.box((0.02, y0 - 0.5 * BOARD, low), post, "wood_light")
        # Two doors on one post stop before their handles meet.
        for name, a, b, left in (
            (f"door_{2 * pair + 2}", middle, y1, True),
            (f"door_{2 * pair + 1}", y0, middle, False),
        ):
            at = (deep, a, low), (deep + 0.02, b, high)
            swing = _WIDE_SWING if pair == (last if left else 0) else _SHORT_SWING
            made.door(name, *at, "front", left=left, handle_z=1.05, swing=swing)


def _sliding_doors(made: Joinery, half: float, low: float, high: float, inner: float) -> None:
    """Put two doors, one of them a mirror, on two tracks one behind the other."""
    top, overlap = high - BOARD, 0.03
    tracks = (("door_left", 1, inner + 0.012, "front"), ("door_right", -1, inner + 0.042, "mirror"))
    made.box((inner, -half + BOARD, low - 0.02), (inner + 0.08, half - BOARD, low), "metal")
    for name, sign, x, material in tracks:
        outer, face = sign * (half - BOARD - 0.002), x + 0.018
        y0, y1 = sorted((outer, -sign * overlap))
        at, way = (x, 0.5 * (y0 + y1), 0.5 * (low + top)), half - BOARD - overlap - 0.002
        door = made.joint(name, at, (0.0, -float(sign), 0.0), way, slides=True, damping=12.0)
        door.box((x, y0, low + 0.004), (face, y1, top - 0.004), material)
        edge = outer - sign * 0.05
        # A flush pull: the doors pass each other.
        door.box((face, edge - 0.012, 0.9), (x + 0.026, edge + 0.012, 1.1), "metal")
        made.frame(f"handle_{name}", (face, edge, 1.0), f"pull of the joint {name}, x out of it")


@furniture("chest_of_drawers")
def make_chest(made: Joinery, *, width: float = 0.9, drawers: int = 4) -> None:
    """Make a chest of drawers, one above the other; ConfigError if there are none or too many."""
    if not 1 <= drawers <= 6:
        raise ConfigError(f"a chest has 1 to 6 drawers, got {drawers}")
    high, deep, half, plinth = 0.1 + 0.21 * drawers, 0.48, 0.5 * width, 0.08
    under, inner = high - 0.02, half - BOARD
    made.sides((0.0, -half, 0.0), (deep, half, under), BOARD, "wood")
    made.box((0.0, -half - 0.01, under), (deep + 0.015, half + 0.01, high), "wood")
    made.box((0.0, -half + BOARD, plinth), (0.012, inner, under), "wood")
    made.box((0.0, -half + BOARD, plinth - BOARD), (deep - 0.02, inner, plinth), "wood")
    step = (high - 0.02 - plinth) / drawers
    for k in range(drawers):
        z = plinth + k * step
        a, b = (0.02, -half + BOARD, z), (deep, inner, z + step)
        made.drawer(f"drawer_{drawers - k}", a, b, "wood_light")
    made.show((0.1, -0.3, high), (0.3, -0.08, high + 0.05), "paper")
    made.frame("top", (0.5 * deep, 0.0, high), "middle of the top")
    made.stand_zone(-half, half, 0.6, x=deep)
