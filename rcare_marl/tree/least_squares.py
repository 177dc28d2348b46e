"""Damped least squares of few residuals over many joints, within limits, and rotation vectors: kernels."""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True)
def put(values, out) -> None:  # type: ignore[no-untyped-def]
    """Write `values` [n] into `out` [n].

    `out[:] = values` would do, but for that numba compiles the text of an error: 4 to 7 s in each process.
    """
    for i in range(out.shape[0]):
        out[i] = values[i]


@numba.njit(cache=True)
def rotation_vector(turn, wanted):  # type: ignore[no-untyped-def]
    """Return the rotation vector [3] that turns the axes `wanted` into `turn`, both [3, >= 3]."""
    e, out = np.zeros((3, 3)), np.empty(3)
    for r in range(3):
        for c in range(3):
            for k in range(3):
                e[r, c] += turn[r, k] * wanted[c, k]
    out[0], out[1], out[2] = e[2, 1] - e[1, 2], e[0, 2] - e[2, 0], e[1, 0] - e[0, 1]
    sine = 0.5 * math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    cosine = 0.5 * (e[0, 0] + e[1, 1] + e[2, 2] - 1)
    if sine > 1e-9:
        out *= 0.5 * math.atan2(sine, cosine) / sine
    elif cosine > 0:
        out *= 0.5
    else:  # a half turn: the largest column of e + 1 lies along the axis
        k = 0
        for i in range(1, 3):
            if e[i, i] > e[k, k]:
                k = i
        e[k, k] += 1
        length = math.sqrt(e[0, k] ** 2 + e[1, k] ** 2 + e[2, k] ** 2)
        for r in range(3):
            out[r] = math.pi * e[r, k] / length
    return out


@numba.njit(cache=True)
def turn_frame(frame, vector) -> None:  # type: ignore[no-untyped-def]
    """Turn `frame` [3, 4] in place about the world `vector` [rad]; its origin stays."""
    angle = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    if angle < 1e-12:
        return
    x, y, z = vector[0] / angle, vector[1] / angle, vector[2] / angle
    s, c = math.sin(angle), math.cos(angle)
    k = 1 - c
    for i in range(3):
        a, b, d = frame[0, i], frame[1, i], frame[2, i]
        frame[0, i] = (c + k * x * x) * a + (k * x * y - s * z) * b + (k * x * z + s * y) * d
        frame[1, i] = (k * x * y + s * z) * a + (c + k * y * y) * b + (k * y * z - s * x) * d
        frame[2, i] = (k * x * z - s * y) * a + (k * y * z + s * x) * b + (c + k * z * z) * d


@numba.njit(cache=True)
def solve_rows(matrix, free, slope, stiff, floor, b) -> None:  # type: ignore[no-untyped-def]
    """Solve (A S⁻¹ Aᵀ + floor) y = b + A S⁻¹ slope in place, by Cholesky.

    It is the dual of least squares with damping: x = S⁻¹ (Aᵀ y - slope) is that of least
    |A x - b|² / floor + 2 slope·x + S x².

    Args:
        matrix: A, shape [r, n].
        free: Which joints count, shape [n].
        slope: Of the cost along each joint, shape [n].
        stiff: Diagonal of S, shape [n].
        floor: Damping of the residuals.
        b: Right-hand side, then the solution, shape [r].
    """
    rows, count = matrix.shape
    k = np.zeros((rows, rows))
    for i in range(rows):
        wish = 0.0
        for c in range(count):
            if free[c] and matrix[i, c] != 0.0:  # few joints move what a goal is about
                share = matrix[i, c] / stiff[c]
                wish += share * slope[c]
                for j in range(i + 1):
                    k[i, j] += share * matrix[j, c]
        b[i] += wish
        k[i, i] += floor
    for i in range(rows):
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


@numba.njit(cache=True)
def least_squares(matrix, wanted, free, damping):  # type: ignore[no-untyped-def]
    """Return x [n] of least |matrix x - wanted|² + damping² |x|², zero where not `free`."""
    rows, n = matrix.shape
    y, x = wanted.copy(), np.zeros(n)
    solve_rows(matrix, free, np.zeros(n), np.ones(n), damping * damping, y)
    for k in range(n):
        if free[k]:
            for i in range(rows):
                x[k] += matrix[i, k] * y[i]
    return x


@numba.njit(cache=True)
def bounded_step(matrix, wanted, q, lower, upper, pull, damping):  # type: ignore[no-untyped-def]
    """Return a joint step [n] towards `wanted` [r] that stays within limits.

    A joint that would leave its limits goes onto the limit and the others are solved again. `pull`
    [n] is a wish for the joints, honoured as far as it does not move the tool.
    """
    n = len(q)
    step, free = np.zeros(n), np.ones(n, np.bool_)
    rest = wanted.copy()
    for _ in range(n):
        step_free = least_squares(matrix, rest - matrix @ (pull * free), free, damping)
        blocked = False
        for i in range(n):
            if not free[i]:
                continue
            step[i] = step_free[i] + pull[i]
            bounded = min(max(step[i], lower[i] - q[i]), upper[i] - q[i])
            if bounded != step[i]:
                step[i], free[i], blocked = bounded, False, True
                for r in range(len(rest)):
                    rest[r] -= matrix[r, i] * bounded
        if not blocked:
            break
    return step
