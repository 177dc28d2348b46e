"""Control by changes of the tool's pose."""

from __future__ import annotations

import math
from collections.abc import Callable

import numba
import numpy as np

from rcare_marl import pose as poses
from rcare_marl.pose import Array, Pose
from rcare_marl.tree.joint_tree import Tree, gravity_torques, jacobian, new_frames
from rcare_marl.tree.least_squares import (
    bounded_step,
    least_squares,
    put,
    rotation_vector,
    turn_frame,
)
from rcare_marl.world import GRAVITY

from ..arm import Arm
from ..joint_group import RETURN_SPEED, JointGroup
from ..kinematics import place_chain
from ..robot_config import BASE_JOINTS
from .control import ToolMotion

REST_PULL = 0.5  # [1/s] towards the rest posture, at full speed of the tool
HEADROOM = 1.5  # motor torque over what `contact_force` at the tool takes
FELT = 0.4  # share of `contact_force` that counts as contact
YIELD = 0.002  # way of the target into a light contact, and back out of one twice too hard [m]
DAMPING = 0.01  # of the least squares
# Weight of a radian against a metre where fewer than six joints cannot do both: place comes first.
FEW_JOINTS_TURN = 0.03
# Of a link that comes near what it is kept clear of; our own choices. The way that it keeps [m], and the
# share of the rest by which it may come nearer [1/s]; with what the tool's place and turn are spared where
# other joints can make room [m/rad].
CLOSE, NEARING = 0.006, 3.0
SPARING = 0.1
LEVER = 0.1  # [m/rad] that joints move a link at least that is to get away
SWEEPS = 8  # over all that is near
# An arm that weighs itself; our own choices. A load off the tool's point changes what it finds by 4 %.
AS_KNOWN = 0.1  # share by which it may differ from its model and still counts as known
# Share of the torques that its weight may leave open: more, and something touches it.
UNEXPLAINED = 0.05


