"""From the skeleton of a BVH file to ours and back: names of joints, rest posture, directions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rcare_marl.errors import ConfigError, UnknownNameError, check_name
from rcare_marl.pose import Array, matrix_from_quaternion

from ..body.posture import UPRIGHT
from ..body.skeleton import FINGERS, JOINT_INDEX, JOINTS, PARENTS, SIDES, joint_rotations
from .bvh import POSITIONS, Bvh, read_bvh, write_bvh
from .clip import Clip, Motion, leg_length

# What other skeletons call our joints, without side, in small letters, the likeliest first. A name is
# taken once, in this order: so `LeftShoulder` is a collar bone where there is a `LeftArm`, else a
# shoulder, and `LeftFoot` an ankle unless there is a `LeftAnkle`.
_LIMB_NAMES: dict[str, tuple[str, ...]] = {
    "hip": ("upleg", "thigh", "upperleg", "hip"),
    "knee": ("leg", "knee", "lowleg", "lowerleg", "shin", "calf"),
    "ankle": ("ankle", "foot"),
    "foot": ("toebase", "toe", "ball", "foot", "toes"),
    "shoulder": ("arm", "upperarm", "uparm", "shldr", "shoulder"),
    "collar": ("collar", "clavicle", "shoulder"),
    "elbow": ("forearm", "elbow", "lowerarm", "lowarm"),
    "wrist": ("wrist", "hand"),
    "eye_smplhf": ("eyesmplhf", "eye"),
}
_AXIAL_NAMES = {
    "pelvis": ("pelvis", "hips", "hip", "root"),
    "neck": ("neck", "neck1"),
    "head": ("head",),
    "jaw": ("jaw",),
}
_TRUNK = ("spine1", "spine2", "spine3")
NEEDED = ("pelvis",) + tuple(
    f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle", "shoulder", "elbow")
)


def _plain(name: str) -> str:
    """Return a name without prefix, blanks and case, its side written out in front."""
    bare = re.split(r"[:|]", name)[-1]
    sided = re.match(r"^(.*)[._ ](l|r|left|right)$", bare, re.IGNORECASE)
    if sided:
        bare = f"{sided[2]}_{sided[1]}"
    if not bare.lower().startswith(SIDES):  # lThigh, LHand, L_Hip
        short = re.match(r"^([lrLR])(?=[._ A-Z])", bare)
        if short:
            bare = {"l": "left", "r": "right"}[short[1].lower()] + bare[1:]
    return re.sub(r"[^a-z0-9]", "", bare.lower())


def map_joints(bvh: Bvh, names: Mapping[str, str] | None = None) -> dict[str, int]:
    """Return the joint of a BVH file for each of ours that it has.

    Args:
        bvh: The file.
        names: Our joint by the file's name, beside and before what is found by itself.

    Raises:
        UnknownNameError: If `names` has a joint that the file, or our skeleton, does not have.
        ConfigError: If a main joint of trunk, arms or legs is not found.
    """
    found: dict[str, int] = {}
    for theirs, ours in (names or {}).items():
        check_name("joint in the BVH file", theirs, bvh.names)
        if ours not in JOINT_INDEX:
            raise UnknownNameError("joint", ours, JOINTS)
        found[ours] = bvh.names.index(theirs)
    plain = [_plain(name) for name in bvh.names]

    def take(ours: str, *choices: str) -> None:
        for choice in choices:
            if ours not in found and choice in plain:
                j = plain.index(choice)
                if j not in found.values():
                    found[ours] = j

    for ours, choices in _AXIAL_NAMES.items():
        take(ours, *choices)
    for side in SIDES:
        for joint, choices in _LIMB_NAMES.items():
            take(f"{side}_{joint}", *(side + choice for choice in choices))
        for finger in FINGERS:
            for k in (1, 2, 3):
                also = "little" if finger == "pinky" else finger
                take(
                    f"{side}_{finger}{k}",
                    f"{side}hand{finger}{k}",
                    f"{side}{finger}{k}",
                    f"{side}{also}{k}",
                )
    _map_trunk(bvh, found)
    missing = [joint for joint in NEEDED if joint not in found]
    if missing:
        raise ConfigError(
            f"the BVH skeleton has no joint that looks like {', '.join(missing)}; give them by name: "
            f"names={{'<name in the file>': {missing[0]!r}, ...}}. It has {', '.join(bvh.names)}"
        )
    return found


def _map_trunk(bvh: Bvh, found: dict[str, int]) -> None:
    """Map the joints between pelvis and arms to the spine: the lowest, a middle and the highest."""
    arm = next((found[j] for j in ("left_collar", "left_shoulder") if j in found), None)
    if arm is None or "pelvis" not in found or any(joint in found for joint in _TRUNK):
        return
    path: list[int] = []
    j = bvh.parents[arm]
    while j >= 0 and j != found["pelvis"]:
        path.insert(0, j)
        j = bvh.parents[j]
    path = [j for j in path if j not in found.values()]
    if len(path) == 1:
        found["spine2"] = path[0]
    elif path:
        found["spine1"], found["spine3"] = path[0], path[-1]
        if len(path) > 2:
            found["spine2"] = path[len(path) // 2]


def _body_axes(rest: Array, found: Mapping[str, int]) -> Array:
    """Return our body axes (left, up, forward) in the file's: columns, shape [3, 3]."""
    left = rest[found["left_hip"]] - rest[found["right_hip"]]
    up = (
        0.5 * (rest[found["left_shoulder"]] + rest[found["right_shoulder"]]) - rest[found["pelvis"]]
    )
    axes = np.zeros((3, 3))
    for k, vector in enumerate((left, up)):
        nearest = int(np.argmax(np.abs(vector)))
        axes[nearest, k] = np.sign(vector[nearest])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    if abs(np.linalg.det(axes) - 1) > 1e-9:
        raise ConfigError(
            "the OFFSETs of the BVH file do not draw a standing body: hips run along "
            f"{np.round(left, 3).tolist()} and the trunk along {np.round(up, 3).tolist()}"
        )
    return axes


