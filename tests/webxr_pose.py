"""What a headset would send of an upper body."""

from __future__ import annotations

from typing import Any

from rcare_marl.agents.coaching.upper_body import UpperBody
from rcare_marl.baselines.coaching.page.message import HandJoints, Place
from rcare_marl.baselines.coaching.page.sight import FROM_WEBXR, HAND_IN_GRIP
from rcare_marl.pose import Array, matrix_from_quaternion, quaternion_from_matrix


def head_place(position: Array, quaternion: Array) -> tuple[float, ...]:
    """Return a head's pose, of our frame, as WebXR has it: position [m] and quaternion, seven numbers."""
    turn = FROM_WEBXR.T @ matrix_from_quaternion(quaternion) @ FROM_WEBXR
    return _seven(position, turn)


def grip_place(side: str, position: Array, quaternion: Array) -> tuple[float, ...]:
    """Return a hand's pose, of our frame, as a grip of WebXR: seven numbers."""
    turn = FROM_WEBXR.T @ matrix_from_quaternion(quaternion) @ HAND_IN_GRIP[side].T
    return _seven(position, turn)


def _seven(position: Array, turn: Array) -> tuple[float, ...]:
    return (*(FROM_WEBXR.T @ position).tolist(), *quaternion_from_matrix(turn).tolist())


def webxr_pose(side: str, angles: Any) -> tuple[HandJoints, Place, Place, Any]:
    """Return a hand's joints and grip and the head in WebXR's frame, and the poses they were made of."""
    body = UpperBody.of_height(1.7)
    poses = body.poses(angles)
    position, quaternion = poses[f"{side}_hand"]
    turn = matrix_from_quaternion(quaternion)
    wrist = position - body.palm * turn[:, 0]
    across = turn[:, 1] * (1 if side == "left" else -1)
    points = (
        wrist,
        wrist + 0.09 * turn[:, 0] - 0.03 * across,
        wrist + 0.09 * turn[:, 0],
        wrist + 0.08 * turn[:, 0] + 0.04 * across,
    )
    joints = HandJoints(*(tuple((FROM_WEBXR.T @ p).tolist()) for p in points))
    grip = grip_place(side, position, quaternion)
    head = head_place(*poses["head"])
    return joints, Place(grip[:3], grip[3:]), Place(head[:3], head[3:]), poses  # type: ignore[arg-type]
