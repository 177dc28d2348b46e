"""Dining rooms: tables, chairs, sideboards, a dresser."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker
from .joinery import Joinery, front_zone, wall_strip

# Length and width [m] of tables by seats; common, from memory. At level 3 longer by what a wheelchair
# needs more than a chair; own choice.
TABLES = {4: (1.2, 0.8), 6: (1.8, 0.9), 8: (2.2, 1.0)}
LONGER = 0.2
TOP = 0.03
LEG = 0.07
INSET = 0.03
COLUMN = 0.45  # [m] from the ends of a long table to its columns; own choice
TUCK = 0.18  # [m] that the front of a chair goes under the table
CHAIR_DEPTH, CHAIR_WIDTH = 0.50, 0.45  # [m]; common, from memory
SITTING = 0.75  # [m] from the table that a chair and who sits down on it take; own choice
SWEEP = 0.45


@maker("dining_table")
def dining_table(setting: Setting, *, seats: int = 6) -> Piece:
    """Return a dining table: on four legs, and on columns at level 3.

    Its frames `place_1`, `place_2`, ... are where the frames of chairs go.

    Args:
        setting: What it is made for.
        seats: 4, 6 or 8.

    Raises:
        ConfigError: If there is no table for so many.
    """
    if seats not in TABLES:
        raise ConfigError(f"dining tables seat {', '.join(map(str, TABLES))}, got {seats!r}")
    rules = setting.rules
    length, depth = TABLES[seats]
    length += LONGER if rules.level == 3 else 0.0
    height, free = rules.figure("table_height"), rules.figure("table_knee_height")
    add = Joinery("dining_table", setting)
    half = 0.5 * length
    add.box((0.0, -half, height - TOP), (depth, half, height), "wood", bevel=0.006)
    if rules.level == 3:
        knee = _columns(add, seats, half, depth, height - TOP, free)
    else:
        knee = _legs(add, half, depth, height - TOP, free)
    _places(add, seats, half, depth)
    add.frame("tabletop", (0.5 * depth, 0.0, height), note="middle of the table")
    at_ends = SITTING if seats == 8 else 0.0
    zone = Rectangle(-SITTING, -half - at_ends, depth + SITTING, half + at_ends)
    add.measures |= {"table_height": height, "table_knee_height": free}
    add.knee += knee
    return add.piece(wall_strip(depth, length), height, zones=(Zone(zone),))


def _legs(
    add: Joinery, half: float, depth: float, under: float, free: float
) -> tuple[Rectangle, ...]:
    """Add legs at the corners, and the frame between them down to where knees go."""
    inset = INSET
    for x in (inset, depth - inset - LEG):
        for y in (-half + inset, half - inset - LEG):
            add.box((x, y, 0.0), (x + LEG, y + LEG, under), "wood")
    a, b = inset + 0.02, inset + 0.045
    for x0, x1 in ((a, b), (depth - b, depth - a)):
        add.box((x0, -half + inset, free), (x1, half - inset, under), "wood")
    for y0, y1 in ((-half + a, -half + b), (half - b, half - a)):
        add.box((inset, y0, free), (depth - inset, y1, under), "wood")
    return (Rectangle(0.0, -half + inset + LEG, depth, half - inset - LEG),)


def _columns(
    add: Joinery, seats: int, half: float, depth: float, under: float, free: float
) -> tuple[Rectangle, ...]:
    """Add one column in the middle of a small table, or one near each end of a long one."""
    thick, foot = 0.10, 0.02
    middle = 0.5 * depth
    plate = middle - TUCK - 0.03  # chairs stand clear of it
    at = (0.0,) if seats == 4 else (-half + COLUMN, half - COLUMN)
    for y in at:
        low, high = (middle - 0.5 * thick, y - 0.5 * thick), (middle + 0.5 * thick, y + 0.5 * thick)
        add.box((*low, 0.0), (*high, under), "wood")
        add.box((middle - plate, y - 0.2, 0.0), (middle + plate, y + 0.2, foot), "wood_dark")
        # What stiffens the top stays above the knees.
        add.box((0.12, y - 0.1, free), (depth - 0.12, y + 0.1, under), "wood")
    if seats == 4:
        reach = middle - 0.5 * thick
        return (Rectangle(0.0, -half, reach, half), Rectangle(depth - reach, -half, depth, half))
    inner = half - COLUMN - 0.5 * thick
    return (
        Rectangle(0.0, -inner, depth, inner),
        Rectangle(0.0, half - COLUMN + 0.5 * thick, depth, half),
        Rectangle(0.0, -half, depth, -half + COLUMN - 0.5 * thick),
    )


def _places(add: Joinery, seats: int, half: float, depth: float) -> None:
    """Name where chairs go: along both long sides, and at the ends of the longest table."""
    a_side = seats // 2 if seats < 8 else 3
    away = CHAIR_DEPTH - TUCK
    inner = half - INSET - LEG  # chairs go between the legs
    step, number = 2 * inner / a_side, 0
    for k in range(a_side):
        y = -inner + (k + 0.5) * step
        for x, yaw in ((-away, 0.0), (depth + away, 180.0)):
            number += 1
            add.frame(f"place_{number}", (x, y, 0.0), yaw_deg=yaw, note="where a chair goes")
    if seats == 8:
        for side, yaw in ((-1, 90.0), (1, -90.0)):
            number += 1
            at = (0.5 * depth, side * (half + away), 0.0)
            add.frame(f"place_{number}", at, yaw_deg=yaw, note="where a chair goes")


@maker("round_table")
def round_table(setting: Setting, *, diameter: float = 1.1) -> Piece:
    """Return a round table on one column, with four places.

    Args:
        setting: What it is made for.
        diameter: 0.7 to 1.5 [m].

    Raises:
        ConfigError: If the diameter is out of range.
    """
    if not 0.7 <= diameter <= 1.5:
        raise ConfigError(f"a round table is 0.7 to 1.5 m wide, got {diameter!r}")
    rules = setting.rules
    height, free = rules.figure("table_height"), rules.figure("table_knee_height")
    add = Joinery("round_table", setting)
    r = 0.5 * diameter
    top = Shape("cylinder", "wood", (r, 0.0, height - 0.5 * TOP), radius=r, length=TOP)
    add.add(top)
    add.rod(((r, 0.0, 0.02), (r, 0.0, height - TOP)), 0.05, "wood", solid=True)
    foot = ((0.26, 0.0), (0.26, 0.015), (0.08, 0.03), (0.05, 0.08))
    add.draw(Shape("lathe", "wood", (r, 0.0, 0.0), profile=foot))
    base = Shape("cylinder", at=(r, 0.0, 0.01), radius=0.26, length=0.02)
    add.solid(base)
    beam = 0.5 * r
    add.box((r - beam, -0.03, free), (r + beam, 0.03, height - TOP), "wood")
    add.box((r - 0.03, -beam, free), (r + 0.03, beam, height - TOP), "wood")
    away = r + CHAIR_DEPTH - TUCK
    for k in range(4):
        turn = k * math.pi / 2
        at = (r - away * math.cos(turn), -away * math.sin(turn), 0.0)
        name = f"place_{k + 1}"
        add.frame(name, at, yaw_deg=math.degrees(turn), note="where a chair goes")
    add.frame("tabletop", (r, 0.0, height), note="middle of the table")
    side = r - 0.06
    add.measures |= {"table_height": height, "table_knee_height": free}
    add.knee += (
        Rectangle(0.0, -r, side, r),
        Rectangle(diameter - side, -r, diameter, r),
    )
    return add.piece(
        wall_strip(diameter, diameter),
        height,
        zones=(Zone(Rectangle(-SITTING, -r - SITTING, diameter + SITTING, r + SITTING)),),
    )


@maker("chair")
def chair(setting: Setting) -> Piece:
    """Return a dining chair; at level 3 with armrests to push up from."""
    rules = setting.rules
    seat = rules.figure("seat_height")
    add = Joinery("chair", setting)
    half, leg, high = 0.5 * CHAIR_WIDTH, 0.035, seat + 0.45
    cushion = 0.035
    for side in (-1, 1):
        y = side * (half - 0.5 * leg)
        y0, y1 = y - 0.5 * leg, y + 0.5 * leg
        add.box((0.02, y0, 0.0), (0.02 + leg, y1, high), "wood")
        add.box(
            (CHAIR_DEPTH - leg - 0.01, y0, 0.0), (CHAIR_DEPTH - 0.01, y1, seat - cushion), "wood"
        )
        a, b = (
            (0.05, y - 0.009, seat - cushion - 0.055),
            (CHAIR_DEPTH - leg, y + 0.009, seat - cushion),
        )
        add.box(a, b, "wood", solid=False)
        a, b = (0.05, y - 0.009, 0.16), (CHAIR_DEPTH - leg, y + 0.009, 0.185)
        add.box(a, b, "wood", solid=False)
        if rules.level == 3:
            post, rest = CHAIR_DEPTH - leg - 0.01, seat + 0.2
            add.box((post - 0.08, y0, seat - cushion), (post - 0.08 + leg, y1, rest), "wood")
            add.box((0.03, y0, rest), (post - 0.02, y1 + 0.0, rest + 0.025), "wood")
    front = CHAIR_DEPTH - 0.045
    a, b = (front, -half + leg, seat - cushion - 0.055), (front + 0.018, half - leg, seat - cushion)
    add.box(a, b, "wood", solid=False)
    low, top = (0.02, -half, seat - cushion - 0.012), (CHAIR_DEPTH, half, seat - cushion)
    add.box(low, top, "wood", seen=False)
    low, top = (0.055, -half + 0.008, seat - cushion), (CHAIR_DEPTH, half - 0.008, seat)
    add.box(low, top, "fabric_light", bevel=0.015)
    for z, tall in ((seat + 0.16, 0.05), (seat + 0.26, 0.05), (seat + 0.36, 0.09)):
        add.box((0.025, -half + leg, z), (0.05, half - leg, z + tall), "wood", solid=False)
    add.box((0.025, -half + leg, seat + 0.15), (0.05, half - leg, high), "wood", seen=False)
    add.frame("seat", (0.05, 0.0, seat), note="top of the seat, at the back")
    add.measures |= {"seat_height": seat}
    return add.piece(
        wall_strip(CHAIR_DEPTH, CHAIR_WIDTH),
        high,
        zones=(front_zone(CHAIR_DEPTH, CHAIR_WIDTH, 0.35),),
    )


@maker("sideboard")
def sideboard(setting: Setting, *, width: float = 1.6) -> Piece:
    """Return a low sideboard with drawers over doors, `width` [m] wide, 1.0 to 2.4."""
    return _sideboard(setting, "sideboard", width, 0.8)


@maker("high_sideboard")
def high_sideboard(setting: Setting, *, width: float = 1.2) -> Piece:
    """Return a sideboard that one can stand at, `width` [m] wide, 1.0 to 2.4."""
    return _sideboard(setting, "high_sideboard", width, 1.15)


def _sideboard(setting: Setting, kind: str, width: float, high: float) -> Piece:
    if not 1.0 <= width <= 2.4:
        raise ConfigError(f"a {kind} is 1.0 to 2.4 m wide, got {width!r}")
    add = Joinery(kind, setting)
    body_of_drawers(add, width, high, 0.42)
    z = high + 0.0
    vase = (
        (0.04, 0.0),
        (0.075, 0.06),
        (0.06, 0.16),
        (0.03, 0.2),
        (0.04, 0.23),
        (0.032, 0.23),
        (0.0, 0.15),
    )
    add.draw(Shape("lathe", "blanket", (0.2, -0.3 * width, z), profile=vase))
    add.box((0.03, 0.2 * width, z), (0.05, 0.2 * width + 0.14, z + 0.19), "wood_dark", solid=False)
    add.box(
        (0.05, 0.2 * width + 0.012, z + 0.012),
        (0.052, 0.2 * width + 0.128, z + 0.178),
        "paper",
        solid=False,
    )
    add.frame("top", (0.22, 0.0, high), note="middle of its top")
    return add.piece(
        wall_strip(0.47, width),
        high + 0.23,
        zones=(
            front_zone(0.47, width, setting.rules.figure("passage_width")),
            front_zone(0.47, width, SWEEP, "sweep"),
        ),
    )


def body_of_drawers(add: Joinery, width: float, high: float, deep: float) -> None:
    """Add a cabinet on legs with a row of drawers over a row of doors, its front at `deep` [m]."""
    half, leg, board, row = 0.5 * width, 0.14, 0.018, 0.16
    carcass = deep - 0.018
    add.box((0.0, -half, high - 0.022), (deep + 0.01, half, high), "wood")
    add.box((0.0, -half, leg), (carcass, half, leg + board), "wood")
    add.box((0.0, -half, leg), (0.012, half, high - 0.022), "wood_dark")
    for side in (-1, 1):
        y = side * (half - 0.5 * board)
        add.box((0.0, y - 0.5 * board, leg), (deep, y + 0.5 * board, high - 0.022), "wood")
        for x in (0.03, carcass - 0.06):
            foot = side * (half - 0.06)
            add.box((x, foot - 0.018, 0.0), (x + 0.036, foot + 0.018, leg), "wood_dark")
    count = max(2, round(width / 0.5))
    step = (width - 2 * board) / count
    upper = high - 0.022 - row
    for k in range(count):
        y0 = -half + board + k * step
        if k:
            add.box((0.0, y0 - 0.008, leg), (carcass, y0 + 0.008, high - 0.022), "wood")
        a, b = (carcass - 0.36, y0, upper), (deep, y0 + step, high - 0.024)
        add.drawer(f"drawer_{k + 1}", a, b, "wood", travel=0.3)
        a, b = (carcass, y0, leg), (deep, y0 + step, upper)
        if k % 2:
            add.door(f"door_{k + 1}", a, b, "wood", hinge="left", framed=True)
        else:
            add.door(f"door_{k + 1}", a, b, "wood", hinge="right", framed=True)
        z = leg + 0.5 * (upper - leg)
        add.box((0.012, y0, z), (carcass - 0.05, y0 + step, z + board), "wood_light")
        at = (0.2, y0 + 0.5 * step, leg + board)
        add.rod((at, (at[0], at[1], at[2] + 0.1)), 0.11, "ceramic")


@maker("dresser_cabinet")
def dresser_cabinet(setting: Setting, *, width: float = 1.2) -> Piece:
    """Return a dresser with crockery on open shelves over drawers and doors, `width` [m] wide."""
    if not 1.0 <= width <= 1.8:
        raise ConfigError(f"a dresser is 1.0 to 1.8 m wide, got {width!r}")
    add = Joinery("dresser_cabinet", setting)
    base, half, deep, top = 0.86, 0.5 * width, 0.3, 1.95
    body_of_drawers(add, width, base, 0.42)
    for side in (-1, 1):
        y = side * (half - 0.03)
        add.box((0.0, y - 0.011, base), (deep, y + 0.011, top), "wood")
    add.box((0.0, -half, top), (deep + 0.03, half, top + 0.03), "wood")
    add.box((0.0, -half + 0.03, base), (0.012, half - 0.03, top), "wood_light")
    for row, z in enumerate((1.2, 1.57)):
        add.box((0.0, -half + 0.04, z), (deep - 0.02, half - 0.04, z + 0.02), "wood")
        count = int((width - 0.2) / 0.24)
        for k in range(count):
            y = -half + 0.2 + k * (width - 0.4) / max(1, count - 1)
            tilted = ((0.07, y, z + 0.13), (0.085, y, z + 0.134))
            add.rod(tilted, 0.105, ("ceramic", "blanket")[(k + row) % 2])
            add.rod(
                ((0.18, y + 0.08, z + 0.02), (0.18, y + 0.08, z + 0.1)),
                0.038,
                ("clay", "ceramic")[k % 2],
            )
    bowl = ((0.06, 0.0), (0.14, 0.09), (0.13, 0.09), (0.05, 0.02), (0.0, 0.02))
    add.draw(Shape("lathe", "clay", (0.2, 0.15, base), profile=bowl))
    add.frame("top", (0.35, -0.2, base), note="on its top, before the shelves")
    return add.piece(
        wall_strip(0.47, width),
        top + 0.03,
        zones=(
            front_zone(0.47, width, setting.rules.figure("passage_width")),
            front_zone(0.47, width, SWEEP, "sweep"),
        ),
    )
