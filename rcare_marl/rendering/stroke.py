"""Lines for backends that draw no tubes: as segments, or painted onto a finished picture."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..world import Lines, Skin
from .camera import Camera
from .mesh import Bytes, Floats

_SPACING = 0.7  # [pixel] between the dots that make a stroke


def segments(starts: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the two points of each segment of polylines that begin at `starts`, shape [s, 2]."""
    first = np.setdiff1d(np.arange(starts[-1]), starts[1:] - 1)
    return np.column_stack((first, first + 1))


def skin_opacity(skin: Skin) -> float:
    """Return the mean opacity of a skin, in [0, 1]."""
    return float(skin.colors[:, 3].mean()) / 255 if skin.colors.shape[1] == 4 else 1.0


def paint(lines: Lines, camera: Camera, picture: Bytes, distance: Floats) -> None:
    """Paint lines into a picture where nothing stands before them, with their distance.

    Args:
        lines: What to paint.
        camera: Who took the picture.
        picture: Shape [height, width, 3]; it is changed.
        distance: Along the line of sight [m], shape [height, width]; it is changed.
    """
    ends = segments(lines.starts)
    view = camera.view()
    place = lines.points().astype(np.float64) @ view[:3, :3].T + view[:3, 3]
    focal, middle = np.array(camera.focal), camera.principal
    a, b = place[ends[:, 0]], place[ends[:, 1]]
    seen = (-a[:, 2] > camera.near) & (-b[:, 2] > camera.near)
    a, b, ends = a[seen], b[seen], ends[seen]
    if not len(ends):
        return
    flat = np.stack((a[:, :2] / -a[:, 2:], b[:, :2] / -b[:, 2:])) * focal
    reach = np.linalg.norm(flat[1] - flat[0], axis=1)
    count = np.clip(np.ceil(reach / _SPACING), 1, 4 * max(camera.width, camera.height)).astype(int)
    which = np.repeat(np.arange(len(ends)), count + 1)
    step = np.arange(len(which)) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
    share = (step / count[which])[:, None]
    at = a[which] * (1 - share) + b[which] * share
    tint = lines.colors().astype(np.float64)
    tint = tint[ends[which, 0]] * (1 - share) + tint[ends[which, 1]] * share
    radius = (
        lines.radii[ends[which, 0]] * (1 - share[:, 0]) + lines.radii[ends[which, 1]] * share[:, 0]
    )
    column = at[:, 0] / -at[:, 2] * focal[0] + middle[0]
    row = middle[1] - at[:, 1] / -at[:, 2] * focal[1]
    _dab(picture, distance, row, column, -at[:, 2] - radius, radius * focal[1] / -at[:, 2], tint)


def _dab(
    picture: Bytes,
    distance: Floats,
    row: npt.NDArray[np.float64],
    column: npt.NDArray[np.float64],
    depth: npt.NDArray[np.float64],
    radius: npt.NDArray[np.float64],
    tint: npt.NDArray[np.float64],
) -> None:
    """Paint round dots, the nearest last, each where it is nearer than the picture."""
    height, width = distance.shape
    most = math.ceil(min(float(radius.max()), 0.1 * height))
    order = np.argsort(-depth, kind="stable")
    across = np.arange(-most, most + 1)
    for down, right in ((i, j) for i in across for j in across):
        chosen = order[np.hypot(down, right) <= np.maximum(radius[order], 0.5)]
        r = np.round(row[chosen]).astype(np.int64) + down
        c = np.round(column[chosen]).astype(np.int64) + right
        inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
        r, c, chosen = r[inside], c[inside], chosen[inside]
        front = depth[chosen] < distance[r, c]
        r, c, chosen = r[front], c[front], chosen[front]
        np.minimum.at(distance, (r, c), depth[chosen].astype(np.float32))
        kept = depth[chosen].astype(np.float32) <= distance[r, c]
        picture[r[kept], c[kept]] = tint[chosen[kept]].astype(np.uint8)
