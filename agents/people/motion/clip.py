"""Clips: recorded motion of anybody's body, and what an avatar makes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, matrix_from_quaternion, quaternion_from_matrix

from ..body.skeleton import (
    DOF_INDEX,
    DOFS,
    DOFS_OF,
    JOINT_INDEX,
    JOINTS,
    PARENTS,
    SIDES,
    forward_kinematics,
)
from ..body.skin import BodyModel
from ..profile import ClinicalProfile, Range
from .decomposition import decompose

# Bones whose direction is kept where the rest postures of clip and avatar differ: joint and next one.
# Hands and fingers go with the forearm; feet and trunk are taken as they are.
_BONES = {
    f"{side}_{joint}": f"{side}_{end}"
    for side in SIDES
    for limb in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))
    for joint, end in zip(limb[:-1], limb[1:], strict=True)
}


@dataclass(frozen=True, eq=False)
class Clip:
    """Recorded motion, in the frames of its own skeleton.

    Attributes:
        rate: Frames a second.
        rotations: Local rotation of each SMPL-X joint against the rest posture, in body axes (x
            left, y up, z forward), identity for those that were not recorded, shape [t, 55, 3, 3].
        pelvis: Where the pelvis is, z up, in the clip's own unit of length, shape [t, 3].
        turns: How it is turned: body axes in the world, z up, shape [t, 3, 3].
        leg: Length of thigh and shank in the clip's unit of length.
        rest: Joint centres in the rest posture in body axes, NaN where unknown, shape [55, 3]; none
            where the rest posture is the avatar's own T-pose.
    """

    rate: float
    rotations: Array
    pelvis: Array
    turns: Array
    leg: float
    rest: Array | None = None

    def __post_init__(self) -> None:
        count = len(self.rotations)
        shapes = {
            "rotations": (self.rotations.shape, (count, len(JOINTS), 3, 3)),
            "pelvis": (self.pelvis.shape, (count, 3)),
            "turns": (self.turns.shape, (count, 3, 3)),
        }
        for name, (got, wanted) in shapes.items():
            if got != wanted:
                raise ConfigError(f"{name} of a clip must have shape {wanted}, got {got}")
            if not np.isfinite(getattr(self, name)).all():
                raise ConfigError(f"{name} of a clip holds values that are not finite")
        if not count:
            raise ConfigError("a clip needs at least one frame")
        for name, value in (("rate", self.rate), ("leg", self.leg)):
            if not (np.isfinite(value) and value > 0):
                raise ConfigError(f"the {name} of a clip must be positive, got {value}")

    def fit(
        self,
        model: BodyModel,
        profile: ClinicalProfile,
        *,
        kind: Range = "passive",
        on_floor: bool = True,
    ) -> Motion:
        """Return the motion that a person makes of the clip.

        Directions of arms and legs are kept, whatever the two rest postures are. The path of the
        pelvis is scaled by the length of the legs.

        Args:
            model: The person's body.
            profile: Whose range of motion cuts the angles.
            kind: By which range: `passive` or `active`.
            on_floor: Whether to shift the clip so that the lowest point that the feet ever reach
                lies at z = 0.
        """
        limits = profile.limits(kind)
        local = self.rotations if self.rest is None else _redirected(self, model.joints)
        angles = np.zeros((len(local), len(DOFS)))
        for joint in JOINTS[1:]:
            names = [dof.name for dof in DOFS_OF[joint]]
            bounds = np.array([limits[name] for name in names])
            columns = [DOF_INDEX[name] for name in names]
            angles[:, columns] = decompose(joint, local[:, JOINT_INDEX[joint]], bounds)
        low, high = np.array([limits[dof.name] for dof in DOFS]).T
        cut = np.clip(angles, low, high)
        motion = Motion(
            rate=self.rate,
            angles=cut,
            pelvis=self.pelvis * (leg_length(model.joints) / self.leg),
            quaternions=np.array([quaternion_from_matrix(turn) for turn in self.turns]),
            excess=float(np.abs(cut - angles).max()),
        )
        return motion.on_floor(model) if on_floor else motion


def _redirected(clip: Clip, joints: Array) -> Array:
    """Return local rotations that give the avatar's bones the directions of the clip's."""
    assert clip.rest is not None
    world, after = np.empty_like(clip.rotations), np.empty_like(clip.rotations)
    mend = np.tile(np.eye(3), (len(JOINTS), 1, 1))
    out = np.empty_like(clip.rotations)
    for j, joint in enumerate(JOINTS):
        parent = PARENTS[j]
        world[:, j] = (
            clip.rotations[:, j] if parent < 0 else world[:, parent] @ clip.rotations[:, j]
        )
        if joint in _BONES:
            end = JOINT_INDEX[_BONES[joint]]
            theirs, ours = clip.rest[end] - clip.rest[j], joints[end] - joints[j]
            if np.isfinite(theirs).all():
                mend[j] = rotation_between(ours, theirs)
        elif "wrist" in joint or j > JOINT_INDEX["right_eye_smplhf"]:
            mend[j] = mend[parent]
        after[:, j] = world[:, j] @ mend[j]
        out[:, j] = after[:, j] if parent < 0 else after[:, parent].transpose(0, 2, 1) @ after[:, j]
    return out


def rotation_between(a: Array, b: Array) -> Array:
    """Return the least rotation that turns the direction `a` into `b`, shape [3, 3]."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < -1 + 1e-9:  # opposite: half a turn about anything across
        across = np.eye(3)[int(np.argmin(np.abs(a)))]
        across = across - (across @ a) * a
        across /= np.linalg.norm(across)
        return np.asarray(2 * np.outer(across, across) - np.eye(3))
    k = np.array(((0, -axis[2], axis[1]), (axis[2], 0, -axis[0]), (-axis[1], axis[0], 0)))
    return np.asarray(np.eye(3) + k + k @ k / (1 + cosine))


