"""Bending constraints: two triangles that share an edge keep the angle between them.

C = theta - theta_0 with the derivatives of the dihedral angle of R. Bridson, S. Marino and R. Fedkiw,
"Simulation of Clothing with Folds and Wrinkles" (SCA 2003), compliance as in XPBD.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from ..errors import ConfigError
from .colouring import colours

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

_LEAST = 1e-20


def hinges(faces: Indices) -> Indices:
    """Return (edge start, edge end, opposite, opposite) of each inner edge of a mesh, shape [h, 4]."""
    sides: dict[tuple[int, int], list[int]] = {}
    for a, b, c in faces.tolist():
        for start, end, across in ((a, b, c), (b, c, a), (c, a, b)):
            sides.setdefault((min(start, end), max(start, end)), []).append(across)
    rows = [(*edge, *across) for edge, across in sides.items() if len(across) == 2]
    return np.array(rows, np.int32).reshape(-1, 4)


class Hinges:
    """Bending constraints of a body, sorted by colour.

    Attributes:
        members: Edge start, edge end, and the two particles across, shape [m, 4].
        table: Rest angle [rad] and compliance [rad/(N·m)], shape [m, 2].
    """

    def __init__(self, rest: Array, members: Indices, *, stiffness: float) -> None:
        """Prepare hinges that are at rest where the particles are.

        Args:
            rest: Positions [m], shape [n, 3].
            members: Rows of `hinges`, shape [m, 4].
            stiffness: Of all of them [N·m/rad].

        Raises:
            ConfigError: If the stiffness is not above zero.
        """
        if not stiffness > 0:
            raise ConfigError(f"a hinge needs a stiffness above 0, got {stiffness}")
        members = np.asarray(members, np.int32).reshape(-1, 4)
        order = np.argsort(colours(members, len(rest)), kind="stable")
        self.members = np.ascontiguousarray(members[order])
        self.table = np.empty((len(members), 2), np.float32)
        self.table[:, 1] = 1 / stiffness
        points = np.ascontiguousarray(rest, np.float32)
        gradient = np.empty((4, 3))
        for row, member in enumerate(self.members):
            self.table[row, 0] = fold(points, member, gradient)


@numba.njit(cache=True, error_model="numpy")
def fold(x, member, gradient):  # type: ignore[no-untyped-def]
    """Return the angle of a hinge [rad], zero when flat, and write its derivatives, shape [4, 3]."""
    p, q, a, b = x[member[0]], x[member[1]], x[member[2]], x[member[3]]
    ex, ey, ez = float(q[0] - p[0]), float(q[1] - p[1]), float(q[2] - p[2])
    ax, ay, az = float(p[0] - a[0]), float(p[1] - a[1]), float(p[2] - a[2])
    cx, cy, cz = float(q[0] - a[0]), float(q[1] - a[1]), float(q[2] - a[2])
    bx, by, bz = float(p[0] - b[0]), float(p[1] - b[1]), float(p[2] - b[2])
    dx, dy, dz = float(q[0] - b[0]), float(q[1] - b[1]), float(q[2] - b[2])
    n1 = (ay * cz - az * cy, az * cx - ax * cz, ax * cy - ay * cx)
    n2 = (dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx)
    s1 = n1[0] * n1[0] + n1[1] * n1[1] + n1[2] * n1[2] + _LEAST
    s2 = n2[0] * n2[0] + n2[1] * n2[1] + n2[2] * n2[2] + _LEAST
    length = np.sqrt(ex * ex + ey * ey + ez * ez + _LEAST)
    cross = (
        (n1[1] * n2[2] - n1[2] * n2[1]) * ex
        + (n1[2] * n2[0] - n1[0] * n2[2]) * ey
        + (n1[0] * n2[1] - n1[1] * n2[0]) * ez
    ) / length
    # How far along the edge the two particles across lie, seen from either end.
    a_end = (cx * ex + cy * ey + cz * ez) / length
    b_end = (dx * ex + dy * ey + dz * ez) / length
    a_start = -(ax * ex + ay * ey + az * ez) / length
    b_start = -(bx * ex + by * ey + bz * ez) / length
    for k in range(3):
        u1, u2 = n1[k] / s1, n2[k] / s2
        gradient[0, k] = a_end * u1 + b_end * u2
        gradient[1, k] = a_start * u1 + b_start * u2
        gradient[2, k] = -length * u1
        gradient[3, k] = -length * u2
    return np.arctan2(cross, n1[0] * n2[0] + n1[1] * n2[1] + n1[2] * n2[2])


@numba.njit(cache=True, error_model="numpy")
def _error(angle, rest):  # type: ignore[no-untyped-def]
    """Return the angle beyond rest, the short way round [rad]."""
    beyond = angle - rest
    if beyond > np.pi:
        beyond -= 2 * np.pi
    elif beyond < -np.pi:
        beyond += 2 * np.pi
    return beyond


@numba.njit(cache=True, error_model="numpy")
def solve_hinges(x, members, table, dt, gradient) -> None:  # type: ignore[no-untyped-def]
    """Solve every bending constraint once; `x` holds positions and inverse masses."""
    for c in range(members.shape[0]):
        beyond = _error(fold(x, members[c], gradient), table[c, 0])
        total = table[c, 1] / (dt * dt)
        for k in range(4):
            square = gradient[k, 0] ** 2 + gradient[k, 1] ** 2 + gradient[k, 2] ** 2
            total += x[members[c, k], 3] * square
        for k in range(4):
            i = members[c, k]
            step = -beyond / total * x[i, 3]
            for a in range(3):
                x[i, a] += step * gradient[k, a]


@numba.njit(cache=True, error_model="numpy")
def add_hinge_forces(x, members, table, gradient, forces) -> None:  # type: ignore[no-untyped-def]
    """Add the elastic forces on all particles [N] to `forces`."""
    for c in range(members.shape[0]):
        torque = -_error(fold(x, members[c], gradient), table[c, 0]) / table[c, 1]
        for k in range(4):
            for a in range(3):
                forces[members[c, k], a] += torque * gradient[k, a]
