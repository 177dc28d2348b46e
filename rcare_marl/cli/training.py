"""The command `train`: learn a task, go on where an earlier sitting ended."""

from __future__ import annotations

import logging
import os
import shlex
import shutil
import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rcare_marl.console import print_line
from rcare_marl.errors import ConfigError

from .parameter import Task, settings

if TYPE_CHECKING:
    from rcare_marl.baselines.training.config import TrainConfig
    from rcare_marl.baselines.training.trainer import Trainer, TrainResult

CONFIG = "config.yaml"  # in the folder of a run
COPIED = (CONFIG, "versions.json", "progress.csv")  # what goes along into another folder
LOCK = ".lock"  # held while a training runs there
AUTO, NEVER = "auto", "never"


def train(
    task: Task,
    algo: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Algorithm, such as sac; else as in the config."),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="YAML file; else the one that ships for the task."),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of everything random.")] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Control steps of all environments together.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Where all is left; runs/TASK_ALGO_seedN if left out."),
    ] = None,
    resume: Annotated[
        str,
        typer.Option(
            metavar="auto|never|PATH",
            help="[bold]auto[/bold] goes on if the folder holds this training, [bold]never[/bold] "
            "refuses then; or a folder or checkpoint to go on from, with its config.",
        ),
    ] = AUTO,
    workers: Annotated[
        str | None,
        typer.Option(
            metavar="N|async://N|ray://...",
            help="Processes that step the environments; 0 is this one. [bold]async://N[/bold] do not "
            "wait for each other, nor for the learner.",
        ),
    ] = None,
    envs: Annotated[
        int | None, typer.Option(min=1, help="Environments that are stepped together.")
    ] = None,
    level: Annotated[
        int | None, typer.Option(min=1, max=3, help="Level of accessibility of home or door.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="FIELD=VALUE",
            help="Any field of the config, such as algorithm.gamma=0.98, options.reward=shaped or "
            "cast.recipient=karan; may be given several times.",
        ),
    ] = None,
) -> None:
    """Train a policy with TorchRL; a checkpoint every interval, a policy file, curves.

    Ctrl-C saves at the end of the interval and says how to go on; a second one stops at once.

    Example: rcare-marl train feeding --algo sac --seed 0 --steps 50000
    """
    given = {"algo": algo, "seed": seed, "steps": steps, "envs": envs}
    fields = {name: value for name, value in given.items() if value is not None}
    if workers is not None:
        fields["workers"] = _workers(workers)
    changes = settings(set_, "--set")
    if resume in (AUTO, NEVER):
        chosen = _chosen(task, config, level, fields, changes)
        folder = out or Path("runs") / _name(chosen)
        _check_folder(folder, chosen)
    else:
        if config is not None or level is not None:
            raise typer.BadParameter("the config is that of the checkpoint", param_hint="--resume")
        chosen, folder = _resumed(task, Path(resume), out, fields, changes)
        resume = AUTO
    _run(chosen, folder, resume)


def _workers(text: str) -> int | str:
    if "://" in text:
        return text  # the config says which there are
    try:
        return int(text)
    except ValueError:
        raise typer.BadParameter(
            f"got {text!r}", param_hint="--workers N, async://N or ray://..."
        ) from None


def _chosen(
    task: str,
    file: Path | None,
    level: int | None,
    fields: Mapping[str, Any],
    changes: Mapping[str, Any],
) -> TrainConfig:
    """Return the config of a new training: a file's, changed by what else was said."""
    from rcare_marl.baselines.training.config import default_config
    from rcare_marl.config import read_yaml

    if file is None:
        data = default_config(task, level)
    else:
        data = {"task": task, **read_yaml(file)}
        if data["task"] != task:
            raise ConfigError(f"{file} is for task {data['task']!r}, not {task!r}")
        if level is not None:
            data["cast"] = {**(data.get("cast") or {}), "level": level}
    if "algo" in fields and fields["algo"] != data.get("algo", "sac"):
        data.pop("algorithm", None)  # what is set there is for the other one
    return _checked(changed({**data, **fields}, changes))


def _checked(data: Mapping[str, Any]) -> TrainConfig:
    """Return a config of which all is known to be possible that can be known without the scene."""
    from rcare_marl.baselines.training.config import load_config
    from rcare_marl.config import load
    from rcare_marl.envs.registry import task_class

    config = load_config(data)
    load(task_class(config.task).Options, config.options, f"options of task {config.task!r}")
    return config


