"""Kernels of whole-body inverse kinematics: residuals of goals, their Jacobian, and least squares.

The body is a tree of single-axis joints in the world: six for the pelvis (three slides, then yaw,
pitch and roll) and the 112 anatomical ones. The search is a Levenberg-Marquardt one with exact
Jacobians: K. Levenberg 1944 and D. Marquardt 1963, with the step found in the space of the residuals,
of which there are far fewer than joints. A joint that would pass its limit is put onto it and the others
are solved again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

POSITION, ORIENTATION, DIRECTION, GAZE, BALANCE = range(5)
ROWS = 3  # residuals of one goal
_WEIGHT, _OFFSET, _TARGET = 0, 1, 4  # columns of a goal's numbers
GOAL_COLUMNS = 13
_LARGEST_STEP = 0.6  # [rad or m] of one joint in one step, where the Jacobian still means something
_TRIES = 8  # of growing damping before the search gives up
_BOUND_ROUNDS = 6  # of putting joints onto their limits


class Tree(NamedTuple):
    """The joints of a body, proximal first.

    Attributes:
        parents: Joint before each one, -1 for the world, shape [n].
        slides: Whether it slides, else it turns, shape [n].
        axes: Unit axis in its own frame, shape [n, 3].
        rotations: Frame at zero in the parent's frame, shape [n, 3, 3].
        offsets: Origin in the parent's frame [m], shape [n, 3].
        masses: What moves with it and not with a later joint [kg], shape [n].
        centres: Centre of that mass in its own frame [m], shape [n, 3].
        carries: Whether joint i moves joint j, or is it, shape [n, n].
    """

    parents: Ints
    slides: npt.NDArray[np.bool_]
    axes: Array
    rotations: Array
    offsets: Array
    masses: Array
    centres: Array
    carries: npt.NDArray[np.bool_]


class Quest(NamedTuple):
    """Goals as arrays.

    Attributes:
        order: The joints whose place matters, proximal first, shape [k].
        columns: The joints that may move, shape [c].
        kinds: Of each goal, shape [g].
        parts: Joint whose frame each goal is about, shape [g].
        numbers: Weight, offset or local direction, and target of each goal, shape [g, 13].
        polygon: The support of a balance goal [m], counter-clockwise, shape [v, 2].
    """

    order: Ints
    columns: Ints
    kinds: Ints
    parts: Ints
    numbers: Array
    polygon: Array


@numba.njit(cache=True)
def place(tree, order, q, turns, points, axes):  # type: ignore[no-untyped-def]
    """Write frames [n, 3, 3], origins [n, 3] and axes [n, 3] of the joints in `order`."""
    for i in order:
        parent = tree.parents[i]
        x, y, z = tree.axes[i, 0], tree.axes[i, 1], tree.axes[i, 2]
        angle = 0.0 if tree.slides[i] else q[i]
        s, c = math.sin(angle), math.cos(angle)
        k = 1 - c
        for r in range(3):
            if parent < 0:
                f0, f1, f2 = (
                    tree.rotations[i, r, 0],
                    tree.rotations[i, r, 1],
                    tree.rotations[i, r, 2],
                )
                points[i, r] = tree.offsets[i, r]
            else:
                p0, p1, p2 = turns[parent, r, 0], turns[parent, r, 1], turns[parent, r, 2]
                m, o = tree.rotations[i], tree.offsets[i]
                f0 = p0 * m[0, 0] + p1 * m[1, 0] + p2 * m[2, 0]
                f1 = p0 * m[0, 1] + p1 * m[1, 1] + p2 * m[2, 1]
                f2 = p0 * m[0, 2] + p1 * m[1, 2] + p2 * m[2, 2]
                points[i, r] = points[parent, r] + p0 * o[0] + p1 * o[1] + p2 * o[2]
            axes[i, r] = f0 * x + f1 * y + f2 * z
            if tree.slides[i]:
                points[i, r] += axes[i, r] * q[i]
            turns[i, r, 0] = (
                f0 * (c + k * x * x) + f1 * (k * x * y + s * z) + f2 * (k * x * z - s * y)
            )
            turns[i, r, 1] = (
                f0 * (k * x * y - s * z) + f1 * (c + k * y * y) + f2 * (k * y * z + s * x)
            )
            turns[i, r, 2] = (
                f0 * (k * x * z + s * y) + f1 * (k * y * z - s * x) + f2 * (c + k * z * z)
            )


@numba.njit(cache=True)
def _log(turn, wanted, out):  # type: ignore[no-untyped-def]
    """Write the rotation vector that turns `wanted` (nine numbers, row by row) into `turn`."""
    e = np.zeros((3, 3))
    for r in range(3):
        for c in range(3):
            for k in range(3):
                e[r, c] += turn[r, k] * wanted[3 * c + k]
    out[0], out[1], out[2] = e[2, 1] - e[1, 2], e[0, 2] - e[2, 0], e[1, 0] - e[0, 1]
    sine = 0.5 * math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    cosine = 0.5 * (e[0, 0] + e[1, 1] + e[2, 2] - 1)
    if sine > 1e-7:
        scale = 0.5 * math.atan2(sine, cosine) / sine
    elif cosine > 0:
        scale = 0.5
    else:  # a half turn: the largest column of e + 1 lies along the axis
        k = 0
        for i in range(1, 3):
            if e[i, i] > e[k, k]:
                k = i
        e[k, k] += 1
        length = math.sqrt(e[0, k] ** 2 + e[1, k] ** 2 + e[2, k] ** 2)
        for r in range(3):
            out[r] = math.pi * e[r, k] / length
        return
    for r in range(3):
        out[r] *= scale


@numba.njit(cache=True)
def _inverse_left(phi, a, out):  # type: ignore[no-untyped-def]
    """Write the rate of the rotation vector `phi` under a turn about `a` in the world."""
    b0 = phi[1] * a[2] - phi[2] * a[1]
    b1 = phi[2] * a[0] - phi[0] * a[2]
    b2 = phi[0] * a[1] - phi[1] * a[0]
    t = math.sqrt(phi[0] ** 2 + phi[1] ** 2 + phi[2] ** 2)
    if t < 1e-4:
        k = 1 / 12
    else:
        k = 1 / (t * t) - 0.5 / (t * math.tan(0.5 * t))
    out[0] = a[0] - 0.5 * b0 + k * (phi[1] * b2 - phi[2] * b1)
    out[1] = a[1] - 0.5 * b1 + k * (phi[2] * b0 - phi[0] * b2)
    out[2] = a[2] - 0.5 * b2 + k * (phi[0] * b1 - phi[1] * b0)


@numba.njit(cache=True)
def _nearest(polygon, x, y):  # type: ignore[no-untyped-def]
    """Return the nearest point of a convex polygon, and the normal of the edge that it lies on.

    Zero normal: inside. A normal of length 2: at a corner, where every direction counts.
    """
    count = polygon.shape[0]
    inside = count > 2
    best, bx, by, nx, ny = 1e300, x, y, 2.0, 0.0
    for i in range(count):
        ax, ay = polygon[i]
        ex, ey = polygon[(i + 1) % count, 0] - ax, polygon[(i + 1) % count, 1] - ay
        square = ex * ex + ey * ey
        if ex * (y - ay) - ey * (x - ax) < 0:
            inside = False
        share = 0.0 if square == 0 else ((x - ax) * ex + (y - ay) * ey) / square
        share = min(max(share, 0.0), 1.0)
        px, py = ax + share * ex, ay + share * ey
        gap = (x - px) ** 2 + (y - py) ** 2
        if gap < best:
            best, bx, by = gap, px, py
            length = math.sqrt(square)
            nx, ny = (2.0, 0.0) if share in (0.0, 1.0) else (ey / length, -ex / length)
    if inside:
        return x, y, 0.0, 0.0
    return bx, by, nx, ny


@numba.njit(cache=True)
def _balance(tree, quest, row, at, turns, points, axes, residual, jacobian, wants):  # type: ignore[no-untyped-def]
    count = tree.parents.shape[0]
    mass, moment = np.zeros(count), np.zeros((count, 3))
    for j in range(count - 1, -1, -1):
        m, c = tree.masses[j], tree.centres[j]
        mass[j] += m
        for r in range(3):
            moment[j, r] += m * (
                points[j, r] + turns[j, r, 0] * c[0] + turns[j, r, 1] * c[1] + turns[j, r, 2] * c[2]
            )
        if tree.parents[j] >= 0:
            mass[tree.parents[j]] += mass[j]
            moment[tree.parents[j]] += moment[j]
    total, w = mass[0], row[_WEIGHT]
    x, y = moment[0, 0] / total, moment[0, 1] / total
    px, py, nx, ny = _nearest(quest.polygon, x, y)
    residual[at], residual[at + 1], residual[at + 2] = w * (x - px), w * (y - py), 0.0
    if not wants:
        return
    for c in range(quest.columns.shape[0]):
        i = quest.columns[c]
        a, p, m = axes[i], points[i], mass[i]
        if tree.slides[i]:
            dx, dy = m * a[0] / total, m * a[1] / total
        else:
            hx, hy, hz = moment[i, 0] - m * p[0], moment[i, 1] - m * p[1], moment[i, 2] - m * p[2]
            dx, dy = (a[1] * hz - a[2] * hy) / total, (a[2] * hx - a[0] * hz) / total
        if nx == 2.0:
            jacobian[at, c], jacobian[at + 1, c] = w * dx, w * dy
        else:
            along = nx * dx + ny * dy
            jacobian[at, c], jacobian[at + 1, c] = w * nx * along, w * ny * along


@numba.njit(cache=True)
def evaluate(tree, quest, q, turns, points, axes, residual, jacobian, wants):  # type: ignore[no-untyped-def]
    """Write the residuals [3 g] at `q` [n] and, where it `wants` it, their Jacobian [3 g, c]."""
    place(tree, quest.order, q, turns, points, axes)
    x, d, v, phi, row_ = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    if wants:
        jacobian[:] = 0.0
    for g in range(quest.kinds.shape[0]):
        kind, part, at, row = quest.kinds[g], quest.parts[g], ROWS * g, quest.numbers[g]
        w, far = row[_WEIGHT], 1.0
        if kind == BALANCE:
            _balance(tree, quest, row, at, turns, points, axes, residual, jacobian, wants)
            continue
        turn = turns[part]
        for r in range(3):  # the offset turned: a lever, or a direction
            v[r] = turn[r, 0] * row[1] + turn[r, 1] * row[2] + turn[r, 2] * row[3]
            x[r] = points[part, r] + v[r]
            d[r] = turn[r, 2] if kind == GAZE else v[r]
        if kind == POSITION:
            for r in range(3):
                residual[at + r] = w * (x[r] - row[_TARGET + r])
        elif kind == ORIENTATION:
            _log(turn, row[_TARGET:], phi)
            for r in range(3):
                residual[at + r] = w * phi[r]
        elif kind == DIRECTION:
            for r in range(3):
                residual[at + r] = w * (d[r] - row[_TARGET + r])
        else:
            far = 0.0
            for r in range(3):
                v[r] = row[_TARGET + r] - x[r]
                far += v[r] ** 2
            far = max(math.sqrt(far), 1e-9)
            for r in range(3):
                v[r] /= far
                residual[at + r] = w * (d[r] - v[r])
        if not wants:
            continue
        for c in range(quest.columns.shape[0]):
            i = quest.columns[c]
            if not tree.carries[i, part]:
                continue
            a = axes[i]
            l0, l1, l2 = x[0] - points[i, 0], x[1] - points[i, 1], x[2] - points[i, 2]
            m0, m1, m2 = a[1] * l2 - a[2] * l1, a[2] * l0 - a[0] * l2, a[0] * l1 - a[1] * l0
            if tree.slides[i]:
                m0, m1, m2 = a[0], a[1], a[2]
            if kind == POSITION:
                row_[0], row_[1], row_[2] = m0, m1, m2
            elif tree.slides[i]:
                row_[:] = 0.0
            elif kind == ORIENTATION:
                _inverse_left(phi, a, row_)
            else:
                row_[0] = a[1] * d[2] - a[2] * d[1]
                row_[1] = a[2] * d[0] - a[0] * d[2]
                row_[2] = a[0] * d[1] - a[1] * d[0]
            if kind == GAZE:
                along = v[0] * m0 + v[1] * m1 + v[2] * m2
                row_[0] += (m0 - along * v[0]) / far
                row_[1] += (m1 - along * v[1]) / far
                row_[2] += (m2 - along * v[2]) / far
            for r in range(3):
                jacobian[at + r, c] = w * row_[r]


@numba.njit(cache=True)
def _cost(residual, q, rest, pull, columns):  # type: ignore[no-untyped-def]
    total = 0.0
    for value in residual:
        total += value * value
    for k in columns:
        total += pull[k] * (q[k] - rest[k]) ** 2
    return total


@numba.njit(cache=True)
def _step(jacobian, residual, slope, stiff, free, step):  # type: ignore[no-untyped-def]
    """Write the step of the free joints that minimises |J d + r|² + slope·d·2 + stiff d²."""
    rows, count = jacobian.shape
    k, b = np.zeros((rows, rows)), np.zeros(rows)
    for i in range(rows):
        for c in range(count):
            if free[c] and jacobian[i, c] != 0.0:
                scaled = jacobian[i, c] / stiff[c]
                b[i] -= scaled * slope[c]
                for j in range(i + 1):
                    k[i, j] += scaled * jacobian[j, c]
        b[i] += residual[i]
        k[i, i] += 1.0
    for i in range(rows):  # Cholesky, in place
        for j in range(i + 1):
            total = k[i, j]
            for m in range(j):
                total -= k[i, m] * k[j, m]
            k[i, j] = math.sqrt(max(total, 1e-14)) if i == j else total / k[j, j]
    for i in range(rows):
        for m in range(i):
            b[i] -= k[i, m] * b[m]
        b[i] /= k[i, i]
    for i in range(rows - 1, -1, -1):
        for m in range(i + 1, rows):
            b[i] -= k[m, i] * b[m]
        b[i] /= k[i, i]
    for c in range(count):
        if free[c]:
            total = slope[c]
            for i in range(rows):
                total += jacobian[i, c] * b[i]
            step[c] = -total / stiff[c]


@numba.njit(cache=True)
def _bounded(jacobian, residual, q, lower, upper, rest, pull, damping, columns, step):  # type: ignore[no-untyped-def]
    """Write a step [c] that stays within the limits."""
    count = columns.shape[0]
    free, left = np.ones(count, np.bool_), residual.copy()
    slope, stiff = np.empty(count), np.empty(count)
    for c in range(count):
        k = columns[c]
        stiff[c] = pull[k] + damping
        slope[c] = pull[k] * (q[k] - rest[k])
    for _ in range(_BOUND_ROUNDS):
        _step(jacobian, left, slope, stiff, free, step)
        blocked = False
        for c in range(count):
            k = columns[c]
            bounded = min(max(step[c], lower[k] - q[k]), upper[k] - q[k])
            if free[c] and bounded != step[c]:
                step[c], free[c], blocked = bounded, False, True
                for r in range(left.shape[0]):
                    left[r] += jacobian[r, c] * bounded
        if not blocked:
            break


@numba.njit(cache=True)
def search(tree, quest, q, lower, upper, rest, pull, iterations):  # type: ignore[no-untyped-def]
    """Return a posture of least cost near `q` [n], its residuals [3 g], its cost, and the iterations.

    Only the joints in `quest.columns` move. `pull` [n] is the weight of the distance to `rest` [n].
    """
    count, rows = q.shape[0], ROWS * quest.kinds.shape[0]
    columns = quest.columns
    turns, points, axes = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    residual, jacobian = np.zeros(rows), np.zeros((rows, columns.shape[0]))
    trial_residual, step = np.zeros(rows), np.zeros(columns.shape[0])
    now = q.copy()
    for k in columns:
        now[k] = min(max(now[k], lower[k]), upper[k])
    trial, damping, done = now.copy(), 1e-3, 0
    evaluate(tree, quest, now, turns, points, axes, residual, jacobian, True)
    cost = _cost(residual, now, rest, pull, columns)
    while done < iterations:
        done += 1
        better = False
        for _ in range(_TRIES):
            _bounded(jacobian, residual, now, lower, upper, rest, pull, damping, columns, step)
            longest = 0.0
            for value in step:
                longest = max(longest, abs(value))
            scale = min(1.0, _LARGEST_STEP / max(longest, 1e-12))
            for c in range(columns.shape[0]):
                k = columns[c]
                trial[k] = min(max(now[k] + scale * step[c], lower[k]), upper[k])
            evaluate(tree, quest, trial, turns, points, axes, trial_residual, jacobian, False)
            trial_cost = _cost(trial_residual, trial, rest, pull, columns)
            if trial_cost < cost:
                better = True
                break
            damping *= 4.0
        if not better:
            break
        gain, cost = cost - trial_cost, trial_cost
        now[:] = trial
        damping = max(0.25 * damping, 1e-7)
        if gain < 1e-5 * cost + 1e-14:
            break
        evaluate(tree, quest, now, turns, points, axes, residual, jacobian, True)
    evaluate(tree, quest, now, turns, points, axes, residual, jacobian, False)
    return now, residual, cost, done
