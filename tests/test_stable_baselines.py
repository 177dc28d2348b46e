"""The Gymnasium form trains with Stable-Baselines3 as it is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from rcare_marl.envs.gym import SingleAgentEnv

stable_baselines3 = pytest.importorskip("stable_baselines3")


@pytest.fixture(scope="module")
def env() -> Iterator[SingleAgentEnv]:
    env = SingleAgentEnv("feeding", options={"reward": "shaped"})
    yield env
    env.close()


def test_stable_baselines_finds_nothing_wrong(
    env: SingleAgentEnv, recwarn: pytest.WarningsRecorder
) -> None:
    from stable_baselines3.common.env_checker import check_env

    check_env(env, warn=True)
    assert [str(w.message) for w in recwarn if w.category is UserWarning] == []


@pytest.mark.slow
def test_sac_learns_from_it(env: SingleAgentEnv) -> None:
    torch.manual_seed(0)
    model = stable_baselines3.SAC(
        "MlpPolicy", env, seed=0, learning_starts=100, policy_kwargs={"net_arch": [32, 32]}
    )
    before = {name: value.clone() for name, value in model.actor.state_dict().items()}
    model.learn(200)
    after = model.actor.state_dict()
    assert all(torch.isfinite(value).all() for value in after.values())
    assert any(not torch.equal(before[name], value) for name, value in after.items())
    assert model.replay_buffer.size() == 200
    assert np.isfinite(model.replay_buffer.rewards[:200]).all()
    assert (model.replay_buffer.rewards[:200] != 0).any()


def test_a_trained_model_acts_within_the_action_space(env: SingleAgentEnv) -> None:
    model = stable_baselines3.SAC("MlpPolicy", env, seed=0, policy_kwargs={"net_arch": [32, 32]})
    observation, _ = env.reset(seed=0)
    action, _ = model.predict(observation, deterministic=True)
    assert env.action_space.contains(action)
    assert env.step(action)[0] in env.observation_space
