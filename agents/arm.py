"""A robot's arm: its driven joints, their limits, and their kinematics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pybullet as bullet

from rcare_marl.body import Body
from rcare_marl.pose import Array, Pose
from rcare_marl.world import World

from .kinematics import Chain, IkResult

# Share of the position error that a motor removes in one physics step, up to the planned speed. All
# of it, so that the speed is even to the end: a motor that brakes there would feel its own inertia.
POSITION_GAIN = 1.0
# Speed that is always allowed, so that a joint that was pushed away can come back [rad/s or m/s].
RETURN_SPEED = 0.01
_SEEDS = 12  # starts of inverse kinematics after the posture that it was given


class Arm:
    """The joints that an action moves, with fast ways to read and to drive them.

    Attributes:
        names: Joint names, base to tip.
        lower: Lower limits [rad or m], shape [n]; -inf for continuous joints.
        upper: Upper limits [rad or m], shape [n]; inf for continuous joints.
        velocity: Greatest speeds [rad/s or m/s], shape [n].
        effort: Greatest torques or forces [N·m or N], shape [n].
        chain: Kinematics from the base to the tool.
        rest: Posture preferred where a tool pose leaves a choice, shape [n].
    """

    def __init__(self, world: World, body: Body, chain: Chain, rest: Sequence[float]) -> None:
        self.body, self.chain, self.names = body, chain, chain.joints
        self._client, self._uid = world.client, body.uid
        joints = [body.joint(name) for name in self.names]
        self.indices = [joint.index for joint in joints]
        self.lower = np.array([joint.lower for joint in joints])
        self.upper = np.array([joint.upper for joint in joints])
        self.velocity = np.array([joint.velocity for joint in joints])
        self.effort = np.array([joint.effort for joint in joints])
        self._dofs = [joint.dof for joint in joints]
        self._all = [joint.index for joint in body.joints.values()]
        self.physics_dt = world.physics_dt
        self.rest = np.array(rest, np.float64)
        self.chain.place(body.base_pose())

    def __len__(self) -> int:
        return len(self.names)

    def read(self) -> tuple[Array, Array, Array]:
        """Return positions, velocities and motor torques of the last step, each of shape [n]."""
        states = bullet.getJointStates(self._uid, self.indices, physicsClientId=self._client)
        positions, velocities, _, torques = zip(*states, strict=True)
        return np.array(positions), np.array(velocities), np.array(torques)

    def positions(self) -> Array:
        """Return the joint positions [rad or m], shape [n]."""
        return np.array(self.body.joint_states(self.indices)[0])

    def velocities(self) -> Array:
        """Return the joint velocities [rad/s or m/s], shape [n]."""
        return np.array(self.body.joint_states(self.indices)[1])

    def inertial_torques(self, positions: Array, acceleration: Array) -> Array:
        """Return the torques that accelerate the arm [N·m or N], shape [n], without speed terms."""
        everything = positions.tolist()
        if len(self._all) != len(self.indices):
            everything = self.body.joint_states(self._all)[0]
        matrix = self.body.mass_matrix(everything)
        out: Array = matrix[np.ix_(self._dofs, self._dofs)] @ acceleration
        return out

    def drive_to(self, targets: Array, speeds: Array, forces: Array) -> None:
        """Drive joints to `targets` [rad or m] no faster than `speeds`, with at most `forces`.

        The speed limit spreads a control step's way evenly over its physics steps: without it the
        motor would jump at each command.
        """
        # One call a joint: the call for many joints has no speed limit.
        for index, target, speed, force in zip(
            self.indices, targets.tolist(), speeds.tolist(), forces.tolist(), strict=True
        ):
            bullet.setJointMotorControl2(
                self._uid,
                index,
                bullet.POSITION_CONTROL,
                targetPosition=target,
                force=force,
                maxVelocity=speed,
                positionGain=POSITION_GAIN,
                velocityGain=1.0,
                physicsClientId=self._client,
            )

    def drive_towards(self, targets: Array, duration: float, forces: Array) -> None:
        """Drive joints so that they reach `targets` [rad or m] in `duration` [s]."""
        way = np.abs(targets - self.positions())
        self.drive_to(targets, self.speeds_for(way, duration), forces)

    def speeds_for(self, way: Array, duration: float) -> Array:
        """Return motor speeds that cover `way` [rad or m] in `duration` [s], within limits."""
        speeds: Array = np.minimum(np.maximum(way / duration, RETURN_SPEED), self.velocity)
        return speeds

    def drive_velocities(self, speeds: Array, forces: Array) -> None:
        """Drive joints at `speeds` [rad/s or m/s] with at most `forces` [N·m or N]."""
        self.body.drive_velocities(self.indices, speeds.tolist(), forces.tolist())

    def limit_speed(self) -> None:
        """Let the physics cut all joint speeds a fifth above the greatest that any joint may have.

        For modes whose motors do not rule the speed.
        """
        bullet.changeDynamics(
            self._uid,
            -1,
            maxJointVelocity=1.2 * float(self.velocity.max()),
            physicsClientId=self._client,
        )

    def solve(self, goal: Pose, seed: Array, *, position_only: bool = False) -> IkResult:
        """Return the posture that puts the tool at `goal`: the first good one, else the best.

        The search starts at `seed`, then at the rest posture, then at postures around both that are
        the same on every call.
        """
        weight = 0.0 if position_only else 0.3
        best: IkResult | None = None
        for start in self._seeds(seed):
            found = self.chain.solve(
                goal, start, self.lower, self.upper, rest=self.rest, turn_weight=weight
            )
            if position_only:
                found = IkResult(found.posture, found.distance, 0.0)
            if found.is_within():
                return found
            if best is None or found.distance + weight * found.angle < (
                best.distance + weight * best.angle
            ):
                best = found
        assert best is not None  # there is always a first seed
        return best

    def _seeds(self, seed: Array) -> list[Array]:
        rng = np.random.default_rng(0)
        spread = [
            (seed if k % 2 else self.rest) + rng.normal(0.0, 0.5, len(self)) for k in range(_SEEDS)
        ]
        return [seed, self.rest, *spread]
