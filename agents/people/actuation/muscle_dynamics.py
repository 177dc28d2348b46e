"""The physics step of a person who is driven by muscles, compiled: from what they are told to torques.

One table has a row a degree of freedom; the columns after those of the parts are named here. `muscular.py`
says what the parts of a torque are, and why tension is taken at the end of the step.
"""

from __future__ import annotations

import numba
import numpy as np

from rcare_marl.tree.dynamics import WEIGHT, mass_matrix, place_masses, solve

from . import muscle_kernel as kernel

# Our own choices.
ACTIVE_END = 0.07  # [rad] before the end of the active range where active torque begins to fade
ACTIVE_END_DAMPING = 0.5  # [s/rad] of the torque that fades there
CARRY_GAP = 0.01  # [rad] above the posture where furniture lets go
GRIP_REACH = 0.02  # [rad] from where a limb was laid down: friction holds it no further

# Columns of the table after those of the parts, one row a DoF.
STIFFNESS, DAMPING, TISSUE, SUPPORT = 28, 29, 30, 31
LOWEST, HIGHEST, POSTURE = 32, 33, 34
LEAST, MOST, ZONE, LIGAMENT, INERTIA = 35, 36, 37, 38, 39
CARRIED, SLACK, GRIP, BORNE, ELASTIC = 40, 41, 42, 43, 44
MOST_AGAINST, MOST_ALONG, OVER_AGAINST, OVER_ALONG, REFLEX = 45, 46, 47, 48, 49
COLUMNS = 50
HELD = 32  # of the scratch: whether furniture holds the limb in this step

# Rows of the torques: active, passive, faded active; damping at both kinds of ends; of ligaments the
# torque and the stiffness.


@numba.njit(cache=True, error_model="numpy")
def observe(muscles, measured, excitation, gravity, state, dt, mode) -> None:  # type: ignore[no-untyped-def]
    """Find lengths, moment arms, tensions, torques, weights and the mass matrix after `dt` [s].

    With a `dt` of 0 no time passes: activations and the state of tendons stay.
    """
    kernel.advance(muscles, measured[0], measured[1], excitation, state, dt, mode)
    place_masses(muscles.parts, muscles.work)
    mass_matrix(muscles.parents, muscles.depths, gravity, muscles.work, muscles.matrix)


@numba.njit(cache=True, error_model="numpy")
def damped_rates(muscles, gravity, damping, ahead, rates) -> None:  # type: ignore[no-untyped-def]
    """Turn `rates` [rad/s] into those that are left when `damping` [N·m·s/rad] has acted for `ahead` [s]."""
    parents, depths, matrix = muscles.parents, muscles.depths, muscles.matrix
    place_masses(muscles.parts, muscles.work)
    mass_matrix(parents, depths, gravity, muscles.work, matrix)
    before = rates.copy()
    for i in range(rates.shape[0]):
        rates[i] = matrix[i, depths[i]] * before[i]
        j = parents[i]
        while j >= 0:
            rates[i] += matrix[i, depths[j]] * before[j]
            rates[j] += matrix[i, depths[j]] * before[i]
            j = parents[j]
        matrix[i, depths[i]] += ahead * damping[i]
    solve(parents, depths, matrix, rates)


@numba.njit(cache=True, error_model="numpy")
def drive(  # type: ignore[no-untyped-def]
    muscles, measured, told, involuntary, gravity, state, dt, mode, out
) -> None:
    """Write the torque of each DoF into `out`."""
    observe(muscles, measured, told, gravity, state, dt, mode)
    table, work, torques = muscles.parts, muscles.work, muscles.torques
    depths, matrix = muscles.depths, muscles.matrix
    _take_reflexes(muscles, state, involuntary)
    _tighten(table, measured, torques)
    _limit(table, torques)
    _fade(table, measured, torques)
    for i in range(table.shape[0]):
        velocity, support = measured[1, i], _support(table, measured, work, i, dt)
        work[i, HELD] = support
        stiffness, damping = table[i, STIFFNESS], table[i, DAMPING]
        loose = table[i, TISSUE] + torques[3, i] + dt * torques[5, i]
        ahead = measured[0, i] + dt * velocity
        given = torques[1, i] + torques[2, i] + torques[4, i] + table[i, REFLEX]
        out[i] = given - loose * velocity
        held = stiffness * (table[i, POSTURE] - ahead) - damping * velocity - table[i, SLACK]
        out[i] += support * held
        out[i] -= (1.0 - support) * work[i, WEIGHT]
        matrix[i, depths[i]] += dt * (loose + support * (damping + dt * stiffness))
    _continue(muscles, state, out)
    solve(muscles.parents, depths, matrix, out)
    for i in range(table.shape[0]):
        torques[0, i] = out[i]  # the acceleration, for `_settle`
        support, after = work[i, HELD], measured[1, i] + dt * out[i]
        there = measured[0, i] + dt * after
        held = work[i, WEIGHT] + table[i, STIFFNESS] * (table[i, POSTURE] - there)
        held -= table[i, DAMPING] * after + table[i, SLACK]
        given = torques[1, i] + torques[2, i] + torques[4, i] + table[i, REFLEX]
        out[i] = given + support * held
        out[i] -= (table[i, TISSUE] + torques[3, i] + dt * torques[5, i]) * after
    _settle(muscles, state, out)


