"""Promises of the synthetic people: right is right, wrong is wrong by far, and the counts add up."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from rcare_marl.agents.coaching.exercise import exercise_names, load_exercise
from rcare_marl.agents.coaching.recognition.recogniser import Repetition
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX, directions
from rcare_marl.baselines.coaching.evaluation import (
    CoachEvaluation,
    Trial,
    evaluate_coach,
    make_sensor,
    score_trial,
)
from rcare_marl.baselines.coaching.noise import HandsSensor, NoiseModel
from rcare_marl.baselines.coaching.performance import (
    GRADED,
    WRONG,
    Performance,
    idle,
    perform,
    perform_at,
)
from rcare_marl.baselines.coaching.synthetic_user import PACE, RANGE, draw_users
from rcare_marl.errors import ConfigError, UnknownNameError

NAMES = exercise_names()
QUIET = NoiseModel(position=0.0, angle_deg=0.0, jitter=0.0, clock=0.0, dropout=0.0)


def performed(kind: str, name: str, user: int = 0) -> Performance | None:
    people = draw_users(user + 1, seed=3, split="development")
    rng = np.random.default_rng((9, user))
    return perform(people[user], load_exercise(name), kind, rng, others=NAMES)


def test_people_differ_in_all_that_makes_recognition_hard() -> None:
    people = draw_users(40, seed=0, split="development")
    heights = [user.height for user in people]
    assert min(heights) < 1.55 and max(heights) > 1.85
    assert {user.handed for user in people} == {"left", "right"}
    assert {user.span_known for user in people} == {True, False}
    assert max(np.degrees(user.tremor).max() for user in people) > 1.0
    assert all(4.0 <= user.tremor_rate <= 6.0 for user in people)


def test_nobody_is_in_both_splits_and_the_same_seed_gives_the_same_people() -> None:
    again, other = (draw_users(5, seed=1, split=s) for s in ("development", "test"))
    first = draw_users(5, seed=1, split="development")
    assert [u.height for u in first] == [u.height for u in again]
    assert not {u.height for u in first} & {u.height for u in other}


@pytest.mark.parametrize("name", NAMES)
def test_what_counts_as_right_is_nearly_what_was_shown(name: str) -> None:
    exercise = load_exercise(name)
    goal = exercise.excursions(exercise.keys)
    for user in range(6):
        done = performed("right", name, user)
        assert done is not None
        ((start, end),) = done.spans
        assert PACE[0] * 0.8 < (end - start) / exercise.duration < PACE[1] * 1.2
        excursions = exercise.excursions(done.angles)
        for part in exercise.parts:  # tremor, breathing and gaze come on top
            assert RANGE[0] - 0.1 < excursions[part] / goal[part] < RANGE[1] + 0.2
        trunk = directions(done.angles)["trunk"]
        assert np.degrees(np.arccos(trunk[:, 2].min())) < 8


@pytest.mark.parametrize("kind", WRONG)
def test_every_way_to_be_wrong_can_be_done_in_nearly_every_exercise(kind: str) -> None:
    done = [performed(kind, name) for name in NAMES]
    assert sum(performance is not None for performance in done) >= 4
    assert all(np.isfinite(performance.angles).all() for performance in done if performance)


def test_wrong_performances_are_wrong_by_far() -> None:
    exercise = load_exercise("lateral_raise")
    goal = exercise.excursions(exercise.keys)["left_arm"]
    for user in range(5):
        half = performed("half_range", "lateral_raise", user)
        assert half is not None
        assert exercise.excursions(half.angles)["left_arm"] < 0.75 * goal
        fast = performed("too_fast", "lateral_raise", user)
        assert fast is not None
        assert fast.spans[0][1] - fast.spans[0][0] < 0.4 * exercise.duration
        lean = performed("trunk_lean", "lateral_raise", user)
        assert lean is not None
        assert np.degrees(np.arccos(directions(lean.angles)["trunk"][:, 2].min())) > 15
        still = performed("standing_still", "lateral_raise", user)
        assert still is not None and still.spans == ()
        plane = performed("wrong_plane", "lateral_raise", user)
        assert plane is not None
        top = plane.angles[np.argmax(plane.angles[:, ARM["left"].start])]
        assert math.degrees(top[MOTION_INDEX["left_shoulder_plane"]]) > 40


@pytest.mark.parametrize("used", [0.5, 0.9, 1.1, 2.0])
def test_a_limit_is_used_as_far_as_was_asked_for(used: float) -> None:
    exercise = load_exercise("lateral_raise")
    user = draw_users(1, seed=3, split="development")[0]
    for kind in GRADED:
        done = perform_at(user, exercise, kind, used, np.random.default_rng(1))
        assert done is not None and done.used == used
        (span,), demand = done.spans, exercise.judged
        during = done.angles[(done.times >= span[0]) & (done.times <= span[1])]
        if kind == "trunk_lean":
            lean = np.degrees(np.arccos(directions(during)["trunk"][:, 2].min()))
            assert lean == pytest.approx(used * demand.lean_deg, abs=2.5)
        elif kind == "bent_elbows":
            top = during[int(np.argmax(during[:, ARM["left"].start]))]
            bent = np.degrees(top[ARM["left"].start + 3]) - 5.0
            assert bent == pytest.approx(used * demand.elbow_deg, abs=8.0)
    assert (
        perform_at(
            user, load_exercise("head_rotation"), "bent_elbows", 1.1, np.random.default_rng(1)
        )
        is None
    )
    with pytest.raises(UnknownNameError, match="trunk_lean"):
        perform_at(user, exercise, "trunk_leen", 1.0, np.random.default_rng(0))


def test_movements_are_not_the_curves_that_exercises_are_shown_by() -> None:
    exercise = load_exercise("front_raise")
    speeds, gaps = [], []
    for user in draw_users(12, seed=2, split="development"):
        done = perform(user, exercise, "right", np.random.default_rng(4), repetitions=4)
        assert done is not None
        gaps += [b[0] - a[1] for a, b in zip(done.spans, done.spans[1:], strict=False)]
        start, end = (int(t * 120) for t in done.spans[0])
        raised = done.angles[start:end, ARM["left"].start]
        out = raised[: int(np.argmax(raised))]
        rise = np.clip((out - out[0]) / (out[-1] - out[0]), 0, 1)
        speeds.append(float(np.argmax(rise > 0.5)) / len(rise))
    assert np.ptp(speeds) > 0.15  # least jerk has gone half the way after half the time
    assert min(gaps) < 0.15 and max(gaps) > 0.7


def test_the_wrong_arm_is_the_one_that_was_not_asked_for() -> None:
    done = performed("wrong_arm", "front_raise")
    assert done is not None
    ((asked,), excursions) = done.asked.parts, done.asked.excursions(done.angles)
    other = {"left_arm": "right_arm", "right_arm": "left_arm"}[asked]
    assert math.degrees(excursions[other]) > 60 > 30 > math.degrees(excursions[asked])


def test_unknown_kinds_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="half_range"):
        performed("half_rang", "front_raise")


def test_somebody_idle_never_does_the_exercise() -> None:
    user = draw_users(1, seed=0, split="development")[0]
    done = idle(user, load_exercise("front_raise"), np.random.default_rng(0), seconds=20.0)
    assert done.kind == "idle" and done.spans == () and len(done.times) == 2400


def test_sensors_drop_out_as_often_as_they_should_and_clocks_only_grow() -> None:
    noise, rng = NoiseModel(), np.random.default_rng(0)
    lost = noise.lost(20_000, 3, rng)
    assert lost.mean() == pytest.approx(0.05, abs=0.01)
    runs = np.diff(np.flatnonzero(np.diff(lost[:, 0].astype(int)) != 0))[::2]
    assert 2.0 < min(runs.mean(), runs.max()) < 80
    taken, told = noise.times(60.0, rng)
    assert (np.diff(taken) >= 0).all() and (np.diff(told) > 0).all()
    assert np.std(np.diff(told) - 1 / 30) > 0.003
    assert not NoiseModel(dropout=0.0).lost(100, 3, rng).any()


def test_noise_is_of_the_size_that_was_asked_for() -> None:
    user = draw_users(1, seed=0, split="development")[0]
    still = perform(user, load_exercise("front_raise"), "standing_still", np.random.default_rng(0))
    assert still is not None
    spread = {}
    for size in (0.0, 0.01):
        sensor = HandsSensor(NoiseModel(position=size, angle_deg=0.0, dropout=0.0))
        rng = np.random.default_rng(1)
        sensor.source(user, rng)
        heights = [r.head.position[2] for _, _, r in sensor.readings(user, still, rng) if r.head]
        spread[size] = float(np.std(np.diff(heights)))
    assert spread[0.01] == pytest.approx(0.01 * math.sqrt(2), rel=0.2) and spread[0.0] < 0.003


def test_bad_sensors_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="source of poses"):
        make_sensor("hand", NoiseModel())
    with pytest.raises(ConfigError, match="must not be negative"):
        NoiseModel(position=-1.0)
    with pytest.raises(ConfigError, match="positive rate"):
        NoiseModel(rate=0.0)


def verdict(start: float, end: float, *errors: str) -> Repetition:
    return Repetition(start, end, not errors, errors, 1.0)


def scored(kind: str, *verdicts: tuple[float, Repetition]) -> Trial:
    spans = ((1.0, 4.0), (5.0, 8.0)) if kind == "right" else ((1.0, 4.0),)
    asked = load_exercise("front_raise")
    done = Performance(asked, kind, np.linspace(0, 10, 50), np.zeros((50, 16)), spans)
    return score_trial(0, done, verdicts)


def test_a_right_repetition_counts_only_if_all_said_of_it_was_right() -> None:
    good, late = (4.1, verdict(1.1, 4.0)), (8.2, verdict(5.1, 8.0))
    assert scored("right", good, late).recognised == 2
    assert scored("right", good, late).latencies == pytest.approx((0.1, 0.2))
    assert scored("right", good).recognised == 1
    twice = scored("right", (2.0, verdict(1.1, 1.9, "range")), good, late)
    assert (twice.recognised, twice.false_alarms) == (1, 1)
    assert scored("right", good, (9.5, verdict(5.1, 8.0))).recognised == 1  # too late


def test_a_wrong_performance_counts_only_if_it_was_called_wrong_and_never_right() -> None:
    wrong, right = (4.1, verdict(1.1, 4.0, "range")), (6.0, verdict(4.5, 5.9))
    assert scored("half_range", wrong).recognised == 1
    assert scored("half_range").recognised == 0
    assert scored("half_range", wrong, right).recognised == 0


@pytest.mark.slow
def test_an_evaluation_is_one_json_object_and_the_same_every_time() -> None:
    arguments: dict[str, Any] = {"users": 1, "seed": 5, "split": "development", "source": "joints"}
    exercises = [load_exercise("front_raise")]
    first, again = (evaluate_coach(exercises=exercises, **arguments) for _ in range(2))
    assert first == again
    told = json.loads(json.dumps(first.to_dict()))
    assert 0 <= told["right_recognised"] <= 1 and 0 <= told["wrong_detected"] <= 1
    assert set(told["exercises"]) == {"front_raise"} and told["right"]["of"] == 3
    assert sum(told["confusion"]["right"].values()) >= 3
    assert {"half_range", "standing_still"} <= set(told["kinds"])
    assert sum(row["of"] for row in told["distance"]) == len(GRADED)
    with pytest.raises(ConfigError, match="at least one person"):
        evaluate_coach(users=0)
    with pytest.raises(ConfigError, match="split"):
        evaluate_coach(split="training")


def test_nothing_evaluated_is_no_share() -> None:
    empty = CoachEvaluation("hands", 0, "test", 1, QUIET, ())
    assert empty.right_recognised == 0.0 and empty.latency() == {}


@pytest.mark.slow
def test_joint_angles_and_hands_of_a_few_people_are_recognised() -> None:
    for source in ("joints", "hands"):
        found = evaluate_coach(source=source, users=4, seed=11, split="development")
        assert found.right_recognised > 0.95 and found.wrong_detected > 0.95
        assert found.latency()["median_s"] < 0.3