def leg_length(joints: Array) -> float:
    """Return the mean length of thigh and shank of joint centres [55, 3], in their unit."""
    total = 0.0
    for side in SIDES:
        hip, knee, ankle = (
            joints[JOINT_INDEX[f"{side}_{part}"]] for part in ("hip", "knee", "ankle")
        )
        total += float(np.linalg.norm(hip - knee) + np.linalg.norm(knee - ankle))
    return 0.5 * total


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of one avatar.

    Attributes:
        rate: Frames a second.
        angles: Angle of every DoF [rad], shape [t, 112].
        pelvis: Position of the pelvis in the world [m], shape [t, 3].
        quaternions: How it is turned, shape [t, 4].
        excess: By how much the range of motion has cut an angle at most [rad].
    """

    rate: float
    angles: Array
    pelvis: Array
    quaternions: Array
    excess: float = 0.0

    @property
    def duration(self) -> float:
        """From the first frame to the last [s]."""
        return (len(self.angles) - 1) / self.rate

    def at(self, time: float) -> tuple[Array, Pose]:
        """Return angles [rad], shape [112], and the pelvis at a time [s], the ends before and after."""
        place = min(max(time * self.rate, 0.0), len(self.angles) - 1.0)
        i = min(int(place), max(len(self.angles) - 2, 0))
        j, share = min(i + 1, len(self.angles) - 1), place - i
        a, b = self.quaternions[i], self.quaternions[j]
        turned = (1 - share) * a + share * (b if a @ b >= 0 else -b)  # neighbours are near
        turned /= np.linalg.norm(turned)
        position = (1 - share) * self.pelvis[i] + share * self.pelvis[j]
        angles = (1 - share) * self.angles[i] + share * self.angles[j]
        return angles, Pose(tuple(position.tolist()), tuple(turned.tolist()))

    def wish(self, time: float) -> dict[str, float]:
        """Return the angle of each DoF by name [rad] at a time [s]."""
        return dict(zip(DOF_INDEX, self.at(time)[0].tolist(), strict=True))

    def resampled(self, dt: float) -> Motion:
        """Return the motion with a frame every `dt` [s]; what is left of a last step is dropped.

        Raises:
            ConfigError: If `dt` is not positive.
        """
        if not (np.isfinite(dt) and dt > 0):
            raise ConfigError(f"the time between frames must be positive, got {dt} s")
        frames = [self.at(k * dt) for k in range(int(self.duration / dt + 1e-9) + 1)]
        angles = np.array([angles for angles, _ in frames])
        return replace(self, rate=1 / dt, angles=angles)._along([pose for _, pose in frames])

    def moved(self, by: Pose) -> Motion:
        """Return the motion in the frame that `by` is given in."""
        poses = [
            by @ Pose(tuple(p), tuple(q))
            for p, q in zip(self.pelvis.tolist(), self.quaternions.tolist(), strict=True)
        ]
        return self._along(poses)

    def _along(self, poses: Sequence[Pose]) -> Motion:
        """Return the motion with the pelvis at other poses."""
        pelvis = np.array([pose.position for pose in poses])
        return replace(self, pelvis=pelvis, quaternions=np.array([p.quaternion for p in poses]))

    def placed(self, x: float, y: float, heading: float) -> Motion:
        """Return the motion begun above (x, y) [m] on the floor, facing `heading` [rad] from x."""
        first = Pose(tuple(self.pelvis[0].tolist()), tuple(self.quaternions[0].tolist()))
        turn = heading - heading_of(first)
        spin = Pose((0, 0, 0), (0.0, 0.0, float(np.sin(turn / 2)), float(np.cos(turn / 2))))
        there = (spin @ first).position
        return self.moved(Pose((x - there[0], y - there[1], 0.0), spin.quaternion))

    def on_floor(self, model: BodyModel) -> Motion:
        """Return the motion shifted up or down until the lowest point of the soles is at z = 0."""
        points = sole_points(model)
        lowest = np.inf
        for angles, p, q in zip(self.angles, self.pelvis, self.quaternions, strict=True):
            rotations, positions = forward_kinematics(model.joints, angles)
            up = matrix_from_quaternion(q)[2]
            for joint, local in points.items():
                j = JOINT_INDEX[joint]
                height = (local @ rotations[j].T + positions[j]) @ up + p[2]
                lowest = min(lowest, float(height.min()))
        return self.moved(Pose((0.0, 0.0, -lowest)))


def heading_of(pelvis: Pose) -> float:
    """Return where a pelvis faces on the floor, from the x axis [rad]."""
    forward = matrix_from_quaternion(pelvis.quaternion)[:, 2]
    return float(np.arctan2(forward[1], forward[0]))


def sole_points(model: BodyModel) -> Mapping[str, Array]:
    """Return points under the feet in the frames of ankle and toe joints [m], each of shape [4, 3]."""
    out = {}
    for side in SIDES:
        for part in ("ankle", "foot"):
            joint = f"{side}_{part}"
            local = model.vertices[model.owner == JOINT_INDEX[joint]].astype(np.float64)
            local -= model.joints[JOINT_INDEX[joint]]
            low, high = local.min(axis=0), local.max(axis=0)
            out[joint] = np.array(
                [(x, low[1], z) for x in (low[0], high[0]) for z in (low[2], high[2])]
            )
    return out
