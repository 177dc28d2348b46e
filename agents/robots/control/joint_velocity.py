"""Control by joint speeds."""

from __future__ import annotations

import numpy as np

from rcare_marl.pose import Array

from ..joint_group import JointGroup
from .latch import IDLE, Latch


class JointVelocity:
    """Each action value is the speed of one joint, 1 being its greatest.

    A joint slows down so that it stops at its limit. The motors keep the speed until the next
    command; a joint whose speed is zero is held where it stopped.
    """

    MARGIN = 0.005  # [rad or m] kept to a limit
    LEASH = 0.02  # [rad or m] that a joint comes back after it was pushed away; our own choice

    def __init__(self, arm: JointGroup) -> None:
        self.size = len(arm)
        self.names = tuple(
            f"{name} [{unit}/s]" for name, unit in zip(arm.names, arm.units, strict=True)
        )
        self.max = arm.velocity.copy()
        self._arm = arm
        self._latch = Latch(arm, self.LEASH)

    def reset(self) -> None:
        arm = self._arm
        self._latch.reset()
        self._latch.hold(np.ones(self.size, np.bool_), arm.effort, arm.physics_dt)

    def command(self, action: Array, duration: float) -> None:
        arm = self._arm
        positions = arm.positions()
        least = np.minimum((arm.lower + self.MARGIN - positions) / duration, self.max)
        most = np.maximum((arm.upper - self.MARGIN - positions) / duration, -self.max)
        speeds = np.clip(np.clip(self.max * action, least, most), -self.max, self.max)
        arm.drive_velocities(speeds, arm.effort)
        held = self._latch.update((np.abs(action) < IDLE) & (speeds == self.max * action))
        self._latch.hold(held, arm.effort, duration)

    @property
    def needs_actuation(self) -> bool:
        return self._arm.has_followers

    def actuate(self) -> None:
        """Bring the joints that follow along; the motors hold their speeds."""
        self._arm.align()
