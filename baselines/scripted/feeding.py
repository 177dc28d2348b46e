"""A hand-written robot that feeds: level the spoon, come in front of the mouth, wait, go in.

It shows that the task can be done. It sees what a robot with perfect perception would see, and it needs
the control mode `tool_delta`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.tasks.feeding import OPEN_MOUTH, Feeding
from rcare_marl.pose import conjugate, multiply, rotation_vector

from .tool_script import scripted_task

Array = npt.NDArray[np.float64]

# All our own choices.
WAIT_IN_FRONT = 0.09  # [m] from mouth to bowl while the mouth is closed
GAIN, TURN_GAIN = 2.5, 2.5  # [1/s]
FAST, SLOW = 0.20, 0.06  # [m/s] far from the mouth, and near it
NEAR = 0.12  # [m]
ACCELERATION = 0.6  # [m/s²] that keeps food on the spoon


class ScriptedFeeding:
    """Levels the spoon, waits before the mouth until it opens, and goes in; sees everything."""

    def __init__(self, env: CareEnv, role: str) -> None:
        """Take the environment and the robot's role.

        Raises:
            ConfigError: If the task is not feeding, or the robot has another control mode.
        """
        self._task = scripted_task(env, role, Feeding)
        self._robot = self._task.robot
        self._velocity = np.zeros(3)

    def reset(self, rng: np.random.Generator) -> None:
        self._velocity[:] = 0.0

    def act(self) -> Array:
        task, seen = self._task, self._task.state
        level = seen.face * (1.0, 1.0, 0.0)
        level /= np.linalg.norm(level)
        goal = seen.mouth + (0.0 if seen.jaw > OPEN_MOUTH else WAIT_IN_FRONT) * seen.face
        error = goal - seen.bowl
        limit = SLOW if seen.distance < NEAR else FAST
        wished = GAIN * error
        speed = float(np.linalg.norm(wished))
        if speed > limit:
            wished *= limit / speed
        change = wished - self._velocity
        size = float(np.linalg.norm(change))
        most = ACCELERATION * task.control_dt
        self._velocity = self._velocity + change * min(1.0, most / max(size, 1e-9))
        turn = TURN_GAIN * rotation_vector(
            multiply(task.spoon_facing(-level), conjugate(seen.turn))
        )
        # The tool turns about the bowl, so that turning does not move the food.
        to_tool = np.subtract(self._robot.tool_pose().position, seen.bowl)
        return self._robot.tool_action(self._velocity + np.cross(turn, to_tool), turn)


register_policy("feeding", "robot", "scripted")(ScriptedFeeding)
