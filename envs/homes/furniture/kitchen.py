"""Fitted kitchens: runs of units against a wall, islands, tall cupboards."""

from __future__ import annotations

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker
from .joinery import Joinery, front_zone, wall_strip
from .kitchen_layout import CORNER, LONGEST_RUN, SHORTEST_RUN, RunPlan, Unit, lay_units
from .kitchen_unit import (
    CARCASS,
    DEPTH,
    FRONT,
    PLINTH,
    Run,
    add_boards,
    add_unit,
    add_worktop,
)
from .kitchen_wall import add_cabinets, add_hood, add_tiles

SWEEP = 0.45  # [m] in front of a run where drawers and most doors move
TALL = 2.1  # [m]; common, from memory
SPARE = 0.25  # [m] of worktop behind an island that stools go under; own choice


@maker("kitchen_run")
def kitchen_run(
    setting: Setting,
    *,
    length: float = 3.0,
    sink: bool = True,
    hob: bool = True,
    dishwasher: bool = True,
    oven: bool = True,
    wall_cabinets: bool = True,
    window: tuple[float, float] | None = None,
    corner: str = "",
    plain: bool = False,
    props: bool = True,
) -> Piece:
    """Return a fitted run along one wall.

    Where the rules ask for room for knees, it is under the sink; at level 3 also under the hob, whose
    oven then is an `oven_tower`.

    Args:
        setting: What it is made for.
        length: Along the wall, 1.8 to 4.8, rounded to 0.1 [m].
        sink: Whether it has a sink.
        hob: Whether it has a hob.
        dishwasher: Whether it has a dishwasher, if there is room for one.
        oven: Whether there is an oven under the hob.
        wall_cabinets: Whether cabinets hang over it.
        window: Where a window is over it, from and to, counted from its end at least y [m].
        corner: `left` or `right`, as seen with the back to the wall, where another run meets it at a
            right angle: 0.6 m of it are then a blind unit. Empty for none.
        plain: Whether it has neither sink nor hob, dishwasher and oven.
        props: Whether a kettle, knives and fruit stand on it; never on a plain one.

    Raises:
        ConfigError: If the length is out of range, sink and hob do not fit, or `corner` is no side.
    """
    plan = RunPlan(
        round(length, 1),
        sink=sink and not plain,
        hob=hob and not plain,
        dishwasher=dishwasher and not plain,
        oven=oven and not plain,
        corner=corner,
        window=None if window is None else (float(window[0]), float(window[1])),
    )
    if not SHORTEST_RUN <= plan.length <= LONGEST_RUN:
        raise ConfigError(
            f"a kitchen run is {SHORTEST_RUN} to {LONGEST_RUN} m long, got {length!r}"
        )
    if corner not in ("", "left", "right"):
        raise ConfigError(f"corner must be 'left', 'right' or empty, got {corner!r}")
    add = Joinery("kitchen_run", setting)
    units = lay_units(plan, setting.rules)
    run = _run(add, 0.0)
    _fit(run, units, DEPTH)
    _free_worktop(run, units, props=props and not plain)
    return _hung(run, plan, units, wall_cabinets=wall_cabinets)


def _hung(run: Run, plan: RunPlan, units: tuple[Unit, ...], *, wall_cabinets: bool) -> Piece:
    """Return the run with what hangs over it."""
    add, rules = run.assembly, run.assembly.rules
    measures, height = _knee_measures(run, units), run.top + 0.27 * plan.sink
    measures["counter_height"] = run.top
    bottom = rules.figure("wall_cabinet_height")
    add_tiles(add, plan, run.top, bottom - 0.016)
    if wall_cabinets:
        height = max(height, add_cabinets(add, plan, units, bottom))
        measures["wall_cabinet_height"] = bottom
    hobs = [unit for unit in units if unit.kind.endswith("hob")]
    if hobs:
        height = max(height, add_hood(add, hobs[0].middle, run.top))
    aisle = rules.figure("kitchen_aisle")
    add.measures |= measures
    add.knee += tuple(
        Rectangle(DEPTH - run.knee_depth, unit.y0, DEPTH, unit.y1) for unit in units if unit.is_open
    )
    return add.piece(
        wall_strip(DEPTH, plan.length),
        height,
        zones=(*_in_front(plan, aisle, "use"), *_in_front(plan, SWEEP, "sweep")),
    )


def _run(add: Joinery, back: float) -> Run:
    rules = add.rules
    has_knee = rules.has("counter_knee_height")
    return Run(
        add,
        back,
        rules.figure("counter_height"),
        rules.figure("counter_knee_height") if has_knee else 0.0,
        rules.figure("counter_knee_depth") if has_knee else 0.0,
    )


