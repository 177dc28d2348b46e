"""A tree of single-axis joints as arrays, and kernels that find where its parts are.

No physics state is touched: a tree is built from a model's data. Kernels take it as one named tuple.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array, axis_rotation

Ints = npt.NDArray[np.int64]


class Tree(NamedTuple):
    """Joints and the parts that they move, proximal first, n of them.

    What is fixed to a part has melted into it.

    Attributes:
        parents: Joint before each one, -1 for the root, shape [n].
        slides: Whether it slides, else it turns, shape [n].
        axes: Axis in its own frame, shape [n, 3]; of unit length where it turns.
        rotations: Frame at zero in the frame of the part before, shape [n, 3, 3].
        offsets: Its origin there [m], shape [n, 3].
        masses: What moves with it and not with a later joint [kg], shape [n].
        centres: Centre of that mass in its own frame [m], shape [n, 3].
        inertias: Inertia about that centre, in its own frame [kg·m²], shape [n, 3, 3]; zeros where
            only forces at rest are asked for.
        lags: Mass of a telescope's segments times the share of the tip's way that they stay behind
            [kg], shape [n]: one sliding joint stands for all of them.
    """

    parents: Ints
    slides: npt.NDArray[np.bool_]
    axes: Array
    rotations: Array
    offsets: Array
    masses: Array
    centres: Array
    inertias: Array
    lags: Array


class Frames(NamedTuple):
    """Where the parts of a tree are, in the frame of its root.

    Attributes:
        turns: Rotation of each part, shape [n, 3, 3].
        points: Its origin [m], shape [n, 3].
        axes: The axis of its joint, shape [n, 3].
    """

    turns: Array
    points: Array
    axes: Array


@dataclass(frozen=True, eq=False)
class JointTree:
    """A tree with names, and with frames that are fixed in its parts.

    Attributes:
        names: The joints, proximal first.
        arrays: What kernels take.
        frame_parts: Part that carries each frame, -1 for the root, shape [f].
        frame_rotations: Each frame in that part, shape [f, 3, 3].
        frame_offsets: Its origin in that part [m], shape [f, 3].
    """

    names: tuple[str, ...]
    arrays: Tree
    frame_parts: Ints
    frame_rotations: Array
    frame_offsets: Array

    def place(self, positions: Array) -> tuple[Array, Array]:
        """Return rotations [n, 3, 3] and origins [m] [n, 3] of parts at `positions`, in the root.

        Not compiled: for what is asked once, when a body is built.
        """
        tree, n = self.arrays, len(self.names)
        turns, points = np.empty((n, 3, 3)), np.empty((n, 3))
        for i, position in enumerate(positions):
            parent, axis = tree.parents[i], tree.axes[i]
            before = turns[parent] if parent >= 0 else np.eye(3)
            start = points[parent] if parent >= 0 else np.zeros(3)
            turns[i], points[i] = before @ tree.rotations[i], start + before @ tree.offsets[i]
            if tree.slides[i]:
                points[i] += turns[i] @ axis * position
            else:
                turns[i] = turns[i] @ axis_rotation((axis[0], axis[1], axis[2]), float(position))
        return turns, points

    def mass_matrix(self, positions: Array) -> Array:
        """Return the joint-space mass matrix at `positions` [rad or m], the root held, [n, n]."""
        tree, n = self.arrays, len(self.names)
        turns, points = self.place(positions)
        matrix = np.zeros((n, n))
        axes = np.einsum("iab,ib->ia", turns, tree.axes)
        for i in range(n):
            path = ancestors(tree.parents, i)
            slides = tree.slides[path, None]
            centre = points[i] + turns[i] @ tree.centres[i]
            linear = np.where(slides, axes[path], np.cross(axes[path], centre - points[path]))
            angular = np.where(slides, 0.0, axes[path])
            inertia = turns[i] @ tree.inertias[i] @ turns[i].T
            block = tree.masses[i] * linear @ linear.T + angular @ inertia @ angular.T
            matrix[np.ix_(path, path)] += block
        return matrix


def ancestors(parents: Ints, part: int) -> list[int]:
    """Return a part and all before it, the last one first; none for the root."""
    out = []
    while part >= 0:
        out.append(part)
        part = int(parents[part])
    return out


@numba.njit(cache=True)
def new_frames(count):  # type: ignore[no-untyped-def]
    """Return room for the frames of a tree of `count` joints."""
    return Frames(np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros((count, 3)))


@numba.njit(cache=True)
def place(tree, order, q, frames) -> None:  # type: ignore[no-untyped-def]
    """Write the frames of the joints in `order`, proximal first, at positions `q` [n]."""
    turns, points, axes = frames
    for i in order:
        parent = tree.parents[i]
        x, y, z = tree.axes[i, 0], tree.axes[i, 1], tree.axes[i, 2]
        angle = 0.0 if tree.slides[i] else q[i]
        s, c = math.sin(angle), math.cos(angle)
        k = 1 - c
        xx, xy, xz = c + k * x * x, k * x * y - s * z, k * x * z + s * y
        yx, yy, yz = k * x * y + s * z, c + k * y * y, k * y * z - s * x
        zx, zy, zz = k * x * z - s * y, k * y * z + s * x, c + k * z * z
        m, o = tree.rotations[i], tree.offsets[i]
        for r in range(3):
            if parent < 0:
                f0, f1, f2 = m[r, 0], m[r, 1], m[r, 2]
                points[i, r] = o[r]
            else:
                p0, p1, p2 = turns[parent, r, 0], turns[parent, r, 1], turns[parent, r, 2]
                f0 = p0 * m[0, 0] + p1 * m[1, 0] + p2 * m[2, 0]
                f1 = p0 * m[0, 1] + p1 * m[1, 1] + p2 * m[2, 1]
                f2 = p0 * m[0, 2] + p1 * m[1, 2] + p2 * m[2, 2]
                points[i, r] = p0 * o[0] + p1 * o[1] + p2 * o[2] + points[parent, r]
            axes[i, r] = f0 * x + f1 * y + f2 * z
            if tree.slides[i]:
                points[i, r] += axes[i, r] * q[i]
            turns[i, r, 0] = f0 * xx + f1 * yx + f2 * zx
            turns[i, r, 1] = f0 * xy + f1 * yy + f2 * zy
            turns[i, r, 2] = f0 * xz + f1 * yz + f2 * zz


@numba.njit(cache=True)
def carried_moments(tree, q, frames, mass, moment) -> None:  # type: ignore[no-untyped-def]
    """Write mass [kg] and first moment [kg·m] of all that hangs on each joint, shapes [n], [n, 3]."""
    turns, points, axes = frames
    mass[:] = 0.0
    moment[:] = 0.0
    for j in range(tree.parents.shape[0] - 1, -1, -1):
        m, c, parent = tree.masses[j], tree.centres[j], tree.parents[j]
        mass[j] += m
        t, lag = turns[j], tree.lags[j] * q[j]
        for r in range(3):
            centre = t[r, 0] * c[0] + t[r, 1] * c[1] + t[r, 2] * c[2] + points[j, r]
            moment[j, r] += m * centre
            if tree.slides[j]:
                moment[j, r] -= axes[j, r] * lag
            if parent >= 0:
                moment[parent, r] += moment[j, r]
        if parent >= 0:
            mass[parent] += mass[j]


@numba.njit(cache=True)
def gravity_torques(tree, q, frames, gravity):  # type: ignore[no-untyped-def]
    """Return what holds the parts at rest against `gravity` [m/s²] along -z, after `place`, [n]."""
    n = tree.parents.shape[0]
    mass, moment, out = np.empty(n), np.empty((n, 3)), np.empty(n)
    carried_moments(tree, q, frames, mass, moment)
    for i in range(n):
        d, p, m = frames.axes[i], frames.points[i], mass[i]
        if tree.slides[i]:
            out[i] = gravity * (m - tree.lags[i]) * d[2]
        else:
            y, x = moment[i, 1] - m * p[1], moment[i, 0] - m * p[0]
            out[i] = gravity * (d[0] * y - d[1] * x)
    return out


@numba.njit(cache=True)
def frame_in(frames, part, rotation, offset, out) -> None:  # type: ignore[no-untyped-def]
    """Write a frame that is fixed in a part as [3, 4]: rotation, and origin [m]."""
    for r in range(3):
        p = frames.turns[part, r]
        for c in range(3):
            out[r, c] = p[0] * rotation[0, c] + p[1] * rotation[1, c] + p[2] * rotation[2, c]
        along = p[0] * offset[0] + p[1] * offset[1] + p[2] * offset[2]
        out[r, 3] = along + frames.points[part, r]


@numba.njit(cache=True)
def jacobian(tree, frames, part, point):  # type: ignore[no-untyped-def]
    """Return the geometric Jacobian of a point [m] of a part, three linear rows first, [6, n]."""
    out = np.zeros((6, tree.parents.shape[0]))
    i = part
    while i >= 0:
        d, p = frames.axes[i], frames.points[i]
        if tree.slides[i]:
            out[0, i], out[1, i], out[2, i] = d[0], d[1], d[2]
        else:
            x, y, z = point[0] - p[0], point[1] - p[1], point[2] - p[2]
            out[0, i] = d[1] * z - d[2] * y
            out[1, i] = d[2] * x - d[0] * z
            out[2, i] = d[0] * y - d[1] * x
            out[3, i], out[4, i], out[5, i] = d[0], d[1], d[2]
        i = tree.parents[i]
    return out
