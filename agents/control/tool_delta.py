"""Control by changes of the tool's pose."""

from __future__ import annotations

import math

import numba
import numpy as np

from rcare_marl.pose import Array

from ..arm import Arm
from ..joint_group import RETURN_SPEED
from ..kinematics import (
    bounded_step,
    forward,
    holding,
    jacobian,
    least_squares,
    rotated,
    rotation_between,
)
from ..robot_config import BASE_JOINTS

REST_PULL = 0.5  # [1/s] towards the rest posture, at full speed of the tool
HEADROOM = 1.5  # motor torque over what `contact_force` at the tool takes
FELT = 0.4  # share of `contact_force` that counts as contact
YIELD = 0.002  # way of the target into a light contact, and back out of one twice too hard [m]
DAMPING = 0.01  # of the least squares
# Weight of a radian against a metre where fewer than six joints cannot do both: place comes first.
FEW_JOINTS_TURN = 0.03


class ToolDelta:
    """Six values move a target of the tool's pose: three along, three about the world's axes.

    Joints follow the target by damped least squares within their position and speed limits. Three
    things keep contact gentle: the target stays on a short leash from the real tool; it gives way
    where the motors feel more than `contact_force` at the tool; and motors get no more torque than
    that force needs, with some room for acceleration. For that the weight of the arm is carried by
    torques of its own, which the limits of the motors could not tell from a push.

    Attributes:
        contact_force: Force at the tool from which the target gives way [N].
    """

    SPEED = 0.25  # [m/s]
    TURN = 1.0  # [rad/s]
    LEASH = (0.03, 0.25)  # [m], [rad]
    CONTACT_FORCE = 15.0  # [N]

    def __init__(self, arm: Arm) -> None:
        self.size = 6
        self.names = (
            *(f"tool {axis} [m/s]" for axis in "xyz"),
            *(f"tool about {axis} [rad/s]" for axis in "xyz"),
        )
        self.max = np.array([self.SPEED] * 3 + [self.TURN] * 3)
        self.contact_force = self.CONTACT_FORCE
        self._arm = arm
        own = [name for name in arm.names if name not in BASE_JOINTS]
        self._is_base = np.array([name in BASE_JOINTS for name in arm.names])
        self._has_base = bool(self._is_base.any())
        self._turn_weight = 1.0 if len(own) >= 6 else FEW_JOINTS_TURN
        self._goal = np.zeros((3, 4))
        self._target = np.zeros(len(arm))
        self._hold = np.zeros(len(arm))
        self._push = tuple(self._hold.tolist())
        self._steps_left = -1  # physics steps to the end of the control step
        self._velocities = np.zeros(len(arm))

    def reset(self) -> None:
        arm, chain = self._arm, self._arm.chain
        self._target = arm.positions()
        self._steps_left = -1
        self._goal[:] = forward(chain.base, chain.origins, chain.axes, chain.slides, self._target)[
            0
        ]
        self._drive(arm.velocity, arm.effort, chain.gravity_torques(self._target))

    def _drive(self, speeds: Array, forces: Array, weight: Array) -> None:
        """Drive to the target, within the effort beside the weight of the arm."""
        arm = self._arm
        room = arm.room(weight)
        if self._has_base:
            room = np.where(self._is_base, arm.effort, room)
        forces = np.minimum(forces, room)
        self._hold = arm.carry(weight, forces)
        self._push = tuple(self._hold.tolist())
        arm.drive_to(self._target, speeds, forces)

    def command(self, action: Array, duration: float) -> None:
        arm, chain = self._arm, self._arm.chain
        positions, velocities, torques = arm.read()
        if self._steps_left == 0:  # the step ran as planned: leave out the torque to speed up
            rate = (velocities - self._velocities) / arm.physics_dt
            torques = torques + self._hold - arm.inertial_torques(positions, rate)
        else:  # nothing can be told of what the motors felt
            torques = chain.gravity_torques(positions)
        self._steps_left = max(round(duration / arm.physics_dt), 1)
        speeds, forces, weight = _follow(
            self._goal,
            self._target,
            positions,
            torques,
            self.max * action,
            duration,
            chain.base,
            chain.origins,
            chain.axes,
            chain.slides,
            chain.masses,
            chain.centres,
            chain.lags,
            arm.lower,
            arm.upper,
            arm.velocity,
            arm.effort,
            arm.rest,
            self.LEASH,
            self.contact_force,
            self._turn_weight,
        )
        if self._has_base:  # it has the whole robot to speed up
            forces = np.where(self._is_base, arm.effort, forces)
        self._drive(speeds, forces, weight)

    @property
    def needs_actuation(self) -> bool:
        return True

    def actuate(self) -> None:
        """Carry the weight of the arm."""
        self._steps_left -= 1
        if self._steps_left == 0:
            self._velocities = self._arm.velocities()
        self._arm.drive_torques(self._push)


