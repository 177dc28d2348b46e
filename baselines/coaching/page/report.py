"""A readable report of a session: a page with a plot per exercise, for the person and their therapist."""

from __future__ import annotations

import html
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from rcare_marl.agents.coaching.exercise import Exercise
from rcare_marl.agents.coaching.recognition.recogniser import ERRORS
from rcare_marl.agents.coaching.upper_body import MOTION_INDEX
from rcare_marl.atomic_file import write_whole
from rcare_marl.pose import Array

if TYPE_CHECKING:
    from .recording import Recording, Step

# What is drawn: label, motion, style; one line for each that the exercise moves.
LINES = (
    ("left arm raised", "left_shoulder_elevation", "#0b5cad", "-"),
    ("right arm raised", "right_shoulder_elevation", "#b3400a", "--"),
    ("left arm to the front", "left_shoulder_plane", "#0b5cad", ":"),
    ("right arm to the front", "right_shoulder_plane", "#b3400a", "-."),
    ("head turned to the left", "neck_rotation_left", "#23703a", "-"),
)
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
"""


def write(recording: Recording, folder: Path) -> Path:
    """Write `report.html` and its plots into a folder; return the page."""
    parts = []
    for exercise in recording.exercises:
        steps = [step for step in recording.steps if step.exercise == exercise.name]
        if not steps:
            continue
        picture = f"{exercise.name}.png"
        _plot(exercise, steps, folder / picture)
        parts.append(_section(exercise, recording, picture))
    begin, spent = recording.begin, recording.steps[-1].time - recording.steps[0].time
    limits = (
        f"arms up to {begin.lift_left_deg:.0f} (left) and {begin.lift_right_deg:.0f} (right) degrees, "
        f"head up to {begin.turn_deg:.0f} degrees"
    )
    page = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Exercise session</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head><body>
<h1>Exercise session</h1>
<p>Recorded for {spent:.0f} seconds with the person's consent; source: {begin.source}; tempo
{begin.tempo:.0%} of the exercises'; asked for: {limits}. This is no medical assessment.</p>
{_table(recording)}
{"".join(parts)}
<p>All angles are in <code>session.h5</code> beside this page. To delete the recording delete this folder.</p>
</body></html>
"""
    write_whole(folder / "report.html", page.encode())
    return folder / "report.html"


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
        f"<h2>{title}</h2><p>{html.escape(exercise.about)}</p>"
        f"<p>{LEGEND}</p>"
        f"<img src='{picture}' alt='Angles of {title} over time; green where the person followed'>"
        f"{f'<p>What the coach had to say:</p><ul>{said}</ul>' if said else ''}"
    )


def _plot(exercise: Exercise, steps: list[Step], file: Path) -> None:
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
    figure.savefig(file, dpi=110)


def _spans(times: Array, green: npt.NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return beginning and end of each time in which the window was green [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], green, [False])).astype(int)))
    last = len(times) - 1
    return [
        (float(times[a]), float(times[min(b, last)]))
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    ]
