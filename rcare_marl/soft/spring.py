"""Distance constraints: threads, edges of a cloth, struts."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from ..errors import ConfigError
from .colouring import colours

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

_LEAST = np.float32(1e-12)  # [m], a length that counts as none


def edges(faces: Indices) -> Indices:
    """Return each edge of a mesh once, shape [e, 2]."""
    pairs = np.concatenate([faces[:, k] for k in ((0, 1), (1, 2), (2, 0))])
    return np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int32)


class Springs:
    """Distance constraints of a body, sorted by colour.

    Attributes:
        members: Two particles each, shape [m, 2].
        table: Rest length [m] and compliance [m/N], shape [m, 2].
    """

    def __init__(self, rest: Array, members: Indices, *, stiffness: float | Array) -> None:
        """Prepare springs that are at rest where the particles are.

        Args:
            rest: Positions [m], shape [n, 3].
            members: Two particles each, shape [m, 2].
            stiffness: Of each, or of all [N/m].

        Raises:
            ConfigError: If a stiffness is not above zero.
        """
        members = np.asarray(members, np.int32).reshape(-1, 2)
        stiffnesses = np.broadcast_to(np.asarray(stiffness, np.float64), len(members))
        if len(members) and not stiffnesses.min() > 0:
            raise ConfigError(f"a spring needs a stiffness above 0, got {stiffnesses.min()}")
        order = np.argsort(colours(members, len(rest)), kind="stable")
        self.members = np.ascontiguousarray(members[order])
        lengths = np.linalg.norm(rest[members[:, 1]] - rest[members[:, 0]], axis=1)
        self.table = np.column_stack((lengths, 1 / stiffnesses))[order].astype(np.float32)


@numba.njit(cache=True, error_model="numpy")
def solve_springs(x, members, table, dt) -> None:  # type: ignore[no-untyped-def]
    """Solve every distance constraint once; `x` holds positions and inverse masses."""
    per_square = np.float32(1) / (dt * dt)
    for c in range(members.shape[0]):
        i, j = members[c, 0], members[c, 1]
        wi, wj = x[i, 3], x[j, 3]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        total = wi + wj + table[c, 1] * per_square
        if length < _LEAST or total <= 0:
            continue
        pull = (length - table[c, 0]) / (total * length)
        x[i, 0] += wi * pull * dx
        x[i, 1] += wi * pull * dy
        x[i, 2] += wi * pull * dz
        x[j, 0] -= wj * pull * dx
        x[j, 1] -= wj * pull * dy
        x[j, 2] -= wj * pull * dz


@numba.njit(cache=True, error_model="numpy")
def add_spring_forces(x, members, table, forces) -> None:  # type: ignore[no-untyped-def]
    """Add the elastic forces on all particles [N] to `forces`."""
    for c in range(members.shape[0]):
        i, j = members[c, 0], members[c, 1]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        if length < _LEAST:
            continue
        pull = (length - table[c, 0]) / (table[c, 1] * length)
        forces[i, 0] += pull * dx
        forces[i, 1] += pull * dy
        forces[i, 2] += pull * dz
        forces[j, 0] -= pull * dx
        forces[j, 1] -= pull * dy
        forces[j, 2] -= pull * dz
