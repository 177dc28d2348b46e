"""Muscle paths as kernels: from the frames of a person's parts to lengths, rates and moment arms.

A path is straight between its spots; spots on surfaces and pulleys follow their neighbours. Its pull is a
wrench through each segment, so that a moment arm needs no derivative of where a spot is.
"""

from __future__ import annotations

import math

import numba

from rcare_marl.tree.dynamics import AXIS_NOW

from .muscle_unit import ARM, ARM_BEFORE, FIRST_WRAP, LEAVES, RADIUS, TURNS
from .muscle_wrap import CENTRE, IS_CYLINDER, TURN, WRAP_RADIUS, wrapped

LENGTH, RATE = 2, 3  # rows of the state of the units, see `muscle_kernel.py`

# Columns of the frames, one row a part after one for the pelvis: rotation, origin, axis.
_ORIGIN, _AXIS = 9, 12
FRAME_COLUMNS = 15

# Columns of the spots, the points of one path at a time: where it is, the way from the point before; of a
# pulley the arm as the part carries it, the direction between both arms, radius by its length.
_X, _U, _ARM_NOW, _MIDDLE, _LEVER = 0, 3, 6, 9, 12
SPOT_COLUMNS = 13


@numba.njit(cache=True, error_model="numpy")
def gather_frames(work, frames) -> None:  # type: ignore[no-untyped-def]
    """Write the frames of all parts close together; the row of the pelvis is never written."""
    for i in range(work.shape[0]):
        for a in range(12):
            frames[i + 1, a] = work[i, a]
        for a in range(3):
            frames[i + 1, _AXIS + a] = work[i, AXIS_NOW + a]


@numba.njit(cache=True, error_model="numpy", inline="always")
def _turned(frames, row, x, y, z):  # type: ignore[no-untyped-def]
    """Return a vector of a part's frame in that of the pelvis."""
    return (
        frames[row, 0] * x + frames[row, 1] * y + frames[row, 2] * z,
        frames[row, 3] * x + frames[row, 4] * y + frames[row, 5] * z,
        frames[row, 6] * x + frames[row, 7] * y + frames[row, 8] * z,
    )


@numba.njit(cache=True, error_model="numpy")
def _turn_pulley(pulleys, pulley, frames, row, before, spots, k) -> None:  # type: ignore[no-untyped-def]
    """Move a point from the centre of its pulley to its rim."""
    a0, a1, a2 = _turned(
        frames, row, pulleys[pulley, ARM], pulleys[pulley, ARM + 1], pulleys[pulley, ARM + 2]
    )
    c0, c1, c2 = (
        pulleys[pulley, ARM_BEFORE],
        pulleys[pulley, ARM_BEFORE + 1],
        pulleys[pulley, ARM_BEFORE + 2],
    )
    b0, b1, b2 = _turned(frames, before, c0, c1, c2)
    spots[k, _ARM_NOW], spots[k, _ARM_NOW + 1], spots[k, _ARM_NOW + 2] = a0, a1, a2
    b0, b1, b2 = a0 + b0, a1 + b1, a2 + b2
    norm = 1.0 / (math.sqrt(b0 * b0 + b1 * b1 + b2 * b2) + 1e-12)
    b0, b1, b2 = b0 * norm, b1 * norm, b2 * norm
    radius = pulleys[pulley, RADIUS]
    spots[k, _MIDDLE], spots[k, _MIDDLE + 1], spots[k, _MIDDLE + 2] = b0, b1, b2
    spots[k, _LEVER] = radius * norm
    spots[k, _X] += radius * b0
    spots[k, _X + 1] += radius * b1
    spots[k, _X + 2] += radius * b2


@numba.njit(cache=True, error_model="numpy", inline="always")
def _on_surface(wraps, w, frames, row, spots, k):  # type: ignore[no-untyped-def]
    """Return a spot in the frame of a surface."""
    d0 = spots[k, _X] - frames[row, _ORIGIN]
    d1 = spots[k, _X + 1] - frames[row, _ORIGIN + 1]
    d2 = spots[k, _X + 2] - frames[row, _ORIGIN + 2]
    x = frames[row, 0] * d0 + frames[row, 3] * d1 + frames[row, 6] * d2 - wraps[w, CENTRE]
    y = frames[row, 1] * d0 + frames[row, 4] * d1 + frames[row, 7] * d2 - wraps[w, CENTRE + 1]
    z = frames[row, 2] * d0 + frames[row, 5] * d1 + frames[row, 8] * d2 - wraps[w, CENTRE + 2]
    return (
        wraps[w, TURN] * x + wraps[w, TURN + 1] * y + wraps[w, TURN + 2] * z,
        wraps[w, TURN + 3] * x + wraps[w, TURN + 4] * y + wraps[w, TURN + 5] * z,
        wraps[w, TURN + 6] * x + wraps[w, TURN + 7] * y + wraps[w, TURN + 8] * z,
    )


