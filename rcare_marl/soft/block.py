"""A block of soft matter: a grid of cells, each cut into five tetrahedra."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..errors import ConfigError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

# Corners of a cell are numbered x + 2 y + 4 z. Neighbours are cut as mirror images, so that the
# diagonals of their common face agree.
_EVEN = ((0, 1, 2, 4), (3, 2, 1, 7), (5, 1, 4, 7), (6, 4, 2, 7), (1, 2, 4, 7))
_ODD = ((1, 0, 5, 3), (2, 0, 3, 6), (4, 0, 6, 5), (7, 3, 5, 6), (0, 3, 5, 6))


def make_block(size: Sequence[float], cells: Sequence[int]) -> tuple[Array, Indices]:
    """Return particles [m], shape [n, 3], and tetrahedra, shape [t, 4], of a block.

    The block lies with the middle of its underside at the origin. Particles go layer by layer up z, so
    the first `(cells[0] + 1) (cells[1] + 1)` of them are the underside, the last ones the top.

    Args:
        size: Edges along x, y, z [m].
        cells: Number of cells along each.

    Raises:
        ConfigError: If an edge has no length or there is no cell along it.
    """
    if len(size) != 3 or len(cells) != 3 or min(size) <= 0 or min(cells) < 1:
        raise ConfigError(f"a block has three edges and cells along each, got {size}, {cells}")
    nx, ny, nz = cells
    x, y = np.linspace(-0.5, 0.5, nx + 1) * size[0], np.linspace(-0.5, 0.5, ny + 1) * size[1]
    z = np.linspace(0.0, 1.0, nz + 1) * size[2]
    grid = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1)
    row, layer = nx + 1, (nx + 1) * (ny + 1)
    corners = np.array([a + b * row + c * layer for c in (0, 1) for b in (0, 1) for a in (0, 1)])
    members = []
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                cut = _ODD if (i + j + k) % 2 else _EVEN
                members.append(i + j * row + k * layer + corners[np.array(cut)])
    return grid.reshape(-1, 3), _outward(grid.reshape(-1, 3), np.concatenate(members))


def _outward(positions: Array, members: npt.NDArray[np.integer]) -> Indices:
    """Number the corners of each tetrahedron so that its volume is above zero."""
    out = members.astype(np.int32)
    edges = positions[out[:, 1:]] - positions[out[:, :1]]
    inside_out = np.linalg.det(edges) < 0
    out[inside_out, 2:] = out[inside_out, :1:-1]
    return out
