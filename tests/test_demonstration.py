"""Demonstrations: what was done, and what was meant."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from rcare_marl.baselines.teleoperation.stage import Hand, Scenario, Stage
from rcare_marl.baselines.training.config import Demonstrations
from rcare_marl.baselines.training.demonstration import demonstrate
from rcare_marl.envs.datasets import record
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


FEEDING = EnvRecipe("feeding")
ENDINGS = ("a.hdf5", "a.mcap", "a-v0", "a")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A place with one demonstrated episode in each format."""
    place = tmp_path_factory.mktemp("recorded")
    env = LearnerEnv(FEEDING)
    for name in ENDINGS:
        with record(env.care_env, place / name):
            demonstrate(env, Demonstrations(episodes=1))
    env.close()
    return place


@pytest.mark.parametrize("name", ENDINGS)
def test_what_was_recorded_teaches_what_was_played(name: str, recorded: Path) -> None:
    pytest.importorskip("minari")
    env = LearnerEnv(FEEDING)
    played = demonstrate(env, Demonstrations(episodes=1))
    read = demonstrate(env, Demonstrations(path=str(recorded / name)))
    assert set(read.keys(True, True)) == set(played.keys(True, True))
    for key in played.keys(True, True):
        assert torch.equal(read[key], played[key]), key
    env.close()


@pytest.mark.parametrize(
    ("recipe", "text"),
    [
        (EnvRecipe("toileting"), "of the task 'feeding', and not 'toileting'"),
        (EnvRecipe("feeding", cast={"robot": "ur5"}), "'robot' was .*, and is"),
        (
            EnvRecipe("feeding", cast={"recipient": {"physiology_observed": True}}),
            "'recipient' observes",
        ),
        (EnvRecipe("feeding", options={"reward": "shaped"}), "its option reward was 'paper'"),
        (EnvRecipe("feeding", residual={"robot": 0.2}), "residual"),
    ],
)
def test_what_does_not_fit_is_named(recipe: EnvRecipe, text: str, recorded: Path) -> None:
    env = LearnerEnv(recipe)
    with pytest.raises(ConfigError, match=text):
        demonstrate(env, Demonstrations(path=str(recorded / "a.hdf5")))
    env.close()


def test_a_hand_of_another_role_teaches_that_role(tmp_path: Path) -> None:
    stage = Stage(Scenario("feeding", ["recipient"], record=tmp_path / "mouth.mcap"))
    values = tuple(float("jaw" in name) for name in stage.facts("recipient")["acts"])
    while not stage.is_over:
        stage.step({"recipient": Hand(0, True, values)})
    stage.close()
    env = LearnerEnv(EnvRecipe("feeding", learners=("recipient",)))
    shown = demonstrate(env, Demonstrations(path=str(tmp_path / "mouth.mcap")))
    assert torch.equal(shown["recipients", "action"][0, 0], torch.tensor(values))
    env.close()
