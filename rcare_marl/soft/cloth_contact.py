"""Contact of a cloth's particles with rigid shapes, and what the shapes get of it.

As `contact`, for many more particles: nothing here makes a view of an array, which costs more than to find
a distance.
"""

from __future__ import annotations

import numba
import numpy as np

from .contact import BOX, CAPSULE, CYLINDER, GRIP, HULL, PLACE, SIZE, SLIDE, SPIN, TURN
from .kernel import line_point

# Columns of what a shape got from a cloth in a step: impulse [N·s], moment of impulse about the world's
# origin [N·m·s], then sums over touches: point times size of the normal impulse [m·N·s], count, and that
# size [N·s].
IMPULSE, MOMENT, MIDDLE, COUNT, LOAD = 0, 3, 6, 9, 10
OUTCOME = 11
_LEAST = 1e-12


@numba.njit(cache=True, error_model="numpy", inline="always")
def _box(x, y, z, a, b, c):  # type: ignore[no-untyped-def]
    ox, oy, oz = abs(x) - a, abs(y) - b, abs(z) - c
    sx, sy, sz = np.copysign(1.0, x), np.copysign(1.0, y), np.copysign(1.0, z)
    if ox <= 0.0 and oy <= 0.0 and oz <= 0.0:
        if ox >= oy and ox >= oz:
            return ox, sx, 0.0, 0.0
        if oy >= oz:
            return oy, 0.0, sy, 0.0
        return oz, 0.0, 0.0, sz
    ox, oy, oz = max(ox, 0.0), max(oy, 0.0), max(oz, 0.0)
    length = np.sqrt(ox * ox + oy * oy + oz * oz)
    return length, sx * ox / length, sy * oy / length, sz * oz / length


@numba.njit(cache=True, error_model="numpy", inline="always")
def _cylinder(x, y, z, half, radius):  # type: ignore[no-untyped-def]
    across = np.sqrt(x * x + y * y) + _LEAST
    side, cap, sz = across - radius, abs(z) - half, np.copysign(1.0, z)
    if side <= 0.0 and cap <= 0.0:
        if side >= cap:
            return side, x / across, y / across, 0.0
        return cap, 0.0, 0.0, sz
    side, cap = max(side, 0.0), max(cap, 0.0)
    length = np.sqrt(side * side + cap * cap)
    return length, side / length * x / across, side / length * y / across, sz * cap / length


@numba.njit(cache=True, error_model="numpy")
def _hull(x, y, z, planes, first, last):  # type: ignore[no-untyped-def]
    best, face = -1e9, first
    for k in range(first, last):
        d = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z - planes[k, 3]
        if d > best:
            best, face = d, k
    return best, planes[face, 0], planes[face, 1], planes[face, 2]


@numba.njit(cache=True, error_model="numpy")
def _distance(meetings, c, kind, planes, runs, x, y, z):  # type: ignore[no-untyped-def]
    """Return signed distance of a point from shape `c` [m] and the way out, both in the world."""
    x, y, z = x - meetings[c, PLACE], y - meetings[c, PLACE + 1], z - meetings[c, PLACE + 2]
    r0, r1, r2 = meetings[c, TURN], meetings[c, TURN + 1], meetings[c, TURN + 2]
    r3, r4, r5 = meetings[c, TURN + 3], meetings[c, TURN + 4], meetings[c, TURN + 5]
    r6, r7, r8 = meetings[c, TURN + 6], meetings[c, TURN + 7], meetings[c, TURN + 8]
    x, y, z = r0 * x + r3 * y + r6 * z, r1 * x + r4 * y + r7 * z, r2 * x + r5 * y + r8 * z
    size = meetings[c, SIZE]
    if kind == BOX:
        d, a, b, e = _box(x, y, z, size, meetings[c, SIZE + 1], meetings[c, SIZE + 2])
    elif kind == CYLINDER:
        d, a, b, e = _cylinder(x, y, z, size, meetings[c, SIZE + 1])
    elif kind == HULL:
        d, a, b, e = _hull(x, y, z, planes, runs[c, 0], runs[c, 1])
    else:
        if kind == CAPSULE:
            z -= min(max(z, -size), size)
            size = meetings[c, SIZE + 1]
        length = np.sqrt(x * x + y * y + z * z) + _LEAST
        d, a, b, e = length - size, x / length, y / length, z / length
    return d, r0 * a + r1 * b + r2 * e, r3 * a + r4 * b + r5 * e, r6 * a + r7 * b + r8 * e


