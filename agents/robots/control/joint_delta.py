"""Control by changes of the joint positions."""

from __future__ import annotations

import numpy as np

from rcare_marl.pose import Array

from ..joint_group import JointGroup


class JointDelta:
    """Each action value moves the target of one joint.

    A value of 1 moves the target at the joint's greatest speed. Targets stay within the limits, and
    within a tenth of a radian of the joint, so that a blocked arm does not wind up.
    """

    LEASH = 0.1  # [rad or m] beyond the way of one step

    def __init__(self, arm: JointGroup) -> None:
        self.size = len(arm)
        self.names = tuple(
            f"{name} [{unit}/s]" for name, unit in zip(arm.names, arm.units, strict=True)
        )
        self.max = arm.velocity.copy()
        self._arm = arm
        self._target = np.zeros(self.size)

    def reset(self) -> None:
        self._target = self._arm.positions()
        self._arm.drive_to(self._target, self._arm.velocity, self._arm.effort)

    def command(self, action: Array, duration: float) -> None:
        arm = self._arm
        step = self.max * duration * action
        real = arm.positions()
        leash = self.LEASH + np.abs(step)
        target = np.clip(self._target + step, real - leash, real + leash)
        self._target = np.clip(target, arm.lower, arm.upper)
        speeds = arm.speeds_for(np.abs(self._target - real), duration)
        arm.drive_to(self._target, speeds, arm.effort)

    @property
    def needs_actuation(self) -> bool:
        return False

    def actuate(self) -> None:
        """Do nothing: the motors hold their targets."""
