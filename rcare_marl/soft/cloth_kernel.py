"""The loops over the particles of a cloth.

Small steps with one iteration each: M. Macklin, K. Storey, M. Lu, P. Terdiman, N. Chentanez, S. Jeschke
and M. Müller, "Small Steps in Physics Simulation" (SCA 2019). One iteration leaves a thread softer than it
is: of two particles that it joins, each was or will be moved by others in the same small step, by as much as
the tension does in it. On average that adds (w_i + w_j) dt² / 2 to the compliance, w being inverse masses;
this is taken off again, so that a strip stretches as its figures say.
"""

from __future__ import annotations

import numba
import numpy as np

from .contact import GRIP, PLACE, SLIDE, SPIN, distance_to, move_meetings

# Columns of what a shape got from a cloth in a step: impulse [N·s], moment of impulse about the world's
# origin [N·m·s], then sums over touches: point [m], normal, count, size of the normal impulses [N·s].
IMPULSE, MOMENT, MIDDLE, NORMAL, COUNT, LOAD = 0, 3, 6, 9, 12, 13
OUTCOME = 14
# Columns of a pin: where it is [m], its way in a small step [m], compliance [m/N], greatest force [N], and
# the impulse on the particle in this step [N·s].
ANCHOR, WAY, PIN_SOFTNESS, PIN_LIMIT, PULL = 0, 3, 6, 7, 8
PIN = 11
# Columns of the constants of a step.
DT, KEEP, FASTEST, RUB, THICKNESS, FIELD = 0, 1, 2, 3, 4, 5
CONSTANTS = 8
BEND_EVERY, ROOT_EVERY = 2, 2.0**0.5  # an impulse of so many small steps at once
_LEAST = 1e-12
_HASH = (92837111, 689287499, 283923481)  # of three cell numbers; any large primes do


@numba.njit(cache=True, fastmath=True, error_model="numpy")
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
        x[i, 0] += dt * vx
        x[i, 1] += dt * vy
        x[i, 2] += dt * vz


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _stretch(x, threads, table, dt) -> None:  # type: ignore[no-untyped-def]
    """Solve every thread once; columns of the table as in `weave`."""
    square = dt * dt
    per_square = 1.0 / square
    for c in range(threads.shape[0]):
        i, j = threads[c, 0], threads[c, 1]
        wi, wj = x[i, 3], x[j, 3]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz) + _LEAST
        rest, softness = table[c, 0], table[c, 1]
        if length > table[c, 4]:
            rest, softness = table[c, 2], table[c, 3]
        total = wi + wj
        total += max(softness * per_square - 0.5 * total, 0.0)
        pull = (length - rest) / (total * length)
        dx, dy, dz = pull * dx, pull * dy, pull * dz
        x[i, 0] += wi * dx
        x[i, 1] += wi * dy
        x[i, 2] += wi * dz
        x[j, 0] -= wj * dx
        x[j, 1] -= wj * dy
        x[j, 2] -= wj * dz


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _bend(x, folds, table, dt) -> None:  # type: ignore[no-untyped-def]
    """Solve every fold once; columns of the table as in `weave`."""
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


@numba.njit(cache=True, fastmath=True, error_model="numpy")
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
        x[i, 0] += share * dx
        x[i, 1] += share * dy
        x[i, 2] += share * dz
        row[PULL] += share * dx / (w * dt)
        row[PULL + 1] += share * dy / (w * dt)
        row[PULL + 2] += share * dz / (w * dt)


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _part(x, previous, close, gaps, count, rub) -> None:  # type: ignore[no-untyped-def]
    """Push particles of the cloth apart that are closer than their gap, and let them rub."""
    for p in range(count):
        i, j = close[p, 0], close[p, 1]
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
        x[i, 0] += wi * fx
        x[i, 1] += wi * fy
        x[i, 2] += wi * fz
        x[j, 0] -= wj * fx
        x[j, 1] -= wj * fy
        x[j, 2] -= wj * fz
        # What was too close before must not fly apart: only the approach of this step is an impulse.
        rest = push * (1.0 - min(depth, max(-along * length, 0.0)) / depth)
        for a in range(3):
            o = rest * (dx if a == 0 else (dy if a == 1 else dz))
            previous[i, a] -= wi * o
            previous[j, a] += wj * o


