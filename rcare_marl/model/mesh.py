"""Triangle meshes from a few numbers: turned, lofted and swept shapes, with smooth normals.

They come shaded.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.pose import IDENTITY, Array, Pose, Vector, matrix_from_quaternion

Faces = npt.NDArray[np.int64]

# Of a box: its corners, in halves of its edges, and its sides.
_CORNERS = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
_RINGS = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
_SIDES = np.array(_RINGS)[:, ((0, 1, 2), (0, 2, 3))].reshape(-1, 3)


CREASE = math.radians(40)  # edges sharper than this stay sharp; own choice
_PAIRS = 1 << 20  # of corners that are looked at at once: fans of many faces take much memory


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh, with normals once it is shaded.

    Attributes:
        vertices: Points [m], shape [n, 3].
        faces: Their indices, outward by right hand, shape [m, 3].
        normals: Unit normals, shape [k, 3]; none before it is shaded.
        corners: Index of the normal at each corner of each face, shape [m, 3]; as `faces` where there is a
            normal for each vertex.
        colors: sRGB colours of the vertices, shape [n, 3]; None where there are none.
        closed: Whether it is known that its inside can never be seen.
    """

    vertices: npt.NDArray[Any]
    faces: npt.NDArray[Any]
    normals: npt.NDArray[Any] = field(default_factory=lambda: np.zeros((0, 3)))
    corners: npt.NDArray[Any] = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    colors: npt.NDArray[np.uint8] | None = None
    closed: bool = False

    def moved(self, pose: Pose) -> Mesh:
        """Return the mesh, given in the frame `pose`, in the frame that `pose` is given in."""
        if pose.quaternion == IDENTITY:
            return replace(self, vertices=self.vertices + pose.position)
        back = matrix_from_quaternion(pose.quaternion).T
        turned = self.vertices @ back + pose.position
        return replace(self, vertices=turned, normals=self.normals @ back)

    def stretched(self, scale: Vector) -> Mesh:
        """Return the mesh stretched along its axes by `scale`, shape [3]."""
        return replace(self, vertices=self.vertices * scale, normals=_unit(self.normals / scale))

    def copies(self, scales: Array, turns: Array, at: Array) -> Mesh:
        """Return many copies as one mesh, which takes less time than to make and to merge them.

        Args:
            scales: Factors along its axes, shape [n, 3].
            turns: Quaternions, shape [n, 4].
            at: Places of its origin [m], shape [n, 3].
        """
        mesh, number = self.shaded(), np.arange(len(at))[:, None, None]
        back = matrix_from_quaternion(turns.T).transpose(2, 1, 0)
        vertices = (mesh.vertices * scales[:, None]) @ back + at[:, None]
        normals = _unit((mesh.normals / scales[:, None]).reshape(-1, 3))
        return Mesh(
            vertices.reshape(-1, 3),
            (mesh.faces + number * len(mesh.vertices)).reshape(-1, 3),
            (normals.reshape(len(at), -1, 3) @ back).reshape(-1, 3),
            (mesh.corners + number * len(mesh.normals)).reshape(-1, 3),
        )

    def shaded(self, crease: float = CREASE) -> Mesh:
        """Return the mesh with normals, smooth but at edges sharper than `crease` [rad]."""
        if len(self.corners) or not len(self.faces):
            return self
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        places = self.faces.reshape(-1)
        normals, index = _distinct(corner_normals(places, np.cross(b - a, c - a), crease))
        return replace(self, normals=normals, corners=index.reshape(-1, 3))

    def obj(self) -> str:
        """Return the mesh as Wavefront OBJ text."""
        mesh = self.shaded()
        normals, index = _distinct(mesh.normals)
        normals = np.round(normals, 4) + 0.0  # no minus zeros
        corners = np.stack((self.faces, index[mesh.corners]), axis=2) + 1
        return "".join(
            (row * len(table)) % tuple(table.ravel().tolist())
            for row, table in (
                ("v %.6g %.6g %.6g\n", self.vertices),
                ("vn %.4g %.4g %.4g\n", normals),
                ("f %d//%d %d//%d %d//%d\n", corners),
            )
        )


