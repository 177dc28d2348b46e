"""Triangle meshes to draw: from primitives and files, smoothed up to creases, coarser where far away."""

from __future__ import annotations

import logging
import math
import os
import warnings
from functools import lru_cache
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from ..body_part import VisualShape
from ..errors import ConfigError
from ..model.mesh import Mesh, corner_normals, merge
from ..reading import check_regular, refusing
from .collada import read_collada

Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]
Bytes = npt.NDArray[np.uint8]

CREASE = math.radians(35.0)  # [rad]; sharper edges stay edges
_LOG = logging.getLogger(__package__)
CELLS = (0.002, 0.004, 0.008, 0.016)  # [m], edge of a cell of each coarser level
_FINEST = 0.08  # greatest cell, as a share of the size of the mesh
_SMALLEST = 400  # faces; a mesh with fewer is always drawn as it is
_CRUMB = 0.008  # [m], radius up to which a sphere is seen small and has fewer faces
_BEVEL = 0.004  # [m], so that the edges of boxes catch light as real ones do


def shape_mesh(shape: VisualShape) -> Mesh | None:
    """Return the mesh of a shape in the shape's own frame, or None if it cannot be read."""
    if shape.kind == "mesh":
        return _file_mesh(shape.mesh, tuple(shape.size[:3]))
    return _primitive(shape.kind, tuple(round(float(x), 6) for x in shape.size))


@lru_cache(maxsize=512)
def _primitive(kind: str, size: tuple[float, ...]) -> Mesh:
    import trimesh

    if kind == "box":
        return _box(np.array(size[:3]))
    if kind == "plane":
        made = trimesh.creation.box((40.0, 40.0, 0.001))
        made.apply_translation((0, 0, -0.0005))
    elif kind == "sphere":
        count = (24, 32) if size[0] > _CRUMB else (12, 16)
        made = trimesh.creation.uv_sphere(radius=size[0], count=count)
    elif kind == "cylinder":
        made = trimesh.creation.cylinder(radius=size[1], height=size[0], sections=40)
    else:
        made = trimesh.creation.capsule(height=size[0], radius=size[1], count=(24, 24))
        low, high = made.bounds
        made.apply_translation(-(low + high) / 2)
    return smoothed(np.asarray(made.vertices), np.asarray(made.faces), None, closed=True)


def _box(size: npt.NDArray[np.float64]) -> Mesh:
    """Return a box whose edges are bevelled: six faces that share their normals with the bevels."""
    half = size / 2
    inset = half - min(_BEVEL, 0.15 * float(size.min()))
    # Each corner has three vertices, one on each of the three faces that meet there.
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    vertices, normals = np.empty((24, 3)), np.zeros((24, 3))
    for axis in range(3):
        vertices[axis::3] = signs * inset
        vertices[axis::3, axis] = signs[:, axis] * half[axis]
        normals[axis::3, axis] = signs[:, axis]
    import trimesh

    hull = trimesh.convex.convex_hull(vertices)
    order = np.argmin(np.linalg.norm(hull.vertices[:, None] - vertices[None], axis=2), axis=1)
    faces = order[hull.faces].astype(np.int32)
    return Mesh(vertices.astype(np.float32), faces, normals.astype(np.float32), faces, None, True)


@lru_cache(maxsize=1024)
def _file_mesh(path: str, scale: tuple[float, ...]) -> Mesh | None:
    if not os.path.isfile(path):
        import pybullet_data

        path = os.path.join(pybullet_data.getDataPath(), path)
    if not os.path.isfile(path):
        _LOG.warning("no mesh file at %s: the shape is left out of the picture", path)
        return None
    try:
        check_regular(path, "a mesh")
        with warnings.catch_warnings(), refusing(path, "a mesh"):
            warnings.simplefilter("ignore", RuntimeWarning)  # trimesh averages empty textures
            parts = _read(path)
    except ConfigError as error:
        _LOG.warning("cannot read a mesh: %s: it is left out of the picture", error)
        return None
    if not parts:
        return None
    meshes = []
    for vertices, faces, colors in parts:
        if np.prod(scale) < 0:
            faces = faces[:, ::-1]
        meshes.append(smoothed(vertices * np.asarray(scale), faces, colors))
    return merge(meshes) if len(meshes) > 1 else meshes[0]


Part = tuple[npt.NDArray[np.float64], Ints, Bytes | None]


