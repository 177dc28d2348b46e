"""The surface of a heap of particles, for the eye.

How far a point is outside: its distance from the mean of the particles around, less a radius (Y. Zhu and
R. Bridson, "Animating Sand as a Fluid", SIGGRAPH 2005). Particles alone become balls, many a smooth body.
The mesh is a surface net: a vertex in each cell of a grid that the surface crosses (S. Gibson,
"Constrained Elastic Surface Nets", 1998).
"""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array  # type: ignore[import-untyped]
from scipy.sparse.csgraph import connected_components  # type: ignore[import-untyped]
from scipy.spatial import cKDTree  # type: ignore[import-untyped]

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int32]

# In spacings: cell of the grid, how far particles count, radius of one, gap that parts two heaps.
CELL, REACH, RADIUS, GAP = 0.6, 2.0, 0.62, 2.5
SMOOTHING = 2  # passes
_EDGES = [
    (a, b)
    for a, b in itertools.combinations(itertools.product((0, 1), repeat=3), 2)
    if sum(abs(p - q) for p, q in zip(a, b, strict=True)) == 1
]


def enclose(points: Array, spacing: float) -> tuple[Array, Faces]:
    """Return the surface around particles.

    Args:
        points: Their positions [m], shape [n, 3].
        spacing: Usual distance of neighbours [m].

    Returns:
        Vertices [m], shape [v, 3], and faces that look outwards, shape [f, 3].
    """
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int32)], 0
    if len(points):
        pairs = cKDTree(points).query_pairs(GAP * spacing, output_type="ndarray")
        links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
        heaps, labels = connected_components(links, directed=False)
        for heap in range(heaps):
            field, low = _field(points[labels == heap], spacing)
            found, own = _net(field)
            vertices.append(low + CELL * spacing * found)
            faces.append(own + count)
            count += len(found)
    return np.concatenate(vertices), np.concatenate(faces)


def _field(points: Array, spacing: float) -> tuple[Array, Array]:
    """Return how far nodes of a grid are outside, in cells, shape [x, y, z], and the place of the first."""
    cell, wide = CELL * spacing, int(np.ceil(REACH / CELL))
    low = points.min(axis=0) - (wide + 2) * cell
    shape = np.ceil((points.max(axis=0) - low) / cell).astype(int) + wide + 3
    local = (points - low) / cell
    near = np.stack(np.meshgrid(*[np.arange(-wide, wide + 1)] * 3, indexing="ij"), -1).reshape(
        -1, 3
    )
    nodes = np.round(local).astype(int)[:, None] + near
    apart = nodes - local[:, None]
    weights = np.maximum(1 - np.einsum("nka,nka->nk", apart, apart) * (CELL / REACH) ** 2, 0) ** 3
    rows = np.ravel_multi_index(tuple(nodes.reshape(-1, 3).T), tuple(shape))
    size = int(np.prod(shape))
    total = np.bincount(rows, weights.ravel(), size)
    means = [np.bincount(rows, (weights * -apart[..., a]).ravel(), size) for a in range(3)]
    # From a node to the mean of the particles around it.
    away = np.sqrt(sum(mean**2 for mean in means)) / np.maximum(total, 1e-12)
    out = np.where(total > 0, away - RADIUS / CELL, REACH / CELL)
    return out.reshape(shape), low


def _net(field: Array) -> tuple[Array, Faces]:
    """Return vertices in cells and faces of the surface where a field is zero."""
    cells = np.array(field.shape) - 1
    corner = {
        c: field[tuple(slice(k, k + n) for k, n in zip(c, cells, strict=True))]
        for c in itertools.product((0, 1), repeat=3)
    }
    total, count = np.zeros((*cells, 3)), np.zeros(cells)
    for a, b in _EDGES:
        crosses = (corner[a] < 0) != (corner[b] < 0)
        share = corner[a] / np.where(crosses, corner[a] - corner[b], 1.0)
        at = np.array(a) + share[..., None] * np.subtract(b, a)
        total += np.where(crosses[..., None], at, 0.0)
        count += crosses
    held = count > 0
    number = np.full(cells, -1, np.int64)
    number[held] = np.arange(int(held.sum()))
    vertices = np.argwhere(held) + total[held] / count[held][:, None]
    quads = np.concatenate([_quads(field, number, axis) for axis in range(3)])
    for _ in range(SMOOTHING):
        vertices = _smoothed(vertices, quads)
    faces = np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))
    return vertices, faces.astype(np.int32)


def _quads(field: Array, number: npt.NDArray[np.int64], axis: int) -> npt.NDArray[np.int64]:
    """Return the faces across the edges of the grid along an axis, four vertices each."""
    b, c = (axis + 1) % 3, (axis + 2) % 3
    grid = np.moveaxis(field < 0, (axis, b, c), (0, 1, 2))
    cells = np.moveaxis(number, (axis, b, c), (0, 1, 2))
    inside, outside = grid[:-1, 1:-1, 1:-1], grid[1:, 1:-1, 1:-1]
    out = []
    for which, turn in ((inside & ~outside, 1), (~inside & outside, -1)):
        k, j, i = np.nonzero(which)
        ring = [cells[k, j, i], cells[k, j + 1, i], cells[k, j + 1, i + 1], cells[k, j, i + 1]]
        out.append(np.stack(ring[::turn], axis=1))
    return np.concatenate(out)


def _smoothed(vertices: Array, quads: npt.NDArray[np.int64]) -> Array:
    """Return vertices halfway to the mean of their neighbours."""
    ends = np.concatenate(
        [np.stack((quads[:, k], quads[:, (k + 1) % 4])) for k in range(4)], axis=1
    )
    a, b = np.concatenate((ends, ends[::-1]), axis=1)
    count = np.maximum(np.bincount(a, minlength=len(vertices)), 1)
    mean = [np.bincount(a, vertices[b, k], len(vertices)) / count for k in range(3)]
    return np.asarray(0.5 * (vertices + np.stack(mean, axis=1)))
