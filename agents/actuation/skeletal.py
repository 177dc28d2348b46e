"""The skeletal drive: joint torques that pursue target angles, within a person's strength and range.

The torque of a degree of freedom is the sum of

* muscle: holds the limb against gravity and pulls towards the target (a stable proportional-
  derivative law), but never beyond the strength of the muscles on that side of the joint;
* support: where a posture rests a limb on furniture and the muscles are too weak to hold it, the
  furniture carries its weight and holds it in the posture by the same law, without a limit; the
  muscles pull against it with what strength they have;
* tissue: damping everywhere. The passive range ends at a hard stop, which is the physics engine's.

Stiffness and damping act at the end of the coming step (Tan, Liu & Turk, "Stable proportional-
derivative controllers", IEEE CG&A 2011): each step solves for the accelerations that they will meet,
with the mass matrix of all moving parts (composite rigid bodies and the sparse factorisation of
R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, chapters 6.2 and 6.5). So the law stays stable
at 1/240 s for a trunk as for a fingertip, and where two axes of a shoulder align.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from .chain import Chain

Array = npt.NDArray[np.float64]

# Our own choices; no measurement of everyday joint impedance covers all 112 degrees of freedom.
STIFFNESS_PER_TORQUE = 2.5  # [1/rad]: full strength answers an error of 0.4 rad
TISSUE_DAMPING_PER_TORQUE = 0.02  # [s/rad]
MAX_FREQUENCY = (
    40.0  # [rad/s] of a joint on its own stiffness: a finger's strength is not its stiffness
)

# Columns of the kernel's table, one row a DoF.
_AXIS, _OFFSET, _CENTRE, _ROTATION, _TENSOR = 0, 3, 6, 9, 18
_MASS, _STIFFNESS, _DAMPING, _TISSUE = 27, 28, 29, 30
_STRENGTH_AGAINST, _STRENGTH_ALONG, _SUPPORT = 31, 32, 33
_COLUMNS = 34


class SkeletalDrive:
    """Torques of a person's moving DoFs from target angles.

    Attributes:
        names: The moving DoFs.
        target: Angle that each DoF pursues [rad], shape [n]; write it to command the person.
    """

    def __init__(
        self,
        chain: Chain,
        *,
        strength: Array,
        normal_strength: Array,
        supported: npt.NDArray[np.bool_],
        posture: Array,
        physics_dt: float,
    ) -> None:
        """Prepare the table of the kernel.

        Args:
            chain: The moving parts, n of them.
            strength: Greatest torque against and along the axis [N·m], shape [n, 2], both >= 0.
            normal_strength: Torque of a healthy person, the scale of stiffness [N·m], shape [n].
            supported: Whether furniture holds the limb, shape [n].
            posture: Angles where furniture holds, and where damping is critical [rad], shape [n].
            physics_dt: Physics step [s].
        """
        count = len(chain.names)
        self.names = chain.names
        self._parents, self._dt = chain.parents, physics_dt
        inertia = np.diag(chain.mass_matrix(posture))
        table = np.zeros((count, _COLUMNS))
        table[:, _AXIS : _AXIS + 3] = chain.axes
        table[:, _OFFSET : _OFFSET + 3] = chain.offsets
        table[:, _CENTRE : _CENTRE + 3] = chain.centres
        table[:, _ROTATION : _ROTATION + 9] = chain.rotations.reshape(count, 9)
        table[:, _TENSOR : _TENSOR + 9] = chain.inertias.reshape(count, 9)
        table[:, _MASS] = chain.masses
        table[:, _STIFFNESS] = np.minimum(
            STIFFNESS_PER_TORQUE * normal_strength, inertia * MAX_FREQUENCY**2
        )
        table[:, _DAMPING] = 2 * np.sqrt(table[:, _STIFFNESS] * inertia)
        table[:, _TISSUE] = TISSUE_DAMPING_PER_TORQUE * normal_strength
        table[:, _STRENGTH_AGAINST], table[:, _STRENGTH_ALONG] = strength.T
        table[:, _SUPPORT] = supported
        self._table = table
        self._state = np.zeros((4, count))
        self._state[3] = posture
        self.target = self._state[2]
        self._work = np.zeros((count, _WORK))
        self._matrices = np.zeros((2, count, count))
        self._out = np.zeros(count)

    def torques(
        self, positions: list[float], velocities: list[float], gravity: Array
    ) -> list[float]:
        """Return joint torques [N·m], length n.

        Args:
            positions: Joint angles [rad], length n.
            velocities: Joint rates [rad/s], length n.
            gravity: Gravity in the frame of the pelvis [m/s²], shape [3].
        """
        self._state[0] = positions
        self._state[1] = velocities
        _torques(
            self._table, self._parents, self._state, gravity, self._dt, self._work,
            self._matrices, self._out,
        )  # fmt: skip
        result: list[float] = self._out.tolist()
        return result


# Columns of the kernel's scratch, one row a moving part, all in the frame of the pelvis.
_R, _P = 0, 9  # rotation, origin
_M, _H, _I = 12, 13, 16  # mass, first moment, inertia about the pelvis, of all that hangs on it
_A, _V = 25, 28  # axis, and velocity of the pelvis' origin if the part turns with unit rate
_WEIGHT, _CLIPPED = 31, 32  # torque against gravity; 0, or the sign of the strength that is spent
_WORK = 33


@numba.njit(cache=True)
def _place(table, parents, positions, work) -> None:  # type: ignore[no-untyped-def]
    """Find where every part is, and its own mass, first moment and inertia."""
    for i in range(table.shape[0]):
        row, mine, parent = table[i], work[i], parents[i]
        x, y, z = row[_AXIS], row[_AXIS + 1], row[_AXIS + 2]
        sine, cosine = np.sin(positions[i]), np.cos(positions[i])
        versine = 1 - cosine
        turn = (
            (cosine + x * x * versine, x * y * versine - z * sine, x * z * versine + y * sine),
            (x * y * versine + z * sine, cosine + y * y * versine, y * z * versine - x * sine),
            (x * z * versine - y * sine, y * z * versine + x * sine, cosine + z * z * versine),
        )  # Rodrigues, after the fixed rotation of the joint
        for a in range(3):
            if parent < 0:
                f0 = row[_ROTATION + 3 * a]
                f1 = row[_ROTATION + 3 * a + 1]
                f2 = row[_ROTATION + 3 * a + 2]
                mine[_P + a] = row[_OFFSET + a]
            else:
                up = work[parent]
                p0, p1, p2 = up[3 * a], up[3 * a + 1], up[3 * a + 2]
                f0 = p0 * row[_ROTATION] + p1 * row[_ROTATION + 3] + p2 * row[_ROTATION + 6]
                f1 = p0 * row[_ROTATION + 1] + p1 * row[_ROTATION + 4] + p2 * row[_ROTATION + 7]
                f2 = p0 * row[_ROTATION + 2] + p1 * row[_ROTATION + 5] + p2 * row[_ROTATION + 8]
                mine[_P + a] = (
                    up[_P + a] + p0 * row[_OFFSET] + p1 * row[_OFFSET + 1] + p2 * row[_OFFSET + 2]
                )
            for b in range(3):
                mine[_R + 3 * a + b] = f0 * turn[0][b] + f1 * turn[1][b] + f2 * turn[2][b]
        for a in range(3):
            r0, r1, r2 = mine[3 * a], mine[3 * a + 1], mine[3 * a + 2]
            centre = (
                mine[_P + a] + r0 * row[_CENTRE] + r1 * row[_CENTRE + 1] + r2 * row[_CENTRE + 2]
            )
            mine[_H + a] = row[_MASS] * centre
            mine[_A + a] = r0 * x + r1 * y + r2 * z
        mine[_M] = row[_MASS]
        _tensor(row, mine)
        # A unit rate about an axis through the part's origin moves the pelvis' origin by p x a.
        mine[_V] = mine[_P + 1] * mine[_A + 2] - mine[_P + 2] * mine[_A + 1]
        mine[_V + 1] = mine[_P + 2] * mine[_A] - mine[_P] * mine[_A + 2]
        mine[_V + 2] = mine[_P] * mine[_A + 1] - mine[_P + 1] * mine[_A]


@numba.njit(cache=True)
def _tensor(row, mine) -> None:  # type: ignore[no-untyped-def]
    """Write a part's inertia about the origin of the pelvis."""
    squared = 0.0
    if row[_MASS] > 0:
        squared = (mine[_H] ** 2 + mine[_H + 1] ** 2 + mine[_H + 2] ** 2) / row[_MASS]
    for a in range(3):
        t0 = t1 = t2 = 0.0
        for b in range(3):
            r = mine[_R + 3 * a + b]
            t0 += r * row[_TENSOR + 3 * b]
            t1 += r * row[_TENSOR + 3 * b + 1]
            t2 += r * row[_TENSOR + 3 * b + 2]
        for b in range(3):
            value = t0 * mine[_R + 3 * b] + t1 * mine[_R + 3 * b + 1] + t2 * mine[_R + 3 * b + 2]
            if row[_MASS] > 0:
                value -= mine[_H + a] * mine[_H + b] / row[_MASS]
            if a == b:
                value += squared
            mine[_I + 3 * a + b] = value


