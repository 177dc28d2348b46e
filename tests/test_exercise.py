"""Promises of the upper body and of exercises: angles mean what they say, goals fit the person."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rcare_marl.agents.coaching.exercise import (
    Demand,
    Exercise,
    KeyPose,
    Reach,
    exercise_names,
    load_exercise,
    load_exercises,
)
from rcare_marl.agents.coaching.imitation import reach_of as imitated_reach
from rcare_marl.agents.coaching.sources.arm_pose import (
    arm_motion,
    axes_of,
    forearm_axes,
    swing_axes,
    trunk_axes,
)
from rcare_marl.agents.coaching.sources.elbow_posterior import elbow_posterior
from rcare_marl.agents.coaching.upper_body import (
    ARM,
    MOTION_INDEX,
    MOTIONS,
    SIDES,
    UpperBody,
    arm_angles,
    arm_direction,
    directions,
    girdle,
    quaternions,
    swing,
    trunk_turn,
    turn_y,
    turn_z,
)
from rcare_marl.agents.people.avatar import load_avatar
from rcare_marl.errors import ConfigError, UnknownNameError

BODY = UpperBody.of_height(1.7)


def angles_of(**degrees: float) -> np.ndarray:
    """Return angles [16] of motions [deg]; those of an arm without a side for both."""
    out = np.zeros(len(MOTIONS))
    for name, value in degrees.items():
        names = [name] if name in MOTION_INDEX else [f"{side}_{name}" for side in SIDES]
        out[[MOTION_INDEX[n] for n in names]] = math.radians(value)
    return out


def reach_of(**changes: tuple[float, float]) -> Reach:
    low, high = np.full(len(MOTIONS), -4.0), np.full(len(MOTIONS), 4.0)
    for motion, (least, most) in changes.items():
        low[MOTION_INDEX[motion]], high[MOTION_INDEX[motion]] = np.radians((least, most))
    return Reach(low, high)


@pytest.mark.parametrize(
    ("pose", "wanted"),
    [
        ({}, (0, 0, -1)),
        ({"elbow_flexion": 90}, (1, 0, 0)),
        ({"shoulder_elevation": 90, "elbow_flexion": 90}, (1, 0, 0)),
        ({"shoulder_elevation": 90, "shoulder_plane": 90, "elbow_flexion": 90}, (0, 0, 1)),
        ({"shoulder_elevation": 90}, (0, 1, 0)),
        ({"shoulder_elevation": 90, "shoulder_plane": 90}, (1, 0, 0)),
        ({"shoulder_elevation": 180, "shoulder_plane": 30}, (0, 0, 1)),
        ({"elbow_flexion": 90, "shoulder_rotation": 90}, (0, -1, 0)),
    ],
)
def test_angles_point_the_left_forearm_where_the_convention_says(
    pose: dict[str, float], wanted: tuple[float, ...]
) -> None:
    points = BODY.points(angles_of(**pose))
    along = points["left_wrist"] - points["left_elbow"]
    assert along / BODY.forearm == pytest.approx(wanted, abs=1e-12)


def test_both_sides_are_mirror_images() -> None:
    rng = np.random.default_rng(0)
    arm = rng.uniform(-1, 1, size=5)
    angles = np.zeros(16)
    angles[ARM["left"]] = angles[ARM["right"]] = arm
    points, poses = BODY.points(angles), BODY.poses(angles)
    for part in ("shoulder", "elbow", "wrist", "hand"):
        assert points[f"left_{part}"] == pytest.approx(points[f"right_{part}"] * (1, -1, 1))
    left, right = (axes_of(poses[f"{side}_hand"][1].tolist()) for side in SIDES)
    mirror = np.diag((1.0, -1.0, 1.0))
    assert mirror @ left @ mirror == pytest.approx(right)


def test_hands_held_forward_palms_down_have_the_axes_of_the_body() -> None:
    poses = BODY.poses(angles_of(elbow_flexion=90, forearm_pronation=90))
    for side in SIDES:
        assert axes_of(poses[f"{side}_hand"][1].tolist()) == pytest.approx(np.eye(3), abs=1e-12)


def test_many_frames_at_once_are_as_each_alone_and_unknown_angles_stay_unknown() -> None:
    angles = np.random.default_rng(1).uniform(-1, 1, size=(4, 3, 16))
    angles[2, 1, ARM["left"]] = np.nan
    points, poses = BODY.points(angles), BODY.poses(angles)
    one = BODY.points(angles[1, 2])
    assert all(points[name][1, 2] == pytest.approx(value) for name, value in one.items())
    assert np.isnan(points["left_hand"][2, 1]).all() and np.isnan(poses["left_hand"][1][2, 1]).all()
    assert np.isfinite(points["right_hand"]).all() and np.isfinite(poses["head"][1]).all()


def test_scalar_rotations_are_those_of_the_body() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        a, b, c = rng.uniform(-2, 2, size=3)
        assert trunk_axes(a, b, c) == pytest.approx(trunk_turn(a, b, c))
        for side, sign in (("left", 1.0), ("right", -1.0)):
            assert swing_axes(side, a, b) == pytest.approx(swing(side, a, b))
            fore = turn_z(-sign * b) @ turn_y(-c)
            assert forearm_axes(side, b, c) == pytest.approx(fore)
        turn = trunk_turn(a, b, c)
        assert axes_of((3.0 * quaternions(turn)).tolist()) == pytest.approx(turn)


@pytest.mark.parametrize("side", SIDES)
def test_arm_angles_come_back_from_directions_and_hand(side: str) -> None:
    rng = np.random.default_rng(3)
    for _ in range(30):
        arm = rng.uniform((0.1, -0.5, -1, 0.5, -1.2), (2.9, 1.6, 1, 2.4, 1.2))
        angles = np.zeros(16)
        angles[ARM[side]] = arm
        points = BODY.points(angles)
        shoulder, elbow, wrist = (points[f"{side}_{p}"] for p in ("shoulder", "elbow", "wrist"))
        upper, fore = (elbow - shoulder) / BODY.upper_arm, (wrist - elbow) / BODY.forearm
        hand = axes_of(BODY.poses(angles)[f"{side}_hand"][1].tolist())
        assert arm_motion(side, upper, fore, hand) == pytest.approx(arm.tolist())
        assert arm_direction(side, *arm_angles(side, upper)) == pytest.approx(upper)


@pytest.mark.parametrize("elbow", [10.0, 45.0, 90.0, 120.0])
def test_an_elbow_is_found_from_wrist_and_hand_and_a_straight_one_is_told_less_surely(
    elbow: float,
) -> None:
    angles = angles_of(shoulder_elevation=60, shoulder_plane=45, elbow_flexion=elbow)
    points, turns = BODY.points(angles), BODY.turns(angles)
    wrist = points["left_wrist"] - points["left_shoulder"]
    fingers = turns["left_hand"][:, 0]
    lengths = (BODY.upper_arm, BODY.forearm)
    upper, fore, unsure = elbow_posterior("left", wrist, *lengths, fingers, 0.03)
    found = math.degrees(math.acos(min(1.0, float(upper @ fore))))
    assert found == pytest.approx(elbow, abs=12)
    assert math.degrees(math.acos(float(upper @ -turns["left_upper_arm"][:, 2]))) < 12
    assert elbow_posterior("left", wrist, *lengths, fingers, 0.08)[2] > unsure


def test_a_wrist_out_of_reach_is_reached_for_with_a_nearly_straight_arm() -> None:
    x = np.array((1.0, 0.0, 0.0))
    upper, fore, _ = elbow_posterior("left", 2.0 * x, 0.3, 0.25, x, 0.03)
    assert min(upper @ x, fore @ x) > math.cos(math.radians(12))


def test_a_goal_is_taken_from_somebodys_own_range_where_the_exercise_allows_it() -> None:
    fixed = load_exercise("lateral_raise")
    assert fixed.with_own_goal(0.6).keys == pytest.approx(fixed.keys)
    allowed = replace(fixed, judged=Demand(least_goal=0.5))
    for share, got in ((0.7, 0.7), (0.3, 0.5), (1.2, 1.0)):
        excursions = allowed.with_own_goal(share).keys[1] - fixed.keys[0]
        assert excursions == pytest.approx(got * (fixed.keys[1] - fixed.keys[0]))
    with pytest.raises(ConfigError, match="positive share"):
        allowed.with_own_goal(0.0)
    with pytest.raises(ConfigError, match="least_goal"):
        Demand(least_goal=1.5)


def test_shoulders_rise_and_go_back_with_arms_and_both_sides_are_alike() -> None:
    assert girdle("left", 0.3, 0.0) == pytest.approx(np.zeros(3))
    x, y, z = girdle("left", math.radians(120), 0.0) * 1.7
    assert x < -0.03 and y < 0.0 and 0.03 < z < 0.08
    assert girdle("right", math.radians(120), 0.0) * 1.7 == pytest.approx((x, -y, z))


def test_the_five_exercises_of_the_paper_are_there_and_move_what_they_should() -> None:
    parts = {exercise.name: exercise.parts for exercise in load_exercises()}
    arms = ("left_arm", "right_arm")
    assert parts == {
        "chest_expansion": arms,
        "front_raise": arms,
        "head_rotation": ("head",),
        "lateral_raise": arms,
        "upper_lift": arms,
    }


@pytest.mark.parametrize("name", exercise_names())
def test_an_exercise_begins_and_ends_at_rest_and_never_jumps(name: str) -> None:
    exercise = load_exercise(name)
    path = exercise.path(100.0)
    assert path[0] == pytest.approx(exercise.keys[0])
    assert exercise.angles(exercise.duration + 1) == pytest.approx(exercise.keys[0])
    rates = np.degrees(np.abs(np.diff(path, axis=0))) * 100
    assert rates.max() < 130  # [deg/s]
    assert rates[0].max() < 1 and rates[-1].max() < 5
    for direction in directions(path).values():
        assert np.linalg.norm(direction, axis=-1) == pytest.approx(1)


def test_a_key_pose_is_reached_in_its_time_and_held() -> None:
    exercise = load_exercise("lateral_raise")
    pose = exercise.poses[0]
    for time in (pose.move_s, pose.move_s + 0.9 * pose.hold_s):
        assert exercise.angles(time) == pytest.approx(exercise.keys[1])
    assert exercise.faster(2.0).duration == pytest.approx(exercise.duration / 2)


def test_goals_never_go_beyond_a_persons_reach() -> None:
    reach = reach_of(left_shoulder_elevation=(0, 60), neck_rotation_left=(-20, 30))
    for exercise in load_exercises():
        adapted = exercise.adapted(reach)
        assert adapted.can_do
        assert (adapted.path() <= reach.high + 1e-9).all() and (
            adapted.path() >= reach.low - 1e-9
        ).all()
    raised = load_exercise("lateral_raise").adapted(reach)
    assert raised.keys[1, MOTION_INDEX["left_shoulder_elevation"]] == pytest.approx(
        math.radians(60)
    )
    assert raised.keys[1, MOTION_INDEX["right_shoulder_elevation"]] == pytest.approx(
        math.radians(90)
    )


def test_an_arm_that_goes_higher_in_front_than_aside_has_goals_for_both() -> None:
    high = reach_of().high.copy()
    high[[MOTION_INDEX[f"{side}_shoulder_elevation"] for side in SIDES]] = math.radians(50)
    reach = Reach(reach_of().low, high, front=(math.radians(80), math.radians(50)))
    front, side = (
        load_exercise(n).adapted(reach).keys[1] for n in ("front_raise", "lateral_raise")
    )
    at = [MOTION_INDEX[f"{s}_shoulder_elevation"] for s in SIDES]
    assert np.degrees(front[at]) == pytest.approx((80, 50))
    assert np.degrees(side[at]) == pytest.approx((50, 50), abs=0.5)


def test_what_nobody_can_do_is_left_out() -> None:
    still = reach_of(left_shoulder_elevation=(0, 14), neck_rotation_left=(-3, 40))
    assert load_exercise("front_raise").adapted(still).parts == ("right_arm",)
    turned = load_exercise("head_rotation").adapted(still)
    assert turned.can_do and np.degrees(turned.keys[:, 5].min()) > -4
    nothing = reach_of(left_shoulder_elevation=(0, 14), right_shoulder_elevation=(0, 14))
    assert not load_exercise("front_raise").adapted(nothing).can_do


def test_who_cannot_draw_a_raised_arm_to_the_front_is_asked_for_the_other_exercises_only() -> None:
    weak = replace(reach_of(), sweeps=(False, True))
    assert load_exercise("chest_expansion").adapted(weak).parts == ("right_arm",)
    for name in ("lateral_raise", "upper_lift", "front_raise"):
        assert load_exercise(name).adapted(weak).parts == ("left_arm", "right_arm")
    assert imitated_reach(load_avatar("natalia").profile).sweeps == (False, False)  # grade 1
    assert imitated_reach(load_avatar("kim").profile).sweeps == (True, True)


def test_one_side_of_an_exercise_leaves_the_other_at_rest() -> None:
    half = load_exercise("chest_expansion").one_sided("left")
    assert half.parts == ("left_arm",)
    head = load_exercise("head_rotation").one_sided("right")
    assert head.parts == ("head",) and head.keys[:, 5].max() <= 0 < -head.keys[:, 5].min()
    with pytest.raises(UnknownNameError, match="side"):
        half.one_sided("middle")


def test_a_therapist_can_write_an_exercise(tmp_path: Path) -> None:
    file = tmp_path / "reach_up.yaml"
    file.write_text(
        "title: Reach up\nsay: Reach up.\nabout: For shelves.\nrest: {}\nreturn_s: 1\n"
        "poses:\n  - {angles_deg: {left_shoulder_elevation: 120}, move_s: 1}\n"
    )
    exercise = load_exercise(file)
    assert (exercise.name, exercise.parts, exercise.duration) == ("reach_up", ("left_arm",), 2.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{left_shoulder_elevaton: 50}", "Did you mean 'left_shoulder_elevation'"),
        ("{shoulder_elevation: 500}", "must lie in -200..200"),
        ("{shoulder_elevation: 50, left_shoulder_elevation: 40}", "given twice"),
        ("{elbow_flexion: 40}", "nothing moves"),
    ],
)
def test_mistakes_in_an_exercise_are_told(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "broken.yaml"
    file.write_text(
        "title: a\nsay: a\nabout: a\nrest: {}\nreturn_s: 1\n"
        f"poses:\n  - {{angles_deg: {text}, move_s: 1}}\n"
    )
    with pytest.raises(ConfigError, match=message):
        load_exercise(file)


def test_impossible_tempo_and_reach_are_refused() -> None:
    with pytest.raises(ConfigError, match="move_s"):
        KeyPose({}, 0.0)
    with pytest.raises(ConfigError, match="repetitions"):
        Exercise("a", "a", "a", "a", (), {}, 1.0, repetitions=0)
    with pytest.raises(ConfigError, match="low beyond high"):
        reach_of(neck_flexion=(5, -5))
    with pytest.raises(UnknownNameError, match="lateral_raise"):
        load_exercise("lateral_rise")
