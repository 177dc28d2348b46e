"""A hand-written robot that feeds: level the spoon, come in front of the mouth, wait, go in.

Between bites it draws back until the spoon is filled, and waits until the mouth is empty. From who does not
want it, it draws back at once.
"""

from __future__ import annotations

import numpy as np

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.meal import TAKEN_AWAY
from rcare_marl.envs.tasks.feeding import FOOD_COUNT, LOADED_FROM, OPEN_MOUTH, Feeding
from rcare_marl.pose import Array

from .offering import Offering
from .tool_script import ToolScript, limited, turning, unit

# All our own choices.
WAIT_IN_FRONT = 0.09  # [m] from mouth to bowl while the mouth is closed
ASK = 0.20  # [m] from mouth to bowl, where it is offered to who just said no
CLEAR = 0.03  # [m] beyond where the spoon is filled, or was taken away
GAIN, TURN_GAIN = 2.5, 2.5  # [1/s]
FAST, SLOW = 0.20, 0.06  # [m/s] far from the mouth, and near it
NEAR = 0.12  # [m]
ACCELERATION = 0.6  # [m/s²] that keeps food on the spoon


@register_policy("feeding", "robot", "scripted")
class ScriptedFeeding(ToolScript[Feeding]):
    """Levels the spoon, waits before the mouth until it opens, and goes in; sees everything."""

    KIND = Feeding

    def _begin(self) -> None:
        self._velocity, self._offering = np.zeros(3), Offering()
        self._mouth: Array | None = None
        self._face = np.array((1.0, 0.0, 0.0))

    def act(self) -> Array:
        task, seen = self._task, self._task.state
        offers = self._offering.goes_on(seen.refusal, seen.time)
        if self._mouth is None or (offers and not seen.refusal.turned):  # nobody is chased
            self._mouth, self._face = seen.mouth, seen.face
        level = self._face * (1.0, 1.0, 0.0)
        level /= np.linalg.norm(level)
        goes_in = seen.jaw > OPEN_MOUTH and seen.mouthful.is_ready
        away = 0.0 if goes_in else WAIT_IN_FRONT
        if seen.eaten == FOOD_COUNT:
            away = LOADED_FROM + CLEAR
        if not offers:
            away = TAKEN_AWAY + CLEAR
        goal = self._mouth + away * self._face
        if offers and seen.refusal.is_no:
            goal = seen.mouth + ASK * unit(seen.bowl - seen.mouth)
        error = goal - seen.bowl
        wished = limited(GAIN * error, SLOW if offers and seen.distance < NEAR else FAST)
        step = ACCELERATION * task.control_dt
        self._velocity = self._velocity + limited(wished - self._velocity, step)
        turn = turning(task.spoon_facing(-level), seen.turn, TURN_GAIN)
        if seen.refusal.turned:  # it asks from where it is, and does not go round the head
            turn = np.zeros(3)
        return self._about(seen.bowl, self._velocity, turn)  # so that turning does not move food
