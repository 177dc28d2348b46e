"""Neo-Hookean tetrahedra as XPBD constraints.

Energy density: mu/2 (|F|² - 3) + lambda/2 (det F - gamma)², gamma = 1 + mu/lambda, the stable neo-Hookean
material of M. Macklin and M. Müller, "A Constraint-based Formulation of Stable Neo-Hookean Materials"
(Motion, Interaction and Games 2021). Each tetrahedron of volume V has two constraints:

* deviatoric, C = |F| = sqrt(tr FᵀF), compliance 1/(mu V);
* hydrostatic, C = det F - gamma, compliance 1/(lambda V).

The two are solved together, as a system of two equations. One after the other, as in the paper, they do
not leave a body at rest alone: the first pulls it together, and the second, which one iteration leaves
softer than it is, does not push it back.

Eight tetrahedra that share no particle are solved in the lanes of one vector operation. The loops over
lanes therefore work on one scratch array at constant places, which a compiler can see through.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np

from ..errors import ConfigError
from ..pose import Array
from .constraint import colours, groups, summed
from .contact import Floats, Indices
from .material import Material

LANES = 8
SPARE = 4  # particles behind the last one, a tetrahedron at rest that fills unused lanes
# Rows of the scratch, LANES values each: positions of four particles, their inverse masses, the inverse
# of the rest edges, the compliance of shape. That of volume is mu / lambda of it.
_MASSES, _INVERSE, _SOFTNESS = 12, 16, 25
_ROWS = 26
_TABLE = _ROWS - _INVERSE  # of these rows, those that never change
_ONE = np.float32(1.0)
# Corners of a cell are numbered x + 2 y + 4 z. Neighbours are cut as mirror images, so that the
# diagonals of their common face agree.
_EVEN = ((0, 1, 2, 4), (3, 2, 1, 7), (5, 1, 4, 7), (6, 4, 2, 7), (1, 2, 4, 7))
_ODD = ((1, 0, 5, 3), (2, 0, 3, 6), (4, 0, 6, 5), (7, 3, 5, 6), (0, 3, 5, 6))


def signed_volumes(positions: Array, tetrahedra: Indices) -> Array:
    """Return the volume of each tetrahedron [m³], negative if it is inside out, shape [t]."""
    return np.linalg.det(_edges(positions, tetrahedra)) / 6


def _edges(positions: Array, tetrahedra: Indices) -> Array:
    first = positions[tetrahedra[:, 0]]
    return np.stack([positions[tetrahedra[:, k]] - first for k in (1, 2, 3)], axis=2)


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
    points, out = grid.reshape(-1, 3), np.concatenate(members).astype(np.int32)
    inside_out = signed_volumes(points, out) < 0
    out[inside_out, 2:] = out[inside_out, :1:-1]
    return points, out


def boundary(tetrahedra: Indices) -> Indices:
    """Return the outer faces of a mesh, counter-clockwise from outside, shape [m, 3]."""
    faces = np.concatenate([tetrahedra[:, k] for k in ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))])
    _, first, times = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.ascontiguousarray(faces[np.sort(first[times == 1])], np.int32)


class Packed(NamedTuple):
    """Tetrahedra packed for the kernels.

    Attributes:
        particles: Their particles, shape [g, 4 LANES].
        table: Their constants, shape [g, 10 LANES].
        ratio: mu / lambda.
        scratch: Shape [_ROWS LANES].
    """

    particles: Indices
    table: Floats
    ratio: np.float32
    scratch: Floats


class Tetrahedra:
    """The elastic tetrahedra of a body.

    Attributes:
        members: Particles of each tetrahedron, shape [t, 4].
        volumes: Rest volumes [m³], shape [t].
        packed: What the kernels take.
    """

    def __init__(self, rest: Array, members: Indices, material: Material) -> None:
        """Pack tetrahedra.

        Args:
            rest: Rest positions [m], shape [n, 3].
            members: Particles of each tetrahedron, shape [t, 4].
            material: What they are made of.

        Raises:
            ConfigError: If a tetrahedron has no volume or is inside out.
        """
        self.members = np.asarray(members, np.int32).reshape(-1, 4)
        self.volumes = signed_volumes(rest, self.members)
        if self.volumes.min() <= 0:
            worst = int(np.argmin(self.volumes))
            raise ConfigError(f"tetrahedron {worst} has the volume {self.volumes[worst]} m³")
        self._inverse = np.linalg.inv(_edges(rest, self.members))
        self._material = material
        mu, lame = material.shear_modulus, material.bulk_parameter
        if lame <= 0:
            raise ConfigError("neo-Hookean tetrahedra need a Poisson's ratio above 0")
        scratch = np.zeros(_ROWS * LANES, np.float32)
        self.packed = Packed(*self._pack(rest, mu), np.float32(mu / lame), scratch)

    def _pack(self, rest: Array, mu: float) -> tuple[Indices, Floats]:
        count = len(rest)
        centres = rest[self.members].mean(axis=1)
        axis = int(np.argmax(np.ptp(centres, axis=0)))
        rows = groups(colours(self.members, count), centres[:, axis], LANES)
        used = rows >= 0
        particles = np.empty((len(rows), 4, LANES), np.int32)
        particles[:] = count + np.arange(SPARE)[:, None]
        table = np.zeros((len(rows), _TABLE, LANES), np.float32)
        table[:, :9] = np.eye(3).reshape(9, 1)
        table[:, 9] = 1.0
        here, lane = np.nonzero(used)
        chosen = rows[used]
        particles[here, :, lane] = self.members[chosen]
        table[here, :9, lane] = self._inverse[chosen].reshape(-1, 9)
        table[here, 9, lane] = 1 / (mu * self.volumes[chosen])
        return particles.reshape(-1, 4 * LANES), table.reshape(-1, _TABLE * LANES)

    def determinants(self, positions: Array) -> Array:
        """Return det F of each tetrahedron, the ratio of volumes, shape [t]; negative if inverted."""
        return signed_volumes(positions, self.members) / self.volumes

    def lumped_masses(self, count: int) -> Array:
        """Return a quarter of each tetrahedron's mass at each of its particles [kg], shape [count]."""
        return summed(self.members, self._material.density_kg_m3 * self.volumes / 4, count)


