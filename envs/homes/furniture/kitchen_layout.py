"""What stands where along a fitted kitchen."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from rcare_marl.errors import ConfigError

from ..rule import Rules

# Widths of units [m]; common, from memory.
APPLIANCE = 0.6
WIDEST = 0.8
NARROWEST = 0.3
CORNER = 0.6
SHORTEST_RUN, LONGEST_RUN = 1.8, 4.8
_STEP = 0.1

UnitKind = Literal[
    "drawers",
    "doors",
    "sink",
    "knee_sink",
    "dishwasher",
    "hob",
    "oven_hob",
    "knee_hob",
    "corner",
    "filler",
    "oven",
]


@dataclass(frozen=True)
class Unit:
    """One unit of a run.

    Attributes:
        kind: What it is.
        y0: Its lower end along the wall [m].
        y1: Its upper end [m].
    """

    kind: UnitKind
    y0: float
    y1: float

    @property
    def middle(self) -> float:
        """Its middle along the wall [m]."""
        return 0.5 * (self.y0 + self.y1)

    @property
    def is_open(self) -> bool:
        """Whether there is room for knees under it."""
        return self.kind.startswith("knee")


@dataclass(frozen=True)
class RunPlan:
    """What a run should have.

    Attributes:
        length: Along the wall [m].
        sink: Whether it has a sink.
        hob: Whether it has a hob.
        dishwasher: Whether it has a dishwasher, where there is room for one.
        oven: Whether there is an oven under the hob, where no knees go there.
        corner: The end where another run meets it, `left` at most y or `right` at least; empty for none.
        window: Where a window is, from and to, from the end at least y [m]; None for no window.
    """

    length: float
    sink: bool = True
    hob: bool = True
    dishwasher: bool = True
    oven: bool = True
    corner: str = ""
    window: tuple[float, float] | None = None


def joined(units: Iterable[Unit]) -> list[tuple[float, float]]:
    """Return the stretches along the wall [m] that units take, from the least y to the most."""
    out: list[tuple[float, float]] = []
    for unit in units:
        if out and abs(out[-1][1] - unit.y0) < 1e-9:
            out[-1] = (out[-1][0], unit.y1)
        else:
            out.append((unit.y0, unit.y1))
    return out


def lay_units(plan: RunPlan, rules: Rules) -> tuple[Unit, ...]:
    """Return the units of a run, from least y to most, without gaps; y is 0 in its middle.

    The sink goes under the window if there is one, the dishwasher beside it, and worktop between sink
    and hob where there is room.

    Raises:
        ConfigError: If sink and hob do not fit.
    """
    corner = CORNER if plan.corner else 0.0
    groups = _groups(plan, rules, plan.length - corner)
    used = sum(width for group in groups for _, width in group)
    rest = plan.length - corner - used
    start = -0.5 * plan.length + (corner if plan.corner == "right" else 0.0)
    best: tuple[Unit, ...] = ()
    least = math.inf
    for order in _orders(groups):
        for gaps in _gaps(rest, len(order) + 1):
            units = _row(order, gaps, start)
            cost = _cost(units, plan)
            if cost < least - 1e-9:
                best, least = units, cost
    if plan.corner == "right":
        best = (Unit("corner", -0.5 * plan.length, start), *best)
    elif plan.corner:
        best = (*best, Unit("corner", best[-1].y1, 0.5 * plan.length))
    return best


Group = tuple[tuple[UnitKind, float], ...]


def _groups(plan: RunPlan, rules: Rules, room: float) -> list[Group]:
    """Return what stands together: the sink with the dishwasher, and the hob."""
    knee = rules.figure("counter_knee_width", 0.0)
    sink: Group = ((("knee_sink", knee) if knee else ("sink", APPLIANCE)),) if plan.sink else ()
    low: UnitKind = "oven_hob" if plan.oven else "hob"
    hobs: list[Group] = [((low, APPLIANCE),)] if plan.hob else [()]
    if plan.hob and rules.level == 3:
        hobs.insert(0, (("knee_hob", knee),))
    if plan.oven and not plan.hob:
        hobs = [(("oven", APPLIANCE),)]
    washers: list[Group] = [(("dishwasher", APPLIANCE),), ()] if plan.dishwasher else [()]
    for hob, washer in itertools.product(hobs, washers):
        groups = [group for group in ((*sink, *washer), hob) if group]
        if sum(width for group in groups for _, width in group) <= room + 1e-9:
            return groups
    raise ConfigError(f"a sink and a hob do not fit into {room:.2f} m of kitchen")


def _orders(groups: list[Group]) -> Iterator[tuple[Group, ...]]:
    for order in itertools.permutations(groups):
        for turned in itertools.product(*[dict.fromkeys((group, group[::-1])) for group in order]):
            yield tuple(turned)


def _gaps(rest: float, count: int) -> Iterator[tuple[float, ...]]:
    """Return the ways to share out `rest` [m] to `count` gaps, each none or wide enough for a unit."""
    if rest < NARROWEST:
        for place in range(count):
            yield tuple(rest if k == place else 0.0 for k in range(count))
        return
    steps = [0.0, *(k * _STEP for k in range(3, int(rest / _STEP + 1e-6) + 1))]
    for first in itertools.product(steps, repeat=count - 1):
        last = rest - sum(first)
        if abs(last) < 1e-9 or last >= NARROWEST - 1e-9:
            yield (*first, max(last, 0.0))


def _row(order: tuple[Group, ...], gaps: tuple[float, ...], start: float) -> tuple[Unit, ...]:
    units: list[Unit] = []
    y, count = start, 0
    pieces: list[tuple[UnitKind, float]] = []
    for place, gap in enumerate(gaps):
        share = math.ceil((gap - 1e-9) / WIDEST)
        for _ in range(share):
            width = gap / share
            kind: UnitKind = "drawers" if count % 2 == 0 else "doors"
            pieces.append((kind if width >= NARROWEST - 1e-9 else "filler", width))
            count += 1
        if place < len(order):
            pieces.extend(order[place])
    for piece, width in pieces:
        units.append(Unit(piece, y, y + width))
        y += width
    return tuple(units)


def _cost(units: tuple[Unit, ...], plan: RunPlan) -> float:
    """Return how unhandy a row is; own choice."""
    sink = next((unit for unit in units if unit.kind.endswith("sink")), None)
    hob = next((unit for unit in units if unit.kind.endswith("hob")), None)
    cost = 0.0
    if plan.window is not None:
        low, high = (end - 0.5 * plan.length for end in plan.window)
        if sink is not None:
            cost += 3.0 * abs(sink.middle - 0.5 * (low + high))
        if hob is not None and hob.y0 < high and hob.y1 > low:
            cost += 5.0
    if sink is not None and hob is not None:
        between = max(hob.y0 - sink.y1, sink.y0 - hob.y1)
        cost += abs(between - 0.8) + (3.0 if between < NARROWEST else 0.0)
    if hob is not None:
        cost += sum(1.0 for end in (units[0], units[-1]) if end is hob)
    if sink is not None:
        cost += sum(0.5 for end in (units[0], units[-1]) if end is sink)
    # Sink and hob apart from the ends alike.
    ends = [unit.middle for unit in (sink, hob) if unit is not None]
    middle = 0.5 * (units[0].y0 + units[-1].y1)
    if ends:
        cost += 0.2 * abs(sum(ends) / len(ends) - middle)
    cost += 0.1 * sum(1 for unit in units if unit.kind == "filler")
    return cost
