"""Surfaces that paths go round: length, side, moment arms, and the same in torch."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pytest
import torch
from variants import few

from rcare_marl import assets
from rcare_marl.agents.people.actuation.drive import fitted_musculature
from rcare_marl.agents.people.actuation.muscle_layout import crossing
from rcare_marl.agents.people.actuation.muscle_lines import path_points
from rcare_marl.agents.people.actuation.muscle_model import MuscleModel
from rcare_marl.agents.people.actuation.muscle_table import parse_path
from rcare_marl.agents.people.actuation.muscle_torch import TorchMuscles
from rcare_marl.agents.people.actuation.muscle_unit import path_lengths
from rcare_marl.agents.people.actuation.muscle_wrap import wrapped
from rcare_marl.agents.people.actuation.musculature import load_musculature
from rcare_marl.agents.people.avatar import load_avatar
from rcare_marl.agents.people.body.person_tree import person_tree
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS, forward_kinematics
from rcare_marl.agents.people.validation.reference_muscles import muscle_model
from rcare_marl.errors import ConfigError, UnknownNameError

Array = npt.NDArray[np.float64]
STEP = 1e-5  # [rad] of a finite difference
PATHS = (
    "left_shoulder@left_elbow:-0.1,0,0.04;left_shoulder@left_elbow:0,0,0|cylinder:0.02:0,-1,0;"
    "left_elbow@left_elbow:0.06,0.005,0.03",
    "left_collar@left_shoulder:-0.02,0.05,0.02;left_shoulder@left_shoulder:0,0,0|sphere:0.025;"
    "left_shoulder@left_shoulder:0.08,0.02,0.01",
    "left_shoulder@left_elbow:-0.09,0,0.03;left_ulna@left_elbow:0.04,0,0|cylinder:0.01:1,0,0;"
    "left_elbow@left_elbow:0.045,-0.005,-0.011",
    "left_scapula@left_shoulder:-0.08,-0.02,-0.07;left_scapula@left_shoulder:-0.02,0.01,-0.02|sphere:0.025;"
    "left_shoulder@left_shoulder:0.08,0.02,0.01",
    "spine3@spine3:0,0.1,-0.06;right_blade@right_shoulder:0.04,0.02,-0.05;"
    "right_collar@right_shoulder:0.01,0.05,0.05;right_shoulder@right_shoulder:-0.08,0.02,0.01",
    "pelvis@left_hip:0,0.03,0.05;left_hip@left_hip:0,-0.3,0.05;"
    "left_hip@left_knee:0,0,0|cylinder:0.03:-1,0,0;left_knee@left_knee:0,-0.07,0.05",
)


@lru_cache
def model(paths: tuple[str, ...] = PATHS) -> MuscleModel:
    muscles = fitted_musculature(load_avatar("karan"), None)
    names = [dof.name for dof in DOFS]
    chain = person_tree(whole_segments("karan"), muscles.joints, np.zeros(len(DOFS)), names)
    units = [
        dataclasses.replace(muscles.units[k], path=parse_path(path, "here"))
        for k, path in enumerate(paths)
    ]
    return MuscleModel(units, muscles.joints, chain)


@lru_cache
def whole(name: str) -> tuple[MuscleModel, Array]:
    """Return all units of an avatar, and the passive range of the DoFs."""
    avatar = load_avatar(name)
    limits = avatar.profile.limits("passive")
    return muscle_model(name), np.array([limits[dof.name] for dof in DOFS])


def postures(muscles: MuscleModel, count: int, seed: int = 0) -> Array:
    """Return random postures within the normal range, shape [count, 112]."""
    ranges = whole("karan")[1]
    return np.random.default_rng(seed).uniform(ranges[:, 0], ranges[:, 1], (count, len(DOFS)))


def slope(muscles: MuscleModel, q: Array, dof: int) -> Array:
    """Return dL/dq by a difference of fourth order [m], shape [m]."""
    e = np.zeros(len(q))
    e[dof] = STEP
    near = muscles.lengths(q + e) - muscles.lengths(q - e)
    far = muscles.lengths(q + 2 * e) - muscles.lengths(q - 2 * e)
    return np.asarray((8 * near - far) / (12 * STEP))


def round_path(q: float, radius: float = 0.02, *, sphere: bool = False) -> float:
    """Return the length of a path round a surface at the origin whose second point turns by q."""
    p, s = np.array((0.05, 0.0, 0.01)), 0.06 * np.array((np.cos(q), np.sin(q), 0.0))
    figures = (*p, *s, radius, not sphere)
    a0, a1, a2, b0, b1, b2, extra, _, _ = wrapped(*figures)
    if extra < 0:
        return float(np.linalg.norm(s - p))
    spots = np.array((p, (a0, a1, a2), (b0, b1, b2), s))
    return float(np.linalg.norm(np.diff(spots, axis=0), axis=1).sum() + extra)


# ---- one surface


def test_a_path_round_a_cylinder_has_the_length_of_a_string() -> None:
    """Both tangents, and the arc between them, unrolled."""
    turned, rise = np.radians(200), -0.01
    out, back = np.sqrt(0.05**2 - 0.02**2), np.sqrt(0.06**2 - 0.02**2)
    arc = 0.02 * (turned - np.arccos(0.02 / 0.05) - np.arccos(0.02 / 0.06))
    assert round_path(turned) == pytest.approx(np.hypot(out + arc + back, rise), abs=1e-12)


def test_a_path_round_a_sphere_is_a_great_circle() -> None:
    """Both points in one plane with the centre: the angle between them, whatever the axis."""
    p, s = np.array((0.05, 0.0, 0.01)), 0.06 * np.array((np.cos(2.5), np.sin(2.5), 0.0))
    angle = np.arccos(p @ s / np.linalg.norm(p) / 0.06)
    tangents = [np.sqrt(x @ x - 0.02**2) for x in (p, s)]
    arc = 0.02 * (angle - sum(np.arccos(0.02 / np.linalg.norm(x)) for x in (p, s)))
    assert round_path(2.5, sphere=True) == pytest.approx(sum(tangents) + arc, abs=1e-12)
    assert round_path(-2.5, sphere=True) == pytest.approx(round_path(2.5, sphere=True), abs=1e-12)


def test_a_path_that_clears_the_surface_is_straight() -> None:
    straight = np.linalg.norm(
        np.array((0.05, 0, 0.01)) - 0.06 * np.array((np.cos(1.0), np.sin(1.0), 0))
    )
    assert round_path(1.0) == pytest.approx(straight, abs=1e-15)


@pytest.mark.parametrize("sphere", (False, True))
def test_length_and_its_slope_are_continuous_where_contact_begins(sphere: bool) -> None:
    turns = np.linspace(1.0, 3.0, 4001)
    lengths = np.array([round_path(q, sphere=sphere) for q in turns])
    slopes = np.gradient(lengths, turns)
    assert np.abs(np.diff(lengths)).max() < 5e-5
    assert np.abs(np.diff(slopes)).max() < 5e-5  # a jump of slope would be of the radius, 0.02


def test_a_cylinder_is_gone_round_on_one_side_only() -> None:
    """From just past the axis to 260 degrees: always the same way, always longer."""
    lengths = [round_path(q) for q in np.radians(np.arange(140, 261, 5))]
    assert (np.diff(lengths) > 0).all()


def test_a_surface_makes_room_for_a_point_that_would_be_inside() -> None:
    radii = np.linspace(0.02, 0.2, 2001)
    lengths = np.array([round_path(3.0, float(radius)) for radius in radii])
    assert np.isfinite(lengths).all()
    assert np.abs(np.diff(lengths, 2)).max() < 5e-6  # a kink would be of 1e-4


# ---- paths


@pytest.mark.parametrize("path", range(len(PATHS)))
def test_moment_arms_are_the_slope_of_length(path: int) -> None:
    muscles = model((PATHS[path],))
    touched = 0
    for q in postures(muscles, 40):
        arms = muscles.moment_arms(q)[0]
        for dof in np.flatnonzero(np.abs(arms) > 0):
            assert arms[dof] == pytest.approx(-slope(muscles, q, int(dof))[0], abs=1e-6)
        spots = path_points(muscles, q)
        touched += bool(np.abs(np.diff(spots, axis=0)).sum(axis=1).min() > 1e-6)
    assert touched > 3  # a surface is met


def test_lengths_are_those_of_the_table_functions() -> None:
    muscles = model()
    joints = fitted_musculature(load_avatar("karan"), None).joints
    for q in postures(muscles, 5):
        found = path_lengths(
            [unit.path for unit in muscles.units], joints, *forward_kinematics(joints, q)
        )
        np.testing.assert_allclose(found, muscles.lengths(q), atol=1e-12)


def test_torch_agrees() -> None:
    muscles = model()
    q = postures(muscles, 20)
    ours = TorchMuscles(muscles)
    lengths, arms = ours.lengths(torch.tensor(q)), ours.moment_arms(torch.tensor(q))
    for k, posture in enumerate(q):
        np.testing.assert_allclose(lengths[k].numpy(), muscles.lengths(posture), atol=1e-12)
        np.testing.assert_allclose(arms[k].numpy(), muscles.moment_arms(posture), atol=1e-12)
    turned = torch.tensor(q[:1], requires_grad=True)
    for m in range(len(muscles.names)):
        (slopes,) = torch.autograd.grad(ours.lengths(turned)[0, m], turned)
        np.testing.assert_allclose(-slopes[0].numpy(), muscles.moment_arms(q[0])[m], atol=1e-10)


def test_an_ulna_bends_but_does_not_pronate() -> None:
    paths = (
        "left_shoulder@left_elbow:-0.1,0,0.04;left_ulna@left_elbow:0.06,0.005,0.03",
        "left_ulna@left_elbow:0.2,0,-0.02;left_elbow@left_elbow:0.21,0.01,0.02",
    )
    muscles = model(paths)
    for q in postures(muscles, 5):
        arms = muscles.moment_arms(q)
        assert abs(arms[0, DOF_INDEX["left_elbow_flexion"]]) > 1e-3
        assert arms[0, DOF_INDEX["left_elbow_pronation"]] == 0
        assert arms[1, DOF_INDEX["left_elbow_flexion"]] == 0
        assert arms[1, DOF_INDEX["left_elbow_pronation"]] != 0


def test_an_ulna_stays_where_a_fixed_pronation_leaves_it() -> None:
    """Pronation that does not move, at 60 degrees, is melted into the radius and not into the ulna."""
    avatar = load_avatar("karan")
    muscles = fitted_musculature(avatar, None)
    path = "left_ulna@left_elbow:0.2,0,-0.02;left_elbow@left_elbow:0.21,0.01,0.02;left_wrist@left_wrist:0,0,0"
    unit = dataclasses.replace(muscles.units[0], path=parse_path(path, "here"))
    posture = np.zeros(len(DOFS))
    posture[DOF_INDEX["left_elbow_pronation"]] = np.pi / 3
    segments = whole_segments("karan")
    chain = person_tree(
        segments, muscles.joints, posture, ["left_elbow_flexion", "left_wrist_flexion"]
    )
    some = MuscleModel([unit], muscles.joints, chain)
    everything = MuscleModel(
        [unit],
        muscles.joints,
        person_tree(segments, muscles.joints, posture, [d.name for d in DOFS]),
    )
    assert some.lengths(np.zeros(2))[0] == pytest.approx(everything.lengths(posture)[0], abs=1e-12)


def test_one_joint_of_the_shoulder_is_crossed_from_trunk_blade_and_scapula() -> None:
    avatar = load_avatar("karan")
    muscles, segments = fitted_musculature(avatar, None), whole_segments("karan")
    posture = np.zeros(len(DOFS))
    posture[DOF_INDEX["left_shoulder_flexion"]] = 0.4
    everything = person_tree(segments, muscles.joints, posture, [d.name for d in DOFS])
    whole_model = MuscleModel(muscles.units, muscles.joints, everything)
    for joint, names in (
        ("left_shoulder_abduction", "delt2_l serr_inf_l pecm2_l"),
        ("jaw_opening", ""),
    ):
        chain = person_tree(segments, muscles.joints, posture, [joint])
        units = [muscles.units[m] for m in crossing(muscles.units, chain)]
        assert {unit.name for unit in units} >= set(names.split())
        assert not any(unit.name.startswith("delt") for unit in units) or names
        one = MuscleModel(units, muscles.joints, chain)
        column = whole_model.moment_arms(posture)[:, DOF_INDEX[joint]]
        theirs = column[[whole_model.index(name) for name in one.names]]
        np.testing.assert_allclose(one.moment_arms(np.zeros(1))[:, 0], theirs, atol=1e-12)
        assert np.abs(column).sum() == pytest.approx(np.abs(theirs).sum())


def whole_segments(name: str):  # type: ignore[no-untyped-def]
    from rcare_marl.agents.people.avatar import body_segments

    avatar = load_avatar(name)
    return body_segments(avatar.body_path(), avatar.height_m, avatar.mass_kg, avatar.sex)


# ---- the table


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("left_humerus@left_elbow:0,0,0|cylinder:0.02:0,1,0", UnknownNameError, "left_humerus"),
        ("left_elbow@left_elbow:0,0,0|cylinder:0:0,1,0", ConfigError, "radius must lie in"),
        ("left_elbow@left_elbow:0,0,0|sphere:-0.1", ConfigError, "radius must lie in"),
        ("left_elbow@left_elbow:0,0,0|sphere:wide", ConfigError, "radius must be a number"),
        ("left_elbow@left_elbow:0,0,0|cylinder:0.02:0,0,0", ConfigError, "not all 0"),
        ("left_elbow@left_elbow:0,0,0|cylinder:0.02", ConfigError, "cylinder:radius:x,y,z"),
        ("left_elbow@left_elbow:0,0,0|cyllinder:0.02:0,1,0", UnknownNameError, "cylinder"),
        ("left_elbow+left_shoulder@left_elbow:0,0,1e-2|sphere:0.02", ConfigError, "one segment"),
    ],
)
def test_a_wrong_surface_is_named(text: str, error: type[Exception], message: str) -> None:
    around = "left_shoulder@left_elbow:-0.1,0,0.04;{};left_elbow@left_elbow:0.06,0.005,0.03"
    with pytest.raises(error, match=message):
        parse_path(around.format(text), "row 2")


def test_a_path_does_not_leave_the_scapula_for_the_blade() -> None:
    path = "left_scapula@left_shoulder:0,0.03,0;left_blade@left_shoulder:-0.1,0,-0.05"
    with pytest.raises(ConfigError, match="they are one bone"):
        model((path,))


def test_surfaces_stand_between_points() -> None:
    surface, point = "left_elbow@left_elbow:0,0,0|sphere:0.01", "left_elbow@left_elbow:0.1,0,0"
    for path in (f"{surface};{point}", f"{point};{surface}"):
        with pytest.raises(ConfigError, match="cannot start or end"):
            parse_path(path, "row 2")
    with pytest.raises(ConfigError, match="needs a point"):
        parse_path(f"{point};{surface};{surface};{point}", "row 2")


def test_surfaces_fit_other_bodies() -> None:
    ours = load_musculature()
    units = [
        dataclasses.replace(unit, path=parse_path(path, "here"))
        for unit, path in zip(ours.units, PATHS, strict=False)
    ]
    some = dataclasses.replace(ours, units=tuple(units))
    large = some.fitted(1.2 * ours.joints)
    for old, new in zip(some.units, large.units, strict=True):
        for a, b in zip(old.path, new.path, strict=True):
            assert (a.surface is None) == (b.surface is None)
            if a.surface is not None and b.surface is not None:
                assert b.surface.radius == pytest.approx(1.2 * a.surface.radius)
                np.testing.assert_allclose(a.surface.axis, b.surface.axis, atol=1e-12)


# ---- all units


@pytest.mark.parametrize("name", few(assets.names("avatars"), "karan", "kim"))
def test_moment_arms_of_all_units_are_the_slopes_of_their_lengths(name: str) -> None:
    muscles, ranges = whole(name)
    for q in np.random.default_rng(4).uniform(ranges[:, 0], ranges[:, 1], (2, len(DOFS))):
        arms = muscles.moment_arms(q)
        for dof in range(len(DOFS)):
            np.testing.assert_allclose(arms[:, dof], -slope(muscles, q, dof), atol=1e-6)


def test_all_units_agree_in_torch() -> None:
    muscles, ranges = whole("natalia")
    q = np.random.default_rng(5).uniform(ranges[:, 0], ranges[:, 1], (4, len(DOFS)))
    ours = TorchMuscles(muscles)
    lengths, arms = ours.lengths(torch.tensor(q)), ours.moment_arms(torch.tensor(q))
    for k, posture in enumerate(q):
        np.testing.assert_allclose(lengths[k].numpy(), muscles.lengths(posture), atol=1e-9)
        np.testing.assert_allclose(arms[k].numpy(), muscles.moment_arms(posture), atol=1e-9)
