"""What a clinician takes along from recorded sessions: a table as CSV, FHIR Observations, trends.

An observation is one of HL7 FHIR R4 (https://hl7.org/fhir/R4/observation.html): status `preliminary`, as
nobody has looked at it, angles in degrees of UCUM. Codes are text alone: we know of none of LOINC for how far
a part went from its rest in an exercise of ours. There is no subject: a recording holds no name.
"""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rcare_marl.errors import ConfigError

if TYPE_CHECKING:
    from .recording import Recording

TABLE, OBSERVATIONS = "repetitions.csv", "observations.json"
PARTS = {"left_arm_deg": "left arm", "right_arm_deg": "right arm"}  # excursions from rest [deg]
COMPENSATION = ("lean_deg", "turn_deg", "elbow_deg")  # how far besides, at worst [deg]
COLUMNS = ("exercise", "time_s", "verdict", "score", "errors", *PARTS, *COMPENSATION)
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


def trends(folder: Path, exercises: Sequence[str]) -> str:
    """Return a table in HTML of all sessions in a folder, the oldest first; empty if there are not two.

    Args:
        folder: Where recordings lie, one folder a session; all of it is taken for one person's.
        exercises: Names of those to tell of.

    Raises:
        ConfigError: If a table of a session cannot be read.
    """
    sessions = sorted(folder.glob(f"session-*/{TABLE}"))
    if len(sessions) < 2:
        return ""
    body = [
        f"<tr><th scope='row'>{html.escape(file.parent.name.removeprefix('session-'))}</th>"
        f"<td>{name.replace('_', ' ')}</td>{_cells(own)}</tr>"
        for file in sessions
        for name in exercises
        if (own := [row for row in _read(file) if row["exercise"] == name])
    ]
    names = ("Session", "Exercise", "Right", "Not right", "Left arm", "Right arm", "Lean")
    head = "".join(f"<th scope='col'>{name}</th>" for name in names)
    caption = "All sessions in this folder: repetitions, and medians of range and lean [deg]"
    return f"<table><caption>{caption}</caption><tr>{head}</tr>{''.join(body)}</table>"


def _cells(own: Sequence[dict[str, str]]) -> str:
    right = sum(row["verdict"] == "right" for row in own)
    medians = []
    for key in ("left_arm_deg", "right_arm_deg", "lean_deg"):
        values = [float(row[key]) for row in own if row[key]]
        medians.append(f"{np.median(values):.0f}" if values else "")
    return "".join(f"<td>{cell}</td>" for cell in (right, len(own) - right, *medians))


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
