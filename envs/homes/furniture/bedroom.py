"""What stands in bedrooms. Sizes are common ones, from memory, unless a rule sets them."""

from __future__ import annotations

import math
from typing import Literal

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker
from .joinery import BOARD, Joinery

_MATTRESS = 0.2  # [m] thick
_PILLOW = (0.4, 0.62, 0.11)  # [m]; soft, so it is for the eye only, as the blanket is
_WIDE_SWING = math.radians(100.0)  # where no wall is beside the hinge; own choice
_SHORT_SWING = math.radians(80.0)
_CLOTHES = ("blanket", "rug", "fabric_light", "fabric", "accent", "towel", "linen", "wood_dark")
Sides = Literal["both", "left", "right"]


@maker("bed")
def make_bed(
    setting: Setting, *, width: float = 0.95, length: float = 2.0, sides: Sides = "both"
) -> Piece:
    """Make a bed with its head against the wall.

    Args:
        setting: What it is made for.
        width: Of the mattress [m]; from 1.3 on there are two pillows.
        length: Of the mattress [m].
        sides: Where one can get in at level 1; at levels 2 and 3 both sides are free.

    Raises:
        ConfigError: If it has no such sides, or is too small for anybody.
    """
    if sides not in ("both", "left", "right"):
        raise ConfigError(f"the free sides of a bed are both, left or right, got {sides!r}")
    if width < 0.7 or length < 1.4:
        raise ConfigError(f"a bed of {width} m by {length} m is too small")
    rules = setting.rules
    top = rules.figure("bed_height")
    half, head = 0.5 * width, 0.05
    end, base = head + length, top - _MATTRESS
    bed = Joinery("bed", setting)
    rail = min(base - 0.08, 0.22)  # below it stays open, so that the legs of a lift go under it
    for sign in (-1, 1):
        y = sorted((sign * half, sign * (half + 0.025)))
        bed.box((head, y[0], rail), (end, y[1], base + 0.05), "wood")
    bed.box((head, -half, base - 0.03), (end, half, base), "wood_light")
    bed.box((end, -half - 0.025, rail), (end + 0.03, half + 0.025, base + 0.08), "wood")
    frame = Rectangle(head, -half - 0.025, end + 0.03, half + 0.025)
    bed.legs(frame, rail, 0.06, "wood_dark")
    bed.box((0.0, -half - 0.03, 0.0), (head, half + 0.03, top + 0.4), "wood", bevel=0.015)
    bed.box((head, -half, base), (end, half, top), "linen", bevel=0.05)
    _dress(bed, half, end, top)
    _bed_places(bed, half, end, top, sides)
    return bed.piece()


def _dress(bed: Joinery, half: float, end: float, top: float) -> None:
    """Lay pillows and a blanket, folded back, on a mattress."""
    deep, wide, thick = _PILLOW
    pillows = (-0.5 * half, 0.5 * half) if half >= 0.65 else (0.0,)
    for y in pillows:
        at = (0.09 + 0.5 * deep, y, top + 0.42 * thick)
        size = (deep, min(wide, 1.7 * half / len(pillows)), thick)
        bed.slab(at, size, "white", rpy=(0.0, 0.12, 0.0), bevel=0.054, solid=False)
    fold, over = 0.85, half + 0.035
    bed.box(
        (fold, -over, top - 0.19),
        (end - 0.015, over, top + 0.03),
        "blanket",
        bevel=0.045,
        solid=False,
    )
    bed.box(
        (fold - 0.08, -over - 0.004, top - 0.17),
        (fold + 0.22, over + 0.004, top + 0.045),
        "fabric_light",
        bevel=0.03,
        solid=False,
    )


def _bed_places(bed: Joinery, half: float, end: float, top: float, sides: Sides) -> None:
    rules = bed.setting.rules
    bed.measures["bed_height"] = top
    bed.measures["bed_side_space"] = space = rules.figure("bed_side_space")
    bed.frame("mattress", (0.05 + 0.5 * (end - 0.05), 0.0, top), "middle of the mattress' top")
    bed.frame(
        "pillow",
        (0.09 + 0.5 * _PILLOW[0], 0.0 if half < 0.65 else 0.5 * half, top),
        "mattress under the head; the pillow gives way",
    )
    edge = half + 0.04  # the blanket hangs over
    for side, sign in (("left", 1), ("right", -1)):
        bed.frame(
            f"edge_{side}",
            (0.55 * end, sign * half, top),
            "edge to sit on, x outwards",
            yaw_deg=sign * 90.0,
        )
        if rules.level == 1 and sides not in ("both", side):
            continue
        ys = sorted((sign * edge, sign * (edge + space)))
        bed.zones.append(Zone(Rectangle(0.5, ys[0], end, ys[1])))


