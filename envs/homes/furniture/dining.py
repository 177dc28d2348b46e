"""Dining rooms and gardens: tables, chairs, sideboards, a dresser."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError

from ...rectangle import Rectangle
from ..piece import Zone
from .joinery import BOARD, Joinery, front_zone, furniture

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
_CHAIR = "where a chair goes"


@furniture("dining_table")
def dining_table(made: Joinery, *, seats: int = 6) -> None:
    """Make a dining table: on four legs, and on columns at level 3.

    Its frames `place_1`, `place_2`, ... are where the frames of chairs go. It has 4, 6 or 8 `seats`;
    ConfigError if there is no table for so many.
    """
    if seats not in TABLES:
        raise ConfigError(f"dining tables seat {', '.join(map(str, TABLES))}, got {seats!r}")
    length, depth = TABLES[seats]
    length += LONGER if made.rules.level == 3 else 0.0
    height, free = made.ruled("table_height"), made.ruled("table_knee_height")
    half, under = 0.5 * length, height - TOP
    made.box((0.0, -half, under), (depth, half, height), "wood", bevel=0.006)
    if made.rules.level == 3:
        _columns(made, seats, half, depth, under, free)
    else:
        _legs(made, half, depth, under, free)
    _places(made, seats, half, depth)
    made.frame("tabletop", (0.5 * depth, 0.0, height), "middle of the table")
    end = half + (SITTING if seats == 8 else 0.0)
    use = Zone(Rectangle(-SITTING, -end, depth + SITTING, end))
    made.outline(depth, half, height, use)


def _legs(made: Joinery, half: float, depth: float, under: float, free: float) -> None:
    """Add legs at the corners, and the frame between them down to where knees go."""
    side = half - INSET
    made.legs(Rectangle(INSET, -half + INSET, depth - INSET, side), under, LEG, "wood")
    a, b = INSET + 0.02, INSET + 0.045
    for x0, x1 in ((a, b), (depth - b, depth - a)):
        made.box((x0, -half + INSET, free), (x1, side, under), "wood")
    for y0, y1 in ((-half + a, -half + b), (half - b, half - a)):
        made.box((INSET, y0, free), (depth - INSET, y1, under), "wood")
    made.knee.append(Rectangle(0.0, -half + INSET + LEG, depth, side - LEG))


def _columns(
    made: Joinery, seats: int, half: float, depth: float, under: float, free: float
) -> None:
    """Add one column in the middle of a small table, or one near each end of a long one."""
    thick, foot, middle = 0.10, 0.02, 0.5 * depth
    plate = middle - TUCK - 0.03  # chairs stand clear of it
    for y in (0.0,) if seats == 4 else (-half + COLUMN, half - COLUMN):
        low, high = (middle - 0.5 * thick, y - 0.5 * thick), (middle + 0.5 * thick, y + 0.5 * thick)
        made.box((*low, 0.0), (*high, under), "wood")
        made.box((middle - plate, y - 0.2, 0.0), (middle + plate, y + 0.2, foot), "wood_dark")
        # What stiffens the top stays above the knees.
        made.box((0.12, y - 0.1, free), (depth - 0.12, y + 0.1, under), "wood")
    if seats == 4:
        reach = middle - 0.5 * thick
        made.knee.append(Rectangle(0.0, -half, reach, half))
        made.knee.append(Rectangle(depth - reach, -half, depth, half))
        return
    inner = half - COLUMN - 0.5 * thick
    made.knee.append(Rectangle(0.0, -inner, depth, inner))
    made.knee.append(Rectangle(0.0, half - COLUMN + 0.5 * thick, depth, half))
    made.knee.append(Rectangle(0.0, -half, depth, -half + COLUMN - 0.5 * thick))


def _places(made: Joinery, seats: int, half: float, depth: float) -> None:
    """Name where chairs go: along both long sides, and at the ends of the longest table."""
    a_side = seats // 2 if seats < 8 else 3
    away, inner = CHAIR_DEPTH - TUCK, half - INSET - LEG  # chairs go between the legs
    step = 2 * inner / a_side
    spots = [
        (x, -inner + (k + 0.5) * step, yaw)
        for k in range(a_side)
        for x, yaw in ((-away, 0.0), (depth + away, 180.0))
    ]
    if seats == 8:
        spots += [(0.5 * depth, -(half + away), 90.0), (0.5 * depth, half + away, -90.0)]
    for number, (x, y, yaw) in enumerate(spots, start=1):
        made.frame(f"place_{number}", (x, y, 0.0), _CHAIR, yaw_deg=yaw)


@furniture("round_table")
def round_table(made: Joinery, *, diameter: float = 1.1) -> None:
    """Make a round table on one column, with four places.

    It is `diameter` [m] wide; ConfigError unless that is 0.7 to 1.5.
    """
    if not 0.7 <= diameter <= 1.5:
        raise ConfigError(f"a round table is 0.7 to 1.5 m wide, got {diameter!r}")
    height, free = made.ruled("table_height"), made.ruled("table_knee_height")
    r, under = 0.5 * diameter, height - TOP
    made.cylinder((r, 0.0, height - 0.5 * TOP), r, TOP, material="wood")
    made.post((r, 0.0, 0.02), under, 0.05, "wood", solid=True)
    foot = ((0.26, 0.0), (0.26, 0.015), (0.08, 0.03), (0.05, 0.08))
    made.lathe((r, 0.0, 0.0), foot, "wood")
    made.cylinder((r, 0.0, 0.01), 0.26, 0.02)
    beam = 0.5 * r
    made.box((r - beam, -0.03, free), (r + beam, 0.03, under), "wood")
    made.box((r - 0.03, -beam, free), (r + 0.03, beam, under), "wood")
    away, side = r + CHAIR_DEPTH - TUCK, r - 0.06
    for k in range(4):
        turn = k * math.pi / 2
        at = (r - away * math.cos(turn), -away * math.sin(turn), 0.0)
        made.frame(f"place_{k + 1}", at, _CHAIR, yaw_deg=math.degrees(turn))
    made.frame("tabletop", (r, 0.0, height), "middle of the table")
    made.knee += [Rectangle(0.0, -r, side, r), Rectangle(diameter - side, -r, diameter, r)]
    use = Rectangle(-SITTING, -r - SITTING, diameter + SITTING, r + SITTING)
    made.outline(diameter, r, height, Zone(use))


@furniture("garden_table")
def make_garden_table(made: Joinery, *, width: float = 1.2, depth: float = 0.9) -> None:
    """Make a slatted table with room for knees and for a chair on each of its long sides."""
    half, top = 0.5 * width, made.ruled("table_height")
    made.measures["table_knee_height"] = under = top - 0.025
    slats = round(depth / 0.1)
    for k in range(slats):
        x = k * depth / slats
        made.show((x, -half, under), (x + depth / slats - 0.008, half, top), "wood_light")
    made.block((0.0, -half, under), (depth, half, top))
    for y in (-half + 0.08, half - 0.12):
        made.box((0.03, y, top - 0.055), (depth - 0.03, y + 0.04, under), "wood")
    feet = Rectangle(0.03, -half + 0.07, depth - 0.03, half - 0.07)
    made.legs(feet, top - 0.055, 0.06, "wood")
    made.post((0.5 * depth, 0.1, top), top + 0.2, 0.05, "glass")
    for x, y in ((0.3, -0.2), (0.62, -0.3), (0.6, 0.3)):
        made.post((x, y, top), top + 0.11, 0.032, "glass")
    made.knee.append(Rectangle(0.0, -half + 0.13, depth, half - 0.13))
    made.frame("tabletop", (0.5 * depth, 0.0, top), "middle of the top")
    note = "floor of a chair's back that faces the table"
    made.frame("place_1", (depth + 0.35, 0.0, 0.0), note, yaw_deg=180.0)
    made.frame("place_2", (-0.35, 0.0, 0.0), note)


@furniture("chair")
def chair(made: Joinery) -> None:
    """Make a dining chair; at level 3 with armrests to push up from."""
    seat = made.ruled("seat_height")
    half, leg, high, deep = 0.5 * CHAIR_WIDTH, 0.035, seat + 0.45, CHAIR_DEPTH
    under = seat - 0.035  # of the cushion
    for side in (-1, 1):
        y = side * (half - 0.5 * leg)
        y0, y1, a, b = y - 0.5 * leg, y + 0.5 * leg, y - 0.009, y + 0.009
        made.box((0.02, y0, 0.0), (0.02 + leg, y1, high), "wood")
        made.box((deep - leg - 0.01, y0, 0.0), (deep - 0.01, y1, under), "wood")
        made.show((0.05, a, under - 0.055), (deep - leg, b, under), "wood")
        made.show((0.05, a, 0.16), (deep - leg, b, 0.185), "wood")
        if made.rules.level == 3:
            post, rest = deep - leg - 0.01, seat + 0.2
            made.box((post - 0.08, y0, under), (post - 0.08 + leg, y1, rest), "wood")
            made.box((0.03, y0, rest), (post - 0.02, y1, rest + 0.025), "wood")
    front = deep - 0.045
    made.show((front, -half + leg, under - 0.055), (front + 0.018, half - leg, under), "wood")
    made.block((0.02, -half, under - 0.012), (deep, half, under))
    made.box((0.055, -half + 0.008, under), (deep, half - 0.008, seat), "fabric_light", bevel=0.015)
    for z, tall in ((seat + 0.16, 0.05), (seat + 0.26, 0.05), (seat + 0.36, 0.09)):
        made.show((0.025, -half + leg, z), (0.05, half - leg, z + tall), "wood")
    made.block((0.025, -half + leg, seat + 0.15), (0.05, half - leg, high))
    made.frame("seat", (0.05, 0.0, seat), "top of the seat, at the back")
    made.outline(deep, half, high, front_zone(deep, half, 0.35))


@furniture("sideboard")
def sideboard(made: Joinery, *, width: float = 1.6) -> None:
    """Make a low sideboard with drawers over doors, `width` [m] wide, 1.0 to 2.4."""
    if not 1.0 <= width <= 2.4:
        raise ConfigError(f"a {made.kind} is 1.0 to 2.4 m wide, got {width!r}")
    z = 0.8
    _body_of_drawers(made, width, z, z + 0.23)
    outside = ((0.04, 0.0), (0.075, 0.06), (0.06, 0.16), (0.03, 0.2), (0.04, 0.23))
    made.lathe((0.2, -0.3 * width, z), (*outside, (0.032, 0.23), (0.0, 0.15)), "blanket")
    y = 0.2 * width
    made.show((0.03, y, z), (0.05, y + 0.14, z + 0.19), "wood_dark")
    made.show((0.05, y + 0.012, z + 0.012), (0.052, y + 0.128, z + 0.178), "paper")
    made.frame("top", (0.22, 0.0, z), "middle of its top")


def _body_of_drawers(made: Joinery, width: float, high: float, top: float) -> None:
    """Add a cabinet on legs with a row of drawers over a row of doors, and say what floor it needs.

    It is `high` [m] with what stands on it `top` [m].
    """
    deep, half, leg, row = 0.42, 0.5 * width, 0.14, 0.16
    carcass, over = deep - 0.018, high - 0.022
    made.box((0.0, -half, over), (deep + 0.01, half, high), "wood")
    made.box((0.0, -half, leg), (carcass, half, leg + BOARD), "wood")
    made.box((0.0, -half, leg), (0.012, half, over), "wood_dark")
    for side in (-1, 1):
        y, foot = side * (half - 0.5 * BOARD), side * (half - 0.06)
        made.box((0.0, y - 0.5 * BOARD, leg), (deep, y + 0.5 * BOARD, over), "wood")
        for x in (0.03, carcass - 0.06):
            made.box((x, foot - 0.018, 0.0), (x + 0.036, foot + 0.018, leg), "wood_dark")
    count = max(2, round(width / 0.5))
    step, upper = (width - 2 * BOARD) / count, over - row
    for k in range(count):
        y0 = -half + BOARD + k * step
        if k:
            made.box((0.0, y0 - 0.008, leg), (carcass, y0 + 0.008, over), "wood")
        a, b = (carcass - 0.36, y0, upper), (deep, y0 + step, high - 0.024)
        made.drawer(f"drawer_{k + 1}", a, b, "wood", travel=0.3)
        a, b, name = (carcass, y0, leg), (deep, y0 + step, upper), f"door_{k + 1}"
        made.door(name, a, b, "wood", left=bool(k % 2), framed=True)
        z = leg + 0.5 * (upper - leg)
        made.box((0.012, y0, z), (carcass - 0.05, y0 + step, z + BOARD), "wood_light")
        z = leg + BOARD
        made.post((0.2, y0 + 0.5 * step, z), z + 0.1, 0.11, "ceramic")
    use = front_zone(0.47, half, made.rules.figure("passage_width"))
    made.outline(0.47, half, top, use, front_zone(0.47, half, SWEEP, "sweep"))


@furniture("dresser_cabinet")
def dresser_cabinet(made: Joinery, *, width: float = 1.2) -> None:
    """Make a dresser with crockery on open shelves over drawers and doors, `width` [m] wide."""
    if not 1.0 <= width <= 1.8:
        raise ConfigError(f"a dresser is 1.0 to 1.8 m wide, got {width!r}")
    base, half, deep, top = 0.86, 0.5 * width, 0.3, 1.95
    _body_of_drawers(made, width, base, top + 0.03)
    for side in (-1, 1):
        y = side * (half - 0.03)
        made.box((0.0, y - 0.011, base), (deep, y + 0.011, top), "wood")
    made.box((0.0, -half, top), (deep + 0.03, half, top + 0.03), "wood")
    made.box((0.0, -half + 0.03, base), (0.012, half - 0.03, top), "wood_light")
    for row, z in enumerate((1.2, 1.57)):
        made.box((0.0, -half + 0.04, z), (deep - 0.02, half - 0.04, z + 0.02), "wood")
        count = int((width - 0.2) / 0.24)
        for k in range(count):
            y = -half + 0.2 + k * (width - 0.4) / max(1, count - 1)
            plate, mug = ("ceramic", "blanket")[(k + row) % 2], ("clay", "ceramic")[k % 2]
            made.rod(((0.07, y, z + 0.13), (0.085, y, z + 0.134)), 0.105, plate)
            made.post((0.18, y + 0.08, z + 0.02), z + 0.1, 0.038, mug)
    bowl = ((0.06, 0.0), (0.14, 0.09), (0.13, 0.09), (0.05, 0.02), (0.0, 0.02))
    made.lathe((0.2, 0.15, base), bowl, "clay")
    made.frame("top", (0.35, -0.2, base), "on its top, before the shelves")