@numba.njit(cache=True, error_model="numpy", inline="always")
def _segment(spots, k):  # type: ignore[no-untyped-def]
    """Write the direction of the segment that ends in a spot, and return its length."""
    d0 = spots[k, _X] - spots[k - 1, _X]
    d1 = spots[k, _X + 1] - spots[k - 1, _X + 1]
    d2 = spots[k, _X + 2] - spots[k - 1, _X + 2]
    span = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    each = 1.0 / max(span, 1e-12)
    spots[k, _U], spots[k, _U + 1], spots[k, _U + 2] = d0 * each, d1 * each, d2 * each
    return span


@numba.njit(cache=True, error_model="numpy")
def _from_surface(wraps, w, frames, row, e0, e1, e2, is_spot, spots, k, column) -> None:  # type: ignore[no-untyped-def]
    """Write a spot, or with `is_spot` 0 a direction, that is given in the frame of a surface."""
    x, y, z = _turned(
        frames,
        row,
        wraps[w, TURN] * e0
        + wraps[w, TURN + 3] * e1
        + wraps[w, TURN + 6] * e2
        + wraps[w, CENTRE] * is_spot,
        wraps[w, TURN + 1] * e0
        + wraps[w, TURN + 4] * e1
        + wraps[w, TURN + 7] * e2
        + wraps[w, CENTRE + 1] * is_spot,
        wraps[w, TURN + 2] * e0
        + wraps[w, TURN + 5] * e1
        + wraps[w, TURN + 8] * e2
        + wraps[w, CENTRE + 2] * is_spot,
    )
    spots[k, column] = x + frames[row, _ORIGIN] * is_spot
    spots[k, column + 1] = y + frames[row, _ORIGIN + 1] * is_spot
    spots[k, column + 2] = z + frames[row, _ORIGIN + 2] * is_spot


@numba.njit(cache=True, error_model="numpy")
def _wrap_round(wraps, w, frames, row, spots, k):  # type: ignore[no-untyped-def]
    """Write both spots on a surface, k - 2 and k - 1, between the points k - 3 and k.

    Return the length of the path from k - 3 to k - 1 [m].
    """
    p0, p1, p2 = _on_surface(wraps, w, frames, row, spots, k - 3)
    s0, s1, s2 = _on_surface(wraps, w, frames, row, spots, k)
    is_cylinder = wraps[w, IS_CYLINDER] > 0.5
    t0, t1, t2, u0, u1, u2, extra, push, other = wrapped(
        p0, p1, p2, s0, s1, s2, wraps[w, WRAP_RADIUS], is_cylinder
    )
    for a in range(3):
        spots[k - 2, _ARM_NOW + a] = spots[k - 1, _ARM_NOW + a] = 0.0
    if extra < 0.0:
        for a in range(3):
            spots[k - 2, a] = spots[k - 1, a] = 0.5 * (spots[k - 3, a] + spots[k, a])
        return _segment(spots, k - 2)
    _from_surface(wraps, w, frames, row, t0, t1, t2, 1.0, spots, k - 2, _X)
    _from_surface(wraps, w, frames, row, u0, u1, u2, 1.0, spots, k - 1, _X)
    length = _segment(spots, k - 2) + _segment(spots, k - 1) + extra
    if push != 0.0 or other != 0.0:
        p2, s2 = (0.0, 0.0) if is_cylinder else (p2, s2)
        _from_surface(
            wraps, w, frames, row, push * p0, push * p1, push * p2, 0.0, spots, k - 2, _ARM_NOW
        )
        _from_surface(
            wraps, w, frames, row, other * s0, other * s1, other * s2, 0.0, spots, k - 1, _ARM_NOW
        )
        for a in range(3):
            spots[k - 2, _U + a] -= spots[k - 2, _ARM_NOW + a]
    return length


@numba.njit(cache=True, error_model="numpy", inline="always")
def _place(points, pulleys, wraps, carriers, frames, spots, first, count):  # type: ignore[no-untyped-def]
    """Write the spots of a path and the ways between them; return its length."""
    length = 0.0
    for k in range(count):
        p = first + k
        row, pulley = carriers[p, 0], carriers[p, 1]
        if carriers[p, 2] <= FIRST_WRAP:  # the point after the surface places both its spots
            continue
        x, y, z = _turned(frames, row, points[p, 0], points[p, 1], points[p, 2])
        spots[k, _X] = x + frames[row, _ORIGIN]
        spots[k, _X + 1] = y + frames[row, _ORIGIN + 1]
        spots[k, _X + 2] = z + frames[row, _ORIGIN + 2]
        if pulley >= 0:
            _turn_pulley(pulleys, pulley, frames, row, carriers[p, 2], spots, k)
        if k > 0:
            if carriers[p - 1, 1] == LEAVES:
                surface = FIRST_WRAP - carriers[p - 1, 2]
                length += _wrap_round(wraps, surface, frames, carriers[p - 1, 0], spots, k)
            length += _segment(spots, k)
            if carriers[p - 1, 1] == LEAVES:  # how the surface makes room for the point
                for a in range(3):
                    spots[k, _U + a] += spots[k - 1, _ARM_NOW + a]
    return length