@numba.njit(cache=True, fastmath=True, error_model="numpy")
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


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _touch(  # type: ignore[no-untyped-def]
    x, previous, pairs, count, meetings, kinds, planes, runs, dt, thickness, furthest, outcome
) -> None:
    """Push particles out of the shapes, hold them back by friction, and note what shapes get.

    Coulomb's law as positions, as in `contact.solve_contacts`. A change of position is a change of
    velocity by itself over dt, so impulses are exact. What was inside before comes out without speed.
    """
    for p in range(count):
        i, c = pairs[p, 0], pairs[p, 1]
        row = meetings[c]
        d, nx, ny, nz = distance_to(row, kinds[c], planes, runs[c], x[i, 0], x[i, 1], x[i, 2])
        d -= thickness
        if d >= 0.0:
            continue
        rx, ry, rz = x[i, 0] - row[PLACE], x[i, 1] - row[PLACE + 1], x[i, 2] - row[PLACE + 2]
        sx = x[i, 0] - previous[i, 0] - dt * (row[SLIDE] + row[SPIN + 1] * rz - row[SPIN + 2] * ry)
        sy = x[i, 1] - previous[i, 1] - dt * (row[SLIDE + 1] + row[SPIN + 2] * rx - row[SPIN] * rz)
        sz = x[i, 2] - previous[i, 2] - dt * (row[SLIDE + 2] + row[SPIN] * ry - row[SPIN + 1] * rx)
        along = sx * nx + sy * ny + sz * nz
        # Of the way out, `along` below zero is the approach of this step: that much is an impulse.
        push = min(-d, max(-along, 0.0))
        rest = min(-d - push, furthest)
        previous[i, 0] += rest * nx
        previous[i, 1] += rest * ny
        previous[i, 2] += rest * nz
        sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
        slip = np.sqrt(sx * sx + sy * sy + sz * sz) + _LEAST
        held = min(1.0, push * row[GRIP] / slip)
        fx, fy, fz = push * nx - held * sx, push * ny - held * sy, push * nz - held * sz
        x[i, 0] += fx + rest * nx
        x[i, 1] += fy + rest * ny
        x[i, 2] += fz + rest * nz
        out, mass = outcome[c], -1.0 / (x[i, 3] * dt)
        fx, fy, fz = mass * fx, mass * fy, mass * fz
        px, py, pz = x[i, 0], x[i, 1], x[i, 2]
        out[IMPULSE] += fx
        out[IMPULSE + 1] += fy
        out[IMPULSE + 2] += fz
        out[MOMENT] += py * fz - pz * fy
        out[MOMENT + 1] += pz * fx - px * fz
        out[MOMENT + 2] += px * fy - py * fx
        weight = -mass * push
        out[MIDDLE] += weight * px
        out[MIDDLE + 1] += weight * py
        out[MIDDLE + 2] += weight * pz
        out[NORMAL] += weight * nx
        out[NORMAL + 1] += weight * ny
        out[NORMAL + 2] += weight * nz
        out[COUNT] += 1.0
        out[LOAD] += weight


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _finish(x, v, previous, keep, dt) -> None:  # type: ignore[no-untyped-def]
    scale = keep / dt
    for i in range(v.shape[0]):
        v[i, 0] = (x[i, 0] - previous[i, 0]) * scale
        v[i, 1] = (x[i, 1] - previous[i, 1]) * scale
        v[i, 2] = (x[i, 2] - previous[i, 2]) * scale


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def find_near(x, v, meetings, kinds, planes, runs, radii, reach, period, pairs) -> int:  # type: ignore[no-untyped-def]
    """Write (particle, shape) for each particle that may come to a shape in `period` [s].

    Args:
        x: Positions, shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        meetings: Shapes in the world, columns as in `contact`, shape [m, MEETING].
        kinds: Their kinds.
        planes: Planes of all hulls.
        runs: Runs of the planes of each.
        radii: Of spheres around them [m].
        reach: How near counts as touching [m].
        period: Length of the physics step [s].
        pairs: Out, shape [p, 2].

    Returns:
        How many there are.
    """
    count = 0
    for c in range(meetings.shape[0]):
        row = meetings[c]
        speed = np.sqrt(row[SLIDE] ** 2 + row[SLIDE + 1] ** 2 + row[SLIDE + 2] ** 2)
        spin = np.sqrt(row[SPIN] ** 2 + row[SPIN + 1] ** 2 + row[SPIN + 2] ** 2)
        ahead = reach + period * (speed + spin * min(radii[c], 2.0))
        for i in range(v.shape[0]):
            near = ahead + period * np.sqrt(v[i, 0] ** 2 + v[i, 1] ** 2 + v[i, 2] ** 2)
            dx, dy, dz = x[i, 0] - row[PLACE], x[i, 1] - row[PLACE + 1], x[i, 2] - row[PLACE + 2]
            if dx * dx + dy * dy + dz * dz > (radii[c] + near) ** 2 or count >= pairs.shape[0]:
                continue
            d, _, _, _ = distance_to(row, kinds[c], planes, runs[c], x[i, 0], x[i, 1], x[i, 2])
            if d < near:
                pairs[count, 0], pairs[count, 1] = i, c
                count += 1
    return count


