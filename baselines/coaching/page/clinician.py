"""What a clinician takes along from recorded sessions: a table as CSV, FHIR Observations, trends.

An observation is one of HL7 FHIR R4 (https://hl7.org/fhir/R4/observation.html): status `preliminary`, as
nobody has looked at it, angles in degrees of UCUM. Codes are text alone: we know of none of LOINC for how far
a part went from its rest in an exercise of ours. There is no subject: a recording holds no name.
"""

from __future__ import annotations

import base64
import csv
import html
import io
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rcare_marl.errors import ConfigError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rcare_marl.agents.coaching.exercise import Exercise

    from .recording import Recording

TABLE, OBSERVATIONS = "repetitions.csv", "observations.json"
PARTS = {"left_arm_deg": "left arm", "right_arm_deg": "right arm"}  # excursions from rest [deg]
COMPENSATION = ("lean_deg", "turn_deg", "elbow_deg")  # how far besides, at worst [deg]
COLUMNS = ("exercise", "time_s", "verdict", "score", "errors", *PARTS, *COMPENSATION)
STYLES = (
    ("#0b5cad", "o-"),
    ("#b3400a", "s--"),
    ("#23703a", "^:"),
)  # colour and line of what is drawn
LARGEST = 4_000_000  # bytes of a table that is read back


def rows(recording: Recording) -> list[dict[str, Any]]:
    """Return a row of `COLUMNS` for each repetition; what was not measured is empty."""
    out = []
    for name, time, found in recording.repetitions:
        measured = {
            key: round(found.measures[key], 1)
            for key in (*PARTS, *COMPENSATION)
            if np.isfinite(found.measures.get(key, np.nan))
        }
        said = {"verdict": found.verdict, "score": found.score, "errors": " ".join(found.errors)}
        out.append({"exercise": name, "time_s": round(time, 2), **said, **measured})
    return out


def to_csv(recording: Recording) -> bytes:
    """Return the table of all repetitions."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows(recording))
    return text.getvalue().encode()


def bundle(recording: Recording, when: datetime) -> dict[str, Any]:
    """Return a FHIR R4 Bundle of Observations: of each exercise its repetitions, and each part's best range.

    Args:
        recording: The session.
        when: When it was, with its time zone.
    """
    found, entries = rows(recording), []
    for exercise in recording.exercises:
        own = [row for row in found if row["exercise"] == exercise.name]
        if not own:
            continue
        right = [row for row in own if row["verdict"] == "right"]
        title = exercise.title
        entries += [
            _observation(f"{title}: right repetitions", when, float(len(right)), "{count}"),
            _observation(f"{title}: repetitions", when, float(len(own)), "{count}"),
        ]
        for key, part in PARTS.items():
            ranges = [row[key] for row in right if key in row]
            if ranges:
                text = f"{title}: greatest excursion of the {part} from rest, active"
                entries.append(_observation(text, when, max(ranges), "deg"))
    return {
        "resourceType": "Bundle",
        "type": "collection",
        "timestamp": when.isoformat(timespec="seconds"),
        "entry": [{"resource": entry} for entry in entries],
    }


def _observation(text: str, when: datetime, value: float, unit: str) -> dict[str, Any]:
    system = "http://terminology.hl7.org/CodeSystem/observation-category"
    return {
        "resourceType": "Observation",
        "status": "preliminary",
        "category": [{"coding": [{"system": system, "code": "activity"}]}],
        "code": {"text": text},
        "effectiveDateTime": when.isoformat(timespec="seconds"),
        "valueQuantity": {
            "value": value,
            "unit": unit.strip("{}"),
            "system": "http://unitsofmeasure.org",
            "code": unit,
        },
    }


def trends(folder: Path, exercises: Sequence[Exercise]) -> str:
    """Return plots and a table in HTML of all sessions in a folder, oldest first; empty if there are not two.

    Args:
        folder: Where recordings lie, one folder a session; all of it is taken for one person's.
        exercises: Those to tell of.

    Raises:
        ConfigError: If a table of a session cannot be read.
    """
    files = sorted(folder.glob(f"session-*/{TABLE}"))
    if len(files) < 2:
        return ""
    tables = {_when(file): _read(file) for file in files}
    courses = {
        exercise.title: {when: own for when, rows in tables.items() if (own := _of(exercise, rows))}
        for exercise in exercises
    }
    body = [
        f"<tr><th scope='row'>{html.escape(title)}</th><td>{when}</td>{_cells(own)}</tr>"
        for title, course in courses.items()
        for when, own in course.items()
    ]
    names = ("Exercise", "Session", "Right", "Not right", "Left arm", "Right arm", "Lean")
    head = "".join(f"<th scope='col'>{name}</th>" for name in names)
    caption = "All sessions in this folder: repetitions, and medians of range and lean [deg]"
    return (
        f"<h2>From session to session</h2><img src='{_courses(courses)}' alt='Range of each arm, "
        f"repetitions and compensation over {len(files)} sessions; the table below has the numbers'>"
        f"<table><caption>{caption}</caption><tr>{head}</tr>{''.join(body)}</table>"
    )


Row = dict[str, str]


def _of(exercise: Exercise, rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row["exercise"] == exercise.name]


def _when(file: Path) -> str:
    """Return when a session was, as its folder says; the folder's name where that is another."""
    name = file.parent.name.removeprefix("session-")
    stem, number = name[:15], name[15:]  # one of several in a second has a number
    try:
        return f"{datetime.strptime(stem, '%Y%m%d-%H%M%S'):%d %b %Y %H:%M:%S}{number}"
    except ValueError:
        return html.escape(file.parent.name)


