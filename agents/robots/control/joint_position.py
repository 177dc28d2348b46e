"""Control by joint positions."""

from __future__ import annotations

import numpy as np

from rcare_marl.pose import Array

from ..joint_group import JointGroup


class JointPosition:
    """Each action value is the position of one joint: -1 its lower limit, 1 its upper one.

    A continuous joint takes -1 to 1 as half a turn each way, by the shorter way. Joints go at their
    greatest speed at most, and take `RAMP` to come to it and to stop from it: all at once they would
    throw each other about.
    """

    RAMP = 0.2  # [s]; our own choice

    def __init__(self, arm: JointGroup) -> None:
        self.size = len(arm)
        self.names = tuple(
            f"{name} [{unit}]" for name, unit in zip(arm.names, arm.units, strict=True)
        )
        self._arm = arm
        self._speeds = np.zeros(self.size)  # that were told last
        self._turns = np.isinf(arm.upper) | np.isinf(arm.lower)
        lower = np.where(self._turns, -np.pi, arm.lower)
        upper = np.where(self._turns, np.pi, arm.upper)
        self.middle, self.max = (lower + upper) / 2, (upper - lower) / 2

    def reset(self) -> None:
        self._speeds = np.zeros(self.size)
        self._arm.drive_to(self._arm.positions(), self._arm.velocity, self._arm.effort)

    def action_for(self, positions: Array) -> Array:
        """Return the action that asks for joint `positions` [rad or m], shape [n]."""
        offset = positions - self.middle
        wrapped = offset - 2 * np.pi * np.rint(offset / (2 * np.pi))
        out: Array = np.where(self._turns, wrapped, offset) / np.maximum(self.max, 1e-12)
        return out

    def command(self, action: Array, duration: float) -> None:
        arm = self._arm
        real = arm.positions()
        way = self.middle + self.max * action - real
        way = np.where(self._turns, way - 2 * np.pi * np.rint(way / (2 * np.pi)), way)
        rate = arm.velocity / self.RAMP
        # From v it takes v^2 / (2 rate) to stop, and half a step more as speeds change in steps.
        late = 0.5 * rate * duration
        most = np.sqrt(late**2 + 2 * rate * np.abs(way)) - late
        wanted = np.sign(way) * np.minimum(np.minimum(np.abs(way) / duration, most), arm.velocity)
        change = rate * duration
        self._speeds = np.clip(wanted, self._speeds - change, self._speeds + change)
        step = self._speeds * duration
        arm.drive_to(real + step, arm.speeds_for(np.abs(step), duration), arm.effort)

    @property
    def needs_actuation(self) -> bool:
        return False

    def actuate(self) -> None:
        """Do nothing: the motors hold their targets."""
