"""Control of joints one by one: by changes of position, positions, speeds or torques."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rcare_marl.pose import Array

from ..arm import Arm
from ..joint_group import JointGroup, Mask
from .control import Control

IDLE = 1e-6  # an action below it is none
# Units of action values, for joints that turn and for those that slide.
PLACES = {"rad": "rad", "m": "m"}
RATES = {"rad": "rad/s", "m": "m/s"}
EFFORTS = {"rad": "N·m", "m": "N"}


class JointControl(Control):
    """One action value a joint."""

    def __init__(self, group: JointGroup, units: Mapping[str, str]) -> None:
        """Name the values by the joints and what `units` say for `rad` and `m`."""
        self.size = len(group)
        joints = zip(group.names, group.units, strict=True)
        self.names = tuple(f"{name} [{units[unit]}]" for name, unit in joints)


class JointDelta(JointControl):
    """Each action value moves the target of one joint.

    A value of 1 moves the target at the joint's greatest speed. Targets stay within the limits, and
    within a tenth of a radian of the joint, so that a blocked arm does not wind up.
    """

    LEASH = 0.1  # [rad or m] beyond the way of one step

    def __init__(self, arm: JointGroup) -> None:
        super().__init__(arm, RATES)
        self._arm, self.max = arm, arm.velocity.copy()
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


class JointPosition(JointControl):
    """Each action value is the position of one joint: -1 its lower limit, 1 its upper one.

    A continuous joint takes -1 to 1 as half a turn each way, by the shorter way. Joints go at their
    greatest speed at most, and take `RAMP` to come to it and to stop from it: all at once they would
    throw each other about.
    """

    RAMP = 0.2  # [s]; our own choice

    def __init__(self, arm: JointGroup) -> None:
        super().__init__(arm, PLACES)
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
        return np.where(self._turns, wrapped, offset) / np.maximum(self.max, 1e-12)

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


class Latch:
    """Where idle joints came to rest.

    A motor that is told no more than to stand still gives way a little in every physics step, since
    the solver only comes near to no speed. One that is told where to stand comes back.
    """

    def __init__(self, group: JointGroup, leash: float) -> None:
        """Make a latch that lets go as soon as a joint is more than `leash` [rad or m] away."""
        self._group, self._leash = group, leash
        self.reset()

    def reset(self) -> None:
        """Take the present posture as the one to hold."""
        self._targets = self._group.positions()
        self._was_idle: Mask = np.ones(len(self._group), np.bool_)
        self._is_held = self._was_idle

    def update(self, idle: Mask) -> Mask:
        """Return which joints to hold, shape [n]: those that were `idle` for a control step.

        Until then they only brake, so that they do not come back by the way that they took for it.
        """
        positions = self._group.positions()
        held: Mask = idle & self._was_idle
        fresh = held & ~self._is_held
        near = np.clip(self._targets, positions - self._leash, positions + self._leash)
        self._targets = np.where(fresh | ~held, positions, near)
        self._was_idle, self._is_held = idle, held
        return held

    def hold(self, held: Mask, forces: Array, duration: float) -> None:
        """Drive the joints that are `held` back to where they were in `duration` [s]."""
        if held.any():
            group = self._group
            way = np.abs(self._targets - group.positions())
            group.drive_to(self._targets, group.speeds_for(way, duration), forces, only=held)


class JointVelocity(JointControl):
    """Each action value is the speed of one joint, 1 being its greatest.

    A joint slows down so that it stops at its limit. The motors keep the speed until the next
    command; a joint whose speed is zero is held where it stopped.
    """

    MARGIN = 0.005  # [rad or m] kept to a limit
    LEASH = 0.02  # [rad or m] that a joint comes back after it was pushed away; our own choice

    def __init__(self, arm: JointGroup) -> None:
        super().__init__(arm, RATES)
        self._arm, self.max = arm, arm.velocity.copy()
        self._latch = Latch(arm, self.LEASH)
        self.needs_actuation = arm.has_followers

    def reset(self) -> None:
        arm = self._arm
        self._latch.reset()
        self._latch.hold(np.ones(self.size, np.bool_), arm.effort, arm.physics_dt)

    def command(self, action: Array, duration: float) -> None:
        arm = self._arm
        speeds = _braked(arm, self.max * action, arm.positions(), self.MARGIN, duration)
        arm.drive_velocities(speeds, arm.effort)
        held = self._latch.update((np.abs(action) < IDLE) & (speeds == self.max * action))
        self._latch.hold(held, arm.effort, duration)

    def actuate(self) -> None:
        """Bring the joints that follow along; the motors hold their speeds."""
        self._arm.align()


class JointTorque(JointControl):
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
    needs_actuation = True
    STICKING = 0.005  # [rad or m] that a joint springs back after a push; our own choice

    def __init__(self, arm: Arm) -> None:
        super().__init__(arm, EFFORTS)
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
        wanted = np.sign(action) * arm.velocity
        self._speeds = _braked(arm, wanted, positions, self.MARGIN, duration)
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


def _braked(
    arm: JointGroup, wanted: Array, positions: Array, margin: float, duration: float
) -> Array:
    """Return speeds near those `wanted`, such that joints stop `margin` before a limit, shape [n]."""
    least = np.minimum((arm.lower + margin - positions) / duration, arm.velocity)
    most = np.maximum((arm.upper - margin - positions) / duration, -arm.velocity)
    return np.clip(np.clip(wanted, least, most), -arm.velocity, arm.velocity)