def load_bvh(path: str | Path, *, names: Mapping[str, str] | None = None) -> Clip:
    """Return the clip in a BVH file.

    The rest posture (all channels zero) must be a standing one, T-pose or not; lengths may have any
    unit. The body stands on the plane across its own up, whichever axis that is. Directions of arms
    and legs are kept, whatever the rest posture is.

    Args:
        path: The file.
        names: Our joint by the file's name, for skeletons whose names are not found by themselves.

    Raises:
        ConfigError: If the file is malformed (the message names the line), a main joint is missing,
            or the rest posture does not stand.
        UnknownNameError: If `names` has a joint that is not there.
    """
    bvh = read_bvh(path)
    found = map_joints(bvh, names)
    theirs = bvh.rest_positions()
    axes = _body_axes(theirs, found)
    local = bvh.local_rotations()
    world = np.empty_like(local)
    positions = np.zeros((len(local), len(bvh.names), 3))
    positions[:, 0] = bvh.root_positions()
    for j, parent in enumerate(bvh.parents):
        world[:, j] = local[:, j] if parent < 0 else world[:, parent] @ local[:, j]
        if parent >= 0:
            positions[:, j] = positions[:, parent] + world[:, parent] @ bvh.offsets[j]
    turned = axes.T @ world @ axes  # in our body axes
    frames = np.empty((len(local), len(JOINTS), 3, 3))
    for j, joint in enumerate(JOINTS):
        if joint in found:
            frames[:, j] = turned[:, found[joint]]
        else:  # not recorded: stays as it is on its parent
            frames[:, j] = frames[:, PARENTS[j]]
    rotations = np.tile(np.eye(3), (len(local), len(JOINTS), 1, 1))
    for j in range(1, len(JOINTS)):
        rotations[:, j] = frames[:, PARENTS[j]].transpose(0, 2, 1) @ frames[:, j]
    rest = np.full((len(JOINTS), 3), np.nan)
    for joint, j in found.items():
        rest[JOINT_INDEX[joint]] = axes.T @ theirs[j]
    to_world = UPRIGHT @ axes.T
    return Clip(
        rate=1 / bvh.frame_time,
        rotations=rotations,
        pelvis=positions[:, found["pelvis"]] @ to_world.T,
        turns=UPRIGHT @ frames[:, 0],
        leg=leg_length(rest),
        rest=rest,
    )


def save_bvh(path: str | Path, motion: Motion, joints: Array) -> None:
    """Write a motion as a BVH file with our joints, y up, in metres, channels z, x, y.

    Args:
        path: The file.
        motion: What moves.
        joints: Joint centres of the body in the T-pose [m], shape [55, 3].
    """
    offsets = np.array(
        [
            joints[j] - joints[parent] if parent >= 0 else np.zeros(3)
            for j, parent in enumerate(PARENTS)
        ]
    )
    turning = ("Zrotation", "Xrotation", "Yrotation")
    channels = [(*POSITIONS, *turning), *([turning] * (len(JOINTS) - 1))]
    rows = []
    for angles, p, q in zip(motion.angles, motion.pelvis, motion.quaternions, strict=True):
        local = joint_rotations(angles)
        local[0] = UPRIGHT.T @ matrix_from_quaternion(q)
        m = local
        x = np.arcsin(np.clip(m[:, 2, 1], -1, 1))  # R = Rz Rx Ry
        z = np.arctan2(-m[:, 0, 1], m[:, 1, 1])
        y = np.arctan2(-m[:, 2, 0], m[:, 2, 2])
        turns = np.degrees(np.column_stack((z, x, y))).ravel()
        rows.append(np.concatenate((UPRIGHT.T @ p, turns)))
    write_bvh(path, Bvh(JOINTS, PARENTS, offsets, tuple(channels), 1 / motion.rate, np.array(rows)))
