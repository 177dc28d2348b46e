"""Poses from a camera and the marker bands that a person wears.

Nothing is known of the person but what is in the picture: OpenCV finds the bands' markers, and a model of
the upper body is laid through their corners (`band_tracker`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose

from ..recognition.recogniser import Frame
from ..upper_body import ARM, MOTIONS, SIDES, turn_y, turn_z
from .band_tracker import BandTracker, View
from .marker_band import DICTIONARY, Band, band_set

Picture = npt.NDArray[np.uint8]

# All our own choice.
SETTLING = 1.0  # how long a person is watched before anything is told [s]
OFTEN = 0.3  # share of these pictures in which a marker must be found to count
HOLD = 0.25  # how long an angle is held that is not seen any more [s]
# Arms in the rest of the exercises: elevation, plane, rotation, elbow flexion, pronation [deg].
RESTING = (12.0, 45.0, 0.0, 20.0, 0.0)
STATURES = (1.2, 2.1)  # [m]
# Of the threshold [pixel]; larger ones miss small cards on what is as bright as their rims.
WINDOW = 5
OFF = 0.45  # how far a corner may be from where it is expected, as a share of the edge
# Of the edge to that expected: neither the white rim of a card nor its inner square.
RATIO = (0.85, 1.18)
ALIKE = 0.45  # least correlation of a print with what is seen
PIXELS = 4  # a cell of the print is looked at with so many pixels each way


class CardFinder:
    """OpenCV's detector of markers, and a second look at what it could not read.

    A card of less than three pixels a cell is often found as a square whose number cannot be told. If a card
    is expected there, of this size and turned so, and the print looks like its own, it is taken.
    """

    def __init__(self) -> None:
        """Set it up."""
        options = cv2.aruco.DetectorParameters()
        options.adaptiveThreshWinSizeMin = options.adaptiveThreshWinSizeMax = WINDOW
        options.minMarkerPerimeterRate = 0.03
        options.perspectiveRemovePixelPerCell = 8
        options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        self._book = cv2.aruco.getPredefinedDictionary(
            getattr(cv2.aruco, f"DICT_{DICTIONARY.upper()}")
        )
        self._detector: Any = cv2.aruco.ArucoDetector(self._book, options)
        self._prints: dict[int, Array] = {}

    def find(self, image: Picture, expected: Mapping[int, Array] | None = None) -> dict[int, Array]:
        """Return the corners [pixel] of markers by number, shape [4, 2] each.

        Args:
            image: Colours (RGB) or grey, shape [height, width, 3] or [height, width].
            expected: Where cards should be: corners [pixel] by number, shape [4, 2] each.

        Raises:
            ConfigError: If it is no picture.
        """
        if image.dtype != np.uint8 or image.ndim not in (2, 3):
            raise ConfigError(
                "a picture must be uint8 [height, width, 3] or [height, width], got "
                f"{image.dtype} {image.shape}"
            )
        grey: Any = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        squares, numbers, unread = self._detector.detectMarkers(grey)
        found: dict[int, Array] = {}
        doubled: set[int] = set()
        for square, number in zip(squares, () if numbers is None else numbers.ravel(), strict=True):
            if int(number) in found:
                doubled.add(int(number))
            found[int(number)] = square.reshape(4, 2).astype(np.float64)
        found = {number: square for number, square in found.items() if number not in doubled}
        if expected:
            missing = {number: e for number, e in expected.items() if number not in found}
            found.update(self._read(grey, unread, missing))
        return found

    def _read(
        self, grey: Any, unread: Sequence[Any], expected: Mapping[int, Array]
    ) -> dict[int, Array]:
        """Return those of the squares without a number that are expected cards."""
        if not len(unread) or not expected:
            return {}
        squares = np.asarray(unread, np.float64).reshape(-1, 4, 2)
        # Of what it cannot read OpenCV gives the outermost edge: that of the card.
        squares = np.concatenate((squares, [_inner(square) for square in squares]))
        edges = _edge(squares)
        best: dict[int, tuple[float, int, Array]] = {}
        for number, card in expected.items():
            edge = float(_edge(card[None])[0])
            near = np.abs(squares.mean(axis=1) - card.mean(axis=0)).max(axis=1) < OFF * edge
            fits = near & (edges > RATIO[0] * edge) & (edges < RATIO[1] * edge)
            for k in np.flatnonzero(fits).tolist():
                turned = min(
                    (np.roll(squares[k], r, axis=0) for r in range(4)),
                    key=lambda square: float(np.abs(square - card).max()),
                )
                off = float(np.linalg.norm(turned - card, axis=1).max())
                if off < OFF * edge and off < best.get(number, (np.inf,))[0]:
                    best[number] = (off, k, turned)
        taken = [k for _, k, _ in best.values()]
        out = {}
        for number, (_, k, square) in best.items():
            if taken.count(k) == 1:
                fine = self._refined(grey, square)
                if self._likeness(grey, fine, number) > ALIKE:
                    out[number] = fine
        return out

    @staticmethod
    def _refined(grey: Any, square: Array) -> Array:
        """Return corners [pixel] moved to where the edges cross."""
        half = max(2, round(0.3 * float(_edge(square[None])[0]) / 6))
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 30, 0.05)
        corners = square.astype(np.float32).reshape(4, 1, 2)
        cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), stop)
        return np.asarray(corners.reshape(4, 2), np.float64)

    def _likeness(self, grey: Any, square: Array, number: int) -> float:
        """Return the correlation of what is seen in a square with the print of a marker."""
        if number not in self._prints:
            cells = np.asarray(cv2.aruco.generateImageMarker(self._book, number, 6), np.float64)
            self._prints[number] = cells - cells.mean()
        edge = 6 * PIXELS
        flat = np.array(((0, 0), (edge, 0), (edge, edge), (0, edge)), np.float32) - 0.5
        turn = cv2.getPerspectiveTransform(square.astype(np.float32), flat)
        seen = np.asarray(cv2.warpPerspective(grey, turn, (edge, edge)), np.float64)
        cells = seen.reshape(6, PIXELS, 6, PIXELS).mean(axis=(1, 3))
        cells -= cells.mean()
        wanted = self._prints[number]
        spread = float(np.linalg.norm(cells) * np.linalg.norm(wanted))
        return float((cells * wanted).sum()) / spread if spread > 0 else 0.0


def _inner(rim: Array) -> Array:
    """Return the corners of the black square of a card [pixel] from those of the card, [4, 2]."""
    card = np.array(((0, 0), (8, 0), (8, 8), (0, 8)), np.float32)
    black = np.array(((1, 1), (7, 1), (7, 7), (1, 7)), np.float32)
    turn = cv2.getPerspectiveTransform(card, rim.astype(np.float32))
    return np.asarray(cv2.perspectiveTransform(black[None], turn)[0], np.float64)


def _edge(squares: Array) -> Array:
    """Return the mean edge of squares [n, 4, 2], shape [n]."""
    return np.asarray(np.linalg.norm(squares - np.roll(squares, 1, axis=1), axis=2).mean(axis=1))


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
