"""Control by joint torques on top of gravity compensation."""

from __future__ import annotations

import numpy as np

from rcare_marl.pose import Array

from ..arm import Arm


class JointTorque:
    """Each action value is a torque of one joint, added to what holds the arm against gravity.

    A value of 1 is a third of the joint's greatest torque. The torque is applied by a motor that
    would go at the joint's greatest speed, or as fast as its limit allows, and has no more than
    that torque to do so: speed stays limited without torques that react a step late.
    """

    SHARE = 1 / 3
    FRICTION = 0.02  # of a joint's greatest torque, against its motion
    MARGIN = 0.03  # [rad or m] kept to a limit

    def __init__(self, arm: Arm) -> None:
        self.size = len(arm)
        self.names = tuple(
            f"{name} [{'N·m' if unit == 'rad' else 'N'}]"
            for name, unit in zip(arm.names, arm.units, strict=True)
        )
        self.max = self.SHARE * arm.effort
        self._arm = arm
        arm.limit_speed()

    def reset(self) -> None:
        self._arm.drive_velocities(np.zeros(self.size), self.FRICTION * self._arm.effort)

    def command(self, action: Array, duration: float) -> None:
        arm = self._arm
        positions = arm.positions()
        least = np.minimum((arm.lower + self.MARGIN - positions) / duration, arm.velocity)
        most = np.maximum((arm.upper - self.MARGIN - positions) / duration, -arm.velocity)
        wanted = np.sign(action) * arm.velocity
        speeds = np.clip(wanted, np.maximum(least, -arm.velocity), np.minimum(most, arm.velocity))
        torques = np.maximum(self.max * np.abs(action), self.FRICTION * arm.effort)
        # A joint that is held back from its limit may use what it has.
        arm.drive_velocities(speeds, np.where(speeds == wanted, torques, arm.effort))

    @property
    def needs_actuation(self) -> bool:
        return True

    def actuate(self) -> None:
        """Carry the weight of the arm."""
        arm = self._arm
        arm.align()
        arm.drive_torques(arm.chain.gravity_torques(arm.positions()).tolist())
