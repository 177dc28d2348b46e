"""The promise that a training loses nothing but time when it is killed, or when the disk is full."""

from __future__ import annotations

import csv
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from rcare_marl.baselines.algorithms import algorithm_names
from rcare_marl.baselines.training.checkpoint import LAST, load
from rcare_marl.baselines.training.config import load_config
from rcare_marl.baselines.training.log import CURVE
from rcare_marl.baselines.training.trainer import Trainer
from rcare_marl.errors import ConfigError

PAGE = 4096  # [bytes]
KILLS = 15  # of each algorithm: with seven of them 105
INTERVALS, INTERVAL = 20, 160  # more intervals than kills: between two kills there is hardly one
SETTINGS: dict[str, Any] = {
    "task": "toileting",
    "options": {"reward": "shaped"},
    "curriculum": {"stages": [{"spread": 0.5, "tolerance": 2.0}], "episodes": 5},
    "seed": 4,
    "steps": INTERVALS * INTERVAL,
    "interval": INTERVAL,
    "envs": 2,
    "workers": 0,
    "evaluation_episodes": 1,
}
SMALL = {"hidden": [32, 32], "batch_size": 32, "warm_up": 200, "update_to_data": 0.25}
ON_POLICY = {"hidden": [32, 32], "rollout": 40, "epochs": 2, "minibatch": 40}
SHOWN = {"demonstrations": {"episodes": 1, "noise": 0.05}, "algorithm": SMALL}
BOTH = {"task": "feeding", "learners": ["robot", "recipient"], "curriculum": {}}
ALGORITHMS: dict[str, dict[str, Any]] = {  # what of the settings is another one
    "sac": SHOWN,
    "tqc": SHOWN,
    "masac": {**BOTH, "algorithm": SMALL},
    "ppo": {"algorithm": ON_POLICY},
    "ippo": {**BOTH, "algorithm": ON_POLICY},
    "mappo": {**BOTH, "algorithm": ON_POLICY},
    "dagger": {"algorithm": {**SMALL, "rollout": 8, "handover": 800}},
}
ALIKE = (
    "step",
    "eval_success",
    "eval_return",
    "stage",
)  # the others tell of time, or of one sitting


def settings(algo: str) -> dict[str, Any]:
    return {**SETTINGS, "algo": algo, **ALGORITHMS[algo]}


def begin(config: Path, folder: Path) -> subprocess.Popen[bytes]:
    task = yaml.safe_load(config.read_text())["task"]
    command = [sys.executable, "-c", "from rcare_marl.cli import main; main()", "train", task]
    options = ["--config", str(config), "--out", str(folder)]
    with folder.with_suffix(".log").open("ab") as log:
        return subprocess.Popen([*command, *options], stderr=log, stdout=log)


def steps_of(folder: Path) -> int:
    """Return the step of the last row of the curve, 0 if there is none."""
    file = folder / CURVE
    rows = file.read_text().splitlines()[1:] if file.is_file() else []
    return int(rows[-1].split(",")[0]) if rows else 0


def assert_alike(one: Any, other: Any, where: str = "") -> None:
    if isinstance(one, dict):
        assert one.keys() == other.keys(), where
        for key in one:
            assert_alike(one[key], other[key], f"{where}.{key}")
    elif isinstance(one, list | tuple):
        assert len(one) == len(other), where
        for i, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_alike(a, b, f"{where}[{i}]")
    elif isinstance(one, torch.Tensor):
        assert torch.equal(torch.nan_to_num(one), torch.nan_to_num(other)), where
    elif isinstance(one, np.ndarray):
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f"), where
    else:
        assert one == other, where


def test_every_algorithm_is_killed() -> None:
    assert set(ALGORITHMS) == set(algorithm_names()) and KILLS * len(ALGORITHMS) >= 100