@numba.njit(cache=True, error_model="numpy")
def place_path(muscles, m):  # type: ignore[no-untyped-def]
    """Write the spots of one unit's path, and return how many they are."""
    first, count = muscles.starts[m, 0], muscles.starts[m + 1, 0] - muscles.starts[m, 0]
    points, pulleys = muscles.points, muscles.pulleys
    _place(
        points,
        pulleys,
        muscles.wraps,
        muscles.carriers,
        muscles.frames,
        muscles.spots,
        first,
        count,
    )
    return count


@numba.njit(cache=True, error_model="numpy")
def find_arms(muscles, velocities, state) -> None:  # type: ignore[no-untyped-def]
    """Write the length and rate of each unit into `state`, and each crossing's moment arm."""
    points, pulleys, wraps, carriers = (
        muscles.points,
        muscles.pulleys,
        muscles.wraps,
        muscles.carriers,
    )
    starts, crossings, entries = muscles.starts, muscles.crossings, muscles.entries
    frames, spots, arms = muscles.frames, muscles.spots, muscles.arms
    for m in range(starts.shape[0] - 1):
        first, count = starts[m, 0], starts[m + 1, 0] - starts[m, 0]
        length = _place(points, pulleys, wraps, carriers, frames, spots, first, count)
        rate = 0.0
        for c in range(starts[m, 1], starts[m + 1, 1]):
            dof = crossings[c, 0]
            slope = 0.0
            for e in range(crossings[c, 1], crossings[c + 1, 1]):
                k, kind = entries[e, 0], entries[e, 1]
                if kind == TURNS:
                    radius = pulleys[carriers[first + k, 1], RADIUS]
                    slope += _pulley_slope(spots, radius, k, count, frames, dof + 1)
                elif abs(kind) == 1:
                    slope += kind * _segment_slope(spots, k, k, frames, dof + 1)
                else:
                    slope += 0.5 * kind * _segment_slope(spots, k, k - 1, frames, dof + 1)
            arms[c] = -slope
            rate += slope * velocities[dof]
        state[LENGTH, m], state[RATE, m] = length, rate


@numba.njit(cache=True, error_model="numpy", inline="always")
def _segment_slope(spots, k, at, frames, row):  # type: ignore[no-untyped-def]
    """Return how fast a segment grows whose end, on the line through a spot, turns at unit rate."""
    d0 = spots[at, _X] - frames[row, _ORIGIN]
    d1 = spots[at, _X + 1] - frames[row, _ORIGIN + 1]
    d2 = spots[at, _X + 2] - frames[row, _ORIGIN + 2]
    u0, u1, u2 = spots[k, _U], spots[k, _U + 1], spots[k, _U + 2]
    return (
        frames[row, _AXIS] * (d1 * u2 - d2 * u1)
        + frames[row, _AXIS + 1] * (d2 * u0 - d0 * u2)
        + frames[row, _AXIS + 2] * (d0 * u1 - d1 * u0)
    )


@numba.njit(cache=True, error_model="numpy")
def _pulley_slope(spots, radius, k, count, frames, row):  # type: ignore[no-untyped-def]
    """Return how fast a path grows whose pulley is turned at one side by a joint at unit rate."""
    a0, a1, a2 = frames[row, _AXIS], frames[row, _AXIS + 1], frames[row, _AXIS + 2]
    w0 = a1 * spots[k, _ARM_NOW + 2] - a2 * spots[k, _ARM_NOW + 1]
    w1 = a2 * spots[k, _ARM_NOW] - a0 * spots[k, _ARM_NOW + 2]
    w2 = a0 * spots[k, _ARM_NOW + 1] - a1 * spots[k, _ARM_NOW]
    m0, m1, m2 = spots[k, _MIDDLE], spots[k, _MIDDLE + 1], spots[k, _MIDDLE + 2]
    along, lever = w0 * m0 + w1 * m1 + w2 * m2, spots[k, _LEVER]
    c0 = spots[k, _X] - radius * m0 - frames[row, _ORIGIN]  # the centre may be carried too
    c1 = spots[k, _X + 1] - radius * m1 - frames[row, _ORIGIN + 1]
    c2 = spots[k, _X + 2] - radius * m2 - frames[row, _ORIGIN + 2]
    v0 = lever * (w0 - along * m0) + a1 * c2 - a2 * c1
    v1 = lever * (w1 - along * m1) + a2 * c0 - a0 * c2
    v2 = lever * (w2 - along * m2) + a0 * c1 - a1 * c0
    slope = 0.0
    if k > 0:
        slope += spots[k, _U] * v0 + spots[k, _U + 1] * v1 + spots[k, _U + 2] * v2
    if k < count - 1:
        slope -= spots[k + 1, _U] * v0 + spots[k + 1, _U + 1] * v1 + spots[k + 1, _U + 2] * v2
    return slope
