"""Contact of a cloth's particles with rigid shapes, and what the shapes get of it.

As `contact`, for many more particles: nothing here makes a view of an array, which costs more than to find
a distance.
"""

from __future__ import annotations

import numba
import numpy as np

from .contact import BOX, CAPSULE, CYLINDER, GRIP, HULL, PLACE, SIZE, SLIDE, SPIN, TURN

# Columns of what a shape got from a cloth in a step: impulse [N·s], moment of impulse about the world's
# origin [N·m·s], then sums over touches: point [m], normal, count, size of the normal impulses [N·s].
IMPULSE, MOMENT, MIDDLE, NORMAL, COUNT, LOAD = 0, 3, 6, 9, 12, 13
OUTCOME = 14
_LEAST = 1e-12


@numba.njit(cache=True, fastmath=True, error_model="numpy", inline="always")
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


@numba.njit(cache=True, fastmath=True, error_model="numpy", inline="always")
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


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _hull(x, y, z, planes, first, last):  # type: ignore[no-untyped-def]
    best, face = -1e9, first
    for k in range(first, last):
        d = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z - planes[k, 3]
        if d > best:
            best, face = d, k
    return best, planes[face, 0], planes[face, 1], planes[face, 2]


@numba.njit(cache=True, fastmath=True, error_model="numpy")
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


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def touch_shapes(  # type: ignore[no-untyped-def]
    x, previous, pairs, count, meetings, kinds, planes, runs, dt, thickness, furthest, outcome
) -> None:
    """Push particles out of the shapes, hold them back by friction, and note what shapes get.

    Coulomb's law as positions, as in `contact.solve_contacts`. A change of position is a change of
    velocity by itself over dt, so impulses are exact. What was inside before comes out without speed.
    """
    for p in range(count):
        i, c = pairs[p, 0], pairs[p, 1]
        d, nx, ny, nz = _distance(meetings, c, kinds[c], planes, runs, x[i, 0], x[i, 1], x[i, 2])
        d -= thickness
        if d >= 0.0:
            continue
        rx, ry, rz = x[i, 0] - meetings[c, PLACE], x[i, 1] - meetings[c, PLACE + 1], x[i, 2] - meetings[c, PLACE + 2]
        sx = x[i, 0] - previous[i, 0] - dt * (meetings[c, SLIDE] + meetings[c, SPIN + 1] * rz - meetings[c, SPIN + 2] * ry)
        sy = x[i, 1] - previous[i, 1] - dt * (meetings[c, SLIDE + 1] + meetings[c, SPIN + 2] * rx - meetings[c, SPIN] * rz)
        sz = x[i, 2] - previous[i, 2] - dt * (meetings[c, SLIDE + 2] + meetings[c, SPIN] * ry - meetings[c, SPIN + 1] * rx)
        along = sx * nx + sy * ny + sz * nz
        # Of the way out, `along` below zero is the approach of this step: that much is an impulse.
        push = min(-d, max(-along, 0.0))
        rest = min(-d - push, furthest)
        previous[i, 0] += rest * nx
        previous[i, 1] += rest * ny
        previous[i, 2] += rest * nz
        sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
        slip = np.sqrt(sx * sx + sy * sy + sz * sz) + _LEAST
        held = min(1.0, push * meetings[c, GRIP] / slip)
        fx, fy, fz = push * nx - held * sx, push * ny - held * sy, push * nz - held * sz
        x[i, 0] += fx + rest * nx
        x[i, 1] += fy + rest * ny
        x[i, 2] += fz + rest * nz
        mass = -1.0 / (x[i, 3] * dt)
        fx, fy, fz = mass * fx, mass * fy, mass * fz
        px, py, pz = x[i, 0], x[i, 1], x[i, 2]
        outcome[c, IMPULSE] += fx
        outcome[c, IMPULSE + 1] += fy
        outcome[c, IMPULSE + 2] += fz
        outcome[c, MOMENT] += py * fz - pz * fy
        outcome[c, MOMENT + 1] += pz * fx - px * fz
        outcome[c, MOMENT + 2] += px * fy - py * fx
        weight = -mass * push
        outcome[c, MIDDLE] += weight * px
        outcome[c, MIDDLE + 1] += weight * py
        outcome[c, MIDDLE + 2] += weight * pz
        outcome[c, NORMAL] += weight * nx
        outcome[c, NORMAL + 1] += weight * ny
        outcome[c, NORMAL + 2] += weight * nz
        outcome[c, COUNT] += 1.0
        outcome[c, LOAD] += weight


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
    count, ways = 0, np.empty(v.shape[0])
    for i in range(v.shape[0]):
        ways[i] = period * np.sqrt(v[i, 0] ** 2 + v[i, 1] ** 2 + v[i, 2] ** 2)
    for c in range(meetings.shape[0]):
        speed = np.sqrt(meetings[c, SLIDE] ** 2 + meetings[c, SLIDE + 1] ** 2 + meetings[c, SLIDE + 2] ** 2)
        spin = np.sqrt(meetings[c, SPIN] ** 2 + meetings[c, SPIN + 1] ** 2 + meetings[c, SPIN + 2] ** 2)
        ahead = reach + period * (speed + spin * min(radii[c], 2.0))
        px, py, pz = meetings[c, PLACE], meetings[c, PLACE + 1], meetings[c, PLACE + 2]
        for i in range(v.shape[0]):
            near = ahead + ways[i]
            dx, dy, dz = x[i, 0] - px, x[i, 1] - py, x[i, 2] - pz
            if dx * dx + dy * dy + dz * dz > (radii[c] + near) ** 2 or count >= pairs.shape[0]:
                continue
            d, _, _, _ = _distance(meetings, c, kinds[c], planes, runs, x[i, 0], x[i, 1], x[i, 2])
            if d < near:
                pairs[count, 0], pairs[count, 1] = i, c
                count += 1
    return count


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
        square = 0.0
        for a in range(3):
            square += (meetings[c, PLACE + a] - middle[a]) ** 2
        out[c] = False
        if square > (radii[c] + radius + reach) ** 2:
            continue
        d, _, _, _ = _distance(meetings, c, kinds[c], planes, runs, middle[0], middle[1], middle[2])
        if d > radius + reach:
            continue
        for i in range(x.shape[0]):
            d, _, _, _ = _distance(meetings, c, kinds[c], planes, runs, x[i, 0], x[i, 1], x[i, 2])
            if d < reach:
                out[c] = True
                break


__all__ = [
    "COUNT",
    "IMPULSE",
    "LOAD",
    "MIDDLE",
    "MOMENT",
    "NORMAL",
    "OUTCOME",
    "find_near",
    "find_shapes",
    "touch_shapes",
]
