"""What moves a fluid's particles: density as a constraint, and viscosity.

M. Macklin and M. Müller, "Position Based Fluids" (SIGGRAPH 2013): each particle asks that the density at
its place is that of the fluid at rest. Vessels join in, see `vessel_kernel`.

The kernel of all sums is W = 15 / (pi h³) (1 - q)³ with q = distance / h < 1; its integral is one.
"""

from __future__ import annotations

import numba
import numpy as np

from .cloth_contact import touch_shapes
from .contact import move_meetings
from .vessel_kernel import (
    DENSITY,
    FACTOR,
    GRADIENT,
    NOWHERE,
    SHIFT,
    SQUARES,
    WALL,
    carry_vessels,
    contain,
    feel_walls,
    note,
    speed_at,
)

# Columns of the constants: step [s], h [m], density at rest, softness, cohesion, shares of velocity that
# viscosity and walls take in a step, radius for contact [m], fastest [m/s], mass of a particle [kg],
# gravity [m/s²].
DT, REACH, TARGET, SOFTNESS, COHESION, VISCOSITY, DRAG, RADIUS, FASTEST, MASS, FIELD = range(11)
CONSTANTS = FIELD + 3

_LEAST = 1e-12


@numba.njit(cache=True, error_model="numpy", inline="always")
def _bucket(a, b, c, mask):  # type: ignore[no-untyped-def]
    return ((a * 73856093) ^ (b * 19349663) ^ (c * 83492791)) & mask


@numba.njit(cache=True, error_model="numpy", inline="always")
def _same(cells, i, j):  # type: ignore[no-untyped-def]
    return cells[i, 0] == cells[j, 0] and cells[i, 1] == cells[j, 1] and cells[i, 2] == cells[j, 2]


@numba.njit(cache=True, error_model="numpy")
def _pair_cell(x, cells, members, starts, start, end, square, runs, pairs, found) -> int:  # type: ignore[no-untyped-def]
    """Pair the particles of one cell, from its first at `start`, with each other and those around.

    All pairs with the same first particle come one after the other: what it gets is then summed up in
    registers.
    """
    mask, own = starts.shape[0] - 3, members[start]
    for n in range(13, 27):  # the own cell, and 13 that stand for 26
        a, b, c = (
            cells[own, 0] + n // 9 - 1,
            cells[own, 1] + n // 3 % 3 - 1,
            cells[own, 2] + n % 3 - 1,
        )
        bucket = _bucket(a, b, c, mask)
        runs[n - 13, 0], runs[n - 13, 1] = starts[bucket], starts[bucket + 1]
        runs[n - 13, 2], runs[n - 13, 3], runs[n - 13, 4] = a, b, c
    for s in range(start, end):
        i = members[s]
        if not _same(cells, i, own):
            continue
        px, py, pz = x[i, 0], x[i, 1], x[i, 2]
        for n in range(14):
            for t in range(s + 1 if n == 0 else runs[n, 0], runs[n, 1]):
                j = members[t]
                dx, dy, dz = x[j, 0] - px, x[j, 1] - py, x[j, 2] - pz
                if dx * dx + dy * dy + dz * dz >= square or found >= pairs.shape[0]:
                    continue
                if (
                    cells[j, 0] == runs[n, 2]
                    and cells[j, 1] == runs[n, 3]
                    and cells[j, 2] == runs[n, 4]
                ):
                    pairs[found, 0], pairs[found, 1] = i, j
                    found += 1
    return found


@numba.njit(cache=True, error_model="numpy")
def find_pairs(x, active, reach, starts, members, cells, pairs) -> int:  # type: ignore[no-untyped-def]
    """Write pairs of particles that are nearer than `reach` [m].

    Args:
        x: Positions, shape [n, 4].
        active: The particles that there are, shape [a].
        reach: How near a pair counts [m].
        starts: Scratch, two more than a power of two, shape [b + 2].
        members: Scratch, shape [n].
        cells: Scratch: cell of each particle, and its place in the table, shape [n, 4].
        pairs: Out, shape [p, 2].

    Returns:
        How many there are.
    """
    mask, found, square = starts.shape[0] - 3, 0, reach * reach
    starts[:], runs = 0, np.empty((14, 5), np.int64)
    for i in active:
        for k in range(3):
            cells[i, k] = int(np.floor(x[i, k] / reach))
        cells[i, 3] = _bucket(cells[i, 0], cells[i, 1], cells[i, 2], mask)
        starts[cells[i, 3] + 2] += 1
    for b in range(mask + 1):
        starts[b + 2] += starts[b + 1]
    for i in active:
        members[starts[cells[i, 3] + 1]] = i
        starts[cells[i, 3] + 1] += 1
    for b in range(mask + 1):
        first, last = starts[b], starts[b + 1]
        for s in range(first, last):  # cells that share a bucket: from the first member of each
            i = members[s]
            is_first = True
            for t in range(first, s):
                is_first = is_first and not _same(cells, i, members[t])
            if is_first:
                found = _pair_cell(x, cells, members, starts, s, last, square, runs, pairs, found)
    return found


