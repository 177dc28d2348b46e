"""Real people (UI-PRMD, see tests/data): right and wrong are told apart by every source of poses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from variants import few

from rcare_marl.agents.coaching.exercise import Exercise, KeyPose
from rcare_marl.agents.coaching.recognition.recogniser import PoseSource, Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.sources.hands_source import HandsReading, HandsSource
from rcare_marl.agents.coaching.sources.joints_source import JointsSource
from rcare_marl.agents.coaching.sources.landmark_source import LandmarkReading, LandmarkSource
from rcare_marl.agents.coaching.upper_body import ARM
from rcare_marl.pose import Pose

Array = npt.NDArray[np.float64]
FILE = Path(__file__).parent / "data" / "ui_prmd_excerpt.npz"
RATE = 30.0
LANDMARKS = [0, 7, 8, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 23, 24]
SOURCES = ("joints", "landmarks", "hands")


def exercise(
    name: str, top: tuple[float, float, float], rest: tuple[float, float, float], *seconds: float
) -> Exercise:
    """As a therapist would write it; made of subjects 1 and 2: elbow, elevation and plane [deg]."""
    motions = ("elbow_flexion", "shoulder_elevation", "shoulder_plane")
    hold, move, back = seconds
    pose = KeyPose(dict(zip(motions, top, strict=True)), move, hold)
    return Exercise(name, name, name, name, (pose,), dict(zip(motions, rest, strict=True)), back)


EXERCISES = {
    7: exercise("abduction", (18.1, 141.1, 9.3), (15.9, 13.5, -7.8), 0.4, 1.0, 1.1),
    8: exercise("extension", (14.5, 57.9, -63.2), (21.5, 16.5, 10.0), 0.25, 0.8, 0.8),
    10: exercise("scaption", (17.0, 98.5, 41.9), (16.0, 12.2, 23.7), 0.3, 0.7, 0.7),
}


def repetitions() -> list[dict[str, Any]]:
    """Return what was recorded of each repetition."""
    data = np.load(FILE)
    cuts = np.cumsum(data["length"])[:-1]
    columns = [np.split(data[name].astype(float), cuts) for name in ("ang", "poses", "pts")]
    singles = [data[name].tolist() for name in ("origin", "stature", "move", "wrong")]
    names = ("angles", "poses", "points", "origin", "stature", "move", "wrong")
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, *singles, strict=True)]


def held(rows: Array) -> Array:
    """Return rows with rest before and after, which the data leave out."""
    return np.concatenate((np.repeat(rows[:1], 45, 0), rows, np.repeat(rows[-1:], 60, 0)))


def seen(source: str, one: dict[str, Any], rng: np.random.Generator) -> Iterator[Any]:
    """Yield what a source reads of a repetition, with a little noise."""
    if source == "joints":
        angles = held(one["angles"])
        yield from angles + rng.normal(0, math.radians(0.5), angles.shape)
    elif source == "hands":
        rows = held(one["poses"])
        for row in rows.reshape(-1, 3, 7):
            at = row[:, :3] + one["origin"] + rng.normal(0, 0.003, (3, 3))
            yield HandsReading(
                *(Pose(tuple(p), tuple(q)) for p, q in zip(at, row[:, 3:], strict=True))
            )
    else:
        points = held(one["points"])
        for frame in points + rng.normal(0, 0.005, points.shape):
            marks, visibility = np.zeros((33, 3)), np.zeros(33)
            marks[LANDMARKS] = np.column_stack((frame[:, 1], -frame[:, 2], -frame[:, 0]))
            visibility[LANDMARKS] = 1.0
            yield LandmarkReading(marks, visibility)


def said(source: str, one: dict[str, Any], rng: np.random.Generator) -> list[Repetition]:
    """Return what was said of a repetition by somebody nobody has seen before."""
    swept = [float(np.ptp(one["angles"][:, ARM[side].start])) for side in ("left", "right")]
    side = "left" if swept[0] > swept[1] else "right"
    maker: dict[str, PoseSource] = {
        "joints": JointsSource(),
        "landmarks": LandmarkSource(),
        "hands": HandsSource(round(one["stature"], 2)),
    }
    recogniser = RuleRecogniser()
    recogniser.begin(EXERCISES[one["move"]].one_sided(side))
    found = []
    for k, raw in enumerate(seen(source, one, rng)):
        frame = maker[source].update(raw, k / RATE)
        judgement = recogniser.update(frame) if frame is not None else None
        if judgement is not None and judgement.finished is not None:
            found.append(judgement.finished)
    return found


@pytest.mark.parametrize("source", few(SOURCES, "joints", "landmarks"))
def test_real_people_are_told_right_from_wrong_by_every_source(source: str) -> None:
    right, wrong = list[bool](), list[bool]()
    for number, one in enumerate(repetitions()):
        verdicts = said(source, one, np.random.default_rng(number))
        is_right = bool(verdicts) and all(repetition.right for repetition in verdicts)
        (wrong if one["wrong"] else right).append(is_right)
    assert len(right) == len(wrong) == 6
    assert sum(right) >= 5 and sum(wrong) <= 1
