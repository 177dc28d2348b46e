"""MMT grades become strength as documented."""

import numpy as np
import pytest

from rcare_marl.agents.people.actuation.drive import fitted_musculature
from rcare_marl.agents.people.actuation.graded import (
    body_test,
    frame_of,
    level_torques,
    motion_limits,
    normal_torques,
    torque_holding,
    torque_share,
    unit_shares,
)
from rcare_marl.agents.people.avatar import load_avatar
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS
from rcare_marl.agents.people.profile import clinical_norms
from rcare_marl.agents.people.strength import (
    LEAST_HOLDING,
    MOST_HOLDING,
    GradeShares,
    MmtTest,
    mmt_tests,
    strength_share,
    tissue_share,
)
from rcare_marl.agents.people.validation.grades import graded_group, graded_side, resized
from rcare_marl.errors import ConfigError, UnknownNameError

CAREGIVER = load_avatar("caregiver")
FRAME = frame_of(CAREGIVER)
FILE: tuple[None, tuple[int, int]] = (None, (0, 0))


def test_the_linear_map_is_the_papers() -> None:
    assert [strength_share(g, "linear") for g in (0, 1, 2, 3, 4, 5)] == pytest.approx(
        [0, 0.2, 0.4, 0.6, 0.8, 1.0]
    )
    assert np.isinf(motion_limits(graded_side(CAREGIVER, 2.0), "linear")[0]).all()


def test_the_default_map_goes_through_its_grades_and_grows_without_a_jump() -> None:
    holding = 0.09
    shares = [strength_share(g, "mmt", holding) for g in (0, 1, 2, 3, 4, 5)]
    fourth = 0.09 + mmt_tests().shares.grade_4 * 0.91
    assert shares == pytest.approx([0, 0, 0.09 * mmt_tests().shares.grade_2, 0.09, fourth, 1.0])
    fine = np.array([strength_share(g, "mmt", holding) for g in np.linspace(0, 5, 5001)])
    assert (np.diff(fine) >= 0).all()
    assert (np.diff(fine[1001:]) > 0).all()
    assert np.diff(fine).max() < 0.002
    # A plus is a third of the way on a log scale.
    assert strength_share(3 + 1 / 3, "mmt", holding) == pytest.approx(
        0.09 * (fourth / 0.09) ** (1 / 3)
    )
    assert strength_share(2, "mmt", holding, poor=0.5) == holding
    assert [tissue_share(g) for g in (0, 1, 1.5, 2, 5)] == [0, 0, 0.5, 1, 1]


def test_a_wrong_grade_map_range_or_order_is_refused() -> None:
    with pytest.raises(ValueError, match="0..5"):
        strength_share(6, "linear")
    with pytest.raises(UnknownNameError, match="Did you mean 'linear'"):
        strength_share(3, "linaer")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="must grow"):
        MmtTest("elbow_flexion", (90, 0), "upright")
    with pytest.raises(ConfigError, match="holding"):
        GradeShares(grade_2=0.25, holding=0.9, grade_4=0.4)


def test_grade_3_is_the_greatest_weight_of_the_range_for_each_body() -> None:
    heavy = frame_of(resized(CAREGIVER, height=1.9, mass=120))
    for group in mmt_tests().tests:
        for side in ("left", "right"):
            test = body_test(FRAME, side, group)
            if test is None:
                continue
            needed = mmt_tests().shares.holding * float(test.weight.max())
            normal = normal_torques("female")[test.dof, int(test.sign > 0)]
            found = torque_holding(FRAME, side, group)
            assert found == pytest.approx(np.clip(needed / normal, LEAST_HOLDING, MOST_HOLDING)), (
                group
            )
            assert torque_holding(heavy, side, group) >= found
    elbow = body_test(FRAME, "right", "elbow_flexors")
    assert elbow is not None
    assert 80 < np.degrees(elbow.path[elbow.weight.argmax()]) < 100  # where the forearm is level


def test_every_motion_of_grade_3_holds_the_level_limb() -> None:
    share, normal = torque_share(CAREGIVER, "mmt"), normal_torques("female")
    level, tests = level_torques(FRAME), mmt_tests().tests
    for i, dof in enumerate(DOFS):
        for k, motion in enumerate((dof.negative, dof.positive)):
            test = tests.get(clinical_norms().motions[motion].group)
            if test is not None and test.motion != motion:
                able = share(dof, motion, 3.0) * normal[i, k]
                assert able >= min(level[i], 0.89 * normal[i, k]), (dof.name, motion)


def test_a_motion_is_limited_by_its_own_grade_whichever_muscles_make_it() -> None:
    most, tissue = motion_limits(graded_group(CAREGIVER, "elbow_flexors", 1.0), "mmt")
    i = DOF_INDEX["right_elbow_flexion"]
    assert most[i, 1] == 0.0
    assert tissue[i, 1] == 0.0
    assert np.isinf(most[i, 0])
    assert np.isinf(most[DOF_INDEX["right_wrist_flexion"]]).all()
    # From grade 4 on the limit opens without a jump.
    near = motion_limits(graded_group(CAREGIVER, "elbow_flexors", 4.999), "mmt")[0]
    assert near[i, 1] > 100 * normal_torques("female")[i, 1]


def test_muscles_of_grade_3_take_the_limb_through_the_range_or_are_helped() -> None:
    muscles = fitted_musculature(CAREGIVER, None)
    shares = {
        grade: unit_shares(graded_side(CAREGIVER, grade), muscles.units, "mmt", muscles, FILE)
        for grade in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    }
    right = np.array([unit.side == "right" for unit in muscles.units])
    assert (shares[0.0][right] == 0).all()
    assert (shares[1.0][right] > 0).all()  # a flicker to see
    for low, high in ((0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, 5.0)):
        assert (shares[low] <= shares[high] + 1e-12).all()
    assert (shares[3.0][~right] == 1).all()
    elbow = np.array([u.clinical_group == "elbow_flexors" for u in muscles.units]) & right
    # At the end of flexion they are short and their arms small; those of two joints help at the shoulder.
    assert shares[3.0][elbow].min() < 0.5