@numba.njit(cache=True)
def _follow(  # type: ignore[no-untyped-def]
    goal,
    target,
    positions,
    torques,
    twist,
    duration,
    base,
    origins,
    axes,
    slides,
    masses,
    centres,
    lags,
    lower,
    upper,
    velocity,
    effort,
    rest,
    leash,
    contact_force,
    weight,
):
    """Move `goal` [3, 4] and `target` [n] in place; return motor speeds, torques and weight [n]."""
    real, points, directions, frames = forward(base, origins, axes, slides, positions)
    hold = holding(points, directions, frames, slides, masses, centres, lags)
    here = jacobian(real, points, directions, slides)
    wished = goal.copy()
    for r in range(3):
        wished[r, 3] += twist[r] * duration
    turned = np.empty((3, 4))
    rotated(wished, twist[3:] * duration, turned)
    _give_way(turned, real, here, hold - torques, twist, duration, leash, contact_force)

    n = len(target)
    start = target.copy()
    speed = math.sqrt((twist[:3] ** 2).sum()) + 0.2 * math.sqrt((twist[3:] ** 2).sum())
    pull = REST_PULL * min(speed / 0.25, 1.0) * duration * (rest - start)
    error = np.empty(6)
    for k in range(4):
        tip, points, directions, _ = forward(base, origins, axes, slides, target)
        for r in range(3):
            error[r] = turned[r, 3] - tip[r, 3]
        error[3:] = weight * rotation_between(tip, turned)
        if k > 0 and (error**2).sum() < 1e-10:
            break
        matrix = jacobian(tip, points, directions, slides)
        matrix[3:] *= weight
        target += bounded_step(matrix, error, target, lower, upper, pull, DAMPING)
        pull = np.zeros(n)

    # Too far for the joints in one step: go a part of the way, in the same direction.
    part = 1.0
    for i in range(n):
        way = abs(target[i] - start[i])
        if way > velocity[i] * duration * part:
            part = part if way == 0 else min(part, velocity[i] * duration / way)
    if part < 1:
        target[:] = start + part * (target - start)
    tip, _, _, _ = forward(base, origins, axes, slides, target)
    missed = rotation_between(tip, turned)
    gap = 0.0
    for r in range(3):
        gap += (turned[r, 3] - tip[r, 3]) ** 2
    # What the joints cannot reach is forgotten: it would only have to be undone later.
    goal[:] = tip if gap > 1e-6 or (missed**2).sum() > 1e-5 else turned

    forces, speeds = np.empty(n), np.empty(n)
    for i in range(n):
        lever = math.sqrt(here[0, i] ** 2 + here[1, i] ** 2 + here[2, i] ** 2)
        need = HEADROOM * contact_force * lever + 0.1 * effort[i]
        forces[i] = min(need, effort[i])
        way = abs(target[i] - positions[i])
        speeds[i] = min(max(way / duration, RETURN_SPEED), velocity[i])
    return speeds, forces, hold


@numba.njit(cache=True)
def _give_way(goal, real, matrix, outside, twist, duration, leash, contact_force):  # type: ignore[no-untyped-def]
    """Pull `goal` back onto the leash from `real`, and further where the tool is pushed hard."""
    gap = goal[:, 3] - real[:, 3]
    reach = leash[0] + duration * math.sqrt((twist[:3] ** 2).sum())
    length = math.sqrt((gap**2).sum())
    if length > reach:
        gap *= reach / length
    # The force at the tool from the torques that gravity does not explain: J^T F = outside.
    force = least_squares(matrix.T.copy(), outside, np.ones(6, np.bool_), 0.05)[:3]
    size = math.sqrt((force**2).sum())
    if size > FELT * contact_force:
        along = force / size  # points out of what is touched
        into = -(gap * along).sum()
        # The harder the contact the smaller the way into it, and beyond the limit a way back.
        allowed = max(1 - size / contact_force, -2.0) * YIELD
        if into > allowed:
            gap += (into - allowed) * along
    goal[:, 3] = real[:, 3] + gap
    turn = rotation_between(real, goal)
    angle = math.sqrt((turn**2).sum())
    most = leash[1] + duration * math.sqrt((twist[3:] ** 2).sum())
    if angle > most:
        held = np.empty((3, 4))
        start = goal.copy()
        start[:, :3] = real[:, :3]
        rotated(start, turn * (most / angle), held)
        goal[:] = held