class ToolDelta(ToolMotion):
    """Six values move a target of the tool's pose: three along, three about the world's axes.

    Joints follow the target by damped least squares within their position and speed limits. Three
    things keep contact gentle: the target stays on a short leash from the real tool; it gives way
    where the motors feel more than `contact_force` at the tool; and motors get no more torque than
    that force needs, with some room for acceleration. A fourth keeps all links clear of what `near` names:
    each link comes nearer the slower the nearer it is (a velocity damper: Faverjon & Tournassoud 1987), the
    elbow giving way before the tool does. For that limit of the motors the weight of the arm is carried by
    torques of its own, which the limits of the motors could not tell from a push. An arm that is heavier or
    lighter than its model weighs itself in the first control step of an episode, as real ones are calibrated
    before somebody is near; else it would take its own weight for a push.

    Attributes:
        contact_force: Force at the tool from which the target gives way [N].
        contact_torque: Torque with which the tool may turn what it holds, if its motors can [N·m]; else they
            get a tenth of what they can, beside what that force takes.
        weight_share: Share of the weight in its model that the arm has, as it weighed itself.
    """

    LEASH = (0.03, 0.25)  # [m], [rad]
    CONTACT_FORCE = 15.0  # [N]
    needs_actuation = True
    is_steady = True  # whether what motors do changes with commands alone

    def __init__(self, arm: Arm) -> None:
        super().__init__()
        self.contact_force, self.contact_torque = self.CONTACT_FORCE, 0.0
        self._arm = arm
        self._movers = {
            link: k for k, joint in enumerate(arm.indices) for link in arm.body.carried_by(joint)
        }
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
        self._joints: Array | None = None  # where the next command goes in place of its action
        self.weight_share, self._is_weighed = 1.0, False

    def go_to(self, joints: Array) -> None:
        """Let the next command drive the joints there [rad or m], shape [n], whatever its action.

        They go no farther than their limits and speeds allow, and do not give way to contact.
        """
        self._joints = np.asarray(joints, np.float64)

    def reset(self) -> None:
        arm, chain = self._arm, self._arm.chain
        self._target = arm.positions()
        self._steps_left, self.near = -1, ()
        self._goal[:] = chain.tip_frame(self._target)
        self.weight_share, self._is_weighed = 1.0, False
        self._drive(arm.velocity, arm.effort, chain.gravity_torques(self._target))

    def _drive(self, speeds: Array, forces: Array, weight: Array) -> None:
        """Drive to the target, within the effort beside the weight of the arm."""
        arm = self._arm
        room = arm.room(weight)
        if self._has_base:
            room = np.where(self._is_base, arm.effort, room)
        forces = np.minimum(forces, room)
        self._hold = arm.carry(weight, forces, self.weight_share)
        self._push = tuple(self._hold.tolist())
        arm.drive_to(self._target, speeds, forces)

    def command(self, action: Array, duration: float) -> None:
        arm, chain = self._arm, self._arm.chain
        positions, velocities, torques = arm.read()
        if self._joints is not None:
            self._go(positions, duration)
            return
        if self._steps_left == 0:  # the step ran as planned: leave out the torque to speed up
            rate = (velocities - self._velocities) / arm.physics_dt
            torques = torques + self._hold
            if not self._is_weighed:
                self._weigh(positions, torques, rate)
            torques = torques - self.weight_share * arm.inertial_torques(positions, rate)
        else:  # nothing can be told of what the motors felt
            torques = self.weight_share * chain.gravity_torques(positions)
        self._steps_left = max(round(duration / arm.physics_dt), 1)
        speeds, forces, weight = _follow(
            chain.arrays,
            chain.tip,
            (arm.lower, arm.upper, arm.velocity, arm.effort, arm.rest),
            self._goal,
            self._target,
            (positions, torques),
            self._wished_twist(action, duration),
            duration,
            (
                *self.LEASH,
                self.contact_force,
                self.contact_torque,
                self._turn_weight,
                self.weight_share,
            ),
        )
        if self.near and self._keep_clear(positions, duration):
            speeds = arm.speeds_for(np.abs(self._target - positions), duration)
        if self._has_base:  # it has the whole robot to speed up
            forces = np.where(self._is_base, arm.effort, forces)
        self._drive(speeds, forces, weight)

    def _keep_clear(self, positions: Array, duration: float) -> bool:
        """Move the target out of where links would come too near, or near too fast; return whether it was.

        Args:
            positions: Of the joints [rad or m], shape [n].
            duration: Of the control step [s].
        """
        arm, chain = self._arm, self._arm.chain
        tool = chain.jacobian(positions)
        stiffness = tool.T @ tool + SPARING**2 * np.eye(len(positions))
        ease = np.linalg.inv(stiffness)
        target, free = self._target.copy(), np.ones(len(positions), bool)
        bounds = []
        for link, other, point, away, gap, coming in self.near:
            if link in self._movers:
                moved = chain.point_jacobian(positions, self._movers[link], np.array(point))
                if other in self.carried:  # it comes as the tool goes
                    moved, coming = moved - tool[:3], 0.0
                slope = np.array(away) @ moved
                if float(slope @ slope) > LEVER**2:
                    least = NEARING * (CLOSE - gap) + max(coming, 0.0)
                    bounds.append((slope, least * duration))
        for _ in range(SWEEPS):
            for slope, least in bounds:
                short = least - float(slope @ (target - positions))
                if short > 0 and (gain := float(slope @ ease @ slope)) > 0:
                    target += ease @ slope * (short / gain)
            held = np.clip(target, arm.lower, arm.upper)
            if not np.array_equal(held, target):  # the others make up for who is at a limit
                free &= held == target
                ease = np.zeros_like(stiffness)
                ease[np.ix_(free, free)] = np.linalg.inv(stiffness[np.ix_(free, free)])
                target = held
        if np.array_equal(target, self._target):
            return False
        self._target = target
        self._goal[:] = chain.tip_frame(target)
        return True

    def _weigh(self, positions: Array, torques: Array, rate: Array) -> None:
        """Tell the arm's own weight from that of what its hand holds, by what its motors bear and speed up.

        Args:
            positions: Of the joints [rad or m], shape [n].
            torques: Of the motors [N·m or N], shape [n].
            rate: Of the joints' velocities [rad/s² or m/s²], shape [n].
        """
        arm, chain, self._is_weighed = self._arm, self._arm.chain, True
        tool = chain.jacobian(positions)[:3]
        weights = np.stack((chain.gravity_torques(positions), tool[2]), 1)
        if np.linalg.matrix_rank(weights, tol=1e-6 * float(np.linalg.norm(weights))) < 2:
            return  # one joint alone bears it all, as a Stretch's lift does
        speeding = np.stack(
            (arm.inertial_torques(positions, rate), tool.T @ (tool @ rate) / GRAVITY), 1
        )
        causes = weights + speeding
        found = np.linalg.lstsq(causes, torques, rcond=None)[0]
        if np.linalg.norm(causes @ found - torques) > UNEXPLAINED * np.linalg.norm(torques):
            return  # more than weight is felt
        if abs(found[0] - 1.0) > AS_KNOWN:
            self.weight_share = float(found[0])

    def _wished_twist(self, action: Array, duration: float) -> Array:
        """Return how fast the target is to move [m/s] and turn [rad/s], shape [6]."""
        return self.max * action

    def _go(self, positions: Array, duration: float) -> None:
        arm, chain = self._arm, self._arm.chain
        assert self._joints is not None
        most = arm.velocity * duration
        wanted = np.clip(self._joints, arm.lower, arm.upper)
        self._target = np.clip(wanted, positions - most, positions + most)
        self._goal[:] = chain.tip_frame(self._target)
        self._joints, self._steps_left = None, -1
        speeds = arm.speeds_for(np.abs(self._target - positions), duration)
        self._drive(speeds, arm.effort, self.weight_share * chain.gravity_torques(positions))

    @property
    def steady(self) -> tuple[JointGroup, tuple[float, ...]]:
        """What `actuate` pushes until the next command: joints, and their torques [N·m or N]."""
        return self._arm, self._push

    def pass_steps(self, count: int, velocities: Array) -> None:
        """Take note that physics steps were made with that push.

        Args:
            count: How many.
            velocities: Of the joints before the last of them [rad/s or m/s], shape [n].
        """
        self._steps_left -= count
        if self._steps_left == 0:
            self._velocities = velocities

    def actuate(self) -> None:
        """Carry the weight of the arm."""
        self._steps_left -= 1
        if self._steps_left == 0:
            self._velocities = self._arm.velocities()
        self._arm.drive_torques(self._push)


