"""Triangle meshes from a few numbers: turned, lofted and swept shapes, with smooth normals."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .pose import Array, Pose, Vector, matrix_from_quaternion

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


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh: vertices [m], shape [n, 3]; faces, shape [m, 3], outward by right hand."""

    vertices: Array
    faces: Faces

    def moved(self, pose: Pose) -> Mesh:
        """Return the mesh, given in the frame `pose`, in the frame that `pose` is given in."""
        turn = matrix_from_quaternion(pose.quaternion)
        return Mesh(self.vertices @ turn.T + np.asarray(pose.position), self.faces)

    def obj(self, crease: float = math.radians(40)) -> str:
        """Return the mesh as Wavefront OBJ text; edges sharper than `crease` [rad] stay sharp."""
        normals = _corner_normals(self, crease)
        unique, index = np.unique(np.round(normals, 4), axis=0, return_inverse=True)
        rows = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in self.vertices]
        rows += [f"vn {x:.4g} {y:.4g} {z:.4g}" for x, y, z in unique]
        corners = index.reshape(-1, 3) + 1
        rows += [
            f"f {a}//{p} {b}//{q} {c}//{r}"
            for (a, b, c), (p, q, r) in zip(self.faces + 1, corners, strict=True)
        ]
        return "\n".join(rows) + "\n"


def merge(meshes: Iterable[Mesh]) -> Mesh:
    """Return one mesh of all the triangles."""
    vertices, faces, count = [], [], 0
    for mesh in meshes:
        vertices.append(mesh.vertices)
        faces.append(mesh.faces + count)
        count += len(mesh.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


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
    return _skin(rings)


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
    return _skin([ends[0], *rings, ends[1]])


def box(size: Vector, bevel: float = 0.0, steps: int = 4) -> Mesh:
    """Return a box with edges `size` [m], shape [3], rounded by the radius `bevel` [m]."""
    half = 0.5 * np.asarray(size, np.float64)
    if bevel <= 0:
        return Mesh(half * _CORNERS, _SIDES)
    radius = min(bevel, float(half.min()) * 0.999)
    quarter = np.linspace(0, np.pi / 2, steps + 1)
    rings = []
    for side in (-1.0, 1.0):  # lower and upper half of a sphere, pulled apart
        for tilt in quarter - (np.pi / 2 if side < 0 else 0):
            ring = []
            for corner, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
                for turn in quarter + corner * np.pi / 2:
                    on_sphere = radius * np.array(
                        (np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt))
                    )
                    ring.append(on_sphere + (half - radius) * (sx, sy, side))
            rings.append(np.array(ring))
    ends = [np.tile(ring.mean(axis=0), (len(ring), 1)) for ring in (rings[0], rings[-1])]
    return _skin([ends[0], *rings, ends[1]])


def quads(points: Sequence[Sequence[float]]) -> Mesh:
    """Return flat four-sided faces, each by its corners, anticlockwise from outside, shape [4 n, 3]."""
    first = 4 * np.arange(len(points) // 4)[:, None, None]
    faces = (first + np.array(((0, 1, 2), (0, 2, 3)))).reshape(-1, 3)
    return Mesh(np.asarray(points, np.float64), faces)


def sphere(radius: float, segments: int = 24) -> Mesh:
    """Return a sphere of `radius` [m]."""
    return capsule(radius, 0.0, segments)


def cylinder(radius: float, length: float, segments: int = 36) -> Mesh:
    """Return a cylinder along z about the origin [m]."""
    return lathe([(radius, -length / 2), (radius, length / 2)], segments)


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
    points: Sequence[Sequence[float]], radius: float, bend: float = 0.0, segments: int = 14
) -> Mesh:
    """Sweep a circle of `radius` along `points`, the corners rounded by `bend` [m]."""
    path = _rounded(np.asarray(points, np.float64), bend)
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    side = np.cross(tangents[0], np.eye(3)[int(np.argmin(np.abs(tangents[0])))])
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)[:, None]
    rings = []
    for point, tangent in zip(path, tangents, strict=True):
        side = side - tangent * float(side @ tangent)  # carried along without twist
        side /= np.linalg.norm(side)
        other = np.cross(tangent, side)
        rings.append(point + radius * (np.cos(angle) * side + np.sin(angle) * other))
    ends = [np.tile(ring.mean(axis=0), (segments, 1)) for ring in (rings[0], rings[-1])]
    return _skin([ends[0], *rings, ends[1]])


def _rounded(points: Array, bend: float, steps: int = 7) -> Array:
    if bend <= 0 or len(points) < 3:
        return points
    path = [points[0]]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        to_before, to_after = before - corner, after - corner
        reach = min(bend, 0.49 * np.linalg.norm(to_before), 0.49 * np.linalg.norm(to_after))
        start = corner + reach * to_before / np.linalg.norm(to_before)
        end = corner + reach * to_after / np.linalg.norm(to_after)
        for s in np.linspace(0, 1, steps):
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
    _, first, index = np.unique(
        np.round(vertices, 7), axis=0, return_index=True, return_inverse=True
    )
    welded = index.reshape(-1)[np.concatenate(faces)]
    a, b, c = welded.T
    return Mesh(vertices[first], welded[(a != b) & (b != c) & (c != a)])


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
    normals = np.zeros((len(corners), 3))
    np.add.at(normals, left[close], areas[right[close] // 3])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    out: Array = np.where(length > 1e-300, normals / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))
    return out
