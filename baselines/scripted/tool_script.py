"""What hand-written robots that move their tool have in common.

They show that their tasks can be done. They see what a robot with perfect perception would see, and need the
control mode `tool_delta`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Generic, TypeVar

import numpy as np

from rcare_marl.agents.agent import Agent
from rcare_marl.agents.robots.control import GripperClosing, moving_tool
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.body import Body
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.task import Task
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, Vector, turn_to

T = TypeVar("T", bound=Task)


class ToolScript(Generic[T]):
    """A script of a robot's tool, for one kind of task.

    Attributes:
        KIND: That task.
        WITH_GRIPPER: Whether actions must move the arm and its gripper, and nothing else.
    """

    KIND: ClassVar[type[Task]]
    WITH_GRIPPER: ClassVar[bool] = False
    _task: T

    def __init__(self, env: CareEnv, role: str) -> None:
        """Take the environment and the robot's role.

        Raises:
            ConfigError: If it is another task or robot, or actions move other things than the tool.
        """
        task, robot, name = env.task, env.cast[role], self.KIND.__name__
        if not isinstance(task, self.KIND):
            raise ConfigError(f"the script of {name} cannot play {type(task).__name__}")
        if role not in ("robot", "robot_0"):
            raise ConfigError(f"the script of {name} plays the first robot, and not {role!r}")
        assert isinstance(robot, Robot)
        moving_tool(robot.control)
        others = [type(part.control) for part in robot.parts.values()][1:]
        if self.WITH_GRIPPER and others != [GripperClosing]:
            raise ConfigError(
                f"the script of {name} needs the control mode 'tool_delta' and moves arm and gripper only, "
                f"got {', '.join(robot.parts)}"
            )
        self._task, self._robot = task, robot  # type: ignore[assignment]  # KIND is T
        self._begin()

    def reset(self, rng: np.random.Generator) -> None:
        self._begin()

    def memory(self) -> tuple[Sequence[object], Array]:
        """Return what the script goes by beside what it sees now: what holds, and values of -1 to 1, [k].

        It is what a network that imitates the script has to keep in mind; see `baselines.algorithms.dagger`.
        """
        return (), np.zeros(0)

    def recall(self, holds: Sequence[bool]) -> None:
        """Go on from what a network that imitates it wrote down, where that comes right again by itself.

        Else what it shows would follow from what the network cannot know.

        Args:
            holds: What holds, as `memory` tells it.
        """

    def _begin(self) -> None:
        """Set what the script remembers to how an episode begins."""

    def _about(self, point: Array, linear: Array, spin: Array) -> Array:
        """Return the action that moves a point of the tool, and turns the tool about it.

        Args:
            point: Where it is [m], shape [3].
            linear: Its velocity [m/s], shape [3].
            spin: How the tool turns [rad/s], shape [3].
        """
        to_tool = np.subtract(self._robot.tool_pose().position, point)
        return self._robot.tool_action(linear + np.cross(spin, to_tool), spin)


def unit(way: Array) -> Array:
    """Return the direction of a way, a unit vector, shape [3]."""
    return np.asarray(way / max(float(np.linalg.norm(way)), 1e-9))


def limited(velocity: Array, most: float) -> Array:
    """Return a velocity that is no faster than `most` [m/s], shape [3]."""
    return velocity * min(1.0, most / max(float(np.linalg.norm(velocity)), 1e-9))


def turning(wanted: Vector, now: Vector, gain: float = 2.0) -> Array:
    """Return the turn from one orientation to a wanted one, quaternions, times a gain [rad/s], [3]."""
    return gain * turn_to(wanted, now)


class Beat:
    """To and fro by time: three flags, of which one changes in each control step, six to and fro.

    Whoever turns round where a stroke ends must see millimetres; by the beat a network that imitates it, and
    sees little, strokes all the same.

    Attributes:
        flags: Where it is; the first says whether it goes forth.
    """

    def __init__(self) -> None:
        self.flags = (True, True, True)

    def next(self) -> float:
        """Go on by a control step, and return 1 if it goes forth then, else -1."""
        first, second, third = self.flags
        if first == third != second:  # nowhere in the cycle
            first = second
        self.flags = (not third, first, second)
        return 1.0 if self.flags[0] else -1.0


class Detour:
    """A planned way of a point of the tool, to be followed with `tool_delta` or a compliant mode.

    The tool is led a little ahead along the way. A redundant arm may then hold its elbow otherwise than it
    was planned; what it holds goes where it was.
    """

    AHEAD = 0.03  # [m] that the tool is led; our own choice
    TRIES, STRIDE = 6, 10  # paths that are tried, and every which place of them; our own choice

    def __init__(
        self,
        robot: Robot,
        ends: Sequence[Pose],
        point: Array,
        avoid: Mapping[Agent | Body, float],
        tilt: float,
        seed: int = 0,
    ) -> None:
        """Plan it, before it is first needed.

        Args:
            robot: The robot.
            ends: Where the tool may come to.
            point: A point of the tool, in the world [m], shape [3].
            avoid: Distances to keep [m].
            tilt: By how much what it holds may lean [rad].
            seed: Of the planner's chance.

        Raises:
            PlanningError: If there is no way.
            MissingPackageError: If the extra `plan` is not installed.
        """
        self.planning_s = 0.0
        for k in range(self.TRIES):
            path = robot.plan(ends, avoid=avoid, tilt=tilt, within_s=5.0, seed=seed + k)
            self.planning_s += path.planning_s
            tools = [robot.arm.chain.tip_pose(row) for row in path.positions]
            if self._is_followed(robot, tools):
                break
        on_tool = robot.tool_pose().inverse() @ Pose(tuple(point.tolist()))
        self._way = [(np.array((tool @ on_tool).position), tool.quaternion) for tool in tools]
        self._path, self._next = path, 0

    def is_clear(self) -> bool:
        """Return whether what is left of it is clear of everything as it stands now."""
        return self._path.is_clear(after=self._path.times[min(self._next, len(self._way) - 1)])

    def _is_followed(self, robot: Robot, tools: Sequence[Pose]) -> bool:
        """Return whether the arm, led by its tool alone, comes along all the way."""
        arm, posture = robot.arm, robot.arm.positions()
        for tool in tools[:: self.STRIDE]:
            found = arm.chain.solve(tool, posture, arm.lower, arm.upper, rest=arm.rest)
            if not found.is_within(self.AHEAD, 0.2):
                return False
            posture = found.posture
        return True

    def next(self, point: Array) -> tuple[Array, tuple[float, ...]] | None:
        """Return where a point of the tool goes next [m], shape [3], and how the tool is turned there.

        None from the end on.
        """
        while self._next < len(self._way):
            place, turn = self._way[self._next]
            if math.dist(place, point) > self.AHEAD:
                return place, turn
            self._next += 1
        return None

    @property
    def left(self) -> int:
        """How many places of it are left."""
        return len(self._way) - self._next
