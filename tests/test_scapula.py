"""Shoulder blades follow the arm as people's do."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from rcare_marl.agents.people.actuation.musculature import load_musculature
from rcare_marl.agents.people.body.scapula import scapula_angles, turn_scapula
from rcare_marl.agents.people.body.skeleton import (
    CARRIER_INDEX,
    DOF_INDEX,
    DOFS,
    JOINT_INDEX,
    forward_kinematics,
    with_carriers,
)
from rcare_marl.agents.people.validation.reference_muscles import muscle_model
from rcare_marl.pose import axis_rotation

Array = npt.NDArray[np.float64]
# De Groot & Brand 2001: constant [deg], and slopes by plane of elevation and by elevation, of protraction,
# upward rotation and posterior tilt; the constant with a rest of 32.05, 10.67 and -10.32 degrees.
REGRESSION = np.array(
    (
        (-1.203 + 0.901 * 32.05, 0.140, -0.049),
        (3.095 + 0.414 * 10.67, -0.079, 0.396),
        (0.659 + 0.886 * -10.32, -0.028, 0.184),
    )
)


def direction(elevation: float, plane: float) -> Array:
    """Return the direction of a humerus: elevation and plane, 0 at the side and 90 in front [deg]."""
    up, out = np.radians((elevation, plane))
    return np.array((np.sin(up) * np.cos(out), -np.cos(up), np.sin(up) * np.sin(out)))


@pytest.mark.parametrize("plane", (0, 30, 60, 90))
def test_angles_are_those_of_the_regression(plane: float) -> None:
    for elevation in range(30, 151, 10):
        wanted = REGRESSION @ (1.0, plane, elevation)
        found = np.degrees(scapula_angles(direction(elevation, plane)))
        assert np.abs(found - wanted).max() < 2.8, elevation


def test_two_degrees_of_the_arm_are_one_of_the_blade() -> None:
    upward = [np.degrees(scapula_angles(direction(t, 30)))[1] for t in (0, 15, 30, 90, 150, 180)]
    assert (upward[5] - upward[0]) / 180 == pytest.approx(1 / 3, abs=0.02)
    assert (upward[1] - upward[0]) / 15 < 0.15  # it begins slowly
    assert (upward[4] - upward[2]) / 120 == pytest.approx(0.39, abs=0.02)
    assert upward == sorted(upward)


@pytest.mark.parametrize("side", (1.0, -1.0))
def test_spin_is_the_slope_of_the_rotation(side: float) -> None:
    rng = np.random.default_rng(0)
    for along in (*rng.normal(size=(5, 3)), np.array((0.0, -1.0, 0.0)), np.array((0.0, 1.0, 0.0))):
        d, w = along / np.linalg.norm(along), rng.normal(size=3)
        size = float(np.linalg.norm(w))
        axis = (w[0] / size, w[1] / size, w[2] / size)
        turns = []
        spin = np.empty((3, 3))
        for sign in (-1e-6, 1e-6, 0.0):
            x, y, z = axis_rotation(axis, sign * size) @ d
            turns.append(np.empty((3, 3)))
            turn_scapula(side, x, y, z, turns[-1], spin)
        rate = (turns[1] - turns[0]) @ turns[2].T / 2e-6
        found = np.array((rate[2, 1], rate[0, 2], rate[1, 0]))
        np.testing.assert_allclose(found, spin @ np.cross(w, d), atol=1e-8)
        np.testing.assert_allclose(turns[2] @ turns[2].T, np.eye(3), atol=1e-14)


def test_blades_are_mirror_images_and_rest_in_the_t_pose() -> None:
    joints = load_musculature().joints
    q = np.zeros(len(DOFS))
    turns, places = with_carriers(*forward_kinematics(joints, q))
    for name in ("left_scapula", "right_scapula", "left_blade", "right_blade"):
        np.testing.assert_allclose(turns[CARRIER_INDEX[name]], np.eye(3), atol=1e-14)
    for side in ("left", "right"):
        q[DOF_INDEX[f"{side}_shoulder_abduction"]] = -1.2
        q[DOF_INDEX[f"{side}_shoulder_flexion"]] = 0.7
    turns, places = with_carriers(*forward_kinematics(joints, q))
    mirror = np.diag((-1.0, 1.0, 1.0))
    for kind in ("scapula", "blade"):
        left, right = (CARRIER_INDEX[f"{side}_{kind}"] for side in ("left", "right"))
        np.testing.assert_allclose(turns[right], mirror @ turns[left] @ mirror, atol=1e-14)
        np.testing.assert_allclose(places[right], mirror @ places[left], atol=1e-14)
    shoulder = places[JOINT_INDEX["left_shoulder"]]
    np.testing.assert_allclose(places[CARRIER_INDEX["left_scapula"]], shoulder, atol=1e-14)


def test_held_blades_leave_the_whole_turn_to_the_humerus() -> None:
    """Upward rotation takes a part of the middle deltoid's arm, and none of the pectoralis'."""
    model = muscle_model()
    q = np.zeros(len(DOFS))
    column = DOF_INDEX["left_shoulder_abduction"]
    free, held = model.moment_arms(q)[:, column], model.glenohumeral_arms(q)[:, column]
    assert 0.5 < free[model.index("delt2_l")] / held[model.index("delt2_l")] < 0.8
    assert free[model.index("pecm2_l")] == held[model.index("pecm2_l")] != 0.0
    assert free[model.index("serr_inf_l")] > 0.02 and held[model.index("serr_inf_l")] == 0.0
    assert free[model.index("rhom_maj_l")] < -0.02
