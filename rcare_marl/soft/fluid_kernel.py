"""What moves a fluid's particles: density as a constraint, and viscosity.

M. Macklin and M. Müller, "Position Based Fluids" (SIGGRAPH 2013): each particle asks that the density at
its place is that of the fluid at rest. Vessels join in, see `vessel`.

The kernel of all sums is W = 15 / (pi h³) (1 - q)³ with q = distance / h < 1; its integral is one.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from ..pose import Array
from .cloth_contact import Impact, Pairs, touch_shapes
from .contact import Floats, Shapes, add, move_meetings, note
from .vessel import (
    DENSITY,
    FACTOR,
    GRADIENT,
    NOWHERE,
    SHIFT,
    SQUARES,
    WALL,
    contain,
    feel_walls,
    speed_at,
)

_LEAST = 1e-12


class Particles(NamedTuple):
    """The particles of a fluid.

    Attributes:
        x: Positions [m] and inverse mass [1/kg], shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        previous: Scratch: positions before a small step [m], shape [n, 3].
        active: The particles that there are, shape [a].
        near: Out: at which vessel each is, shape [n].
    """

    x: Array
    v: Array
    previous: Array
    active: npt.NDArray[np.int64]
    near: npt.NDArray[np.int64]


class Neighbours(NamedTuple):
    """Which particles can be neighbours, and what they feel of each other.

    Attributes:
        pairs: Shape [p, 2].
        size: How many of them count.
        met: Scratch: those that are neighbours, shape [p, 2].
        weights: Scratch, shape [p, 4].
        feel: Scratch, shape [n, FEELING].
    """

    pairs: npt.NDArray[np.uint32]
    size: int
    met: npt.NDArray[np.uint32]
    weights: Floats
    feel: Floats


class Grid(NamedTuple):
    """Scratch for `find_pairs`.

    Attributes:
        starts: Two more than a power of two, shape [b + 2].
        members: Shape [n].
        cells: Cell of each particle, and its place in the table, shape [n, 4].
    """

    starts: npt.NDArray[np.int64]
    members: npt.NDArray[np.int64]
    cells: npt.NDArray[np.int64]


class Vessels(NamedTuple):
    """What fluids lie in.

    Attributes:
        now: At the start of the step, shape [m, VESSEL]; at its end afterwards.
        former: Scratch, shape [m, VESSEL].
        outcome: Out, added to: what vessels got, shape [m, OUTCOME].
    """

    now: Array
    former: Array
    outcome: Array


class Step(NamedTuple):
    """The figures of a physics step.

    Attributes:
        substeps: How many small steps it has.
        iterations: How often each particle asks for its density in a small step.
        dt: Length of a small step [s].
        reach: h [m].
        target: One by the sum of the kernel at rest [m³].
        softness: Of the density constraint.
        cohesion: Share of the pull where the fluid is thin.
        viscosity: Share of a difference of velocity that neighbours lose in a small step.
        drag: The same for what slides along a wall.
        radius: Least distance of a particle from a wall [m].
        fastest: Of a particle [m/s].
        mass: Of a particle [kg].
        field: Gravity [m/s²], shape [3].
    """

    substeps: int
    iterations: int
    dt: float
    reach: float
    target: float
    softness: float
    cohesion: float
    viscosity: float
    drag: float
    radius: float
    fastest: float
    mass: float
    field: Array


@numba.njit(cache=True, error_model="numpy", inline="always")
def _bucket(a, b, c, mask):  # type: ignore[no-untyped-def]
    return ((a * 73856093) ^ (b * 19349663) ^ (c * 83492791)) & mask


@numba.njit(cache=True, error_model="numpy", inline="always")
def _same(cells, i, j):  # type: ignore[no-untyped-def]
    return cells[i, 0] == cells[j, 0] and cells[i, 1] == cells[j, 1] and cells[i, 2] == cells[j, 2]


@numba.njit(cache=True, error_model="numpy")
def _pair_cell(x, grid, start, end, square, runs, pairs, found) -> int:  # type: ignore[no-untyped-def]
    """Pair the particles of one cell, from its first at `start`, with each other and those around.

    All pairs with the same first particle come one after the other: what it gets is then summed up in
    registers.
    """
    starts, members, cells = grid
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
def find_pairs(x, active, reach, grid, pairs) -> int:  # type: ignore[no-untyped-def]
    """Write pairs of particles that are nearer than `reach` [m].

    Args:
        x: Positions, shape [n, 4].
        active: The particles that there are, shape [a].
        reach: How near a pair counts [m].
        grid: Scratch, `Grid`.
        pairs: Out, shape [p, 2].

    Returns:
        How many there are.
    """
    starts, members, cells = grid
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
                found = _pair_cell(x, grid, s, last, square, runs, pairs, found)
    return found


@numba.njit(cache=True, error_model="numpy")
def _fall(particles, step) -> None:  # type: ignore[no-untyped-def]
    (x, v, previous, active, _), dt, fastest = particles, step.dt, step.fastest
    for i in active:
        square = _LEAST
        for k in range(3):
            v[i, k] += dt * step.field[k]
            square += v[i, k] * v[i, k]
        share = min(1.0, fastest / np.sqrt(square))
        for k in range(3):
            v[i, k] *= share
            previous[i, k] = x[i, k]
            x[i, k] += dt * v[i, k]


@numba.njit(cache=True, error_model="numpy", inline="always")
def _gather(feel, i, x, y, z, squares, density) -> None:  # type: ignore[no-untyped-def]
    add(feel, i, GRADIENT, x, y, z)
    feel[i, SQUARES] += squares
    feel[i, DENSITY] += density


@numba.njit(cache=True, error_model="numpy")
def _feel_others(x, pairs, count, step, neighbours) -> int:  # type: ignore[no-untyped-def]
    """Add up density and gradients over neighbours; note the pairs that are near and their weights."""
    met, weights, feel = neighbours.met, neighbours.weights, neighbours.feel
    h, found = np.float32(step.reach), 0
    square, least, one, zero = h * h, np.float32(_LEAST), np.float32(1), np.float32(0)
    size = np.float32(15.0 / (np.pi * step.reach**3) * step.target)
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
def _press(particles, neighbours, count, step, outcome) -> None:  # type: ignore[no-untyped-def]
    """Move particles until their density is that at rest; what is too thin is pulled together a little."""
    x, _, _, active, near = particles
    met, weights, feel = neighbours.met, neighbours.weights, neighbours.feel
    softness = step.softness / step.reach**2
    pull, zero = step.mass / step.dt, np.float32(0)
    for i in active:
        excess = feel[i, DENSITY] - 1.0
        if excess < 0.0:
            excess *= step.cohesion
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
def _finish(particles, vessels, feel, step) -> None:  # type: ignore[no-untyped-def]
    """Read velocities off the positions; walls hold back what slides along them."""
    x, v, previous, active, near = particles
    dt, h, mass = step.dt, step.reach, step.mass
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
        ux, uy, uz = speed_at(vessels.now, c, x[i, 0], x[i, 1], x[i, 2])
        ux, uy, uz = ux - v[i, 0], uy - v[i, 1], uz - v[i, 2]
        along = ux * gx + uy * gy + uz * gz
        share = min(step.drag * size * h, 1.0)
        ux, uy, uz = share * (ux - along * gx), share * (uy - along * gy), share * (uz - along * gz)
        add(v, i, 0, ux, uy, uz)
        note(vessels.outcome, c, x[i, 0], x[i, 1], x[i, 2], -mass * ux, -mass * uy, -mass * uz)


@numba.njit(cache=True, error_model="numpy")
def _smooth(v, share, met, weights, count) -> None:  # type: ignore[no-untyped-def]
    """Let neighbours move alike (XSPH); their momentum stays the same."""
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
def simulate(particles, neighbours, vessels, touching, impact, step) -> None:  # type: ignore[no-untyped-def]
    """Simulate one physics step.

    Args:
        particles: `Particles`.
        neighbours: `Neighbours`.
        vessels: `Vessels`.
        touching: `Pairs` of particle and rigid shape that can touch.
        impact: `Impact` of those shapes.
        step: `Step`.
    """
    particles, neighbours = Particles(*particles), Neighbours(*neighbours)
    vessels, touching, step = Vessels(*vessels), Pairs(*touching), Step(*step)
    impact = Impact(Shapes(*impact[0]), impact[1], impact[2], impact[3], impact[4])
    x, v, previous, active, near = particles
    met, weights, feel = neighbours.met, neighbours.weights, neighbours.feel
    for _ in range(step.substeps):
        np.multiply(vessels.now, 1.0, vessels.former)
        move_meetings(vessels.now, step.dt)
        if touching.size:
            move_meetings(impact.shapes.meetings, step.dt)
        _fall(particles, step)
        feel_walls(x, active, near, vessels.now, step.reach, feel)
        found = _feel_others(x, neighbours.pairs, neighbours.size, step, neighbours)
        _press(particles, neighbours, found, step, vessels.outcome)
        for _ in range(step.iterations - 1):
            feel_walls(x, active, near, vessels.now, step.reach, feel)
            found = _feel_others(x, met, found, step, neighbours)
            _press(particles, neighbours, found, step, vessels.outcome)
        contain(x, previous, active, vessels, step)
        if touching.size:
            touch_shapes(x, previous, touching, impact)
        _finish(particles, vessels, feel, step)
        _smooth(v, step.viscosity, met, weights, found)