def _fit(run: Run, units: tuple[Unit, ...], depth: float, spare: float = 0.0) -> None:
    for number, unit in enumerate(units, start=1):
        add_unit(run, unit, number)
    add_boards(run, units)
    add_worktop(run, units, depth, spare)


def _knee_measures(run: Run, units: tuple[Unit, ...]) -> dict[str, float]:
    opened = [unit for unit in units if unit.is_open]
    if not opened:
        return {}
    return {
        "counter_knee_height": run.knee,
        "counter_knee_width": min(unit.y1 - unit.y0 for unit in opened),
        "counter_knee_depth": run.knee_depth,
    }


def _in_front(plan: RunPlan, reach: float, why: str) -> tuple[Zone, ...]:
    """Return the floor in front of a run, without a corner that another run takes."""
    half = 0.5 * plan.length
    low = -half + (CORNER if plan.corner == "right" else 0.0)
    high = half - (CORNER if plan.corner == "left" else 0.0)
    return (Zone(Rectangle(DEPTH, low, DEPTH + reach, high), why),)


def _free_worktop(run: Run, units: tuple[Unit, ...], *, props: bool) -> None:
    """Name the longest free stretch of worktop, and put what a kitchen has on the others."""
    taken = ("sink", "hob")
    stretches: list[tuple[float, float]] = []
    for unit in units:
        if unit.kind.endswith(taken):
            continue
        if stretches and abs(stretches[-1][1] - unit.y0) < 1e-9:
            stretches[-1] = (stretches[-1][0], unit.y1)
        else:
            stretches.append((unit.y0, unit.y1))
    stretches.sort(key=lambda span: span[0] - span[1])
    if not stretches:
        return
    middle = 0.5 * sum(stretches[0])
    run.assembly.frame(
        "worktop", run.at(0.35, middle, run.top), note="middle of the longest free worktop"
    )
    if not props:
        return
    low, high = stretches[0]
    if high - low > 0.9:  # they stand at the ends of it, near the wall
        add_kettle(run.assembly, (0.15, low + 0.14, run.top))
        add_knives(run.assembly, (0.10, high - 0.12, run.top))
    if len(stretches) > 1 and stretches[1][1] - stretches[1][0] > 0.4:
        add_fruit(run.assembly, (0.3, 0.5 * sum(stretches[1]), run.top))


def add_kettle(add: Joinery, at: tuple[float, float, float]) -> None:
    """Stand a kettle on a worktop; `at` is the middle of its foot [m]."""
    x, y, z = at
    profile = ((0.082, 0.0), (0.085, 0.02), (0.078, 0.12), (0.055, 0.19), (0.02, 0.205))
    add.draw(Shape("lathe", "metal", at, profile=profile))
    body = Shape("cylinder", at=(x, y, z + 0.1), radius=0.08, length=0.2)
    add.solid(body)
    handle = ((x, y - 0.07, z + 0.17), (x, y - 0.13, z + 0.16), (x, y - 0.12, z + 0.04))
    add.draw(Shape("tube", "black", points=handle, radius=0.010, bend=0.03))
    add.rod(((x, y + 0.05, z + 0.15), (x, y + 0.105, z + 0.185)), 0.014, "metal")


def add_knives(add: Joinery, at: tuple[float, float, float]) -> None:
    """Stand a block of knives on a worktop; `at` is the middle of its foot [m]."""
    x, y, z = at
    add.box((x - 0.06, y - 0.05, z), (x + 0.06, y + 0.05, z + 0.2), "wood", bevel=0.0)
    for k, (dx, dy) in enumerate(((-0.03, -0.025), (-0.03, 0.025), (0.02, -0.025), (0.02, 0.025))):
        a = (x + dx - 0.012, y + dy - 0.008, z + 0.2)
        add.box(
            a, (x + dx + 0.012, y + dy + 0.008, z + 0.27 + 0.02 * (k % 2)), "black", solid=False
        )


def add_fruit(add: Joinery, at: tuple[float, float, float]) -> None:
    """Stand a bowl of fruit on a table or worktop; `at` is the middle of its foot [m]."""
    x, y, z = at
    bowl = ((0.05, 0.0), (0.06, 0.01), (0.14, 0.075), (0.132, 0.075), (0.05, 0.02), (0.0, 0.02))
    add.draw(Shape("lathe", "clay", at, profile=bowl))
    fruit = (
        (0.05, 0.02, "accent"),
        (-0.05, 0.03, "leaf"),
        (0.0, -0.055, "rug"),
        (0.0, 0.03, "accent"),
    )
    ball = ((0.012, -0.034), (0.036, -0.014), (0.036, 0.014), (0.012, 0.034))
    for k, (dx, dy, material) in enumerate(fruit):
        at = (x + dx, y + dy, z + (0.1 if k == 3 else 0.06))
        add.draw(Shape("lathe", material, at, profile=ball))
    body = Shape("cylinder", at=(x, y, z + 0.05), radius=0.12, length=0.1)
    add.solid(body)


