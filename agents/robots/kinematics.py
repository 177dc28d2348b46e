"""Kinematics of a serial chain: tool pose, Jacobian, gravity and inverse kinematics, over the core's tree.

No physics state is touched: a chain is built from a model's data. Everything is in the world frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import Joint, Model, joint_pose
from rcare_marl.pose import Array, Pose, matrix_from_quaternion, quaternion_from_matrix, rotate
from rcare_marl.tree.joint_tree import (
    Tree,
    frame_in,
    gravity_torques,
    jacobian,
    new_frames,
    place,
)
from rcare_marl.tree.least_squares import bounded_step, put, rotation_vector
from rcare_marl.world import GRAVITY

DAMPING = 0.02  # of the least squares; keeps steps small near singular postures
ITERATIONS = 60  # of inverse kinematics, at most
# [rad] or [m] of a joint in an iteration: near a singular posture it would wind up; our own choice.
MOST_STEP = 0.5


@dataclass(frozen=True)
class IkResult:
    """What inverse kinematics found.

    Attributes:
        posture: Joint positions [rad or m], shape [n].
        distance: What is left of the position error [m].
        angle: What is left of the orientation error [rad].
    """

    posture: Array
    distance: float
    angle: float

    def is_within(self, distance: float = 1e-3, angle: float = 0.01) -> bool:
        """Return whether both errors are small enough."""
        return self.distance <= distance and self.angle <= angle


class Chain:
    """The joints from the root of a model to one link, with all mass that they carry.

    Attributes:
        joints: Names of the joints that move the chain, root first.
        telescope: Names of the sliding joints on the way that follow one of them.
        arrays: The joints for kernels, the root where `place` put it: the fields of a `Tree`, as a
            plain tuple, which Numba takes in half the time of a named one.
        tip: Frame of the tip in the last part, shape [3, 4].
    """

    def __init__(
        self,
        model: Model,
        joints: Sequence[str],
        tip: str,
        *,
        others: Mapping[str, float] | None = None,
        root: str | None = None,
    ) -> None:
        """Collect the chain.

        Args:
            model: The robot.
            joints: The joints that move, root first; all other joints count as frozen.
            tip: The link at the end.
            others: Positions of frozen joints [rad or m]; zero where not named.
            root: Link that the chain starts from; the model's root if None.

        Raises:
            ConfigError: If a joint is not on the way from the root to `tip`, or one there follows
                another in a way that is no telescope.
        """
        self.joints = tuple(joints)
        frozen, n = dict(others or {}), len(self.joints)
        path = [(name, model.joints[name]) for name in reversed(model.way(tip, root))]
        if [name for name, _ in path if name in self.joints] != list(self.joints):
            raise ConfigError(f"joints {joints} do not lie, in order, between the root and {tip!r}")
        moving = [model.joints[name] for name in self.joints]
        axes = np.array([j.axis for j in moving], np.float64).reshape(-1, 3)
        self._axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        self._slides = np.array([j.kind == "prismatic" for j in moving])
        origins, here = [], Pose()
        self.telescope: dict[str, float] = {}  # how much farther than the segment before
        lengths = np.ones(n)  # a telescope moves its tip by several times its first joint
        for name, joint in path:
            if name in self.joints:
                origins.append((here @ joint_pose(joint)).matrix()[:3])
                here = Pose()
            elif joint.follows is not None and joint.follows.joint in self.joints:
                longer = self._lengthening(name, joint, here, len(origins) - 1)
                lengths[len(origins) - 1] += longer
                self.telescope[name] = longer
                here = here @ joint_pose(joint, joint.follows.offset)
            else:
                here = here @ joint_pose(joint, frozen.get(name, 0.0))
        self.tip = here.matrix()[:3].copy()
        masses, centres, lags = self._carried(model, frozen, lengths)
        frames = np.array(origins).reshape(n, 3, 4)
        tree = Tree(
            parents=np.arange(-1, n - 1),
            slides=self._slides,
            axes=self._axes * lengths[:, None],
            rotations=frames[:, :, :3].copy(),
            offsets=frames[:, :, 3].copy(),
            masses=masses,
            centres=centres,
            inertias=np.zeros((n, 3, 3)),
            lags=lags,
        )
        self.arrays = tuple(tree)
        self._rotations, self._offsets, self._first = tree.rotations, tree.offsets, frames[0].copy()

    def _lengthening(self, name: str, joint: Joint, here: Pose, last: int) -> float:
        """Return how far the tip moves by a follower for each metre of its leader, joint `last`."""
        assert joint.follows is not None
        along = rotate((here @ joint_pose(joint)).quaternion, joint.axis)
        is_last = last >= 0 and self.joints[last] == joint.follows.joint
        if not (is_last and self._slides[last] and joint.kind == "prismatic"):
            raise ConfigError(
                f"joint {name!r} follows {joint.follows.joint!r} on the way to the tool: only sliding "
                "joints that directly follow a sliding one can, as in a telescope"
            )
        if joint.follows.offset != 0 or joint.follows.multiplier == 0:
            raise ConfigError(f"joint {name!r} of a telescope needs a multiplier and no offset")
        scale = float(np.dot(along, self._axes[last]) / np.linalg.norm(joint.axis))
        if abs(abs(scale) - 1) > 1e-6:
            raise ConfigError(f"joint {name!r} is not parallel to {joint.follows.joint!r}")
        return joint.follows.multiplier * scale

    def _carried(
        self, model: Model, frozen: Mapping[str, float], lengths: Array
    ) -> tuple[Array, Array, Array]:
        """Return mass [kg] and centre [m] of what each joint carries, in its child, and its lag [kg].

        The centre is that of a telescope pushed together, whose segments lag behind from there.
        """
        # What carries each link, where it is in that, and how far it goes for a metre of that.
        where: dict[str, tuple[int, Pose, float]] = {model.root: (-1, Pose(), 1.0)}
        masses, moments = np.zeros(len(self.joints)), np.zeros((len(self.joints), 3))
        lags = np.zeros(len(self.joints))
        for name, joint in model.joints.items():  # parents come before children
            holder, pose, way = where[joint.parent]
            if name in self.joints:
                holder, pose, way = self.joints.index(name), Pose(), 1.0
            else:
                start = 0.0 if name in self.telescope else frozen.get(name, 0.0)
                pose, way = pose @ joint_pose(joint, start), way + self.telescope.get(name, 0.0)
            where[joint.child] = (holder, pose, way)
            if holder >= 0:
                link = model.links[joint.child]
                masses[holder] += link.mass
                moments[holder] += link.mass * np.asarray((pose @ Pose(link.com)).position)
                lags[holder] += link.mass * (1 - way / lengths[holder])
        return masses, moments / np.maximum(masses, 1e-12)[:, None], lags

    def place(self, base: Pose) -> None:
        """Put the root link at `base` in the world."""
        turn, first = matrix_from_quaternion(base.quaternion), self._first
        out = (turn[:, :1] * first[0] + turn[:, 1:2] * first[1]) + turn[:, 2:] * first[2]
        self._rotations[0] = out[:, :3]
        self._offsets[0] = out[:, 3] + base.position

    def tip_frame(self, positions: Array) -> Array:
        """Return the frame of the tip at joint `positions` [rad or m], shape [3, 4]."""
        return _tip_frame(self.arrays, self.tip, positions)

    def tip_pose(self, positions: Array) -> Pose:
        """Return the pose of the tip at joint `positions` [rad or m], shape [n]."""
        tip = self.tip_frame(positions)
        return Pose(tuple(tip[:, 3].tolist()), tuple(quaternion_from_matrix(tip[:, :3]).tolist()))

    def jacobian(self, positions: Array) -> Array:
        """Return the geometric Jacobian of the tip, three linear rows first, shape [6, n]."""
        return _jacobian(self.arrays, self.tip, positions)

    def point_jacobian(self, positions: Array, part: int, point: Array) -> Array:
        """Return how a point [m] of the part that the joint number `part` moves goes, shape [3, n]."""
        return _point_jacobian(self.arrays, positions, part, point)

    def gravity_torques(self, positions: Array) -> Array:
        """Return the torques that hold the chain still [N·m or N], shape [n]."""
        return _gravity_torques(self.arrays, positions)

    def load_torques(self, positions: Array, mass: float, moment: Array) -> Array:
        """Return the torques that hold a load at the tip still [N·m or N], shape [n].

        Args:
            positions: Of the joints [rad or m], shape [n].
            mass: Of the load [kg].
            moment: That times its place in the frame of the tip [kg·m], shape [3].
        """
        return _load_torques(self.arrays, self.tip, positions, mass, moment)

    def solve(
        self,
        goal: Pose,
        seed: Array,
        lower: Array,
        upper: Array,
        *,
        rest: Array | None = None,
        turn_weight: float = 1.0,
    ) -> IkResult:
        """Move the tip to `goal` from the posture `seed` by damped least squares within limits.

        Args:
            goal: Pose of the tip in the world.
            seed: Where the search starts, shape [n].
            lower: Lower limits, shape [n].
            upper: Upper limits, shape [n].
            rest: Posture preferred where the goal leaves a choice; the seed if None.
            turn_weight: Weight of a radian against a metre; zero ignores orientation.
        """
        start = np.asarray(seed, np.float64)
        wished = start if rest is None else np.asarray(rest, np.float64)
        frame = np.ascontiguousarray(goal.matrix()[:3])
        return IkResult(
            *_solve(
                self.arrays, self.tip, frame, start, lower, upper, wished, turn_weight, ITERATIONS
            )
        )


@numba.njit(cache=True)
def place_chain(tree, tip, q, frames, out) -> None:  # type: ignore[no-untyped-def]
    """Write the frames of a chain at `q` [n], and that of its tip [3, 4]."""
    place(tree, range(len(q)), q, frames)
    frame_in(frames, len(q) - 1, tip[:, :3], tip[:, 3], out)


@numba.njit(cache=True)
def _tip_frame(arrays, tip, q):  # type: ignore[no-untyped-def]
    out = np.empty((3, 4))
    place_chain(Tree(*arrays), tip, q, new_frames(len(q)), out)
    return out


@numba.njit(cache=True)
def _jacobian(arrays, tip, q):  # type: ignore[no-untyped-def]
    tree, frames, here = Tree(*arrays), new_frames(len(q)), np.empty((3, 4))
    place_chain(tree, tip, q, frames, here)
    return jacobian(tree, frames, len(q) - 1, here[:, 3])


@numba.njit(cache=True)
def _point_jacobian(arrays, q, part, point):  # type: ignore[no-untyped-def]
    tree, frames = Tree(*arrays), new_frames(len(q))
    place(tree, range(len(q)), q, frames)
    return jacobian(tree, frames, part, point)[:3].copy()


@numba.njit(cache=True)
def _gravity_torques(arrays, q):  # type: ignore[no-untyped-def]
    tree, frames = Tree(*arrays), new_frames(len(q))
    place(tree, range(len(q)), q, frames)
    return gravity_torques(tree, q, frames, GRAVITY)


@numba.njit(cache=True)
def _load_torques(arrays, tip, q, mass, moment):  # type: ignore[no-untyped-def]
    tree, frames, here = Tree(*arrays), new_frames(len(q)), np.empty((3, 4))
    place_chain(tree, tip, q, frames, here)
    at = here[:, 3] + here[:, :3].copy() @ moment / mass
    return mass * GRAVITY * jacobian(tree, frames, len(q) - 1, at)[2]


@numba.njit(cache=True)
def _solve(arrays, tip, goal, seed, lower, upper, rest, turn_weight, iterations):  # type: ignore[no-untyped-def]
    tree, frames, here = Tree(*arrays), new_frames(len(seed)), np.empty((3, 4))
    q = np.minimum(np.maximum(seed, lower), upper)
    error = np.zeros(6)
    distance, angle = 0.0, 0.0
    for k in range(iterations + 1):
        place_chain(tree, tip, q, frames, here)
        put(goal[:, 3] - here[:, 3], error[:3])
        put(rotation_vector(goal, here), error[3:])
        distance = math.sqrt((error[:3] ** 2).sum())
        angle = math.sqrt((error[3:] ** 2).sum())
        if (distance < 1e-5 and turn_weight * angle < 1e-4) or k == iterations:
            break
        scale = min(1.0, 0.15 / max(distance, 1e-9), 0.5 / max(angle * turn_weight, 1e-9))
        matrix = jacobian(tree, frames, len(q) - 1, here[:, 3])
        np.multiply(matrix[3:], turn_weight, matrix[3:])
        wanted = error * scale
        np.multiply(wanted[3:], turn_weight, wanted[3:])
        pull = 0.05 * (rest - q) if k < iterations // 2 else np.zeros(len(q))
        # Far away the damping calms, close by it would only slow the last steps down.
        damping = DAMPING if distance + angle > 0.1 else 0.1 * DAMPING
        step = bounded_step(matrix, wanted, q, lower, upper, pull, damping)
        q = q + step * min(1.0, MOST_STEP / max(np.abs(step).max(), 1e-9))
    return q, distance, angle
