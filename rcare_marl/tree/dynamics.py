"""Rigid-body dynamics of a tree whose root is held, for drives that act at the end of a physics step.

Composite rigid bodies and the sparse factorisation of R. Featherstone, "Rigid Body Dynamics Algorithms",
2008, chapters 6.2 and 6.5. All in the frame of the root; all joints turn. Specialised for one call a
physics step: one row of numbers a joint keeps what belongs together in one line of the cache.
"""

from __future__ import annotations

import numba
import numpy as np

from rcare_marl.pose import Array

from .joint_tree import Ints, Tree

# Columns of the table of parts, one row a joint; a drive adds its own after them.
AXIS, OFFSET, CENTRE, ROTATION, TENSOR, MASS = 0, 3, 6, 9, 18, 27
PART_COLUMNS = 28

# Columns of the scratch, one row a part: rotation, origin; mass, first moment and inertia about the root of
# all that hangs on the joint; axis, and velocity of the root's origin if the part turns at unit rate; the
# torque that holds all that hangs on the joint against gravity.
TURN, ORIGIN, HELD_MASS, MOMENT, INERTIA, AXIS_NOW, SWEEP, WEIGHT = 0, 9, 12, 13, 16, 25, 28, 31
SCRATCH_COLUMNS = 33  # and one for the drive


def part_table(tree: Tree, columns: int = PART_COLUMNS) -> Array:
    """Return the table of parts of a tree, shape [n, columns], zero from `PART_COLUMNS` on."""
    count = len(tree.parents)
    table = np.zeros((count, columns))
    table[:, AXIS : AXIS + 3] = tree.axes
    table[:, OFFSET : OFFSET + 3] = tree.offsets
    table[:, CENTRE : CENTRE + 3] = tree.centres
    table[:, ROTATION : ROTATION + 9] = tree.rotations.reshape(count, 9)
    table[:, TENSOR : TENSOR + 9] = tree.inertias.reshape(count, 9)
    table[:, MASS] = tree.masses
    return table


def tree_depths(parents: Ints) -> Ints:
    """Return how many parts come before each one, shape [n]."""
    depths = np.zeros(len(parents), np.int64)
    for i, parent in enumerate(parents):
        depths[i] = depths[parent] + 1 if parent >= 0 else 0
    return depths


def packed_matrix(parents: Ints) -> Array:
    """Return room for a packed matrix of a tree, shape [n, greatest depth + 1]."""
    return np.zeros((len(parents), int(tree_depths(parents).max(initial=0)) + 1))


def holding_torques(tree: Tree, positions: Array, gravity: Array) -> Array:
    """Return what holds the parts still against `gravity` [m/s²], shape [3], in the root [N·m], [n]."""
    table, work = part_table(tree), np.zeros((len(tree.parents), SCRATCH_COLUMNS))
    place_frames(table, tree.parents, positions, work)
    place_masses(table, work)
    matrix = packed_matrix(tree.parents)
    mass_matrix(tree.parents, tree_depths(tree.parents), gravity, work, matrix)
    return work[:, WEIGHT].copy()


@numba.njit(cache=True, error_model="numpy")
def place_frames(table, parents, positions, work) -> None:  # type: ignore[no-untyped-def]
    """Find the frame of every part, and its axis, in the frame of the root."""
    for i in range(table.shape[0]):
        row, mine, parent = table[i], work[i], parents[i]
        x, y, z = row[AXIS], row[AXIS + 1], row[AXIS + 2]
        sine, cosine = np.sin(positions[i]), np.cos(positions[i])
        versine = 1 - cosine
        turn = (
            (cosine + x * x * versine, x * y * versine - z * sine, x * z * versine + y * sine),
            (x * y * versine + z * sine, cosine + y * y * versine, y * z * versine - x * sine),
            (x * z * versine - y * sine, y * z * versine + x * sine, cosine + z * z * versine),
        )  # Rodrigues, after the fixed rotation of the joint
        for a in range(3):
            if parent < 0:
                f0 = row[ROTATION + 3 * a]
                f1 = row[ROTATION + 3 * a + 1]
                f2 = row[ROTATION + 3 * a + 2]
                mine[ORIGIN + a] = row[OFFSET + a]
            else:
                up = work[parent]
                p0, p1, p2 = up[3 * a], up[3 * a + 1], up[3 * a + 2]
                f0 = p0 * row[ROTATION] + p1 * row[ROTATION + 3] + p2 * row[ROTATION + 6]
                f1 = p0 * row[ROTATION + 1] + p1 * row[ROTATION + 4] + p2 * row[ROTATION + 7]
                f2 = p0 * row[ROTATION + 2] + p1 * row[ROTATION + 5] + p2 * row[ROTATION + 8]
                mine[ORIGIN + a] = (
                    up[ORIGIN + a] + p0 * row[OFFSET] + p1 * row[OFFSET + 1] + p2 * row[OFFSET + 2]
                )
            for b in range(3):
                mine[TURN + 3 * a + b] = f0 * turn[0][b] + f1 * turn[1][b] + f2 * turn[2][b]
        for a in range(3):
            mine[AXIS_NOW + a] = mine[3 * a] * x + mine[3 * a + 1] * y + mine[3 * a + 2] * z