class ToolServo(ToolDelta):
    """`ToolDelta` of at least `RATE`: an action holds until the next, and may come at any time.

    Attributes:
        on_step: Called before each physics step, by who keeps time and hands in what is wanted by then.
    """

    RATE = 100.0  # [Hz]; our own choice
    is_steady = False

    def __init__(self, arm: Arm) -> None:
        super().__init__(arm)
        self.on_step: Callable[[], None] = lambda: None
        self._every = max(int(1.0 / (self.RATE * arm.physics_dt) + 1e-9), 1)  # physics steps
        self._wanted, self._count = np.zeros(self.size), 0

    def reset(self) -> None:
        super().reset()
        self._wanted, self._count = np.zeros(self.size), 0

    def command(self, action: Array, duration: float) -> None:
        self._wanted = action

    def actuate(self) -> None:
        """Follow what is wanted now, and carry the weight of the arm."""
        self.on_step()
        if self._count % self._every == 0:
            super().command(self._wanted, self._every * self._arm.physics_dt)
        self._count += 1
        super().actuate()


class ToolPose(ToolDelta):
    """Six values say where the tool is to be in the frame of the robot's root: place, and rotation vector.

    A value of 1 is `REACH` along, and half a turn about each axis. The target goes there no faster than
    that of `ToolDelta`, and is as gentle.
    """

    REACH = 1.5  # [m]; our own choice

    def __init__(self, arm: Arm) -> None:
        super().__init__(arm)
        self.names = (
            *(f"tool at {axis} [m]" for axis in "xyz"),
            *(f"tool turned about {axis} [rad]" for axis in "xyz"),
        )
        self._most = self.max
        self.max = np.array([self.REACH] * 3 + [math.pi] * 3)

    def action_for(self, pose: Pose) -> Array:
        """Return the action that asks for a pose of the tool in the world, shape [6]."""
        own = self._arm.body.base_pose().inverse() @ pose
        wish = np.concatenate((own.position, poses.rotation_vector(own.quaternion)))
        return np.clip(wish / self.max, -1.0, 1.0)

    def _wished_twist(self, action: Array, duration: float) -> Array:
        wish = self.max * action
        angle = float(np.linalg.norm(wish[3:]))
        axis = wish[3:] / max(angle, 1e-9)
        turn = poses.quaternion_from_axis_angle(tuple(axis.tolist()), angle)
        own = Pose(tuple(wish[:3].tolist()), tuple(turn.tolist()))
        there = np.ascontiguousarray((self._arm.body.base_pose() @ own).matrix()[:3])
        way = np.concatenate((there[:, 3] - self._goal[:, 3], rotation_vector(there, self._goal)))
        return np.asarray(way / max(duration, float((np.abs(way) / self._most).max())))


