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
    SCRATCH_COLUMNS,
    packed_matrix,
    place_frames,
    tree_depths,
)

from .hill import (
    ACTIVATION_TIME,
    DAMPING,
    DEACTIVATION_TIME,
    SHORTEST,
    active_curve,
    next_activation,
    passive_curve,
    speed_curve,
    tendon_curve,
    tendon_length,
)
from .muscle_layout import BLADE_ROWS, PathLayout
from .muscle_path import (
    BLADE_ROOM,
    FRAME_COLUMNS,
    LINK_COLUMNS,
    SPOT_ROWS,
    WRENCH_COLUMNS,
    find_arms,
    gather_frames,
)
from .muscle_path import LENGTH as LENGTH
from .muscle_path import RATE as RATE

Ints = npt.NDArray[np.int64]

# Columns of the table of units.
FORCE, FIBRE, SLACK, PENNATION_SINE, STRAIN = 0, 1, 2, 3, 4
OFFSET, VOLUNTARY, REFLEX_GAIN, REFLEX_THRESHOLD, LEAST = 5, 6, 7, 8, 9
SPEED = 10  # [optimal fibre lengths/s] at which a fibre shortens without load
UNIT_COLUMNS = 11

# Rows of the state of the units, shape [STATE_ROWS, m]: what goes on from step to step ...
ACTIVATION, TENDON = 0, 1  # TENDON: last tension [F_max], or in the implicit mode fibre length
# ... and what the last step found.
ACTIVE, PASSIVE, IMPLICIT, GROWTH, CAPACITY = 4, 5, 6, 7, 8  # after `LENGTH` and `RATE`
STATE_ROWS = 9

RIGID, QUASI_STATIC, IMPLICIT_TENDON = 0, 1, 2
# [slack lengths] A tendon in balance lies between: fibres pull with -0.1 to 3.9 F_max at any state.
SHORTEST_TENDON, LONGEST_TENDON = 0.98, 1.09
BALANCED = 1e-11  # [F_max]: between fibre and tendon, where the implicit mode is content
MOST_TENSION = 4.0  # [F_max]: above what active and capped passive force can be together
BISECTIONS = 50


class Muscles(NamedTuple):
    """What the kernels know of m muscles over n moving parts, and room to work in.

    One tuple and not several: each costs a call about 2 µs.

    Attributes:
        parts: Table of the parts, shape [n, PART_COLUMNS or more]; see `dynamics.py`.
        parents: Part before each one, -1 for the pelvis, shape [n].
        depths: How many parts come before each one, shape [n].
        points, rows, pulleys, pulley_spots, wraps, wrap_spots, scapulae, blades, starts, crossed, cuts,
            entries, is_branched: See `PathLayout`.
        units: Figures of the units, shape [m, UNIT_COLUMNS].
        work: Scratch of the parts, shape [n, SCRATCH_COLUMNS].
        frames: Of the pelvis, all parts and the scapulae, shape [n + 1 + 4 s, FRAME_COLUMNS].
        spots: Of all paths, shape [SPOT_ROWS, p].
        wrenches: Of a unit pull through each cut and on each pulley, shape [s + k, WRENCH_COLUMNS].
        pulley_work, wrap_work: Scratch of pulleys and surfaces, shape [k or w, LINK_COLUMNS].
        blade_work: Scratch of one scapula.
        arms: Moment arm of each crossing [m].
        torques: Of each DoF; the first rows by active and by passive tension [N·m], shape [6, n].
        matrix: The mass matrix, packed as in `dynamics.mass_matrix`.
    """

    parts: Array
    parents: Ints
    depths: Ints
    points: Array
    rows: Ints
    pulleys: Array
    pulley_spots: Ints
    wraps: Array
    wrap_spots: Ints
    scapulae: Ints
    blades: Array
    starts: Ints
    crossed: Ints
    cuts: Ints
    entries: Ints
    is_branched: npt.NDArray[np.bool_]
    units: Array
    work: Array
    frames: Array
    spots: Array
    wrenches: Array
    pulley_work: Array
    wrap_work: Array
    blade_work: Array
    arms: Array
    torques: Array
    matrix: Array