@numba.njit(cache=True)
def _cell(a, b, c, size):  # type: ignore[no-untyped-def]
    return np.uint64((a * _HASH[0]) ^ (b * _HASH[1]) ^ (c * _HASH[2])) & np.uint64(size - 1)


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def find_close(x, rest, gap, reach, starts, cells, members, close, gaps) -> int:  # type: ignore[no-untyped-def]
    """Write pairs of particles of the cloth that are closer than `reach` [m], by a spatial hash.

    M. Teschner, B. Heidelberger, M. Müller, D. Pomeranets and M. Gross, "Optimized Spatial Hashing for
    Collision Detection of Deformable Objects" (VMV 2003).

    Args:
        x: Positions, shape [n, 4].
        rest: Positions at rest [m], shape [n, 3]; neighbours there are left to threads and folds.
        gap: Least distance of particles [m].
        reach: How near a pair counts [m].
        starts: Scratch, shape [s + 1], s being a power of two.
        cells: Scratch, shape [n, 3].
        members: Scratch, shape [n].
        close: Out: the pairs, shape [p, 2].
        gaps: Out: least distance of each [m], shape [p].

    Returns:
        How many there are.
    """
    count, size, per = rest.shape[0], starts.shape[0] - 1, 1.0 / reach
    starts[:] = 0
    for i in range(count):
        for a in range(3):
            cells[i, a] = int(np.floor(x[i, a] * per))
        starts[_cell(cells[i, 0], cells[i, 1], cells[i, 2], size)] += 1
    for h in range(1, size + 1):
        starts[h] += starts[h - 1]
    for k in range(count):
        i = count - 1 - k
        h = _cell(cells[i, 0], cells[i, 1], cells[i, 2], size)
        starts[h] -= 1
        members[starts[h]] = i
    found = 0
    for i in range(count):
        for n in range(27):
            h = _cell(
                cells[i, 0] + n // 9 - 1, cells[i, 1] + (n // 3) % 3 - 1, cells[i, 2] + n % 3 - 1, size
            )
            for s in range(starts[h], starts[h + np.uint64(1)]):
                j = members[s]
                if j <= i:
                    continue
                dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
                if dx * dx + dy * dy + dz * dz > reach * reach or found >= close.shape[0]:
                    continue
                rx, ry, rz = rest[j, 0] - rest[i, 0], rest[j, 1] - rest[i, 1], rest[j, 2] - rest[i, 2]
                if rx * rx + ry * ry + rz * rz > 4.0 * gap * gap:
                    close[found, 0], close[found, 1], gaps[found] = i, j, gap
                    found += 1
    return found