def merge(meshes: Iterable[Mesh]) -> Mesh:
    """Return one mesh of all the triangles; what has no colours becomes white if another has."""
    parts = [mesh.shaded() for mesh in meshes]
    vertices = np.cumsum([0] + [len(part.vertices) for part in parts]).tolist()
    normals = np.cumsum([0] + [len(part.normals) for part in parts]).tolist()
    white = [np.full((len(part.vertices), 3), 255, np.uint8) for part in parts]
    is_colored = any(part.colors is not None for part in parts)
    colors = [
        w if part.colors is None else part.colors for part, w in zip(parts, white, strict=True)
    ]
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + n for part, n in zip(parts, vertices, strict=False)]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.corners + n for part, n in zip(parts, normals, strict=False)]),
        np.concatenate(colors) if is_colored else None,
        all(part.closed for part in parts),
    )


def lathe(profile: Sequence[Sequence[float]], segments: int = 36) -> Mesh:
    """Turn `profile`, points (radius, z) [m], about z. Ends off the axis are closed flat.

    Going up in z outside, the surface faces outward.
    """
    points = [(float(r), float(z)) for r, z in profile]
    if points[0] != points[-1]:  # an open profile: close it on the axis
        points = [(0.0, points[0][1]), *points, (0.0, points[-1][1])]
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    circle = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    rings = [np.column_stack((r * circle, np.full(segments, z))) for r, z in points]
    return _skin(rings).shaded(_crease(segments))


def loft(sections: Sequence[Sequence[float]], segments: int = 36) -> Mesh:
    """Join ellipses along z by a smooth skin, closed flat at both ends.

    Args:
        sections: Rows (z, centre x, centre y, half width x, half width y) [m], z rising.
        segments: Points round each ellipse.
    """
    rows = np.asarray(sections, np.float64)
    fine = np.linspace(0, len(rows) - 1, 5 * (len(rows) - 1) + 1)
    rows = np.column_stack([_monotone(fine, rows[:, k]) for k in range(5)])
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    x, y = np.cos(angle), np.sin(angle)
    rings = [
        np.column_stack((cx + rx * x, cy + ry * y, np.full(segments, z)))
        for z, cx, cy, rx, ry in rows
    ]
    return _capped(rings)


def box(size: Vector, bevel: float = 0.0, steps: int = 4) -> Mesh:
    """Return a box with edges `size` [m], shape [3], rounded by the radius `bevel` [m].

    Each edge is rounded by `steps` strips.
    """
    half = 0.5 * np.asarray(size, np.float64)
    if bevel <= 0:
        return cube().stretched(half)
    radius = min(bevel, float(half.min()) * 0.999)
    ball = _parted_ball(steps)
    vertices = (half - radius) * ball.vertices + radius * ball.normals
    return Mesh(vertices, ball.faces, ball.normals, ball.faces)


@lru_cache
def cube() -> Mesh:
    """Return a cube from -1 to 1 [m]."""
    return Mesh(_CORNERS, _SIDES).shaded()


@lru_cache
def ball(segments: int) -> Mesh:
    """Return a sphere of radius 1 [m]."""
    return capsule(1.0, 0.0, segments)


@lru_cache
def rod(segments: int) -> Mesh:
    """Return a cylinder of radius 1 and length 1 along z about the origin [m]."""
    return lathe([(1.0, -0.5), (1.0, 0.5)], segments)


