"""A care task trains in BenchMARL, where that is installed: it needs an environment of its own."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

EXPERIMENTS = Path(__file__).resolve().parents[1] / "experiments"
SMALL = {
    "on_policy_collected_frames_per_batch": 60,
    "on_policy_minibatch_size": 30,
    "on_policy_n_minibatch_iters": 2,
    "off_policy_collected_frames_per_batch": 60,
    "off_policy_n_optimizer_steps": 2,
    "off_policy_train_batch_size": 32,
    "off_policy_memory_size": 1000,
    "off_policy_init_random_frames": 0,
}


@pytest.mark.parametrize("algorithm", ["mappo", "ippo", "masac", "maddpg"])
def test_benchmarl_trains_on_a_care_task(
    algorithm: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("benchmarl", exc_type=ImportError)
    monkeypatch.syspath_prepend(str(EXPERIMENTS))  # BenchMARL pickles the task by its module's name
    experiment = importlib.import_module("benchmarl_task").make_experiment(
        "feeding", algorithm, 120, tmp_path, **SMALL
    )
    assert experiment.group_map == {"robots": ["robot"], "recipients": ["recipient"]}
    experiment.run()
    assert experiment.total_frames == 120
