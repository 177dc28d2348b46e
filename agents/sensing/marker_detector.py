"""Finds ArUco markers in a picture and says how they lie, to some hundredths of a pixel.

The four corners that a detector finds are good to a few tenths of a pixel. Seen from the front that
leaves the tilt open by many degrees, for a tilt t shortens the picture by 1 - cos t only. The edges of
all cells say more: the pose is moved by Gauss-Newton steps until the print, seen through the camera
and averaged over each pixel, fits the picture best (after Lucas and Kanade 1981).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, Pose, quaternion_from_matrix

from .marker_print import DICTIONARIES, cells
from .marker_print import dictionary as opened

if TYPE_CHECKING:
    from rcare_marl.rendering import Camera

# Pixels that are looked at, every second, third, ... of a larger marker, and the step [pixel] that is
# the last. All are needed in the end: the tilt seen from the front hangs on hundredths of a pixel.
_STAGES = ((1000, 0.02), (8000, 1e-3))
_STEPS = 15  # a stage, at most
_DAMPING = 1e-9
_TRUSTED = 0.25  # of the contrast; a pixel that is off by more counts less (Huber 1964)
_LEAST_CONTRAST = 5.0  # [grey step of 256]
_RIM = 0.5  # [cell] of the outer white that is looked at: what lies beyond it may be anything
_SAME = math.radians(0.5)  # poses nearer than that are one
_WORST = 0.35  # of the contrast; a print that is off by more is no good sign of a pose


Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Detection:
    """A marker in a picture.

    Attributes:
        id: Its number.
        corners: Corners of the black square in the picture [pixel], the upper left pixel's middle
            being (0, 0), shape [4, 2]; clockwise from the upper left of the print.
        pose: Of the marker's frame (x right, y up, z out of the print) in the camera's (x right,
            y down, z forward).
        residual: What the picture differs from the print, as a share of the contrast.
        ambiguity: In [0, 1]: how well the other pose fits that looks almost the same, as the ratio
            of the residuals; near 1 it is open which of the two it is.
    """

    id: int
    corners: Array
    pose: Pose
    residual: float
    ambiguity: float


def detect(
    image: npt.NDArray[np.uint8],
    camera: Camera,
    sizes: Mapping[int, float],
    *,
    dictionary: str = "4x4_50",
) -> list[Detection]:
    """Return the markers of `sizes` that are seen in a picture, by rising number.

    Args:
        image: A picture, shape [height, width, 3] or [height, width].
        camera: What took it; its place does not matter.
        sizes: Edge of the black square of each marker [m], by its number; others are passed over.
        dictionary: Which family of markers.

    Raises:
        ConfigError: If the picture is not of the size of the camera's, or a size is not positive.
        UnknownNameError: If there is no such dictionary.
    """
    check_name("dictionary of markers", dictionary, DICTIONARIES)
    if image.dtype != np.uint8 or image.shape[:2] != (camera.height, camera.width):
        raise ConfigError(
            f"the picture must be uint8 of {camera.height} rows and {camera.width} columns, as the "
            f"camera says, got {image.dtype} {image.shape}"
        )
    for number, size in sizes.items():
        if not size > 0:
            raise ConfigError(f"size of marker {number} must be positive, got {size}")
    grey = (
        image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    )
    found, numbers, _ = _detector(dictionary).detectMarkers(grey)
    out = []
    for corners, number in zip(found, () if numbers is None else numbers.ravel(), strict=True):
        if int(number) in sizes:
            square = corners.reshape(4, 2).astype(np.float64)
            seen = _locate(grey, camera.K, square, int(number), sizes[int(number)], dictionary)
            if seen is not None:
                out.append(seen)
    return _once(out)


def _locate(
    grey: npt.NDArray[np.uint8],
    lens: Array,
    corners: Array,
    number: int,
    size: float,
    dictionary: str,
) -> Detection | None:
    """Return how a marker lies whose corners are near `corners` [pixel]; None for a false one."""
    fit = MarkerFit(grey, lens, _cells(dictionary, number), size)
    fits = [f for f in (fit.fit(*pose) for pose in two_poses(corners, size, lens)) if f is not None]
    if not fits:
        return None
    best = min(fits, key=lambda f: f.residual)
    if best.residual > _WORST:
        return None
    others = [f for f in fits if _angle(best, f) > _SAME]
    flat = _square(size) @ best.rotation.T + best.position
    seen = flat @ lens.T
    return Detection(
        id=number,
        corners=seen[:, :2] / seen[:, 2:],
        pose=Pose(
            tuple(best.position.tolist()), tuple(quaternion_from_matrix(best.rotation).tolist())
        ),
        residual=best.residual,
        ambiguity=max((best.residual / f.residual for f in others), default=0.0),
    )


def _once(detections: list[Detection]) -> list[Detection]:
    """Return the best detection of each number, by rising number."""
    best: dict[int, Detection] = {}
    for seen in sorted(detections, key=lambda d: (d.id, d.residual)):
        best.setdefault(seen.id, seen)
    return list(best.values())


def two_poses(corners: Array, size: float, lens: Array) -> list[tuple[Array, Array]]:
    """Return rotation and position of the two squares that look alike, the better one first.

    With OpenCV's `SOLVEPNP_IPPE_SQUARE`, after Collins and Bartoli (2014).

    Args:
        corners: In the picture [pixel], shape [4, 2].
        size: Edge of the square [m].
        lens: Intrinsic matrix [pixel], shape [3, 3].
    """
    _, turns, places, _ = cv2.solvePnPGeneric(
        _square(size), corners.reshape(4, 1, 2), lens, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    return [
        (np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(place, np.float64).reshape(3))
        for turn, place in zip(turns, places, strict=True)
    ]


def _square(size: float) -> Array:
    return size / 2 * np.array(((-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)), np.float64)


def _angle(a: Fit, b: Fit) -> float:
    """Return the angle between two poses [rad]."""
    cosine = (float(np.sum(a.rotation * b.rotation)) - 1) / 2
    return math.acos(min(max(cosine, -1.0), 1.0))


@lru_cache
def _cells(name: str, number: int) -> Array:
    return cells(name, number)


@lru_cache
def _detector(name: str) -> Any:
    options = cv2.aruco.DetectorParameters()
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(opened(name), options)


@dataclass(frozen=True, eq=False)
class Fit:
    """How a marker lies before the camera.

    Attributes:
        rotation: From the marker's axes to the camera's (x right, y down, z forward), shape [3, 3].
        position: Middle of the marker in the camera's frame [m], shape [3].
        residual: Root mean square of what the picture differs from the print, as a share of the
            contrast of white and black.
    """

    rotation: Array
    position: Array
    residual: float


class MarkerFit:
    """The print of a marker over a picture."""

    def __init__(
        self, picture: npt.NDArray[np.uint8], lens: Array, cells: Array, size: float
    ) -> None:
        """Take a picture.

        Args:
            picture: Brightness, shape [height, width].
            lens: Intrinsic matrix [pixel], shape [3, 3]; pixels are counted by their middles.
            cells: The print with its white margin of one cell, as `marker_print.cells`.
            size: Edge of the black square [m].
        """
        self._picture, self._cells = picture, cells
        self._focal, self._middle = np.diag(lens)[:2], lens[:2, 2]
        self._count = len(cells)
        self._half = self._count / 2
        self._scale = (self._count - 2) / size  # [cell/m]

    def fit(self, rotation: Array, position: Array) -> Fit | None:
        """Return the pose near the given one that fits best; None if the print fits nowhere there."""
        residual = np.inf
        for most, still in _STAGES:
            columns, rows = self._pixels(rotation, position, most)
            if len(columns) < self._count**2:  # less than a pixel a cell
                return None
            values = self._picture[rows, columns].astype(np.float64)
            x, y = self._rays(columns, rows)
            for _ in range(_STEPS):
                found = self._step(x, y, values, rotation, position)
                if found is None:
                    return None
                turn, shift, residual = found
                rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64) @ rotation
                position = position + shift * position[2]
                if position[2] <= 0 or rotation[:, 2] @ position >= 0:
                    return None  # behind us, or seen from behind
                radius = self._half / self._scale / position[2]
                moved = np.abs(shift).max() + np.abs(turn).max() * radius
                if moved * self._focal.max() < still:
                    break
        return Fit(rotation, position, residual)

    def _step(
        self, x: Array, y: Array, values: Array, rotation: Array, position: Array
    ) -> tuple[Array, Array, float] | None:
        """Return turn [rad] and shift, as a share of the distance, that fit better, and the residual.

        None if there is no contrast. The residual is that before the step.
        """
        right, down, seen, slopes = self._look(x, y, rotation, position)
        if np.ptp(seen) < 0.5:
            return None
        # Light may change over the marker, evenly.
        spread = np.stack((np.ones(len(x)), right, down))
        light = np.concatenate((spread, seen * spread))
        level = np.linalg.lstsq(light @ light.T, light @ values, rcond=None)[0]
        contrast = level[3]
        if contrast < _LEAST_CONTRAST:
            return None
        rest = values - level @ light
        full = np.concatenate((level[3:] @ spread * slopes, light))
        weighted = full / np.maximum(1.0, np.abs(rest) / (_TRUSTED * contrast))
        normal = weighted @ full.T
        # It may be that no edge falls on a pixel, if rows run along the print.
        normal[np.diag_indices(len(normal))] += _DAMPING * np.trace(normal) / len(normal)
        step = np.linalg.solve(normal, weighted @ rest)
        return step[:3], step[3:6], float(np.sqrt(np.mean(rest**2)) / contrast)

    def _pixels(self, rotation: Array, position: Array, most: int) -> tuple[Indices, Indices]:
        """Return columns and rows of about `most` pixels that show the print and some margin."""
        reach = self._half - 1 + _RIM
        corners = reach / self._scale * np.array(((-1, 1), (1, 1), (1, -1), (-1, -1)))
        seen = corners @ rotation[:, :2].T + position
        flat = seen[:, :2] / np.maximum(seen[:, 2:], 1e-6) * self._focal + self._middle
        low = np.maximum(np.ceil(flat.min(axis=0)), 0).astype(np.intp)
        high = np.minimum(np.floor(flat.max(axis=0)) + 1, self._picture.shape[::-1])
        area = cv2.contourArea(flat.astype(np.float32))
        stride = max(1, int(np.ceil(np.sqrt(area / most))))
        ranges = [np.arange(a, b, stride) for a, b in zip(low, high.astype(np.intp), strict=True)]
        columns, rows = (axis.ravel() for axis in np.meshgrid(*ranges))
        x, y = self._rays(columns, rows)
        _, place = self._places(x, y, rotation, position)
        inside = np.abs(place).max(axis=1) * self._scale < reach
        return columns[inside], rows[inside]

    def _rays(self, columns: Indices, rows: Indices) -> tuple[Array, Array]:
        """Return the slopes of the lines of sight of pixels, to the right and down."""
        (u, v), (width, height) = self._middle, self._focal
        return (columns - u) / width, (rows - v) / height

    @staticmethod
    def _places(x: Array, y: Array, rotation: Array, position: Array) -> tuple[Array, Array]:
        """Return where lines of sight meet the marker: depth [m], and place on it [m], [n, 2]."""
        out = rotation[:, 2]
        depth = (out @ position) / (out[0] * x + out[1] * y + out[2])
        points = depth[:, None] * np.column_stack((x, y, np.ones(len(x))))
        return depth, (points - position) @ rotation[:, :2]

    def _look(
        self, x: Array, y: Array, rotation: Array, position: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return what lines of sight meet.

        That is the place on the print to the right and down from its middle [cell], what is seen
        there in [0, 1], and how that changes with a turn about the marker's middle [1/rad] and a
        shift as a share of the distance, in the camera's axes, shape [6, n].
        """
        depth, place = self._places(x, y, rotation, position)
        arm = place @ rotation[:, :2].T
        # Of the picture with the place on the marker, and its inverse: [n, 2, 2].
        over = (rotation[:2, :2] - np.stack((x, y), 1)[:, :, None] * rotation[2, :2]) / depth[
            :, None, None
        ]
        back = np.empty_like(over)
        back[:, 0, 0], back[:, 1, 1] = over[:, 1, 1], over[:, 0, 0]
        back[:, 0, 1], back[:, 1, 0] = -over[:, 0, 1], -over[:, 1, 0]
        back /= (over[:, 0, 0] * over[:, 1, 1] - over[:, 0, 1] * over[:, 1, 0])[:, None, None]
        # Of the picture with turn and shift: [n, 2, 6].
        moved = np.zeros((len(x), 3, 6))
        moved[:, 0, 1], moved[:, 0, 2] = arm[:, 2], -arm[:, 1]
        moved[:, 1, 0], moved[:, 1, 2] = -arm[:, 2], arm[:, 0]
        moved[:, 2, 0], moved[:, 2, 1] = arm[:, 1], -arm[:, 0]
        moved[:, (0, 1, 2), (3, 4, 5)] = position[2]
        flat = (moved[:, :2] - np.stack((x, y), 1)[:, :, None] * moved[:, 2:]) / depth[
            :, None, None
        ]
        along = -self._scale * (back @ flat)  # [cell], x right and y up
        # A pixel covers a parallelogram; a rectangle along the cells of the same variance is near.
        width = np.linalg.norm(back / self._focal, axis=2) * self._scale
        right, down = place[:, 0] * self._scale, -place[:, 1] * self._scale
        across, across_slope = self._shares(right, width[:, 0])
        below, below_slope = self._shares(down, width[:, 1])
        rows = below @ self._cells
        seen = np.einsum("nj,nj->n", rows, across)
        seen_right = np.einsum("nj,nj->n", rows, across_slope)
        seen_down = np.einsum("nj,nj->n", below_slope @ self._cells, across)
        slopes = seen_right[:, None] * along[:, 0] - seen_down[:, None] * along[:, 1]
        return right, down, seen, slopes.T

    def _shares(self, middle: Array, width: Array) -> tuple[Array, Array]:
        """Return which share of an interval lies in each row of cells, and its slope, [n, cells]."""
        edges = np.arange(self._count + 1) - self._half
        edges[0], edges[-1] = -np.inf, np.inf  # the white goes on
        low, high = middle[:, None] - width[:, None] / 2, middle[:, None] + width[:, None] / 2
        covered = np.clip(edges[1:], low, high) - np.clip(edges[:-1], low, high)
        ends = (edges[:-1] <= high) & (high < edges[1:])
        starts = (edges[:-1] <= low) & (low < edges[1:])
        return covered / width[:, None], (ends.astype(float) - starts) / width[:, None]
