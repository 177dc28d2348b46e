"""Ambulating: three kinds of doors are worked by contact, and each of them can be."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest
from episode import play

import rcare_marl
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.tasks.ambulating import TURNED, WIDE_ENOUGH, Ambulating
from rcare_marl.errors import ConfigError

HARDWARE = {1: "knob", 2: "lever", 3: "slider"}
BOTH = {"robot": "scripted", "recipient": "still"}


def task_of(env: CareEnv) -> Ambulating:
    return cast(Ambulating, env.task)


def run(env: CareEnv, seed: int) -> Ambulating:
    play(env, seed)
    return task_of(env)


@pytest.fixture(scope="module", params=HARDWARE)
def scripted(request: pytest.FixtureRequest) -> Iterator[CareEnv]:
    env = rcare_marl.make("ambulating", level=request.param, policies=BOTH)
    yield env
    env.close()


def test_each_level_has_its_door_and_the_scripted_robot_works_it(scripted: CareEnv) -> None:
    task = task_of(scripted)
    assert task.hardware == HARDWARE[task.level]
    for seed in range(2):
        assert run(scripted, seed).is_success()
        metrics = task.metrics()
        assert metrics["peak_door_force_n"] > 1 and metrics["peak_force_n"] == 0
        assert metrics["latched"] == 0 or task.hardware != "slider"


def test_an_episode_starts_shut_and_is_a_function_of_its_seed(scripted: CareEnv) -> None:
    tracks = []
    for seed in (3, 4, 3):
        scripted.reset(seed=seed)
        task = task_of(scripted)
        assert task.metrics()["progress"] < 0.01
        assert task._door.is_latched == (task.hardware != "slider")
        track = [scripted.state()]
        for _ in range(45):
            if not scripted.is_over:
                scripted.step({})
                track.append(scripted.state())
        tracks.append(np.array(track))
    np.testing.assert_array_equal(tracks[0], tracks[2])
    assert not np.array_equal(tracks[0][0], tracks[1][0])


@pytest.mark.slow
@pytest.mark.parametrize("level", HARDWARE)
def test_the_scripted_robot_works_ninety_five_of_a_hundred_doors(level: int) -> None:
    env = rcare_marl.make("ambulating", level=level, policies=BOTH)
    assert sum(run(env, seed).is_success() for seed in range(100)) >= 95
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("level", HARDWARE)
def test_a_random_robot_opens_next_to_nothing(level: int) -> None:
    policies = {"robot": "random", "recipient": "still"}
    env = rcare_marl.make("ambulating", level=level, policies=policies)
    assert sum(run(env, seed).is_success() for seed in range(100)) < 2
    env.close()


@pytest.mark.parametrize(("level", "kind"), [(1, "knob"), (2, "lever")])
def test_what_counts_is_that_the_latch_is_free(level: int, kind: str) -> None:
    env = rcare_marl.make("ambulating", level=level, policies=BOTH)
    env.reset(seed=0)
    task = task_of(env)
    for share, is_free in ((0.95, False), (1.05, True)):
        for _ in range(16):  # a latch looks every 8 physics steps
            task._door.body.set_joints(task._joint, [share * TURNED[kind]])
            env.world.step()
        task._door.body.set_joints(task._joint, [share * TURNED[kind]])
        task.after_step()
        assert task.is_success() == is_free and task._door.is_latched != is_free
    env.close()


def test_the_paper_rewards_rotation_of_handles_and_nearness_of_panels(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    task = task_of(scripted)
    terms = dict(task.rewards("robot"))
    assert terms.pop("opened") == 0.0
    if task.hardware == "slider":
        assert terms == {"distance": pytest.approx(-WIDE_ENOUGH, abs=1e-3)}
    else:
        assert terms == {"rotation_angle": pytest.approx(0.0, abs=1e-3)}


def test_random_actions_stay_finite(scripted: CareEnv) -> None:
    level = task_of(scripted).level
    env = rcare_marl.make("ambulating", level=level, options={"reward": "shaped"})
    for role in env.possible_agents:
        env.action_space(role).seed(0)
    env.reset(seed=0)
    for _ in range(100):
        if env.is_over:
            env.reset()
        actions = {role: env.action_space(role).sample() for role in env.agents}
        observations, rewards, _, _, _ = env.step(actions)
        assert all(np.isfinite(seen).all() for seen in observations.values())
        assert np.isfinite(list(rewards.values())).all()
    env.close()


def test_a_door_of_a_house_is_worked_where_a_chair_has_room() -> None:
    env = rcare_marl.make("ambulating", home="house_07", level=3, policies=BOTH)
    task = run(env, 0)
    assert env.task.stage is not None and env.task.built is not None
    assert task._door is env.task.built.doors[env.task.stage.fixture]
    assert task.is_success()
    env.close()


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ({"options": {"force_limit": 0}}, "force_limit"),
        ({"robot": "nao"}, "nao"),
        ({"robot": {"moves": ["arm"]}, "policies": BOTH}, "gripper"),
        ({"robot": {"control": "joint_velocity"}, "policies": BOTH}, "tool_delta"),
    ],
)
def test_what_cannot_be_is_refused(what: dict[str, object], message: str) -> None:
    with pytest.raises((ConfigError, ValueError), match=message):
        rcare_marl.make("ambulating", **what)  # type: ignore[arg-type]
