"""Surface normals out of a picture of depths."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .mesh import Floats

Array = npt.NDArray[np.float64]
_BEND = 2e-3  # relative change of slope from pixel to pixel above which there may be an edge
_AGREEMENT = 1e-3  # relative distance from the plane of a neighbour below which a pixel is on it
_AROUND = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


def normals_from_depth(camera: Camera, depth: npt.NDArray[Any], labels: npt.NDArray[Any]) -> Floats:
    """Return unit normals in the optical frame, shape [height, width, 3]; zero for nothing.

    On each axis both neighbours of the same label count, or the one across which the slope changes
    less where there is an edge. A pixel where that does not tell either takes the normal of a pixel
    around it in whose plane it lies.

    Args:
        camera: Who took the picture.
        depth: Along the optical axis [m], shape [height, width]; inf for nothing.
        labels: What is seen, shape [height, width]: neighbours count where they are the same.
    """
    points = camera.rays() * np.where(np.isfinite(depth), depth, np.nan)[:, :, None]
    across, bend_across = _slope(points, depth, labels, axis=1)
    down, bend_down = _slope(points, depth, labels, axis=0)
    normals = np.cross(down, across)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        normals *= -np.sign(np.einsum("ijk,ijk->ij", normals, points))[:, :, None]
        is_sure = np.maximum(bend_across, bend_down) * depth < _BEND
    normals = _borrowed(normals, points, labels, is_sure)
    return np.nan_to_num(normals, nan=0.0).astype(np.float32)


def _slope(
    points: Array, depth: npt.NDArray[Any], labels: npt.NDArray[Any], axis: int
) -> tuple[Array, Array]:
    """Return the step to the next pixel along an axis, on the better side, and how it bends there."""
    with np.errstate(divide="ignore"):
        inverse = 1 / depth.astype(np.float64)  # linear across a flat thing
    steps, bends = [], []
    for side in (-1, 1):
        step = side * (_beside(points, side, axis) - points)
        lost = _beside(labels, side, axis) != labels
        lost |= _is_edge(depth.shape, axis, side)
        alone = _beside(labels, 2 * side, axis) != labels
        alone |= _is_edge(depth.shape, axis, 2 * side)
        bend = _beside(inverse, 2 * side, axis) - 2 * _beside(inverse, side, axis) + inverse
        steps.append(np.where(lost[:, :, None], np.nan, step))
        bends.append(np.where(lost, np.inf, np.where(alone, 1e6, np.abs(bend))))
    with np.errstate(invalid="ignore"):
        is_smooth = np.maximum(*bends) * depth < _BEND
    is_first = bends[0] < bends[1]
    step = np.where(is_first[:, :, None], *steps)
    step = np.where(is_smooth[:, :, None], 0.5 * (steps[0] + steps[1]), step)
    return step, np.where(is_first, *bends)


def _borrowed(
    normals: Array, points: Array, labels: npt.NDArray[Any], is_sure: npt.NDArray[np.bool_]
) -> Array:
    """Return normals in which unsure pixels have taken those of sure ones whose plane they lie in."""
    rows, columns = np.nonzero(~is_sure & np.isfinite(points[:, :, 2]))
    best = np.full(len(rows), _AGREEMENT)
    out = normals.copy()
    here, label = points[rows, columns], labels[rows, columns]
    for down, right in _AROUND:
        r = np.clip(rows + down, 0, labels.shape[0] - 1)
        c = np.clip(columns + right, 0, labels.shape[1] - 1)
        off = np.abs(np.einsum("ij,ij->i", normals[r, c], here - points[r, c])) / here[:, 2]
        taken = is_sure[r, c] & (labels[r, c] == label) & (off < best)
        best[taken] = off[taken]
        out[rows[taken], columns[taken]] = normals[r[taken], c[taken]]
    return out


def _beside(array: npt.NDArray[Any], steps: int, axis: int) -> npt.NDArray[Any]:
    """Return for each pixel the value that many pixels on."""
    return np.roll(array, -steps, axis)


def _is_edge(shape: tuple[int, ...], axis: int, steps: int) -> npt.NDArray[np.bool_]:
    """Return which pixels have no other that many pixels on."""
    place = np.arange(shape[axis]) + steps
    out = (place < 0) | (place >= shape[axis])
    return np.broadcast_to(out if axis == 1 else out[:, None], shape)
