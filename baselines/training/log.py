"""What is written of a training while it runs: a CSV file and events for TensorBoard."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from rcare_marl.atomic_file import write_whole
from rcare_marl.errors import ConfigError
from rcare_marl.reading import read_text, refusing

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

    from .config import TrainConfig

CURVE = "progress.csv"  # in the folder of a run
STEP = "step"  # the first column of it
# Where TensorBoard shows a metric; all others are under `train`.
SECTIONS = {
    "speed": ("steps_per_second", "updates_per_second", "learner_share", "minutes"),
    "evaluation": ("eval_success", "eval_return"),
}


class Reporter(Protocol):
    """Who is told how a training goes, such as a progress bar.

    Metrics may be `return` and `success` of the latest episodes, `steps_per_second`,
    `updates_per_second`, `learner_share`, `eval_success`, `eval_return` and losses; any may be missing.
    """

    def start(self, config: TrainConfig, total_steps: int, at_step: int) -> None:
        """Hear what begins, how long it is, and at which step, if it goes on from a checkpoint."""

    def tell(self, what: str) -> None:
        """Hear what is done before the first step is learned from, which may take a while."""

    def report(self, step: int, metrics: Mapping[str, float]) -> None:
        """Hear how far it is."""

    def close(self) -> None:
        """Hear that it is over, in whatever way."""


class TrainingLog:
    """A CSV file with a row for each time that something was written, the step first, and events.

    A metric that comes later gets a column of its own; it is empty in the rows before. The events are for
    TensorBoard: `tensorboard --logdir runs` shows them.
    """

    def __init__(self, folder: str | Path, *, at_step: int = 0) -> None:
        """Open both in a folder, and cut off what was written after a step.

        A run that was killed has written past its checkpoint, and will do so again.

        Args:
            folder: Of the run; made if need be.
            at_step: Step of the checkpoint from which it goes on; 0 begins anew.

        Raises:
            ConfigError: If the file cannot be written, or is no such file.
        """
        from torch.utils.tensorboard import SummaryWriter  # a second to import

        self._path = Path(folder) / CURVE
        self._columns: list[str] = [STEP]
        self._rows: list[dict[str, str]] = []
        if at_step > 0 and self._path.is_file():
            self._read(at_step)
        self._write_rows()
        purge = at_step + 1 if at_step > 0 else None  # events after it are not shown
        with self._writing():
            self._events: SummaryWriter | None = SummaryWriter(str(folder), purge_step=purge)

    def _read(self, at_step: int) -> None:
        what = "the log of a training"
        with refusing(self._path, what), io.StringIO(read_text(self._path, what)) as file:
            reader = csv.DictReader(file)
            columns = list(reader.fieldnames or ())
            if columns[:1] != [STEP]:
                raise ConfigError(
                    f"{self._path} is no log of a training: its first column is no step"
                )
            self._columns = columns
            for row in reader:
                # A row that was being written when the run was killed has a cell missing.
                if None in row.values() or not row[STEP].isdigit() or int(row[STEP]) > at_step:
                    break
                self._rows.append(row)

    def write(self, step: int, metrics: Mapping[str, float]) -> None:
        """Add a row, and a point to the curve of each metric.

        Raises:
            ConfigError: If the file cannot be written, or the log is closed.
        """
        if self._events is None:
            raise ConfigError("the log is closed")
        row = {STEP: str(step), **{name: f"{value:.6g}" for name, value in metrics.items()}}
        self._columns += [name for name in row if name not in self._columns]
        self._rows.append(row)
        self._write_rows()
        with self._writing():
            for name, value in metrics.items():
                section = next((s for s, names in SECTIONS.items() if name in names), "train")
                self._events.add_scalar(f"{section}/{name}", value, step)
            self._events.flush()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            where = self._path.parent
            raise ConfigError(
                f"cannot write curves in {where}: {error.strerror or error}"
            ) from error

    def _write_rows(self) -> None:
        out = io.StringIO()
        table = csv.DictWriter(out, self._columns, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows(self._rows)
        write_whole(self._path, out.getvalue().encode())

    def close(self) -> None:
        """Close it; safe to call twice. ConfigError if what is left cannot be written."""
        events, self._events = self._events, None
        if events is not None:
            with self._writing():
                events.close()
