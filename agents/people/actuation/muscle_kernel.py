"""Muscles as kernels: from posture to path lengths and moment arms, from activation to torques.

Torques are exact virtual work: the torque of a muscle about a degree of freedom is its tension times
its moment arm, and the moment arm is the derivative of its length. A rate of length is the same
derivative times the joint rates, so no point velocity is ever needed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array
from rcare_marl.tree.dynamics import (
    AXIS_NOW,
    SCRATCH_COLUMNS,
    packed_matrix,
    place_frames,
    tree_depths,
)

from .hill import (
    ACTIVATION_TIME,
    DEACTIVATION_TIME,
    FIBRE_DAMPING,
    MAX_SPEED,
    SHORTEST,
    active_curve,
    next_activation,
    passive_curve,
    speed_curve,
    tendon_curve,
    tendon_length,
)
from .muscle_unit import ARM, ARM_BEFORE, FIRST_WRAP, LEAVES, RADIUS, TURNS, PathLayout
from .muscle_wrap import CENTRE, IS_CYLINDER, TURN, WRAP_RADIUS, wrapped

Ints = npt.NDArray[np.int64]

# Columns of the table of units.
FORCE, FIBRE, SLACK, PENNATION_SINE, STRAIN = 0, 1, 2, 3, 4
OFFSET, VOLUNTARY, REFLEX_GAIN, REFLEX_THRESHOLD, LEAST = 5, 6, 7, 8, 9
UNIT_COLUMNS = 10

# Rows of the state of the units, shape [STATE_ROWS, m]: what goes on from step to step ...
ACTIVATION, TENDON = 0, 1  # TENDON: last tension [F_max], or in the implicit mode fibre length
# ... and what the last step found.
LENGTH, RATE, ACTIVE, PASSIVE, IMPLICIT, GROWTH, CAPACITY = 2, 3, 4, 5, 6, 7, 8
STATE_ROWS = 9

RIGID, QUASI_STATIC, IMPLICIT_TENDON = 0, 1, 2
# [slack lengths] A tendon in balance lies between: fibres pull with -0.1 to 3.9 F_max at any state.
SHORTEST_TENDON, LONGEST_TENDON = 0.98, 1.09
BALANCED = 1e-11  # [F_max]: between fibre and tendon, where the implicit mode is content

# Columns of the frames, one row a part after one for the pelvis: rotation, origin, axis.
_ORIGIN, _AXIS = 9, 12
FRAME_COLUMNS = 15

# Columns of the spots, the points of one path at a time: where it is, the way from the point before; of a
# pulley the arm as the part carries it, the direction between both arms, radius by its length.
_X, _U, _ARM_NOW, _MIDDLE, _LEVER = 0, 3, 6, 9, 12
SPOT_COLUMNS = 13


class Muscles(NamedTuple):
    """What the kernels know of m muscles over n moving parts, and room to work in.

    One tuple and not several: each costs a call about 2 µs.

    Attributes:
        parts: Table of the parts, shape [n, PART_COLUMNS or more]; see `dynamics.py`.
        parents: Part before each one, -1 for the pelvis, shape [n].
        depths: How many parts come before each one, shape [n].
        points, pulleys, wraps, carriers, starts, crossings, entries, is_branched: See `PathLayout`.
        units: Figures of the units, shape [m, UNIT_COLUMNS].
        work: Scratch of the parts, shape [n, SCRATCH_COLUMNS].
        frames: Of the pelvis and all parts, shape [n + 1, FRAME_COLUMNS].
        spots: Scratch of one path, shape [points of the longest path, SPOT_COLUMNS].
        arms: Moment arm of each crossing [m].
        torques: Of each DoF; the first rows by active and by passive tension [N·m], shape [6, n].
        matrix: The mass matrix, packed as in `dynamics.mass_matrix`.
    """

    parts: Array
    parents: Ints
    depths: Ints
    points: Array
    pulleys: Array
    wraps: Array
    carriers: Ints
    starts: Ints
    crossings: Ints
    entries: Ints
    is_branched: npt.NDArray[np.bool_]
    units: Array
    work: Array
    frames: Array
    spots: Array
    arms: Array
    torques: Array
    matrix: Array


def make_muscles(parts: Array, parents: Ints, layout: PathLayout, units: Array) -> Muscles:
    """Return muscles with room of their own; the tables are shared with the caller."""
    count = len(parents)
    frames = np.zeros((count + 1, FRAME_COLUMNS))
    frames[0, :9] = np.eye(3).ravel()
    return Muscles(
        parts,
        parents,
        tree_depths(parents),
        *layout[:8],
        units,
        np.zeros((count, SCRATCH_COLUMNS)),
        frames,
        np.zeros((layout.longest, SPOT_COLUMNS)),
        np.zeros(len(layout.crossings) - 1),
        np.zeros((6, count)),
        packed_matrix(parents),
    )


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


@numba.njit(cache=True, error_model="numpy")
def _wrap_round(wraps, w, frames, row, spots, k):  # type: ignore[no-untyped-def]
    """Write both spots on a surface, k - 2 and k - 1, between the points k - 3 and k.

    Return how much longer than their distance the way between them is [m].
    """
    p0, p1, p2 = _on_surface(wraps, w, frames, row, spots, k - 3)
    s0, s1, s2 = _on_surface(wraps, w, frames, row, spots, k)
    is_cylinder = wraps[w, IS_CYLINDER] > 0.5
    a0, a1, a2, b0, b1, b2, extra = wrapped(
        p0, p1, p2, s0, s1, s2, wraps[w, WRAP_RADIUS], is_cylinder
    )
    t = wraps[w, TURN : TURN + 9]
    for n, e0, e1, e2 in ((k - 2, a0, a1, a2), (k - 1, b0, b1, b2)):
        x, y, z = _turned(
            frames,
            row,
            t[0] * e0 + t[3] * e1 + t[6] * e2 + wraps[w, CENTRE],
            t[1] * e0 + t[4] * e1 + t[7] * e2 + wraps[w, CENTRE + 1],
            t[2] * e0 + t[5] * e1 + t[8] * e2 + wraps[w, CENTRE + 2],
        )
        spots[n, _X] = x + frames[row, _ORIGIN]
        spots[n, _X + 1] = y + frames[row, _ORIGIN + 1]
        spots[n, _X + 2] = z + frames[row, _ORIGIN + 2]
    return extra


@numba.njit(cache=True, error_model="numpy")
def place_path(muscles, m):  # type: ignore[no-untyped-def]
    """Write the spots of a unit's path; return how much longer its arcs are than their chords [m]."""
    points, pulleys, carriers = muscles.points, muscles.pulleys, muscles.carriers
    frames, spots, extra = muscles.frames, muscles.spots, 0.0
    first, count = muscles.starts[m, 0], muscles.starts[m + 1, 0] - muscles.starts[m, 0]
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
        if k > 2 and carriers[p - 1, 1] == LEAVES:
            surface = FIRST_WRAP - carriers[p - 1, 2]
            extra += _wrap_round(muscles.wraps, surface, frames, carriers[p - 1, 0], spots, k)
    return extra


