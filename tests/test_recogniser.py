"""Promises of recognition: what is right is known for right, what is wrong is named, all on line."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rcare_marl.agents.coaching.exercise import Exercise, Reach, exercise_names, load_exercise
from rcare_marl.agents.coaching.recognition.recogniser import ERRORS, Frame, Judgement, Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.recognition.template import COLUMN, Template, features
from rcare_marl.agents.coaching.sources.hands_source import HandsReading, HandsSource
from rcare_marl.agents.coaching.upper_body import (
    ARM,
    MOTION_INDEX,
    MOTIONS,
    SIDES,
    UpperBody,
    directions,
)
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose

RATE = 30.0


def watch(
    exercise: Exercise,
    path: np.ndarray,
    *,
    recogniser: RuleRecogniser | None = None,
    before: float = 1.0,
    after: float = 1.0,
    start: float = 0.0,
) -> list[tuple[float, Judgement]]:
    """Return the judgements on a path [frames, 16] with rest before and after, with their times."""
    if recogniser is None:
        recogniser = RuleRecogniser()
        recogniser.begin(exercise)
    still = (np.repeat(path[:1], int(before * RATE), 0), np.repeat(path[-1:], int(after * RATE), 0))
    rows = np.concatenate((still[0], path, still[1]))
    times = start + np.arange(len(rows)) / RATE
    return [(t, recogniser.update(Frame(t, row))) for t, row in zip(times, rows, strict=True)]


def verdicts(judgements: list[tuple[float, Judgement]]) -> list[Repetition]:
    return [judgement.finished for _, judgement in judgements if judgement.finished is not None]


def changed(exercise: Exercise, **degrees: float) -> np.ndarray:
    """Return the path of an exercise with angles added as far as it has gone."""
    path = exercise.path()
    gone = np.abs(path - path[0]).sum(axis=1)
    for motion, value in degrees.items():
        path[:, MOTION_INDEX[motion]] += math.radians(value) * gone / gone.max()
    return path


@pytest.mark.parametrize("name", exercise_names())
def test_what_was_shown_is_right_and_decided_within_half_a_second(name: str) -> None:
    exercise = load_exercise(name)
    judgements = watch(exercise, exercise.path())
    (repetition,) = verdicts(judgements)
    assert repetition.right and repetition.errors == () and repetition.score > 0.9
    decided = next(t for t, judgement in judgements if judgement.finished)
    assert abs(decided - (1.0 + exercise.duration)) < 0.5
    green = [
        judgement.following for t, judgement in judgements if 2.0 < t < 1.0 + exercise.duration
    ]
    assert np.mean(green) > 0.9
    assert not any(judgement.following for t, judgement in judgements if t < 1.0)


@pytest.mark.parametrize("asked", exercise_names())
@pytest.mark.parametrize("done", exercise_names())
def test_another_exercise_is_never_right(asked: str, done: str) -> None:
    if asked == done:
        return
    (repetition,) = verdicts(watch(load_exercise(asked), load_exercise(done).path()))
    assert not repetition.right
    # The front raise is the first part of two others.
    part = {"range", "part_missing"} if done == "front_raise" else set()
    assert set(repetition.errors) & ({"other_exercise"} | part)


@pytest.mark.parametrize(
    ("name", "change", "error"),
    [
        ("lateral_raise", {"left_shoulder_plane": 42, "right_shoulder_plane": 42}, "direction"),
        (
            "lateral_raise",
            {"left_shoulder_elevation": -40, "right_shoulder_elevation": -40},
            "range",
        ),
        ("front_raise", {"left_shoulder_elevation": -38}, "asymmetric"),
        ("upper_lift", {"trunk_lateral_flexion_left": 25}, "trunk_lean"),
        ("chest_expansion", {"trunk_flexion": 25}, "trunk_lean"),
        ("front_raise", {"trunk_rotation_left": 35}, "trunk_turn"),
        ("lateral_raise", {"left_elbow_flexion": 90, "right_elbow_flexion": 90}, "bent_elbows"),
        ("lateral_raise", {"neck_flexion": 60}, "head_moved"),
    ],
)
def test_a_mistake_is_named(name: str, change: dict[str, float], error: str) -> None:
    exercise = load_exercise(name)
    judgements = watch(exercise, changed(exercise, **change))
    (repetition,) = verdicts(judgements)
    assert not repetition.right and error in repetition.errors
    assert judgements[-1][1].following is False
    hint = next(judgement.hint for _, judgement in judgements if judgement.finished)
    assert hint == ERRORS[repetition.errors[0]]


def test_one_arm_alone_the_wrong_side_and_the_head_alone_are_told_apart() -> None:
    exercise = load_exercise("front_raise")
    left = exercise.one_sided("left")
    assert verdicts(watch(exercise, left.path()))[0].errors[0] == "one_side"
    assert verdicts(watch(exercise.one_sided("right"), left.path()))[0].errors[0] == "wrong_side"
    assert verdicts(watch(left, left.path()))[0].right
    nod = np.repeat(exercise.keys[:1], 60, axis=0)
    nod[:, MOTION_INDEX["neck_flexion"]] = 0.6 * np.sin(np.linspace(0, np.pi, 60))
    assert verdicts(watch(exercise, nod))[0].errors == ("head_only",)
    head = load_exercise("head_rotation")
    assert verdicts(watch(head.one_sided("left"), head.one_sided("right").path()))[0].errors[0] == (
        "wrong_side"
    )


def test_a_movement_that_is_no_exercise_is_unknown() -> None:
    exercise = load_exercise("lateral_raise")
    path = np.repeat(exercise.keys[:1], 75, axis=0)
    up = np.sin(np.linspace(0, np.pi, 75)) ** 0.5
    side = ARM["right"].start
    goal = np.radians((60, 70, 10, 135, 30))  # a hand to the mouth
    path[:, side : side + 5] += up[:, None] * (goal - path[0, side : side + 5])
    (repetition,) = verdicts(watch(exercise, path))
    assert repetition.errors == ("unknown_movement",)


def test_tempo_is_judged_against_what_was_shown() -> None:
    exercise = load_exercise("upper_lift")
    for factor, error in ((4.0, "too_fast"), (0.38, "too_slow")):
        (repetition,) = verdicts(watch(exercise, exercise.faster(factor).path()))
        assert error in repetition.errors
    for factor in (0.65, 1.5):
        (repetition,) = verdicts(watch(exercise, exercise.faster(factor).path()))
        assert repetition.right


def test_a_pause_half_way_and_a_repetition_begun_without_rest_are_no_faults() -> None:
    exercise = load_exercise("lateral_raise")
    path = exercise.path()
    half = int(np.argmax(path[:, ARM["left"].start] > 0.8))
    paused = np.concatenate((path[:half], np.repeat(path[half : half + 1], 30, 0), path[half:]))
    assert [r.right for r in verdicts(watch(exercise, paused))] == [True]
    low = int(np.flatnonzero(path[:, ARM["left"].start] > 0.45)[-1])  # turns round 26 degrees up
    first = int(np.argmax(path[:, ARM["left"].start] > 0.45))
    without_rest = np.concatenate((path[:low], path[first:low], path[first:]))
    assert [r.right for r in verdicts(watch(exercise, without_rest))] == [True] * 3


def test_a_pause_near_rest_on_the_way_back_ends_nothing_twice() -> None:
    exercise = load_exercise("lateral_raise")
    path = exercise.path()
    low = int(np.flatnonzero(path[:, ARM["left"].start] > 0.52)[-1])  # thirty degrees up
    paused = np.concatenate((path[:low], np.repeat(path[low : low + 1], 20, 0), path[low:]))
    again = np.concatenate((paused, np.repeat(path[-1:], 30, 0), paused))
    assert [r.right for r in verdicts(watch(exercise, again))] == [True, True]


def test_hurried_repetitions_of_several_poses_are_told_apart() -> None:
    exercise = load_exercise("chest_expansion")
    path = exercise.path()
    out = np.flatnonzero(path[:, ARM["left"].start] > 0.5)  # turns round half a radian up
    hurried = np.concatenate((path[: out[-1]], path[out[0] : out[-1]], path[out[0] :]))
    assert len(verdicts(watch(exercise, hurried))) == 3


def test_an_arm_that_cannot_be_straightened_points_as_its_upper_arm_does() -> None:
    exercise = load_exercise("lateral_raise")
    keys = exercise.keys.copy()
    keys[:, [ARM[side].start + 3 for side in SIDES]] = np.radians(35)
    asked = exercise._with_keys(keys)
    sagging = asked.path()
    for side in SIDES:
        sagging[:, ARM[side].start + 2] = np.radians(-45)  # the forearm hangs
    assert Template(asked).bent == (True, True) and Template(exercise).bent == (False, False)
    assert [r.right for r in verdicts(watch(asked, sagging))] == [True]


def test_small_faults_add_up_and_what_is_nearly_right_is_said_to_be() -> None:
    exercise = load_exercise("lateral_raise")
    one = verdicts(watch(exercise, changed(exercise, trunk_flexion=8)))[0]
    assert one.right and 0.5 < one.score < 0.999 and one.verdict == "right"
    both = {"trunk_flexion": 8.5, "left_elbow_flexion": 22, "neck_flexion": 12}
    several = verdicts(watch(exercise, changed(exercise, **both)))[0]
    assert several.verdict == "nearly" and several.words.startswith("Nearly right. ")
    far = verdicts(watch(exercise, changed(exercise, trunk_flexion=20)))[0]
    assert far.verdict == "wrong" and far.score < 0.05 and far.used["trunk_lean"] > 1.5


def test_limits_give_way_to_a_source_that_is_unsure() -> None:
    exercise = load_exercise("lateral_raise")
    path = changed(exercise, left_elbow_flexion=40, right_elbow_flexion=40)
    rows = np.concatenate((np.repeat(path[:1], 30, 0), path, np.repeat(path[-1:], 30, 0)))
    for unsure, right in ((np.radians(2.0), False), (np.radians(30.0), True)):
        recogniser = RuleRecogniser()
        recogniser.begin(exercise)
        sd = np.full(16, np.radians(2.0))
        sd[[ARM[side].start + 3 for side in ("left", "right")]] = unsure
        found = [recogniser.update(Frame(k / RATE, row, sd)).finished for k, row in enumerate(rows)]
        assert [r.right for r in found if r is not None] == [right]


def test_standing_still_is_told_once_in_a_while() -> None:
    exercise = load_exercise("lateral_raise")
    still = np.repeat(exercise.keys[:1], int(14 * RATE), axis=0)
    found = verdicts(watch(exercise, still))
    assert [repetition.errors for repetition in found] == [("no_movement",)] * 2
    assert found[0].end == pytest.approx(exercise.duration + exercise.judged.patience_s, abs=0.1)


def test_nobody_to_be_seen_is_not_standing_still() -> None:
    exercise = load_exercise("lateral_raise")
    nothing = np.full((int(8 * RATE), len(MOTIONS)), np.nan)
    assert verdicts(watch(exercise, nothing))[0].errors == ("not_seen",)


def test_repetitions_are_counted_one_by_one() -> None:
    exercise = load_exercise("chest_expansion")
    pause = np.repeat(exercise.keys[:1], 20, axis=0)
    path = np.concatenate([part for _ in range(4) for part in (exercise.path(), pause)])
    found = verdicts(watch(exercise, path))
    assert [repetition.right for repetition in found] == [True] * 4
    assert all(a.end <= b.start for a, b in zip(found, found[1:], strict=False))


def test_a_slow_start_and_another_rest_do_no_harm() -> None:
    exercise = load_exercise("lateral_raise")
    path = exercise.path()
    slow = path[np.round(np.linspace(0, 1, 140) ** 1.6 * (len(path) - 1)).astype(int)]
    assert verdicts(watch(exercise, slow))[0].right
    lap = np.radians((25, 65, 25, 70, 60))
    for side in ("left", "right"):
        share = (path[:, ARM[side].start] - path[0, ARM[side].start]) / math.radians(78)
        path[:, ARM[side]] += (1 - np.clip(share, 0, 1))[:, None] * (lap - path[0, ARM[side]])
    assert verdicts(watch(exercise, path))[0].right


def test_noise_drop_outs_and_a_rough_clock_do_no_harm() -> None:
    rng = np.random.default_rng(0)
    exercise = load_exercise("front_raise")
    recogniser = RuleRecogniser()
    recogniser.begin(exercise)
    rest = np.repeat(exercise.keys[:1], 40, axis=0)
    path = np.concatenate((rest, exercise.path(), rest))
    path += np.radians(rng.normal(0, 2, size=path.shape))
    path[rng.random(len(path)) < 0.05] = np.nan
    path[70:78, ARM["left"]] = np.nan
    times = np.arange(len(path)) / RATE + rng.normal(0, 0.004, size=len(path))
    found = [recogniser.update(Frame(t, row)).finished for t, row in zip(times, path, strict=True)]
    assert [repetition.right for repetition in found if repetition] == [True]


def test_angles_that_no_source_knows_are_not_needed() -> None:
    exercise = load_exercise("lateral_raise")
    path = exercise.path()
    for side in ("left", "right"):
        path[:, ARM[side].start + 2 : ARM[side].stop] = np.nan
    path[:, :6] = np.nan
    assert verdicts(watch(exercise, path))[0].right


def test_an_arm_that_is_not_seen_is_not_called_wrong() -> None:
    exercise = load_exercise("lateral_raise")
    path = exercise.path()
    path[:, ARM["left"]] = np.nan
    (repetition,) = verdicts(watch(exercise, path))
    assert repetition.errors == ("not_seen",)


def test_goals_of_a_person_are_judged_as_theirs() -> None:
    exercise = load_exercise("lateral_raise")
    high = np.full(len(MOTIONS), 4.0)
    high[[ARM[side].start for side in ("left", "right")]] = math.radians(45)
    adapted = exercise.adapted(Reach(-high, high))
    path = adapted.path()
    assert verdicts(watch(adapted, path))[0].right
    assert not verdicts(watch(exercise, path))[0].right


def test_frames_that_come_twice_or_late_are_passed_over() -> None:
    exercise = load_exercise("front_raise")
    recogniser = RuleRecogniser()
    recogniser.begin(exercise)
    path = np.concatenate((np.repeat(exercise.keys[:1], 30, 0), exercise.path()))
    path = np.concatenate((path, np.repeat(exercise.keys[:1], 30, 0)))
    found = []
    for i, row in enumerate(path):
        for time in (i / RATE, i / RATE, (i - 3) / RATE):
            found.append(recogniser.update(Frame(time, row)).finished)
    assert [repetition.right for repetition in found if repetition] == [True]


def test_a_recogniser_begins_before_it_judges() -> None:
    with pytest.raises(RuntimeError, match="before begin"):
        RuleRecogniser().update(Frame(0.0, np.zeros(16)))
    with pytest.raises(ConfigError, match="16 angles"):
        Frame(0.0, np.zeros(5))
    with pytest.raises(UnknownNameError, match="error of a repetition"):
        Repetition(0.0, 1.0, False, ("sloppy",), 0.0)


def test_features_are_the_directions_of_the_body() -> None:
    rng = np.random.default_rng(1)
    angles = rng.uniform(-1.5, 1.5, size=(20, 16))
    for side in ("left", "right"):
        angles[::2, ARM[side].start + 3] = 0.0  # a straight arm and a clearly bent one
        angles[1::2, ARM[side].start + 3] = 1.6
    rows, body = features(angles), UpperBody.of_height(1.6)
    for name, wanted in directions(angles).items():
        assert rows[:, COLUMN[name]] == pytest.approx(wanted)
    angles[:, :3] = 0.0
    points, rows = body.points(angles), features(angles)
    for side in ("left", "right"):
        wrist = points[f"{side}_wrist"] - points[f"{side}_shoulder"]
        assert rows[:, COLUMN[f"{side}_wrist"]] == pytest.approx(
            wrist / (body.upper_arm + body.forearm)
        )


def readings(body: UpperBody, path: np.ndarray, seat: Pose) -> list[HandsReading]:
    poses = body.poses(path)
    return [
        HandsReading(
            *(
                seat @ Pose(tuple(p[i].tolist()), tuple(q[i].tolist()))
                for p, q in (poses["head"], poses["left_hand"], poses["right_hand"])
            )
        )
        for i in range(len(path))
    ]


@pytest.mark.parametrize("name", exercise_names())
def test_headset_and_hands_show_the_directions_of_the_arms(name: str) -> None:
    body, exercise = UpperBody.of_height(1.72), load_exercise(name)
    path = np.concatenate((np.repeat(exercise.keys[:1], 40, 0), exercise.faster(0.5).path()))
    seat = Pose((2.0, -1.0, 0.5), (0.0, 0.0, math.sin(1.1), math.cos(1.1)))
    source = HandsSource(1.72)
    frames = [source.update(r, i / RATE) for i, r in enumerate(readings(body, path, seat))]
    assert frames[10] is None  # not calibrated yet
    seen = directions(np.array([frame.angles for frame in frames if frame is not None]))
    true = directions(path[[frame is not None for frame in frames]])
    for part, wanted in true.items():
        off = np.degrees(np.arccos(np.clip((seen[part] * wanted).sum(axis=1), -1, 1)))
        assert off.max() < 12, part


def test_a_lean_and_a_turn_show_in_headset_and_hands() -> None:
    body = UpperBody.of_height(1.6)
    source = HandsSource(1.6)
    rest = load_exercise("lateral_raise").keys[1]
    upright = np.repeat(rest[None], 40, axis=0)
    moved = upright.copy()
    moved[:, MOTION_INDEX["trunk_flexion"]] = 0.35
    moved[:, MOTION_INDEX["trunk_rotation_left"]] = 0.5
    every = readings(body, np.concatenate((upright, moved)), Pose())
    frame = [source.update(reading, i / RATE) for i, reading in enumerate(every)][-1]
    assert frame is not None
    assert frame.angles[0] == pytest.approx(0.35, abs=0.03)
    assert frame.angles[2] == pytest.approx(0.5, abs=0.12)


def test_a_lost_hand_is_unknown_and_a_broken_reading_is_none() -> None:
    body = UpperBody.of_height(1.6)
    source = HandsSource(1.6)
    (whole,) = readings(body, np.zeros((1, 16)), Pose())
    source.calibrate([whole])
    broken = Pose((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    for right in (None, broken, Pose((0, 0, 0), (0, 0, 0, 0))):
        frame = source.update(HandsReading(whole.head, whole.left, right), 0.0)
        assert frame is not None and np.isfinite(frame.angles[ARM["left"]]).all()
        assert np.isnan(frame.angles[ARM["right"]]).all()
    assert source.update(HandsReading(None, whole.left, whole.right), 0.1) is None
    with pytest.raises(ConfigError, match="head is seen"):
        source.calibrate([HandsReading(None, None, None)])


def guided(body: UpperBody) -> list[HandsReading]:
    """Ten seconds of calibration: arms hang, go forward, to the sides, and round."""
    keys = [(8, 30), (8, 30), (90, 90), (90, 0), (150, 45), (90, 0), (8, 30)]
    times = np.linspace(0, len(keys) - 1, 300)
    path = np.zeros((300, 16))
    for side in ("left", "right"):
        for column in (0, 1):
            values = np.radians([key[column] for key in keys])
            path[:, ARM[side].start + column] = np.interp(times, range(len(keys)), values)
        path[:, ARM[side].start + 3] = math.radians(8)
    return readings(body, path, Pose((0.3, 0.2, 0.5), (0.0, 0.0, math.sin(0.4), math.cos(0.4))))


def test_a_guided_calibration_finds_how_a_person_is_built_and_it_can_be_kept() -> None:
    usual = UpperBody.of_height(1.7)
    body = replace(
        usual,
        shoulder=1.12 * usual.shoulder,
        upper_arm=1.06 * usual.upper_arm,
        forearm=1.06 * usual.forearm,
    )
    source = HandsSource(1.7)
    source.calibrate(guided(body))
    assert source.fit.is_measured
    assert source.body.shoulder == pytest.approx(body.shoulder, rel=0.08)
    assert source.body.reach == pytest.approx(body.reach, rel=0.03)
    assert source.fit.of_direction < HandsSource(1.7).fit.of_direction
    assert HandsSource(1.7, fit=source.fit).body == source.body
    with pytest.raises(ConfigError, match="do not fit a stature"):
        HandsSource(1.1).calibrate(guided(UpperBody.of_height(1.9)))


def test_hands_that_were_calibrated_see_an_elbow_that_is_well_bent() -> None:
    body, exercise = UpperBody.of_height(1.7), load_exercise("lateral_raise")
    said = []
    for bent in (12.0, 60.0):
        source, recogniser = HandsSource(1.7), RuleRecogniser()
        source.calibrate(guided(body))
        recogniser.begin(exercise)
        extra = {f"{side}_elbow_flexion": bent for side in ("left", "right")}
        path = changed(exercise, **extra)
        path = np.concatenate((np.repeat(path[:1], 45, 0), path, np.repeat(path[-1:], 60, 0)))
        at = Pose((0.3, 0.2, 0.5), (0.0, 0.0, math.sin(0.4), math.cos(0.4)))
        for k, raw in enumerate(readings(body, path, at)):
            frame = source.update(raw, k / RATE)
            assert frame is not None
            found = recogniser.update(frame).finished
            said += [found.errors] if found is not None else []
    assert said == [(), ("bent_elbows",)]


def test_hands_that_are_swapped_are_noticed_and_sorted() -> None:
    body = UpperBody.of_height(1.7)
    path = np.zeros((60, 16))
    path[40:, ARM["left"].start] = 1.4
    source = HandsSource(1.7)
    frames = [
        source.update(HandsReading(r.head, r.right, r.left), k / RATE)
        for k, r in enumerate(readings(body, path, Pose()))
    ]
    assert source.is_swapped and frames[-1] is not None
    assert frames[-1].angles[ARM["left"].start] > 1.0 > frames[-1].angles[ARM["right"].start]


def test_a_headset_that_sits_askew_and_a_gaze_aside_make_nobody_lean() -> None:
    body, tilt = (
        UpperBody.of_height(1.7),
        Pose((0, 0, 0), (0.0, math.sin(0.17), 0.0, math.cos(0.17))),
    )
    still = readings(body, np.zeros((45, 16)), Pose())
    source = HandsSource(1.7)
    frames = [
        source.update(HandsReading(r.head @ tilt, r.left, r.right), k / RATE)
        for k, r in enumerate(still)
        if r.head is not None
    ]
    assert frames[-1] is not None and np.abs(frames[-1].angles[:6]).max() < math.radians(1)
