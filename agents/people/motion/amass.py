"""Clips in the layout of the AMASS archive: numpy files with axis-angle poses of SMPL-like bodies.

N. Mahmood et al., "AMASS: Archive of Motion Capture as Surface Shapes", ICCV 2019. Only the layout is
read; such recordings have licences of their own, and none comes with this package.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError, shown
from rcare_marl.pose import matrix_from_quaternion, quaternion_from_matrix, rotation_vector
from rcare_marl.reading import ArrayFile, check_numbers

from ..body.anthropometry import Sex
from ..body.skeleton import JOINT_INDEX, JOINTS, joint_rotations
from .clip import Clip, Motion

RATES = ("mocap_framerate", "mocap_frame_rate")
# Thigh and shank of the person recorded, unless given: of 1.70 m, by the 0.491 of stature of Drillis and
# Contini 1966 (from memory). The files tell the body only through a licensed model.
LEG = 0.491 * 1.70
FARTHEST = 1e5  # [rad, m or 1/s] that any number may be
SLOWEST = 0.01  # frames a second
_HANDS = JOINT_INDEX["left_index1"]
# Joints in the order of the file, by how many numbers a frame has: SMPL, SMPL-H and SMPL-X.
_ORDERS: dict[int, tuple[str, ...]] = {
    72: JOINTS[:22],  # and two hands without fingers, which are left out
    156: JOINTS[:22] + JOINTS[_HANDS:],
    165: JOINTS,
}


def load_amass(path: str | Path, *, leg: float = LEG) -> Clip:
    """Return the clip in a numpy file with `poses`, `trans` and a frame rate.

    The world has z up. `trans` is taken as the path of the pelvis: the model's own origin, which only
    a licensed body would tell, is a constant away. `gender` and `betas` are not needed, since the
    avatar has a body of its own.

    Args:
        path: The file: `poses` [t, 72, 156 or 165] in radians, `trans` [t, 3] in metres, and
            `mocap_framerate` or `mocap_frame_rate` [1/s].
        leg: Length of thigh and shank of the person recorded [m].

    Raises:
        ConfigError: If the file cannot be read, or lacks or misshapes an array.
    """
    file = Path(path)
    data = ArrayFile(file, "a motion")
    rate_key = next((key for key in RATES if key in data.names), " or ".join(RATES))
    poses, trans, rate = data.take("poses", "trans", rate_key)
    check_numbers({"poses": poses, "trans": trans, "the frame rate": rate}, file, largest=FARTHEST)
    if poses.ndim != 2 or poses.shape[1] not in _ORDERS or not len(poses):
        raise ConfigError(
            f"{file}: poses must have shape [t, n] with n one of {', '.join(map(str, _ORDERS))}, "
            f"got {poses.shape}"
        )
    if trans.shape != (len(poses), 3):
        raise ConfigError(f"{file}: trans must have shape {(len(poses), 3)}, got {trans.shape}")
    if rate.size != 1 or not SLOWEST <= float(rate.reshape(-1)[0]) <= FARTHEST:
        raise ConfigError(
            f"{file}: the frame rate must be one number from {SLOWEST} to {FARTHEST:g}, got {shown(rate)}"
        )
    order = _ORDERS[poses.shape[1]]
    vectors = poses[:, : 3 * len(order)].astype(np.float64).reshape(len(poses), len(order), 3)
    rotations = np.tile(np.eye(3), (len(poses), len(JOINTS), 1, 1))
    for k, joint in enumerate(order):
        rotations[:, JOINT_INDEX[joint]] = Rotation.from_rotvec(vectors[:, k]).as_matrix()
    turns = rotations[:, 0].copy()
    rotations[:, 0] = np.eye(3)
    return Clip(
        rate=float(rate.reshape(-1)[0]),
        rotations=rotations,
        pelvis=trans.astype(np.float64),
        turns=turns,
        leg=leg,
    )


def save_amass(path: str | Path, motion: Motion, *, gender: Sex) -> None:
    """Write a motion as a numpy file in the layout of SMPL-X recordings: 165 numbers a frame.

    Args:
        path: The file, ending in `.npz`.
        motion: What moves.
        gender: Written along, since other readers ask for it.
    """
    poses = np.zeros((len(motion.angles), 3 * len(JOINTS)))
    for t, angles in enumerate(motion.angles):
        local = joint_rotations(angles)
        local[0] = matrix_from_quaternion(motion.quaternions[t])
        poses[t] = np.concatenate([rotation_vector(quaternion_from_matrix(r)) for r in local])
    np.savez(
        path,
        poses=poses,
        trans=motion.pelvis,
        mocap_frame_rate=np.array(motion.rate),
        gender=np.array(gender),
        betas=np.zeros(16),
    )
