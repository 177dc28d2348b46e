"""The loops over the particles of a cloth.

Small steps with one iteration each: M. Macklin, K. Storey, M. Lu, P. Terdiman, N. Chentanez, S. Jeschke
and M. Müller, "Small Steps in Physics Simulation" (SCA 2019). One iteration leaves a thread softer than it
is: of two particles that it joins, each was or will be moved by others in the same small step, by as much as
the tension does in it. On average that adds (w_i + w_j) dt² / 2 to the compliance, w being inverse masses;
this is taken off again, so that a strip stretches as its figures say. A thread can be no stiffer than half
the mass of its ends over dt²: 390 N/m for jersey with particles every 2 cm, in ten small steps.

Numba's cache knows the file of a function alone: whoever changes `contact` or `cloth_contact` must remove the
cached `simulate`.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from ..pose import Array
from .cloth_contact import Impact, Pairs, touch_shapes, touch_sharp
from .contact import Shapes, add, move_meetings

# Columns of a pin: where it is [m], its way in a small step [m], compliance [m/N], greatest force [N], and
# the impulse on the particle in this step [N·s].
ANCHOR, WAY, PIN_SOFTNESS, PIN_LIMIT, PULL = 0, 3, 6, 7, 8
PIN = 11
BEND_EVERY, ROOT_EVERY = 5, 5.0**0.5  # an impulse of so many small steps at once
_LEAST = 1e-12


class Particles(NamedTuple):
    """The particles of a cloth.

    Attributes:
        x: Positions [m] and inverse masses [1/kg], shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        previous: Scratch: positions before a small step [m], shape [n, 3].
        air: Unit normal and drag per mass and speed squared [1/m], shape [n, 4].
    """

    x: Array
    v: Array
    previous: Array
    air: Array


class Pins(NamedTuple):
    """What links hold: particles, shape [p], and a table of them, shape [p, PIN]."""

    particles: npt.NDArray[np.int32]
    table: Array


class ClosePairs(NamedTuple):
    """Particles of a cloth that are close to each other.

    Attributes:
        rows: The pairs, shape [p, 2].
        gaps: Least distance of each [m], shape [p].
        size: How many of them count.
    """

    rows: npt.NDArray[np.uint32]
    gaps: Array
    size: int


class Grid(NamedTuple):
    """Scratch for `find_close`: starts of at most c cells, shape [c + 1], cells [n] and members [n]."""

    starts: npt.NDArray[np.int64]
    cells: npt.NDArray[np.int64]
    members: npt.NDArray[np.int64]


class Touching(NamedTuple):
    """Particles, and middles of threads, that may touch shapes."""

    particles: Pairs
    threads: Pairs


class Step(NamedTuple):
    """The figures of a physics step.

    Attributes:
        substeps: How many small steps it has.
        dt: Length of one [s].
        keep: Share of velocity that damping leaves in one.
        furthest: How far a particle goes at most in one [m].
        rub: Friction coefficient of cloth on cloth.
        lock: Strain from where threads are stiffer.
        factor: How much stiffer.
        field: Gravity [m/s²], shape [3].
    """

    substeps: int
    dt: float
    keep: float
    furthest: float
    rub: float
    lock: float
    factor: float
    field: Array


@numba.njit(cache=True, error_model="numpy")
def _predict(x, v, previous, air, dt, field) -> None:  # type: ignore[no-untyped-def]
    """Begin a small step: weight and the air change velocities, and particles go on by them.

    Args:
        x: Positions [m] and inverse masses [1/kg], shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        previous: Out: where particles were [m], shape [n, 3].
        air: Unit normal and drag per mass and speed squared [1/m], shape [n, 4].
        dt: Length of a small step [s].
        field: Gravity [m/s²], shape [3].
    """
    for i in range(v.shape[0]):
        vx, vy, vz = v[i, 0] + dt * field[0], v[i, 1] + dt * field[1], v[i, 2] + dt * field[2]
        across = vx * air[i, 0] + vy * air[i, 1] + vz * air[i, 2]
        size = abs(across) * air[i, 3] * dt
        lost = across * size / (1.0 + size)  # implicit: air stops cloth but never turns it back
        vx -= lost * air[i, 0]
        vy -= lost * air[i, 1]
        vz -= lost * air[i, 2]
        previous[i, 0], previous[i, 1], previous[i, 2] = x[i, 0], x[i, 1], x[i, 2]
        add(x, i, 0, dt * vx, dt * vy, dt * vz)


@numba.njit(cache=True, error_model="numpy")
def _stretch(x, threads, table, dt, lock, factor) -> None:  # type: ignore[no-untyped-def]
    """Solve every thread once; columns of the table as in `constraint`.

    Beyond the strain `lock` it is `factor` times as stiff: the two straight lines of tension over length
    meet there.
    """
    per_square = 1.0 / (dt * dt)
    longer, shift, part = 1.0 + lock, 1.0 + lock * (1.0 - 1.0 / factor), 1.0 / factor
    for c in range(threads.shape[0]):
        i, j = threads[c, 0], threads[c, 1]
        wi, wj = x[i, 3], x[j, 3]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz) + _LEAST
        rest, softness = table[c, 0], table[c, 1]
        if length > longer * rest:
            rest, softness = shift * rest, part * softness
        total = wi + wj
        total += max(softness * per_square - 0.5 * total, 0.0)
        pull = (length - rest) / (total * length)
        dx, dy, dz = pull * dx, pull * dy, pull * dz
        add(x, i, 0, wi * dx, wi * dy, wi * dz)
        add(x, j, 0, -wj * dx, -wj * dy, -wj * dz)


@numba.njit(cache=True, error_model="numpy")
def _bend(x, folds, table, dt) -> None:  # type: ignore[no-untyped-def]
    """Solve every fold once; columns of the table as in `constraint`."""
    per_square = 1.0 / (dt * dt)
    for c in range(folds.shape[0]):
        i, j, k, m = folds[c, 0], folds[c, 1], folds[c, 2], folds[c, 3]
        a, b, d, e = table[c, 0], table[c, 1], table[c, 2], table[c, 3]
        wa, wb, wd, we = a * x[i, 3], b * x[j, 3], d * x[k, 3], e * x[m, 3]
        scale = -1.0 / (table[c, 4] * per_square + a * wa + b * wb + d * wd + e * we)
        for axis in range(3):
            step = scale * (a * x[i, axis] + b * x[j, axis] + d * x[k, axis] + e * x[m, axis])
            x[i, axis] += wa * step
            x[j, axis] += wb * step
            x[k, axis] += wd * step
            x[m, axis] += we * step


@numba.njit(cache=True, error_model="numpy")
def _hold(x, pinned, pins, dt) -> None:  # type: ignore[no-untyped-def]
    """Move the pins on and pull their particles towards them, no harder than they can."""
    for p in range(pinned.shape[0]):
        i, row = pinned[p], pins[p]
        w = x[i, 3]
        for a in range(3):
            row[ANCHOR + a] += row[WAY + a]
        dx, dy, dz = row[0] - x[i, 0], row[1] - x[i, 1], row[2] - x[i, 2]
        share = w / (w + row[PIN_SOFTNESS] / (dt * dt))
        size = share * np.sqrt(dx * dx + dy * dy + dz * dz) + _LEAST
        share *= min(1.0, row[PIN_LIMIT] * w * dt * dt / size)
        dx, dy, dz = share * dx, share * dy, share * dz
        add(x, i, 0, dx, dy, dz)
        add(pins, p, PULL, dx / (w * dt), dy / (w * dt), dz / (w * dt))


@numba.njit(cache=True, error_model="numpy")
def _part(x, previous, close, rub) -> None:  # type: ignore[no-untyped-def]
    """Push particles of the cloth apart that are closer than their gap, and let them rub."""
    gaps = close.gaps
    for p in range(close.size):
        i, j = close.rows[p, 0], close.rows[p, 1]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        square = dx * dx + dy * dy + dz * dz
        if square >= gaps[p] * gaps[p]:
            continue
        length = np.sqrt(square) + _LEAST
        wi, wj = x[i, 3], x[j, 3]
        depth = gaps[p] - length
        if depth <= 0.0:  # it was parted to the last digit before
            continue
        push = depth / ((wi + wj) * length)
        sx = x[j, 0] - previous[j, 0] - x[i, 0] + previous[i, 0]
        sy = x[j, 1] - previous[j, 1] - x[i, 1] + previous[i, 1]
        sz = x[j, 2] - previous[j, 2] - x[i, 2] + previous[i, 2]
        along = (sx * dx + sy * dy + sz * dz) / (length * length)
        sx, sy, sz = sx - along * dx, sy - along * dy, sz - along * dz
        slip = np.sqrt(sx * sx + sy * sy + sz * sz) + _LEAST
        held = min(1.0, rub * min(depth, max(-along * length, 0.0)) / slip) / (wi + wj)
        fx, fy, fz = held * sx - push * dx, held * sy - push * dy, held * sz - push * dz
        add(x, i, 0, wi * fx, wi * fy, wi * fz)
        add(x, j, 0, -wj * fx, -wj * fy, -wj * fz)
        # What was too close before must not fly apart: only the approach of this step is an impulse.
        rest = push * (1.0 - min(depth, max(-along * length, 0.0)) / depth)
        dx, dy, dz = rest * dx, rest * dy, rest * dz
        add(previous, i, 0, -wi * dx, -wi * dy, -wi * dz)
        add(previous, j, 0, wj * dx, wj * dy, wj * dz)


@numba.njit(cache=True, error_model="numpy")
def _limit(x, previous, furthest) -> None:  # type: ignore[no-untyped-def]
    """Let no particle go further in a small step than `furthest` [m]: it could pass through a limb."""
    for i in range(previous.shape[0]):
        dx, dy, dz = x[i, 0] - previous[i, 0], x[i, 1] - previous[i, 1], x[i, 2] - previous[i, 2]
        square = dx * dx + dy * dy + dz * dz
        if square > furthest * furthest:
            scale = furthest / np.sqrt(square)
            x[i, 0] = previous[i, 0] + scale * dx
            x[i, 1] = previous[i, 1] + scale * dy
            x[i, 2] = previous[i, 2] + scale * dz


@numba.njit(cache=True, error_model="numpy")
def _finish(x, v, previous, keep, dt) -> None:  # type: ignore[no-untyped-def]
    scale = keep / dt
    for i in range(v.shape[0]):
        v[i, 0] = (x[i, 0] - previous[i, 0]) * scale
        v[i, 1] = (x[i, 1] - previous[i, 1]) * scale
        v[i, 2] = (x[i, 2] - previous[i, 2]) * scale


@numba.njit(cache=True, error_model="numpy")
def _sort(x, reach, grid):  # type: ignore[no-untyped-def]
    """Sort particles into the cells of a grid and return its shape; cells are `reach` wide or more."""
    starts, cells, members = grid
    count, size = members.shape[0], starts.shape[0] - 1
    low, wide = x[0, :3].copy(), reach
    high = low.copy()
    for i in range(count):
        for a in range(3):
            low[a], high[a] = min(low[a], x[i, a]), max(high[a], x[i, a])
    ny, nz = 0, 0
    for _ in range(64):  # as fine as there is room for; each wider grid has at most half the cells
        nx, ny = int((high[0] - low[0]) / wide) + 1, int((high[1] - low[1]) / wide) + 3
        nz = int((high[2] - low[2]) / wide) + 3
        if (nx + 2) * ny * nz <= size:
            break
        wide *= 1.26
    starts[:] = 0
    for i in range(count):
        row = int((x[i, 0] - low[0]) / wide) * ny + int((x[i, 1] - low[1]) / wide) + 1
        cells[i] = row * nz + int((x[i, 2] - low[2]) / wide) + 1
        starts[cells[i]] += 1
    for h in range(1, size + 1):
        starts[h] += starts[h - 1]
    for k in range(count):
        i = count - 1 - k
        starts[cells[i]] -= 1
        members[starts[cells[i]]] = i
    return ny, nz


@numba.njit(cache=True, error_model="numpy")
def find_close(x, rest, gap, reach, grid, close, gaps) -> int:  # type: ignore[no-untyped-def]
    """Write pairs of particles of the cloth that are closer than `reach` [m].

    Args:
        x: Positions, shape [n, 4].
        rest: Positions at rest [m], shape [n, 3]; neighbours there are left to threads and folds.
        gap: Least distance of particles [m].
        reach: How near a pair counts [m].
        grid: Scratch, `Grid`.
        close: Out: the pairs, shape [p, 2].
        gaps: Out: least distance of each [m], shape [p].

    Returns:
        How many there are.
    """
    starts, cells, members = grid
    ny, nz = _sort(x, reach, grid)
    # A row of three cells along z is one run of `members`. Own row, and four that stand for eight.
    rows = (0, nz, ny * nz - nz, ny * nz, ny * nz + nz)
    found, square, own = 0, reach * reach, 4.0 * gap * gap
    for i in range(members.shape[0]):
        for n in range(5):
            first = cells[i] + rows[n] - 1
            for s in range(starts[first], starts[first + 3]):
                j = members[s]
                if n == 0 and j <= i:
                    continue
                dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
                if dx * dx + dy * dy + dz * dz > square or found >= close.shape[0]:
                    continue
                rx, ry, rz = (
                    rest[j, 0] - rest[i, 0],
                    rest[j, 1] - rest[i, 1],
                    rest[j, 2] - rest[i, 2],
                )
                if rx * rx + ry * ry + rz * rz > own:
                    close[found, 0], close[found, 1], gaps[found] = i, j, gap
                    found += 1
    return found


@numba.njit(cache=True, error_model="numpy")
def feel_air(x, faces, drag, air) -> None:  # type: ignore[no-untyped-def]
    """Write the unit normal of each particle and its drag per mass and speed squared [1/m].

    Args:
        x: Positions [m] and inverse masses [1/kg], shape [n, 4].
        faces: Shape [m, 3].
        drag: Half the density of air times the drag coefficient [kg/m³].
        air: Out, shape [n, 4].
    """
    air[:] = 0.0
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        bx, by, bz = x[k, 0] - x[i, 0], x[k, 1] - x[i, 1], x[k, 2] - x[i, 2]
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        for m in range(3):
            add(air, faces[f, m], 0, nx, ny, nz)
    for i in range(air.shape[0]):
        row = air[i]
        size = np.sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2]) + _LEAST
        row[0] /= size
        row[1] /= size
        row[2] /= size
        row[3] = drag * size / 6.0 * x[i, 3]


@numba.njit(cache=True)
def simulate(particles, constraints, pins, close, touching, impact, step) -> None:  # type: ignore[no-untyped-def]
    """Simulate one physics step: `Particles`, `constraint.Constraints`, `Pins` and so on; see above."""
    close, step = ClosePairs(*close), Step(*step)
    touching = Touching(Pairs(*touching[0]), Pairs(*touching[1]))
    impact = Impact(Shapes(*impact[0]), impact[1], impact[2], impact[3], impact[4])
    pinned, pins = pins
    x, v, previous, air = particles
    threads, thread_table, folds, fold_table = constraints
    dt, meets = step.dt, touching.particles.size or touching.threads.size
    for k in range(step.substeps):
        _predict(x, v, previous, air, dt, step.field)
        _stretch(x, threads, thread_table, dt, step.lock, step.factor)
        if k % BEND_EVERY == 0:  # cloth bends so easily that less often is as good
            _bend(x, folds, fold_table, dt * ROOT_EVERY)
        _hold(x, pinned, pins, dt)
        if close.size:
            _part(x, previous, close, step.rub)
        _limit(x, previous, step.furthest)
        if meets:
            move_meetings(impact.shapes.meetings, dt)
            touch_sharp(x, previous, threads, touching.threads, impact)
            touch_shapes(x, previous, touching.particles, impact)
        _finish(x, v, previous, step.keep, dt)
