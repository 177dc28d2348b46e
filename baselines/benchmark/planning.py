"""The command `bench planning`: how often a path is found in furnished rooms, beside going straight.

Somebody sits in a wheelchair in a room of each of several houses, and a robot stands by or on the chair. A
query goes from one posture of the arm to another, both drawn uniformly within the limits of its joints, and
half a turn each way, until they are clear by as much as a path has to be; full turns of a joint that may
turn farther do not count. Whether a way leads from one to the other is not known before: what is not solved
in time is looked for ten times as long, after all others of the room. If there is no way then either, the
query counts as one that may have none, and is told apart; where no time is left to look, it counts as not
solved.

What is planned is judged by Bullet and not by the planner's own geometry: every 20 ms of a path, how far the
robot and what it holds are from the person and from walls and furniture. To go straight is to move all
joints evenly from start to goal. Times are processor time of the one thread.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from rcare_marl.agents.planning import ACCELERATING
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.console import console, print_line, table
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.homes import CareHome
from rcare_marl.envs.registry import task_class
from rcare_marl.errors import ConfigError, PlanningError
from rcare_marl.planning.clearance import check_installed
from rcare_marl.planning.path import Path
from rcare_marl.planning.search import dense
from rcare_marl.pose import Array

from ..workers import one_count, run_each
from .environment import surroundings

TASK = "feeding"
ROBOTS = ("kinova_gen3", "pr2", "stretch_re1_dex", "fetch", "ur5")
HOUSES = tuple(f"house_{number:02d}" for number in range(1, 17))
ROOMS, QUERIES = 10, 10
FROM_PEOPLE, FROM_THINGS = 0.02, 0.01  # [m] that paths keep
WITHIN = 2.0  # [s] to plan
DRAWS = 2000  # of a posture that is clear, before a room counts as too narrow
SECOND_SEED = 1000  # of the search that asks whether there is a way
STEP = 0.02  # [s or rad] between what is judged
ROUNDING = 1.001  # by which figures may pass limits
WANTED = {"solved": 0.95, "hits": 0}


def bench(
    robot: str | None = None,
    queries: int = QUERIES,
    rooms: int = ROOMS,
    seed: int = 0,
    processes: str = "1",
    seconds: float | None = None,
) -> dict[str, Any]:
    """Return what became of the queries for each robot, as plain values for JSON.

    The postures depend on robot, house and seed alone. After Ctrl-C or SIGTERM the rooms that are done are
    returned.

    Args:
        robot: Models of robots, comma between; those of `ROBOTS` if None.
        queries: In each room.
        rooms: Houses, of each of which one room counts; with another seed they begin elsewhere.
        seed: Of the postures.
        processes: How many rooms at once.
        seconds: Time for all, of which each room gets a like share [s]; as long as it takes if None.

    Raises:
        ConfigError: If the count of processes is none.
        MissingPackageError: If the extra `plan` is not installed.
    """
    check_installed()
    side_by_side = one_count("planning", processes)
    models = robot.split(",") if robot else list(ROBOTS)
    begin = seed % len(HOUSES)
    left = {model: list(HOUSES[begin:] + HOUSES[:begin]) for model in models}
    found: dict[str, list[dict[str, Any]]] = {model: [] for model in models}
    rounds = -(-rooms * len(models) // side_by_side)
    share = None if seconds is None else seconds / rounds
    is_stopped = False
    try:
        while asked := [
            (model, left[model].pop(0))
            for k in range(rooms)
            for model in models
            if k < rooms - len(found[model]) and left[model]
        ]:
            calls = [partial(_in_room, *each, queries, seed, share) for each in asked]
            run_each(calls, side_by_side, partial(_take, found, asked))
    except (KeyboardInterrupt, SystemExit):  # the latter after SIGTERM
        is_stopped = True
    results = {model: _summary(each) for model, each in found.items() if each}
    every = [each for result in results.values() for each in (result["solved"], result["hits"])]
    return {
        "task": TASK,
        "queries_per_room": queries,
        "seed": seed,
        "within_s": WITHIN,
        "processes": side_by_side,
        "robots": results,
        "wanted": WANTED,
        "met": {
            "solved": min(every[::2], default=0.0) >= WANTED["solved"],
            "hits": sum(every[1::2]) == WANTED["hits"],
        },
        "complete": not is_stopped,
        "interrupted": is_stopped,
    } | surroundings()


def _take(
    found: dict[str, list[dict[str, Any]]],
    asked: Sequence[tuple[str, str]],
    number: int,
    result: dict[str, Any] | None | BaseException,
) -> None:
    """Keep what became of a room, and say so."""
    model, house = asked[number]
    if isinstance(result, BaseException):
        raise result
    if result is None:
        print_line(f"{model}: no place in {house}")
        return
    found[model].append(result)
    rows = result["rows"]
    print_line(
        f"{model} {result['room']}: {sum(row['solved'] for row in rows)} of "
        f"{sum(row['has_way'] for row in rows)} solved, "
        f"{sum(row.get('hits', 0) + row.get('hits_things', 0) for row in rows)} touched, "
        f"{sum(not row['has_way'] for row in rows)} without a known way"
    )


def _in_room(
    model: str, house: str, queries: int, seed: int, share: float | None
) -> dict[str, Any] | None:
    """Return what became of the queries in a house; None if the robot has no place there.

    Args:
        model: The robot.
        house: The house.
        queries: How many.
        seed: Of the postures.
        share: When to stop asking [s].
    """
    until = time.monotonic() + (np.inf if share is None else share)
    rng = np.random.default_rng([seed, sum(model.encode()), HOUSES.index(house)])
    env = _in_house(model, house)
    if env is None:
        return None
    try:
        env.reset(seed=seed)
        judge, rows, unsolved = _Judge(env), list[dict[str, Any]](), list[Any]()
        for k in range(queries):
            if time.monotonic() > until:
                break
            if (ends := judge.query(rng)) is None:
                break
            rows.append({"query": k, **judge.play(*ends, seed=k)})
            if not rows[-1]["solved"]:
                unsolved.append((rows[-1], ends))
        for row, ends in unsolved:
            if time.monotonic() < until:
                row["has_way"] = judge.has_way(*ends)
        return {"room": f"{house}/{env.task.place.facts()['room']}", "rows": rows}
    finally:
        env.close()


def _summary(found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the results of one robot over all rooms."""
    every = [row for result in found for row in result["rows"]]
    rows = [row for row in every if row["has_way"]]
    solved = [row for row in rows if row["solved"]]
    times = sorted(row["planning_s"] for row in rows)
    return {
        "rooms": sorted(result["room"] for result in found),
        "queries": len(rows),
        "without_known_way": len(every) - len(rows),
        "solved": len(solved) / max(len(rows), 1),
        "hits": sum(row["hits"] for row in solved),
        "hits_things": sum(row["hits_things"] for row in solved),
        "touched": [
            f"{result['room']} {row['query']}"
            for result in found
            for row in result["rows"]
            if row["solved"] and (row["hits"] or row["hits_things"])
        ],
        "limits_kept": sum(row["limits_kept"] for row in solved) / max(len(solved), 1),
        "nearest_person_mm": 1e3 * min((row["nearest"] for row in solved), default=0.0),
        "straight_hits": sum(row["straight_hits"] for row in rows) / max(len(rows), 1),
        "straight_hits_person": sum(row["straight_hits_person"] for row in rows)
        / max(len(rows), 1),
        "planning_median_s": statistics.median(times) if times else 0.0,
        "planning_p95_s": times[int(0.95 * (len(times) - 1))] if times else 0.0,
    }


