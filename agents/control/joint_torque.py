"""Control by joint torques on top of gravity compensation."""

from __future__ import annotations

import numpy as np

from rcare_marl.pose import Array

from ..arm import Arm


class JointTorque:
    """Each action value is a torque of one joint, added to what holds the arm against gravity.

    A value of 1 is a third of the joint's greatest torque; the sum never exceeds the greatest.
    Close to a limit and beyond the greatest speed a joint brakes by itself.
    """

    SHARE = 1 / 3
    BRAKE_ZONE = 0.15  # [rad or m] before a limit
    DAMPING = 0.05  # of a joint's greatest torque at its greatest speed

    def __init__(self, arm: Arm) -> None:
        self.size = len(arm)
        self.names = tuple(f"{name} [N·m]" for name in arm.names)
        self.max = self.SHARE * arm.effort
        self._arm = arm
        self._torque = np.zeros(self.size)
        # The strongest brake that one physics step can bear, for the lightest posture of the arm.
        self._stiffness = 2 * arm.effort / self.BRAKE_ZONE

    def reset(self) -> None:
        self._torque[:] = 0.0
        self._arm.body.release_motors(self._arm.indices)

    def command(self, action: Array, duration: float) -> None:
        self._torque = self.max * action

    def actuate(self) -> None:
        arm = self._arm
        positions, speeds, _ = arm.read()
        hold = arm.chain.gravity_torques(positions)
        relative = speeds / arm.velocity
        torque = self._torque - self.DAMPING * arm.effort * relative
        # Fade out what drives a joint beyond its greatest speed.
        fast = np.clip(2 - 2 * np.abs(relative), 0.0, 1.0)
        torque = np.where(torque * speeds > 0, torque * fast, torque)
        into_low = np.maximum(arm.lower + self.BRAKE_ZONE - positions, 0.0)
        into_high = np.maximum(positions - arm.upper + self.BRAKE_ZONE, 0.0)
        near = (into_low > 0) | (into_high > 0)
        torque += self._stiffness * (into_low - into_high)
        torque -= np.where(near, 0.3 * arm.effort * relative, 0.0)
        total = np.clip(hold + torque, -arm.effort, arm.effort)
        arm.body.drive_torques(arm.indices, total.tolist())
