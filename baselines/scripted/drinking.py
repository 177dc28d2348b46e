"""A hand-written robot that gives to drink: bring the cup to the lips, wait, tilt it about its edge.

It shows that the task can be done. It sees what a robot with perfect perception would see, and it needs
the control mode `tool_delta`.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.mouth import OPEN
from rcare_marl.envs.tasks.drinking import Drinking
from rcare_marl.pose import conjugate, multiply, rotation_vector

from .tool_script import scripted_task

Array = npt.NDArray[np.float64]

# All our own choices.
WAIT_IN_FRONT = 0.08  # [m] from mouth to rim while the mouth is closed
GAIN, TURN_GAIN = 2.5, 2.5  # [1/s]
FAST, SLOW = 0.16, 0.05  # [m/s] far from the mouth, and near it
NEAR = 0.12  # [m]
ACCELERATION = 0.5  # [m/s²] that keeps the water in the cup
AT_LIPS = (0.006, -0.014)  # [m] of the rim from the mouth, ahead and up, while it pours
ARRIVED = 0.012  # [m] from there, before the cup is tilted to drink
LEANING = math.radians(28)  # tilt with which it comes: the bottom stays clear of the chin
TILT_RATE = 0.35  # [rad/s]
LAST = math.radians(92)  # farther the cup is not tilted


class ScriptedDrinking:
    """Brings the cup to the lips, waits until they open, and tilts it; sees everything."""

    def __init__(self, env: CareEnv, role: str) -> None:
        """Take the environment and the robot's role.

        Raises:
            ConfigError: If the task is not drinking, or the robot has another control mode.
        """
        self._task = scripted_task(env, role, Drinking)
        self._robot = self._task.robot
        self._velocity, self._tilt = np.zeros(3), 0.0

    def reset(self, rng: np.random.Generator) -> None:
        self._velocity[:] = 0.0
        self._tilt = 0.0

    def act(self) -> Array:
        task, seen = self._task, self._task.state
        ahead, up = AT_LIPS
        lips = seen.mouth + ahead * seen.ahead + (0.0, 0.0, up)
        is_open = seen.jaw >= OPEN
        goal = lips if is_open else lips + WAIT_IN_FRONT * seen.ahead
        error = goal - seen.rim
        is_there = is_open and float(np.linalg.norm(error)) < ARRIVED
        most = LAST if is_there else max(self._tilt, LEANING)
        self._tilt = min(self._tilt + TILT_RATE * task.control_dt, most)
        limit = SLOW if seen.distance < NEAR else FAST
        wished = GAIN * error
        speed = float(np.linalg.norm(wished))
        if speed > limit:
            wished *= limit / speed
        change = wished - self._velocity
        size = float(np.linalg.norm(change))
        step = ACCELERATION * task.control_dt
        self._velocity = self._velocity + change * min(1.0, step / max(size, 1e-9))
        wanted = task.cup_pose(seen.rim, -seen.ahead, self._tilt).quaternion
        turn = TURN_GAIN * rotation_vector(multiply(wanted, conjugate(seen.turn)))
        # The tool turns about the rim, so that turning does not move it.
        to_tool = np.subtract(self._robot.tool_pose().position, seen.rim)
        return self._robot.tool_action(self._velocity + np.cross(turn, to_tool), turn)


register_policy("drinking", "robot", "scripted")(ScriptedDrinking)