@numba.njit(cache=True)
def _mass_matrix(parents, gravity, work, matrix) -> None:  # type: ignore[no-untyped-def]
    """Write the mass matrix, lower triangle, and the torques that hold the parts against gravity."""
    for i in range(parents.shape[0] - 1, -1, -1):
        mine = work[i]
        if parents[i] >= 0:
            for k in range(_M, _A):
                work[parents[i], k] += mine[k]
        ax, ay, az = mine[_A], mine[_A + 1], mine[_A + 2]
        vx, vy, vz = mine[_V], mine[_V + 1], mine[_V + 2]
        hx, hy, hz, mass = mine[_H], mine[_H + 1], mine[_H + 2], mine[_M]
        lx = mass * vx + ay * hz - az * hy  # momentum of all that hangs on the joint, at unit rate
        ly = mass * vy + az * hx - ax * hz
        lz = mass * vz + ax * hy - ay * hx
        kx = mine[_I] * ax + mine[_I + 1] * ay + mine[_I + 2] * az + hy * vz - hz * vy
        ky = mine[_I + 3] * ax + mine[_I + 4] * ay + mine[_I + 5] * az + hz * vx - hx * vz
        kz = mine[_I + 6] * ax + mine[_I + 7] * ay + mine[_I + 8] * az + hx * vy - hy * vx
        j = i
        while j >= 0:
            up = work[j]
            matrix[i, j] = (
                up[_A] * kx + up[_A + 1] * ky + up[_A + 2] * kz
                + up[_V] * lx + up[_V + 1] * ly + up[_V + 2] * lz
            )  # fmt: skip
            j = parents[j]
        mx = hx - mass * mine[_P]
        my = hy - mass * mine[_P + 1]
        mz = hz - mass * mine[_P + 2]
        mine[_WEIGHT] = -(
            ax * (my * gravity[2] - mz * gravity[1])
            + ay * (mz * gravity[0] - mx * gravity[2])
            + az * (mx * gravity[1] - my * gravity[0])
        )


