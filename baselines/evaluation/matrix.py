"""A matrix: one task over people, robots, partners and homes, each cell an environment of its own.

Example:
    >>> over = parse_over("people=six,robots=kinova_gen3+pr2")
    >>> matrix = run_matrix(MatrixPlan("feeding", over, episodes=5), processes=2)
    >>> matrix.to_dict()["total"]["success_rate_of_feasible"]
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from rcare_marl.agents.people.avatar import expand_movable
from rcare_marl.agents.people.sampling.population import (
    names_several,
)
from rcare_marl.config import load
from rcare_marl.envs.company import model_of
from rcare_marl.envs.randomise import Randomisation
from rcare_marl.envs.registry import (
    lead_roles,
    policy_factory,
    task_class,
)
from rcare_marl.errors import ConfigError, UnknownNameError, check_name
from rcare_marl.provenance import machine, versions

from ..partners import trembling
from ..workers import run_each
from .axes import AXES, BARE, MUSCLE, RECIPIENT, TREMOR, axis_values
from .evaluate import Episode, Evaluation, evaluate, joined, lead_policies, wilson_interval
from .protocol import columns

FORMAT = 1  # of a record
ROBOT = "robot"
ROOM: Mapping[str, Callable[[list[float]], float]] = {
    "room_contacts": sum,
    "room_near_misses": sum,
    "room_clearance_m": min,
}  # how cells are joined

CHUNK = 5  # episodes of a cell with others in each that one process takes; our own choice

Progress = Callable[[int], None]


@dataclass(frozen=True)
class MatrixPlan:
    """What is to be evaluated.

    Attributes:
        task: Name of the task.
        over: The values of each axis, as `parse_over` returns them; an axis that is left out is as in `cast`.
        policy: Of the robot.
        others: Policy of single other roles.
        episodes: How many of each cell.
        seed: Of the first episode of the first person, and of everybody if not `own_seeds`.
        own_seeds: Whether each person of the axis has seeds of their own, so that one hard start does not
            hit all of them: episode i of the k-th has `seed + k * episodes + i`, in every cell with them.
        options: Settings of the task.
        cast: Who plays beside, by role, and where.
        randomise: What is another in each episode, see `rcare_marl.make`; kept as a mapping.

    Raises:
        UnknownNameError: If a name does not exist.
        ConfigError: If a value is impossible, or stands in `cast` and on an axis.
    """

    task: str
    over: Mapping[str, tuple[str, ...]]
    policy: str = "scripted"
    others: Mapping[str, str] = field(default_factory=dict)
    episodes: int = 5
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)
    cast: Mapping[str, Any] = field(default_factory=dict)
    randomise: Any = None
    own_seeds: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "randomise", Randomisation.of(self.randomise).to_dict())
        cls = task_class(self.task)
        load(cls.Options, dict(self.options), f"options of {self.task!r}")
        policy_factory(self.task, lead_roles(self.task)[0], self.policy)
        for axis in self.over:
            check_name("axis of a matrix", axis, AXES)
        taken = {
            "people": model_of(self.cast.get(RECIPIENT)),
            "robots": model_of(self.cast.get(ROBOT)),
            "partners": self.others.get(RECIPIENT),
            "homes": self.cast.get("home"),
        }
        for axis in self.over:
            if taken[axis] is not None:
                raise ConfigError(f"{axis} are an axis, and one is given besides: {taken[axis]}")
        played = {role for role, part in cls.roles().items() if part.default is not None}
        played |= set(self.cast) | ({RECIPIENT} if "people" in self.over else set())
        for partner in self.over.get("partners", ()):
            role = partner.rpartition(":")[0] or RECIPIENT
            if role not in played:
                raise ConfigError(f"nobody plays the {role} of {self.task!r}, as {partner!r} needs")
        if self.episodes < 1 or self.seed < 0:
            raise ConfigError(
                f"episodes are at least 1 and a seed at least 0, got {self.episodes} and {self.seed}"
            )
        self.cells()

    def cells(self) -> tuple[Cell, ...]:
        """Return the cells in order, the last axis the fastest."""
        axes = [axis_values(self.task, a, self.over[a]) if a in self.over else ("",) for a in AXES]
        people, *others = axes
        step = self.episodes if self.own_seeds else 0
        return tuple(
            Cell(self, person, robot, partner, home, seed)
            for person, seed in zip(people, itertools.count(self.seed, step), strict=False)
            for robot, partner, home in itertools.product(*others)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        fields = {name: v for name, v in vars(self).items() if v or name != "randomise"}
        return {**fields, "over": {axis: list(names) for axis, names in self.over.items()}}


@dataclass(frozen=True)
class Cell:
    """One person, robot, partner and home; empty where that is as the plan's cast has it.

    Episode i of it has the seed `seed + i`.
    """

    plan: MatrixPlan
    person: str
    robot: str
    partner: str
    home: str
    seed: int

    @property
    def name(self) -> str:
        """What tells it from the others."""
        return ", ".join(filter(None, (self.person, self.robot, self.partner, self.home)))

    def values(self) -> dict[str, str]:
        """Return its value on each axis of the plan."""
        found = (self.person, self.robot, self.partner, self.home)
        return {axis: v for axis, v in zip(AXES, found, strict=True) if axis in self.plan.over}

    def evaluation(self, on_episode: Callable[[Episode], None] | None = None) -> Evaluation:
        """Return what came of its episodes; errors as of `evaluate`."""
        plan = self.plan
        policies: dict[str, Any] = {**lead_policies(plan.task, plan.policy, plan.others)}
        cast: dict[str, Any] = dict(plan.cast)
        if self.robot:
            cast[ROBOT] = _entry(cast.get(ROBOT), {"model": self.robot})
        changes: dict[str, Any] = {"model": self.person} if self.person else {}
        if self.partner == TREMOR:
            part = task_class(plan.task).roles()[RECIPIENT]
            name = self.person or model_of(cast.get(RECIPIENT)) or part.default
            changes["model"] = str(trembling(str(name), expand_movable(part.movable)))
        elif self.partner == MUSCLE:
            changes["actuation"] = "muscle"
        elif self.partner:
            role, _, policy = self.partner.rpartition(":")
            policies[role or RECIPIENT] = policy
        if changes:
            cast[RECIPIENT] = _entry(cast.get(RECIPIENT), changes)
        if self.home and self.home != BARE:
            cast["home"], _, level = self.home.partition(":")
            cast |= {"level": int(level)} if level else {}
        return evaluate(
            plan.task,
            policies,
            episodes=plan.episodes,
            seed=self.seed,
            options=plan.options,
            cast=cast,
            randomise=plan.randomise,
            on_episode=on_episode,
        )

    def parts(self) -> list[Cell]:
        """Return cells of a few of its episodes each; itself, unless another one plays in each of them."""
        starts = range(0, self.plan.episodes, CHUNK)
        if len(starts) == 1 or not any(names_several(model_of(e)) for e in self.plan.cast.values()):
            return [self]
        counts = [min(CHUNK, self.plan.episodes - start) for start in starts]
        plans = [replace(self.plan, episodes=count) for count in counts]
        return [
            replace(self, plan=plan, seed=self.seed + start)
            for plan, start in zip(plans, starts, strict=True)
        ]

    def run(self, on_episode: Callable[[Episode], None] | None = None) -> Outcome:
        """Return what came of it; who cannot be cast is refused."""
        try:
            return Outcome(self, "done", "", self.evaluation(on_episode))
        except (ConfigError, UnknownNameError) as error:
            return Outcome(self, "refused", str(error))


def _entry(base: Any, changes: Mapping[str, Any]) -> dict[str, Any]:
    fields = base if isinstance(base, Mapping) else {} if base is None else {"model": base}
    return {**fields, **changes}


@dataclass(frozen=True)
class Outcome:
    """What came of a cell.

    Attributes:
        cell: Which.
        state: `done`, `refused` as it cannot be cast, or `crashed`.
        reason: Why it was refused or crashed.
        result: The evaluation of one that is done.
    """

    cell: Cell
    state: Literal["done", "refused", "crashed"]
    reason: str = ""
    result: Evaluation | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        out = {**self.cell.values(), "state": self.state, "reason": self.reason, **figures([self])}
        if self.result is not None:
            out["infeasible_reason"] = self.result.infeasible
            out["place"] = dict(self.result.place)
            out["episodes_by_column"] = columns(self.result.episodes)
        return out


def figures(outcomes: Iterable[Outcome]) -> dict[str, Any]:
    """Return the numbers over some cells, for JSON.

    Success is that of feasible episodes; forces [N] are those of all episodes, of each the greatest. Where
    they are in homes, touches and near misses of the room are summed, and the least clearance [m] is told.
    """
    results = [each.result for each in outcomes if each.result is not None]
    room = {name: [v for r in results for v in r.values(name)] for name in ROOM}
    feasible = [episode for result in results for episode in result.feasible]
    forces = [force for result in results for force in result.values("peak_force_n")]
    done = sum(episode.success for episode in feasible)
    return {
        "episodes": sum(len(result.episodes) for result in results),
        "feasible_episodes": len(feasible),
        "successes": done,
        "success_rate_of_feasible": done / len(feasible) if feasible else None,
        "success_interval_95": list(wilson_interval(done, len(feasible))) if feasible else None,
        "peak_force_n_mean": float(np.mean(forces)) if forces else None,
        "peak_force_n_greatest": max(forces) if forces else None,
        **{name: total(room[name]) if room[name] else None for name, total in ROOM.items()},
    }


@dataclass(frozen=True)
class Matrix:
    """What came of a plan.

    Attributes:
        plan: What was to be evaluated.
        outcomes: The cells that are finished, in the order of the plan.
    """

    plan: MatrixPlan
    outcomes: tuple[Outcome, ...]

    @property
    def is_complete(self) -> bool:
        """Whether every cell of the plan is finished."""
        return len(self.outcomes) == len(self.plan.cells())

    def sums(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Return the numbers over all cells of each value of each axis."""
        out: dict[str, dict[str, dict[str, Any]]] = {}
        for axis, values in self.plan.over.items():
            out[axis] = {
                value: _sum([o for o in self.outcomes if o.cell.values()[axis] == value])
                for value in axis_values(self.plan.task, axis, values)
            }
        return out

    def total(self) -> dict[str, Any]:
        """Return the numbers over all cells."""
        return _sum(self.outcomes)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, with every episode in columns."""
        results = [each.result for each in self.outcomes if each.result is not None]
        known = {n: v for result in results for n, v in result.versions.items()}
        return {
            "format": FORMAT,
            "kind": "matrix",
            "plan": self.plan.to_dict(),
            "complete": self.is_complete,
            "total": self.total(),
            "sums": self.sums(),
            "cells": [each.to_dict() for each in self.outcomes],
            "people": {who: found for result in results for who, found in result.people.items()},
            "versions": known or versions(),
            "machine": machine(),
        }


def _sum(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    states = [each.state for each in outcomes]
    infeasible = sum(each.result is not None and bool(each.result.infeasible) for each in outcomes)
    counts = {state: states.count(state) for state in ("done", "refused", "crashed")}
    return {"cells": len(outcomes), **counts, "infeasible": infeasible, **figures(outcomes)}


def run_matrix(
    plan: MatrixPlan,
    *,
    processes: int = 1,
    on_progress: Progress | None = None,
    on_cell: Callable[[Matrix, Outcome], None] | None = None,
) -> Matrix:
    """Run all cells of a plan, the same however many processes there are.

    A cell that crashes, or whose process is killed, is told as such, and the others go on.

    Args:
        plan: What to run.
        processes: How many at once.
        on_progress: Called with the number of episodes that were done since.
        on_cell: Called after each cell, with all that is finished by then.

    Raises:
        ConfigError: If `processes` is below 1.
    """
    cells = plan.cells()

    def tell(done: Mapping[int, Outcome], last: Outcome) -> None:
        if on_cell is not None:
            on_cell(Matrix(plan, tuple(done[i] for i in sorted(done))), last)

    return Matrix(plan, run_cells(cells, processes, on_progress, tell))


def run_cells(
    cells: Sequence[Cell],
    processes: int,
    on_progress: Progress | None = None,
    on_cell: Callable[[Mapping[int, Outcome], Outcome], None] | None = None,
) -> tuple[Outcome, ...]:
    """Return what came of cells, of one plan or of several; see `run_matrix`.

    Args:
        cells: What to run.
        processes: How many at once.
        on_progress: Called with the number of episodes that were done since.
        on_cell: Called after each cell, with those that are finished by their numbers, and with it.

    Raises:
        ConfigError: If `processes` is below 1.
    """
    done: dict[int, Outcome] = {}
    told = 0
    tell = on_progress or (lambda _: None)
    parts = [
        (i, part) for i, c in enumerate(cells) for part in (c.parts() if processes > 1 else [c])
    ]
    ended: list[dict[int, Outcome]] = [{} for _ in cells]  # of each cell its parts
    left = Counter(i for i, _ in parts)

    def one(_: Episode) -> None:
        nonlocal told
        told += 1
        tell(1)

    def finish(number: int, found: Outcome | BaseException) -> None:
        nonlocal told
        i, part = parts[number]
        if not isinstance(found, Outcome):
            found = Outcome(part, "crashed", f"{type(found).__name__}: {found}")
        tell(part.plan.episodes - told)
        told = 0
        ended[i][number] = found
        left[i] -= 1
        if left[i]:
            return
        done[i] = _whole(cells[i], [ended[i][k] for k in sorted(ended[i])])
        if on_cell is not None:
            on_cell(done, done[i])

    calls = [partial(part.run, one) if processes == 1 else part.run for _, part in parts]
    run_each(calls, processes, finish)
    return tuple(done[i] for i in range(len(cells)))


def _whole(cell: Cell, parts: Sequence[Outcome]) -> Outcome:
    """Return what came of a cell from what came of its parts: the first that is not done, or all."""
    results = [part.result for part in parts if part.result is not None]
    if len(results) < len(parts):
        return replace(next(part for part in parts if part.result is None), cell=cell)
    return Outcome(cell, "done", "", joined(results))
