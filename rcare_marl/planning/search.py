"""The search for a way between postures: planners of OMPL (https://ompl.kavrakilab.org)."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rcare_marl.pose import Array

from .clearance import Clearance

Planner = Literal["rrt_connect", "bit_star"]
PLANNERS: tuple[Planner, ...] = ("rrt_connect", "bit_star")
STEP = 0.04  # [rad or m] along a way between two postures that a search tests; own choice
FINE = 0.01  # the same, of a way that is found
RANGE = 1.0  # [rad or m] that a tree grows at once; own choice
SIMPLIFYING = 0.25  # [s] at most, for the shortening of a way
PATIENCE = (
    0.5  # share of the time left that one try may take: to begin anew often helps; own choice
)
clock = time.thread_time  # of one core, however busy the machine is


@dataclass(frozen=True)
class Level:
    """That something on a link stays upright.

    Attributes:
        link: The link.
        up: What is up there, a unit vector in its frame, shape [3].
        tilt: By how much it may lean [rad].
    """

    link: str
    up: Array
    tilt: float

    def leaning(self, clear: Clearance, posture: Array) -> Array:
        """Return where its top leans, in the plane of the floor; the sine of the tilt long, shape [2]."""
        return np.asarray((clear.link_turn(self.link, posture) @ self.up)[:2])

    def holds(self, clear: Clearance, posture: Array) -> bool:
        """Return whether it is upright enough at a posture."""
        top = clear.link_turn(self.link, posture) @ self.up
        return bool(top[2] >= np.cos(self.tilt))


@dataclass(frozen=True)
class Problem:
    """What a way is looked for.

    Attributes:
        clear: Who is clear of what.
        start: Where it begins [rad or m], shape [n].
        goals: Where it may end, each of shape [n].
        lower: Lower limits [rad or m], shape [n]; finite.
        upper: Upper limits, shape [n]; finite.
        level: What stays upright.
        bears: Whether motors can hold a posture; they can any if None.
    """

    clear: Clearance
    start: Array
    goals: Sequence[Array]
    lower: Array
    upper: Array
    level: Level | None = None
    bears: Callable[[Array], bool] | None = None

    def holds(self, posture: Array) -> bool:
        """Return whether a posture is within limits, upright, not too heavy, and clear."""
        if (posture < self.lower - 1e-9).any() or (posture > self.upper + 1e-9).any():
            return False
        level, bears = self.level, self.bears
        if not (level is None or level.holds(self.clear, posture)):
            return False
        return self.clear.is_clear(posture) and (bears is None or bears(posture))

    def holds_along(self, way: Array, step: float = FINE) -> bool:
        """Return whether all of a way holds, shape [k, n], tested every `step` [rad or m]."""
        return all(self.holds(posture) for posture in _middle_first(dense(way, step)))


def dense(way: Array, step: float) -> Array:
    """Return a way with postures no more than `step` apart in any joint [rad or m], shape [m, n]."""
    rows = [way[:1]]
    for a, b in zip(way, way[1:], strict=False):
        count = max(int(np.ceil(np.abs(b - a).max() / step)), 1)
        rows.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(rows)


def _middle_first(way: Array) -> Iterator[Array]:
    """Yield all postures of a way, far apart first: what is wrong with it shows early."""
    stride = 1
    while stride < len(way):
        stride *= 2
    seen = np.zeros(len(way), np.bool_)
    while stride:
        for i in range(0, len(way), stride):
            if not seen[i]:
                seen[i] = True
                yield way[i]
        stride //= 2


def ways(problem: Problem, planner: Planner, until: float, seed: int) -> Iterator[Array]:
    """Yield ways from start to goal, shape [k, n], the straight one first if it holds.

    Each is to be tested more finely by who takes it, and the next one asked for if it does not hold.

    Args:
        problem: What is looked for.
        planner: Who looks.
        until: When to give up [s], by `clock`.
        seed: Of the planner's chance.
    """
    by_way = sorted(problem.goals, key=lambda goal: float(np.abs(goal - problem.start).max()))
    for goal in by_way:
        straight = np.array((problem.start, goal))
        if problem.holds_along(straight):
            yield straight
    share = PATIENCE if planner == "rrt_connect" else 1.0
    for k in itertools.count():
        left = until - clock()
        if left <= 0:
            return
        found = _search(problem, planner, until - left + max(share * left, 0.1), seed + k)
        if found is not None:
            yield from found


def _search(problem: Problem, planner: Planner, until: float, seed: int) -> list[Array] | None:
    """Return the shortened way and the plain one; None if there is none in time."""
    from ompl import base, geometric, util

    util.noOutputHandler()
    util.RNG.setSeed(1 + seed)
    count = len(problem.start)
    space = base.RealVectorStateSpace(count)
    bounds = base.RealVectorBounds(count)
    for i in range(count):
        bounds.setLow(i, float(problem.lower[i]))
        bounds.setHigh(i, float(problem.upper[i]))
    space.setBounds(bounds)
    extent = float(np.linalg.norm(problem.upper - problem.lower))
    space.setLongestValidSegmentFraction(STEP / extent)
    if problem.level is None:
        information = base.SpaceInformation(space)
        put, holds = _put, problem.holds
    else:
        space = base.ProjectedStateSpace(space, _constraint(problem, problem.level))
        information = base.ConstrainedSpaceInformation(space)
        put, holds = _put_constrained, problem.holds
        space.setDelta(STEP)
    setup = geometric.SimpleSetup(information)
    setup.setStateValidityChecker(lambda state: holds(_posture(state, count)))
    setup.setStartState(put(space, problem.start))
    goals = base.GoalStates(setup.getSpaceInformation())
    for goal in problem.goals:
        goals.addState(put(space, goal))
    setup.setGoal(goals)
    chosen = geometric.BITstar if planner == "bit_star" else geometric.RRTConnect
    made = chosen(setup.getSpaceInformation())
    if planner == "rrt_connect":
        made.setRange(RANGE)
    setup.setPlanner(made)
    setup.solve(base.PlannerTerminationCondition(lambda: clock() > until))
    if not setup.haveExactSolutionPath():
        return None
    plain = _rows(setup.getSolutionPath(), count)
    setup.simplifySolution(SIMPLIFYING)
    return [_rows(setup.getSolutionPath(), count), plain]


def _rows(path: Any, count: int) -> Array:
    return np.array([_posture(state, count) for state in path.getStates()])


def _posture(state: Any, count: int) -> Array:
    return np.array([state[i] for i in range(count)])


def _put(space: Any, posture: Array) -> Any:
    state = space.allocState()
    for i, value in enumerate(posture.tolist()):
        state[i] = value
    return state


def _put_constrained(space: Any, posture: Array) -> Any:
    state = space.allocState()
    state.copy(posture.tolist())
    return state


def _constraint(problem: Problem, level: Level) -> Any:
    """Return what OMPL projects postures with until the link is upright enough."""
    from ompl import base

    clear = problem.clear

    class Upright(base.Constraint):  # type: ignore[misc]
        def function(self, posture: Array, out: Array) -> None:
            out[:] = level.leaning(clear, np.asarray(posture))

        def jacobian(self, posture: Array, out: Array) -> None:
            posture = np.asarray(posture)
            top = clear.link_turn(level.link, posture) @ level.up
            rates = clear.turn_rates(level.link, posture)
            out[:, :] = np.cross(rates.T, top).T[:2]

    return Upright(len(problem.start), 2, 0.9 * float(np.sin(level.tilt)))
