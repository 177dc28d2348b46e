"""Promises of the kinds of learners that a coach meets, as data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import rcare_marl
from rcare_marl import assets
from rcare_marl.assets import ROOT
from rcare_marl.baselines.training.config import default_config, load_config
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.coaching.learner_kind import LearnerKind, load_learner_kind
from rcare_marl.envs.tasks.social_coaching import SocialCoaching
from rcare_marl.errors import ConfigError, UnknownNameError

HELD_OUT = {"forgetful", "frail"}  # which no shipped config trains with


def lesson(**options: Any) -> CareEnv:
    return rcare_marl.make(
        "social_coaching",
        options={"exercises": ["lateral_raise"], "repetitions": 1, "reward": "shaped", **options},
        policies={"robot": "scripted", "recipient": "learner"},
    )


def task_of(env: CareEnv) -> SocialCoaching:
    assert isinstance(env.task, SocialCoaching)
    return env.task


@pytest.mark.parametrize("name", assets.names("learners"))
def test_every_kind_that_ships_can_be_loaded_and_says_who_it_is(name: str) -> None:
    assert load_learner_kind(name).description


def test_anybody_is_what_a_kind_is_without_figures() -> None:
    assert load_learner_kind("anybody") == LearnerKind(load_learner_kind("anybody").description)


@pytest.mark.parametrize("task", ["social_coaching", "group_coaching"])
def test_a_shipped_training_keeps_two_kinds_for_judging(task: str) -> None:
    kinds = load_config(default_config(task)).options["learners"]
    assert set(kinds) == set(assets.names("learners")) - HELD_OUT


def test_a_tired_learner_begins_tired_and_one_of_several_kinds_is_drawn_by_the_seed() -> None:
    env, found = lesson(learners=["tired", "quick"]), []
    for seed in (0, 1, 2, 3, 4, 5, 0):
        env.reset(seed=seed)
        trainee = task_of(env).trainee
        tired = trainee.person.physiology.fatigue_of("left_arm")
        assert (tired > 0.2) == (trainee.kind.fatigue[1] > 0)
        found.append(tired)
    env.close()
    assert found[0] == found[-1] and len({tired > 0 for tired in found}) == 2


@pytest.mark.slow
def test_a_sore_shoulder_hurts_when_it_is_raised_and_the_coach_is_told() -> None:
    env, pain = lesson(learners=["in_pain"]), [0.0]
    env.reset(seed=3)
    while not env.is_over:
        env.step({})
        pain.append(task_of(env).state.trainees["recipient"].pain)
    report, seen = task_of(env).report(), [seen.name for seen in task_of(env).observables("robot")]
    env.close()
    assert max(pain) > 1 and "told_pain" in seen
    assert report["pain"] == pytest.approx(max(pain), rel=0.05)  # safety is read a moment before
    assert report["mean_pain"] == pytest.approx(sum(pain) / (len(pain) - 1), rel=0.02)
    assert report["right_per_minute"] == pytest.approx(
        60 * report["right_repetitions"] / (0.1 * (len(pain) - 1))
    )


def test_an_exercise_of_ones_own_is_given_by_its_file(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text((ROOT / "exercises" / "lateral_raise.yaml").read_text())
    env = lesson(exercises=["head_rotation", str(mine)])
    env.reset(seed=0)
    task = task_of(env)
    assert [exercise.name for exercise in task.session.exercises] == ["head_rotation", "mine"]
    task.session.go_on()
    task.look()
    assert task.state.exercise.tolist() == [0.0, 1.0]
    env.close()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("delay: [0.8, 0.3]", "least first"),
        ("slips: 1.5", "at most 1"),
        ("returns_after: 0", "must be positive"),
        ("speeed: [1, 2]", "Did you mean 'speed'"),
    ],
)
def test_what_is_no_kind_is_refused_in_plain_words(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "odd.yaml"
    file.write_text(text)
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        load_learner_kind(str(file))
    with pytest.raises(ConfigError, match="quick"):
        lesson(learners=["quik"])
