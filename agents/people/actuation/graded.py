"""What a grade of manual muscle testing leaves of a person's strength: of joint torques and of muscles.

Both are computed for the body and the muscles at hand. Of a joint torque (the skeletal drive, and the limit
of each motion with muscles) grade 3 is the greatest weight in the range of its test. Of a muscle it is the
least activation that takes the limb through that range, while all others are at rest: that of the group
which is graded, or, where it owns too little of the motion, that of all muscles which make it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array
from rcare_marl.tree.joint_tree import JointTree
from rcare_marl.world import GRAVITY

from ..avatar import AvatarConfig, body_model, body_segments
from ..body.anthropometry import Sex
from ..body.person_tree import person_tree
from ..body.skeleton import DOF_INDEX, DOFS, SIDES, Dof
from ..profile import clinical_norms
from ..strength import (
    LEAST_HOLDING,
    RangeTest,
    StrengthMap,
    bisected,
    full_share,
    holding_share,
    mmt_tests,
    range_test,
    strength_share,
    tissue_share,
)
from . import muscle_kernel as kernel
from .muscle_layout import crossing
from .muscle_model import MuscleModel
from .muscle_unit import MuscleUnit
from .musculature import Musculature

Share = Callable[[Dof, str, float], float]  # DoF, motion, MMT grade -> share of strength

FLICKER = 0.01  # of full excitation: what grade 1 shows; its motion's limit lets nothing move
# Activation of grade 3 by what the range needs: muscles shorten while they move, the motion's limit is exact.
SPARE = 1.25
FAR = (
    0.93  # of the range, which is all of it to a clinician's eye: so far muscles must take the limb
)


class Frame(NamedTuple):
    """A person's bones and flesh.

    Attributes:
        path: The body model.
        height: [m].
        mass: [kg].
        sex: Of the proportions.
    """

    path: Path
    height: float
    mass: float
    sex: Sex


def frame_of(avatar: AvatarConfig) -> Frame:
    """Return the body of an avatar."""
    return Frame(avatar.body_path(), avatar.height_m, avatar.mass_kg, avatar.sex)


def one_joint(frame: Frame, angles: Array, dof: str) -> JointTree:
    """Return the tree of one DoF of a body, all others held at `angles` [rad], shape [112]."""
    return person_tree(body_segments(*frame), body_model(*frame[:2]).joints, angles, [dof])


@lru_cache(maxsize=512)
def body_test(frame: Frame, side: str, group: str) -> RangeTest | None:
    """Return the test of a muscle group on a body; None where there is none."""
    return range_test(lambda angles, dof: one_joint(frame, angles, dof), side, group)


def normal_torques(sex: Sex) -> Array:
    """Return a healthy person's greatest torques of each DoF, against and along it [N·m], [112, 2]."""
    norms = clinical_norms()
    factor = norms.female_strength if sex == "female" else 1.0
    return factor * np.array(
        [[norms.motions[d.negative].torque, norms.motions[d.positive].torque] for d in DOFS]
    )


def torque_holding(frame: Frame, side: str, group: str) -> float:
    """Return the share of normal torque that grade 3 of a group is."""
    test = body_test(frame, side, group)
    if test is None:
        return LEAST_HOLDING
    normal = normal_torques(frame.sex)[test.dof, int(test.sign > 0)]
    return holding_share(mmt_tests().shares.holding * test.heaviest, float(normal))


@lru_cache(maxsize=32)
def level_torques(frame: Frame) -> tuple[float, ...]:
    """Return what holds all beyond each DoF where it weighs most [N·m], 112 values.

    That is where it lies level, straight or with bent knees and elbows, however the body is turned.
    """
    straight = np.array([-dof.clinical_zero for dof in DOFS])
    bent = straight.copy()
    for side in SIDES:
        for joint in ("knee", "elbow"):
            bent[DOF_INDEX[f"{side}_{joint}_flexion"]] = 0.5 * np.pi
    tree = person_tree(
        body_segments(*frame), body_model(*frame[:2]).joints, straight, [d.name for d in DOFS]
    )
    return tuple(np.maximum(*(_level(tree, angles) for angles in (straight, bent))).tolist())


