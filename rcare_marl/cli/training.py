"""The command `train`: learn a task, go on where an earlier sitting ended; and what is shown meanwhile."""

from __future__ import annotations

import logging
import os
import shlex
import shutil
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.text import Text

from rcare_marl.console import console, print_line
from rcare_marl.errors import ConfigError

from .parameter import Demonstrated, Task, settings

if TYPE_CHECKING:
    from rcare_marl.baselines.training.config import TrainConfig
    from rcare_marl.baselines.training.trainer import Trainer, TrainResult

CONFIG = "config.yaml"  # in the folder of a run
Configured = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE|everybody",
        help="YAML file, or the one that ships for a population; else that of the default cast.",
    ),
]
COPIED = (CONFIG, "versions.json", "progress.csv")  # what goes along into another folder
LOCK = ".lock"  # held while a training runs there
AUTO, NEVER = "auto", "never"
EVERY = 30.0  # [s] between two lines where there is no terminal
WINDOW = 30.0  # [s] over which the speed is measured
Clock = Callable[[], float]


class TrainingReport:
    """Shows a training on standard error.

    On a terminal it is one line with a bar that is brought up to date; else a plain line every
    half a minute. Every evaluation has a line of its own.
    """

    def __init__(self, *, screen: Console | None = None, clock: Clock = time.monotonic) -> None:
        """Take where to write, standard error if None, and what tells the time [s]."""
        self._screen = screen or console(stderr=True)
        self._clock = clock
        self._latest, self._line = dict[str, float](), ""

    def start(self, config: TrainConfig, total_steps: int, at_step: int) -> None:
        """Say what begins."""
        begin = f"{config.task}, {config.algo}, seed {config.seed}: {total_steps:,} steps"
        self._say(begin + (f", going on at {at_step:,}" if at_step else ""))
        self._bar = Progress(
            *(TextColumn(config.task), BarColumn(), TextColumn("{task.description}")),
            console=self._screen,
            transient=True,
            disable=not self._screen.is_terminal,
            speed_estimate_period=WINDOW,
            get_time=self._clock,
        )
        self._job = self._bar.add_task("", total=total_steps, completed=at_step)
        self._bar.start()
        self._said = self._clock()

    def report(self, step: int, metrics: Mapping[str, float]) -> None:
        """Show how far it is."""
        self._latest |= metrics
        self._bar.update(self._job, completed=step)
        self._line = self._state(step)
        self._bar.update(self._job, description=self._line)
        if "eval_success" in metrics:
            self._say(f"{step:,} steps: evaluation {_evaluation(metrics)}")
        elif self._bar.disable and self._clock() - self._said >= EVERY:
            self._said = self._clock()
            self._say(self._line)

    def tell(self, what: str) -> None:
        """Say what is done meanwhile."""
        self._say(what)

    def _state(self, step: int) -> str:
        """Return in a line how it stands."""
        task = self._bar.tasks[0]
        parts = [f"{step:,}/{task.total:,}"]
        if speed := task.speed:
            left = (task.remaining or 0.0) / speed
            parts += [f"{duration(left)} left"] if left > 0 else []
            parts.append(f"{speed:,.0f} steps/s")
        if "return" in self._latest:
            parts.append(f"return {self._latest['return']:.3g}")
        if "success" in self._latest:
            parts.append(f"success {100 * self._latest['success']:.0f} %")
        return ", ".join(parts)

    def close(self) -> None:
        """Remove the bar, and leave the last line; safe to call twice."""
        self._bar.stop()
        if self._line:
            self._say(self._line)
            self._line = ""

    def _say(self, text: str) -> None:
        self._screen.print(Text(text), soft_wrap=True)


def _evaluation(metrics: Mapping[str, float]) -> str:
    text = f"{100 * metrics['eval_success']:.0f} % success"
    if "eval_return" in metrics:
        text += f", return {metrics['eval_return']:.4g}"
    return text


def duration(seconds: float) -> str:
    """Return a time as a text, such as `1:05:20` or `4:09`."""
    minutes, rest = divmod(round(max(seconds, 0.0)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def train(
    task: Task,
    algo: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Algorithm, such as sac; else as in the config."),
    ] = None,
    config: Configured = None,
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
    engine: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="What computes the motion: bullet, the default, or mujoco."
        ),
    ] = None,
    demonstrations: Demonstrated = None,
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

    Example: rcare-marl train feeding --algo sac --seed 0 --demonstrations runs/by_hand.hdf5
    """
    shown = None if demonstrations is None else {"path": str(demonstrations)}
    given: dict[str, Any] = {"algo": algo, "seed": seed, "steps": steps, "envs": envs}
    given |= {"engine": engine, "demonstrations": shown}
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
    from rcare_marl.baselines.training.config import EVERYBODY, default_config, everybody_config
    from rcare_marl.config import read_yaml

    if file is None:
        data = default_config(task, level)
    elif str(file) == EVERYBODY and not file.exists():
        data = everybody_config(task)
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
    engine = "" if config.engine == "bullet" else f"_{config.engine}"
    return f"{place}{engine}_{config.algo}_seed{config.seed}"


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