@lru_cache
def _parted_ball(steps: int) -> Mesh:
    """Return what makes a rounded box: a ball in eight parts that are pulled to the box's corners.

    Its normals are the points of the ball, its vertices the corner that each is pulled to.
    """
    quarter = np.linspace(0, np.pi / 2, steps + 1)
    turn = np.concatenate([quarter + k * np.pi / 2 for k in range(4)])
    around = np.stack((np.cos(turn), np.sin(turn), np.zeros(len(turn))), axis=1)
    pulls = np.repeat(((1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)), steps + 1, axis=0)
    rings = []
    for side in (-1.0, 1.0):
        up = np.array((0.0, 0.0, side))
        halves = [math.cos(t) * around + abs(math.sin(t)) * up for t in quarter]
        # Half of the pull and half of the ball: points that lie together in both are one point.
        half = [up, *(0.5 * (pulls + up + ball) for ball in reversed(halves))]
        rings += [
            np.broadcast_to(ring, around.shape) for ring in (half if side < 0 else half[::-1])
        ]
    drawn = _skin(rings)
    corners = np.sign(np.round(drawn.vertices, 6))
    return Mesh(corners, drawn.faces, 2 * drawn.vertices - corners, drawn.faces)


def quads(points: Sequence[Sequence[float]]) -> Mesh:
    """Return flat four-sided faces, each by its corners, anticlockwise from outside, shape [4 n, 3]."""
    vertices = np.asarray(points, np.float64)
    number = np.arange(len(vertices) // 4)[:, None, None]
    faces = (4 * number + np.array(((0, 1, 2), (0, 2, 3)))).reshape(-1, 3)
    p, q, r, s = vertices.reshape(-1, 4, 3).transpose(1, 0, 2)
    corners = np.broadcast_to(number, (len(number), 2, 3)).reshape(-1, 3)
    return Mesh(vertices, faces, _unit(np.cross(r - p, s - q)), corners)


def capsule(radius: float, length: float, segments: int = 24) -> Mesh:
    """Return a capsule along z about the origin; `length` [m] is that between the cap centres."""
    tilt = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 2)
    z = radius * np.sin(tilt) + np.sign(tilt) * length / 2
    profile = np.column_stack((radius * np.cos(tilt), z))
    if length > 0 and segments % 4 == 0:
        middle = len(profile) // 2
        profile = np.insert(profile, middle, (radius, -length / 2), axis=0)
    return lathe(profile.tolist(), segments)


def tube(
    points: Sequence[Sequence[float]],
    radius: float,
    bend: float = 0.0,
    segments: int = 14,
    steps: int = 6,
) -> Mesh:
    """Sweep a circle of `radius` along `points`, the corners rounded by `bend` [m] in `steps`."""
    path = _rounded(np.asarray(points, np.float64), bend, steps)
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    sides = _untwisted(tangents)
    others = np.cross(tangents, sides)
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)[:, None]
    around = np.cos(angle) * sides[:, None] + np.sin(angle) * others[:, None]
    rings = list(path[:, None] + radius * around)
    return _capped(rings)


def _untwisted(tangents: Array) -> Array:
    """Return a direction across each tangent, shape [n, 3], carried along a path without twist."""
    rows = tangents.tolist()
    side = np.cross(rows[0], np.eye(3)[int(np.argmin(np.abs(rows[0])))]).tolist()
    out = []
    for tangent in rows:  # in plain numbers: arrays this short take ten times as long
        along = sum(a * b for a, b in zip(side, tangent, strict=True))
        side = [a - along * b for a, b in zip(side, tangent, strict=True)]
        length = math.sqrt(sum(a * a for a in side))
        side = [a / length for a in side]
        out.append(side)
    return np.array(out)


def _rounded(points: Array, bend: float, steps: int) -> Array:
    if bend <= 0 or len(points) < 3:
        return points
    path = [points[0]]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        to_before, to_after = before - corner, after - corner
        reach = min(bend, 0.49 * np.linalg.norm(to_before), 0.49 * np.linalg.norm(to_after))
        start = corner + reach * to_before / np.linalg.norm(to_before)
        end = corner + reach * to_after / np.linalg.norm(to_after)
        for s in np.linspace(0, 1, steps + 1):
            path.append((1 - s) ** 2 * start + 2 * s * (1 - s) * corner + s**2 * end)
    return np.array([*path, points[-1]])


