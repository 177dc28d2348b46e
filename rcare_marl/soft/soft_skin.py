"""What renderers draw of soft objects: implements `rcare_marl.world.Skin`."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array  # type: ignore[import-untyped]
from scipy.sparse.csgraph import connected_components  # type: ignore[import-untyped]
from scipy.spatial import cKDTree  # type: ignore[import-untyped]

from ..body import Body
from ..pose import Array
from ..rendering.mesh import SmoothNormals
from ..world import Skin
from .cloth import Cloth
from .contact import Floats
from .fluid import Fluid
from .soft_body import SoftBody

Faces = npt.NDArray[np.int32]

_CLEAR = 0.008  # [m] off the skin beneath, so that it does not show between particles
_DEEP = 0.08  # [m] beneath a skin, from where cloth is not meant to be outside
_NEIGHBOURS = 4  # vertices of the skin that say where outside is
# In spacings: cell of the grid, how far particles count, radius of one, gap that parts two heaps.
CELL, REACH, RADIUS, GAP = 0.6, 2.0, 0.62, 2.5
SMOOTHING = 2  # passes
_EDGES = [
    (a, b)
    for a, b in itertools.combinations(itertools.product((0, 1), repeat=3), 2)
    if sum(abs(p - q) for p, q in zip(a, b, strict=True)) == 1
]


class SoftSkin:
    """The surface of a soft object, for renderers.

    Attributes:
        body: A body that stands for it where something must; its own shapes are not drawn.
        faces: Shape [m, 3]; new ones when the object has torn or flowed.
        colors: RGB, and opacity of what is not opaque, of each vertex, shape [n, 3] or [n, 4].
    """

    faces: Faces
    colors: npt.NDArray[np.uint8]

    def __init__(self, body: Body, color: Sequence[int]) -> None:
        self.body, self._color = body, np.array(color, np.uint8)

    def _paint(self, count: int) -> None:
        self.colors = np.tile(self._color, (count, 1))

    def vertices(self) -> Floats:
        """Return the present vertices in the world [m], shape [n, 3]."""
        raise NotImplementedError

    def _rest(self) -> Floats:
        """Return the vertices at rest [m], shape [n, 3]."""
        return self.vertices()

    def rest_pieces(self) -> list[tuple[int, Floats, Faces]]:
        """Return it as one rigid piece, for fallbacks."""
        return [(-1, self._rest(), np.arange(len(self.faces), dtype=np.int32))]


class SoftBodySkin(SoftSkin):
    """The surface of a soft body that is no flesh beneath a person's skin."""

    def __init__(self, soft: SoftBody, body: Body, color: Sequence[int]) -> None:
        super().__init__(body, color)
        self._soft = soft
        self._outside, faces = np.unique(soft.faces, return_inverse=True)
        self.faces = faces.reshape(-1, 3).astype(np.int32)
        self._paint(len(self._outside))

    def vertices(self) -> Floats:
        points = self._soft.in_world(self._soft.frame())
        return points[self._outside].astype(np.float32)

    def _rest(self) -> Floats:
        return self._soft.rest[self._outside].astype(np.float32)


class FluidSkin(SoftSkin):
    """The surface of a fluid."""

    def __init__(self, fluid: Fluid, body: Body, color: Sequence[int]) -> None:
        super().__init__(body, color)
        self._fluid = fluid
        self._seen: npt.NDArray[np.float64] = np.zeros((0, 3))
        self._vertices: Floats = np.zeros((0, 3), np.float32)
        self.vertices()

    def vertices(self) -> Floats:
        points = self._fluid.positions[self._fluid.is_active]
        if len(points) == len(self._seen) and (points == self._seen).all() and len(points):
            return self._vertices
        self._seen = points
        vertices, faces = enclose(points, self._fluid.spacing)
        if not len(faces):  # none is left: renderers want something
            vertices, faces = np.tile(self._fluid.positions[:1], (3, 1)), np.array([[0, 1, 2]])
        self._vertices, self.faces = vertices.astype(np.float32), faces.astype(np.int32)
        self._paint(len(vertices))
        return self._vertices


class ClothSkin(SoftSkin):
    """The surface of a cloth.

    Attributes:
        beneath: Skins that it is drawn outside of. Cloth lies on the simple shapes of the physics, and a
            shoulder is no capsule: what is drawn is moved out of the skin by the few centimetres.
    """

    def __init__(
        self, cloth: Cloth, body: Body, color: Sequence[int], beneath: Sequence[Skin] = ()
    ) -> None:
        super().__init__(body, color)
        self.cloth, self.beneath = cloth, tuple(beneath)
        self._mesh()

    def _mesh(self) -> None:
        """Cut each face of the cloth into four."""
        self._coarse = faces = self.cloth.faces
        self._normals = SmoothNormals(faces, len(self.cloth.rest))
        sides = np.concatenate([faces[:, k] for k in ((0, 1), (1, 2), (2, 0))])
        self._edges, where = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
        ab, bc, ca = len(self.cloth.rest) + where.reshape(3, -1)
        a, b, c = faces.T
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        self.faces = np.concatenate([np.stack(p, axis=1) for p in parts]).astype(np.int32)
        self._paint(len(self.cloth.rest) + len(self._edges))

    def vertices(self) -> Floats:
        if self._coarse is not self.cloth.faces:
            self._mesh()
        out = self._rounded(self.cloth.positions.astype(np.float32))
        for skin in self.beneath:
            _move_out(out, skin.vertices(), skin.faces)
        return out

    def _rounded(self, points: Floats) -> Floats:
        """Return the particles and the middles of edges, on a curve that is square to both normals.

        A. Vlachos, J. Peters, C. Boyd and J. Mitchell, "Curved PN Triangles" (I3D 2001).
        """
        normals = self._normals.compute(points)
        p, q = (points[self._edges[:, k]] for k in range(2))
        n, m = (normals[self._edges[:, k]] for k in range(2))
        at_p, at_q = (np.einsum("ea,ea->e", q - p, k)[:, None] for k in (n, m))
        return np.concatenate((points, (p + q) / 2 - (at_p * n - at_q * m) / 8))

    def _rest(self) -> Floats:
        return self._rounded(self.cloth.rest.astype(np.float32))


def _move_out(points: Floats, skin: Floats, faces: Faces) -> None:
    """Move points out of a skin where they are in it, in place."""
    normals = SmoothNormals(faces, len(skin)).compute(skin)
    low, high = points.min(axis=0) - _DEEP, points.max(axis=0) + _DEEP
    chosen = np.flatnonzero(((skin > low) & (skin < high)).all(axis=1))
    if len(chosen) < _NEIGHBOURS:
        return
    distance, near = cKDTree(skin[chosen]).query(points, k=_NEIGHBOURS)
    near = chosen[near]
    away = np.einsum("nka,nka->nk", points[:, None] - skin[near], normals[near]).mean(axis=1)
    way = normals[near].mean(axis=1)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    is_near = (distance[:, 0] < _DEEP) & (away < _CLEAR)
    points += np.where(is_near, _CLEAR - away, 0.0)[:, None].astype(np.float32) * way


def enclose(points: Array, spacing: float) -> tuple[Array, Faces]:
    """Return the surface around particles: alone they become balls, many a smooth body.

    How far a point is outside: its distance from the mean of the particles around, less a radius (Y. Zhu and
    R. Bridson, "Animating Sand as a Fluid", SIGGRAPH 2005). The mesh is a surface net: a vertex in each cell
    of a grid that the surface crosses (S. Gibson, "Constrained Elastic Surface Nets", 1998).

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
