"""What stands in living rooms and warms them. Sizes are common ones, from memory, unless a rule sets them."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError

from ...rectangle import Rectangle
from .bedroom import table_lamp
from .joinery import BOARD, Joinery, furniture

_ARM = 0.16  # [m] width of armrests
_CUSHION = 0.15  # [m] thick
_SPINES = "rug fabric accent leaf paper clay blanket wood_dark brass towel".split()


def _lounge(made: Joinery, seats: int, seat: float, *, deep: float = 0.88) -> None:
    """Add an upholstered seat: base, back and arms, with a cushion and a pillow for each place.

    Args:
        made: What it is part of.
        seats: How many sit on it.
        seat: Width of each place [m].
        deep: From back to front [m].
    """
    top, half, back = made.ruled("seat_height"), 0.5 * seats * seat, 0.2
    under, outer = top - _CUSHION, half + _ARM
    feet = Rectangle(0.06, -outer + 0.06, deep - 0.06, outer - 0.06)
    made.legs(feet, 0.12, 0.05, "wood_dark")
    made.box((0.04, -half, 0.12), (deep - 0.02, half, under), "fabric")
    made.box((0.0, -half, 0.12), (back - 0.06, half, top + 0.36), "fabric")
    for y in (-outer, half):
        made.box((0.0, y, 0.12), (deep, y + _ARM, top + 0.2), "fabric", bevel=0.05)
    lean = (0.0, -0.17, 0.0)
    for k in range(seats):
        y = -half + k * seat
        a, b = (back - 0.04, y + 0.004, under), (deep + 0.01, y + seat - 0.004, top)
        made.box(a, b, "fabric", bevel=0.045)
        x, y, z = back + 0.055, y + 0.5 * seat, top + 0.21
        pillow = (0.13, seat - 0.03, 0.42)
        made.slab((x, y, z), pillow, "fabric", rpy=lean, bevel=0.055, solid=False)
        made.slab((x - 0.02, y, z), (0.09, seat - 0.05, 0.38), "", rpy=lean, seen=False)
        at = (0.5 * (deep + back) + 0.05, y, top)
        made.frame(f"seat_{k + 1}", at, f"middle of place {k + 1}")
    made.frames["seat"] = made.frames["seat_1"]
    made.stand_zone(-half, half, 0.5 if made.rules.level == 1 else 0.6, x=deep)


@furniture("sofa")
def make_sofa(made: Joinery, *, seats: int = 3) -> None:
    """Make a sofa with a cushion for each seat; ConfigError unless it has 1 to 4."""
    if not 1 <= seats <= 4:
        raise ConfigError(f"a sofa has 1 to 4 seats, got {seats}")
    _lounge(made, seats, 0.62)
    edge, z, size = 0.31 * seats, made.measures["seat_height"] + 0.19, (0.11, 0.38, 0.38)
    for sign, material in ((1, "accent"), (-1, "fabric_light")):
        at, turn = (0.42, sign * (edge - 0.2), z), (0.0, -0.35, -0.25 * sign)
        made.slab(at, size, material, rpy=turn, bevel=0.05, solid=False)


@furniture("armchair")
def make_armchair(made: Joinery) -> None:
    """Make an armchair."""
    _lounge(made, 1, 0.56, deep=0.85)


@furniture("recliner")
def make_recliner(made: Joinery) -> None:
    """Make a reclining chair: `backrest` leans back by 35 degrees, `leg_rest` comes up by 88.

    Both are held by the friction of their hinges, as by the catch of a real one, and yield to a push.
    """
    top, half, deep = made.ruled("seat_height"), 0.27, 1.05
    back, outer = 0.55, half + _ARM  # off the wall: the back needs room to recline
    for y in (-outer, half):
        arm = (deep + 0.25, y + _ARM, top + 0.18)
        made.box((back - 0.1, y, 0.03), arm, "fabric", bevel=0.05)
    made.box((back, -half, 0.06), (deep + 0.16, half, top - 0.14), "fabric")
    low, high = (back + 0.02, -half + 0.004, top - 0.14), (deep + 0.24, half - 0.004, top)
    made.box(low, high, "fabric", bevel=0.045)
    for y in (-outer + 0.02, outer - 0.08):
        made.box((back, y, 0.0), (deep + 0.1, y + 0.06, 0.05), "wood_dark")
    x, turn, lean = back + 0.04, math.radians(35.0), (0.0, -0.14, 0.0)
    # Cushions on a frame: light, or no friction that a push can beat would hold them.
    rest = made.joint(
        "backrest", (x, 0.0, top - 0.02), "-y", turn, density=40.0, damping=2.0, friction=6.5
    )
    size = (0.15, 2 * half - 0.02, 0.72)
    rest.slab((x - 0.09, 0.0, top + 0.33), size, "fabric", rpy=lean, bevel=0.055)
    at, size = (x - 0.075, 0.0, top + 0.6), (0.17, 2 * half - 0.06, 0.16)
    rest.slab(at, size, "fabric_light", rpy=lean, bevel=0.05, solid=False)
    front = deep + 0.255
    knee, turn = (front, 0.0, top - 0.055), math.radians(88.0)
    legs = made.joint("leg_rest", knee, "-y", turn, density=80.0, damping=1.0, friction=3.4)
    low, high = (front, -half + 0.01, 0.07), (front + 0.09, half - 0.01, top - 0.05)
    legs.box(low, high, "fabric", bevel=0.04)
    made.frame("handle_backrest", (x - 0.05, 0.0, top + 0.66), "top of the back", yaw_deg=180.0)
    made.frame("handle_leg_rest", (front + 0.09, 0.0, 0.1), "lower edge of the leg rest")
    made.frame("seat", (back + 0.3, 0.0, top), "middle of the seat")
    made.stand_zone(-half, half, 0.6, x=front + 0.09)


@furniture("coffee_table")
def make_coffee_table(made: Joinery, *, width: float = 1.0, depth: float = 0.55) -> None:
    """Make a coffee table with a shelf below; a tray, a mug and magazines lie on it."""
    half, top = 0.5 * width, 0.42
    made.box((0.0, -half, top - 0.035), (depth, half, top), "wood", bevel=0.01)
    feet = Rectangle(0.03, -half + 0.03, depth - 0.03, half - 0.03)
    made.legs(feet, top - 0.035, 0.05, "wood")
    made.box((0.05, -half + 0.05, 0.14), (depth - 0.05, half - 0.05, 0.16), "wood")
    for k, material in enumerate(("paper", "accent", "towel")):
        low = (0.1, -half + 0.12 + 0.01 * k, 0.16 + 0.012 * k)
        made.show(low, (0.34, -half + 0.3, 0.171 + 0.012 * k), material)
    made.show((0.14, 0.05, top), (0.4, 0.42 * width, top + 0.012), "wood_dark")
    made.post((0.3, 0.2, top + 0.012), top + 0.1, 0.038, "ceramic")
    made.frame("tabletop", (0.5 * depth, 0.0, top), "middle of the top")


@furniture("side_table")
def make_side_table(made: Joinery, *, lamp: bool = True) -> None:
    """Make a small round table beside a sofa, with a lamp on it if `lamp`."""
    at, top = 0.23, 0.55
    made.cylinder((at, 0.0, top - 0.0125), 0.22, 0.025, material="wood")
    for turn in range(3):
        angle = 2 * math.pi * turn / 3
        x, y = math.cos(angle), math.sin(angle)
        ends = (at + 0.19 * x, 0.19 * y, 0.0), (at + 0.1 * x, 0.1 * y, top - 0.025)
        made.rod(ends, 0.014, "wood_dark", solid=True)
    if lamp:
        table_lamp(made, at - 0.06, 0.0, top)
    made.frame("tabletop", (at + 0.1, 0.0, top), "free part of the top")


@furniture("tv_stand")
def make_tv_stand(made: Joinery, *, width: float = 1.5) -> None:
    """Make a low cabinet with two drawers and an open shelf, and a television on it."""
    half, deep, top, foot = 0.5 * width, 0.42, 0.5, 0.1
    inner, third, under = half - BOARD, half / 3, top - BOARD
    for y in (-half, inner, -half / 3 - BOARD, third):
        made.box((0.0, y, foot), (deep, y + BOARD, under), "wood")
    made.box((0.0, -half, under), (deep, half, top), "wood")
    made.box((0.0, -half, foot - BOARD), (deep, half, foot), "wood")
    made.box((0.0, -half + BOARD, foot), (0.012, inner, under), "wood_dark")
    made.box((0.02, -half / 3, 0.29), (deep - 0.04, third, 0.29 + BOARD), "wood")
    made.show((0.1, -0.18, 0.29 + BOARD), (0.33, 0.16, 0.35), "black")
    feet = Rectangle(0.03, -half + 0.06, deep - 0.03, half - 0.06)
    made.legs(feet, foot - BOARD, 0.04, "wood_dark")
    for name, y0, y1 in (("left", third + BOARD, inner), ("right", BOARD - half, -third - BOARD)):
        made.drawer(f"drawer_{name}", (0.02, y0, foot), (deep, y1, under), "wood_light")
    wide = min(1.23, 0.9 * width)  # a 55 inch screen
    tall, low, y = wide * 9 / 16, top + 0.07, 0.5 * wide
    made.box((0.17, -y, low), (0.205, y, low + tall), "black")
    made.show(
        (0.205, -y + 0.012, low + 0.015), (0.207, y - 0.012, low + tall - 0.012), "metal_dark"
    )
    for y in (-0.3 * wide, 0.3 * wide):
        made.show((0.08, y - 0.012, top), (0.3, y + 0.012, top + 0.015), "black")
        made.show((0.18, y - 0.01, top), (0.2, y + 0.01, low), "black")
    made.frame("screen", (0.207, 0.0, low + 0.5 * tall), "middle of the screen, x out of it")
    made.stand_zone(-half, half, 0.5, x=deep)


@furniture("bookshelf")
def make_bookshelf(
    made: Joinery, *, width: float = 0.8, height: float = 1.9, seed: int = 0
) -> None:
    """Make a bookshelf with books of many colours; `seed` chooses which."""
    half, deep = 0.5 * width, 0.3
    inner = half - BOARD
    made.sides((0.0, -half, 0.0), (deep, half, height), BOARD, "wood")
    made.box((0.0, -half + BOARD, 0.0), (0.012, inner, height), "wood")
    count = max(2, round((height - 0.1) / 0.36))
    step = (height - 0.07 - BOARD) / count
    for k in range(count + 1):
        z = 0.07 + k * step
        made.box((0.012, -half + BOARD, z), (deep, inner, z + BOARD), "wood")
        if k < count:
            _fill_books(made, (-half + BOARD, inner), z + BOARD, step - BOARD, seed + 5 * k)
    made.box((deep - 0.03, -half + BOARD, 0.0), (deep - 0.018, inner, 0.07), "wood")
    made.stand_zone(-half, half, 0.6, x=deep)


def _fill_books(made: Joinery, span: tuple[float, float], z: float, room: float, seed: int) -> None:
    """Stand books on a shelf, for the eye; one solid box is what one bumps into.

    Args:
        made: What the shelf is part of.
        span: From where to where they may stand along y [m].
        z: Top of the shelf [m].
        room: Free height over it [m].
        seed: What they look like.
    """
    x, y, k = 0.05, span[0] + 0.004, seed
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
        made.show((x, y, z), (x + deep, y + thick - 0.001, z + tall), material)
        y, k, tallest = y + thick, k + 1, max(tallest, tall)
    made.block((x, start, z), (x + 0.15, y, z + tallest))


@furniture("floor_lamp")
def make_floor_lamp(made: Joinery) -> None:
    """Make a floor lamp."""
    x = 0.2
    made.cylinder((x, 0.0, 0.0125), 0.14, 0.025, material="metal_dark")
    made.post((x, 0.0, 0.02), 1.45, 0.012, "metal_dark", solid=True)
    made.lathe((x, 0.0, 0.0), ((0.2, 1.3), (0.14, 1.6)), "lamp")
    made.cylinder((x, 0.0, 1.45), 0.17, 0.3)


@furniture("fireplace")
def make_fireplace(made: Joinery, *, width: float = 1.4) -> None:
    """Make a fireplace with a stone surround, a mantel and logs on the grate."""
    half, high, deep, gap = 0.5 * width, 1.1, 0.32, 0.4
    front, under, top = deep + 0.02, high - 0.08, high + 0.05
    for y0, y1 in ((-half, -gap), (gap, half)):
        made.box((0.0, y0, 0.0), (deep, y1, high), "trim")
        made.show((deep, y0 + 0.05, 0.0), (front, y1 - 0.05, under), "trim")
    made.box((0.0, -gap, 0.7), (deep, gap, high), "trim")
    made.show((deep, -gap + 0.02, 0.74), (front, gap - 0.02, under), "trim")
    made.box((0.0, -half - 0.07, high), (deep + 0.07, half + 0.07, top), "wood_dark")
    made.box((0.0, -gap, 0.0), (0.03, gap, 0.7), "black")
    made.sides((0.03, -gap, 0.03), (deep - 0.03, gap, 0.7), 0.012, "metal_dark", solid=False)
    made.box((0.03, -half, 0.0), (deep + 0.35, half, 0.03), "paving")
    _logs(made)
    for y in (-0.5 * half, -0.35 * half):
        made.post((0.18, y, top), high + 0.23, 0.018, "linen")
        made.post((0.18, y, top), high + 0.06, 0.04, "brass")
    y, z = 0.35 * half, high + 0.17
    made.show((0.12, y, top), (0.2, y + 0.2, high + 0.27), "wood")
    made.rod([(0.2, y + 0.1, z), (0.203, y + 0.1, z)], 0.075, "white")
    made.stand_zone(-half, half, 0.6, x=deep + 0.35)


def _logs(made: Joinery) -> None:
    """Lay logs with a small flame on a grate; all of it is solid as one box."""
    for y in (-0.2, 0.0, 0.2):
        made.show((0.08, y - 0.01, 0.03), (0.28, y + 0.01, 0.1), "metal_dark")
    for x, z, turn in ((0.13, 0.14, 0.05), (0.23, 0.14, -0.06), (0.18, 0.22, 0.1)):
        made.rod([(x - turn, -0.25, z), (x + turn, 0.25, z)], 0.042, "wood_dark")
    for y, tall in ((-0.08, 0.2), (0.03, 0.3), (0.12, 0.18)):
        flame = ((0.0, 0.0), (0.05, 0.06), (0.03, 0.5 * tall), (0.0, tall))
        made.lathe((0.18, y, 0.24), flame, "accent")
    made.block((0.08, -0.28, 0.03), (0.28, 0.28, 0.26))
