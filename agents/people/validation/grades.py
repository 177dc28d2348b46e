"""Manual muscle testing as a clinician does it: every grade in every position, as movements.

Five motions, each with gravity eliminated (the plane of the motion level), against gravity (as the textbook
lays the person), and against the examiner's hand where the limb is heavy. The person wishes the end of the
range; what counts is how much of it the joint goes. Graded is a whole side, or one group alone with normal
muscles around it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np

from rcare_marl import assets
from rcare_marl.config import read_yaml
from rcare_marl.pose import Array

from ..actuation.drive import ActuationConfig
from ..actuation.graded import body_test, frame_of, normal_torques, torque_holding
from ..actuation.muscular import Excitation
from ..avatar import AvatarConfig, load_avatar
from ..body.anthropometry import Sex
from ..body.skeleton import DOFS
from ..profile import ClinicalProfile, SideProfile, muscle_groups_of
from ..strength import RangeTest, Resistance, mmt_tests
from .check import Check
from .single_joint import SingleJoint

Kind = Literal["skeletal", "muscle"]
KINDS: tuple[Kind, ...] = ("skeletal", "muscle")
Position = Literal["gravity eliminated", "against gravity"]
POSITIONS: tuple[Position, ...] = ("gravity eliminated", "against gravity")

GROUPS = (
    "shoulder_abductors",
    "shoulder_flexors",
    "elbow_flexors",
    "hip_flexors",
    "knee_extensors",
)
GRADES = (1.0, 2.0, 3.0, 4.0)
SIDE = "right"
SECONDS = 9.0
COMPLETE = 0.9  # of the range of the test: the whole range, to a clinician's eye
HALF = 0.5  # of the range: less against gravity is no more than 2+
STILL_SHARE = 0.05  # of the range: less than this nobody sees
GIVES = math.radians(15.0)  # more than this and the examiner has broken the hold

HEAVY = 0.85  # of the greatest weight: there the limb is held, and not at a locked end of the range

TUNED = ("karan", "caregiver")  # avatars on which figures were chosen
HELD_OUT: dict[str, tuple[str, float, float]] = {  # avatar, stature [m], mass [kg]
    "kim": ("kim", 0.0, 0.0),
    "jose": ("jose", 0.0, 0.0),
    "karan, 1.92 m and 110 kg": ("karan", 1.92, 110.0),
    "caregiver, 1.48 m and 42 kg": ("caregiver", 1.48, 42.0),
}
MEANING = (
    "what the grades say in teaching (2: the whole range with gravity eliminated; 2+: less than half of it "
    "against gravity; 3: the whole range against gravity); positions after Hislop et al. from memory"
)


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
    grades = dict.fromkeys(sorted(muscle_groups_of(SIDE)), grade)
    profile = ClinicalProfile(right=SideProfile(mmt=grades))
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


def _joint(
    avatar: AvatarConfig,
    kind: Kind,
    test: RangeTest,
    down: Array,
    *,
    excitation: Excitation = "posture",
) -> SingleJoint:
    config = ActuationConfig(kind=kind, excitation=excitation)
    return SingleJoint(avatar, DOFS[test.dof].name, config, angles=test.angles, gravity=down)


def moved(avatar: AvatarConfig, kind: Kind, group: str, position: Position) -> float:
    """Return how much of the range a person goes who wishes its end [share of the range].

    A relaxed limb that comes to rest further on begins there.
    """
    test = _test_of(avatar, group)
    joint = _joint(avatar, kind, test, _down(test, position))
    joint.drive.relax()
    rest = float(joint.move(SECONDS).angles[-1])
    if position == "against gravity" and (rest - joint.start) * test.sign > 0.0:
        joint.put(rest)
    else:
        joint.put(joint.start)
    motion = joint.move(SECONDS, towards=float(test.path[-1]))
    gone = float((motion.angles * test.sign).max() - joint.start * test.sign)
    return max(gone, 0.0) / abs(float(test.path[-1] - test.path[0]))


def stirred(avatar: AvatarConfig, kind: Kind, group: str, position: Position) -> float:
    """Return how much of the range a wish moves a relaxed limb at rest [share of the range]."""
    test = _test_of(avatar, group)
    ways = []
    for wish in (None, float(test.path[-1])):
        joint = _joint(avatar, kind, test, _down(test, position))
        joint.drive.relax()
        joint.move(SECONDS)
        ways.append(joint.move(SECONDS, towards=wish).angles * test.sign)
    gone = float((ways[1] - ways[0]).max())
    return max(gone, 0.0) / abs(float(test.path[-1] - test.path[0]))


def _down(test: RangeTest, position: Position) -> Array:
    return test.down if position == "against gravity" else np.zeros(3)


def holds(avatar: AvatarConfig, kind: Kind, group: str, resistance: Resistance) -> bool:
    """Return whether a limb holds where it is heaviest, with all effort, against the examiner's hand."""
    test = _test_of(avatar, group)
    heavy = np.flatnonzero(test.weight >= HEAVY * test.heaviest)
    middle = 0.5 * (len(test.path) - 1)
    at = float(test.path[heavy[np.argmin(np.abs(heavy - middle))]])
    normal = float(normal_torques(avatar.sex)[test.dof, int(test.sign > 0)])
    joint = _joint(avatar, kind, test, test.down, excitation="unit")
    press = mmt_tests().resistance.torque(resistance, test.heaviest, normal)
    press += test.heaviest - float(test.sign * joint.weight(at))
    joint.put(at)
    joint.move(1.5, effort=test.sign, held=True)
    motion = joint.move(4.0, effort=test.sign, load=-test.sign * press)
    return bool(((motion.angles - at) * test.sign).min() > -GIVES)


