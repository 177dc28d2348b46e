"""Promises of the logs of a training, and of what is shown of it."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from rcare_marl.baselines.training.config import load_config
from rcare_marl.baselines.training.log import CURVE, TrainingLog
from rcare_marl.baselines.training.trainer import Trainer
from rcare_marl.cli.training import TrainingReport, duration
from rcare_marl.errors import ConfigError, MissingPackageError


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / CURVE).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_each_report_is_a_row_with_the_step_first(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path)
    log.write(100, {"return": 1.5, "success": 0.0})
    log.write(200, {"return": 2.25, "success": 1.0})
    assert (tmp_path / CURVE).read_text().splitlines() == [
        "step,return,success",
        "100,1.5,0",
        "200,2.25,1",
    ]


def test_a_metric_that_comes_late_gets_a_column(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path)
    log.write(1, {"success": 0.5})
    log.write(2, {"loss": 3.0, "success": 0.5})
    log.write(3, {"loss": 2.0})
    found = rows(tmp_path)
    assert [row["loss"] for row in found] == ["", "3", "2"]
    assert [row["success"] for row in found] == ["0.5", "0.5", ""]


def test_a_resumed_curve_has_no_step_twice(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path)
    for step in (100, 200, 300, 400):
        log.write(step, {"return": float(step)})
    log = TrainingLog(tmp_path, at_step=200)
    assert [row["step"] for row in rows(tmp_path)] == ["100", "200"]
    log.write(300, {"return": -1.0})
    assert [(row["step"], row["return"]) for row in rows(tmp_path)] == [
        ("100", "100"),
        ("200", "200"),
        ("300", "-1"),
    ]


def test_half_a_row_of_a_killed_run_is_cut_off(tmp_path: Path) -> None:
    TrainingLog(tmp_path).write(100, {"return": 1.0, "success": 0.5})
    with (tmp_path / CURVE).open("a") as file:
        file.write("200,3")
    TrainingLog(tmp_path, at_step=300)
    assert [row["step"] for row in rows(tmp_path)] == ["100"]


def test_a_new_run_begins_a_new_curve(tmp_path: Path) -> None:
    TrainingLog(tmp_path).write(100, {"return": 1.0})
    TrainingLog(tmp_path)
    assert rows(tmp_path) == []


def test_a_file_that_is_no_curve_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / CURVE).write_text("name,height\nkim,1.7\n")
    with pytest.raises(ConfigError, match="no log of a training"):
        TrainingLog(tmp_path, at_step=10)
    assert "kim" in (tmp_path / CURVE).read_text()


def test_tensorboard_shows_a_resumed_curve_once(tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    log = TrainingLog(tmp_path)
    for step in (100, 200, 300):
        log.write(step, {"return": float(step), "eval_success": 0.5, "steps_per_second": 9.0})
    del log  # killed
    log = TrainingLog(tmp_path, at_step=200)
    log.write(300, {"return": -1.0})
    log.close()
    found: Any = EventAccumulator(str(tmp_path))
    found.Reload()
    assert {"train/return", "evaluation/eval_success", "speed/steps_per_second"} <= set(
        found.Tags()["scalars"]
    )
    points = [(each.step, each.value) for each in found.Scalars("train/return")]
    assert points == [(100, 100.0), (200, 200.0), (300, -1.0)]


def test_a_closed_log_takes_nothing_more(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path)
    log.close()
    with pytest.raises(ConfigError, match="closed"):
        log.write(1, {"return": 1.0})


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


CONFIG: Any = SimpleNamespace(task="toileting", algo="sac", seed=3)


def shown(*, is_terminal: bool) -> str:
    """Return what is shown of a training of 1,000 steps that takes 100 s."""
    clock, stream = Clock(), io.StringIO()
    screen = Console(file=stream, force_terminal=is_terminal, width=100, highlight=False)
    report = TrainingReport(screen=screen, clock=clock)
    report.start(CONFIG, 1000, 0)
    for step in range(10, 510, 10):
        clock.now += 1.0
        metrics = {"return": 2.0, "success": 0.25}
        if step == 400:
            metrics |= {"eval_success": 0.75, "eval_return": 12.5}
        report.report(step, metrics)
    report.close()
    report.close()
    return stream.getvalue()


def test_without_a_terminal_there_is_a_line_every_half_minute() -> None:
    lines = shown(is_terminal=False).splitlines()
    assert lines == [
        "toileting, sac, seed 3: 1,000 steps",
        "300/1,000, 1:10 left, 10 steps/s, return 2, success 25 %",
        "400 steps: evaluation 75 % success, return 12.5",
        "500/1,000, 0:50 left, 10 steps/s, return 2, success 25 %",
    ]


def test_on_a_terminal_there_is_a_bar() -> None:
    text = shown(is_terminal=True)
    assert "━" in text and "steps/s" in text and "left" in text and "evaluation 75 %" in text


def test_the_pace_is_that_of_late() -> None:
    clock, stream = Clock(), io.StringIO()
    report = TrainingReport(screen=Console(file=stream, width=100), clock=clock)
    report.start(CONFIG, 1000, 0)
    report.report(0, {})
    for _ in range(100):
        clock.now += 1.0
        report.report(round(clock.now), {})
    for _ in range(40):
        clock.now += 1.0
        report.report(100 + round(5 * (clock.now - 100)), {})
    report.close()
    first, *_, last = stream.getvalue().splitlines()[1:]
    assert ", 1 steps/s" in first and "300/1,000, 2:20 left, 5 steps/s" in last


@pytest.mark.parametrize(
    ("seconds", "text"), [(0, "0:00"), (59.6, "1:00"), (249, "4:09"), (3920, "1:05:20")]
)
def test_times_are_read_as_on_a_clock(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_what_is_done_before_the_first_interval_is_said() -> None:
    stream = io.StringIO()
    report = TrainingReport(screen=Console(file=stream, width=100))
    report.tell("playing 20 demonstrations")
    assert stream.getvalue() == "playing 20 demonstrations\n"


@pytest.mark.parametrize(
    "changes, package", [({"workers": "ray://local:2"}, "ray"), ({"engine": "mujoco"}, "mujoco")]
)
def test_a_missing_package_is_told_before_any_work(
    changes: dict[str, Any], package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rcare_marl.errors.find_spec", lambda name: None)
    config = load_config({"task": "feeding", **changes})
    with pytest.raises(MissingPackageError, match="rcare-marl") as told:
        Trainer(config, tmp_path / "run")
    assert package in str(told.value) or "batch" in str(told.value)
    assert not list(tmp_path.iterdir())