@numba.njit(cache=True, fastmath=True, error_model="numpy")
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
            row = air[faces[f, m]]
            row[0] += nx
            row[1] += ny
            row[2] += nz
    for i in range(air.shape[0]):
        row = air[i]
        size = np.sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2]) + _LEAST
        row[0] /= size
        row[1] /= size
        row[2] /= size
        row[3] = drag * size / 6.0 * x[i, 3]


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def find_shapes(x, middle, radius, meetings, kinds, planes, runs, radii, reach, out) -> None:  # type: ignore[no-untyped-def]
    """Write which shapes are within `reach` [m] of any particle, shape [m].

    Args:
        x: Positions, shape [n, 4].
        middle: Of a sphere around the cloth [m], shape [3].
        radius: Of that sphere [m].
        meetings: Shapes in the world, columns as in `contact`, shape [m, MEETING].
        kinds: Their kinds.
        planes: Planes of all hulls.
        runs: Runs of the planes of each.
        radii: Of spheres around them [m].
        reach: How near counts [m].
        out: Out.
    """
    for c in range(meetings.shape[0]):
        row, square = meetings[c], 0.0
        for a in range(3):
            square += (row[PLACE + a] - middle[a]) ** 2
        out[c] = False
        if square > (radii[c] + radius + reach) ** 2:
            continue
        d, _, _, _ = distance_to(row, kinds[c], planes, runs[c], middle[0], middle[1], middle[2])
        if d > radius + reach:
            continue
        for i in range(x.shape[0]):
            d, _, _, _ = distance_to(row, kinds[c], planes, runs[c], x[i, 0], x[i, 1], x[i, 2])
            if d < reach:
                out[c] = True
                break


@numba.njit(cache=True)
def simulate(  # type: ignore[no-untyped-def]
    x, v, previous, air, constants, substeps, threads, thread_table, folds, fold_table, pinned, pins,
    close, gaps, close_count, pairs, pair_count, meetings, kinds, planes, runs, outcome,
) -> None:  # fmt: skip
    """Simulate one physics step; see above for the tables."""
    dt, furthest = constants[DT], constants[FASTEST] * constants[DT]
    field = constants[FIELD:]
    for step in range(substeps):
        _predict(x, v, previous, air, dt, field)
        _stretch(x, threads, thread_table, dt)
        if step % BEND_EVERY == 0:  # cloth bends so easily that half as often is as good
            _bend(x, folds, fold_table, dt * ROOT_EVERY)
        _hold(x, pinned, pins, dt)
        if close_count:
            _part(x, previous, close, gaps, close_count, constants[RUB])
        _limit(x, previous, furthest)
        if pair_count:
            move_meetings(meetings, np.float32(dt))
            _touch(
                x, previous, pairs, pair_count, meetings, kinds, planes, runs, dt,
                constants[THICKNESS], furthest, outcome,
            )  # fmt: skip
        _finish(x, v, previous, constants[KEEP], dt)


__all__ = [
    "ANCHOR",
    "CONSTANTS",
    "COUNT",
    "DT",
    "FASTEST",
    "FIELD",
    "IMPULSE",
    "KEEP",
    "LOAD",
    "MIDDLE",
    "MOMENT",
    "NORMAL",
    "OUTCOME",
    "PIN",
    "PIN_LIMIT",
    "PIN_SOFTNESS",
    "PULL",
    "RUB",
    "THICKNESS",
    "WAY",
    "feel_air",
    "find_close",
    "find_near",
    "find_shapes",
    "simulate",
]
