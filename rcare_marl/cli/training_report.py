"""How a training goes, for whoever watches: a bar on a terminal, else a line now and then."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.text import Text

from rcare_marl.console import console

if TYPE_CHECKING:
    from rcare_marl.baselines.training.config import TrainConfig

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
