"""Triangle meshes with skin weights and scalar fields: cutting, smoothing, offsetting.

All surgery keeps the mesh closed: a border between skin and cloth is a ring of inserted vertices
on a level of a field, so that hems, lips and hairlines are as straight as their fields, not as
the edges of the source mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix  # type: ignore[import-untyped]

from ..refinement import cut_faces, face_edges, vertex_normals

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass
class WeightedMesh:
    """A triangle mesh whose per-vertex arrays survive subdivision.

    Attributes:
        vertices: Positions [m], shape [n, 3].
        faces: Vertex indices, counter-clockwise seen from outside, shape [m, 3].
        weights: Skin weights of the 55 joints, shape [n, 55].
        fields: Named scalars of the vertices, each of shape [n], interpolated by cuts.
    """

    vertices: Floats
    faces: Ints
    weights: Floats
    fields: dict[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.vertices)

    def normals(self) -> Floats:
        """Return area-weighted unit vertex normals, shape [n, 3]."""
        return vertex_normals(self.vertices, self.faces)

    def volume(self) -> float:
        """Return the enclosed volume [m³] (signed: positive when faces look outward)."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(np.einsum("ij,ij->", np.cross(a, b), c) / 6)

    def smoother(self, of: Ints | None = None) -> Callable[[Floats], Floats]:
        """Return what takes values to their means over the neighbours of each vertex, or of some."""
        edges, count = face_edges(self.faces), len(self.vertices)
        both = np.concatenate([edges, edges[:, ::-1]])
        degree = np.bincount(both[:, 0], minlength=count)
        alone = np.flatnonzero(degree == 0)  # keep what they have
        rows, columns = (np.append(both[:, k], alone) for k in (0, 1))
        shares = 1.0 / np.maximum(degree, 1)[rows]
        mean = csr_matrix((shares, (rows, columns)), shape=(count, count))
        if of is not None:
            mean = mean[of]
        return lambda values: np.asarray(mean @ values)


def join(meshes: list[WeightedMesh]) -> WeightedMesh:
    """Put meshes side by side; a field that one lacks is -1 there."""
    starts = np.cumsum([0] + [len(m) for m in meshes[:-1]])
    names = {name for m in meshes for name in m.fields}
    fields = {
        name: np.concatenate([m.fields.get(name, np.full(len(m), -1.0)) for m in meshes])
        for name in names
    }
    return WeightedMesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + s for m, s in zip(meshes, starts, strict=True)]),
        np.concatenate([m.weights for m in meshes]),
        fields,
    )


def keep_faces(mesh: WeightedMesh, kept: Mask) -> tuple[WeightedMesh, Ints]:
    """Drop the other faces and unused vertices; return also the old index of each vertex."""
    faces = mesh.faces[kept]
    old, new_faces = np.unique(faces, return_inverse=True)
    fields = {name: values[old] for name, values in mesh.fields.items()}
    return (
        WeightedMesh(mesh.vertices[old], new_faces.reshape(-1, 3), mesh.weights[old], fields),
        old,
    )


def split_edges(mesh: WeightedMesh, edges: Ints, at: Floats) -> WeightedMesh:
    """Insert a vertex on each of `edges` [k, 2] at the fraction `at` [k] from its first end."""

    def lerp(values: Floats) -> Floats:
        t = at.reshape((-1,) + (1,) * (values.ndim - 1))
        return np.concatenate([values, values[edges[:, 0]] * (1 - t) + values[edges[:, 1]] * t])

    fields = {name: lerp(values) for name, values in mesh.fields.items()}
    faces = cut_faces(mesh.faces, edges, len(mesh))
    return WeightedMesh(lerp(mesh.vertices), faces, lerp(mesh.weights), fields)


