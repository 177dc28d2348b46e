"""Recording of a session: nothing without consent, on this computer only, gone when consent is withdrawn."""

from __future__ import annotations

import html
import io
import json
import shutil
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.coaching.exercise import Exercise
from rcare_marl.agents.coaching.recognition.recogniser import ERRORS, Repetition
from rcare_marl.agents.coaching.upper_body import MOTION_INDEX, MOTIONS
from rcare_marl.atomic_file import write_whole
from rcare_marl.errors import ConfigError, MissingPackageError
from rcare_marl.pose import Array

from . import clinician
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
        try:
            place = _new_folder(folder)
            self._write_data(place / "session.h5")
            write_whole(place / clinician.TABLE, clinician.to_csv(self))
            found = clinician.bundle(self, datetime.now().astimezone())
            write_whole(
                place / clinician.OBSERVATIONS, (json.dumps(found, indent=1) + "\n").encode()
            )
            return write_report(self, place)
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


# What is drawn: label, motion, style; one line for each that the exercise moves.
LINES = (
    ("left arm raised", "left_shoulder_elevation", "#0b5cad", "-"),
    ("right arm raised", "right_shoulder_elevation", "#b3400a", "--"),
    ("left arm to the front", "left_shoulder_plane", "#0b5cad", ":"),
    ("right arm to the front", "right_shoulder_plane", "#b3400a", "-."),
    ("head turned to the left", "neck_rotation_left", "#23703a", "-"),
)
REPORT = "report.html"
LEAST = np.radians(15)  # a motion that the exercise moves less is not drawn; our own choice
GREEN = "#cdeccd"
LEGEND = (
    "Green: the person followed. Thin lines: from where to where the exercise goes. "
    "✓ a right repetition, ✗ one that was not."
)
STYLE = """
body{font:18px/1.5 sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#111;background:#fff}
img{max-width:100%;border:1px solid #bbb}
table{border-collapse:collapse}
th,td{border:1px solid #888;padding:.3rem .7rem;text-align:left}
caption{text-align:left;font-weight:bold}
@media print{body{font-size:11pt;margin:0}img,table{break-inside:avoid}h2,h3{break-after:avoid}}
"""


def write_report(recording: Recording, folder: Path) -> Path:
    """Write the report, which holds its plots in itself, into a folder; return the page."""
    parts = []
    for exercise in recording.exercises:
        steps = [step for step in recording.steps if step.exercise == exercise.name]
        if not steps:
            continue
        parts.append(_section(exercise, recording, _plot(exercise, steps)))
    begin, spent = recording.begin, recording.steps[-1].time - recording.steps[0].time
    limits = (
        f"arms up to {begin.lift_left_deg:.0f} (left) and {begin.lift_right_deg:.0f} (right) degrees, "
        f"head up to {begin.turn_deg:.0f} degrees"
    )
    page = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Exercise session</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head><body>
<h1>Exercise session</h1>
<p>{datetime.now():%d %B %Y, %H:%M}. Recorded for {spent:.0f} seconds with the person's consent; source:
{begin.source}; tempo {begin.tempo:.0%} of the exercises'; asked for: {limits}. This is no medical
assessment.</p>
{_table(recording)}
{clinician.trends(folder.parent, recording.exercises)}
<h2>This session</h2><p>{LEGEND}</p>
{"".join(parts)}
<p>Every repetition is in <a href="{clinician.TABLE}">{clinician.TABLE}</a>, and as FHIR Observations in
<a href="{clinician.OBSERVATIONS}">{clinician.OBSERVATIONS}</a>.</p>
<p>All angles are in <code>session.h5</code> beside this page. To delete the recording delete this folder.</p>
</body></html>
"""
    write_whole(folder / REPORT, page.encode())
    return folder / REPORT


def _table(recording: Recording) -> str:
    rows = []
    for exercise in recording.exercises:
        found = [each for name, _, each in recording.repetitions if name == exercise.name]
        right = sum(each.right for each in found)
        score = f"{100 * np.mean([each.score for each in found]):.0f}" if found else "none"
        rows.append(
            f"<tr><th scope='row'>{html.escape(exercise.title)}</th><td>{right}</td>"
            f"<td>{len(found) - right}</td><td>{score}</td></tr>"
        )
    head = "".join(
        f"<th scope='col'>{name}</th>" for name in ("Exercise", "Right", "Not right", "Mean score")
    )
    return f"<table><caption>Repetitions</caption><tr>{head}</tr>{''.join(rows)}</table>"


def _section(exercise: Exercise, recording: Recording, picture: str) -> str:
    title = html.escape(exercise.title)
    errors = Counter(
        error
        for name, _, each in recording.repetitions
        if name == exercise.name
        for error in each.errors
    )
    said = "".join(f"<li>{ERRORS[error]} ({n} times)</li>" for error, n in errors.most_common())
    return (
        f"<h3>{title}</h3><p>{html.escape(exercise.about)}</p>"
        f"<img src='{picture}' alt='Angles of {title} over time; green where the person followed'>"
        f"{f'<p>What the coach had to say:</p><ul>{said}</ul>' if said else ''}"
    )


def _plot(exercise: Exercise, steps: list[Step]) -> str:
    from matplotlib.figure import Figure  # a second to import

    times = np.array([step.time for step in steps])
    angles = np.array([step.angles for step in steps])
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    axes = figure.subplots()
    for start, end in _spans(times, np.array([step.following for step in steps])):
        axes.axvspan(start, end, color=GREEN, lw=0)
    asked = exercise.keys
    for label, motion, colour, style in LINES:
        i = MOTION_INDEX[motion]
        if np.ptp(asked[:, i]) < LEAST:
            continue
        axes.plot(times, np.degrees(angles[:, i]), color=colour, ls=style, label=label)
        goal = np.degrees(asked[:, i])
        for value in {float(goal.max()), float(goal.min())}:
            axes.axhline(value, color=colour, lw=0.6, alpha=0.5)
    for step in steps:
        if step.finished is not None:
            right = step.finished.right
            axes.annotate(
                "✓" if right else "✗",
                (step.time, 1.0),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="bottom",
                fontsize=14,
                color="#17602b" if right else "#a01818",
            )
    axes.set_xlabel("time [s]")
    axes.set_ylabel("angle [deg]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    axes.set_title(exercise.title, loc="left", pad=18)
    return clinician.picture(figure)


def _spans(times: Array, green: npt.NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return beginning and end of each time in which the window was green [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], green, [False])).astype(int)))
    last = len(times) - 1
    return [
        (float(times[a]), float(times[min(b, last)]))
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    ]
