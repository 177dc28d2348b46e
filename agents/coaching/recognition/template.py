"""What a right repetition of an exercise looks like: the ways of its parts, and how long they take."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rcare_marl.pose import Array

from ..exercise import SMALLEST, Exercise
from .feature import ANGLE_COLUMN, COLUMN, features

MOVING = (
    "left_arm",
    "right_arm",
    "head",
)  # parts that an exercise may ask for; the trunk's are faults
RATE = 30.0  # frames a second at which ways are compared
PATH_POINTS = 40
UPRIGHT = 0.5  # length of a unit vector along a way below which it is nowhere on it; our own choice
STARTED = 0.2  # share of the greatest excursion at which a movement counts as begun; our own choice


@dataclass(frozen=True, eq=False)
class Phase:
    """The way of one part from one key pose to the next.

    Attributes:
        start: Direction at its beginning, shape [3].
        end: Direction at its end, shape [3].
        across: Unit vector in the plane of the way, a right angle on from its beginning, shape [3].
        angle: Its length [rad].
        scale: What counts as all of it: its length, or how far its end is from rest if that is less [rad].
    """

    start: Array
    end: Array
    across: Array
    angle: float
    scale: float

    def share(self, directions: Array, scale: float | None = None) -> Array:
        """Return how much of the way directions [..., 3] have gone: 0 not begun, 1 all, more beyond.

        A direction that stands nearly upright on the way is nowhere on it: 0.

        Args:
            directions: Unit vectors, shape [..., 3].
            scale: What counts as all of it [rad]; its own if None.
        """
        scale = self.scale if scale is None else scale
        x, y = directions @ self.start, directions @ self.across
        gone = np.arctan2(y, x)
        # What lies opposite the beginning is beyond the end or before the beginning, whichever is nearer.
        gone = np.where(gone < 0.5 * self.angle - math.pi, gone + 2 * math.pi, gone)
        return np.where(np.hypot(x, y) > UPRIGHT, 1.0 - (self.angle - gone) / scale, 0.0)

    def scale_from(self, rest: Array) -> float:
        """Return what counts as all of it [rad] for somebody who rests with the part along `rest` [3]."""
        own = min(self.angle, float(between(rest, self.end)))
        return min(max(own, 0.6 * self.scale), 1.2 * self.scale)


@dataclass(frozen=True, eq=False)
class Way:
    """What one part does in an exercise.

    Attributes:
        part: Which, of `MOVING`.
        rest: Its direction at rest, shape [3].
        phases: Its ways out; the way back to rest is none.
        path: Directions all along, shape [points, 3].
        excursion: How far it gets from rest [rad].
    """

    part: str
    rest: Array
    phases: tuple[Phase, ...]
    path: Array
    excursion: float


class Template:
    """An exercise as its recogniser compares it.

    Attributes:
        exercise: The exercise.
        ways: What each part does that has to move.
        moving_time: From where it has begun to where it is nearly back [s].
        elbows: Greatest flexion of left and right elbow at the key poses [rad].
    """

    def __init__(self, exercise: Exercise) -> None:
        self.exercise = exercise
        rows = features(exercise.path(RATE))
        keys = features(exercise.keys)
        self.ways = {
            part: _way(part, keys[:, COLUMN[part]], rows[:, COLUMN[part]])
            for part in MOVING
            if part in exercise.parts
        }
        spread = [
            between(rows[:, COLUMN[p]], way.rest) / way.excursion for p, way in self.ways.items()
        ]
        moved = np.flatnonzero(np.max(spread, axis=0) > STARTED) if spread else np.zeros(1)
        self.moving_time = max(float(moved[-1] - moved[0]) / RATE, 1 / RATE)
        self.elbows = {
            side: float(keys[1:-1, ANGLE_COLUMN[f"{side}_elbow"]].max(initial=0.0))
            for side in ("left", "right")
        }

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms that have to move."""
        return tuple(part for part in self.ways if part != "head")


def _way(part: str, keys: Array, path: Array) -> Way:
    rest = keys[0]
    phases = []
    for start, end in zip(keys[:-2], keys[1:-1], strict=True):
        angle = float(between(start, end))
        if angle < SMALLEST:
            continue
        across = end - (end @ start) * start
        length = float(np.linalg.norm(across))
        if length < 1e-6:  # half a turn: any way is as short
            continue
        far = float(between(rest, end))
        scale = min(angle, far) if far >= SMALLEST else angle
        phases.append(Phase(start, end, across / length, angle, scale))
    picked = path[np.linspace(0, len(path) - 1, min(PATH_POINTS, len(path))).round().astype(int)]
    return Way(part, rest, tuple(phases), picked, float(between(path, rest).max()))


def between(a: Array, b: Array) -> Array:
    """Return the angle between unit vectors [..., 3] [rad], shape [...]."""
    return np.asarray(np.arccos(np.clip((a * b).sum(axis=-1), -1.0, 1.0)))


def arc(start: Array, end: Array, count: int = 12) -> Array:
    """Return directions on the shortest way from one to another, shape [count, 3]."""
    angle = float(between(start, end))
    if angle < 1e-6:
        return np.tile(start, (count, 1))
    share = np.linspace(0.0, 1.0, count)[:, None]
    mixed = np.sin((1 - share) * angle) * start + np.sin(share * angle) * end
    return np.asarray(mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-9))


def off_path(directions: Array, path: Array) -> Array:
    """Return how far directions [..., 3] are from the nearest point of a path [points, 3] [rad]."""
    return np.asarray(np.arccos(np.clip((directions @ path.T).max(axis=-1), -1.0, 1.0)))
