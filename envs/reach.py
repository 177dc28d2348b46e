"""From where, and in which posture, a robot reaches what a task asks of it, clear of people and things.

Every task searches here. What it names itself, such as a mount, comes first, in its order. If none of that
will do, robots that stand on the floor by themselves are also tried round it: of those places the one is
taken where the arm is most manipulable, by the measure of T. Yoshikawa, Manipulability of Robotic
Mechanisms, Int. J. of Robotics Research 4 (1985).
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.kinematics import IkResult
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import no_reach
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, about_z
from rcare_marl.world import World

# All our own choices.
APART = 0.005  # [m] between robot and people at the start
DISTANCE, ANGLE = 0.02, 0.1  # [m], [rad] that a tool may miss its place by
RINGS = (0.1, 0.2, 0.35)  # [m] round a place, where a robot is tried that stands by itself
WAYS, TURNS = 8, (0.0, 0.35, -0.35)  # places on each ring, and turns there [rad]

Cost = Callable[[IkResult, IkResult], float]


@dataclass(frozen=True)
class Trial:
    """What is tried.

    Attributes:
        way: Poses of the tool in the world, the start first.
        base: Pose of the robot's root; where it is if None.
        seed: Posture from which inverse kinematics begins; the present one if None.
        hold: What the task has to remember of it, such as how the tool is turned.
    """

    way: Sequence[Pose]
    base: Pose | None = None
    seed: Array | None = None
    hold: Any = None


@dataclass(frozen=True)
class Reach:
    """What was found; the robot stands at its base.

    Attributes:
        trial: What was tried.
        base: Pose of the robot's root.
        posture: Of the main arm at the start [rad or m], shape [n].
        manipulability: The least on the way, see `manipulability`.
        room: The least that a joint is from its limits on the way [rad or m], or as a share of its range if
            that is less than 1.
    """

    trial: Trial
    base: Pose
    posture: Array
    manipulability: float
    room: float


@dataclass(frozen=True, eq=False)
class ReachSearch:
    """How to search for the start of a robot, of whom the main arm moves.

    Attributes:
        world: Where all stand.
        robot: The robot.
        people: Whom it must be clear of at the start.
        floor: What a robot may touch that stands.
        clear_of: Other bodies and the distances that it keeps from them [m], at the start.
        all_the_way: Whether it keeps these distances at every pose of the way.
        needed: How many poses of the way, from the first on, must be reached; all if None.
        within: Whether a pose counts as reached.
        cost: What a pose of the way costs after the one before it; with it the cheapest trial is taken, and
            not the first that will do.
        crowding: What a pose costs as the robot stands there, 0 or more.
        rests: Whether the arm prefers the posture of its start on the way.
        roams: Whether other places are tried than those of the trials, if nothing there will do.
        room: How far joints are to be from their limits on the way, as `Reach.room`: of the trials those
            come first that leave so much, or else the most.
    """

    world: World
    robot: Robot
    people: Sequence[Human]
    floor: Body
    clear_of: Sequence[tuple[Body, float]] = ()
    all_the_way: bool = False
    needed: int | None = None
    within: Callable[[IkResult], bool] = lambda found: found.is_within(DISTANCE, ANGLE)
    cost: Cost | None = None
    crowding: Callable[[], float] | None = None
    rests: bool = False
    roams: bool = True
    room: float = 0.0

    def find(self, trials: Iterable[Trial], what: str) -> Reach:
        """Return the best start; the robot is put to its base and keeps its posture.

        Args:
            trials: What is tried, the best first.
            what: What is to be reached, for the error.

        Raises:
            ConfigError: If nothing of it will do.
        """
        robot, trials = self.robot, list(trials)
        home, stood = robot.arm.positions(), robot.body.base_pose()
        misses: list[IkResult] = []
        try:
            found = self._best(trials, misses, home, is_first=self.cost is None)
            if found is None:
                robot.set_posture(home)
                moved = self._moved(trials, stood)
                found = self._best(moved, misses, home, is_first=False)
        finally:
            robot.set_posture(home)
        if found is None:
            robot.place(stood)
            raise ConfigError(self._refusal(misses, what))
        robot.place(found.base)
        return found

    def find_most(self, trials: Sequence[Trial], ends: Sequence[int], what: str) -> Reach:
        """Return the best start for the most of their ways: as `find`, up to the last end that it can.

        Args:
            trials: What is tried, the best first.
            ends: How many poses of each way count, from the least that will do to all.
            what: What is to be reached, for the error.

        Raises:
            ConfigError: If nothing will do up to the first end.
        """
        for end in reversed(ends[1:]):
            with contextlib.suppress(ConfigError):
                return self.find([replace(trial, way=trial.way[:end]) for trial in trials], what)
        return self.find([replace(trial, way=trial.way[: ends[0]]) for trial in trials], what)

    def starting(self, trials: Iterable[Trial]) -> list[Trial]:
        """Return the trials whose first pose is reached and clear of people now.

        If there are none where the robot stands, it is put to a place near by where there are.
        """
        home, stood, trials = self.robot.arm.positions(), self.robot.body.base_pose(), list(trials)
        places = itertools.groupby(self._moved(trials, stood), lambda trial: trial.base)
        for tried in itertools.chain([trials], (group for _, group in places)):
            kept = [trial for trial in tried if self._starts(trial, home)]
            self.robot.set_posture(home)
            if kept:
                return kept
        self.robot.place(stood)
        return []

    def _starts(self, trial: Trial, home: Array) -> bool:
        start = replace(trial, way=trial.way[:1])
        return self._tried(start, [], home) is not None

    def _best(
        self, trials: Iterable[Trial], misses: list[IkResult], home: Array, *, is_first: bool
    ) -> Reach | None:
        best: tuple[tuple[float, float], Reach] | None = None
        for trial in trials:
            most = math.inf if best is None or self.room else best[0][1]
            if (found := self._tried(trial, misses, home, most)) is None:
                continue
            cost, reach = found
            short = max(self.room - reach.room, 0.0) if self.room else 0.0
            if best is None or (short, cost) < best[0]:
                best = (short, cost), reach
            if is_first and short == 0.0:
                break
        return None if best is None else best[1]

    def _tried(
        self, trial: Trial, misses: list[IkResult], home: Array, most: float = math.inf
    ) -> tuple[float, Reach] | None:
        """Return what a trial costs and finds; None if it fails, or costs `most` or more."""
        rest = self.robot.arm.rest
        try:
            return self._followed(trial, misses, home, most)
        finally:
            self.robot.arm.rest = rest

    def _followed(
        self, trial: Trial, misses: list[IkResult], home: Array, most: float
    ) -> tuple[float, Reach] | None:
        robot = self.robot
        if trial.base is not None:
            robot.place(trial.base)
        base = robot.body.base_pose()
        before: IkResult | None = None
        postures, cost = [], 0.0
        for k, pose in enumerate(trial.way):
            seed = before.posture if before is not None else trial.seed
            found = robot.solve_ik(pose, seed=home if seed is None else seed)
            if (self.needed is None or k < self.needed) and not self.within(found):
                misses.append(found)
                return None
            postures.append(found.posture)
            if self.rests:
                robot.arm.rest = postures[0]
            if before is not None and self.cost is not None:
                cost += self.cost(before, found)
                if cost < most and self.crowding is not None:
                    robot.set_posture(found.posture)
                    cost += self.crowding()
            if cost >= most:
                return None
            if self.all_the_way and not self._is_clear(found.posture):
                return None
            before = found
        least = min(manipulability(robot, posture) for posture in postures)
        if not self.all_the_way and not self._is_clear(postures[0]):
            return None
        arm = robot.arm
        bent = np.array(postures)
        room = np.minimum(bent - arm.lower, arm.upper - bent) / np.minimum(arm.upper - arm.lower, 1)
        reach = Reach(trial, base, postures[0], least, float(room.min()))
        return (-least if self.cost is None else cost), reach

    def _is_clear(self, posture: Array) -> bool:
        self.robot.set_posture(posture)
        kept = [*((person.body, APART) for person in self.people), *self.clear_of]
        return all(self._gap(body, gap) >= gap for body, gap in kept)

    def _gap(self, body: Body, within: float) -> float:
        return self.world.separation(self.robot.body, body, within=within)

    def _moved(self, trials: Sequence[Trial], stood: Pose) -> Iterator[Trial]:
        """Yield the trials from places round where the robot was to stand, clear of everything."""
        robot = self.robot
        if not self.roams or robot.config.base is None or robot.chosen_mount is not None:
            return
        ignored = (robot.body, self.floor, *(person.body for person in self.people))
        things = [body for body in self.world.bodies if body not in ignored]
        own = {id(trial.way): trial for trial in trials}.values()
        for base in places_round(trials[0].base or stood):
            robot.place(base)
            if all(self._gap(thing, APART) >= APART for thing in things):
                yield from (replace(trial, base=base) for trial in own)

    def _refusal(self, misses: Sequence[IkResult], what: str) -> str:
        robot = self.robot
        text = f"{no_reach(robot.config, robot.files.model.name, robot.moves)} {what}"
        if not misses:
            return f"{text} clear of the people there: in every posture it would touch somebody"
        miss = min(misses, key=lambda each: each.distance + each.angle)
        return (
            f"{text}: it misses it by {miss.distance:.2f} m, {math.degrees(miss.angle):.0f} degrees"
        )


def manipulability(robot: Robot, posture: Array) -> float:
    """Return Yoshikawa's measure of the main arm, the product of the singular values of its Jacobian.

    It is sqrt(det(J J')) where the arm has six joints or more; lengths count in metres, turns in radians.
    """
    return float(np.prod(np.linalg.svd(robot.arm.chain.jacobian(posture), compute_uv=False)))


def places_round(base: Pose) -> Iterator[Pose]:
    """Yield places on the floor round one, turned by less than a quarter."""
    x, y, z = base.position
    for radius, way, turn in itertools.product(RINGS, range(WAYS), TURNS):
        angle = 2 * math.pi * way / WAYS
        spin = Pose((0.0, 0.0, 0.0), about_z(turn))
        at = (x + radius * math.cos(angle), y + radius * math.sin(angle), z)
        yield Pose(at, (spin @ Pose((0.0, 0.0, 0.0), base.quaternion)).quaternion)


def describe_reach(world: World, robot: Robot, people: Sequence[Human]) -> Mapping[str, Any]:
    """Return from where a robot that stands in a scene reaches, as plain values."""
    pose = robot.body.base_pose()
    near = [world.separation(robot.body, person.body, within=1.0) for person in people]
    return {
        "base_m": [round(v, 3) for v in pose.position],
        "facing_deg": round(math.degrees(math.atan2(*pose.matrix()[1::-1, 0])), 1),
        "tool_m": [round(v, 3) for v in robot.tool_pose().position],
        "manipulability": float(f"{manipulability(robot, robot.arm.positions()):.3g}"),
        "from_people_m": round(min(near), 3) if near else None,
    }