@numba.njit(cache=True, error_model="numpy")
def _fall(x, v, previous, active, constants) -> None:  # type: ignore[no-untyped-def]
    dt, fastest = constants[DT], constants[FASTEST]
    for i in active:
        square = _LEAST
        for k in range(3):
            v[i, k] += dt * constants[FIELD + k]
            square += v[i, k] * v[i, k]
        share = min(1.0, fastest / np.sqrt(square))
        for k in range(3):
            v[i, k] *= share
            previous[i, k] = x[i, k]
            x[i, k] += dt * v[i, k]


@numba.njit(cache=True, error_model="numpy", inline="always")
def _gather(feel, i, x, y, z, squares, density) -> None:  # type: ignore[no-untyped-def]
    feel[i, GRADIENT] += x
    feel[i, GRADIENT + 1] += y
    feel[i, GRADIENT + 2] += z
    feel[i, SQUARES] += squares
    feel[i, DENSITY] += density


@numba.njit(cache=True, error_model="numpy")
def _feel_others(x, pairs, count, constants, feel, met, weights) -> int:  # type: ignore[no-untyped-def]
    """Add up density and gradients over neighbours; note the pairs that are near and their weights."""
    h, found = np.float32(constants[REACH]), 0
    square, least, one, zero = h * h, np.float32(_LEAST), np.float32(1), np.float32(0)
    size = np.float32(15.0 / (np.pi * constants[REACH] ** 3) * constants[TARGET])
    steep, inverse = np.float32(-3) * size / h, one / h
    last, sx, sy, sz, ss, sd = pairs[0, 0], zero, zero, zero, zero, zero
    for p in range(count):
        i, j = pairs[p, 0], pairs[p, 1]
        if i != last:
            _gather(feel, last, sx, sy, sz, ss, sd)
            last, sx, sy, sz, ss, sd = i, zero, zero, zero, zero, zero
        dx = np.float32(x[i, 0] - x[j, 0])
        dy = np.float32(x[i, 1] - x[j, 1])
        dz = np.float32(x[i, 2] - x[j, 2])
        apart = dx * dx + dy * dy + dz * dz
        if apart >= square:
            continue
        r = np.sqrt(apart + least)
        w = one - r * inverse
        density = size * w * w * w
        slope = steep * w * w / r
        squares = slope * slope * apart
        dx, dy, dz = slope * dx, slope * dy, slope * dz
        met[found, 0], met[found, 1] = i, j
        weights[found, 0], weights[found, 1], weights[found, 2] = dx, dy, dz
        weights[found, 3] = density
        found += 1
        sx, sy, sz, ss, sd = sx + dx, sy + dy, sz + dz, ss + squares, sd + density
        _gather(feel, j, -dx, -dy, -dz, squares, density)
    if count:
        _gather(feel, last, sx, sy, sz, ss, sd)
    return found


@numba.njit(cache=True, error_model="numpy")
def _press(x, active, near, constants, feel, met, weights, count, outcome) -> None:  # type: ignore[no-untyped-def]
    """Move particles until their density is that at rest; what is too thin is pulled together a little."""
    softness = constants[SOFTNESS] / constants[REACH] ** 2
    pull, zero = constants[MASS] / constants[DT], np.float32(0)
    for i in active:
        excess = feel[i, DENSITY] - 1.0
        if excess < 0.0:
            excess *= constants[COHESION]
        below = feel[i, SQUARES] + softness
        for k in range(3):
            below += feel[i, GRADIENT + k] ** 2
        feel[i, FACTOR] = -excess / below
    for p in range(count):
        i, j = met[p, 0], met[p, 1]
        both = feel[i, FACTOR] + feel[j, FACTOR]
        if both == zero:
            continue
        for k in range(3):
            shift = both * weights[p, k]
            feel[i, SHIFT + k] += shift
            feel[j, SHIFT + k] -= shift
    for i in active:
        c, factor = near[i], min(feel[i, FACTOR], 0.0)
        for k in range(3):
            x[i, k] += feel[i, SHIFT + k]
        if c != NOWHERE and factor != 0.0:
            jx, jy, jz = (
                -pull * factor * feel[i, WALL],
                -pull * factor * feel[i, WALL + 1],
                -pull * factor * feel[i, WALL + 2],
            )
            note(outcome, c, x[i, 0], x[i, 1], x[i, 2], jx, jy, jz)
            for k in range(3):
                x[i, k] += factor * feel[i, WALL + k]


@numba.njit(cache=True, error_model="numpy")
def _finish(x, v, previous, active, near, vessels, constants, feel, outcome) -> None:  # type: ignore[no-untyped-def]
    """Read velocities off the positions; walls hold back what slides along them."""
    dt, h, mass = constants[DT], constants[REACH], constants[MASS]
    for i in active:
        for k in range(3):
            v[i, k] = (x[i, k] - previous[i, k]) / dt
        c = near[i]
        if c == NOWHERE:
            continue
        gx, gy, gz = feel[i, WALL], feel[i, WALL + 1], feel[i, WALL + 2]
        size = np.sqrt(gx * gx + gy * gy + gz * gz)
        if size * h < _LEAST:
            continue
        gx, gy, gz = gx / size, gy / size, gz / size
        ux, uy, uz = speed_at(vessels, c, x[i, 0], x[i, 1], x[i, 2])
        ux, uy, uz = ux - v[i, 0], uy - v[i, 1], uz - v[i, 2]
        along = ux * gx + uy * gy + uz * gz
        share = min(constants[DRAG] * size * h, 1.0)
        ux, uy, uz = share * (ux - along * gx), share * (uy - along * gy), share * (uz - along * gz)
        v[i, 0] += ux
        v[i, 1] += uy
        v[i, 2] += uz
        note(outcome, c, x[i, 0], x[i, 1], x[i, 2], -mass * ux, -mass * uy, -mass * uz)


