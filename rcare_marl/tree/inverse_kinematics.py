"""Inverse kinematics of a tree: residuals of goals, their exact Jacobian, and a bounded search.

The search is a Levenberg-Marquardt one: K. Levenberg 1944 and D. Marquardt 1963, with the step found in
the space of the residuals, of which there are far fewer than joints. A joint that would pass its limit is
put onto it and the others are solved again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from rcare_marl.pose import Array

from .joint_tree import Ints, carried_moments, new_frames, place
from .least_squares import put, rotation_vector, solve_rows

POSITION, ORIENTATION, DIRECTION, GAZE, BALANCE = range(5)
ROWS = 3  # residuals of one goal
_WEIGHT, _OFFSET, _TARGET = 0, 1, 4  # columns of a goal's numbers
GOAL_COLUMNS = 13
_LARGEST_STEP = 0.6  # [rad or m] of one joint in one step, where the Jacobian still means something
_TRIES = 8  # of growing damping before the search gives up
_BOUND_ROUNDS = 6  # of putting joints onto their limits


class IkProblem(NamedTuple):
    """What a tree is asked for.

    Attributes:
        order: The joints whose place matters, proximal first, shape [k].
        columns: The joints that may move, shape [c].
        kinds: Of each goal, shape [g].
        parts: Joint whose frame each goal is about, shape [g].
        numbers: Weight, offset or local direction, and target of each goal, shape [g, 13].
        polygon: The support of a balance goal [m], counter-clockwise, shape [v, 2].
        lower: Lower limits [rad or m], shape [n].
        upper: Upper limits [rad or m], shape [n].
        rest: Posture that is preferred where goals leave a choice, shape [n].
        pull: Weight of the squared distance to it, shape [n].
    """

    order: Ints
    columns: Ints
    kinds: Ints
    parts: Ints
    numbers: Array
    polygon: Array
    lower: Array
    upper: Array
    rest: Array
    pull: Array


class Linear(NamedTuple):
    """Residuals and their Jacobian at a posture.

    Attributes:
        residual: Weighted, three a goal, shape [3 g].
        jacobian: Of them, by the joints that may move, shape [3 g, c].
    """

    residual: Array
    jacobian: Array


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
def _balance(tree, problem, row, at, q, frames, out, wants) -> None:  # type: ignore[no-untyped-def]
    count = tree.parents.shape[0]
    mass, moment = np.empty(count), np.empty((count, 3))
    carried_moments(tree, q, frames, mass, moment)
    residual, jacobian = out
    total, w = mass[0], row[_WEIGHT]
    x, y = moment[0, 0] / total, moment[0, 1] / total
    px, py, nx, ny = _nearest(problem.polygon, x, y)
    residual[at], residual[at + 1], residual[at + 2] = w * (x - px), w * (y - py), 0.0
    if not wants:
        return
    for c in range(problem.columns.shape[0]):
        i = problem.columns[c]
        a, p, m = frames.axes[i], frames.points[i], mass[i]
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
def evaluate(tree, problem, q, frames, out, wants) -> None:  # type: ignore[no-untyped-def]
    """Write the residuals at `q` [n] and, where it `wants` it, their Jacobian."""
    place(tree, problem.order, q, frames)
    turns, points, axes = frames
    residual, jacobian = out
    x, d, v, phi, row_ = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    moves = np.zeros(tree.parents.shape[0], np.bool_)
    if wants:
        jacobian[:] = 0.0
    for g in range(problem.kinds.shape[0]):
        kind, part, at, row = problem.kinds[g], problem.parts[g], ROWS * g, problem.numbers[g]
        w, far = row[_WEIGHT], 1.0
        if kind == BALANCE:
            _balance(tree, problem, row, at, q, frames, out, wants)
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
            put(rotation_vector(turn, row[_TARGET:].reshape(3, 3)), phi)
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
        moves[:] = False
        i = part
        while i >= 0:
            moves[i], i = True, tree.parents[i]
        for c in range(problem.columns.shape[0]):
            i = problem.columns[c]
            if not moves[i]:
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
def _cost(problem, residual, q):  # type: ignore[no-untyped-def]
    total = 0.0
    for value in residual:
        total += value * value
    for k in problem.columns:
        total += problem.pull[k] * (q[k] - problem.rest[k]) ** 2
    return total


@numba.njit(cache=True)
def _bounded(problem, here, q, damping, step) -> None:  # type: ignore[no-untyped-def]
    """Write the step d [c] within the limits of least |J d + r|² + slope·d·2 + stiff d²."""
    columns, jacobian, left = problem.columns, here.jacobian, -here.residual
    rows, count = jacobian.shape
    free, b = np.ones(count, np.bool_), np.empty(rows)
    slope, stiff = np.empty(count), np.empty(count)
    for c in range(count):
        k = columns[c]
        stiff[c] = problem.pull[k] + damping
        slope[c] = problem.pull[k] * (q[k] - problem.rest[k])
    for _ in range(_BOUND_ROUNDS):
        put(left, b)
        solve_rows(jacobian, free, slope, stiff, 1.0, b)
        blocked = False
        for c in range(count):
            if not free[c]:
                continue
            k, total = columns[c], -slope[c]
            for r in range(rows):
                total += jacobian[r, c] * b[r]
            step[c] = total / stiff[c]
            bounded = min(max(step[c], problem.lower[k] - q[k]), problem.upper[k] - q[k])
            if bounded != step[c]:
                step[c], free[c], blocked = bounded, False, True
                for r in range(rows):
                    left[r] -= jacobian[r, c] * bounded
        if not blocked:
            break


@numba.njit(cache=True)
def search(tree, problem, q, iterations):  # type: ignore[no-untyped-def]
    """Return a posture of least cost near `q` [n], its residuals [3 g], its cost, and the iterations.

    Only the joints in `problem.columns` move.
    """
    columns, lower, upper = problem.columns, problem.lower, problem.upper
    rows, count = ROWS * problem.kinds.shape[0], columns.shape[0]
    frames, step = new_frames(q.shape[0]), np.zeros(count)
    here = Linear(np.zeros(rows), np.zeros((rows, count)))
    there = Linear(np.zeros(rows), here.jacobian)
    now = q.copy()
    for k in columns:
        now[k] = min(max(now[k], lower[k]), upper[k])
    trial, damping, done = now.copy(), 1e-3, 0
    evaluate(tree, problem, now, frames, here, True)
    cost = _cost(problem, here.residual, now)
    while done < iterations:
        done += 1
        better = False
        for _ in range(_TRIES):
            _bounded(problem, here, now, damping, step)
            longest = 0.0
            for value in step:
                longest = max(longest, abs(value))
            scale = min(1.0, _LARGEST_STEP / max(longest, 1e-12))
            for c in range(count):
                k = columns[c]
                trial[k] = min(max(now[k] + scale * step[c], lower[k]), upper[k])
            evaluate(tree, problem, trial, frames, there, False)
            trial_cost = _cost(problem, there.residual, trial)
            if trial_cost < cost:
                better = True
                break
            damping *= 4.0
        if not better:
            break
        gain, cost = cost - trial_cost, trial_cost
        put(trial, now)
        damping = max(0.25 * damping, 1e-7)
        if gain < 1e-5 * cost + 1e-14:
            break
        evaluate(tree, problem, now, frames, here, True)
    evaluate(tree, problem, now, frames, here, False)
    return now, here.residual, cost, done