@numba.njit(inline="always")
def _deformation(s, n):  # type: ignore[no-untyped-def]
    """Return the deformation gradient F and the inverse B of the rest edges, row by row."""
    x, y, z = s[n], s[LANES + n], s[2 * LANES + n]
    ax, ay, az = s[3 * LANES + n] - x, s[4 * LANES + n] - y, s[5 * LANES + n] - z
    bx, by, bz = s[6 * LANES + n] - x, s[7 * LANES + n] - y, s[8 * LANES + n] - z
    cx, cy, cz = s[9 * LANES + n] - x, s[10 * LANES + n] - y, s[11 * LANES + n] - z
    i00, i01, i02 = s[16 * LANES + n], s[17 * LANES + n], s[18 * LANES + n]
    i10, i11, i12 = s[19 * LANES + n], s[20 * LANES + n], s[21 * LANES + n]
    i20, i21, i22 = s[22 * LANES + n], s[23 * LANES + n], s[24 * LANES + n]
    return (
        ax * i00 + bx * i10 + cx * i20,
        ax * i01 + bx * i11 + cx * i21,
        ax * i02 + bx * i12 + cx * i22,
        ay * i00 + by * i10 + cy * i20,
        ay * i01 + by * i11 + cy * i21,
        ay * i02 + by * i12 + cy * i22,
        az * i00 + bz * i10 + cz * i20,
        az * i01 + bz * i11 + cz * i21,
        az * i02 + bz * i12 + cz * i22,
    ), (i00, i01, i02, i10, i11, i12, i20, i21, i22)


@numba.njit(inline="always")
def _cofactors(f):  # type: ignore[no-untyped-def]
    """Return the derivative of det F by F, row by row."""
    return (
        f[4] * f[8] - f[5] * f[7],
        f[5] * f[6] - f[3] * f[8],
        f[3] * f[7] - f[4] * f[6],
        f[7] * f[2] - f[8] * f[1],
        f[8] * f[0] - f[6] * f[2],
        f[6] * f[1] - f[7] * f[0],
        f[1] * f[5] - f[2] * f[4],
        f[2] * f[3] - f[0] * f[5],
        f[0] * f[4] - f[1] * f[3],
    )


