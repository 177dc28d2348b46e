"""The promise that a training loses nothing but time when it is killed."""

from __future__ import annotations

import csv
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from rcare_marl.baselines.training.checkpoint import LAST, load
from rcare_marl.baselines.training.log import CURVE

KILLS = 10
INTERVALS, INTERVAL = 14, 160  # more intervals than kills: between two kills there is hardly one
SETTINGS: dict[str, Any] = {
    "task": "toileting",
    "algo": "sac",
    "algorithm": {"hidden": [32, 32], "batch_size": 32, "warm_up": 200, "update_to_data": 0.25},
    "options": {"reward": "shaped"},
    "demonstrations": {"episodes": 1, "noise": 0.05},
    "curriculum": {"stages": [{"spread": 0.5, "tolerance": 2.0}], "episodes": 5},
    "seed": 4,
    "steps": INTERVALS * INTERVAL,
    "interval": INTERVAL,
    "envs": 2,
    "workers": 0,
    "evaluation_episodes": 1,
}
ALIKE = (
    "step",
    "eval_success",
    "eval_return",
    "stage",
)  # the others tell of time, or of one sitting


def begin(config: Path, folder: Path) -> subprocess.Popen[bytes]:
    command = [
        sys.executable,
        "-c",
        "from rcare_marl.cli import main; main()",
        "train",
        "toileting",
    ]
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


@pytest.mark.slow
def test_a_training_that_is_killed_ten_times_learns_the_same(tmp_path: Path) -> None:
    config = tmp_path / "tiny.yaml"
    config.write_text(yaml.safe_dump(SETTINGS))
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
        while log.read_text().count("toileting, sac, seed 4") == number:  # it is not at work yet
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
    assert len(curves[0]) == 1 + INTERVALS  # before the first there is what copying came to
    with np.load(whole / "policy.npz") as first, np.load(killed / "policy.npz") as second:
        arrays = [name for name in first.files if first[name].dtype.kind == "f"]
        assert arrays and all(np.array_equal(first[name], second[name]) for name in arrays)
