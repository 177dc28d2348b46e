"""How lines are drawn: as round tubes, as segments, or painted onto a finished picture."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..world import Lines, Skin
from .camera import Camera
from .mesh import Bytes, Floats, Ints

SIDES = 8
# Rings that close an end: how far out of it and how wide, in radii.
_CAP = ((1.0, 0.0), (0.71, 0.71))
_EXTRA = len(_CAP)
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


class TubeMesh:
    """The triangles of tubes around polylines; points and radii may change, the numbers may not.

    Attributes:
        faces: Vertex indices, counter-clockwise from outside, shape [f, 3].
        vertex_count: How many vertices there are.
    """

    def __init__(self, starts: npt.NDArray[np.int64]) -> None:
        """Prepare tubes around polylines of at least two points each.

        Args:
            starts: First point of each polyline, and the end of the last, shape [m + 1].
        """
        counts = np.diff(starts)
        self._starts, self._counts = starts[:-1], counts
        rings = counts + 2 * _EXTRA
        first = np.concatenate(([0], np.cumsum(rings)))
        self.vertex_count = int(first[-1]) * SIDES
        # The point of each ring, and how far out of an end it lies and how wide it is there.
        self._source = np.empty(first[-1], np.int64)
        self._out = np.zeros(first[-1], np.float32)
        self._width = np.ones(first[-1], np.float32)
        for i, (begin, count) in enumerate(zip(starts[:-1], counts, strict=True)):
            row = np.arange(-_EXTRA, count + _EXTRA)
            mine = slice(first[i], first[i + 1])
            self._source[mine] = begin + np.clip(row, 0, count - 1)
            for k, (out, width) in enumerate(_CAP):
                for ring, sign in ((first[i] + k, -1), (first[i + 1] - 1 - k, 1)):
                    self._out[ring], self._width[ring] = sign * out, width
        self._longest = int(counts.max(initial=0))
        angle = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
        self._circle = np.column_stack((np.cos(angle), np.sin(angle))).astype(np.float32)
        self.faces = self._find_faces(first)

    def _find_faces(self, first: npt.NDArray[np.int64]) -> Ints:
        inner = np.ones(first[-1], np.bool_)
        inner[first[1:] - 1] = False
        ring = np.flatnonzero(inner)[:, None] * SIDES
        here = np.arange(SIDES)
        after = np.roll(here, -1)
        a, b = ring + here, ring + after
        c, d = a + SIDES, b + SIDES
        both = np.stack((np.stack((a, b, c), axis=-1), np.stack((b, d, c), axis=-1)), axis=2)
        return both.reshape(-1, 3).astype(np.int32)

    def surface(self, points: Floats, radii: Floats) -> tuple[Floats, Floats]:
        """Return vertices [m] and normals, shape [vertex_count, 3], around points [m], [p, 3]."""
        along, right = self._frames(points)
        forward = np.cross(along, right)
        ring, radius = self._source, radii[self._source][:, None, None]
        across = (
            self._circle[None, :, :1] * right[ring][:, None]
            + self._circle[None, :, 1:] * forward[ring][:, None]
        )
        tilt = self._out[:, None, None] * along[ring][:, None]
        spread = self._width[:, None, None] * across
        vertices = points[ring][:, None] + radius * (tilt + spread)
        normals = (tilt + spread).reshape(-1, 3)
        return vertices.reshape(-1, 3).astype(np.float32), normals.astype(np.float32)

    def _frames(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the direction along the tube and one across it at each point, shape [p, 3]."""
        steps = np.zeros_like(points)
        steps[:-1] = np.diff(points, axis=0)
        last = self._starts + self._counts - 1
        steps[last] = 0.0
        length = np.linalg.norm(steps, axis=1, keepdims=True)
        steps /= np.maximum(length, 1e-9)
        along = steps.copy()
        along[1:] += steps[:-1]  # the step before; none into a first point, as each last step is 0
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        lost = ~np.any(along, axis=1)
        along[lost] = (0.0, 0.0, 1.0)
        right = np.empty_like(points)
        first = along[self._starts]
        axis = np.eye(3, dtype=points.dtype)[np.argmin(np.abs(first), axis=1)]
        carried = _across(axis, first)
        for k in range(self._longest):  # carried on from point to point, so that no tube is twisted
            mine = self._counts > k
            at = self._starts[mine] + k
            carried[mine] = _across(carried[mine], along[at])
            right[at] = carried[mine]
        return along, right

    def spread(self, colors: Bytes) -> Bytes:
        """Return the colour of each vertex from that of each point, shape [vertex_count, 3]."""
        return np.repeat(colors[self._source], SIDES, axis=0)


def _across(vector: npt.NDArray[Any], axis: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return unit vectors, shape [n, 3]: what of `vector` stands across `axis`."""
    out = vector - (vector * axis).sum(axis=1, keepdims=True) * axis
    length = np.linalg.norm(out, axis=1, keepdims=True)
    other = np.cross(axis, np.roll(axis, 1, axis=1) + (0.31, 0.17, 0.53))
    other /= np.maximum(np.linalg.norm(other, axis=1, keepdims=True), 1e-9)
    return np.where(length > 1e-4, out / np.maximum(length, 1e-9), other)
