"""Manual muscle testing as a clinician does it: every grade in every position, as movements.

Five motions, each with gravity eliminated (it pulls along the axis) and against gravity (as the textbook lays the
person), and against the resistance of the examiner's hand where the limb is heaviest. The person wishes the end
of the range; what counts is how much of it the joint goes. Graded is a whole side, or one group alone with
normal muscles around it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np

from rcare_marl.pose import Array

from ..actuation.drive import ActuationConfig
from ..actuation.graded import body_test, frame_of, normal_torques, torque_holding
from ..avatar import AvatarConfig, load_avatar
from ..body.skeleton import DOFS
from ..profile import ClinicalProfile, SideProfile, clinical_norms
from ..strength import RangeTest, mmt_tests
from .check import Check
from .single_joint import SingleJoint

Kind = Literal["skeletal", "muscle"]
KINDS: tuple[Kind, ...] = ("skeletal", "muscle")
Position = Literal["gravity eliminated", "against gravity"]
POSITIONS: tuple[Position, ...] = ("gravity eliminated", "against gravity")
Resistance = Literal["slight", "moderate", "strong"]

GROUPS = (
    "shoulder_abductors",
    "shoulder_flexors",
    "elbow_flexors",
    "hip_flexors",
    "knee_extensors",
)
GRADES = (1.0, 2.0, 3.0, 4.0)
SIDE = "right"
SECONDS = 6.0
COMPLETE = 0.9  # of the range of the test: the whole range, to a clinician's eye
HALF = 0.5  # of the range: less against gravity is no more than 2+
STILL = math.radians(5.0)  # less than this nobody sees
GIVES = math.radians(15.0)  # more than this and the examiner has broken the hold

TUNED = ("karan", "caregiver")


class Case(NamedTuple):
    """What was tested, and how much of the range the joint went, or whether it held.

    Attributes:
        group: Muscle group.
        grade: MMT grade.
        position: Position, or the resistance of the examiner.
        found: Share of the range; with a resistance 1 if the limb held, else 0.
        low: Least that the grade means.
        high: Greatest.
    """

    group: str
    grade: float
    position: str
    found: float
    low: float
    high: float

    @property
    def is_right(self) -> bool:
        """Whether it is what the grade means."""
        return self.low <= self.found <= self.high


def graded_side(avatar: AvatarConfig, grade: float) -> AvatarConfig:
    """Return an avatar's body with a right side of one grade in all groups, and healthy ranges."""
    motions = {m for d in DOFS if d.side == SIDE for m in (d.positive, d.negative)}
    groups = {clinical_norms().motions[m].group for m in motions}
    profile = ClinicalProfile(right=SideProfile(mmt=dict.fromkeys(groups, grade)))
    return dataclasses.replace(avatar, profile=profile)


def graded_group(avatar: AvatarConfig, group: str, grade: float) -> AvatarConfig:
    """Return an avatar's body with one graded group on the right, all else normal."""
    profile = ClinicalProfile(right=SideProfile(mmt={group: grade}))
    return dataclasses.replace(avatar, profile=profile)


def resized(avatar: AvatarConfig, *, height: float, mass: float) -> AvatarConfig:
    """Return an avatar of another stature [m] and mass [kg]."""
    return dataclasses.replace(avatar, height_m=height, mass_kg=mass)


def _test_of(avatar: AvatarConfig, group: str) -> RangeTest:
    test = body_test(frame_of(avatar), SIDE, group)
    assert test is not None, group
    return test


def _joint(avatar: AvatarConfig, kind: Kind, test: RangeTest, down: Array) -> SingleJoint:
    config = ActuationConfig(kind=kind, excitation="posture")
    return SingleJoint(avatar, DOFS[test.dof].name, config, angles=test.angles, gravity=down)


def across(test: RangeTest) -> Array:
    """Return a direction in the frame of the pelvis that leaves the limb without weight, shape [3].

    It is the axis of the joint, the only direction in which gravity has no moment about it.
    """
    weights = np.array(
        [[_weight_row(test, direction, end) for direction in np.eye(3)] for end in (0, -1)]
    )
    found = np.linalg.svd(weights)[2][-1]
    return np.asarray(found / np.linalg.norm(found))
