"""Who says no is not pressed: what was offered goes away, comes again, and after the third no stays away."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from episode import play
from variants import few

import rcare_marl
from rcare_marl.agents.people.human import Human
from rcare_marl.baselines.scripted.offering import Offering
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.episode import EpisodeRecorder, replay
from rcare_marl.envs.scenes.refusal import GENTLE, LAST_NO, Refusal, turns_away

TASKS = ("feeding", "drinking", "bathing")


def refusing(task: str, policy: str = "refusing", **cast: Any) -> CareEnv:
    return rcare_marl.make(task, policies={"robot": "scripted", "recipient": policy}, **cast)


def step(before: Refusal, **changes: Any) -> Refusal:
    usual = {"says_no": False, "is_offered": True, "is_away": False, "force": 0.0}
    return before.after(**{**usual, **changes})


@pytest.mark.parametrize("task", few(TASKS, "feeding", "bathing"))
def test_who_refuses_from_the_start_is_offered_three_times_and_then_left_alone(task: str) -> None:
    env = refusing(task, "behaviour")
    env.reset(seed=0)
    env.policies["recipient"].cues.refuses = True  # type: ignore[attr-defined]
    while not env.is_over:
        env.step({})
    report = env.task.report()
    assert env.task.succeeded() and report["refusals"] == LAST_NO
    assert report["pressed_after_no_n"] <= GENTLE
    env.close()


def test_the_gentle_cup_is_offered_again_once_it_is_back_however_long_that_takes() -> None:
    offering, far, near = Offering(), True, False
    said_no = step(step(Refusal()), says_no=True)
    assert offering.once_back(Refusal(), near)
    assert not offering.once_back(said_no, far)  # the no stands
    taken_away = step(said_no, is_offered=False, is_away=True)
    assert not any(offering.once_back(taken_away, near) for _ in range(100))
    assert offering.once_back(taken_away, far)
    assert offering.once_back(taken_away, near)  # on its way again
    final = dataclasses.replace(taken_away, count=LAST_NO)
    assert not offering.once_back(final, far)


def test_who_refuses_a_gentle_cup_is_offered_it_three_times() -> None:
    env = rcare_marl.make("drinking", policies={"robot": "gentle", "recipient": "refusing"})
    play(env, 0)
    report = env.task.report()
    env.close()
    assert env.task.succeeded() and report["refusals"] == LAST_NO
    assert report["pressed_after_no_n"] <= GENTLE


@pytest.mark.parametrize("task", few(TASKS, "feeding", "bathing"))
def test_a_no_in_the_middle_ends_the_touch_gently(task: str) -> None:
    env = refusing(task)
    for seed in range(1 if task == "drinking" else 2):
        play(env, seed)
        assert env.task.succeeded()
        assert env.task.report()["pressed_after_no_n"] <= GENTLE
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("person", ["jose", "daniel", "morgan"])
@pytest.mark.parametrize("task", TASKS)
def test_nobody_is_pressed_after_a_no(task: str, person: str) -> None:
    env = refusing(task, recipient=person)
    for seed in range(7000, 7034):
        play(env, seed)
        assert env.task.succeeded(), seed
        assert env.task.report()["pressed_after_no_n"] <= GENTLE, seed
    env.close()


def test_a_no_counts_once_until_the_offer_was_taken_away() -> None:
    no = step(Refusal(), says_no=True)
    assert no.count == 1 and no.stands
    assert step(no, says_no=True).count == 1
    away = step(no, says_no=True, is_offered=False, is_away=True)
    assert not away.stands
    assert step(away, says_no=True).count == 2


def test_a_no_to_nothing_is_no_refusal() -> None:
    assert step(Refusal(), says_no=True, is_offered=False, is_away=True).count == 0


def test_only_force_after_the_no_counts() -> None:
    no = step(Refusal(), says_no=True, force=9.0)
    assert no.pressed == 0.0
    pressed = step(no, force=6.0)
    assert pressed.pressed == 6.0 and pressed.is_hurt


def test_who_was_pressed_was_not_respected() -> None:
    left = Refusal(count=LAST_NO, pressed=GENTLE + 0.1)
    assert not left.is_respected and Refusal(count=LAST_NO).is_respected


def test_a_face_that_is_turned_away_for_two_steps_means_no() -> None:
    first = step(Refusal(), turns_away=True)
    assert not first.is_no and step(first, turns_away=True).count == 1


def test_an_open_mouth_is_no_refusal() -> None:
    env = refusing("feeding", "still")
    env.reset(seed=0)
    person = env.cast["recipient"]
    assert isinstance(person, Human)
    aside, way = np.array((0.0, 1.0, 0.0)), np.array((0.3, 0.0, 0.0))
    assert turns_away(person, aside, way, jaw=0.0)
    assert not turns_away(person, aside, way, jaw=0.3)
    assert not turns_away(person, np.array((1.0, 0.0, 0.0)), way, jaw=0.0)
    env.close()


def test_a_no_is_part_of_the_action_so_a_replay_hears_it() -> None:
    env = refusing("feeding")
    recorder = EpisodeRecorder(env)
    play(env, 3)
    episode = recorder.episode()
    assert env.cast["recipient"].action_names[-1].startswith("says no")
    env.close()
    assert replay(episode).difference == ""


def test_agents_observe_refusals_where_the_options_say_so() -> None:
    names = []
    for options in ({"refusals_observed": False}, {}):
        env = rcare_marl.make("drinking", options=options, policies={"recipient": "behaviour"})
        names.append({name for _, name, _ in env.describe("robot")})
        env.close()
    assert names[1] - names[0] == {"says_no", "no_stands", "refusals"}