@maker("nightstand")
def make_nightstand(setting: Setting, *, width: float = 0.45, lamp: bool = True) -> Piece:
    """Make a nightstand with a drawer over a shelf, and a lamp on it if `lamp`."""
    high, deep, half = 0.55, 0.4, 0.5 * width
    stand = Joinery("nightstand", setting)
    for y in (-half, half - BOARD):
        stand.box((0.0, y, 0.0), (deep, y + BOARD, high - BOARD), "wood")
    stand.box((0.0, -half, high - BOARD), (deep, half, high), "wood")
    stand.box((0.0, -half + BOARD, 0.1), (deep, half - BOARD, 0.1 + BOARD), "wood")
    stand.box((0.0, -half + BOARD, 0.1 + BOARD), (0.012, half - BOARD, high - BOARD), "wood")
    shelf = high - 0.2
    stand.box((0.012, -half + BOARD, shelf - BOARD), (deep, half - BOARD, shelf), "wood")
    stand.drawer(
        "drawer", (0.02, -half + BOARD, shelf), (deep, half - BOARD, high - BOARD), "wood_light"
    )
    for k, material in enumerate(("rug", "paper", "fabric")):
        z = 0.1 + BOARD + 0.03 * k
        stand.box((0.1, -0.1, z), (0.28, 0.03 + 0.01 * k, z + 0.028), material, solid=False)
    if lamp:
        table_lamp(stand, 0.15, 0.0, high)
    stand.frame("top", (0.5 * deep, 0.0, high), "middle of the top")
    stand.stand_zone(-half, half, 0.45, x=deep)
    return stand.piece()


def table_lamp(piece: Joinery, x: float, y: float, z: float) -> None:
    """Put a table lamp on a piece, its foot at (x, y, z) [m]."""
    foot = (
        (0.06, 0.0),
        (0.065, 0.012),
        (0.02, 0.02),
        (0.035, 0.08),
        (0.03, 0.13),
        (0.01, 0.15),
        (0.008, 0.22),
    )
    piece.draw(Shape(kind="lathe", material="clay", at=(x, y, z), profile=foot))
    shade = ((0.1, 0.2), (0.065, 0.36))
    piece.draw(Shape(kind="lathe", material="lamp", at=(x, y, z), profile=shade))
    piece.solid(
        Shape(kind="cylinder", at=(x, y, z + 0.28), radius=0.085, length=0.16),
        Shape(kind="cylinder", at=(x, y, z + 0.1), radius=0.035, length=0.2),
    )


@maker("wardrobe")
def make_wardrobe(setting: Setting, *, width: float = 1.5) -> Piece:
    """Make a wardrobe with a rail, clothes and a shelf: hinged doors at level 1, sliding ones else.

    ConfigError if it is narrower than two doors need, 0.7 m.
    """
    if width < 0.7:
        raise ConfigError(f"a wardrobe {width} m wide has no room for two doors")
    deep, high, half, plinth = 0.6, 2.05, 0.5 * width, 0.07
    robe = Joinery("wardrobe", setting)
    rail = setting.rules.figure("wardrobe_rail_height")
    inner = deep - 0.08  # doors slide in front of it
    for y in (-half, half - BOARD):
        robe.box((0.0, y, 0.0), (deep, y + BOARD, high), "wood_light")
    for z in (plinth, rail + 0.07, high - BOARD):
        front = deep if z > high - 0.1 else inner
        robe.box((0.0, -half + BOARD, z), (front, half - BOARD, z + BOARD), "wood_light")
    robe.box((0.0, -half + BOARD, plinth), (0.012, half - BOARD, high), "wood_light")
    robe.box((inner - 0.02, -half + BOARD, 0.0), (inner, half - BOARD, plinth), "wood_light")
    ends = (0.28, -half + BOARD, rail), (0.28, half - BOARD, rail)
    robe.rod(ends, 0.0125, "metal", solid=True)
    hang_clothes(robe, (0.06 - half, half - 0.06), rail)
    robe.measures["wardrobe_rail_height"] = rail
    if setting.rules.level == 1:
        _hinged_doors(robe, half, plinth, high, deep)
    else:
        _sliding_doors(robe, half, plinth, high, inner)
    robe.frame("rail", (0.28, 0.0, rail), "middle of the rail")
    robe.stand_zone(-half, half, 0.6 if setting.rules.level == 1 else 0.76, x=deep)
    return robe.piece()


