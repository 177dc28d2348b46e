"""A handle on one multibody: names in, numbers out. The state stays in the physics client."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .body_part import SHAPE_NAMES, Gear, Joint, State, Touching, VisualShape
from .bullet import bullet
from .errors import check_name
from .joint_feedback import JointFeedback
from .model.urdf import Model
from .pose import Array, Pose, Vector, matrix_from_quaternion

if TYPE_CHECKING:
    from .world import World


GEAR_ERP = 0.9  # of what Bullet removes of the position error of bonds in one physics step
FIRST_OWN_GROUP, OWN_GROUPS = 64, 20  # collision groups; Bullet uses the lower ones itself


class Body:
    """A handle on one multibody of a world; it holds names and indices, never state.

    Attributes:
        uid: Body id in the physics client.
        name: Name given by the loader, unique in its world.
        joints: The movable joints by name.
        links: Link indices by name; the base is -1 and is found under its own name and as `base`.
        is_movable: Whether the base can move.
        may_sleep: Whether it sleeps while it is still; see `SleepingBodies`.
        source: The URDF file that it was read from, or the model.
        meets_itself: Whether links that are not parent and child collide.
        meeting: Pairs of own links that collide though the others do not, see `let_meet`.
        gears: Joints that the physics couples.
        friction: Dry friction [N·m or N] of the joints that have no motor, by index.
    """

    def __init__(self, world: World, uid: int, name: str, source: Path | Model) -> None:
        self._world, self._client, self.uid, self.name = world, world.client, uid, name
        self.source, self.meets_itself = source, False
        self.gears: list[Gear] = []
        base_link = bullet.getBodyInfo(uid, physicsClientId=self._client)[0].decode()
        self.links: dict[str, int] = {"base": -1, base_link: -1}
        self.joints: dict[str, Joint] = {}
        for index in range(bullet.getNumJoints(uid, physicsClientId=self._client)):
            info = bullet.getJointInfo(uid, index, physicsClientId=self._client)
            self.links[info[12].decode()] = index
            if info[2] == bullet.JOINT_FIXED:
                continue
            lower, upper = (info[8], info[9]) if info[8] <= info[9] else (-np.inf, np.inf)
            kind = "prismatic" if info[2] == bullet.JOINT_PRISMATIC else "revolute"
            self.joints[info[1].decode()] = Joint(
                index, kind, lower, upper, info[10], info[11], len(self.joints)
            )
        self.link_names = {index: link for link, index in self.links.items()}
        self.link_count = max(self.links.values()) + 1  # without the base
        dynamics = bullet.getDynamicsInfo(uid, -1, physicsClientId=self._client)
        self.is_movable = dynamics[0] > 0
        self._inertial = Pose(dynamics[3], dynamics[4])
        self._from_inertial = self._inertial.inverse()
        self._has_offset = self._inertial != Pose()
        self.meeting: list[tuple[int, int]] = []  # own links that collide, see `let_meet`
        self.friction: dict[int, float] = {}
        self.may_sleep = False

    def indices(self, joints: Iterable[str]) -> list[int]:
        """Return the indices of the named movable joints.

        Raises:
            UnknownNameError: If there is no movable joint of that name.
        """
        return [self.joint(name).index for name in joints]

    def joint(self, name: str) -> Joint:
        """Return the movable joint `name`; UnknownNameError if there is none."""
        check_name("movable joint", name, self.joints)
        return self.joints[name]

    def link_index(self, link: str) -> int:
        """Return the index of the named link; UnknownNameError if there is none."""
        check_name("link", link, self.links)
        return self.links[link]

    def mass(self, link: int | None = None) -> float:
        """Return the mass of one link, or of the whole body [kg]."""
        links = range(-1, self.link_count) if link is None else (link,)
        return float(sum(bullet.getDynamicsInfo(self.uid, i, self._client)[0] for i in links))

    def state(self) -> Array:
        """Return base pose and velocity, all joints and their rates, exactly [SI], shape [13 + 2 joints]."""
        place = bullet.getBasePositionAndOrientation(self.uid, self._client)
        motion = bullet.getBaseVelocity(self.uid, self._client)
        return np.concatenate([*place, *motion, *self.joint_states(range(self.link_count))])

    def joint_states(self, indices: Sequence[int]) -> tuple[list[float], list[float]]:
        """Return positions [rad or m] and velocities [rad/s or m/s] of joints, each of length n."""
        states = bullet.getJointStates(self.uid, indices, self._client) or ()  # None of no joint
        return [s[0] for s in states], [s[1] for s in states]

    def joint_torques(self, indices: Sequence[int]) -> list[float]:
        """Return what the motors of joints applied in the last physics step [N·m or N]."""
        return [s[3] for s in bullet.getJointStates(self.uid, indices, self._client)]

    def joint_readings(self, indices: Sequence[int]) -> tuple[Array, ...]:
        """Return positions [rad or m], velocities and motor torques of joints, each of shape [n]."""
        found = bullet.getJointStates(self.uid, indices, self._client)
        return tuple(np.array([state[k] for state in found]) for k in (0, 1, 3))

    @cached_property
    def feedback(self) -> JointFeedback:
        """What the joints transmit."""
        return JointFeedback(self, self._client)

    def has_motor(self, index: int) -> bool:
        """Whether a joint is driven by a motor; not after `release_motors` without friction."""
        return self.friction.get(index) != 0.0

    def centre_state(self, link: int) -> State:
        """Return how the centre of mass of a link is and moves in the world, 13 numbers; -1 is the base.

        Position [m], quaternion of the principal axes, velocity [m/s] and rate of turning [rad/s].
        """
        if link >= 0:
            return self.centre_states((link,))[0]
        (place, turn), motion = self.centre_pose(), bullet.getBaseVelocity(self.uid, self._client)
        return (*place, *turn, *motion[0], *motion[1])

    def centre_states(self, links: Sequence[int]) -> Sequence[State]:
        """Return `centre_state` of some links; not of the base."""
        states = bullet.getLinkStates(self.uid, links, 1, 1, self._client)
        return [(*s[0], *s[1], *s[6], *s[7]) for s in states]

    def centre_places(self, links: Sequence[int]) -> Sequence[State]:
        """Return the first seven numbers of `centre_state` of some links; not of the base."""
        return [s[0] + s[1] for s in bullet.getLinkStates(self.uid, links, 0, 1, self._client)]

    def link_centres(self, links: Sequence[int]) -> Array:
        """Return the centres of mass of `links` in the world [m], shape [n, 3]; not of the base."""
        return np.array([place[:3] for place in self.centre_places(links)]).reshape(-1, 3)

    def carried_by(self, link: int) -> list[int]:
        """Return `link` and all links that it carries, directly or not."""
        found = {link}
        for index in range(link + 1, self.link_count):  # parents come before children
            if bullet.getJointInfo(self.uid, index, physicsClientId=self._client)[16] in found:
                found.add(index)
        return sorted(found)

    def solid_links(self) -> list[int]:
        """Return the indices of the links that have a collision shape."""
        shapes, client = bullet.getCollisionShapeData, self._client
        return [i for i in self.link_names if shapes(self.uid, i, physicsClientId=client)]

    def own_gap(self, a: int, b: int) -> float:
        """Return the distance between two links [m], negative where they overlap; 0.01 if farther."""
        near = bullet.getClosestPoints(self.uid, self.uid, 0.01, a, b, physicsClientId=self._client)
        return min((float(point[8]) for point in near), default=0.01)

    def exclude_pairs(self, pairs: Iterable[tuple[str, str]]) -> None:
        """Let pairs of links of the body, by name, pass through each other."""
        for a, b in pairs:
            self._world.filter.set((self.uid, self.links[a]), (self.uid, self.links[b]), False)

    def bounds(self, links: Iterable[int] | None = None) -> tuple[Array, Array]:
        """Return the corners of the box round the collision shapes of links in the world [m], each [3]."""
        boxes = [
            bullet.getAABB(self.uid, link, physicsClientId=self._client)
            for link in (self.solid_links() if links is None else links)
        ]
        if not boxes:
            raise ValueError(f"{self.name!r} has no collision shape")
        lows, highs = zip(*boxes, strict=True)
        return np.min(lows, axis=0), np.max(highs, axis=0)

    def base_pose(self) -> Pose:
        """Return the pose of the base link's frame in the world."""
        pose = Pose(*bullet.getBasePositionAndOrientation(self.uid, physicsClientId=self._client))
        return pose @ self._from_inertial if self._has_offset else pose

    def centre_pose(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return where the base's centre of mass is [m] and how its principal axes are turned.

        Cheaper than `base_pose`; see `in_centre_frame`.
        """
        position, turn = bullet.getBasePositionAndOrientation(self.uid, self._client)
        return position, turn

    def inertial_pose(self, index: int) -> Pose:
        """Return where the centre of mass of a link is in its frame, and how its axes are turned."""
        return Pose(*bullet.getDynamicsInfo(self.uid, index, self._client)[3:5])

    def mass_and_inertia(self, index: int) -> tuple[float, Array]:
        """Return mass [kg] and principal moments of inertia [kg·m²], shape [3], of a link."""
        info = bullet.getDynamicsInfo(self.uid, index, physicsClientId=self._client)
        return float(info[0]), np.array(info[2])

    def touching(self, index: int) -> Touching:
        """Return how the surface of a link touches."""
        info = bullet.getDynamicsInfo(self.uid, index, physicsClientId=self._client)
        return Touching(info[1], info[6], info[7], max(info[9], 0.0), max(info[8], 0.0))

    def in_centre_frame(self, pose: Pose) -> Pose:
        """Return a pose in the base link's frame relative to its centre of mass and principal axes."""
        return self._from_inertial @ pose

    def link_pose(self, index: int) -> Pose:
        """Return the pose of a link's frame in the world; index -1 is the base."""
        if index < 0:
            return self.base_pose()
        state = bullet.getLinkState(self.uid, index, 0, 1, physicsClientId=self._client)
        return Pose(state[4], state[5])

    def link_motion(self, index: int) -> tuple[Pose, Array, Array]:
        """Return pose of a link, velocity of its origin [m/s] and rate of turning [rad/s], each [3].

        All in the world; index -1 is the base.
        """
        if index < 0:
            pose, centre = self.base_pose(), self.centre_pose()[0]
            linear, angular = bullet.getBaseVelocity(self.uid, physicsClientId=self._client)
        else:
            state = bullet.getLinkState(self.uid, index, 1, 1, physicsClientId=self._client)
            pose, centre, linear, angular = Pose(state[4], state[5]), state[0], state[6], state[7]
        # Bullet tells the velocity of the centre of mass.
        arm = np.subtract(pose.position, centre)
        return pose, linear + np.cross(angular, arm), np.array(angular)

    def link_poses(self) -> tuple[Array, Array]:
        """Return positions [m], shape [links + 1, 3], and quaternions [links + 1, 4], base first."""
        base = self.base_pose()
        positions = np.empty((self.link_count + 1, 3))
        quaternions = np.empty((self.link_count + 1, 4))
        positions[0], quaternions[0] = base.position, base.quaternion
        if self.link_count:
            states = bullet.getLinkStates(self.uid, range(self.link_count), 0, 1, self._client)
            positions[1:] = [s[4] for s in states]
            quaternions[1:] = [s[5] for s in states]
        return positions, quaternions

    def wake(self) -> None:
        """Wake it if it sleeps."""
        if self.may_sleep:
            self._change((-1,), activationState=bullet.ACTIVATION_STATE_WAKE_UP)

    def set_joints(self, indices: Sequence[int], positions: Vector) -> None:
        """Teleport joints to `positions` [rad or m] at rest."""
        self.wake()
        self._world.teleports += 1
        for i, position in zip(indices, positions, strict=True):
            bullet.resetJointState(self.uid, i, float(position), 0.0, physicsClientId=self._client)

    def drive_positions(
        self,
        indices: Sequence[int],
        targets: Vector,
        forces: Vector,
        *,
        position_gain: float = 0.1,
        velocities: Sequence[float] | None = None,
    ) -> None:
        """Drive joints to `targets` [rad or m] with at most `forces` [N·m or N].

        `velocities` [rad/s or m/s] are those wished at the targets, zero if None. The gains are
        Bullet's: the share of the position error, and of the velocity error, that the motor tries to
        remove in one physics step.
        """
        self.wake()
        for index in indices:
            self.friction.pop(index, None)
        count = len(indices)
        bullet.setJointMotorControlArray(
            self.uid,
            indices,
            bullet.POSITION_CONTROL,
            targetPositions=targets,
            targetVelocities=[0.0] * count if velocities is None else velocities,
            forces=forces,
            positionGains=[position_gain] * count,
            velocityGains=[1.0] * count,
            physicsClientId=self._client,
        )

    def drive_to(
        self,
        indices: Sequence[int],
        targets: Sequence[float],
        speeds: Sequence[float],
        forces: Sequence[float],
        gains: Sequence[float],
    ) -> None:
        """Drive joints to `targets` no faster than `speeds`, with at most `forces`; see `drive_positions`."""
        # One call a joint: the call for many joints has no speed limit. Arguments in their order, since
        # names cost as much as the call: target, its speed, force, two gains, greatest speed.
        tell, mode = bullet.setJointMotorControl2, bullet.POSITION_CONTROL
        uid, client = self.uid, self._client
        for index, target, speed, force, gain in zip(
            indices, targets, speeds, forces, gains, strict=True
        ):
            tell(uid, index, mode, target, 0.0, force, gain, 1.0, speed, client)

    def drive_velocities(self, indices: Sequence[int], targets: Vector, forces: Vector) -> None:
        """Drive joints at `targets` [rad/s or m/s] with at most `forces` [N·m or N]."""
        self.wake()
        for index in indices:
            self.friction.pop(index, None)
        bullet.setJointMotorControlArray(
            self.uid,
            indices,
            bullet.VELOCITY_CONTROL,
            targetVelocities=targets,
            forces=forces,
            physicsClientId=self._client,
        )

    def drive_torques(self, indices: Sequence[int], torques: Sequence[float]) -> None:
        """Apply joint `torques` [N·m or N] for one physics step. A list is faster than an array."""
        if self.may_sleep:
            self.wake()
        tell, mode = bullet.setJointMotorControlArray, bullet.TORQUE_CONTROL
        tell(self.uid, indices, mode, forces=torques, physicsClientId=self._client)

    def pushing(self, indices: Sequence[int], torques: Sequence[float]) -> Callable[[], object]:
        """Return what applies joint `torques` for a physics step: one call to Bullet, or none."""
        loaded = [(i, t) for i, t in zip(indices, torques, strict=True) if t != 0.0]
        mode, client = bullet.TORQUE_CONTROL, self._client
        if not loaded:
            return tuple  # nothing to do
        if len(loaded) == 1:  # in half the time of the call for many joints
            ((i, t),) = loaded
            tell = bullet.setJointMotorControl2
            return partial(tell, self.uid, i, mode, 0.0, 0.0, t, 0.0, 0.0, 0.0, client)
        chosen, forces = zip(*loaded, strict=True)
        tell = bullet.setJointMotorControlArray
        return partial(tell, self.uid, chosen, mode, forces=forces, physicsClientId=client)

    def limit_joint(self, index: int, lower: float, upper: float) -> None:
        """Change the range of a joint [rad or m]."""
        self._change((index,), jointLowerLimit=lower, jointUpperLimit=upper)

    def limit_speed(self, most: float) -> None:
        """Let the physics cut all joint speeds at `most` [rad/s or m/s]."""
        bullet.changeDynamics(self.uid, -1, maxJointVelocity=most, physicsClientId=self._client)

    def release_motors(self, indices: Sequence[int], friction: float = 0.0) -> None:
        """Turn off the default velocity motors, leaving `friction` [N·m or N]."""
        if indices:
            self.drive_velocities(indices, [0.0] * len(indices), [friction] * len(indices))
            self.friction |= dict.fromkeys(indices, friction)

    def gear(self, leader: int, follower: int, multiplier: float, force: float) -> None:
        """Couple two joints: `follower` moves `multiplier` times as far, by at most `force` [N·m or N].

        The physics solves it with all else, where a motor that follows would react a step late. It
        lasts as long as the world.
        """
        self.gears.append(Gear(leader, follower, multiplier, force))
        pair, frames = (self.uid, leader, self.uid, follower), ((0, 0, 1), (0, 0, 0), (0, 0, 0))
        gear = bullet.createConstraint(
            *pair, bullet.JOINT_GEAR, *frames, physicsClientId=self._client
        )
        bullet.changeConstraint(
            gear,
            gearRatio=-1 / multiplier,
            maxForce=force,
            erp=GEAR_ERP,
            physicsClientId=self._client,
        )

    def apply_force(self, link: int, force: Vector, point: Vector) -> None:
        """Push a link with `force` [N] at `point` [m], both in the world, for one physics step."""
        self.wake()
        bullet.applyExternalForce(
            self.uid, link, force, point, bullet.WORLD_FRAME, physicsClientId=self._client
        )

    def mass_matrix(self, positions: Sequence[float]) -> Array:
        """Return the joint-space mass matrix at joint `positions` [rad or m].

        Its size is that of `positions` for a fixed base, and six more for a free one.
        """
        return np.array(
            bullet.calculateMassMatrix(self.uid, positions, physicsClientId=self._client)
        )

    def set_base(self, pose: Pose) -> None:
        """Teleport the base link's frame to `pose`, at rest."""
        self.wake()
        self._world.teleports += 1
        at = pose @ self._inertial if self._has_offset else pose
        bullet.resetBasePositionAndOrientation(
            self.uid, at.position, at.quaternion, physicsClientId=self._client
        )
        bullet.resetBaseVelocity(self.uid, (0, 0, 0), (0, 0, 0), physicsClientId=self._client)

    def set_damping(self) -> None:
        """Take Bullet's default damping off every link."""
        self._change(None, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0)

    def _change(self, links: Iterable[int] | None, **values: float) -> None:
        """Change the dynamics of links, all if None, as Bullet calls them."""
        for link in range(-1, self.link_count) if links is None else links:
            bullet.changeDynamics(self.uid, link, physicsClientId=self._client, **values)

    def set_friction(
        self, links: Iterable[int], *, lateral: float, rolling: float = 0.0, spinning: float = 0.0
    ) -> None:
        """Set the friction coefficients of `links`: sliding [1], rolling and spinning [m]."""
        self._change(
            links, lateralFriction=lateral, rollingFriction=rolling, spinningFriction=spinning
        )

    def exclude_own_links(self) -> None:
        """Take pairs of the body's own links out of the broad phase, where they cost time each step.

        They never collide anyway, but Bullet would find that out pair by pair. There are collision
        groups for `OWN_GROUPS` bodies of a world; more bodies are left as they are.
        """
        if self._world.own_groups >= OWN_GROUPS:
            return
        self.meets_itself = False
        bit = FIRST_OWN_GROUP << self._world.own_groups
        self._world.own_groups += 1
        for link in range(-1, self.link_count):
            bullet.setCollisionFilterGroupMask(
                self.uid, link, bit, ~bit, physicsClientId=self._client
            )

    def let_meet(self, pairs: Iterable[tuple[int, int]]) -> None:
        """Let pairs of the body's own links collide, if they do not overlap as they are now.

        The body must have been loaded with `self_collision`, and its own links excluded.
        """
        self.meeting = [pair for pair in pairs if self.own_gap(*pair) >= 0.0]
        self.part_own(False)

    def part_own(self, apart: bool) -> None:
        """Keep the pairs of `let_meet` from colliding for a while, or let them again."""
        for pair in self.meeting:
            bullet.setCollisionFilterPair(
                self.uid, self.uid, *pair, int(not apart), physicsClientId=self._client
            )

    def set_softness(
        self, *, stiffness: float, damping: float, links: Iterable[int] | None = None
    ) -> None:
        """Let links, all if None, yield in contact: `stiffness` [N/m] and `damping` [N·s/m]."""
        self._change(links, contactStiffness=stiffness, contactDamping=damping)

    def visual_shapes(self) -> list[VisualShape]:
        """Return the shapes to draw, each in the frame of its link."""
        rows = bullet.getVisualShapeData(self.uid, physicsClientId=self._client)
        return [
            VisualShape(
                link=row[1],
                kind=SHAPE_NAMES[row[2]],
                size=tuple(row[3]),
                mesh=row[4].decode(),
                pose=Pose(row[5], row[6]),
                rgba=tuple(row[7]),
            )
            for row in rows
            if row[2] in SHAPE_NAMES
        ]

    def collision_shapes(self, link: int) -> list[VisualShape]:
        """Return the shapes with which a link collides, each in its frame; Bullet hulls meshes.

        Cylinders of a URDF are meshes without a file: see `hull_points`.
        """
        rows = bullet.getCollisionShapeData(self.uid, link, physicsClientId=self._client)
        at, white = self.inertial_pose(link), (1.0, 1.0, 1.0, 1.0)
        return [
            VisualShape(
                link,
                SHAPE_NAMES.get(kind, "other"),
                tuple(size),
                file.decode(),
                at @ Pose(*to),
                white,
            )
            for _, _, kind, size, file, *to in rows
        ]

    def hull_points(self, link: int, place: int) -> Array:
        """Return the corners of the collision shape at `place` of a link in its frame, shape [n, 3].

        Only of a mesh that has no file; there are none of anything else.
        """
        found = bullet.getMeshData(
            self.uid, link, collisionShapeIndex=place, physicsClientId=self._client
        )
        at = self.inertial_pose(link)
        points = np.array(found[1] if found else ()).reshape(-1, 3)
        return points @ matrix_from_quaternion(at.quaternion).T + at.position
