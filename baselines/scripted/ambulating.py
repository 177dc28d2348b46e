"""A scripted robot that works doors: turns a knob, presses a lever, pushes a panel by its bar."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.control import ToolDelta
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.tasks.ambulating import AHEAD, Ambulating
from rcare_marl.errors import ConfigError
from rcare_marl.pose import conjugate, multiply, rotation_vector

Array = npt.NDArray[np.float64]

# All our own choices.
OFF = 0.06  # [m] beside the handle, where the hand comes in
OUT = 0.10  # [m] before it, where it lines up
LEAD = 0.05  # [m] that the hand is ahead of what it pushes
DEEP = 0.005  # [m] that the tool goes past the middle of a knob
SHY = 0.024  # [m] that the tool stays out from a bar at first, while the wall is beside it
DEEPER = 0.10  # [m] that a panel is open where there is room for the whole finger beside its bar
PAST = 0.02  # [m] beyond the handle: the hand slipped off it
NEAR = 0.012  # [m] from a place that counts as there
CLOSING = 1.5  # [s] that the gripper closes before it turns
GAIN, TURN_GAIN = 3.0, 2.0  # [1/s]
FAST, SLOW = 0.20, 0.10  # [m/s] on the way, and in contact
TURNING = 0.5  # [rad/s] of a knob


class ScriptedAmbulating:
    """Goes beside the handle and pushes it, or round a knob and turns it."""

    def __init__(self, env: CareEnv, role: str) -> None:
        """Take the environment and the robot's role.

        Raises:
            ConfigError: If the task is not ambulating, or the robot has another control mode, or no
                gripper that moves for a knob.
        """
        task = env.task
        if not isinstance(task, Ambulating):
            raise ConfigError(f"the scripted opener of doors cannot play {type(task).__name__}")
        if env.cast[role] is not task.robot:
            raise ConfigError(f"{role!r} is not before the door: the first robot is")
        if not isinstance(task.robot.control, ToolDelta):
            raise ConfigError(
                "the scripted opener of doors needs the control mode 'tool_delta': "
                "make('ambulating', robot={'control': 'tool_delta'})"
            )
        self._task, self._robot = task, task.robot
        self._max = task.robot.control.max
        self._has_gripper = task.robot.action_size == 7
        if task.hardware == "knob" and not self._has_gripper:
            raise ConfigError("the scripted opener of doors needs a gripper to turn a knob")
        self._stage, self._wait, self._is_deep = 0, 0.0, False

    def reset(self, rng: np.random.Generator) -> None:
        self._stage, self._wait, self._is_deep = 0, 0.0, False

    def act(self) -> Array:
        pose = self._robot.tool_pose()
        tool = np.array(pose.position)
        is_knob = self._task.hardware == "knob"
        goal, most = self._knob(tool) if is_knob else self._push(tool)
        wished = GAIN * (goal - tool)
        speed = float(np.linalg.norm(wished))
        if speed > most:
            wished *= most / speed
        if is_knob and self._stage == 3:
            turn = np.array((0.0, TURNING, 0.0))
        else:
            turn = TURN_GAIN * rotation_vector(
                multiply(np.array(AHEAD), conjugate(pose.quaternion))
            )
        action = np.concatenate((wished, turn)) / self._max
        action = np.clip(action / max(1.0, float(np.abs(action).max())), -1.0, 1.0)
        if not self._has_gripper:
            return action
        closing = 1.0 if not is_knob or self._stage >= 2 else -1.0
        return np.append(action, closing)

    def _push(self, tool: Array) -> tuple[Array, float]:
        """Return where the tool goes to push a lever down, or a panel aside by its bar."""
        at = self._task.handle_position()
        beside = np.array((0.0, 0.0, 1.0))
        if self._task.hardware == "slider":
            beside = np.array((-self._task.slides_along, 0.0, 0.0))
            if self._task.opening() > DEEPER and not self._is_deep:
                self._is_deep, self._stage = True, 0
            at = at - (0.0, 0.0 if self._is_deep else SHY, 0.0)
        if self._stage == 2 and float((tool - at) @ beside) < -PAST:
            self._stage = 0
        places = (at + OFF * beside - (0.0, OUT, 0.0), at + OFF * beside)
        if self._stage < 2:
            if math.dist(tool, places[self._stage]) < NEAR:
                self._stage += 1
            else:
                return places[self._stage], FAST
        return at - LEAD * beside, SLOW

    def _knob(self, tool: Array) -> tuple[Array, float]:
        """Return where the tool goes to hold a knob."""
        at = self._task.handle_position()
        places = (at - (0.0, OUT, 0.0), at + (0.0, DEEP, 0.0))
        if self._stage < 2:
            if math.dist(tool, places[self._stage]) < NEAR:
                self._stage += 1
            else:
                return places[self._stage], FAST
        if self._stage == 2:
            self._wait += self._task.control_dt
            if self._wait >= CLOSING:
                self._stage = 3
        return places[1], SLOW


register_policy("ambulating", "robot", "scripted")(ScriptedAmbulating)