def cut(mesh: WeightedMesh, name: str, *levels: float) -> WeightedMesh:
    """Insert vertices where the field `name` crosses each of `levels`."""
    for level in levels:
        values = mesh.fields[name] - level
        corners = values[mesh.faces]
        edges = face_edges(mesh.faces[(corners.min(axis=1) < 0) & (corners.max(axis=1) > 0)])
        a, b = values[edges[:, 0]], values[edges[:, 1]]
        crossing = (a * b < 0) & (np.minimum(abs(a), abs(b)) > 1e-3 * abs(a - b))
        if crossing.any():
            fraction = a[crossing] / (a - b)[crossing]
            mesh = split_edges(mesh, edges[crossing], fraction)
    return mesh


def refine(mesh: WeightedMesh, where: Mask) -> WeightedMesh:
    """Halve every edge whose two ends are in `where` [n]."""
    edges = face_edges(mesh.faces[where[mesh.faces].sum(axis=1) > 1])
    chosen = edges[where[edges].all(axis=1)]
    return split_edges(mesh, chosen, np.full(len(chosen), 0.5)) if len(chosen) else mesh


def drape(
    mesh: WeightedMesh, inside: Mask, slack: Floats, blunt: Floats, iterations: int
) -> Floats:
    """Return positions with the vertices `inside` relaxed like a membrane over the body.

    The small relief of the skin is smoothed away first. From then on the membrane spans clefts and
    hollows but never sinks into the surface it started from.

    Args:
        mesh: The body.
        inside: Which vertices are covered, shape [n].
        slack: How far a vertex may slide along the surface, 0 to 1: 0 keeps hems straight.
        blunt: How strongly points of the body are rounded off, 0 to 1, shape [n].
        iterations: Number of relaxation steps.
    """
    average = mesh.smoother()
    start = mesh.vertices
    for step in (0.6, -0.63) * 15:  # Taubin's pair keeps the volume
        start = start + (inside * slack)[:, None] * step * (average(start) - start)
    pull = inside * slack * blunt * 0.9
    blunted = np.flatnonzero(pull)  # few: the rest stays where it is
    of_blunted = mesh.smoother(blunted)
    for _ in range(250):
        start[blunted] += pull[blunted, None] * (of_blunted(start) - start[blunted])
    out_of = WeightedMesh(start, mesh.faces, mesh.weights).normals()
    points = start.copy()
    for _ in range(iterations):
        moved = 0.5 * points + 0.5 * average(points) - start
        along = np.einsum("ij,ij->i", moved, out_of)[:, None] * out_of
        moved = along + slack[:, None] * (moved - along)
        sunk = np.minimum(np.einsum("ij,ij->i", moved, out_of), 0.0)
        moved -= sunk[:, None] * out_of
        points = np.where(inside[:, None], start + moved, points)
    return points


def smoothstep(low: float, high: float, values: Floats) -> Floats:
    """Return 0 below `low`, 1 above `high`, smooth between."""
    t: Floats = np.clip((values - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def noise(points: Floats, scale: float, seed: int) -> Floats:
    """Return smooth value noise in -1..1 at `points` [n, 3] with cells of `scale` [m]."""
    grid = points / scale + 1000.0
    cell = np.floor(grid).astype(np.int64)
    part = smoothstep(0.0, 1.0, grid - cell)
    total = np.zeros(len(points))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(np.array(corner) == 1, part, 1 - part), axis=1)
        total += weight * _hash(cell + np.array(corner), seed)
    return total


def _hash(cells: Ints, seed: int) -> Floats:
    mixed: Any = cells.astype(np.uint64) * np.array([73856093, 19349663, 83492791], dtype=np.uint64)
    bits = mixed[:, 0] ^ mixed[:, 1] ^ mixed[:, 2] ^ np.uint64(seed * 2654435761)
    bits = (bits ^ (bits >> np.uint64(15))) * np.uint64(2246822519)
    bits = bits ^ (bits >> np.uint64(13))
    return (bits % np.uint64(65536)).astype(np.float64) / 32767.5 - 1.0
