"""Landmarks of synthetic people, as a detector that knows depths gives them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rcare_marl.agents.coaching.sources.landmark_source import (
    COUNT,
    EAR,
    ELBOW,
    HIP,
    INDEX,
    NOSE,
    PINKY,
    SHOULDER,
    WRIST,
    LandmarkReading,
    LandmarkSource,
)
from rcare_marl.agents.coaching.upper_body import SIDES, SIGN, UpperBody
from rcare_marl.pose import Array

from .noise import NoiseModel, own_lift, sampled
from .performance import Performance, at_rest
from .synthetic_user import SyntheticUser

CALIBRATION = 1.3  # how long a person sits still before the camera [s]
# From the eyes, in the axes of the head, and from a wrist, in those of its hand [m]; our own choice.
NOSE_AT, EAR_AT = (0.02, 0.0, -0.04), (-0.09, 0.07, -0.02)
PINKY_AT, INDEX_AT = (0.08, 0.04, 0.0), (0.09, -0.03, 0.0)
HIP_AT = 0.09  # [m] to the side; our own choice
# In the picture: to its right is the person's left; down; away from the camera.
SEEN = np.array(((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0)))


def landmarks_of(body: UpperBody, angles: Array) -> Array:
    """Return the landmarks of a body that faces the camera [m], shape [n, 33, 3]; of the face nose and ears.

    Args:
        body: Whose.
        angles: [rad], shape [n, 16].
    """
    points, turns = body.points(angles), body.turns(angles)
    out = np.zeros((len(angles), COUNT, 3))
    out[:, :11] = points["eyes"][:, None]
    out[:, NOSE] += turns["head"] @ NOSE_AT
    for side in SIDES:
        sign = SIGN[side]
        out[:, EAR[side]] += turns["head"] @ (EAR_AT * np.array((1.0, sign, 1.0)))
        for part, name in ((SHOULDER, "shoulder"), (ELBOW, "elbow"), (WRIST, "wrist")):
            out[:, part[side]] = points[f"{side}_{name}"]
        for part, at in ((PINKY, PINKY_AT), (INDEX, INDEX_AT)):
            reach = turns[f"{side}_hand"] @ (at * np.array((1.0, sign, 1.0)))
            out[:, part[side]] = points[f"{side}_wrist"] + reach
        out[:, HIP[side]] = (0.0, sign * HIP_AT, 0.0)
    return np.asarray(out @ SEEN.T)


class LandmarksSensor:
    """A detector of body landmarks: every one of them is off, and a few frames show nobody."""

    def __init__(self, noise: NoiseModel) -> None:
        self._noise = noise

    def source(self, user: SyntheticUser, rng: np.random.Generator) -> LandmarkSource:
        """Return a source that has seen a person sit still."""
        source, count = LandmarkSource(), int(CALIBRATION * self._noise.rate)
        still = np.repeat(at_rest(user)[None], count, axis=0)
        for i, reading in enumerate(self._read(user, still, rng)):
            source.update(reading, (i - count) / self._noise.rate)
        return source

    def readings(
        self, user: SyntheticUser, performance: Performance, rng: np.random.Generator
    ) -> Iterator[tuple[float, float, LandmarkReading | None]]:
        """Yield what is detected, None where nobody is."""
        taken, told = self._noise.times(float(performance.times[-1]), rng)
        read = self._read(user, sampled(performance, taken), rng)
        yield from zip(taken, told, read, strict=True)

    def _read(
        self, user: SyntheticUser, angles: Array, rng: np.random.Generator
    ) -> Iterator[LandmarkReading | None]:
        points = landmarks_of(user.body, angles)
        trunk = user.body.turns(angles)["trunk"]
        for side in SIDES:  # shoulders of their own move the whole arm
            more = (trunk @ own_lift(user, side, angles)[..., None])[..., 0] @ SEEN.T
            for part in (SHOULDER, ELBOW, WRIST, PINKY, INDEX):
                points[:, part[side]] += more
        points += rng.normal(0, self._noise.position, size=points.shape)
        for found, lost in zip(points, self._noise.lost(len(points), 1, rng)[:, 0], strict=True):
            yield None if lost else LandmarkReading(found, np.ones(COUNT))
