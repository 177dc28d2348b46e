"""A hand-written robot that gives to drink: bring the cup to the lips, wait, tilt it about its edge.

From who does not want it, it draws back at once, and sets the cup upright.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.meal import OPEN_MOUTH, TAKEN_AWAY
from rcare_marl.envs.tasks.drinking import Drinking
from rcare_marl.pose import Array

from .offering import BACK, Offering
from .tool_script import ToolScript, limited, turning, unit

# All our own choices.
WAIT_IN_FRONT = 0.08  # [m] from mouth to rim while the mouth is closed
GAIN, TURN_GAIN = 2.5, 2.5  # [1/s]
FAST, SLOW = 0.16, 0.05  # [m/s] far from the mouth, and near it
NEAR = 0.12  # [m]
ACCELERATION = 0.5  # [m/s²] that keeps the water in the cup
ARRIVED = 0.012  # [m] from there, before the cup is tilted to drink
LEANING = math.radians(28)  # tilt with which it comes: the bottom stays clear of the chin
# [N] from which a chest is in the way of the bottom; tilt with which that is lifted off it, short of pouring,
# how nearly, and [m] from the mouth: there it pours, which frees it to come nearer
BLOCKED, FULL, ALMOST, AT_MOUTH = 1.0, math.radians(43), math.radians(2), 0.038
PRESS, YIELD = 3.0, 0.02  # [N] that it may press with, and [m/s] off for each newton more
TILT_RATE = 0.35  # [rad/s]
LAST = math.radians(92)  # farther the cup is not tilted
ASK = 0.20  # [m] from mouth to rim, where it is offered to who just said no
CLEAR = 0.03  # [m] beyond where it counts as taken away
HASTE = 1.5  # [m/s²] back from who said no
UPRIGHT_RATE = 1.0  # [rad/s] at which it is set upright then


@register_policy("drinking", "robot", "scripted")
class ScriptedDrinking(ToolScript[Drinking]):
    """Brings the cup to the lips, waits until they open, and tilts it; sees everything.

    Attributes:
        AT_LIPS: Where the rim is from the mouth while it pours, ahead and up [m].
    """

    KIND = Drinking
    AT_LIPS = (0.006, -0.014)

    def _begin(self) -> None:
        self._velocity, self._offering = np.zeros(3), Offering()

    def act(self) -> Array:
        task, seen = self._task, self._task.state
        lips = self._lips()
        offers = self._offers()
        is_open = offers and not seen.refusal.is_no and seen.jaw >= OPEN_MOUTH
        away = WAIT_IN_FRONT if offers else TAKEN_AWAY + CLEAR
        goal = lips if is_open else lips + away * seen.ahead_faced
        if offers and seen.refusal.is_no:
            goal = seen.mouth + ASK * unit(seen.rim - seen.mouth)
        error = goal - seen.rim
        is_blocked = is_open and seen.force > BLOCKED
        is_there = is_open and float(np.linalg.norm(error)) < ARRIVED
        is_there |= is_blocked and seen.distance < AT_MOUTH and seen.tilt > FULL - ALMOST
        # A little ahead of the cup as it is: what lags behind, or is pushed, is not wound up.
        leaning = LAST if is_there else FULL if is_blocked else LEANING
        tilt = min(seen.tilt + TILT_RATE / TURN_GAIN, max(seen.tilt, leaning))
        if not offers:
            keeps = min(seen.tilt, FULL) if seen.distance < NEAR else 0.0  # off the chest first
            tilt = max(seen.tilt - UPRIGHT_RATE / TURN_GAIN, keeps)
        wished = limited(GAIN * error, SLOW if offers and seen.distance < NEAR else FAST)
        wished = (
            wished + YIELD * max(seen.force - (PRESS if offers else 0.0), 0.0) * seen.ahead_faced
        )
        step = (ACCELERATION if offers else HASTE) * task.control_dt
        self._velocity = self._velocity + limited(wished - self._velocity, step)
        wanted = task.cup_pose(seen.rim, -seen.ahead_faced, tilt).quaternion
        turn = turning(wanted, seen.turn, TURN_GAIN)
        return self._about(seen.rim, self._velocity, turn)  # so that turning does not move the rim

    def _lips(self) -> Array:
        """Return where the rim goes to pour [m], shape [3]: nobody who turns away is chased."""
        ahead, up = self.AT_LIPS
        seen = self._task.state
        return seen.mouth_faced + ahead * seen.ahead_faced + (0.0, 0.0, up)

    def _offers(self) -> bool:
        """Return whether to offer now."""
        seen = self._task.state
        return self._offering.goes_on(seen.refusal, seen.time)

    def memory(self) -> tuple[Sequence[object], Array]:
        return (self._offering.is_on,), self._velocity / FAST


@register_policy("drinking", "robot", "gentle")
class GentleDrinking(ScriptedDrinking):
    """As `scripted`, but pours from farther off, and offers again by where the cup is, not by the time.

    So the far side of a cup that is nearly empty hardly touches a nose, and who imitates it need not count.
    """

    AT_LIPS = (0.014, -0.014)

    def _offers(self) -> bool:
        seen = self._task.state
        return self._offering.once_back(seen.refusal, seen.distance > BACK)