def _read(path: str) -> list[Part]:
    """Return (vertices, faces, colours or None) of each part of a file."""
    if path.lower().endswith(".dae"):
        return read_collada(path)
    import trimesh

    loaded = trimesh.load_scene(path, process=False, maintain_order=True)
    parts: list[Part] = []
    for mesh in loaded.dump():
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        parts.append((np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32), _colors(mesh)))
    return parts


def _colors(mesh: Any) -> Bytes | None:
    """Return the colours of the vertices from a file's materials, textures or vertex colours."""
    visual = mesh.visual
    if visual.kind == "vertex":
        return np.asarray(visual.vertex_colors[:, :3], np.uint8)
    if visual.kind != "texture":
        return None
    image = getattr(visual.material, "image", None) or getattr(
        visual.material, "baseColorTexture", None
    )
    if image is not None:
        # One colour: the vertices are too far apart to carry a texture.
        mean = np.asarray(image.convert("RGB").resize((1, 1), 4))[0, 0]
    else:
        mean = np.asarray(visual.material.main_color)[:3]
    return np.tile(np.asarray(mean, np.uint8), (len(mesh.vertices), 1))


def smoothed(
    vertices: npt.NDArray[np.float64],
    faces: npt.NDArray[np.integer[Any]],
    colors: Bytes | None,
    *,
    closed: bool | None = None,
) -> Mesh:
    """Return a mesh with smooth normals that are split at creases sharper than `CREASE`.

    The normal of a corner is the area-weighted mean over the faces around its vertex whose own
    normals lie within the crease angle of its face's.

    Args:
        vertices: Positions [m], shape [n, 3]; coincident ones are joined.
        faces: Vertex indices, shape [m, 3].
        colors: sRGB colours, shape [n, 3], or None.
        closed: Whether the mesh is watertight; found out if None.
    """
    joined = weld(vertices)[faces]
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(area, axis=1)
    keep = (length > 1e-14) & (joined != np.roll(joined, 1, axis=1)).all(axis=1)
    faces, joined = faces[keep], joined[keep]
    normal = corner_normals(joined.ravel(), area[keep], CREASE)
    # Corners become vertices; those that agree in place, normal and colour become one.
    source = faces.ravel()
    bits = np.round(normal * 300).astype(np.int64) + 300
    key = (joined.ravel().astype(np.int64) * 601 + bits[:, 0]) * 601 + bits[:, 1]
    key = key * 2 + (bits[:, 2] > 300)
    if colors is not None:
        packed = colors[source].astype(np.int64) >> 3
        key = key * 32768 + (packed[:, 0] * 1024 + packed[:, 1] * 32 + packed[:, 2])
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    if closed is None:
        closed = is_closed(joined, vertices, faces)
    at, placed = source[first], inverse.reshape(-1, 3).astype(np.int32)
    return Mesh(
        vertices[at].astype(np.float32),
        placed,
        normal[first].astype(np.float32),
        placed,
        None if colors is None else colors[at],
        closed,
    )


