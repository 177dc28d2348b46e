"""Control of a driving base by its speeds."""

from __future__ import annotations

import numpy as np

from rcare_marl.pose import Array

from ..mobile_base import MobileBase
from .control import Control


class BaseVelocity(Control):
    """Action values are speeds in the robot's own frame: forward, to the left if it can, and turning.

    The base takes `RAMP` to come from rest to its full speed, since a jolt would throw arms and head
    about.
    """

    RAMP = 0.2  # [s]; our own choice
    needs_actuation = True

    def __init__(self, base: MobileBase, name: str = "base") -> None:
        self._base = base
        config = base.config
        slides = ("forward", "left") if config.kind == "omnidirectional" else ("forward",)
        self.size = len(slides) + 1
        self.names = (*(f"{name} {way} [m/s]" for way in slides), f"{name} turning [rad/s]")
        self.max = np.array([config.speed] * len(slides) + [config.turn])
        self._velocity = np.zeros(3)

    def reset(self) -> None:
        self._velocity = np.zeros(3)
        self._base.drive(self._velocity)

    def command(self, action: Array, duration: float) -> None:
        speeds = self.max * action
        left = float(speeds[1]) if self.size == 3 else 0.0
        wanted = np.array((speeds[0], left, speeds[-1]))
        config = self._base.config
        # Going aslant is no faster than going straight.
        along = float(np.hypot(wanted[0], wanted[1]))
        if along > config.speed:
            wanted[:2] *= config.speed / along
        change = np.array((config.speed, config.speed, config.turn)) * duration / self.RAMP
        self._velocity = np.clip(wanted, self._velocity - change, self._velocity + change)

    def actuate(self) -> None:
        """Drive on along the present heading."""
        self._base.drive(self._velocity)
