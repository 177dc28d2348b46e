"""The SMPL-X skeleton: 55 joints, and the 112 anatomical degrees of freedom that we give them.

Axes are those of SMPL-X: x to the person's left, y up, z forward. The rest pose is the T-pose, and every
joint's local frame is parallel to the body's frame there, so an axis is both local and global. A degree of
freedom is named by its positive motion (`left_elbow_flexion`), and a motion has the same sign on both
sides. Clinical angles start at the anatomical position; the only one that differs from the T-pose is
shoulder abduction, which is 90 degrees there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rcare_marl import assets
from rcare_marl.config import read_yaml
from rcare_marl.pose import Array, axis_rotation

from .scapula import pivot, turn_scapula

BODY = tuple(
    """
    pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3
    left_foot right_foot neck left_collar right_collar head left_shoulder right_shoulder
    left_elbow right_elbow left_wrist right_wrist jaw left_eye_smplhf right_eye_smplhf
    """.split()
)
FINGERS = ("index", "middle", "pinky", "ring", "thumb")
SIDES = ("left", "right")
JOINTS: tuple[str, ...] = BODY + tuple(
    f"{side}_{finger}{k}" for side in SIDES for finger in FINGERS for k in (1, 2, 3)
)
JOINT_INDEX = {name: i for i, name in enumerate(JOINTS)}

_BODY_PARENTS = tuple(
    map(int, "-1 0 0 0 1 2 3 4 5 6 7 8 9 9 9 12 13 14 16 17 18 19 15 15 15".split())
)
PARENTS: tuple[int, ...] = _BODY_PARENTS + tuple(
    wrist if k == 0 else first + 3 * finger + k - 1
    for wrist, first in ((20, 25), (21, 40))
    for finger in range(5)
    for k in range(3)
)

Axis = tuple[float, float, float]


@dataclass(frozen=True)
class Dof:
    """One rotational degree of freedom.

    Attributes:
        name: Joint and positive motion, such as `left_elbow_flexion`.
        joint: SMPL-X joint that it belongs to.
        axis: Unit axis in the joint's frame.
        positive: Clinical motion in the positive direction, such as `elbow_flexion`.
        negative: Clinical motion in the negative direction, such as `elbow_extension`.
        share: Part of the clinical range that this joint contributes (a trunk has three joints).
        clinical_zero: Clinical angle in the T-pose [rad].
        side: `left`, `right` or `axial`.
    """

    name: str
    joint: str
    axis: Axis
    positive: str
    negative: str
    share: float
    clinical_zero: float
    side: str


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def _negated(axis: Axis) -> Axis:
    return (-axis[0], -axis[1], -axis[2])


# Joints of the middle and the left half, proximal axis first: (positive motion, negative, axis).
_SIGNED = {name: axis for name, axis in zip("xyz", (X, Y, Z), strict=True)}
_SIGNED |= {f"-{name}": _negated(axis) for name, axis in _SIGNED.items()}
_AXES: dict[str, tuple[tuple[str, str, Axis], ...]] = {
    joint: tuple((positive, other, _SIGNED[axis]) for positive, (other, axis) in rows.items())
    for joint, rows in read_yaml(assets.ROOT / "clinical" / "joint_axes.yaml")["axes"].items()
}
_HALF = math.sqrt(0.5)
_THUMB_FLEXION: Axis = (0.0, _HALF, -_HALF)  # in the rest pose the thumb's pad faces down and back
_THUMB_ABDUCTION: Axis = (_HALF, 0.0, -_HALF)
for _finger in FINGERS:
    _spread = _negated(Y) if _finger in ("index", "middle") else Y
    _spread = _THUMB_ABDUCTION if _finger == "thumb" else _spread
    _flexion = ("flexion", "extension", _THUMB_FLEXION if _finger == "thumb" else _negated(Z))
    _AXES[f"{_finger}1"] = (_flexion, ("abduction", "adduction", _spread))
    _AXES[f"{_finger}2"] = _AXES[f"{_finger}3"] = (_flexion,)
_SPINE = (
    ("flexion", "extension", X),
    ("lateral_flexion_left", "lateral_flexion_right", _negated(Z)),
    ("rotation_left", "rotation_right", Y),
)
# Shares of the trunk's and the neck's range: our own choice, more motion low in the trunk.
_AXIAL_SHARES = {"spine1": 0.4, "spine2": 0.35, "spine3": 0.25, "neck": 0.5, "head": 0.5}
_AXES |= dict.fromkeys(_AXIAL_SHARES, _SPINE)


def _region(kind: str) -> str:
    """Return the clinical name of a joint: the thumb has its own joints, the fingers share theirs."""
    if kind[:-1] in FINGERS:
        is_thumb = kind.startswith("thumb")
        level = ("cmc", "mcp", "ip") if is_thumb else ("mcp", "pip", "dip")
        return f"{'thumb' if is_thumb else 'finger'}_{level[int(kind[-1]) - 1]}"
    shared = {"spine1": "trunk", "spine2": "trunk", "spine3": "trunk", "head": "neck"}
    return shared.get(kind, kind.removesuffix("_smplhf"))


def _dofs(joint: str) -> list[Dof]:
    side, kind = joint.split("_", 1) if joint.startswith(SIDES) else ("axial", joint)
    region = _region(kind)
    return [
        Dof(
            name=f"{joint.removesuffix('_smplhf')}_{positive}",
            joint=joint,
            # Mirrored in the sagittal plane, as a rotation axis is.
            axis=(axis[0], -axis[1], -axis[2]) if side == "right" else axis,
            positive=f"{region}_{positive}",
            negative=f"{region}_{negative}",
            share=_AXIAL_SHARES.get(joint, 1.0),
            clinical_zero=math.pi / 2 if (kind, positive) == ("shoulder", "abduction") else 0.0,
            side=side,
        )
        for positive, negative, axis in _AXES[kind]
    ]


DOFS: tuple[Dof, ...] = tuple(dof for joint in JOINTS[1:] for dof in _dofs(joint))
DOF_INDEX = {dof.name: i for i, dof in enumerate(DOFS)}
DOFS_OF: dict[str, tuple[Dof, ...]] = {
    joint: tuple(dof for dof in DOFS if dof.joint == joint) for joint in JOINTS
}
EYES = ("left_eye_smplhf", "right_eye_smplhf")
# What may carry flesh and bone: the joints; the ulnae, which bend with the elbow but do not pronate; and the
# shoulder blades as the humerus and as the trunk sees them, which turn with the arm as `scapula.py` says.
ULNAE = ("left_ulna", "right_ulna")
SCAPULAE = ("left_scapula", "right_scapula", "left_blade", "right_blade")
CARRIERS = (*JOINTS, *ULNAE, *SCAPULAE)
CARRIER_INDEX = {name: i for i, name in enumerate(CARRIERS)}
PRONATIONS = tuple(f"{side}_elbow_pronation" for side in SIDES)  # what an ulna does not do


# Of each DoF its joint, and the cross product with its axis, once and twice (Rodrigues' formula).
_JOINT_OF = [JOINT_INDEX[dof.joint] for dof in DOFS]
_ABOUT = np.array([((0, -z, y), (z, 0, -x), (-y, x, 0)) for x, y, z in (dof.axis for dof in DOFS)])
_ABOUT_TWICE = _ABOUT @ _ABOUT


def joint_rotation(joint: str, angles: Array) -> Array:
    """Return a joint's local rotation for DoF `angles` [rad], shape [112] -> [3, 3]."""
    out = np.eye(3)
    for dof in DOFS_OF[joint]:
        angle = float(angles[DOF_INDEX[dof.name]])
        if angle:
            out = out @ axis_rotation(dof.axis, angle)
    return out