@maker("kitchen_island")
def kitchen_island(setting: Setting, *, length: float = 1.6) -> Piece:
    """Return an island: units that open along x, and worktop that hangs over behind them.

    The overhang takes stools at level 1; at levels 2 and 3 it is deep enough for knees and wheelchairs.

    Args:
        setting: What it is made for.
        length: 1.2 to 2.8 [m].

    Raises:
        ConfigError: If the length is out of range.
    """
    if not 1.2 <= length <= 2.8:
        raise ConfigError(f"a kitchen island is 1.2 to 2.8 m long, got {length!r}")
    add = Joinery("kitchen_island", setting)
    rules = setting.rules
    has_knee = rules.has("counter_knee_depth")
    spare = rules.figure("counter_knee_depth") if has_knee else SPARE
    run = Run(add, spare, rules.figure("counter_height"))
    half, count = 0.5 * length, round(length / 0.6)
    width = length / count
    units = tuple(
        Unit("drawers" if k % 2 else "doors", -half + k * width, -half + (k + 1) * width)
        for k in range(count)
    )
    _fit(run, units, DEPTH, spare)
    add.box((spare - 0.012, -half, 0.0), (spare, half, run.under), "front")
    add_fruit(add, run.at(0.2, 0.25 * length, run.top))
    free = half
    if has_knee:  # legs at the ends carry the overhang
        for side in (-1, 1):
            y = side * (half - 0.03)
            add.box((0.02, y - 0.03, 0.0), (0.08, y + 0.03, run.under), "front")
        free = half - 0.06
    reach = rules.figure("passage_width")
    behind = Zone(Rectangle(-reach, -half, 0.0, half))
    depth = spare + DEPTH
    add.frame("worktop", (0.25, 0.0, run.top), note="middle of the overhang")
    measures = {"counter_height": run.top}
    if has_knee:
        measures = {
            "counter_height": run.top,
            "counter_knee_height": run.under,
            "counter_knee_width": 2 * free,
            "counter_knee_depth": spare - 0.012,
        }
    add.measures |= measures
    add.knee += (Rectangle(0.0, -free, spare - 0.012, free),) if has_knee else ()
    return add.piece(
        wall_strip(depth, length),
        run.top + 0.14,
        zones=(front_zone(depth, length, rules.figure("kitchen_aisle")), behind),
    )


@maker("tall_cupboard")
def tall_cupboard(setting: Setting, *, width: float = 0.6) -> Piece:
    """Return a cupboard of the height of a person with an upper and a lower door, `width` [m] wide."""
    return _tall(setting, "tall_cupboard", width, (PLINTH, 1.25, TALL), is_pantry=False)


@maker("pantry_cupboard")
def pantry_cupboard(setting: Setting, *, width: float = 0.6) -> Piece:
    """Return a tall cupboard with one high door and food on five shelves, `width` [m] wide."""
    return _tall(setting, "pantry_cupboard", width, (PLINTH, TALL), is_pantry=True)


def _tall(
    setting: Setting, kind: str, width: float, joins: tuple[float, ...], *, is_pantry: bool
) -> Piece:
    if not 0.4 <= width <= 1.2:
        raise ConfigError(f"a {kind} is 0.4 to 1.2 m wide, got {width!r}")
    add = Joinery(kind, setting)
    half = 0.5 * width
    tall_carcass(add, half)
    for place, (z0, z1) in enumerate(zip(joins, joins[1:], strict=False), start=1):
        handle = min(max(1.05, z0 + 0.15), z1 - 0.15)
        if width <= 0.6 + 1e-9:
            spans = [(-half, half, "low")]
        else:
            spans = [(-half, 0.0, "low"), (0.0, half, "high")]
        for leaf, (y0, y1, side) in enumerate(spans):
            name = f"door_{place}" + (f"_{leaf + 1}" if len(spans) > 1 else "")
            at = ((CARCASS, y0, z0), (CARCASS + FRONT, y1, z1))
            if side == "low":
                add.door(name, *at, "front", hinge="right", handle_z=handle, framed=True)
            else:
                add.door(name, *at, "front", hinge="left", handle_z=handle, framed=True)
    for k, z in enumerate((0.45, 0.8, 1.15, 1.5, 1.8)):
        low, high = (0.01, -half + 0.016, z), (0.48, half - 0.016, z + 0.016)
        add.box(low, high, "trim")
        _groceries(add, half, z + 0.016, k) if is_pantry else _linen(add, half, z + 0.016, k)
    return add.piece(
        wall_strip(DEPTH, width),
        TALL,
        zones=(
            front_zone(DEPTH, width, setting.rules.figure("kitchen_aisle")),
            front_zone(DEPTH, width, SWEEP, "sweep"),
        ),
    )


