"""How a training goes, for whoever watches: a bar on a terminal, else a line now and then."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn
from rich.text import Text

from rcare_marl.console import console

if TYPE_CHECKING:
    from rcare_marl.baselines.training.config import TrainConfig

EVERY = 30.0  # [s] between two lines where there is no terminal
WINDOW = 30.0  # [s] over which the speed is measured
Clock = Callable[[], float]


class Pace:
    """How fast the steps go by."""

    def __init__(self, clock: Clock = time.monotonic) -> None:
        self._clock = clock
        self._seen: deque[tuple[float, int]] = deque()

    def note(self, step: int) -> None:
        """Take note of how far it is now; that it is still there tells nothing of its pace."""
        now = self._clock()
        if self._seen and self._seen[-1][1] == step:
            self._seen.pop()
        self._seen.append((now, step))
        while len(self._seen) > 2 and self._seen[1][0] <= now - WINDOW:
            self._seen.popleft()

    @property
    def speed(self) -> float | None:
        """Steps per second, of late; None as long as there is nothing to measure."""
        if len(self._seen) < 2:
            return None
        (begin, first), (end, last) = self._seen[0], self._seen[-1]
        return (last - first) / (end - begin) if end > begin else None


class TrainingReport:
    """Shows a training on standard error.

    On a terminal it is one line with a bar that is brought up to date; else a plain line every
    half a minute. Every evaluation has a line of its own.
    """

    def __init__(self, *, screen: Console | None = None, clock: Clock = time.monotonic) -> None:
        """Take where to write, standard error if None, and what tells the time [s]."""
        self._screen = screen or console(stderr=True)
        self._clock = clock
        self._pace = Pace(clock)
        self._bar: Progress | None = None
        self._job = TaskID(0)
        self._said = clock()
        self._total, self._latest, self._line = 0, dict[str, float](), ""

    def start(self, config: TrainConfig, total_steps: int, at_step: int) -> None:
        """Say what begins."""
        self._total = total_steps
        begin = f"{config.task}, {config.algo}, seed {config.seed}: {total_steps:,} steps"
        self._say(begin + (f", going on at {at_step:,}" if at_step else ""))
        if self._screen.is_terminal:
            columns = [TextColumn(config.task), BarColumn(), TextColumn("{task.description}")]
            self._bar = Progress(*columns, console=self._screen, transient=True)
            self._job = self._bar.add_task("", total=total_steps, completed=at_step)
            self._bar.start()
        self._pace.note(at_step)
        self._said = self._clock()

    def report(self, step: int, metrics: Mapping[str, float]) -> None:
        """Show how far it is."""
        self._pace.note(step)
        self._latest |= metrics
        self._line = self._state(step)
        if self._bar is not None:
            self._bar.update(self._job, completed=step, description=self._line)
        if "eval_success" in metrics:
            self._say(f"{step:,} steps: evaluation {_evaluation(metrics)}")
        elif self._bar is None and self._clock() - self._said >= EVERY:
            self._said = self._clock()
            self._say(self._line)

    def _state(self, step: int) -> str:
        """Return in a line how it stands."""
        parts = [f"{step:,}/{self._total:,}"]
        if speed := self._pace.speed:
            left = self._total - step
            parts += [f"{duration(left / speed)} left"] if left > 0 else []
            parts.append(f"{speed:,.0f} steps/s")
        if "return" in self._latest:
            parts.append(f"return {self._latest['return']:.3g}")
        if "success" in self._latest:
            parts.append(f"success {100 * self._latest['success']:.0f} %")
        return ", ".join(parts)

    def close(self) -> None:
        """Remove the bar, and leave the last line; safe to call twice."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
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
