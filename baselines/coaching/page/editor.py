"""Exercises that are written on the page: how they look on the coach and on a person, and their YAML."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import yaml

from rcare_marl.agents.coaching.exercise import Demand, Exercise, Reach, exercise_of
from rcare_marl.agents.coaching.upper_body import (
    ARM,
    ARM_MOTIONS,
    MOTION_INDEX,
    MOTIONS,
    SIDES,
    UpperBody,
)
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from .message import Draft, Range

RATE = 15.0  # of what is shown [1/s]
LONGEST = 60.0  # of a repetition [s]
FIGURE = UpperBody.of_height(1.6)  # coach and person are drawn of one size


def points_of(angles: Array) -> dict[str, list[float] | None]:
    """Return the points of a figure [m], None for those that are not known, at angles [rad], shape [16]."""
    return {
        name: np.round(point, 3).tolist() if np.isfinite(point).all() else None
        for name, point in FIGURE.points(angles).items()
    }


def reach_of(given: Range) -> Reach:
    """Return what somebody says that they can do; all else is free."""
    high = np.full(len(MOTIONS), math.radians(200))
    low = -high
    turn = MOTION_INDEX["neck_rotation_left"]
    high[turn], low[turn] = math.radians(given.turn_deg), -math.radians(given.turn_deg)
    for side, most in zip(SIDES, (given.lift_left_deg, given.lift_right_deg), strict=True):
        high[ARM[side].start] = math.radians(most)
    return Reach(low, high)


def drafted(draft: Draft) -> dict[str, Any]:
    """Return what the page shows of a draft, ready for JSON: frames of both figures, and the YAML to save.

    Raises:
        ConfigError: If it is no exercise; it names the value that is wrong.
    """
    exercise = exercise_of(draft.name, draft.exercise, f"{draft.name}.yaml")
    if exercise.duration > LONGEST:
        raise ConfigError(
            f"one repetition takes {exercise.duration:g} s; here it may take {LONGEST:g} s"
        )
    own = exercise.adapted(reach_of(draft))
    path = exercise.path(RATE)
    theirs = own.angles(np.arange(len(path)) / RATE) if own.can_do else None
    return {
        "type": "draft",
        "yaml": yaml.safe_dump(
            dict(draft.exercise), sort_keys=False, allow_unicode=True, width=100
        ),
        "rate": RATE,
        "duration": round(exercise.duration, 2),
        "parts": [part.replace("_", " ") for part in exercise.parts],
        "left": [part.replace("_", " ") for part in own.parts],
        "coach": [points_of(angles) for angles in path],
        "user": None if theirs is None else [points_of(angles) for angles in theirs],
    }


def fields_of(exercise: Exercise) -> dict[str, Any]:
    """Return an exercise as its YAML has it, without what is as usual: where a new one may begin."""
    usual, judged = asdict(Demand()), asdict(exercise.judged)
    return {
        "title": exercise.title,
        "say": exercise.say,
        "about": exercise.about,
        "rest": _short(exercise.rest),
        "poses": [
            {**asdict(pose), "angles_deg": _short(pose.angles_deg)} for pose in exercise.poses
        ],
        "return_s": exercise.return_s,
        "repetitions": exercise.repetitions,
        "judged": {key: value for key, value in judged.items() if value != usual[key]},
    }


def _short(angles: Mapping[str, float]) -> dict[str, float]:
    """Return angles with those of both arms in one where they are alike."""
    out = {name: angle for name, angle in angles.items() if not name.startswith(SIDES)}
    for motion in ARM_MOTIONS:
        both = {side: angles.get(f"{side}_{motion}") for side in SIDES}
        if both["left"] is not None and both["left"] == both["right"]:
            out[motion] = both["left"]
        else:
            out |= {f"{side}_{motion}": angle for side, angle in both.items() if angle is not None}
    return out