@numba.njit(inline="always")
def _gradients(p, b):  # type: ignore[no-untyped-def]
    """Return P Bᵀ by columns: what a derivative P by F is at the particles 1, 2, 3."""
    return (
        p[0] * b[0] + p[1] * b[1] + p[2] * b[2],
        p[3] * b[0] + p[4] * b[1] + p[5] * b[2],
        p[6] * b[0] + p[7] * b[1] + p[8] * b[2],
        p[0] * b[3] + p[1] * b[4] + p[2] * b[5],
        p[3] * b[3] + p[4] * b[4] + p[5] * b[5],
        p[6] * b[3] + p[7] * b[4] + p[8] * b[5],
        p[0] * b[6] + p[1] * b[7] + p[2] * b[8],
        p[3] * b[6] + p[4] * b[7] + p[5] * b[8],
        p[6] * b[6] + p[7] * b[7] + p[8] * b[8],
    )


@numba.njit(inline="always")
def _coupling(u, h, w):  # type: ignore[no-untyped-def]
    """Return the sum over the four particles of inverse mass times u·h."""
    ux, uy, uz = u[0] + u[3] + u[6], u[1] + u[4] + u[7], u[2] + u[5] + u[8]
    hx, hy, hz = h[0] + h[3] + h[6], h[1] + h[4] + h[7], h[2] + h[5] + h[8]
    return (
        w[0] * (ux * hx + uy * hy + uz * hz)
        + w[1] * (u[0] * h[0] + u[1] * h[1] + u[2] * h[2])
        + w[2] * (u[3] * h[3] + u[4] * h[4] + u[5] * h[5])
        + w[3] * (u[6] * h[6] + u[7] * h[7] + u[8] * h[8])
    )


@numba.njit(cache=True, error_model="numpy")
def _solve_lanes(s, ratio) -> None:  # type: ignore[no-untyped-def]
    """Move the particles in the scratch by both constraints of each lane's tetrahedron."""
    for n in range(LANES):
        f, b = _deformation(s, n)
        k = _cofactors(f)
        determinant = f[0] * k[0] + f[1] * k[1] + f[2] * k[2]
        square = f[0] * f[0] + f[1] * f[1] + f[2] * f[2] + f[3] * f[3] + f[4] * f[4]
        square += f[5] * f[5] + f[6] * f[6] + f[7] * f[7] + f[8] * f[8]
        u, h = _gradients(f, b), _gradients(k, b)
        w = (s[12 * LANES + n], s[13 * LANES + n], s[14 * LANES + n], s[15 * LANES + n])
        # With C = |F| its gradient is u / C. Scaling its multiplier by 1 / C saves the root.
        across = _coupling(u, h, w)
        m00 = _coupling(u, u, w) / square + s[25 * LANES + n]
        m01 = across / square
        m11 = _coupling(h, h, w) + ratio * s[25 * LANES + n]
        beyond = determinant - _ONE - ratio
        scale = _ONE / (m00 * m11 - m01 * across)
        p, q = (m01 * beyond - m11) * scale, (across - m00 * beyond) * scale
        dx = p * (u[0] + u[3] + u[6]) + q * (h[0] + h[3] + h[6])
        dy = p * (u[1] + u[4] + u[7]) + q * (h[1] + h[4] + h[7])
        dz = p * (u[2] + u[5] + u[8]) + q * (h[2] + h[5] + h[8])
        s[n] -= w[0] * dx
        s[LANES + n] -= w[0] * dy
        s[2 * LANES + n] -= w[0] * dz
        s[3 * LANES + n] += w[1] * (p * u[0] + q * h[0])
        s[4 * LANES + n] += w[1] * (p * u[1] + q * h[1])
        s[5 * LANES + n] += w[1] * (p * u[2] + q * h[2])
        s[6 * LANES + n] += w[2] * (p * u[3] + q * h[3])
        s[7 * LANES + n] += w[2] * (p * u[4] + q * h[4])
        s[8 * LANES + n] += w[2] * (p * u[5] + q * h[5])
        s[9 * LANES + n] += w[3] * (p * u[6] + q * h[6])
        s[10 * LANES + n] += w[3] * (p * u[7] + q * h[7])
        s[11 * LANES + n] += w[3] * (p * u[8] + q * h[8])