def _median(rows: Sequence[Row], key: str) -> float:
    values = [float(row[key]) for row in rows if row[key]]
    return float(np.median(values)) if values else np.nan


def _cells(own: Sequence[Row]) -> str:
    right = sum(row["verdict"] == "right" for row in own)
    medians = [_median(own, key) for key in (*PARTS, COMPENSATION[0])]
    told = ["" if np.isnan(each) else f"{each:.0f}" for each in medians]
    return "".join(f"<td>{cell}</td>" for cell in (right, len(own) - right, *told))


def _courses(courses: Mapping[str, Mapping[str, Sequence[Row]]]) -> str:
    """Draw range, repetitions and compensation of each exercise over sessions; return the address."""
    from matplotlib.figure import Figure  # a second to import
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(9, 0.5 + 2.1 * len(courses)), layout="constrained")
    for line, (title, course) in zip(
        figure.subplots(len(courses), 3, squeeze=False), courses.items(), strict=True
    ):
        at = np.arange(1, len(course) + 1)
        right = np.array([sum(row["verdict"] == "right" for row in own) for own in course.values()])
        for keys, axes in ((tuple(PARTS), line[0]), (COMPENSATION, line[2])):
            for key, (colour, style) in zip(keys, STYLES, strict=False):
                values = [_median(own, key) for own in course.values()]
                label = key.removesuffix("_deg").replace("_", " ")
                axes.plot(at, values, style, color=colour, label=label)
        line[1].bar(at, right, color="#17602b", label="right")
        wrong = [len(own) for own in course.values()] - right
        line[1].bar(
            at,
            wrong,
            bottom=right,
            color="white",
            edgecolor="#a01818",
            hatch="//",
            label="not right",
        )
        for axes, name in zip(
            line, ("range [deg]", "repetitions", "compensation [deg]"), strict=True
        ):
            axes.set_title(f"{title}: {name}", loc="left", fontsize=9)
            axes.set_ylim(bottom=0)
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in figure.axes[-3:]:
        axes.set_xlabel("session")
        axes.legend(
            fontsize=8, frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.28)
        )
    return picture(figure)


def picture(figure: Figure) -> str:
    """Return a figure as the address of a picture that a page holds in itself."""
    out = io.BytesIO()
    figure.savefig(out, dpi=110, format="png")
    return f"data:image/png;base64,{base64.b64encode(out.getvalue()).decode()}"


def _read(file: Path) -> list[dict[str, str]]:
    if file.stat().st_size > LARGEST:
        raise ConfigError(f"{file} is no table of a session: more than {LARGEST} bytes")
    try:
        found = list(csv.DictReader(io.StringIO(file.read_text("utf-8"))))
        for row in found:
            if set(row) != set(COLUMNS):
                raise ValueError(f"columns must be {', '.join(COLUMNS)}")
            _ = [float(row[key]) for key in (*PARTS, *COMPENSATION) if row[key]]
    except (ValueError, csv.Error) as error:
        raise ConfigError(f"{file} is no table of a session: {error}") from error
    return found
