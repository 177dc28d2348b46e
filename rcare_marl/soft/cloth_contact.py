"""Contact of many particles, of cloth or fluid, with rigid shapes, and what the shapes get of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from ..pose import Array
from .collider import Colliders, NearShapes
from .contact import (
    GRIP,
    LEAST_DOUBLE,
    PLACE,
    SLIDE,
    SPIN,
    Numbers,
    Rows,
    Shapes,
    add,
    distance_in,
    note,
)
from .kernel import line_point

# Columns of what a shape got from a cloth in a step: impulse [N·s], moment of impulse about the world's
# origin [N·m·s], then sums over touches: point times size of the normal impulse [m·N·s], count, and that
# size [N·s].
MOMENT, MIDDLE, COUNT, LOAD = 3, 6, 9, 10
OUTCOME = 11
# Distance from what was touched, from where a point is none [m]: forces all round that cancel leave a
# couple, which no line can give.
FAR = 0.5


class Pairs(NamedTuple):
    """Pairs of particle, or thread, and shape.

    Attributes:
        rows: Number of particle and of shape, shape [p, 2].
        size: How many of the rows count.
    """

    rows: npt.NDArray[np.uint32]
    size: int


class Impact(NamedTuple):
    """How shapes and particles meet in a step.

    Attributes:
        shapes: Shapes in the world with their velocities.
        dt: Length of a small step [s].
        thickness: Least distance of a particle from a shape [m].
        furthest: How far what is inside a shape comes out in a small step [m].
        outcome: Out, added to: what each shape got, shape [m, OUTCOME].
    """

    shapes: Shapes
    dt: float
    thickness: float
    furthest: float
    outcome: npt.NDArray[np.float64]


class Drift(NamedTuple):
    """How near and for how long particles are looked at.

    Attributes:
        reach: How near counts for what does not move [m].
        least: Speed that a particle may soon have in any case [m/s].
        period: How long [s].
    """

    reach: float
    least: float
    period: float


@numba.njit(cache=True, error_model="numpy")
def _answer(  # type: ignore[no-untyped-def]
    meetings, c, kind, planes, runs, point, before, mass, dt, thickness, furthest, outcome
):
    """Return how a point moves out of a shape, and by how much of it without speed, twice x, y, z [m].

    Coulomb's law as positions, as in `contact.solve_contacts`. A change of position is a change of
    velocity by itself over dt, so impulses are exact. What was inside before comes out without speed.
    """
    x, y, z = point
    d, nx, ny, nz = distance_in(meetings, c, kind, planes, runs, x, y, z, LEAST_DOUBLE)
    d -= thickness
    if d >= 0.0:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    rx, ry, rz = x - meetings[c, PLACE], y - meetings[c, PLACE + 1], z - meetings[c, PLACE + 2]
    wx, wy, wz = meetings[c, SPIN], meetings[c, SPIN + 1], meetings[c, SPIN + 2]
    sx = x - before[0] - dt * (meetings[c, SLIDE] + wy * rz - wz * ry)
    sy = y - before[1] - dt * (meetings[c, SLIDE + 1] + wz * rx - wx * rz)
    sz = z - before[2] - dt * (meetings[c, SLIDE + 2] + wx * ry - wy * rx)
    along = sx * nx + sy * ny + sz * nz
    # Of the way out, `along` below zero is the approach of this step: that much is an impulse. The rest,
    # and what there is of a way out already, is no speed afterwards.
    push = min(-d, max(-along, 0.0))
    rest = min(-d - push, furthest)
    sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
    slip = np.sqrt(sx * sx + sy * sy + sz * sz) + LEAST_DOUBLE
    held = min(1.0, (push + rest) * meetings[c, GRIP] / slip)
    out, quiet = push + rest, rest + max(along, 0.0)
    mx, my, mz = out * nx - held * sx, out * ny - held * sy, out * nz - held * sz
    x, y, z = x + mx, y + my, z + mz
    held *= push / (out + LEAST_DOUBLE)
    fx, fy, fz = push * nx - held * sx, push * ny - held * sy, push * nz - held * sz
    load = push * mass / dt
    jx, jy, jz = -fx * mass / dt, -fy * mass / dt, -fz * mass / dt
    note(outcome, c, x, y, z, jx, jy, jz)
    add(outcome, c, MIDDLE, load * x, load * y, load * z)
    outcome[c, COUNT] += 1.0
    outcome[c, LOAD] += load
    return True, mx, my, mz, quiet * nx, quiet * ny, quiet * nz


@numba.njit(cache=True, error_model="numpy", inline="always")
def _meet(impact, c, point, before, mass):  # type: ignore[no-untyped-def]
    s = impact.shapes
    return _answer(
        s.meetings,
        c,
        s.kinds[c],
        s.planes,
        s.runs,
        point,
        before,
        mass,
        impact.dt,
        impact.thickness,
        impact.furthest,
        impact.outcome,
    )


@numba.njit(cache=True, error_model="numpy")
def touch_shapes(x, previous, pairs, impact) -> None:  # type: ignore[no-untyped-def]
    """Push particles out of the shapes, hold them back by friction, and note what shapes get."""
    for p in range(pairs.size):
        i, c = pairs.rows[p, 0], pairs.rows[p, 1]
        point = (x[i, 0], x[i, 1], x[i, 2])
        before = (previous[i, 0], previous[i, 1], previous[i, 2])
        is_hit, dx, dy, dz, ox, oy, oz = _meet(impact, c, point, before, 1.0 / x[i, 3])
        if is_hit:
            add(x, i, 0, dx, dy, dz)
            add(previous, i, 0, ox, oy, oz)


@numba.njit(cache=True, error_model="numpy", inline="always")
def _middle(x, i, j):  # type: ignore[no-untyped-def]
    return 0.5 * (x[i, 0] + x[j, 0]), 0.5 * (x[i, 1] + x[j, 1]), 0.5 * (x[i, 2] + x[j, 2])


@numba.njit(cache=True, error_model="numpy")
def touch_sharp(x, previous, threads, pairs, impact) -> None:  # type: ignore[no-untyped-def]
    """Do the same with the middles of threads, whose two ends move together.

    A heel or a finger is not much wider than the mesh: without this its corner comes through.
    """
    for p in range(pairs.size):
        t, c = pairs.rows[p, 0], pairs.rows[p, 1]
        i, j = threads[t, 0], threads[t, 1]
        point, before = _middle(x, i, j), _middle(previous, i, j)
        mass = 1.0 / x[i, 3] + 1.0 / x[j, 3]
        is_hit, dx, dy, dz, ox, oy, oz = _meet(impact, c, point, before, mass)
        if is_hit:
            for k in (i, j):
                add(x, k, 0, dx, dy, dz)
                add(previous, k, 0, ox, oy, oz)


@numba.njit(cache=True, error_model="numpy")
def find_middles(x, v, threads, middles, speeds) -> None:  # type: ignore[no-untyped-def]
    """Write the middles of threads [m], shape [t, 3], and their velocities [m/s], shape [t, 3]."""
    for t in range(threads.shape[0]):
        i, j = threads[t, 0], threads[t, 1]
        for a in range(3):
            middles[t, a] = 0.5 * (x[i, a] + x[j, a])
            speeds[t, a] = 0.5 * (v[i, a] + v[j, a])


@numba.njit(cache=True, error_model="numpy")
def find_near(x, v, low, high, shapes, drift, pairs) -> int:  # type: ignore[no-untyped-def]
    """Write (particle, shape) for each particle that may come to a shape.

    Args:
        x: Positions, shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        low: Lower corner of a box around all particles [m], shape [3].
        high: Its upper corner.
        shapes: Shapes in the world.
        drift: How near and for how long, `Drift`.
        pairs: Out, shape [p, 2].

    Returns:
        How many there are.
    """
    shapes, drift = Shapes(*shapes), Drift(*drift)
    count, ways = 0, np.empty(v.shape[0])
    most, meetings, radii = 0.0, shapes.meetings, shapes.radii
    kinds, planes, runs = shapes.kinds, shapes.planes, shapes.runs
    for i in range(v.shape[0]):
        speed = np.sqrt(v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1] + v[i, 2] * v[i, 2])
        ways[i] = drift.reach + drift.period * max(speed, drift.least)
        most = max(most, ways[i])
    for c in range(meetings.shape[0]):
        px, py, pz = meetings[c, PLACE], meetings[c, PLACE + 1], meetings[c, PLACE + 2]
        dx = px - min(max(px, low[0]), high[0])
        dy = py - min(max(py, low[1]), high[1])
        dz = pz - min(max(pz, low[2]), high[2])
        if dx * dx + dy * dy + dz * dz > (radii[c] + most) ** 2:
            continue
        for i in range(v.shape[0]):
            near = ways[i]
            dx, dy, dz = x[i, 0] - px, x[i, 1] - py, x[i, 2] - pz
            if dx * dx + dy * dy + dz * dz > (radii[c] + near) ** 2 or count >= pairs.shape[0]:
                continue
            d, _, _, _ = distance_in(
                meetings, c, kinds[c], planes, runs, x[i, 0], x[i, 1], x[i, 2], LEAST_DOUBLE
            )
            if d < near:
                pairs[count, 0], pairs[count, 1] = i, c
                count += 1
    return count


@numba.njit(cache=True)
def find_threads(near, sharp, threads_at, stamps, pairs) -> int:  # type: ignore[no-untyped-def]
    """Write (thread, shape) for each thread of a particle that is near a sharp shape.

    Args:
        near: Pairs of particle and shape, sorted by shape.
        sharp: Whether each shape is sharp, shape [m].
        threads_at: Threads of all particles one after the other, shape [2 t], and the first of each
            particle, shape [n + 1].
        stamps: Scratch, shape [t].
        pairs: Out, shape [p, 2].

    Returns:
        How many there are.
    """
    found, near, (around, starts) = 0, Pairs(*near), threads_at
    stamps[:] = -1
    for p in range(near.size):
        i, c = near.rows[p, 0], near.rows[p, 1]
        if not sharp[c]:
            continue
        for s in range(starts[i], starts[i + np.uint32(1)]):
            t = around[s]
            if stamps[t] != c and found < pairs.shape[0]:
                stamps[t] = c
                pairs[found, 0], pairs[found, 1] = t, c
                found += 1
    return found


@numba.njit(cache=True, error_model="numpy")
def narrow(x, v, near, shapes, drift, pairs) -> int:  # type: ignore[no-untyped-def]
    """Write those of the pairs found by `find_near` that may touch in the coming step.

    Args:
        x: Positions, shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        near: The pairs.
        shapes: Shapes in the world with their velocities.
        drift: How near counts as touching, and how long the step is.
        pairs: Out, shape [p, 2].

    Returns:
        How many there are.
    """
    shapes, drift, near = Shapes(*shapes), Drift(*drift), Pairs(*near)
    meetings, radii, reach, period = shapes.meetings, shapes.radii, drift.reach, drift.period
    kinds, planes, runs = shapes.kinds, shapes.planes, shapes.runs
    count, ways = 0, np.empty(meetings.shape[0])
    for c in range(meetings.shape[0]):
        speed, spin = 0.0, 0.0
        for a in range(3):
            speed += meetings[c, SLIDE + a] ** 2
            spin += meetings[c, SPIN + a] ** 2
        ways[c] = reach + period * (np.sqrt(speed) + np.sqrt(spin) * min(radii[c], 2.0))
    for p in range(near.size):
        i, c = near.rows[p, 0], near.rows[p, 1]
        way = ways[c] + period * np.sqrt(v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1] + v[i, 2] * v[i, 2])
        d, _, _, _ = distance_in(
            meetings, c, kinds[c], planes, runs, x[i, 0], x[i, 1], x[i, 2], LEAST_DOUBLE
        )
        if d < way:
            pairs[count, 0], pairs[count, 1] = i, c
            count += 1
    return count


@numba.njit(cache=True, error_model="numpy")
def _sum_by_link(outcome, owners, period, sums) -> None:  # type: ignore[no-untyped-def]
    """Add up what the shapes of each link got, as force [N] and a point of its line of action [m].

    Args:
        outcome: What each shape got, shape [m, OUTCOME].
        owners: Place of the link of each shape, shape [m].
        period: Length of the physics step [s].
        sums: Out: force, point, load [N], shape [l, 7]; a load of zero where nothing was touched.
    """
    total, middle, point = np.zeros((sums.shape[0], OUTCOME)), np.empty(3), np.empty(3)
    for c in range(outcome.shape[0]):
        if outcome[c, COUNT] > 0:
            for a in range(OUTCOME):
                total[owners[c], a] += outcome[c, a]
    sums[:] = 0.0
    for k in range(sums.shape[0]):
        load = total[k, LOAD]
        if load <= 0:
            continue
        for a in range(3):
            middle[a] = total[k, MIDDLE + a] / load
        line_point(total[k, :3], total[k, MOMENT : MOMENT + 3], middle, point)
        apart = 0.0
        for a in range(3):
            apart += (point[a] - middle[a]) ** 2
        for a in range(3):
            sums[k, a] = total[k, a] / period
            sums[k, 3 + a] = middle[a] if apart > FAR * FAR else point[a]
        sums[k, 6] = load / period


def find_pairs(
    x: Array, v: Array, colliders: Colliders, rows: Rows, drift: Drift, pairs: Numbers
) -> tuple[int, npt.NDArray[np.bool_]]:
    """Write (particle, shape) for each particle that may come to a shape, numbered among those met.

    Args:
        x: Positions, shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        colliders: The rigid shapes.
        rows: Those whose poses are fresh, shape [r].
        drift: How near and for how long.
        pairs: Out, shape [p, 2].

    Returns:
        How many there are, and which of `rows` are met, shape [r].
    """
    low, high = x[:, :3].min(axis=0), x[:, :3].max(axis=0)
    shapes = tuple(NearShapes(colliders, rows).in_world())
    count = find_near(x, v, low, high, shapes, tuple(drift), pairs)
    met = np.zeros(len(rows), np.bool_)
    met[pairs[:count, 1]] = True
    pairs[:count, 1] = (np.cumsum(met) - 1)[pairs[:count, 1]]
    return count, met


def forces_on(near: NearShapes, outcome: Array, period: float) -> Iterator[tuple[int, Array]]:
    """Yield the row of each link that was touched in a step, and force [N], point [m] and load [N] on it.

    Args:
        near: The shapes.
        outcome: What each of them got, shape [m, OUTCOME].
        period: Length of the physics step [s].
    """
    links, owners = near.by_link
    sums = np.empty((len(links), 7))
    _sum_by_link(outcome, owners, period, sums)
    for row, got in zip(links, sums, strict=True):
        if got[6] > 0:
            yield row, got
