"""What sensors of contact have in common: what they make of many physics steps."""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.pose import Array
from rcare_marl.world import World

from .sensor import Sensor, SensorConfig


@dataclass(frozen=True)
class TouchConfig(SensorConfig):
    """Options of sensors of contact.

    Attributes:
        statistic: Of the physics steps since the last sample, which is a control step if there is no
            `rate`: their `mean`, or the greatest force of each, `peak`; or the `last` physics step
            alone, which is cheaper. Impacts are short: only the peak tells how hard they were.
    """

    statistic: Literal["mean", "peak", "last"] = "mean"


class TouchSensor(Sensor):
    """A sensor of contact forces, in rows of one or three values."""

    Config = TouchConfig
    config: TouchConfig
    _world: World

    @abc.abstractmethod
    def present(self) -> Array:
        """Return what was felt in the last physics step [N], shape [rows, 1] or [rows, 3]."""

    def begin(self, rows: int, width: int) -> None:
        """Say how much there is to read, when it is bound."""
        self._seen, self._gathered = np.zeros((rows, width)), np.zeros((rows, width))
        self.reset()

    def reset(self) -> None:
        self._begun, self._count = self._world.step_count, 0
        self._seen = np.zeros_like(self._seen)

    @property
    def watches(self) -> bool:
        return self.config.statistic != "last"

    def after_substep(self) -> None:
        if not self.watches:
            return
        now = self.present()
        if self._count == 0:
            self._gathered[:] = now
        elif self.config.statistic == "mean":
            self._gathered += now
        else:
            greater = (now**2).sum(axis=1) > (self._gathered**2).sum(axis=1)
            self._gathered[greater] = now[greater]
        self._count += 1

    def gathered(self) -> Array:
        """Return the statistic since it was last asked for, in rows; zeros before the first step."""
        if not self.watches:
            if self._world.step_count != self._begun:  # what Bullet tells is of the last episode
                self._seen = self.present()
        elif self._count:
            share = self._count if self.config.statistic == "mean" else 1
            self._seen, self._count = self._gathered / share, 0
        return self._seen