def hang_clothes(
    robe: Joinery, span: tuple[float, float], rail: float, *, spacing: float = 0.075
) -> None:
    """Hang shirts and dresses on a rail, from `span[0]` to `span[1]` along y, `rail` high [m].

    They are soft, for the eye only.
    """
    start, end = span
    count = int((end - start) / spacing)
    for k in range(count):
        y = start + (k + 0.5) * (end - start) / count
        material = _CLOTHES[(3 * k + k // 4) % len(_CLOTHES)]
        low = rail - (0.75, 0.95, 0.82, 1.05)[k % 4] * min(1.0, (rail - 0.2) / 1.05)
        robe.box((0.07, y - 0.02, low), (0.49, y + 0.02, rail - 0.05), material, solid=False)


def _hinged_doors(robe: Joinery, half: float, low: float, high: float, deep: float) -> None:
    """Hang two doors, or four on a wardrobe from 1.2 m on, hinged to the outer and middle posts."""
    pairs = 1 if half < 0.6 else 2
    span = 2 * half / pairs
    for pair in range(pairs):
        y0, y1 = -half + pair * span, -half + (pair + 1) * span
        middle = 0.5 * (y0 + y1)
        if pair:
            robe.box(
                (0.02, y0 - 0.5 * BOARD, low), (deep, y0 + 0.5 * BOARD, high - BOARD), "wood_light"
            )
        number = 2 * pair
        # Two doors on one post stop before their handles meet.
        robe.door(
            f"door_{number + 2}",
            (deep, middle, low),
            (deep + 0.02, y1, high),
            "front",
            hinge="left",
            handle_z=1.05,
            swing=_WIDE_SWING if pair == pairs - 1 else _SHORT_SWING,
        )
        robe.door(
            f"door_{number + 1}",
            (deep, y0, low),
            (deep + 0.02, middle, high),
            "front",
            hinge="right",
            handle_z=1.05,
            swing=_WIDE_SWING if pair == 0 else _SHORT_SWING,
        )


def _sliding_doors(robe: Joinery, half: float, low: float, high: float, inner: float) -> None:
    """Put two doors, one of them a mirror, on two tracks one behind the other."""
    top, overlap = high - BOARD, 0.03
    tracks = (("door_left", 1, inner + 0.012, "front"), ("door_right", -1, inner + 0.042, "mirror"))
    robe.box((inner, -half + BOARD, low - 0.02), (inner + 0.08, half - BOARD, low), "metal")
    for name, sign, x, material in tracks:
        outer = sign * (half - BOARD - 0.002)
        y0, y1 = sorted((outer, -sign * overlap))
        middle = 0.5 * (y0 + y1)
        robe.moving(
            name,
            "prismatic",
            (x, middle, 0.5 * (low + top)),
            (0.0, -float(sign), 0.0),
            half - BOARD - overlap - 0.002,
            damping=12.0,
        )
        robe.box((x, y0, low + 0.004), (x + 0.018, y1, top - 0.004), material, link=name)
        edge = outer - sign * 0.05
        grip = (x + 0.018, edge, 1.0)
        # A flush pull: the doors pass each other.
        robe.box((x + 0.018, edge - 0.012, 0.9), (x + 0.026, edge + 0.012, 1.1), "metal", link=name)
        robe.frame(f"handle_{name}", grip, f"pull of the joint {name}, x out of it")


@maker("chest_of_drawers")
def make_chest(setting: Setting, *, width: float = 0.9, drawers: int = 4) -> Piece:
    """Make a chest of drawers, one above the other; ConfigError if there are none or too many."""
    if not 1 <= drawers <= 6:
        raise ConfigError(f"a chest has 1 to 6 drawers, got {drawers}")
    high, deep, half, plinth = 0.1 + 0.21 * drawers, 0.48, 0.5 * width, 0.08
    chest = Joinery("chest_of_drawers", setting)
    for y in (-half, half - BOARD):
        chest.box((0.0, y, 0.0), (deep, y + BOARD, high - 0.02), "wood")
    chest.box((0.0, -half - 0.01, high - 0.02), (deep + 0.015, half + 0.01, high), "wood")
    chest.box((0.0, -half + BOARD, plinth), (0.012, half - BOARD, high - 0.02), "wood")
    chest.box((0.0, -half + BOARD, plinth - BOARD), (deep - 0.02, half - BOARD, plinth), "wood")
    step = (high - 0.02 - plinth) / drawers
    for k in range(drawers):
        z = plinth + k * step
        chest.drawer(
            f"drawer_{drawers - k}",
            (0.02, -half + BOARD, z),
            (deep, half - BOARD, z + step),
            "wood_light",
        )
    chest.box((0.1, -0.3, high), (0.3, -0.08, high + 0.05), "paper", solid=False)
    chest.frame("top", (0.5 * deep, 0.0, high), "middle of the top")
    chest.stand_zone(-half, half, 0.6, x=deep)
    return chest.piece()


@maker("vanity")
def make_vanity(setting: Setting, *, width: float = 1.0) -> Piece:
    """Make a dressing table with knee space, two small drawers and a mirror."""
    rules = setting.rules
    top, knee, deep, half = (
        rules.figure("table_height"),
        rules.figure("table_knee_height"),
        0.45,
        0.5 * width,
    )
    table = Joinery("vanity", setting)
    table.box((0.0, -half, top - 0.025), (deep, half, top), "wood")
    for y in (-half, half - 0.04):
        for x in (0.0, deep - 0.04):
            table.box((x, y, 0.0), (x + 0.04, y + 0.04, top - 0.025), "wood")
    box = 0.09
    table.box((0.0, -half, top), (0.012, half, top + box), "wood")
    for name, y in (("left", half - 0.25), ("right", -half)):
        table.box((0.0, y, top + box), (0.2, y + 0.25, top + box + 0.012), "wood")
        for side in (y, y + 0.238):
            table.box((0.012, side, top), (0.2, side + 0.012, top + box), "wood")
        table.drawer(
            f"drawer_{name}", (0.014, y + 0.012, top), (0.2, y + 0.238, top + box), "wood_light"
        )
    table.box((0.005, -0.3, top + 0.12), (0.03, 0.3, top + 0.85), "wood")
    table.box((0.03, -0.27, top + 0.15), (0.033, 0.27, top + 0.82), "mirror", solid=False)
    table.box((0.0, -0.2, top), (0.02, 0.2, top + 0.14), "wood")
    table.measures.update(table_height=top, table_knee_height=top - 0.025)
    assert top - 0.025 >= knee
    table.knee.append(Rectangle(0.0, -half + 0.04, deep, half - 0.04))
    table.frame("tabletop", (0.3, 0.0, top), "free part of the top")
    table.frame(
        "place_1",
        (deep + 0.32, 0.0, 0.0),
        "floor where one sits, x out of the chair's back",
        yaw_deg=180.0,
    )
    table.stand_zone(-0.4, 0.4, 0.75, x=deep)
    return table.piece()


@maker("bench")
def make_bench(setting: Setting, *, width: float = 1.2, depth: float = 0.4) -> Piece:
    """Make an upholstered bench to sit on, as at the foot of a bed."""
    top, half = setting.rules.figure("seat_height"), 0.5 * width
    bench = Joinery("bench", setting)
    bench.box((0.0, -half, top - 0.09), (depth, half, top), "fabric_light", bevel=0.03)
    bench.box(
        (0.02, -half + 0.02, top - 0.12), (depth - 0.02, half - 0.02, top - 0.09), "wood_dark"
    )
    bench.legs(
        Rectangle(0.03, -half + 0.05, depth - 0.03, half - 0.05), top - 0.12, 0.04, "wood_dark"
    )
    bench.measures["seat_height"] = top
    bench.frame("seat", (0.5 * depth, 0.0, top), "middle of the seat")
    bench.stand_zone(-half, half, 0.5, x=depth)
    return bench.piece()