@numba.njit(cache=True)
def _follow(arrays, tip, limits, goal, target, felt, twist, duration, gentleness):  # type: ignore[no-untyped-def]
    """Move `goal` [3, 4] and `target` [n] in place; return motor speeds, torques and weight [n].

    Args:
        arrays: The fields of the arm's `Tree`.
        tip: Frame of the tool in the last part, shape [3, 4].
        limits: Lower and upper limits, greatest speeds, greatest torques, rest posture, each [n].
        goal: Where the tool is to be, shape [3, 4].
        target: Where the joints are to be, shape [n].
        felt: Positions and motor torques now, each [n].
        twist: Wished velocity of the tool [m/s] and [rad/s], shape [6].
        duration: Of the control step [s].
        gentleness: Leash [m] and [rad], contact force [N] and torque [N·m], weight of a radian against a
            metre, and the share of its known weight that the arm has.
    """
    positions, torques = felt
    lower, upper, velocity, effort, rest = limits
    _, _, contact_force, contact_torque, weight, share = gentleness
    tree, frames = Tree(*arrays), new_frames(len(target))
    real, there = np.empty((3, 4)), np.empty((3, 4))
    place_chain(tree, tip, positions, frames, real)
    last = len(target) - 1
    hold = share * gravity_torques(tree, positions, frames, GRAVITY)
    here = jacobian(tree, frames, last, real[:, 3])
    turned = goal.copy()
    put(goal[:, 3] + twist[:3] * duration, turned[:, 3])
    turn_frame(turned, twist[3:] * duration)
    _give_way(turned, real, here, hold - torques, twist, duration, gentleness)

    n = len(target)
    start = target.copy()
    pull = _pull(rest - start, upper, twist) * duration
    error = np.empty(6)
    for k in range(4):
        place_chain(tree, tip, target, frames, there)
        put(turned[:, 3] - there[:, 3], error[:3])
        put(weight * rotation_vector(turned, there), error[3:])
        if k > 0 and (error**2).sum() < 1e-10:
            break
        matrix = jacobian(tree, frames, last, there[:, 3])
        np.multiply(matrix[3:], weight, matrix[3:])
        target += bounded_step(matrix, error, target, lower, upper, pull, DAMPING)
        pull = np.zeros(n)

    # Too far for the joints in one step: go a part of the way, in the same direction.
    part = 1.0
    for i in range(n):
        way = abs(target[i] - start[i])
        if way > velocity[i] * duration * part:
            part = part if way == 0 else min(part, velocity[i] * duration / way)
    if part < 1:
        put(start + part * (target - start), target)
    place_chain(tree, tip, target, frames, there)
    missed = rotation_vector(turned, there)
    gap = ((turned[:, 3] - there[:, 3]) ** 2).sum()
    # What the joints cannot reach is forgotten: it would only have to be undone later.
    found = there if gap > 1e-6 or (missed**2).sum() > 1e-5 else turned
    for r in range(3):
        put(found[r], goal[r])

    forces, speeds = np.empty(n), np.empty(n)
    for i in range(n):
        lever = math.sqrt(here[0, i] ** 2 + here[1, i] ** 2 + here[2, i] ** 2)
        turning = math.sqrt(here[3, i] ** 2 + here[4, i] ** 2 + here[5, i] ** 2) * contact_torque
        need = HEADROOM * contact_force * lever + max(0.1 * effort[i], turning)
        forces[i] = min(need, effort[i])
        way = abs(target[i] - positions[i])
        speeds[i] = min(max(way / duration, RETURN_SPEED), velocity[i])
    return speeds, forces, hold


@numba.njit(cache=True)
def _pull(away, upper, twist):  # type: ignore[no-untyped-def]
    """Return how fast joints are drawn to rest [n], the shorter way where they turn without limit."""
    for i in range(len(away)):
        if upper[i] == math.inf:
            away[i] -= 2 * math.pi * np.rint(away[i] / (2 * math.pi))
    speed = math.sqrt((twist[:3] ** 2).sum()) + 0.2 * math.sqrt((twist[3:] ** 2).sum())
    return REST_PULL * min(speed / 0.25, 1.0) * away


@numba.njit(cache=True)
def _give_way(goal, real, matrix, outside, twist, duration, gentleness) -> None:  # type: ignore[no-untyped-def]
    """Pull `goal` back onto the leash from `real`, and further where the tool is pushed hard."""
    leash, turn_leash, contact_force, _, _, _ = gentleness
    gap = goal[:, 3] - real[:, 3]
    reach = leash + duration * math.sqrt((twist[:3] ** 2).sum())
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
    put(real[:, 3] + gap, goal[:, 3])
    turn = rotation_vector(goal, real)
    angle = math.sqrt((turn**2).sum())
    most = turn_leash + duration * math.sqrt((twist[3:] ** 2).sum())
    if angle > most:
        for r in range(3):
            put(real[r, :3], goal[r, :3])
        turn_frame(goal, turn * (most / angle))