def weld(vertices: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Return for each vertex the number of its place; coincident vertices share one."""
    size = max(float(np.ptp(vertices, axis=0).max()), 1e-9)
    grid = np.round((vertices - vertices.min(axis=0)) / (size * 2e-6)).astype(np.int64)
    key = (grid[:, 0] << 42) + (grid[:, 1] << 21) + grid[:, 2]
    return np.unique(key, return_inverse=True)[1].reshape(-1)


def is_closed(
    joined: npt.NDArray[Any],
    vertices: npt.NDArray[Any],
    faces: npt.NDArray[Any],
    *,
    tolerance: float = 0.0,
) -> bool:
    """Return whether each edge is met once in each direction, and the surface faces outwards.

    Args:
        joined: Faces with coincident vertices joined, shape [m, 3].
        vertices: Positions [m], shape [n, 3].
        faces: Vertex indices, shape [m, 3].
        tolerance: Share of the edges that may lie open.
    """
    if not len(faces):
        return False
    joined = joined.astype(np.int64)
    edges = np.concatenate([joined[:, (i, (i + 1) % 3)] for i in range(3)])
    big = int(joined.max()) + 1
    forward, backward = edges[:, 0] * big + edges[:, 1], edges[:, 1] * big + edges[:, 0]
    unique = np.unique(forward)
    open_count = len(forward) - len(unique) + np.count_nonzero(~np.isin(unique, backward))
    if open_count > tolerance * len(forward):
        return False
    a, b, c = (vertices[faces[:, i]] - vertices.mean(axis=0) for i in range(3))
    normals = np.cross(b - a, c - a)
    volume = float(np.einsum("ij,ij->i", a, normals).sum()) / 6
    area = float(np.linalg.norm(normals, axis=1).sum()) / 2
    return bool(volume > 1e-3 * area**1.5)  # a sheet holds nothing


class SmoothNormals:
    """The vertex normals of a deforming surface."""

    def __init__(self, faces: Ints, vertex_count: int) -> None:
        self._faces = np.ascontiguousarray(faces, np.int32)
        self._count = vertex_count

    def compute(self, vertices: Floats) -> Floats:
        """Return area-weighted unit normals, shape [n, 3]; zero for a vertex of no face."""
        out = np.zeros((self._count, 3), np.float32)
        _add_normals(np.ascontiguousarray(vertices, np.float32), self._faces, out)
        return out


@numba.njit(cache=True)
def _add_normals(vertices, faces, out) -> None:  # type: ignore[no-untyped-def]
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        bx, by, bz = vertices[j, 0] - ax, vertices[j, 1] - ay, vertices[j, 2] - az
        cx, cy, cz = vertices[k, 0] - ax, vertices[k, 1] - ay, vertices[k, 2] - az
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        for v in (i, j, k):
            out[v, 0] += nx
            out[v, 1] += ny
            out[v, 2] += nz
    for v in range(out.shape[0]):
        x, y, z = out[v, 0], out[v, 1], out[v, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 1e-20:
            out[v, 0], out[v, 1], out[v, 2] = x / length, y / length, z / length


def detail_levels(
    vertices: Floats, normals: Floats, faces: Ints, colors: Bytes | None
) -> list[Ints]:
    """Return the faces at full detail and then at each of `CELLS` that saves something.

    Software OpenGL pays for each triangle, however small. Vertices that fall into one cell of a grid are
    drawn as one (vertex clustering, after Rossignac and Borrel 1993): only new indices are needed.
    Vertices of unlike normals or colours are kept apart, so creases and edges of clothes stay.
    """
    levels = [faces]
    if len(faces) < _SMALLEST:
        return levels
    kind = np.argmax(np.abs(normals), axis=1)
    kind = kind * 2 + (normals[np.arange(len(normals)), kind] > 0)
    if colors is not None:
        bins = (colors[:, :3] >> 5).astype(np.int64)
        kind = ((kind * 8 + bins[:, 0]) * 8 + bins[:, 1]) * 8 + bins[:, 2]
    low = vertices.min(axis=0)
    size = float(np.ptp(vertices, axis=0).max())
    for cell in CELLS:
        if cell > _FINEST * size:  # or small things would vanish
            break
        grid = ((vertices - low) / cell).astype(np.int64)
        place = (grid[:, 0] << 28) + (grid[:, 1] << 14) + grid[:, 2]
        coarse = _clustered(vertices, low + (grid + 0.5) * cell, place, kind, faces)
        levels.append(coarse if len(coarse) < 0.9 * len(levels[-1]) else levels[-1])
    return levels


def _clustered(
    vertices: Floats,
    centers: npt.NDArray[np.float64],
    place: npt.NDArray[np.int64],
    kind: npt.NDArray[np.int64],
    faces: Ints,
) -> Ints:
    _, group = np.unique(np.stack((place, kind)), axis=1, return_inverse=True)
    group = group.reshape(-1)
    # The vertex nearest to the middle of the cell stands for all of them.
    order = np.lexsort((np.linalg.norm(vertices - centers, axis=1), group))
    first = np.flatnonzero(np.r_[True, np.diff(group[order]) > 0])
    standing = order[first][group].astype(np.int32)
    at = place[faces]
    flat = (at[:, 0] == at[:, 1]) & (at[:, 1] == at[:, 2])
    out = standing[faces[~flat]]
    a, b, c = out.T
    out = out[(a != b) & (b != c) & (c != a)]
    # Of faces that became the same, one is enough.
    _, once = np.unique(np.sort(out, axis=1) @ np.array((1 << 40, 1 << 20, 1)), return_index=True)
    return np.ascontiguousarray(out[np.sort(once)])


def level_for(size: float) -> int:
    """Return the coarsest level whose cells are no larger than `size` [m]."""
    return int(np.searchsorted(CELLS, size, side="right"))
