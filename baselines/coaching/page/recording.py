"""Recording of a session: nothing without consent, on this computer only, gone when consent is withdrawn."""

from __future__ import annotations

import io
import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rcare_marl.agents.coaching.exercise import Exercise
from rcare_marl.agents.coaching.recognition.recogniser import Repetition
from rcare_marl.agents.coaching.upper_body import MOTIONS
from rcare_marl.atomic_file import write_whole
from rcare_marl.errors import ConfigError, MissingPackageError
from rcare_marl.pose import Array

from .message import Begin

LONGEST = 2 * 3600 * 30  # steps that are kept: two hours
FORMAT = "rcare-marl coaching session 1"


@dataclass(frozen=True, eq=False)
class Step:
    """What is kept of one step.

    Attributes:
        time: Since the session began [s].
        exercise: Name of the exercise that was on.
        angles: Of the person [rad], shape [16]; NaN where unknown.
        following: Whether the window was green.
        progress: Of the repetition, 0 to 1.
        finished: A repetition that was judged in this step.
    """

    time: float
    exercise: str
    angles: Array
    following: bool
    progress: float
    finished: Repetition | None


class Recorder:
    """Keeps one session in memory while there is consent, and writes it when it is over.

    Attributes:
        folder: Where recordings go, one folder a session.
        has_consent: Whether the person consents now; not to begin with.
        report: The report of the last session that was written; None before, and after it was deleted.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.has_consent = folder, False
        self.report: Path | None = None
        self._steps: list[Step] = []
        self._begin: Begin | None = None
        self._exercises: Sequence[Exercise] = ()

    def consent(self, *, given: bool) -> None:
        """Take what the person says. Taking consent back deletes this session, written or not.

        Raises:
            ConfigError: If what was written cannot be deleted.
        """
        self.has_consent = given
        if given:
            return
        self._steps.clear()
        report, self.report = self.report, None
        if report is not None and report.parent.exists():
            try:
                shutil.rmtree(report.parent)
            except OSError as error:
                raise ConfigError(f"cannot delete {report.parent}: {error}") from error

    def begin(self, begin: Begin, exercises: Sequence[Exercise]) -> None:
        """Begin a session, without consent yet; one that was not written is dropped, one that was stays."""
        self.has_consent = False
        self._begin, self._exercises, self.report = begin, exercises, None
        self._steps.clear()

    def add(self, step: Step) -> None:
        """Keep a step, if there is consent."""
        if self.has_consent and len(self._steps) < LONGEST:
            self._steps.append(step)

    def written(self, report: Path) -> None:
        """Take note of where the recording went; it is deleted if consent was withdrawn meanwhile."""
        self.report = report
        if not self.has_consent:
            self.consent(given=False)

    def take(self) -> Recording | None:
        """Hand over what was kept, to be written; None if there is nothing to write."""
        if not (self.has_consent and self._steps and self._begin is not None):
            return None
        steps, self._steps = self._steps, []
        return Recording(self._begin, tuple(self._exercises), tuple(steps))


@dataclass(frozen=True, eq=False)
class Recording:
    """A session that is over.

    Attributes:
        begin: How it was begun.
        exercises: What was asked of this person.
        steps: All that was kept.
    """

    begin: Begin
    exercises: tuple[Exercise, ...]
    steps: tuple[Step, ...]

    @property
    def repetitions(self) -> list[tuple[str, float, Repetition]]:
        """Name of the exercise, time [s] and repetition, of each that was judged."""
        return [(s.exercise, s.time, s.finished) for s in self.steps if s.finished is not None]

    def write(self, folder: Path) -> Path:
        """Write data and report into a new folder below `folder`; return the report.

        Raises:
            MissingPackageError: If h5py is not installed.
            ConfigError: If the folder cannot be written.
        """
        from . import report

        try:
            place = _new_folder(folder)
            self._write_data(place / "session.h5")
            return report.write(self, place)
        except OSError as error:
            raise ConfigError(f"cannot write the recording to {folder}: {error}") from error

    def _write_data(self, file: Path) -> None:
        try:
            import h5py  # type: ignore[import-untyped, unused-ignore]
        except ImportError as error:
            raise MissingPackageError("recording a session", "coach") from error
        memory = io.BytesIO()
        with h5py.File(memory, "w") as data:
            data.attrs["format"] = FORMAT
            data.attrs["motions"] = list(MOTIONS)
            data.attrs["source"], data.attrs["height_m"] = self.begin.source, self.begin.height_m
            for name in ("time", "angles", "following", "progress"):
                data[name] = np.array([getattr(step, name) for step in self.steps])
            names = [exercise.name for exercise in self.exercises]
            data.attrs["exercises"] = names
            data["exercise"] = np.array([names.index(step.exercise) for step in self.steps])
            found = self.repetitions
            data["repetition/time"] = np.array([time for _, time, _ in found])
            data["repetition/exercise"] = np.array([names.index(name) for name, _, _ in found], int)
            data["repetition/right"] = np.array([each.right for _, _, each in found], bool)
            data["repetition/score"] = np.array([each.score for _, _, each in found])
            data["repetition/errors"] = [json.dumps(list(each.errors)) for _, _, each in found]
        write_whole(file, memory.getvalue())


def _new_folder(folder: Path) -> Path:
    """Return a new folder that only this user may read, named by the time."""
    stem = time.strftime("session-%Y%m%d-%H%M%S")
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(1, 1000):
        place = folder / (stem if number == 1 else f"{stem}-{number}")
        try:
            place.mkdir(mode=0o700)
        except FileExistsError:
            continue
        return place
    raise OSError("too many sessions at once")