@numba.njit(cache=True, error_model="numpy")
def _answer(  # type: ignore[no-untyped-def]
    meetings, c, kind, planes, runs, point, before, mass, dt, thickness, furthest, outcome
):
    """Return how a point moves out of a shape, and by how much of it without speed, twice x, y, z [m].

    Coulomb's law as positions, as in `contact.solve_contacts`. A change of position is a change of
    velocity by itself over dt, so impulses are exact. What was inside before comes out without speed.
    """
    x, y, z = point
    d, nx, ny, nz = _distance(meetings, c, kind, planes, runs, x, y, z)
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
    slip = np.sqrt(sx * sx + sy * sy + sz * sz) + _LEAST
    held = min(1.0, (push + rest) * meetings[c, GRIP] / slip)
    out, quiet = push + rest, rest + max(along, 0.0)
    mx, my, mz = out * nx - held * sx, out * ny - held * sy, out * nz - held * sz
    x, y, z = x + mx, y + my, z + mz
    held *= push / (out + _LEAST)
    fx, fy, fz = push * nx - held * sx, push * ny - held * sy, push * nz - held * sz
    load = push * mass / dt
    jx, jy, jz = -fx * mass / dt, -fy * mass / dt, -fz * mass / dt
    outcome[c, IMPULSE] += jx
    outcome[c, IMPULSE + 1] += jy
    outcome[c, IMPULSE + 2] += jz
    outcome[c, MOMENT] += y * jz - z * jy
    outcome[c, MOMENT + 1] += z * jx - x * jz
    outcome[c, MOMENT + 2] += x * jy - y * jx
    outcome[c, MIDDLE] += load * x
    outcome[c, MIDDLE + 1] += load * y
    outcome[c, MIDDLE + 2] += load * z
    outcome[c, COUNT] += 1.0
    outcome[c, LOAD] += load
    return True, mx, my, mz, quiet * nx, quiet * ny, quiet * nz


@numba.njit(cache=True, error_model="numpy")
def touch_shapes(  # type: ignore[no-untyped-def]
    x, previous, pairs, count, meetings, kinds, planes, runs, dt, thickness, furthest, outcome
) -> None:
    """Push particles out of the shapes, hold them back by friction, and note what shapes get."""
    for p in range(count):
        i, c = pairs[p, 0], pairs[p, 1]
        point = (x[i, 0], x[i, 1], x[i, 2])
        before = (previous[i, 0], previous[i, 1], previous[i, 2])
        is_hit, dx, dy, dz, ox, oy, oz = _answer(
            meetings, c, kinds[c], planes, runs, point, before, 1.0 / x[i, 3], dt, thickness,
            furthest, outcome,
        )  # fmt: skip
        if is_hit:
            x[i, 0] += dx
            x[i, 1] += dy
            x[i, 2] += dz
            previous[i, 0] += ox
            previous[i, 1] += oy
            previous[i, 2] += oz


@numba.njit(cache=True, error_model="numpy")
def touch_sharp(  # type: ignore[no-untyped-def]
    x, previous, threads, pairs, count, meetings, kinds, planes, runs, dt, thickness, furthest,
    outcome,
) -> None:  # fmt: skip
    """Do the same with the middles of threads, whose two ends move together.

    A heel or a finger is not much wider than the mesh: without this its corner comes through.
    """
    for p in range(count):
        t, c = pairs[p, 0], pairs[p, 1]
        i, j = threads[t, 0], threads[t, 1]
        point = (
            0.5 * (x[i, 0] + x[j, 0]), 0.5 * (x[i, 1] + x[j, 1]), 0.5 * (x[i, 2] + x[j, 2]),
        )  # fmt: skip
        before = (
            0.5 * (previous[i, 0] + previous[j, 0]),
            0.5 * (previous[i, 1] + previous[j, 1]),
            0.5 * (previous[i, 2] + previous[j, 2]),
        )
        is_hit, dx, dy, dz, ox, oy, oz = _answer(
            meetings, c, kinds[c], planes, runs, point, before, 1.0 / x[i, 3] + 1.0 / x[j, 3], dt,
            thickness, furthest, outcome,
        )  # fmt: skip
        if is_hit:
            x[i, 0] += dx
            x[i, 1] += dy
            x[i, 2] += dz
            x[j, 0] += dx
            x[j, 1] += dy
            x[j, 2] += dz
            previous[i, 0] += ox
            previous[i, 1] += oy
            previous[i, 2] += oz
            previous[j, 0] += ox
            previous[j, 1] += oy
            previous[j, 2] += oz


