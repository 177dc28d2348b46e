"""Finds ArUco markers in a picture and says how they lie before the camera."""

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

from .marker_fit import Fit, MarkerFit
from .marker_print import DICTIONARIES, cells
from .marker_print import dictionary as opened

if TYPE_CHECKING:
    from rcare_marl.rendering import Camera

_SAME = math.radians(0.5)  # poses nearer than that are one
_WORST = 0.35  # of the contrast; a print that is off by more is no good sign of a pose


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
    out: Array = size / 2 * np.array(((-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)), np.float64)
    return out


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