@numba.njit(cache=True, error_model="numpy")
def _support(table, measured, work, i, dt):  # type: ignore[no-untyped-def]
    """Return whether furniture holds a limb now: 1.0 or 0.0."""
    if table[i, SUPPORT] != 0.0:
        return 1.0
    weight, gap = work[i, WEIGHT], table[i, POSTURE] - measured[0, i] - dt * measured[1, i]
    push = weight + table[i, STIFFNESS] * gap - table[i, DAMPING] * measured[1, i]
    push -= table[i, SLACK]
    extra = push + table[i, SLACK] - table[i, BORNE]  # beyond what it has borne from the start
    if abs(extra) < table[i, GRIP] and abs(gap) < GRIP_REACH:  # friction
        return 1.0
    # What lies behind bears whom it bore at the start, not who leans to the other side.
    is_carried = table[i, CARRIED] != 0.0 and weight * table[i, BORNE] > 0.0
    sags = is_carried and weight * gap >= -abs(weight) * CARRY_GAP
    return 1.0 if sags and push * weight > 0.0 else 0.0


@numba.njit(cache=True, error_model="numpy")
def _take_reflexes(muscles, state, involuntary) -> None:  # type: ignore[no-untyped-def]
    """Part the torque of reflexes from the active torque: what is left of that is willed."""
    starts, crossed, arms = muscles.starts, muscles.crossed, muscles.arms
    table, active = muscles.parts, muscles.torques[0]
    table[:, REFLEX] = 0.0
    for m in range(starts.shape[0] - 1):
        if involuntary[m] > 0.0:
            force = involuntary[m] * state[kernel.ACTIVE, m]
            for c in range(starts[m, 1], starts[m + 1, 1]):
                table[crossed[c], REFLEX] += arms[c] * force
                active[crossed[c]] -= arms[c] * force


@numba.njit(cache=True, error_model="numpy")
def _limit(table, torques) -> None:  # type: ignore[no-untyped-def]
    """Keep willed torque within what its motion can: a net torque, with what passive tissue gives."""
    for i in range(table.shape[0]):
        held = torques[1, i] + torques[4, i]
        most = max(table[i, MOST_ALONG] - table[i, OVER_ALONG] * held, 0.0)
        least = min(-table[i, MOST_AGAINST] - table[i, OVER_AGAINST] * held, 0.0)
        torques[0, i] = min(max(torques[0, i], least), most)


@numba.njit(cache=True, error_model="numpy")
def _fade(table, measured, torques) -> None:  # type: ignore[no-untyped-def]
    """Let active torque end at the active range, and damp the movement that it made."""
    for i in range(table.shape[0]):
        torque = torques[0, i]
        if torque > 0.0:
            left = (table[i, HIGHEST] - measured[0, i]) / ACTIVE_END
        else:
            left = (measured[0, i] - table[i, LOWEST]) / ACTIVE_END
        share = min(max(left, 0.0), 1.0)
        torques[2, i] = share * torque
        is_outward = measured[1, i] * torque > 0.0
        torques[3, i] = ACTIVE_END_DAMPING * (1.0 - share) * abs(torque) if is_outward else 0.0


@numba.njit(cache=True, error_model="numpy")
def _tighten(table, measured, torques) -> None:  # type: ignore[no-untyped-def]
    """Find what discs do everywhere, and ligaments near the ends of the passive range."""
    for i in range(table.shape[0]):
        zone, torques[4, i] = table[i, ZONE], -table[i, ELASTIC] * measured[0, i]
        torques[5, i] = table[i, ELASTIC]
        over = 1.0 - (table[i, MOST] - measured[0, i]) / zone
        under = 1.0 - (measured[0, i] - table[i, LEAST]) / zone
        depth = max(over, under)
        if depth <= 0.0:
            continue
        stiffness = 2.0 * table[i, LIGAMENT] * depth / zone
        torques[4, i] += table[i, LIGAMENT] * depth * depth * (-1.0 if over > under else 1.0)
        torques[5, i] += stiffness
        torques[3, i] += 2.0 * np.sqrt(stiffness * table[i, INERTIA])


@numba.njit(cache=True, error_model="numpy")
def _continue(muscles, state, out) -> None:  # type: ignore[no-untyped-def]
    """Add to the torques what tensions grow by at the present rates, and to the matrix the rest."""
    starts, crossed, arms = muscles.starts, muscles.crossed, muscles.arms
    depths, matrix = muscles.depths, muscles.matrix
    for m in range(starts.shape[0] - 1):
        growth, implicit = state[kernel.GROWTH, m], state[kernel.IMPLICIT, m]
        first, last = starts[m, 1], starts[m + 1, 1]
        reach = 0.0
        for c in range(first, last):
            i = crossed[c]
            out[i] += arms[c] * growth
            reach += abs(arms[c])
        for c in range(first, last):
            i, lever = crossed[c], arms[c] * implicit
            if muscles.is_branched[
                m
            ]:  # a bound, on the diagonal: the factorisation knows branches only
                matrix[i, depths[i]] += abs(lever) * reach
                continue
            for d in range(first, c + 1):
                matrix[i, depths[crossed[d]]] += lever * arms[d]


@numba.njit(cache=True, error_model="numpy")
def _settle(muscles, state, out) -> None:  # type: ignore[no-untyped-def]
    """Add to the torques what tensions change by over the step."""
    starts, crossed, arms = muscles.starts, muscles.crossed, muscles.arms
    acceleration = muscles.torques[0]
    for m in range(starts.shape[0] - 1):
        first, last = starts[m, 1], starts[m + 1, 1]
        growth, implicit = state[kernel.GROWTH, m], state[kernel.IMPLICIT, m]
        bend = reach = 0.0
        for c in range(first, last):
            bend += arms[c] * acceleration[crossed[c]]
            reach += abs(arms[c])
        for c in range(first, last):
            i = crossed[c]
            if muscles.is_branched[m]:
                out[i] += arms[c] * growth - abs(arms[c]) * reach * implicit * acceleration[i]
            else:
                out[i] += arms[c] * (growth - implicit * bend)