@numba.njit(cache=True, error_model="numpy")
def find_arms(muscles, velocities, state) -> None:  # type: ignore[no-untyped-def]
    """Write the length and rate of each unit into `state`, and each crossing's moment arm."""
    pulleys, carriers = muscles.pulleys, muscles.carriers
    starts, crossings, entries = muscles.starts, muscles.crossings, muscles.entries
    frames, spots, arms = muscles.frames, muscles.spots, muscles.arms
    for m in range(starts.shape[0] - 1):
        first, count = starts[m, 0], starts[m + 1, 0] - starts[m, 0]
        length = place_path(muscles, m)
        for k in range(1, count):
            d0 = spots[k, _X] - spots[k - 1, _X]
            d1 = spots[k, _X + 1] - spots[k - 1, _X + 1]
            d2 = spots[k, _X + 2] - spots[k - 1, _X + 2]
            span = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
            length += span
            each = 1.0 / max(span, 1e-12)
            spots[k, _U], spots[k, _U + 1], spots[k, _U + 2] = d0 * each, d1 * each, d2 * each
        rate = 0.0
        for c in range(starts[m, 1], starts[m + 1, 1]):
            dof = crossings[c, 0]
            slope = 0.0
            for e in range(crossings[c, 1], crossings[c + 1, 1]):
                k, kind = entries[e, 0], entries[e, 1]
                if kind == TURNS:
                    radius = pulleys[carriers[first + k, 1], RADIUS]
                    slope += _pulley_slope(spots, radius, k, count, frames, dof + 1)
                else:
                    slope += kind * _segment_slope(spots, k, frames, dof + 1)
            arms[c] = -slope
            rate += slope * velocities[dof]
        state[LENGTH, m], state[RATE, m] = length, rate


@numba.njit(cache=True, error_model="numpy", inline="always")
def _segment_slope(spots, k, frames, row):  # type: ignore[no-untyped-def]
    """Return how fast a segment grows whose end turns with a joint at unit rate."""
    d0 = spots[k, _X] - frames[row, _ORIGIN]
    d1 = spots[k, _X + 1] - frames[row, _ORIGIN + 1]
    d2 = spots[k, _X + 2] - frames[row, _ORIGIN + 2]
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