def _monotone(at: Array, values: Array) -> Array:
    """Interpolate `values`, given at 0, 1, 2, ..., without overshoot (Fritsch-Carlson)."""
    steps = np.diff(values)
    slopes = np.zeros(len(values))
    same = steps[:-1] * steps[1:] > 0
    slopes[1:-1][same] = 2 / (1 / steps[:-1][same] + 1 / steps[1:][same])
    slopes[0], slopes[-1] = steps[0], steps[-1]
    i = np.minimum(at.astype(int), len(values) - 2)
    t = at - i
    return (
        (1 + 2 * t) * (1 - t) ** 2 * values[i]
        + t * (1 - t) ** 2 * slopes[i]
        + t**2 * (3 - 2 * t) * values[i + 1]
        + t**2 * (t - 1) * slopes[i + 1]
    )


def _skin(rings: Sequence[Array]) -> Mesh:
    """Join closed rings of equally many points, welding points that coincide."""
    count = len(rings[0])
    vertices = np.concatenate(rings)
    here = np.arange(count)
    after = np.roll(here, -1)
    faces = []
    for k in range(len(rings) - 1):
        low, high = k * count, (k + 1) * count
        faces.append(np.stack((low + here, low + after, high + after), axis=1))
        faces.append(np.stack((low + here, high + after, high + here), axis=1))
    ranks = [np.unique(axis, return_inverse=True)[1] for axis in np.round(vertices, 7).T]
    code = (ranks[0] * len(vertices) + ranks[1]) * len(vertices) + ranks[2]
    _, first, index = np.unique(code, return_index=True, return_inverse=True)
    welded = index[np.concatenate(faces)]
    a, b, c = welded.T
    return Mesh(vertices[first], welded[(a != b) & (b != c) & (c != a)])


def _capped(rings: Sequence[Array]) -> Mesh:
    """Join rings of equally many points and close both ends flat."""
    ends = [np.broadcast_to(ring.mean(axis=0), ring.shape) for ring in (rings[0], rings[-1])]
    return _skin([ends[0], *rings, ends[1]]).shaded(_crease(len(rings[0])))


def _crease(segments: int) -> float:
    """Return the crease of a round mesh [rad], at which few points round it are still smooth."""
    return max(CREASE, 1.25 * 2 * math.pi / segments)


def corner_normals(places: npt.NDArray[Any], areas: Array, crease: float) -> Array:
    """Return a unit normal for each corner of each face, shape [3 m, 3].

    It is the area-weighted mean over the faces around its place whose own normals lie within the crease
    of its face's.

    Args:
        places: Number of the place of each corner, shape [3 m].
        areas: Area vector of each face, shape [m, 3].
        crease: Greatest angle between faces that are one smooth surface [rad].
    """
    units = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    order = np.argsort(places, kind="stable")
    counts = np.bincount(places)
    starts = np.cumsum(counts) - counts
    # Each corner meets every corner at its place: one row for each such pair.
    repeats = counts[places]
    ends = np.cumsum(repeats)
    out, first = np.empty((len(places), 3)), 0
    while first < len(places):
        before = ends[first] - repeats[first]
        last = max(first + 1, int(np.searchsorted(ends, before + _PAIRS, side="right")))
        own, here = repeats[first:last], ends[first:last] - before
        left = np.repeat(np.arange(first, last), own)
        within = np.arange(len(left)) - np.repeat(here - own, own)
        right = order[starts[places[left]] + within]
        close = np.einsum("ij,ij->i", units[left // 3], units[right // 3]) > math.cos(crease)
        met = np.where(close[:, None], areas[right // 3], 0.0)
        out[first:last] = np.add.reduceat(met, here - own)
        first = last
    return _unit(out)


def _unit(normals: Array) -> Array:
    """Return vectors of length one; up where there is none."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 1e-300, normals / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))


def _distinct(normals: Array) -> tuple[Array, Faces]:
    """Return normals without those that look the same as another, and where each went, shape [n]."""
    fine = 10_000
    steps = np.rint(normals * fine).astype(np.int64) + fine
    code = (steps[:, 0] * (2 * fine + 1) + steps[:, 1]) * (2 * fine + 1) + steps[:, 2]
    _, first, index = np.unique(code, return_index=True, return_inverse=True)
    return normals[first], index.reshape(-1)