@numba.njit(cache=True)
def _solve(parents, matrix, x) -> None:  # type: ignore[no-untyped-def]
    """Solve in place; fill-in stays on the branches of the tree (matrix = Lᵀ L)."""
    count = x.shape[0]
    for k in range(count - 1, -1, -1):
        matrix[k, k] = np.sqrt(matrix[k, k])
        i = parents[k]
        while i >= 0:
            matrix[k, i] /= matrix[k, k]
            i = parents[i]
        i = parents[k]
        while i >= 0:
            j = i
            while j >= 0:
                matrix[i, j] -= matrix[k, i] * matrix[k, j]
                j = parents[j]
            i = parents[i]
    for i in range(count - 1, -1, -1):
        x[i] /= matrix[i, i]
        j = parents[i]
        while j >= 0:
            x[j] -= matrix[i, j] * x[i]
            j = parents[j]
    for i in range(count):
        j = parents[i]
        while j >= 0:
            x[i] -= matrix[i, j] * x[j]
            j = parents[j]
        x[i] /= matrix[i, i]


@numba.njit(cache=True)
def _torques(table, parents, state, gravity, dt, work, matrices, out) -> None:  # type: ignore[no-untyped-def]
    """Write the torque of each DoF into `out`."""
    count = table.shape[0]
    _place(table, parents, state[0], work)
    _mass_matrix(parents, gravity, work, matrices[0])
    for i in range(count):
        row = table[i]
        is_paralysed = row[_STRENGTH_ALONG] == 0.0 and row[_STRENGTH_AGAINST] == 0.0
        work[i, _CLIPPED] = 1.0 if is_paralysed else 0.0
    # A muscle at the end of its strength pulls with that strength, whatever the stiffness: when some
    # are, the accelerations are found once more without theirs.
    for _ in range(2):
        for i in range(count):
            row, j = table[i], i
            while j >= 0:
                matrices[1, i, j] = matrices[0, i, j]
                j = parents[j]
            velocity = state[1, i]
            ahead = state[0, i] + dt * velocity
            stiffness, damping, support = row[_STIFFNESS], row[_DAMPING], row[_SUPPORT]
            out[i] = support * (stiffness * (state[3, i] - ahead) - damping * velocity)
            out[i] -= row[_TISSUE] * velocity
            implicit = dt * (row[_TISSUE] + support * (damping + dt * stiffness))
            if work[i, _CLIPPED] == 0.0:
                out[i] += stiffness * (state[2, i] - ahead) - damping * velocity
                implicit += dt * (damping + dt * stiffness)
            else:  # the muscle does not give what would carry the weight, unless furniture does
                out[i] += _spent(row, work[i, _CLIPPED]) - (1 - support) * work[i, _WEIGHT]
            matrices[1, i, i] += implicit
        _solve(parents, matrices[1], out)
        is_new = False
        for i in range(count):
            row, support, weight = table[i], table[i, _SUPPORT], work[i, _WEIGHT]
            after = state[1, i] + dt * out[i]
            there = state[0, i] + dt * after
            held = weight + row[_STIFFNESS] * (state[3, i] - there) - row[_DAMPING] * after
            if work[i, _CLIPPED] == 0.0:
                muscle = row[_STIFFNESS] * (state[2, i] - there) - row[_DAMPING] * after
                muscle += (1 - support) * weight
                if muscle > row[_STRENGTH_ALONG]:
                    work[i, _CLIPPED], muscle, is_new = 1.0, row[_STRENGTH_ALONG], True
                elif muscle < -row[_STRENGTH_AGAINST]:
                    work[i, _CLIPPED], muscle, is_new = -1.0, -row[_STRENGTH_AGAINST], True
            else:
                muscle = _spent(row, work[i, _CLIPPED])
            out[i] = muscle + support * held - row[_TISSUE] * after
        if not is_new:
            break


@numba.njit(cache=True)
def _spent(row, sign):  # type: ignore[no-untyped-def]
    """Return the torque of a muscle at the end of its strength."""
    return row[_STRENGTH_ALONG] if sign > 0 else -row[_STRENGTH_AGAINST]
