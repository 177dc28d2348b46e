"""Scratching: only strokes over the itch with a gentle press relieve it, and it can be done."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from episode import play

import rcare_marl
from rcare_marl import assets
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.scenes.refusal import LAST_NO
from rcare_marl.envs.scenes.skin_spot import FREE
from rcare_marl.envs.tasks.scratching import GAPS, PRESS, RELIEF, SITES, Scratching
from rcare_marl.errors import ConfigError


def made(
    recipient: str = "jose", partner: str = "still", robot: str = "scripted", **arguments: Any
) -> CareEnv:
    policies = {"robot": robot, "recipient": partner}
    return rcare_marl.make("scratching", recipient=recipient, policies=policies, **arguments)


@pytest.mark.parametrize("site", SITES)
def test_the_scripted_robot_relieves_an_itch_gently(site: str) -> None:
    env = made(options={"site": site})
    play(env, 0)
    task = cast(Scratching, env.task)
    assert task.succeeded() and task.state.scratched >= RELIEF - 1e-9
    assert task.state.peak_force < 10.0
    env.close()


def test_the_gentle_script_relieves_an_itch_with_less_force_than_the_scripted_one() -> None:
    forces = {}
    for robot in ("scripted", "gentle"):
        env = made(robot=robot, options={"site": "forearm"})
        play(env, 0)
        task = cast(Scratching, env.task)
        assert task.succeeded(), robot
        forces[robot] = task.state.peak_force
        env.close()
    assert 0 < forces["gentle"] < 0.8 * forces["scripted"]


@pytest.mark.slow
@pytest.mark.parametrize("avatar", [n for n in assets.names("avatars") if n != "caregiver"])
@pytest.mark.parametrize("partner", ["still", "behaviour", "refusing"])
def test_everybody_can_be_scratched_or_is_left_alone(avatar: str, partner: str) -> None:
    env = made(avatar, partner)
    for seed in range(10):
        play(env, seed)
        assert env.task.succeeded(), seed
        assert env.task.report()["pressed_after_no_n"] <= PRESS[1]
    env.close()


def test_a_tool_that_rests_on_the_itch_does_not_scratch() -> None:
    env = rcare_marl.make("scratching", policies={"robot": "still", "recipient": "still"})
    play(env, 0)
    assert cast(Scratching, env.task).state.scratched == 0.0
    env.close()


def test_it_itches_near_where_the_person_says() -> None:
    env = made()
    for seed in range(5):
        env.reset(seed=seed)
        state = cast(Scratching, env.task).state
        assert np.linalg.norm(state.said - state.itch) < 0.015
        assert state.site.sum() == 1
    env.close()


@pytest.mark.slow
def test_it_itches_where_no_thumb_is_in_the_way() -> None:
    env = made("natalia", options={"site": "hand"})  # hers is up: the hand's top lies under it
    play(env, 0)
    task = cast(Scratching, env.task)
    assert task._itch.room(GAPS) > FREE and task.succeeded()
    env.close()


def test_who_says_no_is_not_scratched() -> None:
    env = made(partner="refusing")
    play(env, 0)
    report = env.task.report()
    assert env.task.succeeded() and report["pressed_after_no_n"] <= PRESS[1]
    env.close()


@pytest.mark.slow
def test_a_cheek_that_is_turned_away_is_offered_to_until_the_third_no() -> None:
    env = made("natalia", partner="refusing", options={"site": "cheek"})
    play(env, 0)
    report = env.task.report()
    assert env.task.succeeded() and report["refusals"] == LAST_NO
    assert report["pressed_after_no_n"] <= PRESS[1]
    env.close()


@pytest.mark.slow
def test_a_robot_that_reaches_no_itch_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match="fetch has no arm that reaches the forearm"):
        rcare_marl.make("scratching", robot="fetch", options={"site": "forearm"})
