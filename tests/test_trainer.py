"""The trainer: it teaches, it stops when asked, and it goes on as if it had not stopped."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from test_training_kills import assert_alike

import rcare_marl
from rcare_marl.baselines.algorithms.sac import Sac
from rcare_marl.baselines.policy_file import PolicyFile
from rcare_marl.baselines.training.checkpoint import BEST, LAST, load
from rcare_marl.baselines.training.config import load_config
from rcare_marl.baselines.training.log import CURVE
from rcare_marl.baselines.training.trainer import Trainer, TrainResult
from rcare_marl.envs.learning import station
from rcare_marl.errors import ConfigError

TINY: dict[str, Any] = {
    "task": "toileting",
    "algo": "sac",
    "algorithm": {
        "hidden": [64, 64],
        "batch_size": 64,
        "actor_lr": 1e-3,
        "behaviour_cloning": {"updates": 800, "weight": 4.0},
    },
    "options": {"reward": "shaped"},
    "demonstrations": {"episodes": 8, "noise": 0.05},
    "steps": 100,
    "interval": 100,
    "envs": 2,
    "evaluation_episodes": 6,
}
SHORT = TINY | {
    "algorithm": {"hidden": [16], "batch_size": 16, "warm_up": 20},
    "demonstrations": {"episodes": 0},
    "steps": 120,
    "interval": 40,
    "evaluation_episodes": 1,
}


def changed(settings: dict[str, Any], **values: Any) -> dict[str, Any]:
    """Return settings with other values of the algorithm."""
    return settings | {"algorithm": settings["algorithm"] | values}


def trained(settings: dict[str, Any], folder: Path, *, is_stopped: bool = False) -> TrainResult:
    """Train until the end, or until the next interval."""
    trainer = Trainer(load_config(settings), folder)
    trainer.stop_requested = is_stopped
    return trainer.run()


def curve(folder: Path) -> list[dict[str, str]]:
    with (folder / CURVE).open(newline="") as file:
        return list(csv.DictReader(file))


def assert_same_training(one: Path, other: Path) -> None:
    """Check all that is learned, and what of the progress is not wall time."""
    first, second = load(one / LAST), load(other / LAST)
    for saved in (first, second):
        del saved["progress"]["seconds"]
    assert_alike(first, second)
    for name in ("step", "eval_success", "eval_return", "stage"):
        assert [row[name] for row in curve(one)] == [row[name] for row in curve(other)]


@pytest.mark.slow
def test_a_learner_comes_far_and_one_that_cannot_move_does_not(tmp_path: Path) -> None:
    """Over seeds 0 to 5 the first has success 0.5 to 0.83 and a return of 84 to 143; the other, whose
    actor stays as random as it began, 0 and 9 to 14."""
    trained(TINY, tmp_path / "learner")
    still = {
        "evaluation_episodes": 3,
        "demonstrations": {"episodes": 1},
    }  # each lasts to the limit of time
    stuck = changed(TINY, actor_lr=1e-12, behaviour_cloning={"updates": 8})
    trained(stuck | still, tmp_path / "stuck")
    *_, learner = curve(tmp_path / "learner")
    *_, other = curve(tmp_path / "stuck")
    assert float(learner["eval_success"]) >= 0.3 > 0.1 >= float(other["eval_success"])
    assert float(learner["eval_return"]) > 50 > 30 > float(other["eval_return"])


def test_a_training_of_another_config_is_refused_by_the_names_that_differ(tmp_path: Path) -> None:
    trained(SHORT, tmp_path, is_stopped=True)
    for other, said in (
        (changed(SHORT, gamma=0.5), r"algorithm\.gamma is not set .* and 0\.5 in the config"),
        (SHORT | {"envs": 4}, r"envs is 2 in the checkpoint and 4 in the config"),
        (SHORT | {"seed": 1}, r"seed is 0 in the checkpoint and 1 in the config"),
    ):
        with pytest.raises(ConfigError, match=said):
            trained(other, tmp_path)
    with pytest.raises(ConfigError, match="holds a training already"):
        Trainer(load_config(SHORT), tmp_path, resume="never")


@pytest.mark.slow
def test_a_training_stops_when_asked_and_goes_on_as_if_it_had_not(tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert trained(SHORT, whole).finished
    sittings = [trained(SHORT, parts, is_stopped=True) for _ in range(3)]
    assert [sitting.steps for sitting in sittings] == [40, 80, 120]
    assert [sitting.finished for sitting in sittings] == [False, False, True]
    assert_same_training(whole, parts)
    assert any(
        load(parts / LAST)["progress"]["sums"].values()
    )  # returns of episodes that still run


def test_a_learner_has_the_threads_that_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, seen, learn = torch.get_num_threads(), set[int](), Sac.learn

    def watched(self: Sac, batch: Any) -> dict[str, float]:
        seen.add(torch.get_num_threads())
        return learn(self, batch)

    monkeypatch.setattr(Sac, "learn", watched)
    try:
        trained(SHORT | {"steps": 40, "threads": 2}, tmp_path)
    finally:
        torch.set_num_threads(before)
    assert seen == {2}
    with pytest.raises(ConfigError, match="threads must be at least 1, got 0"):
        load_config(SHORT | {"threads": 0})


def test_a_training_on_mujoco_says_so_in_its_policy(tmp_path: Path) -> None:
    result = trained(SHORT | {"engine": "mujoco", "steps": 40}, tmp_path)
    file = PolicyFile.read(result.policies["robots"])
    assert file.recipe["engine"] == "mujoco" and "mujoco" in file.training["versions"]
    robot = result.policies["robots"]
    env = rcare_marl.make("toileting", policies={"robot": robot})
    env.reset(seed=0)  # in Bullet
    env.step({})
    env.close()


@pytest.mark.slow
def test_a_correction_of_a_script_is_evaluated_with_another_person_in_each_episode(
    tmp_path: Path,
) -> None:
    people = {"recipient": "population:train:0-1"}
    given = {"task": "bathing", "cast": people, "residual": {"robot": 0.1}, "options": {}}
    run = SHORT | given | {"envs": 1, "steps": 20, "interval": 20, "evaluation_episodes": 2}
    assert trained(run, tmp_path).success >= 0.5


def test_the_best_checkpoint_is_that_of_the_kept_policy(tmp_path: Path) -> None:
    trained(SHORT, tmp_path)
    rows = [(float(r["eval_success"]), float(r["eval_return"])) for r in curve(tmp_path)]
    at = max(range(len(rows)), key=lambda i: (rows[i], i))  # of equals the last
    assert load(tmp_path / BEST)["progress"]["steps"] == (at + 1) * SHORT["interval"]
    with np.load(tmp_path / "policy.npz") as kept, np.load(tmp_path / "policy_last.npz") as last:
        alike = [np.array_equal(kept[n], last[n]) for n in kept.files if kept[n].dtype.kind == "f"]
    assert all(alike) == (at == len(rows) - 1)


@pytest.mark.slow
def test_a_feeding_that_is_stopped_at_each_interval_learns_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Food that is eaten leaves a trace in the scene: of the episodes after it one in eight or so differs
    from the same episode in a new scene, by 1e-8 and less."""
    monkeypatch.setattr(station, "RENEWAL", 150)  # so that scenes are made anew a few times, too
    settings = changed(SHORT, update_to_data=0.25, warm_up_scale=0.5, last_layer_scale=0.01)
    settings |= {
        "task": "feeding",
        "options": {},
        "residual": {"robot": 0.2},  # on top of the scripted robot: it feeds from the start
        "steps": 900,
        "interval": 150,
    }
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert trained(settings, whole).finished
    assert sum(load(whole / LAST)["progress"]["successes"]) >= 10, "hardly anything was eaten"
    while not trained(settings, parts, is_stopped=True).finished:
        pass
    assert len(curve(parts)) == 6
    assert_same_training(whole, parts)