@numba.njit(cache=True, error_model="numpy")
def activate(units, state, excitation, dt) -> None:  # type: ignore[no-untyped-def]
    """Carry the activation of each unit on by `dt` [s], after `find_arms`.

    What a person wills is scaled by the strength of the unit; a stretch reflex comes on top.
    """
    for m in range(units.shape[0]):
        drive = units[m, VOLUNTARY] * excitation[m]
        stretch = state[RATE, m] / units[m, FIBRE] - units[m, REFLEX_THRESHOLD]
        if stretch > 0.0:
            drive += units[m, REFLEX_GAIN] * stretch
        now, least = state[ACTIVATION, m], units[m, LEAST]
        state[ACTIVATION, m] = next_activation(
            now, min(drive, 1.0), dt, ACTIVATION_TIME, DEACTIVATION_TIME, least
        )


@numba.njit(cache=True, error_model="numpy")
def pull(units, state, dt, mode) -> None:  # type: ignore[no-untyped-def]
    """Write the tension of each unit, active and passive part [N], after `find_arms`.

    `CAPACITY` gets the active tension of full activation here and now [N].
    `IMPLICIT` gets how much the tension grows over the coming step per acceleration of length
    [N·s²/m], and `GROWTH` how much at the present rate [N]: what a stable integration needs.
    """
    count = units.shape[0]
    if mode == IMPLICIT_TENDON:
        for m in range(count):
            _implicit(units, state, m, dt)
        return
    # Short loops, one after the other: in one long loop each unit would wait for its own results.
    work = np.empty((7, count))
    lengths, cosines, speeds = work[0], work[1], work[2]
    _stretch(units, state, mode, lengths, cosines, speeds)
    _active_curves(lengths, work[3], work[4])
    _passive_curves(units, lengths, work[5], work[6])
    for m in range(count):
        a, cosine, speed, force = state[ACTIVATION, m], cosines[m], speeds[m], units[m, FORCE]
        active, active_slope, passive_slope = work[3, m], work[4, m], work[6, m]
        by_speed, speed_slope = speed_curve(speed)
        capacity = cosine * active * by_speed
        contractile = a * capacity
        rest = max(cosine * (work[5, m] + FIBRE_DAMPING * speed), -contractile)
        state[CAPACITY, m] = force * capacity
        state[ACTIVE, m], state[PASSIVE, m] = force * contractile, force * rest
        state[TENDON, m] = contractile + rest
        force *= cosine * cosine / units[m, FIBRE]
        stiffness = force * max(a * active_slope * by_speed + passive_slope, 0.0)
        damping = force * (a * active * speed_slope + FIBRE_DAMPING) * (1.0 / MAX_SPEED)
        state[IMPLICIT, m] = dt * (damping + dt * stiffness)
        state[GROWTH, m] = dt * stiffness * state[RATE, m]


@numba.njit(cache=True, error_model="numpy")
def _stretch(units, state, mode, lengths, cosines, speeds) -> None:  # type: ignore[no-untyped-def]
    """Write fibre length, cosine of the pennation and fibre speed of each unit, normalised."""
    for m in range(units.shape[0]):
        slack, per_fibre = units[m, SLACK], 1.0 / units[m, FIBRE]
        if mode == QUASI_STATIC:
            slack *= tendon_length(state[TENDON, m])
        along = max((state[LENGTH, m] - slack) * per_fibre, SHORTEST)
        length = math.sqrt(along * along + units[m, PENNATION_SINE] ** 2)
        cosine = along / length
        lengths[m], cosines[m] = length, cosine
        speed = state[RATE, m] * per_fibre * (1.0 / MAX_SPEED) * cosine
        speeds[m] = min(max(speed, -1.0), 1.0)


@numba.njit(cache=True, error_model="numpy")
def _active_curves(lengths, forces, slopes) -> None:  # type: ignore[no-untyped-def]
    for m in range(lengths.shape[0]):
        forces[m], slopes[m] = active_curve(lengths[m])


@numba.njit(cache=True, error_model="numpy")
def _passive_curves(units, lengths, forces, slopes) -> None:  # type: ignore[no-untyped-def]
    for m in range(lengths.shape[0]):
        forces[m], slopes[m] = passive_curve(lengths[m], units[m, STRAIN], units[m, OFFSET])


