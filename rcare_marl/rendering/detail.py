"""Coarser versions of dense meshes, for what is far away and for shadows.

Software OpenGL pays for each triangle, however small. Vertices that fall into one cell of a grid
are drawn as one (vertex clustering, after Rossignac and Borrel 1993): only new indices are needed.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .mesh import Bytes, Floats, Ints

CELLS = (0.002, 0.004, 0.008, 0.016)  # [m], edge of a cell of each coarser level
_FINEST = 0.08  # greatest cell, as a share of the size of the mesh
_SMALLEST = 400  # faces; a mesh with fewer is always drawn as it is


def detail_levels(
    vertices: Floats, normals: Floats, faces: Ints, colors: Bytes | None
) -> list[Ints]:
    """Return the faces at full detail and then at each of `CELLS` that saves something.

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
