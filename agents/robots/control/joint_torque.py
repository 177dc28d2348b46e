"""Control by joint torques on top of gravity compensation."""

from __future__ import annotations

import numpy as np

from rcare_marl.pose import Array

from ..arm import Arm
from ..joint_group import Mask
from .latch import IDLE, Latch


class JointTorque:
    """Each action value is a torque of one joint, added to what holds the arm against gravity.

    A value of 1 is a third of the joint's greatest torque, as far as the weight of the arm leaves
    it. The torque is applied by a motor that would go at the joint's greatest speed, or as fast as
    its limit allows, and has no more than that torque to do so: speed stays limited without torques
    that react a step late. A joint that the others throw faster than its greatest speed is braked
    with all that it has. A joint without torque sticks where it is until a push overcomes friction.
    """

    SHARE = 1 / 3
    FRICTION = 0.02  # of a joint's greatest torque, against its motion
    MARGIN = 0.03  # [rad or m] kept to a limit
    STICKING = 0.005  # [rad or m] that a joint springs back after a push; our own choice

    def __init__(self, arm: Arm) -> None:
        self.size = len(arm)
        self.names = tuple(
            f"{name} [{'N·m' if unit == 'rad' else 'N'}]"
            for name, unit in zip(arm.names, arm.units, strict=True)
        )
        self.max = self.SHARE * arm.effort
        self._arm = arm
        self._latch = Latch(arm, self.STICKING)
        self._speeds = np.zeros(self.size)
        self._forces = self._motors = self.FRICTION * arm.effort
        self._room = arm.effort
        self._idle: Mask = np.zeros(self.size, np.bool_)
        self._fast: Mask = self._idle
        arm.limit_speed()

    def reset(self) -> None:
        arm = self._arm
        self._latch.reset()
        self._speeds, self._forces = np.zeros(self.size), self.FRICTION * arm.effort
        self._room = arm.room(arm.chain.gravity_torques(arm.positions()))
        self._idle = np.ones(self.size, np.bool_)
        self._drive(np.zeros(self.size, np.bool_))
        self._latch.hold(self._idle, self._forces, arm.physics_dt)

    def command(self, action: Array, duration: float) -> None:
        arm = self._arm
        positions, velocities = arm.states()
        self._room = arm.room(arm.chain.gravity_torques(positions))
        least = np.minimum((arm.lower + self.MARGIN - positions) / duration, arm.velocity)
        most = np.maximum((arm.upper - self.MARGIN - positions) / duration, -arm.velocity)
        wanted = np.sign(action) * arm.velocity
        self._speeds = np.clip(
            wanted, np.maximum(least, -arm.velocity), np.minimum(most, arm.velocity)
        )
        torques = np.maximum(self.max * np.abs(action), self.FRICTION * arm.effort)
        is_free = self._speeds == wanted
        # A joint that is held back from its limit may use what it has.
        self._forces = np.minimum(np.where(is_free, torques, arm.effort), self._room)
        self._drive(np.abs(velocities) > arm.velocity)
        self._idle = self._latch.update((np.abs(action) < IDLE) & is_free)
        self._latch.hold(self._idle & ~self._fast, self._forces, duration)

    def _drive(self, fast: Mask) -> None:
        """Drive all joints, and brake those that are too `fast`."""
        arm, self._fast = self._arm, fast
        self._motors = np.where(fast, self._room, self._forces)
        arm.drive_velocities(self._speeds, self._motors)

    @property
    def needs_actuation(self) -> bool:
        return True

    def actuate(self) -> None:
        """Carry the weight of the arm, and brake joints that are too fast."""
        arm = self._arm
        arm.align()
        positions, velocities = arm.states()
        fast = np.abs(velocities) > arm.velocity
        if (fast != self._fast).any():
            self._drive(fast)
            self._latch.hold(self._idle & ~fast, self._forces, arm.physics_dt)
        weight = arm.chain.gravity_torques(positions)
        arm.drive_torques(arm.carry(weight, self._motors).tolist())
