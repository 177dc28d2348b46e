"""Fitted kitchens: runs of units against a wall, tall cupboards."""

from __future__ import annotations

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Triple

from ...rectangle import Rectangle
from ..piece import Zone
from .joinery import Joinery, front_zone, furniture
from .kitchen_layout import CORNER, LONGEST_RUN, SHORTEST_RUN, RunPlan, Unit, joined, lay_units
from .kitchen_unit import CARCASS, DEPTH, FACE, PLINTH, Run, add_units
from .kitchen_wall import add_cabinets, add_hood, add_tiles

SWEEP = 0.45  # [m] in front of a run where drawers and most doors move
TALL = 2.1  # [m]; common, from memory


@furniture("kitchen_run")
def kitchen_run(
    made: Joinery,
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
) -> None:
    """Make a fitted run along one wall.

    Where the rules ask for room for knees, it is under the sink; at level 3 also under the hob, whose
    oven then is an `oven_tower`.

    Args:
        made: What it becomes.
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
    wanted = {"sink": sink, "hob": hob, "dishwasher": dishwasher, "oven": oven}
    plan = RunPlan(
        round(length, 1),
        **{name: is_wanted and not plain for name, is_wanted in wanted.items()},
        corner=corner,
        window=None if window is None else (float(window[0]), float(window[1])),
    )
    if not SHORTEST_RUN <= plan.length <= LONGEST_RUN:
        raise ConfigError(
            f"a kitchen run is {SHORTEST_RUN} to {LONGEST_RUN} m long, got {length!r}"
        )
    if corner not in ("", "left", "right"):
        raise ConfigError(f"corner must be 'left', 'right' or empty, got {corner!r}")
    rules, units = made.rules, lay_units(plan, made.rules)
    knee = (rules.figure(f"counter_knee_{side}", 0.0) for side in ("height", "depth"))
    run = Run(made, 0.0, made.ruled("counter_height"), *knee)
    add_units(run, units)
    _free_worktop(run, units, props=props and not plain)
    opened = [unit for unit in units if unit.is_open]
    if opened:
        width = min(unit.y1 - unit.y0 for unit in opened)
        made.measures.update(counter_knee_height=run.knee, counter_knee_width=width)
        made.measures["counter_knee_depth"] = run.knee_depth
    made.knee += [Rectangle(DEPTH - run.knee_depth, u.y0, DEPTH, u.y1) for u in opened]
    height, bottom = run.top + 0.27 * plan.sink, rules.figure("wall_cabinet_height")
    add_tiles(made, plan, run.top, bottom - 0.016)
    if wall_cabinets:
        height = max(height, add_cabinets(made, plan, units, bottom))
        made.measures["wall_cabinet_height"] = bottom
    hobs = [unit for unit in units if unit.kind.endswith("hob")]
    if hobs:
        height = max(height, add_hood(made, hobs[0].middle, run.top))
    # The floor in front of it, without a corner that another run takes.
    half = 0.5 * plan.length
    low, high = -half + CORNER * (corner == "right"), half - CORNER * (corner == "left")
    made.outline(DEPTH, half, height)
    made.zones = [
        Zone(Rectangle(DEPTH, low, DEPTH + reach, high), why)
        for why, reach in (("use", rules.figure("kitchen_aisle")), ("sweep", SWEEP))
    ]


def _free_worktop(run: Run, units: tuple[Unit, ...], *, props: bool) -> None:
    """Name the longest free stretch of worktop, and put what a kitchen has on the others."""
    free = joined(unit for unit in units if not unit.kind.endswith(("sink", "hob")))
    free.sort(key=lambda span: span[0] - span[1])
    if not free:
        return
    low, high = free[0]
    run.frame("worktop", (0.35, 0.5 * sum(free[0]), run.top), "middle of the longest free worktop")
    if not props:
        return
    if high - low > 0.9:  # they stand at the ends of it, near the wall
        add_kettle(run.made, (0.15, low + 0.14, run.top))
        add_knives(run.made, (0.10, high - 0.12, run.top))
    if len(free) > 1 and free[1][1] - free[1][0] > 0.4:
        add_fruit(run.made, (0.3, 0.5 * sum(free[1]), run.top))


def add_kettle(made: Joinery, at: Triple) -> None:
    """Stand a kettle on a worktop; `at` is the middle of its foot [m]."""
    x, y, z = at
    profile = ((0.082, 0.0), (0.085, 0.02), (0.078, 0.12), (0.055, 0.19), (0.02, 0.205))
    made.lathe(at, profile, "metal")
    made.cylinder((x, y, z + 0.1), 0.08, 0.2)
    handle = ((x, y - 0.07, z + 0.17), (x, y - 0.13, z + 0.16), (x, y - 0.12, z + 0.04))
    made.rod(handle, 0.010, "black", bend=0.03)
    made.rod(((x, y + 0.05, z + 0.15), (x, y + 0.105, z + 0.185)), 0.014, "metal")


def add_knives(made: Joinery, at: Triple) -> None:
    """Stand a block of knives on a worktop; `at` is the middle of its foot [m]."""
    x, y, z = at
    made.box((x - 0.06, y - 0.05, z), (x + 0.06, y + 0.05, z + 0.2), "wood")
    for k, (dx, dy) in enumerate(((-0.03, -0.025), (-0.03, 0.025), (0.02, -0.025), (0.02, 0.025))):
        top = (x + dx + 0.012, y + dy + 0.008, z + 0.27 + 0.02 * (k % 2))
        made.show((x + dx - 0.012, y + dy - 0.008, z + 0.2), top, "black")


def add_fruit(made: Joinery, at: Triple) -> None:
    """Stand a bowl of fruit on a table or worktop; `at` is the middle of its foot [m]."""
    x, y, z = at
    bowl = ((0.05, 0.0), (0.06, 0.01), (0.14, 0.075), (0.132, 0.075), (0.05, 0.02), (0.0, 0.02))
    made.lathe(at, bowl, "clay")
    ball = ((0.012, -0.034), (0.036, -0.014), (0.036, 0.014), (0.012, 0.034))
    for dx, dy, up, material in (
        (0.05, 0.02, 0.06, "accent"),
        (-0.05, 0.03, 0.06, "leaf"),
        (0.0, -0.055, 0.06, "rug"),
        (0.0, 0.03, 0.1, "accent"),
    ):
        made.lathe((x + dx, y + dy, z + up), ball, material)
    made.cylinder((x, y, z + 0.05), 0.12, 0.1)


@furniture("tall_cupboard")
def tall_cupboard(made: Joinery, *, width: float = 0.6) -> None:
    """Make a cupboard of the height of a person with an upper and a lower door, `width` [m] wide."""
    if not 0.4 <= width <= 1.2:
        raise ConfigError(f"a {made.kind} is 0.4 to 1.2 m wide, got {width!r}")
    half, joins = 0.5 * width, (PLINTH, 1.25, TALL)
    tall_carcass(made, half)
    spans = [(-half, half)] if width <= 0.6 + 1e-9 else [(-half, 0.0), (0.0, half)]
    for place, (z0, z1) in enumerate(zip(joins, joins[1:], strict=False), start=1):
        for leaf, (y0, y1) in enumerate(spans):
            name = f"door_{place}" + (f"_{leaf + 1}" if len(spans) > 1 else "")
            grip, at = min(max(1.05, z0 + 0.15), z1 - 0.15), ((CARCASS, y0, z0), (FACE, y1, z1))
            made.door(name, *at, "front", left=leaf > 0, handle_z=grip, framed=True)
    for k, z in enumerate((0.45, 0.8, 1.15, 1.5, 1.8)):
        made.box((0.01, -half + 0.016, z), (0.48, half - 0.016, z + 0.016), "trim")
        _linen(made, half, z + 0.016, k)
    stand_tall(made, half, SWEEP)


def stand_tall(made: Joinery, half: float, sweep: float) -> None:
    """Say what floor a tall unit needs, whose doors move over `sweep` before it [m]."""
    aisle = front_zone(DEPTH, half, made.rules.figure("kitchen_aisle"))
    made.outline(DEPTH, half, TALL, aisle, front_zone(DEPTH, half, sweep, "sweep"))


def tall_carcass(made: Joinery, half: float) -> None:
    """Add the boards of a tall unit `2 half` [m] wide: sides, top, bottom, back and plinth."""
    for y0, y1 in ((-half, -half + 0.016), (half - 0.016, half)):
        made.box((0.0, y0, 0.0), (CARCASS, y1, TALL), "front")
    made.box((0.0, -half, TALL - 0.016), (CARCASS, half, TALL), "front")
    made.box((0.0, -half, PLINTH), (CARCASS, half, PLINTH + 0.016), "trim")
    made.box((0.0, -half, PLINTH), (0.012, half, TALL), "trim")
    made.box((CARCASS - 0.076, -half, 0.0), (CARCASS - 0.06, half, PLINTH), "front")


def _linen(made: Joinery, half: float, z: float, row: int) -> None:
    colours = ("towel", "linen", "blanket", "paper")
    for k in range(2):
        y, top = -0.5 * half + k * half, z + 0.1 + 0.05 * (row % 2)
        made.show((0.1, y - 0.4 * half, z), (0.42, y + 0.4 * half, top), colours[(row + k) % 4])


@furniture("bin")
def waste_bin(made: Joinery) -> None:
    """Make a bin with a lid that swings up."""
    x, radius, high, wall = 0.17, 0.15, 0.55, 0.012
    inside = radius - 0.006
    can = ((radius, 0.0), (radius, high), (inside, high), (inside, 0.01), (0.0, 0.01))
    made.lathe((x, 0.0, 0.0), can, "metal")
    made.block((x - 0.13, -0.13, 0.0), (x + 0.13, 0.13, wall))
    for side in (-1, 1):
        y = side * (0.13 - 0.5 * wall)
        made.block((x - 0.13, y - 0.5 * wall, 0.0), (x + 0.13, y + 0.5 * wall, high))
        c = x + y
        made.block((c - 0.5 * wall, -0.13, 0.0), (c + 0.5 * wall, 0.13, high))
    # It stops short of upright, and friction holds its 0.4 kg wherever it is let go of.
    lid = made.joint(
        "lid", (x - radius, 0.0, high), "-y", 1.4, mass=0.4, damping=0.03, friction=0.75
    )
    dome = ((radius, 0.0), (radius - 0.005, 0.025), (radius - 0.06, 0.05), (0.02, 0.06))
    lid.lathe((x, 0.0, high), dome, "metal_dark")
    lid.block((x - 0.12, -0.12, high), (x + 0.12, 0.12, high + 0.04))
    made.frame("handle_lid", (x + radius - 0.01, 0.0, high + 0.01), "front rim of the lid")
    made.outline(0.33, 0.16, high + 0.06)