@numba.njit(cache=True, error_model="numpy")
def _fibre_balance(unit, length, old, reach, activation, dt):  # type: ignore[no-untyped-def]
    """Return fibre less tendon force at a fibre length, its slope, and both fibre forces [F_max]."""
    height = unit[PENNATION_SINE]
    cosine = math.sqrt(max(1.0 - (height / length) ** 2, 1e-4))
    speed = min(max((length - old) / (dt * MAX_SPEED), -1.0), 1.0)
    active, active_slope = active_curve(length)
    by_speed, speed_slope = speed_curve(speed)
    passive, passive_slope = passive_curve(length, unit[STRAIN], unit[OFFSET])
    tendon, tendon_slope = tendon_curve((reach - length * unit[FIBRE] * cosine) / unit[SLACK])
    contractile = activation * active * by_speed
    rest = passive + FIBRE_DAMPING * speed
    fibre_slope = activation * active_slope * by_speed + passive_slope
    fibre_slope += (activation * active * speed_slope + FIBRE_DAMPING) / (dt * MAX_SPEED)
    turn = height * height / (length**3 * cosine)  # of the cosine with the length
    slope = fibre_slope * cosine + (contractile + rest) * turn
    slope += tendon_slope * unit[FIBRE] / unit[SLACK] * (cosine + length * turn)
    return (contractile + rest) * cosine - tendon, slope, contractile, rest, fibre_slope * cosine


@numba.njit(cache=True, error_model="numpy", inline="always")
def _fibre_length(unit, reach, tendon):  # type: ignore[no-untyped-def]
    """Return the fibre length beside a tendon of a normalised length."""
    along = max((reach - tendon * unit[SLACK]) / unit[FIBRE], 0.0)
    return math.sqrt(along * along + unit[PENNATION_SINE] ** 2)


@numba.njit(cache=True, error_model="numpy")
def _implicit(units, state, m, dt) -> None:  # type: ignore[no-untyped-def]
    """Carry the fibre length on by a backward Euler step: bracketed Newton."""
    unit = units[m]
    old, reach, activation = state[TENDON, m], state[LENGTH, m], state[ACTIVATION, m]
    least = max(unit[PENNATION_SINE] + 1e-3, 0.2)
    low = max(_fibre_length(unit, reach, LONGEST_TENDON), least)
    high = max(_fibre_length(unit, reach, SHORTEST_TENDON), least)
    length = min(max(old, low), high)
    for n in range(80):
        error, slope, contractile, rest, stiffness = _fibre_balance(
            unit, length, old, reach, activation, dt
        )
        if abs(error) < BALANCED:
            break
        if error > 0.0:
            high = min(high, length)
        else:
            low = max(low, length)
        after = length - error / slope if slope > 1e-9 else 0.5 * (low + high)
        if not low < after < high or (n > 6 and n % 2):  # Newton is slow on a steep tendon
            after = 0.5 * (low + high)
        length = after
    cosine = math.sqrt(max(1.0 - (unit[PENNATION_SINE] / length) ** 2, 1e-4))
    tendon, tendon_slope = tendon_curve((reach - length * unit[FIBRE] * cosine) / unit[SLACK])
    tension = unit[FORCE] * max(tendon, 0.0)
    both = contractile + rest
    share = min(max(contractile / both, 0.0), 1.0) if both > 1e-9 else 0.0
    state[TENDON, m] = length
    state[CAPACITY, m] = contractile / max(activation, 1e-6) * cosine * unit[FORCE]
    state[ACTIVE, m], state[PASSIVE, m] = tension * share, tension * (1.0 - share)
    of_fibre = max(stiffness, 0.0) / unit[FIBRE]
    of_tendon = tendon_slope / unit[SLACK]
    in_series = unit[FORCE] * of_fibre * of_tendon / (of_fibre + of_tendon + 1e-12)
    state[IMPLICIT, m] = dt * dt * in_series
    state[GROWTH, m] = dt * in_series * state[RATE, m]


@numba.njit(cache=True, error_model="numpy")
def project(muscles, state) -> None:  # type: ignore[no-untyped-def]
    """Write the torque about each DoF by active and by passive tension [N·m]."""
    starts, crossings, arms = muscles.starts, muscles.crossings, muscles.arms
    active, passive = muscles.torques[0], muscles.torques[1]
    active[:] = 0.0
    passive[:] = 0.0
    for m in range(starts.shape[0] - 1):
        for c in range(starts[m, 1], starts[m + 1, 1]):
            dof = crossings[c, 0]
            active[dof] += arms[c] * state[ACTIVE, m]
            passive[dof] += arms[c] * state[PASSIVE, m]


@numba.njit(cache=True, error_model="numpy")
def advance(muscles, q, qd, excitation, state, dt, mode) -> None:  # type: ignore[no-untyped-def]
    """Find paths, and tensions and torques after `dt` [s]; with 0 activations and tendons stay."""
    place_frames(muscles.parts, muscles.parents, q, muscles.work)
    gather_frames(muscles.work, muscles.frames)
    find_arms(muscles, qd, state)
    if dt > 0.0:
        activate(muscles.units, state, excitation, dt)
    if dt > 0.0 or mode != IMPLICIT_TENDON:
        pull(muscles.units, state, dt, mode)
    project(muscles, state)