def changed(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of nested mappings with fields set by their full names.

    Args:
        data: The mappings.
        changes: Values by names such as `algorithm.gamma`.

    Raises:
        ConfigError: If a name leads through something that has no fields.
    """
    out = dict(data)
    for name, value in changes.items():
        first, _, rest = name.partition(".")
        if not rest:
            out[first] = value
            continue
        inner = out.get(first)
        if not isinstance(inner, Mapping | None):
            raise ConfigError(f"cannot set {name}: {first} is {inner!r}, which has no fields")
        out[first] = changed(inner or {}, {rest: value})
    return out


def _name(config: TrainConfig) -> str:
    level = config.cast.get("level")
    place = config.task if level is None else f"{config.task}_level{level}"
    return f"{place}_{config.algo}_seed{config.seed}"


def _check_folder(folder: Path, config: TrainConfig) -> None:
    """Refuse a folder in which there is something else than this training."""
    from rcare_marl.baselines.training.checkpoint import FREE, differences
    from rcare_marl.config import read_yaml

    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"cannot train in {folder}: there is a file of that name")
    if _is_free(folder):
        return
    if not (folder / CONFIG).is_file():
        raise ConfigError(
            f"{folder} is no folder of a training and is not empty: choose another one with --out"
        )
    found = differences(
        read_yaml(folder / CONFIG), config.to_dict(), free=FREE, names=("there", "now")
    )
    if found:
        raise ConfigError(
            f"{folder} holds another training: {'; '.join(found)}. Choose another folder with --out, or "
            f"go on with that one: {_resume_command(config.task, folder)}"
        )


def _is_free(folder: Path) -> bool:
    """Return whether nothing is in a folder, but the lock of a training that never began."""
    return not folder.exists() or all(each.name == LOCK for each in folder.iterdir())


def _resumed(
    task: str,
    path: Path,
    out: Path | None,
    fields: Mapping[str, Any],
    changes: Mapping[str, Any],
) -> tuple[TrainConfig, Path]:
    """Return the config and the folder of a training that goes on from a folder or a checkpoint."""
    from rcare_marl.baselines.policy_file import SUFFIX
    from rcare_marl.baselines.training.checkpoint import LAST, load
    from rcare_marl.config import read_yaml

    if path.suffix == SUFFIX:
        raise ConfigError(
            f"{path} is a policy, which a training cannot go on from: give its folder, {path.parent}, or "
            f"its {LAST}"
        )
    checkpoint = path / LAST if path.is_dir() or not path.suffix else path
    if not checkpoint.is_file():
        load(checkpoint)  # says what is there instead
    source = checkpoint.parent
    config = _checked(changed({**read_yaml(source / CONFIG), **fields}, changes))
    if config.task != task:
        raise ConfigError(f"{checkpoint} is for task {config.task!r}, not {task!r}")
    folder = out or source
    if folder.resolve() != source.resolve():
        if not _is_free(folder):
            raise ConfigError(f"{folder} is not empty: choose another folder with --out")
        folder.mkdir(parents=True, exist_ok=True)
        for name in COPIED:
            if (source / name).is_file():
                shutil.copyfile(source / name, folder / name)
        shutil.copyfile(checkpoint, folder / LAST)
    elif checkpoint.name != LAST:
        raise ConfigError(
            f"to go on from {checkpoint} would lose what came after it: choose another folder with --out"
        )
    return config, folder


def _run(config: TrainConfig, folder: Path, resume: str) -> None:
    from rcare_marl.baselines.training.checkpoint import LAST
    from rcare_marl.baselines.training.trainer import Trainer

    from .training_report import TrainingReport

    logging.getLogger("torchrl").setLevel(logging.WARNING)  # it tells of every buffer it makes
    with _alone(folder):
        trainer = Trainer(config, folder, resume=resume, reporter=TrainingReport())
        try:
            with _stopping(trainer) as signals:
                result = trainer.run()
        except KeyboardInterrupt:
            saved = (folder / LAST).is_file()
            command = _resume_command(config.task, folder)
            print_line(
                f"stopped at once; to go on from the last checkpoint: {command}"
                if saved
                else "stopped before the first checkpoint: the same command begins anew"
            )
            raise
    if result.finished:
        _tell(result)
        return
    print_line(
        f"stopped at {result.steps:,} of {config.steps:,} steps; to go on: "
        f"{_resume_command(config.task, folder)}"
    )
    if signals:
        raise typer.Exit(128 + signals[0])  # as shells have it


def _tell(result: TrainResult) -> None:
    print_line(
        f"done: {result.steps:,} steps in {result.minutes:.1f} minutes, "
        f"{100 * result.success:.0f} % success in evaluation"
    )
    for file in result.policies.values():
        print_line(f"wrote {file}")


def _resume_command(task: str, folder: Path) -> str:
    return shlex.join(["rcare-marl", "train", task, "--resume", str(folder)])


@contextmanager
def _stopping(trainer: Trainer) -> Iterator[list[int]]:
    """Let the first Ctrl-C or SIGTERM ask a training to save and end, and the second one end it.

    Yields:
        The signals that came.
    """
    came: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        came.append(number)
        if len(came) > 1:
            raise KeyboardInterrupt
        trainer.stop_requested = True
        print_line(
            "saving at the end of this interval; once more to stop at once, and lose what is since the last"
        )

    kinds = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(kind, stop) for kind in kinds]
    try:
        yield came
    finally:
        for kind, handler in zip(kinds, before, strict=True):
            signal.signal(kind, handler)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep a second training out of a folder; a lock of a killed one does not last."""
    try:
        import fcntl
    except ImportError:  # no such locks on Windows
        yield
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise ConfigError(f"cannot write to {folder}: {error.strerror}") from error
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ConfigError(f"another training is running in {folder}") from None
        yield
    finally:
        os.close(handle)