@numba.njit(cache=True, error_model="numpy")
def place_masses(table, work) -> None:  # type: ignore[no-untyped-def]
    """Find every part's own mass, first moment and inertia, after `place_frames`."""
    for i in range(table.shape[0]):
        row, mine = table[i], work[i]
        for a in range(3):
            r0, r1, r2 = mine[3 * a], mine[3 * a + 1], mine[3 * a + 2]
            centre = (
                mine[ORIGIN + a] + r0 * row[CENTRE] + r1 * row[CENTRE + 1] + r2 * row[CENTRE + 2]
            )
            mine[MOMENT + a] = row[MASS] * centre
        mine[HELD_MASS] = row[MASS]
        _tensor(row, mine)
        # A unit rate about an axis through the part's origin moves the root's origin by p x a.
        mine[SWEEP] = mine[ORIGIN + 1] * mine[AXIS_NOW + 2] - mine[ORIGIN + 2] * mine[AXIS_NOW + 1]
        mine[SWEEP + 1] = mine[ORIGIN + 2] * mine[AXIS_NOW] - mine[ORIGIN] * mine[AXIS_NOW + 2]
        mine[SWEEP + 2] = mine[ORIGIN] * mine[AXIS_NOW + 1] - mine[ORIGIN + 1] * mine[AXIS_NOW]


@numba.njit(cache=True, error_model="numpy")
def _tensor(row, mine) -> None:  # type: ignore[no-untyped-def]
    """Write a part's inertia about the origin of the root."""
    squared = 0.0
    if row[MASS] > 0:
        squared = (mine[MOMENT] ** 2 + mine[MOMENT + 1] ** 2 + mine[MOMENT + 2] ** 2) / row[MASS]
    for a in range(3):
        t0 = t1 = t2 = 0.0
        for b in range(3):
            r = mine[TURN + 3 * a + b]
            t0 += r * row[TENSOR + 3 * b]
            t1 += r * row[TENSOR + 3 * b + 1]
            t2 += r * row[TENSOR + 3 * b + 2]
        for b in range(3):
            value = (
                t0 * mine[TURN + 3 * b] + t1 * mine[TURN + 3 * b + 1] + t2 * mine[TURN + 3 * b + 2]
            )
            if row[MASS] > 0:
                value -= mine[MOMENT + a] * mine[MOMENT + b] / row[MASS]
            if a == b:
                value += squared
            mine[INERTIA + 3 * a + b] = value


@numba.njit(cache=True, error_model="numpy")
def mass_matrix(parents, depths, gravity, work, matrix) -> None:  # type: ignore[no-untyped-def]
    """Write the mass matrix, packed, and the torques that hold the parts against gravity.

    Row i of a packed matrix holds part i's entries with the parts before it, the first one first:
    the one with part j stands in column `depths[j]`, its own in column `depths[i]`.
    """
    for i in range(parents.shape[0] - 1, -1, -1):
        mine = work[i]
        if parents[i] >= 0:
            for k in range(HELD_MASS, AXIS_NOW):
                work[parents[i], k] += mine[k]
        ax, ay, az = mine[AXIS_NOW], mine[AXIS_NOW + 1], mine[AXIS_NOW + 2]
        vx, vy, vz = mine[SWEEP], mine[SWEEP + 1], mine[SWEEP + 2]
        hx, hy, hz, mass = mine[MOMENT], mine[MOMENT + 1], mine[MOMENT + 2], mine[HELD_MASS]
        lx = mass * vx + ay * hz - az * hy  # momentum of all that hangs on the joint, at unit rate
        ly = mass * vy + az * hx - ax * hz
        lz = mass * vz + ax * hy - ay * hx
        inertia = mine[INERTIA:AXIS_NOW]
        kx = inertia[0] * ax + inertia[1] * ay + inertia[2] * az + hy * vz - hz * vy
        ky = inertia[3] * ax + inertia[4] * ay + inertia[5] * az + hz * vx - hx * vz
        kz = inertia[6] * ax + inertia[7] * ay + inertia[8] * az + hx * vy - hy * vx
        j = i
        while j >= 0:
            up = work[j]
            turned = up[AXIS_NOW] * kx + up[AXIS_NOW + 1] * ky + up[AXIS_NOW + 2] * kz
            turned = turned + up[SWEEP] * lx + up[SWEEP + 1] * ly + up[SWEEP + 2] * lz
            matrix[i, depths[j]] = turned
            j = parents[j]
        mx = hx - mass * mine[ORIGIN]
        my = hy - mass * mine[ORIGIN + 1]
        mz = hz - mass * mine[ORIGIN + 2]
        mine[WEIGHT] = -(
            ax * (my * gravity[2] - mz * gravity[1])
            + ay * (mz * gravity[0] - mx * gravity[2])
            + az * (mx * gravity[1] - my * gravity[0])
        )


@numba.njit(cache=True, error_model="numpy")
def solve(parents, depths, matrix, x) -> None:  # type: ignore[no-untyped-def]
    """Solve in place with a packed matrix; fill-in stays on the branches of the tree (Lᵀ L)."""
    count = x.shape[0]
    for k in range(count - 1, -1, -1):
        depth = depths[k]
        each = 1.0 / np.sqrt(matrix[k, depth])
        matrix[k, depth] = each  # the reciprocal of the diagonal
        for a in range(depth):
            matrix[k, a] *= each
        i = parents[k]
        for a in range(depth - 1, -1, -1):
            share = matrix[k, a]
            for b in range(a + 1):
                matrix[i, b] -= share * matrix[k, b]
            i = parents[i]
    for i in range(count - 1, -1, -1):
        x[i] *= matrix[i, depths[i]]
        j = parents[i]
        for a in range(depths[i] - 1, -1, -1):
            x[j] -= matrix[i, a] * x[i]
            j = parents[j]
    for i in range(count):
        rest, j = x[i], parents[i]
        for a in range(depths[i] - 1, -1, -1):
            rest -= matrix[i, a] * x[j]
            j = parents[j]
        x[i] = rest * matrix[i, depths[i]]
