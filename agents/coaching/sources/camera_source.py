"""Poses from a camera and the marker bands that a person wears.

Nothing is known of the person but what is in the picture: OpenCV finds the bands' markers, and a model of
the upper body is laid through their corners (`band_tracker`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose

from ..recognition.recogniser import Frame
from ..upper_body import ARM, MOTIONS, SIDES, turn_y, turn_z
from .band_tracker import BandTracker, View
from .card_finder import CardFinder, Picture
from .marker_band import Band, band_set

# All our own choice.
SETTLING = 1.0  # how long a person is watched before anything is told [s]
OFTEN = 0.3  # share of these pictures in which a marker must be found to count
HOLD = 0.25  # how long an angle is held that is not seen any more [s]
# Arms in the rest of the exercises: elevation, plane, rotation, elbow flexion, pronation [deg].
RESTING = (12.0, 45.0, 0.0, 20.0, 0.0)
STATURES = (1.2, 2.1)  # [m]


class Seen(Protocol):
    """What is known of a camera: `rcare_marl.rendering.Camera` is one."""

    @property
    def K(self) -> Array:  # noqa: N802  (the field's own name)
        """Intrinsic matrix [pixel], shape [3, 3]."""

    @property
    def pose(self) -> Pose:
        """Pose of the optical frame (x right, y down, z forward) in a frame with z up."""


@dataclass(frozen=True, eq=False)
class CameraReading:
    """A picture and what took it.

    Attributes:
        image: Colours (RGB) or grey, uint8, shape [height, width, 3] or [height, width].
        camera: Its intrinsics, and where it is in any frame that stands still and has z up: of a robot's
            camera what its joints say.
    """

    image: Picture
    camera: Seen


class CameraSource:
    """Makes frames of pictures of a person who wears bands.

    For the first second the person sits upright before the camera, arms hanging as in the rest of the
    exercises. That shows where they sit, which way they look, how tall they are and how the bands sit.

    Attributes:
        height: Stature [m], once known.
        seen: Markers found in the last picture: corners [pixel] by number.
        tracker: What follows the body, once calibrated.
    """

    def __init__(
        self,
        *,
        bands: Sequence[Band] | None = None,
        height: float | None = None,
        recline: float = 0.0,
    ) -> None:
        """Prepare a source.

        Args:
            bands: What the person wears; `band_set()` if None.
            height: Stature [m]; told from the bands in the first second if None.
            recline: How far the trunk leans back when it sits upright, as a wheelchair's backrest does [rad].

        Raises:
            ConfigError: If the stature or the recline is impossible.
        """
        if height is not None and not STATURES[0] <= height <= STATURES[1]:
            raise ConfigError(f"a stature must lie in {STATURES} m, got {height}")
        if not abs(recline) <= math.radians(60):
            raise ConfigError(f"recline must lie within 60 degrees, got {recline} rad")
        self.bands = tuple(band_set() if bands is None else bands)
        self.height, self._given, self._recline = height, height, recline
        self._finder = CardFinder()
        self._owner = {face.id: band for band in self.bands for face in band.faces}
        self.reset()

    def reset(self) -> None:
        """Begin anew, with somebody who sits down."""
        self.tracker: BandTracker | None = None
        self.height = self._given
        self.seen: dict[int, Array] = {}
        self._settling: list[tuple[float, dict[int, Array]]] = []
        self._time = -math.inf
        self._last = np.full(len(MOTIONS), np.nan)
        self._known_at = np.full(len(MOTIONS), -np.inf)

    def update(self, raw: CameraReading, time: float) -> Frame | None:
        """Return what is known at a time [s]; None during the calibration and while nothing is seen."""
        return self.follow(self.find(raw), raw.camera, time)

    def find(self, raw: CameraReading) -> dict[int, Array]:
        """Return the corners [pixel] of the bands' markers in a picture, by number, shape [4, 2] each."""
        expected = None
        if self.tracker is not None:
            expected = self.tracker.expected(self._view(raw.camera))
        return self._finder.find(raw.image, expected)

    def follow(self, seen: Mapping[int, Array], camera: Seen, time: float) -> Frame | None:
        """Return the frame of markers that somebody else has found.

        Args:
            seen: Corners by number of the marker [pixel], shape [4, 2] each.
            camera: What saw them.
            time: [s]; a frame that is not later than the last is passed over.
        """
        if time <= self._time:
            return None
        passed, self._time = time - self._time, time
        self.seen = {number: seen[number] for number in seen if number in self._owner}
        if self.tracker is None:
            self._settle(camera, time)
            return None
        angles = self.tracker.update(self.seen, self._view(camera), passed)
        known = np.isfinite(angles)
        self._last[known], self._known_at[known] = angles[known], time
        held = time - self._known_at <= HOLD
        if not held.any():
            return None
        return Frame(time, np.where(held, self._last, np.nan))

    def _view(self, camera: Seen) -> View:
        optical = camera.pose.matrix()
        lens = optical[:3, :3].T
        return View(camera.K, lens @ self._base, lens @ (self._origin - optical[:3, 3]))

    def _settle(self, camera: Seen, time: float) -> None:
        """Gather pictures of the first second, then learn from all of them."""
        self._settling.append((time, self.seen))
        if time - self._settling[0][0] < SETTLING:
            return
        self._settling = [(t, s) for t, s in self._settling if time - t <= 1.5 * SETTLING]
        numbers = {number for _, seen in self._settling for number in seen}
        steady = {}
        for number in numbers:
            squares = [seen[number] for _, seen in self._settling if number in seen]
            if len(squares) >= OFTEN * len(self._settling):
                steady[number] = np.median(squares, axis=0)
        places = self._places(steady, camera)
        facing = _facing(places)
        if facing is None:  # too little is seen: go on watching
            return
        self._base = turn_z(np.float64(facing)) @ turn_y(np.float64(-self._recline))
        heights = [self._given] if self._given else np.arange(*STATURES, 0.02).tolist()
        fits = [self._fit(places, height) for height in heights]
        _, self.height, self._origin, tracker = min(fits, key=lambda fit: fit[0])
        tracker.settle(steady, self._view(camera), resting())
        self.tracker = tracker

    def _fit(
        self, places: Mapping[str, Array], height: float
    ) -> tuple[float, float, Array, BandTracker]:
        """Return how badly bands of somebody of a stature fit where they are seen [m], and what fits best."""
        tracker = BandTracker(self.bands, height)
        tracker.pose.set_angles(resting())
        expected = _expected(tracker)
        shifts = np.array([place - self._base @ expected[name] for name, place in places.items()])
        middle = np.median(shifts, axis=0)
        return float(np.linalg.norm(shifts - middle, axis=1).mean()), height, middle, tracker

    def _places(self, seen: Mapping[int, Array], camera: Seen) -> dict[str, Array]:
        """Return roughly where bands are in the frame of the camera's pose [m], by name, shape [3]."""
        optical, found = camera.pose.matrix(), dict[str, list[Array]]()
        for number, square in seen.items():
            band = self._owner[number]
            face = next(face for face in band.faces if face.id == number)
            half = (
                face.size
                / 2
                * np.array(((-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)), np.float64)
            )
            good, turn, place = cv2.solvePnP(
                half, square.reshape(4, 1, 2), camera.K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
            )
            if good:
                back = np.asarray(cv2.Rodrigues(turn)[0]) @ face.place[:3, :3].T @ face.place[:3, 3]
                at = place.ravel() - back
                found.setdefault(band.name, []).append(optical[:3, :3] @ at + optical[:3, 3])
        return {name: np.median(places, axis=0) for name, places in found.items()}


def resting() -> Array:
    """Return the posture of the calibration, angles of `MOTIONS` [rad], shape [16]."""
    out = np.zeros(len(MOTIONS))
    for side in SIDES:
        out[ARM[side]] = np.radians(RESTING)
    return out


def _facing(places: Mapping[str, Array]) -> float | None:
    """Return about which angle round the vertical a person looks [rad]: across what is left and right."""
    pairs = [
        places[f"left_{part}"] - places[f"right_{part}"]
        for part in ("shoulder", "elbow", "wrist")
        if f"left_{part}" in places and f"right_{part}" in places
    ]
    if len(pairs) < 2 or not any(name in places for name in ("left_shoulder", "chest")):
        return None
    x, y = np.sum(pairs, axis=0)[:2]
    return math.atan2(-x, y)


def _expected(tracker: BandTracker) -> dict[str, Array]:
    """Return where bands are in the frame of the body [m], by name, as far as the estimate knows."""
    turns, origins, _ = tracker.pose.frames()
    segments = tracker.layout.segment
    return {
        band.name: origins[segments[i]] + turns[segments[i]] @ tracker.pose.places[i]
        for i, band in enumerate(tracker.layout.bands)
    }