def make_muscles(parts: Array, parents: Ints, layout: PathLayout, units: Array) -> Muscles:
    """Return muscles with room of their own; the tables are shared with the caller."""
    count = len(parents)
    frames = np.zeros((count + 1 + BLADE_ROWS * len(layout.scapulae), FRAME_COLUMNS))
    frames[0, :9] = np.eye(3).ravel()
    return Muscles(
        parts,
        parents,
        tree_depths(parents),
        *layout,
        units,
        np.zeros((count, SCRATCH_COLUMNS)),
        frames,
        np.zeros((SPOT_ROWS, len(layout.points))),
        np.zeros((len(layout.cuts) + len(layout.pulleys), WRENCH_COLUMNS)),
        np.zeros((len(layout.pulleys), LINK_COLUMNS)),
        np.zeros((len(layout.wraps), LINK_COLUMNS)),
        np.zeros(BLADE_ROOM),
        np.zeros(len(layout.crossed)),
        np.zeros((6, count)),
        packed_matrix(parents),
    )


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
        rest = max(cosine * (work[5, m] + units[m, SPEED] * DAMPING * speed), -contractile)
        state[CAPACITY, m] = force * capacity
        state[ACTIVE, m], state[PASSIVE, m] = force * contractile, force * rest
        state[TENDON, m] = contractile + rest
        force *= cosine * cosine / units[m, FIBRE]
        stiffness = force * max(a * active_slope * by_speed + passive_slope, 0.0)
        damping = force * (a * active * speed_slope / units[m, SPEED] + DAMPING)
        state[IMPLICIT, m] = dt * (damping + dt * stiffness)
        state[GROWTH, m] = dt * stiffness * state[RATE, m]


@numba.njit(cache=True, error_model="numpy")
def balance(units, state) -> None:  # type: ignore[no-untyped-def]
    """Do as `pull` does, with elastic tendons that are in balance with their fibres."""
    low, high = np.zeros(units.shape[0]), np.full(units.shape[0], MOST_TENSION)
    for _ in range(BISECTIONS):  # a stretched tendon never gains force faster than it needs it
        guess = 0.5 * (low + high)
        state[TENDON] = guess
        pull(units, state, 0.0, QUASI_STATIC)
        for m in range(units.shape[0]):
            if state[TENDON, m] > guess[m]:
                low[m] = guess[m]
            else:
                high[m] = guess[m]


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
        speed = state[RATE, m] * per_fibre / units[m, SPEED] * cosine
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
    speed = min(max((length - old) / (dt * unit[SPEED]), -1.0), 1.0)
    active, active_slope = active_curve(length)
    by_speed, speed_slope = speed_curve(speed)
    passive, passive_slope = passive_curve(length, unit[STRAIN], unit[OFFSET])
    tendon, tendon_slope = tendon_curve((reach - length * unit[FIBRE] * cosine) / unit[SLACK])
    contractile = activation * active * by_speed
    rest = passive + unit[SPEED] * DAMPING * speed
    fibre_slope = activation * active_slope * by_speed + passive_slope
    fibre_slope += (activation * active * speed_slope / unit[SPEED] + DAMPING) / dt
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
    starts, crossed, arms = muscles.starts, muscles.crossed, muscles.arms
    active, passive = muscles.torques[0], muscles.torques[1]
    active[:] = 0.0
    passive[:] = 0.0
    for m in range(starts.shape[0] - 1):
        for c in range(starts[m, 1], starts[m + 1, 1]):
            dof = crossed[c]
            active[dof] += arms[c] * state[ACTIVE, m]
            passive[dof] += arms[c] * state[PASSIVE, m]


@numba.njit(cache=True, error_model="numpy")
def advance(muscles, q, qd, excitation, state, dt, mode) -> None:  # type: ignore[no-untyped-def]
    """Find paths, and tensions and torques after `dt` [s]; with 0 activations and tendons stay."""
    place_frames(muscles.parts, muscles.parents, q, muscles.work)
    gather_frames(muscles)
    find_arms(muscles, qd, state)
    if dt > 0.0:
        activate(muscles.units, state, excitation, dt)
    if dt > 0.0 or mode != IMPLICIT_TENDON:
        pull(muscles.units, state, dt, mode)
    project(muscles, state)
