"""MMT grades become strength as documented."""

from typing import Literal

import numpy as np
import pytest

from rcare_marl.agents.people.actuation import muscle_kernel as kernel
from rcare_marl.agents.people.actuation.drive import (
    ActuationConfig,
    fitted_musculature,
    muscle_share,
    skeletal_share,
    whole_chain,
)
from rcare_marl.agents.people.actuation.muscle_model import MuscleModel
from rcare_marl.agents.people.avatar import load_avatar
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS
from rcare_marl.agents.people.strength import (
    LEAST_HOLDING,
    MOST_HOLDING,
    gravity_tests,
    level_torque,
    mmt_tests,
    strength_share,
)
from rcare_marl.errors import UnknownNameError
from rcare_marl.tree.joint_tree import JointTree, ancestors

CAREGIVER = load_avatar("caregiver")


def chain() -> JointTree:
    body = CAREGIVER
    return whole_chain(body.body_path(), body.height_m, body.mass_kg, body.sex)


def test_the_linear_map_is_the_papers() -> None:
    assert [strength_share(g, "linear") for g in (0, 1, 2, 3, 4, 5)] == pytest.approx(
        [0, 0.2, 0.4, 0.6, 0.8, 1.0]
    )


def test_the_gravity_map_goes_through_its_grades_and_grows() -> None:
    holding = 0.09
    shares = [strength_share(g, "gravity", holding) for g in (0, 1, 2, 3, 4, 5)]
    assert shares == pytest.approx([0, 0.01, 0.045, 0.09, 0.3, 1.0])
    fine = [strength_share(g, "gravity", holding) for g in np.linspace(0, 5, 61)]
    assert (np.diff(fine) > 0).all()
    # A plus is a third of the way on a log scale.
    assert strength_share(3 + 1 / 3, "gravity", holding) == pytest.approx(
        0.09 * (0.3 / 0.09) ** (1 / 3)
    )


def test_a_wrong_grade_or_map_is_refused() -> None:
    with pytest.raises(ValueError, match="0..5"):
        strength_share(6, "linear")
    with pytest.raises(UnknownNameError, match="Did you mean 'gravity'"):
        strength_share(3, "gravitiy")  # type: ignore[arg-type]


def test_level_torque_is_mass_times_lever() -> None:
    limb = chain()
    i = DOF_INDEX["right_elbow_flexion"]
    angles = np.zeros(len(DOFS))
    beyond = [k for k in range(len(DOFS)) if i in ancestors(limb.arrays.parents, k)]
    mass = limb.arrays.masses[beyond].sum()
    torque = level_torque(limb, i, angles)
    assert 0.02 * CAREGIVER.mass_kg < 1.3 * mass < 0.04 * CAREGIVER.mass_kg  # forearm and hand
    assert 0.05 < torque / (9.81 * mass) < 0.25  # [m] from elbow to their centre
    assert level_torque(limb, DOF_INDEX["right_elbow_pronation"], angles) < 0.05 * torque


def test_every_graded_group_gets_a_test_on_each_side_that_has_it() -> None:
    tests = gravity_tests(chain())
    groups = {group for _, group in tests}
    assert groups == set(mmt_tests().tests)
    assert {side for side, group in tests if group == "elbow_flexors"} == {"left", "right"}
    assert all(test.torque > 0 for test in tests.values())


@pytest.mark.parametrize("kind", ["skeletal", "muscle"])
def test_grade_3_by_gravity_is_far_weaker_than_the_linear_one_at_elbow_and_knee(
    kind: Literal["skeletal", "muscle"],
) -> None:
    config = ActuationConfig(kind=kind, strength="gravity")
    share = (
        skeletal_share(CAREGIVER, "gravity")
        if kind == "skeletal"
        else muscle_share(CAREGIVER, config)
    )
    for group in ("elbow_flexors", "knee_extensors"):
        found = share("right", group, 3.0)
        assert LEAST_HOLDING <= found < 0.2, group
    for (side, group), _ in gravity_tests(chain()).items():
        assert LEAST_HOLDING <= share(side, group, 3.0) <= MOST_HOLDING
        assert share(side, group, 3.0) == pytest.approx(
            share("left" if side == "right" else side, group, 3.0), rel=0.05
        )


def test_at_the_share_of_grade_3_a_group_just_carries_its_limb() -> None:
    """Where the group can at all; the others are carried by all muscles of the motion together."""
    limb, config = chain(), ActuationConfig(kind="muscle", strength="gravity")
    muscles, share = fitted_musculature(CAREGIVER, None), muscle_share(CAREGIVER, config)
    model = MuscleModel(muscles.units, muscles.joints, limb)
    carried = []
    for (side, group), test in gravity_tests(limb).items():
        members = np.array([u.side == side and u.clinical_group == group for u in muscles.units])
        arms = test.sign * model.moment_arms(test.angles)[:, test.dof]
        rest = model.table[:, kernel.LEAST]

        def torque(share: float) -> float:
            told = np.where(members, np.maximum(share, rest), rest)  # noqa: B023
            return float(arms @ model.isometric_forces(test.angles, told))  # noqa: B023

        grade_3 = share(side, group, 3.0)
        if torque(1.0) > test.torque and LEAST_HOLDING < grade_3 < MOST_HOLDING:
            assert torque(grade_3) == pytest.approx(test.torque, rel=0.02), (side, group)
            carried.append(group)
    assert {"elbow_flexors", "elbow_extensors", "knee_extensors"} <= set(carried)
    assert len(set(carried)) >= 8
