"""A matrix: one task over people, robots, partners and homes, each cell an environment of its own.

Example:
    >>> over = parse_over("people=six,robots=kinova_gen3+pr2")
    >>> matrix = run_matrix(MatrixPlan("feeding", over, episodes=5), processes=2)
    >>> matrix.to_dict()["total"]["success_rate_of_feasible"]
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rcare_marl import assets
from rcare_marl.agents.people.avatar import expand_movable
from rcare_marl.agents.people.sampling.population import (
    PREFIX,
    SIX,
    find_avatar,
    names_several,
    people_named,
)
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.config import load
from rcare_marl.envs.company import model_of
from rcare_marl.envs.homes import LEVELS, home_names
from rcare_marl.envs.randomise import Randomisation
from rcare_marl.envs.registry import (
    is_policy_file,
    lead_roles,
    policy_factory,
    policy_names,
    task_class,
)
from rcare_marl.errors import ConfigError, UnknownNameError, check_name
from rcare_marl.provenance import machine, versions

from ..partners import trembling
from ..workers import run_each
from .evaluate import Episode, Evaluation, evaluate, lead_policies, wilson_interval
from .protocol import columns

FORMAT = 1  # of a record
AXES = ("people", "robots", "partners", "homes")
ALL, REACHABLE, BARE = "all", "reachable", "bare"
RECIPIENT, CAREGIVER, ROBOT = "recipient", "caregiver", "robot"
TREMOR, MUSCLE = "tremor", "muscle"  # partners that differ in their body
USUAL = ("behaviour", "still", "passive", "resisting", "refusing")  # of `all`, where they are known
ROOM: Mapping[str, Callable[[list[float]], float]] = {
    "room_contacts": sum,
    "room_near_misses": sum,
    "room_clearance_m": min,
}  # how cells are joined

Progress = Callable[[int], None]


def parse_over(text: str) -> dict[str, tuple[str, ...]]:
    """Return the values of each axis of a text such as `people=six,robots=all,homes=2`.

    Raises:
        UnknownNameError: If there is no such axis.
        ConfigError: If it is no list of axes, or one stands there twice or without a value.
    """
    out: dict[str, tuple[str, ...]] = {}
    for part in text.split(","):
        axis, _, rest = part.partition("=")
        axis, values = axis.strip(), tuple(value.strip() for value in rest.split("+"))
        check_name("axis of a matrix", axis, AXES)
        if axis in out or not all(values):
            what = "stands there twice" if axis in out else "needs values, joined by +"
            raise ConfigError(
                f"{axis} {what}; write for example people=six,robots=pr2+ur5, got {text!r}"
            )
        out[axis] = values
    return out


def axis_values(task: str, axis: str, values: Sequence[str]) -> tuple[str, ...]:
    """Return the single values that those of an axis stand for, each once.

    Raises:
        UnknownNameError: If a name does not exist.
        ConfigError: If a value is impossible.
    """
    expand = {"people": _people, "robots": _robots, "partners": _partners, "homes": _homes}[axis]
    found = [name for value in values for name in expand(task, value)]
    return tuple(dict.fromkeys(found))


def _people(task: str, value: str) -> tuple[str, ...]:
    if RECIPIENT not in task_class(task).roles():
        raise ConfigError(f"task {task!r} has no {RECIPIENT!r}: leave out people and partners")
    if not Path(value).suffix and not value.startswith(PREFIX):
        check_name("avatar or population", value, [*assets.names("avatars"), SIX])
    if not names_several(value):
        find_avatar(value)  # so that a file that is missing is told before anything runs
    return people_named(value)


def _robots(task: str, value: str) -> tuple[str, ...]:
    known, reach = assets.names("robots"), task_class(task).reachable_by
    if value == REACHABLE:
        return tuple(sorted(known if reach is None else reach))
    if not Path(value).suffix:
        check_name("robot", value, [*known, ALL, REACHABLE])
    if value != ALL:
        load_robot(value)
    return tuple(known) if value == ALL else (value,)


def partner_names(task: str) -> tuple[str, ...]:
    """Return the partners that `all` stands for: how the recipient is played, and then the caregiver.

    The recipient's default policy comes first, then others that it knows (see `USUAL`), then the default
    one with a body that trembles and with one driven by muscles. Policies of a caregiver whom the task
    cannot do without are called `caregiver:NAME`.
    """
    roles = task_class(task).roles()
    if RECIPIENT not in roles:
        raise ConfigError(f"task {task!r} has no {RECIPIENT!r}: leave out people and partners")
    known = policy_names(task, RECIPIENT)
    usual = roles[RECIPIENT].partner
    own = [name for name in (usual, *USUAL) if name in known]
    helper = roles.get(CAREGIVER)
    beside = policy_names(task, CAREGIVER) if helper is not None and helper.default else ()
    others = [f"{CAREGIVER}:{n}" for n in beside if helper and n not in (helper.partner, "random")]
    return tuple(dict.fromkeys([*own, TREMOR, MUSCLE, *others]))


def _partners(task: str, value: str) -> tuple[str, ...]:
    known = partner_names(task)
    if value == ALL:
        return known
    role, _, name = value.rpartition(":")
    if not is_policy_file(name):
        helpers = policy_names(task, CAREGIVER) if CAREGIVER in task_class(task).roles() else ()
        more = [*policy_names(task, RECIPIENT), *(f"{CAREGIVER}:{each}" for each in helpers)]
        check_name(f"partner in task {task!r}", value, {ALL, *known, *more})
    elif role not in ("", CAREGIVER):
        raise ConfigError(
            f"a partner plays the {RECIPIENT} or, as in caregiver:FILE, helps: got {value!r}"
        )
    return (value,)


def _homes(task: str, value: str) -> tuple[str, ...]:
    known = home_names()
    if value.isdecimal():
        if not 1 <= int(value) <= len(known):
            raise ConfigError(f"homes are a number from 1 to {len(known)}, or names, got {value}")
        return tuple(known[: int(value)])
    name, colon, level = value.partition(":")
    check_name("house", name, [*known, ALL, BARE])
    if colon and (name == BARE or level not in map(str, LEVELS)):
        raise ConfigError(
            f"the level of a house is one of {LEVELS}, as in house_07:2, got {value!r}"
        )
    return tuple(f"{each}{colon}{level}" for each in known) if name == ALL else (value,)


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
        processes: How many at once; each takes whole cells.
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

    def one(_: Episode) -> None:
        nonlocal told
        told += 1
        tell(1)

    def finish(number: int, found: Outcome | BaseException) -> None:
        nonlocal told
        if not isinstance(found, Outcome):
            found = Outcome(cells[number], "crashed", f"{type(found).__name__}: {found}")
        done[number] = found
        tell(cells[number].plan.episodes - told)
        told = 0
        if on_cell is not None:
            on_cell(done, found)

    calls = [partial(cell.run, one) if processes == 1 else cell.run for cell in cells]
    run_each(calls, processes, finish)
    return tuple(done[i] for i in range(len(cells)))