def joint_rotations(angles: Array) -> Array:
    """Return each joint's local rotation for DoF `angles` [rad], shape [112] -> [55, 3, 3]."""
    out = np.tile(np.eye(3), (len(JOINTS), 1, 1))
    turned = np.flatnonzero(angles)  # most do not
    given = angles[turned].tolist()
    sines = np.array([math.sin(angle) for angle in given])[:, None, None]
    rest = np.array([1 - math.cos(angle) for angle in given])[:, None, None]
    turns = np.eye(3) + sines * _ABOUT[turned] + rest * _ABOUT_TWICE[turned]
    for i, turn in zip(turned.tolist(), turns, strict=True):
        j = _JOINT_OF[i]
        out[j] = out[j] @ turn
    return out


def carrier_joint(carrier: str) -> str:
    """Return the joint at which a carrier starts: itself, the elbow of an ulna, the shoulder of a blade."""
    if carrier in JOINT_INDEX:
        return carrier
    side, kind = carrier.split("_")
    return f"{side}_{'elbow' if kind == 'ulna' else 'shoulder'}"


def carrier_origin(carrier: str, joints: Array) -> Array:
    """Return where a carrier turns in the T-pose [m], shape [3], for joint centres [55, 3]."""
    j = JOINT_INDEX[carrier_joint(carrier)]
    if carrier not in SCAPULAE:
        return np.asarray(joints[j])
    return np.asarray(joints[j] + pivot(carrier, joints[PARENTS[j]], joints[j]))


def with_carriers(rotations: Array, positions: Array) -> tuple[Array, Array]:
    """Return global rotations [61, 3, 3] and positions [61, 3] of `CARRIERS` for those of the joints."""
    turns, places = [rotations], [positions]
    for carrier in CARRIERS[len(JOINTS) :]:
        j = JOINT_INDEX[carrier_joint(carrier)]
        before, place = rotations[PARENTS[j]], positions[j]
        if carrier in ULNAE:
            turn = _bent(before.T @ rotations[j])
        else:
            turn = _followed(carrier, before.T @ rotations[j])
            place = place + before @ pivot(carrier, positions[PARENTS[j]], place)
        turns.append((before @ turn)[None])
        places.append(place[None])
    return np.concatenate(turns), np.concatenate(places)


def _bent(elbow: Array) -> Array:
    """Return the rotation of an ulna for that of the elbow: up to pronation, which leaves its axis alone."""
    x, y, z = elbow[:, 0]
    return axis_rotation(Y, math.atan2(-z, x)) @ axis_rotation(Z, math.asin(min(max(y, -1.0), 1.0)))


def _followed(scapula: str, shoulder: Array) -> Array:
    """Return the rotation of a shoulder blade for that of the shoulder."""
    side = 1.0 if scapula.startswith("left") else -1.0
    turn, spin = np.empty((3, 3)), np.empty((3, 3))
    x, y, z = side * shoulder[:, 0]
    turn_scapula(side, x, y, z, turn, spin)
    return turn


def forward_kinematics(rest: Array, angles: Array) -> tuple[Array, Array]:
    """Return joint rotations [55, 3, 3] and positions [m] [55, 3] in the frame of the pelvis.

    Args:
        rest: Joint centres in the T-pose [m], shape [55, 3].
        angles: DoF angles, zero in the T-pose [rad], shape [112].
    """
    local = joint_rotations(angles)
    rotations, positions = local.copy(), np.zeros((len(JOINTS), 3))
    for j in range(1, len(JOINTS)):
        parent = PARENTS[j]
        rotations[j] = rotations[parent] @ local[j]
        positions[j] = positions[parent] + rotations[parent] @ (rest[j] - rest[parent])
    return rotations, positions