def _level(chain: JointTree, angles: Array) -> Array:
    tree, (turns, origins) = chain.arrays, chain.place(angles)
    masses = tree.masses.copy()
    moments = masses[:, None] * (origins + np.einsum("iab,ib->ia", turns, tree.centres))
    for i in range(len(masses) - 1, -1, -1):
        if tree.parents[i] >= 0:
            masses[tree.parents[i]] += masses[i]
            moments[tree.parents[i]] += moments[i]
    arms = moments - masses[:, None] * origins
    axes = np.einsum("iab,ib->ia", turns, tree.axes)
    across = arms - np.sum(arms * axes, axis=1, keepdims=True) * axes
    return np.asarray(GRAVITY * np.linalg.norm(across, axis=1))


def torque_share(avatar: AvatarConfig, strength: StrengthMap) -> Share:
    """Return the share of normal torque by DoF, motion and grade.

    Motions of a group beside the tested one, such as the abduction of a knee, hold the level limb too.
    """
    if strength == "linear":
        return lambda dof, motion, grade: strength_share(grade, "linear")
    frame, normal = frame_of(avatar), normal_torques(avatar.sex)
    tests, motions = mmt_tests(), clinical_norms().motions

    def share(dof: Dof, motion: str, grade: float) -> float:
        if grade in (0.0, 5.0):
            return grade / 5.0
        group, i = motions[motion].group, DOF_INDEX[dof.name]
        holding = torque_holding(frame, dof.side, group)
        test = tests.tests.get(group)
        if test is not None and test.motion != motion:
            needed = tests.shares.holding * level_torques(frame)[i]
            full = float(normal[i, int(motion == dof.positive)])
            holding = max(holding, holding_share(needed, full))
        return strength_share(grade, strength, holding)

    return share


def motion_limits(avatar: AvatarConfig, strength: StrengthMap) -> Array:
    """Return what muscles can do at most about each DoF, against and along it, shape [2, 112, 2].

    The net torque that a person can will [N·m], whichever muscles make it, infinite at grade 5; and the share
    of the tissue's resistance that they overcome besides. The grade is one of the motion: strong muscles of
    another group do not lift what a clinician found unable to rise.
    """
    most, tissue = np.full((len(DOFS), 2), np.inf), np.ones((len(DOFS), 2))
    if strength == "linear":
        return np.stack((most, tissue))
    profile = avatar.profile
    torques = np.column_stack(profile.strength(avatar.sex, torque_share(avatar, strength)))
    for i, dof in enumerate(DOFS):
        for k in range(2):
            grade = profile.grade(dof, positive=k == 1)
            open_end = full_share(grade)
            most[i, k] = torques[i, k] / open_end if open_end > 0 else np.inf
            tissue[i, k] = tissue_share(grade)
    return np.stack((most, tissue))


class Holding(NamedTuple):
    """The activation of grade 3, and the least of grade 2.

    Attributes:
        share: Of grade 3, of full activation.
        poor: Of grade 2: what goes through the range with gravity eliminated.
        makers: Names of all muscles that must help, empty where the group is enough.
    """

    share: float
    poor: float
    makers: frozenset[str]


def unit_shares(
    avatar: AvatarConfig,
    units: Sequence[MuscleUnit],
    strength: StrengthMap,
    muscles: Musculature,
    key: tuple[str | None, tuple[int, int]],
) -> Array:
    """Return the share of full excitation that reaches each muscle, shape [m].

    Args:
        avatar: Whose grades.
        units: The muscles.
        strength: The map.
        muscles: All muscles on the avatar's body.
        key: What tells this musculature from others: its file and when that changed.
    """
    grades = [avatar.profile.side(u.side).mmt.get(u.clinical_group, 5.0) for u in units]
    if strength == "linear":
        return np.array([strength_share(grade, "linear") for grade in grades])
    frame = frame_of(avatar)
    graded: dict[tuple[str, str, bool], float] = {}
    for unit, grade in zip(units, grades, strict=True):
        if 0.0 < grade < 5.0:
            graded[unit.side, unit.clinical_group, _pulls_back(unit)] = grade
    found = {group: _holding(frame, muscles, key, *group) for group in graded}
    out = np.array([float(grade == 5.0) for grade in grades])
    for m, (unit, grade) in enumerate(zip(units, grades, strict=True)):
        if not 0.0 < grade < 5.0:
            continue
        out[m] = _activation(grade, found[unit.side, unit.clinical_group, _pulls_back(unit)])
        for group, holding in found.items():  # those that it must help
            if group[0] == unit.side and unit.name in holding.makers:
                out[m] = max(out[m], _activation(min(grade, graded[group]), holding))
    return out