def _moves(avatar: AvatarConfig, kind: Kind, group: str, grade: float) -> list[Case]:
    out = []
    for position in POSITIONS:
        low, high = 0.0, STILL_SHARE
        if grade >= 2.0:
            low, high = (
                (COMPLETE, math.inf) if grade >= 3.0 or position == POSITIONS[0] else (0.0, HALF)
            )
        found = (moved if grade >= 2.0 else stirred)(avatar, kind, group, position)
        out.append(Case(group, grade, position, found, low, high))
    return out


def side_cases(avatar: AvatarConfig, kind: Kind, groups: Iterable[str] = GROUPS) -> list[Case]:
    """Return the whole-side cases: five motions, four grades, two positions."""
    return [
        case
        for group in groups
        for grade in GRADES
        for case in _moves(graded_side(avatar, grade), kind, group, grade)
    ]


def group_cases(avatar: AvatarConfig, kind: Kind, groups: Iterable[str] = GROUPS) -> list[Case]:
    """Return the cases of groups that are graded alone."""
    return [
        case
        for group in groups
        for grade in GRADES
        for case in _moves(graded_group(avatar, group, grade), kind, group, grade)
    ]


# Grade, the examiner's resistance, and whether it is held.
HELD: tuple[tuple[float, Resistance, bool], ...] = (
    (3.0, "slight", False),
    (10 / 3, "slight", True),
    (10 / 3, "moderate", False),
    (4.0, "moderate", True),
    (4.0, "strong", False),
    (5.0, "strong", True),
)


def resisted_cases(avatar: AvatarConfig, kind: Kind, groups: Iterable[str] = GROUPS) -> list[Case]:
    """Return the cases with the resistance of the test, on a whole side."""
    out = []
    for group in groups:
        for grade, resistance, is_held in HELD:
            found = float(holds(graded_side(avatar, grade), kind, group, resistance))
            out.append(Case(group, grade, resistance, found, float(is_held), float(is_held)))
    return out


def bodies() -> dict[str, AvatarConfig]:
    """Return who is examined, by name: those on whom figures were chosen, then those held out."""
    out = {name: load_avatar(name) for name in TUNED}
    for name, (avatar, height, mass) in HELD_OUT.items():
        person = load_avatar(avatar)
        out[name] = resized(person, height=height, mass=mass) if height else person
    return out


def checks() -> list[Check]:
    """Return the checks of the family `grade`: cases that are right, and what grade 3 is worth."""
    out = []
    sets = (
        ("whole side", side_cases),
        ("one group alone", group_cases),
        ("resisted", resisted_cases),
    )
    for name, person in bodies().items():
        for kind in KINDS:
            for what, cases in sets:
                found = cases(person, kind)
                right = float(sum(case.is_right for case in found))
                case = f"{name}, {kind}: {what}, cases right"
                count, is_fitted = float(len(found)), name in TUNED
                out.append(
                    Check("grade", case, right, count, count, "cases", MEANING, "read", is_fitted)
                )
    return out + [
        _weight(group, sex, low, high, study["source"])
        for study in read_yaml(assets.ROOT / "clinical" / "limb_weights.yaml")["published"]
        for group, sex, low, high in study["rows"]
    ]


def _weight(group: str, sex: Sex, low: float, high: float, source: str) -> Check:
    """Return the check of what share of normal strength the weight of a limb is."""
    person = load_avatar("karan" if sex == "male" else "caregiver")
    share = torque_holding(frame_of(person), SIDE, group) / mmt_tests().shares.holding
    case = f"weight of the limb, {group}, {sex}"
    return Check("grade", case, share, low, high, "of normal", source, "read", False)
