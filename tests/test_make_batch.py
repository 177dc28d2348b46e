"""Promises of `make_batch` and `make_vector`: batches by name, on either engine."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from torchrl.envs import check_env_specs

import rcare_marl
from rcare_marl.envs.learning import CareVectorEnv, EnvRecipe, LearnerEnv
from rcare_marl.envs.learning.station import episode_seed
from rcare_marl.errors import (
    ActionError,
    ConfigError,
    EpisodeError,
    MissingPackageError,
    UnknownNameError,
)

PEOPLE = ["karan", "kim"]
COUNT, SEED = 2, 4


def actions(env: CareVectorEnv, step: int) -> Any:
    """Return the same random actions for the same step."""
    return np.random.default_rng(step).uniform(-1, 1, env.action_space.shape).astype(np.float32)


def test_a_batch_is_an_environment_of_torchrl_and_meets_several_people() -> None:
    with closing(rcare_marl.make_batch("feeding", num_envs=2, recipient=PEOPLE)) as env:
        check_env_specs(env, seed=0)
        assert env.batch_size == torch.Size([2]) and env.group_map == {"robots": ["robot"]}
        assert env.recipe.engine == "mujoco"
        assert [env.recipe.entries(i)["recipient"] for i in range(2)] == PEOPLE
        seen = env.reset()["robots", "observation"]
        assert not torch.equal(seen[0], seen[1])


@pytest.mark.parametrize("engine", ["mujoco", "bullet"])
def test_a_batch_plays_the_episodes_of_the_environments_that_make_gives(engine: str) -> None:
    recipe = EnvRecipe("toileting", engine=engine)
    make = rcare_marl.make_batch
    with closing(make("toileting", num_envs=1, engine=engine, seed=SEED)) as env:
        env.set_seed(SEED)
        step = env.reset()
        with closing(LearnerEnv(recipe)) as alone:
            alone.reset(episode_seed(SEED, 0, 0))
            assert ("engine" in alone.care_env.setup) is (engine != "bullet")
            for number in range(5):
                seen = torch.from_numpy(alone.observation["robots"])
                assert torch.equal(step["robots", "observation"][0], seen)
                rng = np.random.default_rng(number)
                given = rng.uniform(-1, 1, (1, 1, env.layout.action_sizes["robots"]))
                step["robots", "action"] = torch.from_numpy(given.astype(np.float32))
                step = env.step(step)["next"]
                alone.step({"robots": given[0].astype(np.float32)})


@pytest.mark.slow
def test_processes_give_what_this_process_gives() -> None:
    rows = []
    for processes in (0, 1):
        given: Any = {"policies": {"recipient": ["cooperative", "still"]}, "robot": "kinova_gen2"}
        with closing(
            rcare_marl.make_vector("feeding", num_envs=1, processes=processes, **given)
        ) as env:
            rows.append([env.reset(seed=1)[0], *(env.step(actions(env, k))[0] for k in range(3))])
    np.testing.assert_array_equal(np.array(rows[0]), np.array(rows[1]))


BAD: dict[str, tuple[dict[str, Any], type[Exception], str]] = {
    "a device that is not there": ({"device": "cuda"}, UnknownNameError, "'cuda'.*Known: cpu"),
    "an engine that is none": ({"engine": "bulet"}, UnknownNameError, "Did you mean 'bullet'"),
    "a task that the engine has not": (
        {"task": "tooth_brushing"},
        ConfigError,
        "does not run on engine",
    ),
    "nobody": ({"recipient": []}, ConfigError, "recipient of a batch needs at least one"),
    "several houses": ({"home": ["a", "b"]}, ConfigError, "home of a batch must be one"),
    "a function": ({"policies": {"recipient": print}}, ConfigError, "must be a name, a file"),
    "no mapping": ({"policies": "still"}, ConfigError, "policies must be a mapping"),
    "no environments": ({"num_envs": 0}, ConfigError, "count must be a whole number from 1"),
    "idle processes": ({"num_envs": 1, "processes": 2}, ConfigError, "2 workers for 1"),
}


@pytest.mark.parametrize("make", [rcare_marl.make_batch, rcare_marl.make_vector])
@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_a_batch_is_refused_by_name(make: Any, name: str) -> None:
    given, error, message = BAD[name]
    with pytest.raises(error, match=message):
        make(**{"task": "feeding", **given})


def test_a_batch_without_mujoco_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingPackageError, match=r"rcare-marl\[batch\]"):
        rcare_marl.make_batch("feeding", num_envs=1)
    rcare_marl.make_batch("toileting", num_envs=1, engine="bullet").close()


@pytest.mark.slow
def test_neither_the_package_nor_a_vector_environment_loads_torch() -> None:
    code = (
        "import sys, rcare_marl; assert 'rcare_marl.envs' not in sys.modules;"
        "rcare_marl.make_vector; rcare_marl.make_batch; assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.fixture(scope="module")
def vector() -> Iterator[CareVectorEnv]:
    env = rcare_marl.make_vector("feeding", num_envs=COUNT, seed=SEED)
    yield env
    env.close()


def test_a_vector_environment_keeps_the_shapes_and_kinds_of_gymnasium(
    vector: CareVectorEnv,
) -> None:
    assert isinstance(vector, gymnasium.vector.VectorEnv)
    assert vector.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    seen, infos = vector.reset(seed=SEED)
    assert vector.observation_space.contains(seen) and vector.num_envs == COUNT
    assert vector.single_observation_space.contains(seen[0])
    assert vector.action_space.contains(vector.action_space.sample())
    seen, rewards, ended, late, infos = vector.step(actions(vector, 0))
    assert vector.observation_space.contains(seen)
    assert rewards.shape == ended.shape == late.shape == (COUNT,)
    assert [str(each.dtype) for each in (rewards, ended, late)] == ["float64", "bool", "bool"]
    assert set(infos) == {"success", "cost", "_success", "_cost"}
    assert all(value.shape == (COUNT,) for value in infos.values())
    kept = seen.copy()
    vector.step(actions(vector, 1))
    np.testing.assert_array_equal(seen, kept)  # what was handed out stays as it is


def test_the_step_after_an_end_begins_the_next_episode(vector: CareVectorEnv) -> None:
    recipe, episode, steps = EnvRecipe("feeding", engine="mujoco"), 0, 0
    seen, _ = vector.reset(seed=SEED)
    with closing(LearnerEnv(recipe)) as alone:
        alone.reset(episode_seed(SEED, 0, episode))
        while episode < 2:
            np.testing.assert_array_equal(seen[0], alone.observation["robots"][0])
            given = actions(vector, steps)
            is_over = alone.terminated or alone.truncated
            seen, rewards, ended, late, infos = vector.step(given)
            if is_over:
                episode += 1
                alone.reset(episode_seed(SEED, 0, episode))
            else:
                alone.step({"robots": given[:1]})
            assert rewards[0] == alone.reward["robots"][0]
            assert (ended[0], late[0]) == (alone.terminated, alone.truncated)
            assert infos["success"][0] == alone.success
            assert infos["cost"][0] == alone.cost["robots"][0]
            steps += 1
            assert steps < 500


def test_the_same_seed_repeats_and_another_differs(vector: CareVectorEnv) -> None:
    first, _ = vector.reset(seed=1)
    vector.step(actions(vector, 0))
    other, _ = vector.reset(seed=2)
    vector.step(actions(vector, 0))
    again, _ = vector.reset(seed=1)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_reset_can_be_of_some_environments(vector: CareVectorEnv) -> None:
    first, _ = vector.reset(seed=1)
    mask = np.array([True, False])
    fresh, _ = vector.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(first, fresh)  # none was stepped since it began
    before, *_ = vector.step(actions(vector, 0))
    after, _ = vector.reset(options={"reset_mask": mask})
    assert not np.array_equal(after[0], before[0])
    np.testing.assert_array_equal(after[1], before[1])


def test_wrappers_of_gymnasium_take_it(vector: CareVectorEnv) -> None:
    wrapped = RecordEpisodeStatistics(vector)
    wrapped.reset(seed=SEED)
    total, steps = 0.0, 0
    while True:
        _, rewards, ended, late, infos = wrapped.step(actions(vector, steps))
        total, steps = total + rewards[0], steps + 1
        if ended[0] or late[0]:
            break
    assert infos["episode"]["l"][0] == steps
    assert infos["episode"]["r"][0] == pytest.approx(total)


def test_a_wrong_call_of_a_vector_environment_is_refused(vector: CareVectorEnv) -> None:
    vector.reset(seed=0)
    for wrong in (np.zeros((COUNT, 1), np.float32), np.nan * vector.action_space.sample()):
        with pytest.raises(ActionError, match="finite numbers of shape"):
            vector.step(wrong)
    calls: list[dict[str, Any]] = [
        {"seed": -1},
        {"seed": [1, 2]},
        {"options": {"mask": None}},
        {"options": {"reset_mask": [1, 0]}},
        {"seed": 1, "options": {"reset_mask": np.array([True, False])}},
    ]
    for wrong_call in calls:
        with pytest.raises(ConfigError):
            vector.reset(**wrong_call)
    with pytest.raises(EpisodeError, match="draws no pictures"):
        vector.render()


def test_a_vector_environment_that_has_not_begun_or_is_closed_says_so() -> None:
    env = rcare_marl.make_vector("toileting", num_envs=1, engine="bullet")
    with pytest.raises(EpisodeError, match="call reset"):
        env.step(actions(env, 0))
    env.close()
    with pytest.raises(EpisodeError, match="closed"):
        env.reset()
    with pytest.raises(ConfigError, match="one role must be left to learn"):
        CareVectorEnv(EnvRecipe("feeding", learners=("robot", "recipient")))
