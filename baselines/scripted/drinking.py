"""A hand-written robot that gives to drink: bring the cup to the lips, wait, tilt it about its edge."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.meal import OPEN_MOUTH
from rcare_marl.envs.tasks.drinking import Drinking
from rcare_marl.pose import Array

from .tool_script import ToolScript, limited, turning

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


@register_policy("drinking", "robot", "scripted")
class ScriptedDrinking(ToolScript[Drinking]):
    """Brings the cup to the lips, waits until they open, and tilts it; sees everything."""

    KIND = Drinking

    def _begin(self) -> None:
        self._velocity, self._tilt = np.zeros(3), 0.0

    def act(self) -> Array:
        task, seen = self._task, self._task.state
        ahead, up = AT_LIPS
        lips = seen.mouth + ahead * seen.ahead + (0.0, 0.0, up)
        is_open = seen.jaw >= OPEN_MOUTH
        goal = lips if is_open else lips + WAIT_IN_FRONT * seen.ahead
        error = goal - seen.rim
        is_there = is_open and float(np.linalg.norm(error)) < ARRIVED
        most = LAST if is_there else max(self._tilt, LEANING)
        self._tilt = min(self._tilt + TILT_RATE * task.control_dt, most)
        wished = limited(GAIN * error, SLOW if seen.distance < NEAR else FAST)
        step = ACCELERATION * task.control_dt
        self._velocity = self._velocity + limited(wished - self._velocity, step)
        wanted = task.cup_pose(seen.rim, -seen.ahead, self._tilt).quaternion
        turn = turning(wanted, seen.turn, TURN_GAIN)
        return self._about(seen.rim, self._velocity, turn)  # so that turning does not move the rim