@numba.njit(cache=True, error_model="numpy")
def _smooth(v, constants, met, weights, count) -> None:  # type: ignore[no-untyped-def]
    """Let neighbours move alike (XSPH); their momentum stays the same."""
    share = constants[VISCOSITY]
    for p in range(count):
        i, j = met[p, 0], met[p, 1]
        both = share * weights[p, 3]
        for k in range(3):
            change = both * (v[j, k] - v[i, k])
            v[i, k] += change
            v[j, k] -= change


@numba.njit(cache=True, error_model="numpy")
def drift(x, v, built, active, period):  # type: ignore[no-untyped-def]
    """Return how far any particle will be at most from its place among the others when paired [m].

    Args:
        x: Positions [m], shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        built: Positions when the pairs were found [m], shape [n, 3].
        active: The particles that there are, shape [a].
        period: How far to look ahead [s].
    """
    mx, my, mz, most = 0.0, 0.0, 0.0, 0.0
    for i in active:
        mx += x[i, 0] + period * v[i, 0] - built[i, 0]
        my += x[i, 1] + period * v[i, 1] - built[i, 1]
        mz += x[i, 2] + period * v[i, 2] - built[i, 2]
    share = 1.0 / max(active.shape[0], 1)
    mx, my, mz = share * mx, share * my, share * mz
    for i in active:
        dx = x[i, 0] + period * v[i, 0] - built[i, 0] - mx
        dy = x[i, 1] + period * v[i, 1] - built[i, 1] - my
        dz = x[i, 2] + period * v[i, 2] - built[i, 2] - mz
        most = max(most, dx * dx + dy * dy + dz * dz)
    return np.sqrt(most)


@numba.njit(cache=True, error_model="numpy")
def simulate(  # type: ignore[no-untyped-def]
    x, v, previous, active, near, pairs, count, met, weights, feel, constants, substeps, iterations,
    vessels, former, outcome, touching, touches, meetings, kinds, planes, runs, met_by_shapes,
) -> None:  # fmt: skip
    """Simulate one physics step.

    Args:
        x: Positions [m] and inverse mass [1/kg], shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        previous: Scratch, shape [n, 3].
        active: The particles that there are, shape [a].
        near: Out: at which vessel each is, shape [n].
        pairs: Pairs of particles that can be neighbours, shape [p, 2].
        count: How many there are.
        met: Scratch, shape [p, 2].
        weights: Scratch, shape [p, 4].
        feel: Scratch, shape [n, FEELING].
        constants: Shape [CONSTANTS].
        substeps: Small steps in the step.
        iterations: How often each asks for its density in a small step.
        vessels: Vessels at the start of the step, shape [m, VESSEL]; at its end afterwards.
        former: Scratch, shape [m, VESSEL].
        outcome: Out, added to: what vessels got, shape [m, OUTCOME].
        touching: Pairs of particle and rigid shape that can touch, shape [q, 2].
        touches: How many there are.
        meetings: Rigid shapes in the world with their velocities, as in `contact`.
        kinds: Their kinds.
        planes: Planes of all hulls.
        runs: Runs of the planes of each.
        met_by_shapes: Out, added to: what shapes got, as in `cloth_contact`.
    """
    dt = constants[DT]
    for _ in range(substeps):
        former[:] = vessels
        carry_vessels(vessels, dt)
        if touches:
            move_meetings(meetings, dt)
        _fall(x, v, previous, active, constants)
        feel_walls(x, active, near, vessels, constants[REACH], feel)
        found = _feel_others(x, pairs, count, constants, feel, met, weights)
        _press(x, active, near, constants, feel, met, weights, found, outcome)
        for _ in range(iterations - 1):
            feel_walls(x, active, near, vessels, constants[REACH], feel)
            found = _feel_others(x, met, found, constants, feel, met, weights)
            _press(x, active, near, constants, feel, met, weights, found, outcome)
        contain(
            x, previous, active, vessels, former, constants[RADIUS], dt, constants[MASS], outcome
        )
        if touches:
            touch_shapes(
                x, previous, touching, touches, meetings, kinds, planes, runs, dt,
                constants[RADIUS], 1.0, met_by_shapes,
            )  # fmt: skip
        _finish(x, v, previous, active, near, vessels, constants, feel, outcome)
        _smooth(v, constants, met, weights, found)


__all__ = ["CONSTANTS", "DENSITY", "FIELD", "drift", "find_pairs", "simulate"]
