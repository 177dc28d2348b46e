"""Meshes of far fewer triangles, for pages without a graphics card: software OpenGL pays for each."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree  # type: ignore[import-untyped]

from ..errors import check_package
from .mesh import Bytes, Floats, Ints, weld

# All our own choices.
RIGID, SKIN = 6e-4, 2.5e-4  # [m²] of the surface for each triangle
FEWEST = 150  # triangles; a mesh with fewer stays as it is
COLOURS_APART = (
    0.03  # [m] that black and white lie apart, so that borders of colours stay where they are
)


def coarse(
    vertices: Floats, normals: Floats, faces: Ints, colors: Bytes | None, area: float
) -> Ints:
    """Return fewer faces between the same vertices, shape [m, 3].

    Quadric edge collapse (Garland and Heckbert 1997, by fast-simplification), with colours as further ways in
    space; then each corner is the old vertex that is nearest and looks most like its face, so creases stay.

    Args:
        vertices: Positions [m], shape [n, 3].
        normals: Unit vectors, shape [n, 3].
        faces: Vertex indices, shape [k, 3].
        colors: sRGB, shape [n, 3 or 4], or None.
        area: Of the surface for each triangle [m²], `RIGID` or `SKIN`.

    Raises:
        MissingPackageError: If fast-simplification is not installed.
    """
    wanted = max(FEWEST, int(_areas(vertices, faces).sum() / area))
    if wanted > 0.8 * len(faces):
        return faces
    check_package("fast_simplification", "a page without a graphics card", "coach")
    import fast_simplification

    lifted = vertices.astype(np.float64)
    if colors is not None:
        lifted += COLOURS_APART / 255 * colors[:, :3]
    joined = weld(lifted)
    first = np.unique(joined, return_index=True)[1]
    places = lifted[first]
    corners = _proper(joined[faces])
    moved, made = fast_simplification.simplify(
        places, corners.astype(np.int32), target_count=wanted
    )
    near = _proper(KDTree(places).query(moved)[1][made])
    return _alike(near, joined, normals, _normals(vertices[first][near]))


def _alike(near: npt.NDArray[Any], joined: npt.NDArray[Any], normals: Floats, wanted: Any) -> Ints:
    """Return for each corner of places the vertex there whose normal is most like that of the face."""
    order = np.argsort(joined, kind="stable")
    starts = np.searchsorted(joined[order], np.arange(joined.max() + 2))
    most = np.diff(starts)[near]
    best, score = order[starts[near]], np.full(near.shape, -np.inf)
    for k in range(int(most.max(initial=0))):
        found = order[np.minimum(starts[near] + k, len(order) - 1)]
        fits = np.einsum("fcx,fx->fc", normals[found], wanted)
        better = (most > k) & (fits > score)
        best[better], score[better] = found[better], fits[better]
    return np.ascontiguousarray(best, np.int32)


def _proper(faces: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the faces whose corners differ."""
    return faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


def _across(corners: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _normals(corners: npt.NDArray[Any]) -> npt.NDArray[Any]:
    across = _across(corners)
    return across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)


def _areas(vertices: Floats, faces: Ints) -> npt.NDArray[Any]:
    return np.asarray(0.5 * np.linalg.norm(_across(vertices[faces]), axis=1))
