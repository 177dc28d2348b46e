"""Poses from the joint angles of a simulated person."""

from __future__ import annotations

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from ...people.body.skeleton import DOFS, JOINT_INDEX, forward_kinematics
from ..recognition.recogniser import Frame
from ..upper_body import ARM, MOTIONS, SIDES, SIGN
from .arm_pose import arm_motion

TO_BODY = np.array(
    ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
)  # from x left, y up, z forward


class JointsSource:
    """Makes frames of joint angles: sixteen of the upper body, or all 112 of a simulated person."""

    def __init__(self, joints: Array | None = None) -> None:
        """Prepare a source.

        Args:
            joints: Joint centres of the person in the T-pose [m], shape [55, 3], as of `BodyModel.joints`;
                needed for the angles of a simulated person only.
        """
        self._joints = joints
        self._rotation = dict.fromkeys(SIDES, 0.0)

    def update(self, raw: Array, time: float) -> Frame | None:
        """Return the frame at a time [s]; None if nothing is known.

        Args:
            raw: Angles of `MOTIONS` [rad], shape [16], NaN where unknown; or of all DoFs, shape [112].
            time: [s].

        Raises:
            ConfigError: If there are neither 16 nor 112 angles, or joint centres are missing.
        """
        raw = np.asarray(raw, dtype=np.float64)
        if raw.shape == (len(MOTIONS),):
            return Frame(time, raw) if np.isfinite(raw).any() else None
        if raw.shape != (len(DOFS),):
            raise ConfigError(
                f"expected {len(MOTIONS)} or {len(DOFS)} angles, got shape {raw.shape}"
            )
        if self._joints is None:
            raise ConfigError("the angles of a simulated person need joint centres")
        return Frame(time, self._upper_body(*forward_kinematics(self._joints, raw)))

    def _upper_body(self, rotations: Array, positions: Array) -> Array:
        angles = np.empty(len(MOTIONS))
        turned = TO_BODY @ rotations @ TO_BODY.T  # of each joint, in the frame of the body
        trunk, head = turned[JOINT_INDEX["spine3"]], turned[JOINT_INDEX["head"]]
        x, y, z = trunk[:, 2].tolist()
        flexion, lateral = float(np.arctan2(x, z)), float(np.arcsin(np.clip(y, -1, 1)))
        # Trunk: turned about y by the flexion, about x by the lateral flexion, then about its own axis.
        forward = np.array((np.cos(flexion), 0.0, -np.sin(flexion)))
        across = np.cross(trunk[:, 2], forward)
        rotation = np.arctan2(trunk[:, 0] @ across, trunk[:, 0] @ forward)
        angles[:3] = flexion, lateral, rotation
        neck = trunk.T @ head
        angles[3] = np.arcsin(np.clip(-neck[2, 0], -1, 1))
        angles[4] = -np.arctan2(neck[2, 1], neck[2, 2])
        angles[5] = np.arctan2(neck[1, 0], neck[0, 0])
        for side in SIDES:
            shoulder, elbow, wrist = (
                TO_BODY @ positions[JOINT_INDEX[f"{side}_{joint}"]]
                for joint in ("shoulder", "elbow", "wrist")
            )
            upper, fore = (trunk.T @ _unit(v) for v in (elbow - shoulder, wrist - elbow))
            wrist_turn = trunk.T @ turned[JOINT_INDEX[f"{side}_wrist"]]
            # In the T-pose the fingers point to the side and the back of the hand up.
            fingers, back = wrist_turn[:, 1] * SIGN[side], wrist_turn[:, 2]
            hand = np.column_stack((fingers, np.cross(back, fingers), back))
            motion = arm_motion(side, upper, fore, hand, rotation=self._rotation[side])
            self._rotation[side] = motion[2]
            angles[ARM[side]] = motion
        return angles


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
