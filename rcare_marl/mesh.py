"""Triangle meshes from a few numbers: turned, lofted and swept shapes, with smooth normals.

They come shaded.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from .pose import IDENTITY, Array, Pose, Vector, matrix_from_quaternion

Faces = npt.NDArray[np.int64]

# Of a box: its corners, in halves of its edges, and its sides.
_CORNERS = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
_SIDES = np.array(
    [
        face
        for a, b, c, d in (
            (0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)
        )
        for face in ((a, b, c), (a, c, d))
    ]
)  # fmt: skip


CREASE = math.radians(40)  # edges sharper than this stay sharp; own choice


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh, with normals once it is shaded.

    Attributes:
        vertices: Points [m], shape [n, 3].
        faces: Their indices, outward by right hand, shape [m, 3].
        normals: Unit normals, shape [k, 3].
        corners: Index of the normal at each corner of each face, shape [m, 3].
    """

    vertices: Array
    faces: Faces
    normals: Array | None = None
    corners: Faces | None = None

    def moved(self, pose: Pose) -> Mesh:
        """Return the mesh, given in the frame `pose`, in the frame that `pose` is given in."""
        if pose.quaternion == IDENTITY:
            return Mesh(self.vertices + pose.position, self.faces, self.normals, self.corners)
        back = matrix_from_quaternion(pose.quaternion).T
        normals = None if self.normals is None else self.normals @ back
        return Mesh(self.vertices @ back + pose.position, self.faces, normals, self.corners)

    def stretched(self, scale: Vector) -> Mesh:
        """Return the mesh stretched along its axes by `scale`, shape [3]."""
        normals = None if self.normals is None else _unit(self.normals / scale)
        return Mesh(self.vertices * scale, self.faces, normals, self.corners)

    def copies(self, scales: Array, turns: Array, at: Array) -> Mesh:
        """Return many copies as one mesh, which takes less time than to make and to merge them.

        Args:
            scales: Factors along its axes, shape [n, 3].
            turns: Quaternions, shape [n, 4].
            at: Places of its origin [m], shape [n, 3].
        """
        mesh, number = self.shaded(), np.arange(len(at))[:, None, None]
        assert mesh.normals is not None and mesh.corners is not None
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
        if self.normals is not None:
            return self
        normals, index = _distinct(_corner_normals(self, crease))
        return Mesh(self.vertices, self.faces, normals, index.reshape(-1, 3))

    def obj(self) -> str:
        """Return the mesh as Wavefront OBJ text."""
        mesh = self.shaded()
        assert mesh.normals is not None and mesh.corners is not None
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
    """Return one mesh of all the triangles."""
    vertices, faces, normals, corners, count, turns = [], [], [], [], 0, 0
    for mesh in meshes:
        shaded = mesh.shaded()
        assert shaded.normals is not None and shaded.corners is not None
        vertices.append(shaded.vertices)
        faces.append(shaded.faces + count)
        normals.append(shaded.normals)
        corners.append(shaded.corners + turns)
        count += len(shaded.vertices)
        turns += len(shaded.normals)
    return Mesh(
        np.concatenate(vertices),
        np.concatenate(faces),
        np.concatenate(normals),
        np.concatenate(corners),
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
    ends = [np.tile(ring.mean(axis=0), (segments, 1)) for ring in (rings[0], rings[-1])]
    return _skin([ends[0], *rings, ends[1]]).shaded(_crease(segments))


def box(size: Vector, bevel: float = 0.0, steps: int = 4) -> Mesh:
    """Return a box with edges `size` [m], shape [3], rounded by the radius `bevel` [m].

    Each edge is rounded by `steps` strips.
    """
    half = 0.5 * np.asarray(size, np.float64)
    if bevel <= 0:
        return cube().stretched(half)
    radius = min(bevel, float(half.min()) * 0.999)
    ball = _parted_ball(steps)
    assert ball.normals is not None
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
    ends = [np.broadcast_to(ring.mean(axis=0), ring.shape) for ring in (rings[0], rings[-1])]
    return _skin([ends[0], *rings, ends[1]]).shaded(_crease(segments))


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
    out: Array = (
        (1 + 2 * t) * (1 - t) ** 2 * values[i]
        + t * (1 - t) ** 2 * slopes[i]
        + t**2 * (3 - 2 * t) * values[i + 1]
        + t**2 * (t - 1) * slopes[i + 1]
    )
    return out


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


def _crease(segments: int) -> float:
    """Return the crease of a round mesh [rad], at which few points round it are still smooth."""
    return max(CREASE, 1.25 * 2 * math.pi / segments)


def _corner_normals(mesh: Mesh, crease: float) -> Array:
    """Return a unit normal for each corner of each face, shape [3 m, 3]."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)
    units = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    corners = mesh.faces.reshape(-1)
    order = np.argsort(corners, kind="stable")
    counts = np.bincount(corners, minlength=len(mesh.vertices))
    starts = np.cumsum(counts) - counts
    # Each corner meets every corner at its vertex: one row for each such pair.
    repeats = counts[corners]
    left = np.repeat(np.arange(len(corners)), repeats)
    within = np.arange(len(left)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    right = order[starts[corners[left]] + within]
    close = np.einsum("ij,ij->i", units[left // 3], units[right // 3]) > math.cos(crease)
    met = np.where(close[:, None], areas[right // 3], 0.0)
    return _unit(np.add.reduceat(met, np.cumsum(repeats) - repeats))


def _unit(normals: Array) -> Array:
    """Return vectors of length one; up where there is none."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    out: Array = np.where(length > 1e-300, normals / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))
    return out


def _distinct(normals: Array) -> tuple[Array, Faces]:
    """Return normals without those that look the same as another, and where each went, shape [n]."""
    fine = 10_000
    steps = np.rint(normals * fine).astype(np.int64) + fine
    code = (steps[:, 0] * (2 * fine + 1) + steps[:, 1]) * (2 * fine + 1) + steps[:, 2]
    _, first, index = np.unique(code, return_index=True, return_inverse=True)
    return normals[first], index.reshape(-1)