@numba.njit(cache=True, error_model="numpy")
def _force_lanes(s, ratio) -> None:  # type: ignore[no-untyped-def]
    """Replace the positions in the scratch by the elastic forces on the particles."""
    for n in range(LANES):
        f, b = _deformation(s, n)
        k = _cofactors(f)
        determinant = f[0] * k[0] + f[1] * k[1] + f[2] * k[2]
        u, h = _gradients(f, b), _gradients(k, b)
        # First Piola-Kirchhoff stress P = mu F + lambda (det F - gamma) cof F, force -V P Bᵀ.
        p = -_ONE / s[25 * LANES + n]
        q = p * (determinant - _ONE - ratio) / ratio
        s[n] = -p * (u[0] + u[3] + u[6]) - q * (h[0] + h[3] + h[6])
        s[LANES + n] = -p * (u[1] + u[4] + u[7]) - q * (h[1] + h[4] + h[7])
        s[2 * LANES + n] = -p * (u[2] + u[5] + u[8]) - q * (h[2] + h[5] + h[8])
        s[3 * LANES + n] = p * u[0] + q * h[0]
        s[4 * LANES + n] = p * u[1] + q * h[1]
        s[5 * LANES + n] = p * u[2] + q * h[2]
        s[6 * LANES + n] = p * u[3] + q * h[3]
        s[7 * LANES + n] = p * u[4] + q * h[4]
        s[8 * LANES + n] = p * u[5] + q * h[5]
        s[9 * LANES + n] = p * u[6] + q * h[6]
        s[10 * LANES + n] = p * u[7] + q * h[7]
        s[11 * LANES + n] = p * u[8] + q * h[8]


@numba.njit(cache=True)
def _gather(x, row, constants, s) -> None:  # type: ignore[no-untyped-def]
    for k in range(4):
        for n in range(LANES):
            i = row[k * LANES + n]
            s[3 * k * LANES + n] = x[i, 0]
            s[(3 * k + 1) * LANES + n] = x[i, 1]
            s[(3 * k + 2) * LANES + n] = x[i, 2]
            s[(_MASSES + k) * LANES + n] = x[i, 3]
    for n in range(_TABLE * LANES):
        s[_INVERSE * LANES + n] = constants[n]


@numba.njit(cache=True)
def solve_tetrahedra(x, run, packed, dt) -> None:  # type: ignore[no-untyped-def]
    """Solve each tetrahedron once.

    Args:
        x: Positions [m] and inverse masses [1/kg], shape [n + SPARE, 4].
        run: The groups to solve, shape [r].
        packed: All groups, `Packed`.
        dt: Length of a small step [s].
    """
    particles, table, ratio, s = packed
    per_square = _ONE / (dt * dt)
    for g in run:
        row = particles[g]
        _gather(x, row, table[g], s)
        for n in range(LANES):
            s[_SOFTNESS * LANES + n] *= per_square
        _solve_lanes(s, ratio)
        for k in range(4):
            for n in range(LANES):
                i = row[k * LANES + n]
                x[i, 0] = s[3 * k * LANES + n]
                x[i, 1] = s[(3 * k + 1) * LANES + n]
                x[i, 2] = s[(3 * k + 2) * LANES + n]


@numba.njit(cache=True)
def add_elastic_forces(x, run, packed, forces) -> None:  # type: ignore[no-untyped-def]
    """Add the elastic forces on all particles [N] to `forces`, shape [n + SPARE, 3]; see above."""
    particles, table, ratio, s = packed
    for g in run:
        row = particles[g]
        _gather(x, row, table[g], s)
        _force_lanes(s, ratio)
        for k in range(4):
            for n in range(LANES):
                i = row[k * LANES + n]
                forces[i, 0] += s[3 * k * LANES + n]
                forces[i, 1] += s[(3 * k + 1) * LANES + n]
                forces[i, 2] += s[(3 * k + 2) * LANES + n]
