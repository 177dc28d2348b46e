"""Finds the cards of bands in a picture, small ones too, where one knows about where to look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from .marker_band import DICTIONARY

Picture = npt.NDArray[np.uint8]

# All our own choice.
WINDOW = (
    5  # of the threshold [pixel]; larger ones miss small cards on what is as bright as their rims
)
OFF = 0.45  # how far a corner may be from where it is expected, as a share of the edge
RATIO = (
    0.85,
    1.18,
)  # of the edge to that expected: neither the white rim of a card nor its inner square
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
