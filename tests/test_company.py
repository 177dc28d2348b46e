"""Populations in an environment: another person in each episode, told by name, the same for the same seed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rcare_marl
from rcare_marl.agents.people.sampling.population import find_avatar, person_hash, population_hash
from rcare_marl.baselines.evaluation.evaluate import evaluate, lead_policies
from rcare_marl.envs import company
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.episode import EpisodeRecorder, RecordedEpisode, replay
from rcare_marl.errors import ConfigError, UnknownNameError

SCRIPTS = {"robot": "scripted", "recipient": "cooperative"}


@pytest.fixture(scope="module")
def six() -> Iterator[CareEnv]:
    env = rcare_marl.make("feeding", recipient="six", policies=SCRIPTS)
    yield env
    env.close()


def played(env: CareEnv, seed: int) -> list[np.ndarray[Any, Any]]:
    env.reset(seed=seed)
    out = [env.state()]
    while not env.is_over:
        env.step({})
        out.append(env.state())
    return out


@pytest.mark.slow
def test_the_same_seed_is_the_same_episode_of_the_same_person(six: CareEnv) -> None:
    first, name = played(six, 1), six.cast["recipient"].describe()["avatar"]
    other = played(six, 2)
    assert six.cast["recipient"].describe()["avatar"] != name
    np.testing.assert_array_equal(first, played(six, 1))
    with np.testing.assert_raises(AssertionError):
        np.testing.assert_array_equal(first[0], other[0])
    alone = rcare_marl.make("feeding", recipient="jose", policies=SCRIPTS)
    np.testing.assert_array_equal(first, played(alone, 1))
    alone.close()


def test_six_seeds_in_a_row_meet_everybody(six: CareEnv) -> None:
    met = []
    for seed in range(6, 12):
        six.reset(seed=seed)
        met.append(six.company.playing["recipient"])  # type: ignore[union-attr]
    assert met == ["morgan", "jose", "natalia", "daniel", "kim", "karan"]


def test_a_recorded_episode_names_its_person(six: CareEnv, tmp_path: Path) -> None:
    recorder = EpisodeRecorder(six)
    played(six, 4)
    recorder.episode().save(tmp_path / "episode.npz")
    six.watchers.clear()
    episode = RecordedEpisode.read(tmp_path / "episode.npz")
    assert episode.header.setup["cast"]["recipient"]["model"] == "kim"
    assert replay(episode).difference == ""


def test_infos_tell_who_it_is_and_a_stage_outlives_the_person() -> None:
    env = rcare_marl.make("feeding", recipient="population:test:3-4")
    infos = [env.reset(seed=seed)[1]["robot"]["recipient_person"] for seed in (0, 1)]
    assert infos == [0.0, 1.0]
    env.task.set_stage(force=2.0)
    wanted = 2 * env.task.force_limit
    env.reset(seed=0)
    assert env.task.force_limit == wanted
    env.reset(seed=1)
    assert env.task.force_limit == wanted
    env.close()


def test_evaluations_tell_who_played_and_of_which_version() -> None:
    policies, who = lead_policies("feeding", "scripted"), "population:test:5-6"
    found = evaluate("feeding", policies, episodes=2, seed=0, cast={"recipient": who})
    assert found.cast["recipient"] == who
    names = [episode.people["recipient"] for episode in found.episodes]
    assert names == ["population:test:5", "population:test:6"]
    assert found.people == {name: person_hash(find_avatar(name)) for name in names}
    assert found.versions["population test"] == population_hash("test")
    alone = evaluate("feeding", policies, episodes=1, seed=1, cast={"recipient": names[1]})
    assert alone.episodes[0].metrics == found.episodes[1].metrics


def test_who_cannot_be_cast_is_passed_over_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(self: CareEnv) -> str | None:
        return "no room" if self.company.playing["recipient"] != "daniel" else None  # type: ignore[union-attr]

    monkeypatch.setattr(CareEnv, "_overlap", refused)
    env = rcare_marl.make("bathing", recipient="six")
    assert env.company is not None and env.company.playing == {"recipient": "daniel"}
    assert env.company.refused == dict.fromkeys(("morgan", "jose", "natalia"), "no room")
    env.reset(seed=4)
    assert env.company.playing == {"recipient": "daniel"}
    env.close()
    monkeypatch.setattr(company, "TRIES", 3)
    with pytest.raises(ConfigError, match="cannot cast natalia, nor those before: no room"):
        rcare_marl.make("bathing", recipient="six")


def test_who_has_no_clear_start_is_passed_over_in_that_episode(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    env = rcare_marl.make("bathing", recipient="six")
    env.reset(seed=2)
    free, found = env.company.playing["recipient"], CareEnv._find_start  # type: ignore[union-attr]

    def none(self: CareEnv) -> object:
        crowded = self.company.playing["recipient"] == free and self.seed == 2  # type: ignore[union-attr]
        return "no start is clear" if crowded else found(self)

    monkeypatch.setattr(CareEnv, "_find_start", none)
    met = []
    for seed in (2, 3, 8, 2):
        env.reset(seed=seed)
        met.append(env.company.playing["recipient"])  # type: ignore[union-attr]
    assert met == [met[1], met[1], free, met[1]]
    assert met[1] != free and not env.company.refused  # type: ignore[union-attr]


def test_who_observes_otherwise_is_refused_by_name(
    six: CareEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = rcare_marl.make("bathing", recipient="six")
    monkeypatch.setattr(CareEnv, "_table", lambda self: {"recipient": self.company.playing})
    with pytest.raises(ConfigError, match=r"jose.* cannot take turns .*: recipient observes"):
        env.reset(seed=1)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("population:tets", "Did you mean 'test'"),
        ("population:test:7-3", "several as population:test:0-9"),
        ("population:six:4-6", "one from 0 to 5"),
    ],
)
def test_bad_names_of_several_are_refused(name: str, said: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=said):
        rcare_marl.make("feeding", recipient=name)


def test_batches_take_a_population() -> None:
    batch = rcare_marl.make_vector(
        "bathing", num_envs=2, engine="bullet", recipient="population:train:0-3"
    )
    first, _ = batch.reset(seed=1)
    again, _ = batch.reset(seed=1)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[0], first[1])
    batch.close()