@numba.njit(cache=True, error_model="numpy")
def find_middles(x, v, threads, middles, speeds) -> None:  # type: ignore[no-untyped-def]
    """Write the middles of threads [m], shape [t, 3], and their velocities [m/s], shape [t, 3]."""
    for t in range(threads.shape[0]):
        i, j = threads[t, 0], threads[t, 1]
        for a in range(3):
            middles[t, a] = 0.5 * (x[i, a] + x[j, a])
            speeds[t, a] = 0.5 * (v[i, a] + v[j, a])


@numba.njit(cache=True, error_model="numpy")
def find_near(  # type: ignore[no-untyped-def]
    x, v, low, high, meetings, kinds, planes, runs, radii, reach, least, period, pairs
) -> int:
    """Write (particle, shape) for each particle that may come to a shape in `period` [s].

    Args:
        x: Positions, shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        low: Lower corner of a box around all particles [m], shape [3].
        high: Its upper corner.
        meetings: Shapes in the world, columns as in `contact`, shape [m, MEETING].
        kinds: Their kinds.
        planes: Planes of all hulls.
        runs: Runs of the planes of each.
        radii: Of spheres around them [m].
        reach: How near a particle counts that does not move [m].
        least: Speed that a particle may soon have in any case [m/s].
        period: How long [s].
        pairs: Out, shape [p, 2].

    Returns:
        How many there are.
    """
    count, ways = 0, np.empty(v.shape[0])
    most = 0.0
    for i in range(v.shape[0]):
        speed = np.sqrt(v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1] + v[i, 2] * v[i, 2])
        ways[i] = reach + period * max(speed, least)
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
            d, _, _, _ = _distance(meetings, c, kinds[c], planes, runs, x[i, 0], x[i, 1], x[i, 2])
            if d < near:
                pairs[count, 0], pairs[count, 1] = i, c
                count += 1
    return count


@numba.njit(cache=True)
def find_threads(near, count, sharp, starts, around, stamps, pairs) -> int:  # type: ignore[no-untyped-def]
    """Write (thread, shape) for each thread of a particle that is near a sharp shape.

    Args:
        near: Pairs of particle and shape, sorted by shape.
        count: How many there are.
        sharp: Whether each shape is sharp, shape [m].
        starts: First of the threads of each particle in `around`, shape [n + 1].
        around: Threads of all particles, shape [2 t].
        stamps: Scratch, shape [t].
        pairs: Out, shape [p, 2].

    Returns:
        How many there are.
    """
    found = 0
    stamps[:] = -1
    for p in range(count):
        i, c = near[p, 0], near[p, 1]
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
def narrow(  # type: ignore[no-untyped-def]
    x, v, near, near_count, meetings, kinds, planes, runs, radii, reach, period, pairs
) -> int:
    """Write those of the pairs found by `find_near` that may touch in the coming `period` [s].

    Args:
        x: Positions, shape [n, 4].
        v: Velocities [m/s], shape [n, 3].
        near: The pairs.
        near_count: How many there are.
        meetings: Shapes in the world with their velocities.
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
    count, ways = 0, np.empty(meetings.shape[0])
    for c in range(meetings.shape[0]):
        speed, spin = 0.0, 0.0
        for a in range(3):
            speed += meetings[c, SLIDE + a] ** 2
            spin += meetings[c, SPIN + a] ** 2
        ways[c] = reach + period * (np.sqrt(speed) + np.sqrt(spin) * min(radii[c], 2.0))
    for p in range(near_count):
        i, c = near[p, 0], near[p, 1]
        way = ways[c] + period * np.sqrt(v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1] + v[i, 2] * v[i, 2])
        d, _, _, _ = _distance(meetings, c, kinds[c], planes, runs, x[i, 0], x[i, 1], x[i, 2])
        if d < way:
            pairs[count, 0], pairs[count, 1] = i, c
            count += 1
    return count


@numba.njit(cache=True, error_model="numpy")
def sum_by_link(outcome, owners, period, far, sums) -> None:  # type: ignore[no-untyped-def]
    """Add up what the shapes of each link got, as force [N] and a point of its line of action [m].

    Args:
        outcome: What each shape got, shape [m, OUTCOME].
        owners: Place of the link of each shape, shape [m].
        period: Length of the physics step [s].
        far: Distance from what was touched, from where a point is none [m]: forces all round that
            cancel leave a couple, which no line can give.
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
            sums[k, 3 + a] = middle[a] if apart > far * far else point[a]
        sums[k, 6] = load / period


__all__ = [
    "COUNT",
    "IMPULSE",
    "LOAD",
    "MIDDLE",
    "MOMENT",
    "OUTCOME",
    "find_middles",
    "find_near",
    "find_threads",
    "narrow",
    "sum_by_link",
    "touch_shapes",
    "touch_sharp",
]