def _pulls_back(unit: MuscleUnit) -> bool:
    """Return whether a muscle takes the limb back whence its group's test moves it."""
    test = mmt_tests().tests.get(unit.clinical_group)
    return test is not None and bool(test.back) and unit.action_group == test.back


def _activation(grade: float, holding: Holding) -> float:
    share = strength_share(grade, "mmt", holding.share, poor=holding.poor)
    return max(share, FLICKER * min(grade, 1.0))


_known: dict[tuple[object, ...], Holding] = {}


def _holding(
    frame: Frame,
    muscles: Musculature,
    key: tuple[str | None, tuple[int, int]],
    side: str,
    group: str,
    back: bool,
) -> Holding:
    asked = (*frame, *key, side, group, back)
    if asked not in _known:
        if len(_known) > 1024:
            _known.clear()
        _known[asked] = _found_holding(frame, muscles, side, group, back)
    return _known[asked]


def _found_holding(
    frame: Frame, muscles: Musculature, side: str, group: str, back: bool
) -> Holding:
    test = body_test(frame, side, group)
    if test is None:
        return Holding(LEAST_HOLDING, 0.0, frozenset())
    if back:
        test = test._replace(sign=-test.sign, path=test.path[::-1], weight=-test.weight[::-1])
    chain = one_joint(frame, test.angles, DOFS[test.dof].name)
    units = [muscles.units[m] for m in crossing(muscles.units, chain)]
    members = np.array(
        [(u.side, u.clinical_group, _pulls_back(u)) == (side, group, back) for u in units], np.bool_
    )
    if not members.any():
        return Holding(LEAST_HOLDING, 0.0, frozenset())
    test = _most_of(test)
    probe = _Probe(MuscleModel(units, muscles.joints, chain), test)
    makers = probe.makers
    shares = mmt_tests().shares
    against = shares.holding * np.maximum(test.weight, 0.0)
    eliminated = np.full(len(against), shares.grade_2 * shares.holding * test.heaviest)
    # Where nobody's muscles can, with all their might, no grade is about.
    able = probe.torque(1.0, makers | members) > np.maximum(against, eliminated)
    if not able.any():
        return Holding(1.0, 0.0, frozenset())
    is_enough = bool((probe.torque(1.0, members) > against)[able].all())
    active = members if is_enough else makers | members

    def least(wanted: Array) -> float:
        found = bisected(lambda a: float((probe.torque(a, active) - wanted)[able].min()), 0.0)
        return min(max(SPARE * found, LEAST_HOLDING), 1.0)

    helpers = (
        frozenset()
        if is_enough
        else frozenset(u.name for u, helps in zip(units, active, strict=True) if helps)
    )
    return Holding(least(against), least(eliminated), helpers)


def _most_of(test: RangeTest) -> RangeTest:
    """Return a test without the last of its range, where muscles are at their shortest."""
    along = np.linspace(0.0, FAR, len(test.path))
    every = np.linspace(0.0, 1.0, len(test.path))
    path, weight = (np.interp(along, every, values) for values in (test.path, test.weight))
    return test._replace(path=path, weight=weight)


class _Probe:
    """The muscles of a test, at the angles of its range."""

    def __init__(self, model: MuscleModel, test: RangeTest) -> None:
        self._model, self._test = model, test
        self._arms = [
            test.sign * model.moment_arms(test.path[k : k + 1])[:, 0] for k in range(len(test.path))
        ]

    @property
    def makers(self) -> npt.NDArray[np.bool_]:
        """Muscles that pull the limb through most of the range."""
        return np.median(self._arms, axis=0) > 0.0

    def torque(self, activation: float, active: npt.NDArray[np.bool_]) -> Array:
        """Return the torque at each angle when some are active and the others rest [N·m]."""
        rest = self._model.table[:, kernel.LEAST]
        told = np.where(active, np.maximum(activation, rest), rest)
        path, model = self._test.path, self._model
        return np.array(
            [
                arms @ model.isometric_forces(path[k : k + 1], told)
                for k, arms in enumerate(self._arms)
            ]
        )
