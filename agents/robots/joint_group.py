"""Joints of a robot that are read and driven together, with those that follow them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from rcare_marl.body import Body
from rcare_marl.model.urdf import Follow
from rcare_marl.pose import Array
from rcare_marl.world import World

Mask = npt.NDArray[np.bool_]  # which joints of a group, shape [n]
# Share of the position error that a motor removes in one physics step, up to the planned speed. All
# of it, so that the speed is even to the end: a motor that brakes there would feel its own inertia.
POSITION_GAIN = 1.0
# The same for the first joint of a telescope: with all of it, motor and gear shake each other (0.5 mm;
# with a fifth, nothing is felt at the wrist).
TELESCOPE_GAIN = 0.2
# Speed that is always allowed, so that a joint that was pushed away can come back [rad/s or m/s].
RETURN_SPEED = 0.01


class JointGroup:
    """The joints that an action moves, with fast ways to read and to drive them.

    Bullet ignores `<mimic>`, so we move joints that follow another one along with it. The segments of
    a telescope are geared to the first, which has the effort of all on their common way, after the
    principle of virtual work: four that push with 100 N each move the tip four times as far as one,
    and so have 400 N on the way of the first. Other followers have motors of their own.

    Attributes:
        world: Where they are.
        names: Joint names, base to tip.
        lower: Lower limits [rad or m], shape [n]; -inf for continuous joints.
        upper: Upper limits [rad or m], shape [n]; inf for continuous joints.
        velocity: Greatest speeds [rad/s or m/s], shape [n].
        effort: Greatest torques or forces [N·m or N], shape [n].
        rest: Start posture, shape [n].
        units: Unit of each position, `rad` or `m`.
        has_followers: Whether other joints with motors of their own follow those of the group.
        motor_gain: Times the share of the position error that motors remove in a physics step.
        motor_strength: Times the greatest torques or forces that motors are told.
    """

    motor_gain: float = 1.0
    motor_strength: float = 1.0

    def __init__(
        self,
        world: World,
        body: Body,
        names: Sequence[str],
        rest: Sequence[float],
        followers: Mapping[str, Follow] | None = None,
        telescope: Collection[str] = (),
    ) -> None:
        """Take hold of joints of a spawned body.

        Args:
            world: Where the body is.
            body: The body.
            names: The joints.
            rest: Start posture [rad or m], shape [n].
            followers: How joints follow those of `names`, by name.
            telescope: Those of them that lie on the way to the tip.
        """
        self.body, self.names = body, tuple(names)
        self.world = world
        self.physics_dt = world.physics_dt
        joints = [body.joint(name) for name in self.names]
        self.indices = [joint.index for joint in joints]
        self.lower = np.array([joint.lower for joint in joints])
        self.upper = np.array([joint.upper for joint in joints])
        self.velocity = np.array([joint.velocity for joint in joints])
        self.effort = np.array([joint.effort for joint in joints])
        self.rest = np.array(rest, np.float64)
        self.units = tuple("m" if joint.kind == "prismatic" else "rad" for joint in joints)
        self._dofs = [joint.dof for joint in joints]
        self._all = [joint.index for joint in body.joints.values()]
        self._is_whole = self._all == self.indices
        self._asked, self._places = self.indices, list(range(len(joints)))  # what `read` asks for
        self._read_at = (-1, -1)
        self._bind_followers(followers or {}, telescope)
        first = 6 if body.is_movable else 0  # the mass matrix begins with a free base
        dofs = [first + dof for dof in (*self._dofs, *self._segment_dofs)]
        # Of the mass matrix; None where that is all of it.
        is_all = dofs == list(range(first + len(self._all)))
        self._block = None if is_all else np.ix_(dofs, dofs)
        self._told: tuple[float, ...] | None = None  # torques that `_push` applies
        self._push: Callable[[], object] = tuple
        self._along = np.eye(len(dofs), len(self))  # joint speeds for each speed of the group
        self._along[range(len(self), len(dofs)), self._segment_leaders] = self._segment_ways

    def _bind_followers(self, followers: Mapping[str, Follow], telescope: Collection[str]) -> None:
        """Find the joints that follow, and share out the effort."""
        segments = {name: rule for name, rule in followers.items() if name in telescope}
        for name, rule in segments.items():
            joint, i = self.body.joint(name), self.names.index(rule.joint)
            self.effort[i] += abs(rule.multiplier) * joint.effort
        self._segments = [self.body.joint(name).index for name in segments]
        self._segment_dofs = [self.body.joint(name).dof for name in segments]
        self._segment_leaders = [self.names.index(rule.joint) for rule in segments.values()]
        self._segment_ways = np.array([rule.multiplier for rule in segments.values()])
        self.body.release_motors(self._segments)
        for index, i, way in zip(
            self._segments, self._segment_leaders, self._segment_ways.tolist(), strict=True
        ):
            force = 10 * float(self.effort[i])  # a gear that gives nothing
            self.body.gear(self.indices[i], index, way, force)
        telescopes = {self.indices[i] for i in self._segment_leaders}
        others = {name: rule for name, rule in followers.items() if name not in telescope}
        joints = [self.body.joint(name) for name in others]
        self._follower_indices = [joint.index for joint in joints]
        self._gains = {
            index: TELESCOPE_GAIN if index in telescopes else POSITION_GAIN
            for index in (*self.indices, *self._follower_indices)
        }
        self._leaders = [self.names.index(rule.joint) for rule in others.values()]
        self._multipliers = np.array([rule.multiplier for rule in others.values()])
        self._offsets = np.array([rule.offset for rule in others.values()])
        self.has_followers = bool(others)
        self._own_effort = np.array([joint.effort for joint in joints])

    def __len__(self) -> int:
        return len(self.names)

    def read(self) -> tuple[Array, Array, Array]:
        """Return positions, velocities and motor torques of the last step, each of shape [n].

        What was read since the world last moved is returned again: do not write into it.
        """
        now = (self.world.step_count, self.world.teleports)
        if now != self._read_at:
            self._read_at = now
            positions, velocities, torques = self.body.joint_readings(self._asked)
            self._everything = positions.tolist()
            if self._asked is not self.indices:  # more than its own
                own = self._places
                positions, velocities, torques = positions[own], velocities[own], torques[own]
            self._read = positions, velocities, torques
        return self._read

    def positions(self) -> Array:
        """Return the joint positions [rad or m], shape [n]."""
        return np.array(self.body.joint_states(self.indices)[0])

    def velocities(self) -> Array:
        """Return the joint velocities [rad/s or m/s], shape [n]."""
        return np.array(self.body.joint_states(self.indices)[1])

    def states(self) -> tuple[Array, Array]:
        """Return positions and velocities, each of shape [n]."""
        positions, velocities = self.body.joint_states(self.indices)
        return np.array(positions), np.array(velocities)

    def teleport(self, positions: Array) -> None:
        """Put the joints at `positions` [rad or m], shape [n], at rest."""
        self.body.set_joints(self.indices, positions)
        if self._segments:
            self.body.set_joints(
                self._segments, self._segment_ways * np.asarray(positions)[self._segment_leaders]
            )
        if self._leaders:
            self.body.set_joints(self._follower_indices, self._followed(positions))

    def _followed(self, positions: Array) -> Array:
        return np.asarray(self._multipliers * positions[self._leaders] + self._offsets)

    def inertial_torques(self, positions: Array, acceleration: Array) -> Array:
        """Return the torques that accelerate the group [N·m or N], shape [n], without speed terms."""
        return np.asarray(self.mass_matrix(positions) @ acceleration)

    def mass_matrix(self, positions: Array) -> Array:
        """Return the mass matrix of the group, the body held by its base, shape [n, n]."""
        everything = positions.tolist()
        if not self._is_whole:
            if self._asked is not self._all:  # from now on `read` asks for all at once
                self._asked, self._read_at = self._all, (-1, -1)
                self._places = [self._all.index(index) for index in self.indices]
            self.read()
            everything = self._everything
        matrix = self.body.mass_matrix(everything)
        if self._block is not None:
            matrix = matrix[self._block]
        if not self._segments:
            return matrix
        return np.asarray(self._along.T @ matrix @ self._along)

    def drive_to(
        self, targets: Array, speeds: Array, forces: Array, *, only: Mask | None = None
    ) -> None:
        """Drive joints to `targets` [rad or m] no faster than `speeds`, with at most `forces`.

        The speed limit spreads a control step's way evenly over its physics steps: without it the
        motor would jump at each command. With `only`, a mask of shape [n], the other joints stay
        under the command that they have, and joints that follow need `align`.
        """
        if only is not None:
            indices = [index for index, chosen in zip(self.indices, only, strict=True) if chosen]
            self._drive_each(indices, targets[only], speeds[only], forces[only])
            return
        self._drive_each(self.indices, targets, speeds, forces)
        if self._leaders:
            self._drive_followers(targets, speeds)

    def _drive_followers(self, targets: Array, speeds: Array) -> None:
        speeds = np.abs(self._multipliers) * speeds[self._leaders]
        places = self._followed(targets)
        self._drive_each(self._follower_indices, places, speeds, self._own_effort)

    def _drive_each(
        self, indices: Sequence[int], targets: Array, speeds: Array, forces: Array
    ) -> None:
        gains = [self.motor_gain * self._gains[index] for index in indices]
        forces = self.motor_strength * forces
        self.body.drive_to(indices, targets.tolist(), speeds.tolist(), forces.tolist(), gains)

    def speeds_for(self, way: Array, duration: float) -> Array:
        """Return motor speeds that cover `way` [rad or m] in `duration` [s], within limits."""
        return np.minimum(np.maximum(way / duration, RETURN_SPEED), self.velocity)

    def drive_velocities(self, speeds: Array, forces: Array) -> None:
        """Drive joints at `speeds` [rad/s or m/s] with at most `forces` [N·m or N].

        Joints that follow need `align` before every physics step.
        """
        forces = self.motor_strength * forces
        self.body.drive_velocities(self.indices, speeds.tolist(), forces.tolist())

    def align(self) -> None:
        """Drive the joints that follow to where the others are now, for a physics step."""
        if self._leaders:
            self._drive_followers(self.positions(), self.velocity)

    def drive_torques(self, torques: Sequence[float]) -> None:
        """Apply `torques` [N·m or N], shape [n], for one physics step.

        A list is faster than an array, and a tuple that is given step after step than both. Of a list, all
        segments of a telescope bear the same share, so that its gears bear none.
        """
        if torques is self._told:
            self._push()
        elif isinstance(torques, tuple) and not self.body.may_sleep:
            self._told = torques
            self._push = self.body.pushing(self.indices, torques)
            self._push()
        elif self._segments:
            own = np.asarray(torques) / (self._along**2).sum(axis=0)
            everything = (self._along @ own).tolist()
            self.body.drive_torques([*self.indices, *self._segments], everything)
        else:
            self.body.drive_torques(self.indices, torques)

    def limit_speed(self) -> None:
        """Let the physics cut all joint speeds a fifth above the greatest that any joint may have.

        For modes whose motors do not rule the speed.
        """
        self.body.limit_speed(1.2 * float(self.velocity.max()))