def _in_house(model: str, house: str) -> CareEnv | None:
    kinds = task_class(TASK).room_kinds
    for room in (room.name for room in CareHome.load(house).rooms() if room.kind in kinds):
        for side in ("right", "left"):
            try:
                env = make(TASK, robot=model, home=house, room=room, options={"mount": side})
            except ConfigError:
                continue  # too narrow there
            if _stands_clear(env):
                return env
            env.close()
    return None


def _stands_clear(env: CareEnv) -> bool:
    """Return whether the robot, as an episode begins, is in no wall and no furniture (1 mm is let pass)."""
    env.reset(seed=0)
    robot, things = env.cast["robot"].body, [body for _, body in env.task.place.obstacles]
    return all(env.world.separation(robot, thing, within=0.0) >= 0 for thing in things)


class _Judge:
    """Draws queries in a room, and looks at what comes of them."""

    def __init__(self, env: CareEnv) -> None:
        robot = env.cast["robot"]
        assert isinstance(robot, Robot)  # the task has one
        self._env, self._robot, self._person = env, robot, env.cast["recipient"]
        self._held = env.world.held_by(robot.body)
        self._things = [body for _, body in env.task.place.obstacles]
        self._wishes: dict[str, Any] = {
            "avoid": {self._person: FROM_PEOPLE},
            "gap": FROM_THINGS,
            "within_s": WITHIN,
        }
        self._grips = [robot.tool_pose().inverse() @ body.base_pose() for body in self._held]

    def query(self, rng: np.random.Generator) -> tuple[Array, list[Array]] | None:
        """Return a posture that is clear and another with its full turns; None if there is hardly any."""
        from rcare_marl.agents.planning import Request, posed, same_but_for_turns

        problem = posed(self._robot, Request(self._wishes["avoid"], FROM_THINGS))
        found: list[Array] = []
        lower, upper = np.maximum(problem.lower, -np.pi), np.minimum(problem.upper, np.pi)
        for _ in range(DRAWS):
            posture = rng.uniform(lower, upper)
            if problem.holds(posture):
                found.append(posture)
                if len(found) == 2:
                    goals = same_but_for_turns(found[1], problem.lower, problem.upper)
                    goals.sort(key=lambda goal: float(np.abs(goal - found[0]).max()))
                    return found[0], goals
        return None

    def play(self, start: Array, goals: Sequence[Array], seed: int) -> dict[str, Any]:
        """Return what became of a query; the nearest goal comes first."""
        straight = dense(np.array((start, goals[0])), STEP)
        hits_person = any(self._gap_to(posture, [self._person.body]) < 0 for posture in straight)
        row: dict[str, Any] = {
            "straight_hits_person": hits_person,
            "straight_hits": hits_person
            or any(self._gap_to(posture, self._things) < 0 for posture in straight),
        }
        self._put(start)
        try:
            path = self._robot.plan(np.array(goals), seed=seed, **self._wishes)
        except PlanningError:
            return row | {"solved": False, "planning_s": WITHIN, "has_way": True}
        times = np.arange(0.0, path.duration + STEP, STEP)
        postures = [path.at(time) for time in times]
        people = [self._gap_to(each, [self._person.body], within=0.05) for each in postures]
        return row | {
            "solved": path.planning_s <= WITHIN,
            "planning_s": path.planning_s,
            "has_way": True,
            "hits": min(people) < 0,
            "hits_things": any(self._gap_to(each, self._things) < 0 for each in postures),
            "nearest": min(people),
            "limits_kept": self._keeps_limits(path),
        }

    def has_way(self, start: Array, goals: Sequence[Array]) -> bool:
        """Return whether a way is found in ten times the time."""
        self._put(start)
        try:
            self._robot.plan(
                np.array(goals), seed=SECOND_SEED, **{**self._wishes, "within_s": 10 * WITHIN}
            )
        except PlanningError:
            return False
        return True

    def _put(self, posture: Array) -> None:
        self._robot.set_posture(posture)
        for body, grip in zip(self._held, self._grips, strict=True):
            body.set_base(self._robot.tool_pose() @ grip)

    def _gap_to(self, posture: Array, others: Sequence[Any], *, within: float = 0.0) -> float:
        """Return how far robot and tool are from some bodies, `within` at most [m]."""
        self._put(posture)
        return min(
            (
                self._env.world.separation(body, other, within=within)
                for body in (self._robot.body, *self._held)
                for other in others
            ),
            default=within,
        )

    def _keeps_limits(self, path: Path) -> bool:
        arm, rows, dt = self._robot.arm, path.positions, np.diff(path.times)[:, None]
        speeds = np.diff(rows, axis=0) / dt
        changes = np.diff(speeds, axis=0) / dt[1:]
        return bool(
            ((rows >= arm.lower - 1e-6) & (rows <= arm.upper + 1e-6)).all()
            and (np.abs(speeds) <= ROUNDING * arm.velocity).all()
            and (np.abs(changes) <= ROUNDING * arm.velocity / ACCELERATING).all()
        )


def show(result: Mapping[str, Any]) -> None:
    """Print what `bench` returned as a table."""
    rows = [
        (
            model,
            f"{found['queries']} in {len(found['rooms'])}, {found['without_known_way']}",
            f"{100 * found['solved']:.1f} %",
            f"{found['hits']}, {found['hits_things']}",
            f"{100 * found['limits_kept']:.0f} %",
            f"{found['nearest_person_mm']:.0f} mm",
            f"{100 * found['straight_hits']:.0f}, {100 * found['straight_hits_person']:.0f} %",
            f"{found['planning_median_s']:.2f}, {found['planning_p95_s']:.2f} s",
        )
        for model, found in result["robots"].items()
    ]
    columns = (
        "robot",
        "queries in rooms, without a known way",
        f"solved in {result['within_s']:g} s",
        "hit person, things",
        "limits kept",
        "nearest",
        "straight hits anything, person",
        "planning: median, 95th of 100",
    )
    console().print(table("planning in furnished rooms", columns, rows))
