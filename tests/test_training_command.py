"""Promises of the command `train`: what it takes, what it refuses, how it stops and goes on."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from rcare_marl.baselines.training import trainer as training
from rcare_marl.baselines.training.checkpoint import LAST, load, save
from rcare_marl.baselines.training.config import TrainConfig, load_config
from rcare_marl.cli import app
from rcare_marl.cli.training import changed
from rcare_marl.errors import ConfigError


def call(*arguments: object, code: int = 0) -> Any:
    result = CliRunner().invoke(app, ["train", *map(str, arguments)])
    assert result.exit_code == code, result.output
    return result


def refusal(*arguments: object) -> str:
    """Return what is said on standard error, on one line."""
    return " ".join(str(call(*arguments, code=2).stderr).split())


@pytest.fixture
def config(tmp_path: Path) -> Path:
    file = tmp_path / "tiny.yaml"
    file.write_text(yaml.safe_dump({"task": "toileting", "steps": 400, "envs": 2}))
    return file


class Recorder:
    """Stands in for `Trainer`, which takes minutes; keeps what it is given and leaves what it leaves."""

    made: list[Recorder] = []
    signals: tuple[int, ...] = ()

    def __init__(self, config: TrainConfig, folder: Path, *, resume: str, reporter: Any) -> None:
        self.config, self.folder, self.resume = config, Path(folder), resume
        self.stop_requested = False
        Recorder.made.append(self)

    def run(self) -> training.TrainResult:
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / "config.yaml").write_text(yaml.safe_dump(self.config.to_dict()))
        file, config = self.folder / LAST, self.config.to_dict()
        if file.is_file():
            load(file, config=config)
        save(file, {"steps": 100}, config=config)
        for number in self.signals:
            os.kill(os.getpid(), number)
        return training.TrainResult(
            steps=100 if self.stop_requested else 400,
            minutes=1.0,
            success=0.9,
            reached=False,
            finished=not self.stop_requested,
            policies={"robots": self.folder / "policy.npz"},
        )


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[Recorder]]:
    Recorder.made, Recorder.signals = [], ()
    monkeypatch.setattr(training, "Trainer", Recorder)
    yield Recorder


def test_help_shows_an_example() -> None:
    assert "Example: rcare-marl train feeding" in call("--help").stdout


def test_what_is_said_changes_the_config(
    config: Path, recorder: type[Recorder], tmp_path: Path
) -> None:
    call(
        "toileting",
        "--config",
        config,
        "--seed",
        3,
        "--steps",
        200,
        "--out",
        tmp_path / "run",
        "--workers",
        1,
        "--set",
        "options.reward=shaped",
        "--set",
        "cast.recipient=karan",
        "--set",
        "curriculum.stages=[{spread: 0.5}]",
    )
    (made,) = recorder.made
    got = made.config
    assert (got.task, got.seed, got.steps, got.envs, got.workers) == ("toileting", 3, 200, 2, 1)
    assert got.options == {"reward": "shaped"} and got.cast == {"recipient": "karan"}
    assert got.curriculum.stages[0].spread == 0.5


def test_a_cluster_is_named_where_processes_are(
    config: Path, recorder: type[Recorder], tmp_path: Path
) -> None:
    call(
        "toileting", "--config", config, "--out", tmp_path / "run", "--workers", "ray://head:10001"
    )
    assert recorder.made[0].config.workers == "ray://head:10001"


def test_settings_of_one_algorithm_are_not_those_of_another(
    recorder: type[Recorder], tmp_path: Path
) -> None:
    file = tmp_path / "sac.yaml"
    file.write_text("task: toileting\nalgo: sac\nalgorithm: {gamma: 0.9}\n")
    call("toileting", "--config", file, "--algo", "ppo", "--out", tmp_path / "ppo")
    call("toileting", "--config", file, "--algo", "sac", "--out", tmp_path / "sac")
    assert [made.config.algorithm for made in recorder.made] == [{}, {"gamma": 0.9}]


def test_the_same_command_again_goes_on(
    config: Path, recorder: type[Recorder], tmp_path: Path
) -> None:
    for steps in (400, 800):  # longer is no other training
        call("toileting", "--config", config, "--steps", steps, "--out", tmp_path / "run")
    assert [made.resume for made in recorder.made] == ["auto", "auto"]
    assert recorder.made[1].config.steps == 800


def test_the_folder_of_another_training_is_not_overwritten(
    config: Path, recorder: type[Recorder], tmp_path: Path
) -> None:
    call("toileting", "--config", config, "--out", tmp_path / "run")
    said = refusal("toileting", "--config", config, "--seed", 1, "--out", tmp_path / "run")
    assert "holds another training: seed is 0 there and 1 now" in said
    assert "--out" in said and f"rcare-marl train toileting --resume {tmp_path / 'run'}" in said
    assert len(recorder.made) == 1


def test_a_folder_of_something_else_is_not_written_to(config: Path, tmp_path: Path) -> None:
    said = refusal("toileting", "--config", config, "--out", tmp_path)
    assert "is no folder of a training and is not empty" in said
    assert "there is a file of that name" in refusal(
        "toileting", "--config", config, "--out", config
    )


def test_a_training_goes_on_from_its_folder_with_its_config(
    config: Path, recorder: type[Recorder], tmp_path: Path
) -> None:
    call("toileting", "--config", config, "--seed", 5, "--out", tmp_path / "run")
    call("toileting", "--resume", tmp_path / "run", "--steps", 900)
    again = recorder.made[1]
    assert again.folder == tmp_path / "run"
    assert (again.config.seed, again.config.steps, again.config.envs) == (5, 900, 2)


def test_a_training_goes_on_from_its_best_checkpoint_in_another_folder(
    config: Path, recorder: type[Recorder], tmp_path: Path
) -> None:
    call("toileting", "--config", config, "--out", tmp_path / "run")
    best = (tmp_path / "run" / LAST).rename(tmp_path / "run" / "best.pt")
    said = refusal("toileting", "--resume", best)
    assert "would lose what came after it: choose another folder with --out" in said
    call("toileting", "--resume", best, "--out", tmp_path / "other")
    assert recorder.made[1].folder == tmp_path / "other" and best.is_file()
    assert "not empty" in refusal("toileting", "--resume", best, "--out", tmp_path / "other")


def test_what_cannot_be_gone_on_from_is_said(
    config: Path, recorder: type[Recorder], tmp_path: Path
) -> None:
    call("toileting", "--config", config, "--out", tmp_path / "run")
    assert "Did you mean" in refusal("toileting", "--resume", tmp_path / "rum")
    assert "is for task 'toileting', not 'feeding'" in refusal(
        "feeding", "--resume", tmp_path / "run"
    )
    policy = tmp_path / "run" / "policy.npz"
    assert "is a policy, which a training cannot go on from" in refusal(
        "toileting", "--resume", policy
    )
    call("toileting", "--resume", tmp_path / "run", "--config", config, code=2)
    other = ("toileting", "--resume", tmp_path / "run", "--set", "options.reward=shaped")
    assert "does not fit: options.reward is not set in the checkpoint" in refusal(*other)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("toiletting",), "Did you mean 'toileting'"),
        (("toileting", "--algo", "sacc"), "Did you mean 'sac'"),
        (("toileting", "--set", "stepz=3"), "Did you mean 'steps'"),
        (("toileting", "--set", "algorithm.gama=0.9"), "Did you mean 'gamma'"),
        (("toileting", "--set", "options.rewart=shaped"), "Did you mean 'reward'"),
        (("toileting", "--set", "seed.x=1"), "seed is 0, which has no fields"),
        (("toileting", "--workers", "-2"), "workers must not be negative"),
        (("toileting", "--workers", "many"), "--workers N, async://N or ray://..."),
        (("toileting", "--set", "steps"), "expected NAME=VALUE"),
    ],
)
def test_a_mistake_is_named_before_anything_is_made(
    tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    file = tmp_path / "config.yaml"
    file.write_text(f"task: {arguments[0]}\nseed: 0\n")
    said = refusal(*arguments, "--config", file, "--out", tmp_path / "run")
    assert message in said.replace("│ ", "")
    assert not (tmp_path / "run").exists()


def test_a_config_of_another_task_is_refused(config: Path, tmp_path: Path) -> None:
    said = refusal("feeding", "--config", config, "--out", tmp_path / "run")
    assert "is for task 'toileting', not 'feeding'" in said


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_saves_and_says_how_to_go_on(
    config: Path, recorder: type[Recorder], tmp_path: Path, number: int, code: int
) -> None:
    before = signal.getsignal(number)
    recorder.signals = (number,)
    said = call("toileting", "--config", config, "--out", tmp_path / "run", code=code).stderr
    assert "saving at the end of this interval" in said
    assert "stopped at 100 of 400 steps" in said
    assert f"rcare-marl train toileting --resume {tmp_path / 'run'}" in " ".join(said.split())
    assert signal.getsignal(number) is before


def test_a_second_signal_stops_at_once(
    config: Path, recorder: type[Recorder], tmp_path: Path
) -> None:
    recorder.signals = (signal.SIGTERM, signal.SIGINT)
    said = call("toileting", "--config", config, "--out", tmp_path / "run", code=130).stderr
    assert "interrupted" in said
    command = f"rcare-marl train toileting --resume {tmp_path / 'run'}"
    assert f"from the last checkpoint: {command}" in " ".join(said.split())


def test_two_trainings_do_not_run_in_one_folder(
    config: Path, recorder: type[Recorder], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Recorder.run
    said: list[str] = []

    def nested(self: Recorder) -> training.TrainResult:
        monkeypatch.setattr(Recorder, "run", run)
        said.append(refusal("toileting", "--config", config, "--out", tmp_path / "run"))
        return run(self)

    monkeypatch.setattr(Recorder, "run", nested)
    call("toileting", "--config", config, "--out", tmp_path / "run")
    assert "another training is running in" in said[0]
    call("toileting", "--config", config, "--out", tmp_path / "run")


def test_fields_are_set_by_their_full_names() -> None:
    data = {"a": {"b": 1, "c": 2}, "d": None}
    assert changed(data, {"a.b": 5, "d.e.f": 6, "g": 7}) == {
        "a": {"b": 5, "c": 2},
        "d": {"e": {"f": 6}},
        "g": 7,
    }
    assert data == {"a": {"b": 1, "c": 2}, "d": None}, "what was given stays as it is"
    with pytest.raises(ConfigError, match="a is 3, which has no fields"):
        changed({"a": 3}, {"a.b": 1})


def test_an_engine_is_chosen_and_has_a_folder_of_its_own(
    recorder: type[Recorder], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    call("feeding", "--engine", "mujoco")
    call("feeding")
    assert [each.config.recipe().engine for each in recorder.made] == ["mujoco", "bullet"]
    names = [each.folder.name for each in recorder.made]
    assert names == ["feeding_mujoco_sac_seed0", "feeding_sac_seed0"]
    assert "does not run on engine 'mujoco'" in refusal("tooth_brushing", "--engine", "mujoco")


def test_a_saved_config_is_the_one_it_was(config: Path) -> None:
    first = load_config(config)
    assert load_config(first.to_dict()) == first