def tall_carcass(add: Joinery, half: float) -> None:
    """Add the boards of a tall unit `2 half` [m] wide: sides, top, bottom, back and plinth."""
    for y0, y1 in ((-half, -half + 0.016), (half - 0.016, half)):
        add.box((0.0, y0, 0.0), (CARCASS, y1, TALL), "front")
    add.box((0.0, -half, TALL - 0.016), (CARCASS, half, TALL), "front")
    add.box((0.0, -half, PLINTH), (CARCASS, half, PLINTH + 0.016), "trim")
    add.box((0.0, -half, PLINTH), (0.012, half, TALL), "trim")
    add.box((CARCASS - 0.076, -half, 0.0), (CARCASS - 0.06, half, PLINTH), "front")


def _groceries(add: Joinery, half: float, z: float, row: int) -> None:
    colours = ("accent", "paper", "clay", "leaf", "rug", "blanket", "glass")
    count = int((2 * half - 0.1) / 0.095)
    for k in range(count):
        y = -half + 0.08 + 0.095 * k
        material, tall = colours[(3 * k + 2 * row) % 7], 0.12 + 0.05 * ((k + row) % 3)
        if (k + row) % 2:
            add.rod(((0.3, y, z), (0.3, y, z + tall)), 0.036, material)
        else:
            low, high = (0.22, y - 0.036, z), (0.36, y + 0.036, z + tall)
            add.box(low, high, material, solid=False)


def _linen(add: Joinery, half: float, z: float, row: int) -> None:
    colours = ("towel", "linen", "blanket", "paper")
    for k in range(2):
        y = -0.5 * half + k * half
        low, high = (0.1, y - 0.4 * half, z), (0.42, y + 0.4 * half, z + 0.1 + 0.05 * (row % 2))
        add.box(low, high, colours[(row + k) % 4], solid=False)


@maker("stool")
def stool(setting: Setting, *, height: float = 0.65) -> Piece:
    """Return a stool with a round seat, `height` [m] high."""
    add = Joinery("stool", setting)
    x, foot = 0.19, 0.15
    add.add(Shape("cylinder", "wood", (x, 0.0, height - 0.018), radius=0.17, length=0.036))
    for dx in (-1, 1):
        for dy in (-1, 1):
            low = (x + dx * foot, dy * foot, 0.002)
            add.rod((low, (x + 0.11 * dx, 0.11 * dy, height - 0.03)), 0.016, "wood", solid=True)
    z = 0.35 * height
    for side in (-1, 1):
        add.rod(((x - 0.135, 0.135 * side, z), (x + 0.135, 0.135 * side, z)), 0.01, "metal")
        add.rod(((x + 0.135 * side, -0.135, z), (x + 0.135 * side, 0.135, z)), 0.01, "metal")
    add.frame("seat", (x, 0.0, height), note="middle of the seat")
    return add.piece(wall_strip(0.38, 0.36), height)


@maker("bin")
def waste_bin(setting: Setting) -> Piece:
    """Return a bin with a lid that swings up."""
    add = Joinery("bin", setting)
    x, radius, high = 0.17, 0.15, 0.55
    can = (
        (radius, 0.0),
        (radius, high),
        (radius - 0.006, high),
        (radius - 0.006, 0.01),
        (0.0, 0.01),
    )
    add.draw(Shape("lathe", "metal", (x, 0.0, 0.0), profile=can))
    wall = 0.012
    add.box((x - 0.13, -0.13, 0.0), (x + 0.13, 0.13, wall), "", seen=False)
    for side in (-1, 1):
        y = side * (0.13 - 0.5 * wall)
        add.box((x - 0.13, y - 0.5 * wall, 0.0), (x + 0.13, y + 0.5 * wall, high), "", seen=False)
        c = x + y
        add.box((c - 0.5 * wall, -0.13, 0.0), (c + 0.5 * wall, 0.13, high), "", seen=False)
    # It stops short of upright, and friction holds its 0.4 kg wherever it is let go of.
    hinge = (x - radius, 0.0, high)
    add.moving(
        "lid", "revolute", hinge, (0.0, -1.0, 0.0), 1.4, mass=0.4, damping=0.03, friction=0.75
    )
    dome = ((radius, 0.0), (radius - 0.005, 0.025), (radius - 0.06, 0.05), (0.02, 0.06))
    add.draw(Shape("lathe", "metal_dark", (x, 0.0, high), profile=dome), link="lid")
    low, top = (x - 0.12, -0.12, high), (x + 0.12, 0.12, high + 0.04)
    add.box(low, top, "metal_dark", link="lid", seen=False)
    add.frame("handle_lid", (x + radius - 0.01, 0.0, high + 0.01), note="front rim of the lid")
    return add.piece(wall_strip(0.33, 0.32), high + 0.06)
