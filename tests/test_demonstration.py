"""Demonstrations: what was done, and what was meant."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from rcare_marl.baselines.training.config import Demonstrations
from rcare_marl.baselines.training.demonstration import demonstrate
from rcare_marl.envs.learning import EnvRecipe, LearnerEnv
from rcare_marl.errors import ConfigError


@pytest.fixture(scope="module")
def env() -> Iterator[LearnerEnv]:
    env = LearnerEnv(EnvRecipe("toileting", options={"reward": "paper"}, residual={"robot": 0.2}))
    yield env
    env.close()


def test_noise_is_done_and_not_meant(env: LearnerEnv) -> None:
    shown = demonstrate(env, Demonstrations(episodes=1, noise=0.2))
    done, meant = shown["robots", "action"], shown["robots", "meant"]
    assert torch.equal(meant, torch.zeros_like(meant))  # a residual demonstrates no correction
    assert 0.1 < done.std() < 0.3
    assert bool(shown["next", "done"][-1]) and bool(shown["next", "terminated"][-1])


def test_without_noise_what_is_done_is_what_was_meant(env: LearnerEnv) -> None:
    shown = demonstrate(env, Demonstrations(episodes=1, noise=0.0))
    assert torch.equal(shown["robots", "action"], shown["robots", "meant"])


def test_the_same_seed_shows_the_same(env: LearnerEnv) -> None:
    wanted = Demonstrations(episodes=1, noise=0.2)
    first, again, other = (demonstrate(env, wanted, seed) for seed in (3, 3, 4))
    assert torch.equal(first["robots", "action"], again["robots", "action"])
    assert not torch.equal(first["robots", "action"][:5], other["robots", "action"][:5])


def test_too_few_successes_are_told() -> None:
    env = LearnerEnv(EnvRecipe("toileting", options={"reward": "paper"}))
    with pytest.raises(ConfigError, match="of 2 demonstrated episodes of 'toileting' succeeded"):
        demonstrate(env, Demonstrations(episodes=2, noise=20.0, attempts=1))
    env.close()
