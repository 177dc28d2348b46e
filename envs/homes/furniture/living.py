"""What stands in living rooms and lounges. Sizes are common ones, from memory, unless a rule sets them."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from ..piece import Piece, Setting, maker
from .bedroom import table_lamp
from .joinery import BOARD, Joinery

_ARM = 0.16  # [m] width of armrests
_CUSHION = 0.15  # [m] thick
_SPINES = tuple(
    """
    rug fabric accent leaf paper clay blanket wood_dark brass towel
    """.split()
)


def _lounge(kind: str, setting: Setting, seats: int, seat: float, *, deep: float = 0.88) -> Joinery:
    """Return an upholstered seat: base, back and arms, with a cushion and a pillow for each place.

    Args:
        kind: Kind of the piece.
        setting: What it is made for.
        seats: How many sit on it.
        seat: Width of each place [m].
        deep: From back to front [m].
    """
    top, half = setting.rules.figure("seat_height"), 0.5 * seats * seat
    back, under = 0.2, top - _CUSHION
    sofa = Joinery(kind, setting)
    outer = half + _ARM
    sofa.legs(Rectangle(0.06, -outer + 0.06, deep - 0.06, outer - 0.06), 0.12, 0.05, "wood_dark")
    sofa.box((0.04, -half, 0.12), (deep - 0.02, half, under), "fabric")
    sofa.box((0.0, -half, 0.12), (back - 0.06, half, top + 0.36), "fabric")
    for y in (-outer, half):
        sofa.box((0.0, y, 0.12), (deep, y + _ARM, top + 0.2), "fabric", bevel=0.05)
    for k in range(seats):
        y = -half + k * seat
        sofa.box(
            (back - 0.04, y + 0.004, under),
            (deep + 0.01, y + seat - 0.004, top),
            "fabric",
            bevel=0.045,
        )
        at = (back + 0.055, y + 0.5 * seat, top + 0.21)
        sofa.slab(
            at, (0.13, seat - 0.03, 0.42), "fabric", rpy=(0.0, -0.17, 0.0), bevel=0.055, solid=False
        )
        sofa.slab(
            (at[0] - 0.02, at[1], at[2]),
            (0.09, seat - 0.05, 0.38),
            "",
            rpy=(0.0, -0.17, 0.0),
            seen=False,
        )
        sofa.frame(
            f"seat_{k + 1}", (0.5 * (deep + back) + 0.05, at[1], top), f"middle of place {k + 1}"
        )
    sofa.frames["seat"] = sofa.frames["seat_1"]
    sofa.measures["seat_height"] = top
    sofa.stand_zone(-half, half, 0.5 if setting.rules.level == 1 else 0.6, x=deep)
    return sofa


@maker("sofa")
def make_sofa(setting: Setting, *, seats: int = 3) -> Piece:
    """Make a sofa with a cushion for each seat; ConfigError unless it has 1 to 4."""
    if not 1 <= seats <= 4:
        raise ConfigError(f"a sofa has 1 to 4 seats, got {seats}")
    sofa = _lounge("sofa", setting, seats, 0.62)
    edge, top = 0.31 * seats, setting.rules.figure("seat_height")
    for sign, material in ((1, "accent"), (-1, "fabric_light")):
        sofa.slab(
            (0.42, sign * (edge - 0.2), top + 0.19),
            (0.11, 0.38, 0.38),
            material,
            rpy=(0.0, -0.35, -0.25 * sign),
            bevel=0.05,
            solid=False,
        )
    return sofa.piece()


@maker("armchair")
def make_armchair(setting: Setting) -> Piece:
    """Make an armchair."""
    return _lounge("armchair", setting, 1, 0.56, deep=0.85).piece()


@maker("recliner")
def make_recliner(setting: Setting) -> Piece:
    """Make a reclining chair: `backrest` leans back by 35 degrees, `leg_rest` comes up by 88.

    Both are held by the friction of their hinges, as by the catch of a real one, and yield to a push.
    """
    top, half, deep = setting.rules.figure("seat_height"), 0.27, 1.05
    chair = Joinery("recliner", setting)
    back, outer = 0.55, half + _ARM  # off the wall: the back needs room to recline
    for y in (-outer, half):
        chair.box((back - 0.1, y, 0.03), (deep + 0.25, y + _ARM, top + 0.18), "fabric", bevel=0.05)
    chair.box((back, -half, 0.06), (deep + 0.16, half, top - 0.14), "fabric")
    chair.box(
        (back + 0.02, -half + 0.004, top - 0.14),
        (deep + 0.24, half - 0.004, top),
        "fabric",
        bevel=0.045,
    )
    for y in (-outer + 0.02, outer - 0.08):
        chair.box((back, y, 0.0), (deep + 0.1, y + 0.06, 0.05), "wood_dark")
    pivot = (back + 0.04, 0.0, top - 0.02)
    # Cushions on a frame: light, or no friction that a push can beat would hold them.
    chair.moving(
        "backrest",
        "revolute",
        pivot,
        (0.0, -1.0, 0.0),
        math.radians(35.0),
        density=40.0,
        damping=2.0,
        friction=6.5,
    )
    chair.slab(
        (pivot[0] - 0.09, 0.0, top + 0.33),
        (0.15, 2 * half - 0.02, 0.72),
        "fabric",
        link="backrest",
        rpy=(0.0, -0.14, 0.0),
        bevel=0.055,
    )
    chair.slab(
        (pivot[0] - 0.075, 0.0, top + 0.6),
        (0.17, 2 * half - 0.06, 0.16),
        "fabric_light",
        link="backrest",
        rpy=(0.0, -0.14, 0.0),
        bevel=0.05,
        solid=False,
    )
    front = deep + 0.255
    knee = (front, 0.0, top - 0.055)
    chair.moving(
        "leg_rest",
        "revolute",
        knee,
        (0.0, -1.0, 0.0),
        math.radians(88.0),
        density=80.0,
        damping=1.0,
        friction=3.4,
    )
    chair.box(
        (front, -half + 0.01, 0.07),
        (front + 0.09, half - 0.01, top - 0.05),
        "fabric",
        link="leg_rest",
        bevel=0.04,
    )
    chair.frame(
        "handle_backrest", (pivot[0] - 0.05, 0.0, top + 0.66), "top of the back", yaw_deg=180.0
    )
    chair.frame("handle_leg_rest", (front + 0.09, 0.0, 0.1), "lower edge of the leg rest")
    chair.frame("seat", (back + 0.3, 0.0, top), "middle of the seat")
    chair.measures["seat_height"] = top
    chair.stand_zone(-half, half, 0.6, x=front + 0.09)
    return chair.piece()


@maker("coffee_table")
def make_coffee_table(setting: Setting, *, width: float = 1.0, depth: float = 0.55) -> Piece:
    """Make a coffee table with a shelf below; a tray, a mug and magazines lie on it."""
    half, top = 0.5 * width, 0.42
    table = Joinery("coffee_table", setting)
    table.box((0.0, -half, top - 0.035), (depth, half, top), "wood", bevel=0.01)
    table.legs(Rectangle(0.03, -half + 0.03, depth - 0.03, half - 0.03), top - 0.035, 0.05, "wood")
    table.box((0.05, -half + 0.05, 0.14), (depth - 0.05, half - 0.05, 0.16), "wood")
    for k, material in enumerate(("paper", "accent", "towel")):
        table.box(
            (0.1, -half + 0.12 + 0.01 * k, 0.16 + 0.012 * k),
            (0.34, -half + 0.3, 0.171 + 0.012 * k),
            material,
            solid=False,
        )
    table.box((0.14, 0.05, top), (0.4, 0.42 * width, top + 0.012), "wood_dark", solid=False)
    table.rod([(0.3, 0.2, top + 0.012), (0.3, 0.2, top + 0.1)], 0.038, "ceramic")
    table.frame("tabletop", (0.5 * depth, 0.0, top), "middle of the top")
    return table.piece()


@maker("side_table")
def make_side_table(setting: Setting, *, lamp: bool = True) -> Piece:
    """Make a small round table beside a sofa, with a lamp on it if `lamp`."""
    table, at, top = Joinery("side_table", setting), 0.23, 0.55
    table.add(
        Shape(
            kind="cylinder", material="wood", at=(at, 0.0, top - 0.0125), radius=0.22, length=0.025
        )
    )
    for turn in range(3):
        angle = 2 * math.pi * turn / 3
        x, y = math.cos(angle), math.sin(angle)
        table.rod(
            [(at + 0.19 * x, 0.19 * y, 0.0), (at + 0.1 * x, 0.1 * y, top - 0.025)],
            0.014,
            "wood_dark",
            solid=True,
        )
    if lamp:
        table_lamp(table, at - 0.06, 0.0, top)
    table.frame("tabletop", (at + 0.1, 0.0, top), "free part of the top")
    return table.piece()


@maker("tv_stand")
def make_tv_stand(setting: Setting, *, width: float = 1.5) -> Piece:
    """Make a low cabinet with two drawers and an open shelf, and a television on it."""
    half, deep, top, foot = 0.5 * width, 0.42, 0.5, 0.1
    stand = Joinery("tv_stand", setting)
    for y in (-half, half - BOARD, -half / 3 - BOARD, half / 3):
        stand.box((0.0, y, foot), (deep, y + BOARD, top - BOARD), "wood")
    stand.box((0.0, -half, top - BOARD), (deep, half, top), "wood")
    stand.box((0.0, -half, foot - BOARD), (deep, half, foot), "wood")
    stand.box((0.0, -half + BOARD, foot), (0.012, half - BOARD, top - BOARD), "wood_dark")
    stand.box((0.02, -half / 3, 0.29), (deep - 0.04, half / 3, 0.29 + BOARD), "wood")
    stand.box((0.1, -0.18, 0.29 + BOARD), (0.33, 0.16, 0.35), "black", solid=False)
    stand.legs(
        Rectangle(0.03, -half + 0.06, deep - 0.03, half - 0.06), foot - BOARD, 0.04, "wood_dark"
    )
    for name, y0, y1 in (
        ("left", half / 3 + BOARD, half - BOARD),
        ("right", BOARD - half, -half / 3 - BOARD),
    ):
        stand.drawer(f"drawer_{name}", (0.02, y0, foot), (deep, y1, top - BOARD), "wood_light")
    wide = min(1.23, 0.9 * width)  # a 55 inch screen
    tall = wide * 9 / 16
    low = top + 0.07
    stand.box((0.17, -0.5 * wide, low), (0.205, 0.5 * wide, low + tall), "black")
    stand.box(
        (0.205, -0.5 * wide + 0.012, low + 0.015),
        (0.207, 0.5 * wide - 0.012, low + tall - 0.012),
        "metal_dark",
        solid=False,
    )
    for y in (-0.3 * wide, 0.3 * wide):
        stand.box((0.08, y - 0.012, top), (0.3, y + 0.012, top + 0.015), "black", solid=False)
        stand.box((0.18, y - 0.01, top), (0.2, y + 0.01, low), "black", solid=False)
    stand.frame("screen", (0.207, 0.0, low + 0.5 * tall), "middle of the screen, x out of it")
    stand.stand_zone(-half, half, 0.5, x=deep)
    return stand.piece()


@maker("bookshelf")
def make_bookshelf(
    setting: Setting, *, width: float = 0.8, height: float = 1.9, seed: int = 0
) -> Piece:
    """Make a bookshelf with books of many colours; `seed` chooses which."""
    half, deep = 0.5 * width, 0.3
    shelf = Joinery("bookshelf", setting)
    for y in (-half, half - BOARD):
        shelf.box((0.0, y, 0.0), (deep, y + BOARD, height), "wood")
    shelf.box((0.0, -half + BOARD, 0.0), (0.012, half - BOARD, height), "wood")
    count = max(2, round((height - 0.1) / 0.36))
    step = (height - 0.07 - BOARD) / count
    for k in range(count + 1):
        z = 0.07 + k * step
        shelf.box((0.012, -half + BOARD, z), (deep, half - BOARD, z + BOARD), "wood")
        if k < count:
            fill_books(shelf, (-half + BOARD, half - BOARD), z + BOARD, step - BOARD, seed + 5 * k)
    shelf.box((deep - 0.03, -half + BOARD, 0.0), (deep - 0.018, half - BOARD, 0.07), "wood")
    shelf.stand_zone(-half, half, 0.6, x=deep)
    return shelf.piece()


def fill_books(
    piece: Joinery, span: tuple[float, float], z: float, room: float, seed: int, *, x: float = 0.05
) -> None:
    """Stand books on a shelf, for the eye; one solid box is what one bumps into.

    Args:
        piece: What the shelf is part of.
        span: From where to where they may stand along y [m].
        z: Top of the shelf [m].
        room: Free height over it [m].
        seed: What they look like.
        x: Their backs' place [m].
    """
    y, k = span[0] + 0.004, seed
    until = span[0] + (0.95, 0.7, 0.85, 0.6)[seed % 4] * (span[1] - span[0])
    start, tallest = y, 0.0
    while True:
        # Golden steps: no pattern that the eye finds, and no random numbers.
        mix = math.modf((k + 1) * 0.6180339887)[0]
        thick, tall = 0.028 + 0.03 * mix, min(room - 0.03, 0.19 + 0.11 * math.modf(7.3 * mix)[0])
        if y + thick > until:
            break
        deep = 0.14 + 0.05 * math.modf(3.1 * mix)[0]
        material = _SPINES[int(10 * math.modf(11.7 * mix + 0.13 * seed)[0])]
        piece.box((x, y, z), (x + deep, y + thick - 0.001, z + tall), material, solid=False)
        y, k, tallest = y + thick, k + 1, max(tallest, tall)
    piece.box((x, start, z), (x + 0.15, y, z + tallest), "", seen=False)


@maker("floor_lamp")
def make_floor_lamp(setting: Setting) -> Piece:
    """Make a floor lamp."""
    lamp, x = Joinery("floor_lamp", setting), 0.2
    lamp.add(
        Shape(
            kind="cylinder", material="metal_dark", at=(x, 0.0, 0.0125), radius=0.14, length=0.025
        )
    )
    lamp.rod([(x, 0.0, 0.02), (x, 0.0, 1.45)], 0.012, "metal_dark", solid=True)
    lamp.draw(
        Shape(kind="lathe", material="lamp", at=(x, 0.0, 0.0), profile=((0.2, 1.3), (0.14, 1.6)))
    )
    lamp.solid(Shape(kind="cylinder", at=(x, 0.0, 1.45), radius=0.17, length=0.3))
    return lamp.piece()
