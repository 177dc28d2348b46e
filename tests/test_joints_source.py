"""Promises of the coach's source that reads joint angles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rcare_marl.agents.coaching.sources.joints_source import JointsSource
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS, JOINT_INDEX, JOINTS
from rcare_marl.errors import ConfigError


def test_joint_angles_of_a_simulated_person_show_the_same_arms() -> None:
    joints = np.zeros((len(JOINTS), 3))  # body axes: x left, y up, z forward
    for name, place in {
        "spine1": (0, 0.1, 0),
        "spine2": (0, 0.2, 0),
        "spine3": (0, 0.3, 0),
        "neck": (0, 0.5, 0),
        "head": (0, 0.6, 0),
    }.items():
        joints[JOINT_INDEX[name]] = place
    for side, sign in (("left", 1), ("right", -1)):
        for joint, x in (("collar", 0.05), ("shoulder", 0.18), ("elbow", 0.45), ("wrist", 0.7)):
            joints[JOINT_INDEX[f"{side}_{joint}"]] = (sign * x, 0.45, 0.0)
    source = JointsSource(joints)
    spread = source.update(np.zeros(len(DOFS)), 0.0)
    assert spread is not None
    for side in ("left", "right"):
        elevation, plane, _, elbow, _ = spread.angles[ARM[side]]
        assert (elevation, plane, elbow) == pytest.approx((math.pi / 2, 0.0, 0.0), abs=1e-6)
    assert spread.angles[:6] == pytest.approx(np.zeros(6), abs=1e-9)
    bent = np.zeros(len(DOFS))
    bent[DOF_INDEX["left_elbow_flexion"]] = 1.0
    frame = source.update(bent, 0.1)
    assert frame is not None and frame.angles[MOTION_INDEX["left_elbow_flexion"]] == pytest.approx(
        1.0
    )


def test_sixteen_angles_pass_a_joints_source_as_they_are() -> None:
    angles = np.arange(16.0)
    frame = JointsSource().update(angles, 0.5)
    assert frame is not None and (frame.angles == angles).all()
    assert JointsSource().update(np.full(16, np.nan), 0.5) is None
    with pytest.raises(ConfigError, match="16 or 112"):
        JointsSource().update(np.zeros(3), 0.0)
    with pytest.raises(ConfigError, match="joint centres"):
        JointsSource().update(np.zeros(len(DOFS)), 0.0)