@pytest.mark.slow
@pytest.mark.parametrize("algo", ALGORITHMS)
def test_a_training_that_is_killed_again_and_again_learns_the_same(
    algo: str, tmp_path: Path
) -> None:
    config = tmp_path / "tiny.yaml"
    config.write_text(yaml.safe_dump(settings(algo)))
    whole, killed = tmp_path / "whole", tmp_path / "killed"

    run = begin(config, whole)
    while steps_of(whole) < INTERVAL:
        assert run.poll() is None, whole.with_suffix(".log").read_text()
        time.sleep(0.05)
    begun = time.monotonic()
    assert run.wait() == 0, whole.with_suffix(".log").read_text()
    interval = (time.monotonic() - begun) / (INTERVALS - 1)  # [s]

    rng, reached = random.Random(7), []
    log = killed.with_suffix(".log")
    for number in range(KILLS):
        run = begin(config, killed)
        while log.read_text().count(f", {algo}, seed 4") == number:  # it is not at work yet
            assert run.poll() is None, log.read_text()
            time.sleep(0.01)
        before, end = steps_of(killed), time.monotonic() + rng.uniform(0.0, 1.5 * interval)
        if number % 2:  # every other one gets as far as a checkpoint, however busy the machine is
            end = time.monotonic() + 600.0
        while time.monotonic() < end and steps_of(killed) == before:
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.2 * interval))
        os.kill(run.pid, signal.SIGKILL)
        assert run.wait() == -signal.SIGKILL, "it ended before it was killed"
        reached.append(steps_of(killed))
    assert 0 < reached[-1] < SETTINGS["steps"] and len(set(reached)) > 3
    assert begin(config, killed).wait() == 0, killed.with_suffix(".log").read_text()

    one, other = load(whole / LAST), load(killed / LAST)
    for part in ("algorithm", "env", "curriculum", "rng"):
        assert_alike(one[part], other[part], part)
    curves = []
    for folder in (whole, killed):
        with (folder / CURVE).open(newline="") as file:
            curves.append([{name: row[name] for name in ALIKE} for row in csv.DictReader(file)])
    assert curves[0] == curves[1]
    assert len(curves[0]) == INTERVALS
    policies = sorted(file.name for file in whole.glob("policy*.npz"))
    assert len(policies) in (2, 4) and "policy" in policies[0]
    for name in policies:
        assert_equal_weights(whole / name, killed / name)


def assert_equal_weights(one: Path, other: Path) -> None:
    with np.load(one) as first, np.load(other) as second:
        arrays = [name for name in first.files if first[name].dtype.kind == "f"]
        assert arrays and all(np.array_equal(first[name], second[name]) for name in arrays)


@contextmanager
def small_disk(folder: Path) -> Iterator[Callable[[int], None]]:
    """Give a disk at a folder, and what sets its size [bytes]; skip where it cannot be had."""
    folder.mkdir()
    size = "size=64k"
    if os.geteuid() or subprocess.call(["mount", "-t", "tmpfs", "-o", size, "rcare", folder]):
        pytest.skip("a disk of a small size needs Linux, and to be root")

    def resize(size: int) -> None:
        subprocess.check_call(["mount", "-o", f"remount,size={size}", folder])

    try:
        yield resize
    finally:
        subprocess.check_call(["umount", folder])


@pytest.mark.slow
def test_a_full_disk_at_each_write_keeps_the_last_checkpoint(tmp_path: Path) -> None:
    few = {**settings("sac"), "steps": 3 * INTERVAL}
    config = load_config(few)
    Trainer(config, tmp_path / "whole").run()
    refused, reached = 0, 0
    with small_disk(tmp_path / "disk") as resize:
        folder = tmp_path / "disk" / "run"
        for size in range(PAGE, 800 * PAGE, 5 * PAGE):  # so that each write is the one too many
            resize(size)
            before = steps_in(folder)
            try:
                Trainer(config, folder).run()
            except ConfigError as error:
                assert "No space left on device" in str(error), error
                refused += 1
            else:
                break
            assert steps_in(folder) >= before, "a checkpoint was lost"
            reached += steps_in(folder) > before
        assert refused > 20 and reached >= 1
        one, other = load(tmp_path / "whole" / LAST), load(folder / LAST)
        for part in ("algorithm", "env", "curriculum"):  # the rest is drawn from by imports, too
            assert_alike(one[part], other[part], part)
        assert_equal_weights(tmp_path / "whole" / "policy.npz", folder / "policy.npz")


def steps_in(folder: Path) -> int:
    """Return the step of the checkpoint, 0 if there is none; it can always be read."""
    return load(folder / LAST)["progress"]["steps"] if (folder / LAST).is_file() else 0
