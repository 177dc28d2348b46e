"""Contact of particles with rigid shapes: signed distance, projection out of the shape, friction.

Nothing here makes a view of an array, which costs more than to find a distance.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int32]
Rows = npt.NDArray[np.int64]
Numbers = npt.NDArray[np.uint32]

SPHERE, BOX, CAPSULE, CYLINDER, HULL = range(5)

# Columns of the table of shapes as one body meets them, in its own frame.
PLACE, TURN, SLIDE, SPIN, GRIP = 0, 3, 12, 15, 18  # position, rotation, velocities, friction
SIZE = 19
MEETING = 22

_ZERO, _ONE = np.float32(0), np.float32(1)
LEAST = np.float32(1e-9)  # [m], a length that counts as none in single precision
LEAST_DOUBLE = 1e-12  # and in double


class Shapes(NamedTuple):
    """Rigid shapes as a soft object meets them.

    Attributes:
        meetings: Places, velocities, sizes and friction in the frame of the object, shape [m, MEETING].
        kinds: Their kinds, shape [m].
        planes: Planes of all hulls: unit normal and distance from the origin, shape [p, 4].
        runs: First and last plus one of the planes of each hull, shape [m, 2].
        radii: Of spheres around them [m], shape [m].
        foundations: Stiffness of the flesh on each, zero where it is rigid [Pa/m], shape [m].
    """

    meetings: npt.NDArray[np.floating[Any]]
    kinds: npt.NDArray[np.int64]
    planes: npt.NDArray[np.float32]
    runs: npt.NDArray[np.int64]
    radii: npt.NDArray[np.float64]
    foundations: npt.NDArray[np.float32]


class Surface(NamedTuple):
    """The surface of a soft body and what it touches.

    Attributes:
        skin: Particles that can touch, shape [s].
        areas: Area around each particle at rest [m²], shape [n].
        touch: Out: shape that each particle touches plus one, 0 if none, shape [n].
        normals: Out: the way out of it, shape [n, 3].
    """

    skin: npt.NDArray[np.int32]
    areas: npt.NDArray[np.float32]
    touch: npt.NDArray[np.int32]
    normals: npt.NDArray[np.float32]


def plain(tables: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return named tuples as plain ones, for a call from Python.

    Numba finds the type of a plain tuple at once, that of a named one in Python, which takes 25 µs.
    """
    return tuple(plain(value) if isinstance(value, tuple) else value for value in tables)


@numba.njit(cache=True, error_model="numpy", inline="always")
def add(table, i, at, x, y, z) -> None:  # type: ignore[no-untyped-def]
    """Add to three columns of a row, from column `at` on."""
    table[i, at] += x
    table[i, at + 1] += y
    table[i, at + 2] += z


@numba.njit(cache=True, error_model="numpy", inline="always")
def note(table, i, x, y, z, jx, jy, jz) -> None:  # type: ignore[no-untyped-def]
    """Add a force or impulse at a point, and its moment about the origin, to the first six columns."""
    add(table, i, 0, jx, jy, jz)
    add(table, i, 3, y * jz - z * jy, z * jx - x * jz, x * jy - y * jx)


@numba.njit(cache=True, error_model="numpy", inline="always")
def _box(x, y, z, a, b, c):  # type: ignore[no-untyped-def]
    ox, oy, oz = abs(x) - a, abs(y) - b, abs(z) - c
    sx = _ONE if x >= _ZERO else -_ONE
    sy = _ONE if y >= _ZERO else -_ONE
    sz = _ONE if z >= _ZERO else -_ONE
    if ox <= _ZERO and oy <= _ZERO and oz <= _ZERO:
        if ox >= oy and ox >= oz:
            return ox, sx, _ZERO, _ZERO
        if oy >= oz:
            return oy, _ZERO, sy, _ZERO
        return oz, _ZERO, _ZERO, sz
    ox, oy, oz = max(ox, _ZERO), max(oy, _ZERO), max(oz, _ZERO)
    length = np.sqrt(ox * ox + oy * oy + oz * oz)
    return length, sx * ox / length, sy * oy / length, sz * oz / length


@numba.njit(cache=True, error_model="numpy", inline="always")
def _cylinder(x, y, z, half, radius, least):  # type: ignore[no-untyped-def]
    across = np.sqrt(x * x + y * y) + least
    side, cap = across - radius, abs(z) - half
    sz = _ONE if z >= _ZERO else -_ONE
    if side <= _ZERO and cap <= _ZERO:
        if side >= cap:
            return side, x / across, y / across, _ZERO
        return cap, _ZERO, _ZERO, sz
    side, cap = max(side, _ZERO), max(cap, _ZERO)
    length = np.sqrt(side * side + cap * cap)
    return length, side / length * x / across, side / length * y / across, sz * cap / length


@numba.njit(cache=True, error_model="numpy")
def _hull(x, y, z, planes, first, last):  # type: ignore[no-untyped-def]
    """Exact inside; outside it is the distance from the furthest plane, which is never too long."""
    best, face = planes[first, 0] * x + planes[first, 1] * y + planes[first, 2] * z, first
    best -= planes[first, 3]
    for k in range(first + 1, last):
        d = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z - planes[k, 3]
        if d > best:
            best, face = d, k
    return best, planes[face, 0], planes[face, 1], planes[face, 2]


@numba.njit(cache=True, error_model="numpy")
def signed_distance(kind, sizes, planes, run, x, y, z, least):  # type: ignore[no-untyped-def]
    """Return how far a point is from a shape's surface [m], negative inside, and the way out.

    Args:
        kind: One of the constants above.
        sizes: Sphere: radius; box: three half edges; capsule, cylinder: half length, radius [m].
        planes: Of all hulls: unit normal and distance from the origin, shape [p, 4].
        run: First and last plus one of the planes of this hull.
        x: Point in the frame of the shape [m].
        y: Its second coordinate.
        z: Its third coordinate.
        least: A length that counts as none [m], in the precision of all others.
    """
    if kind == BOX:
        return _box(x, y, z, sizes[0], sizes[1], sizes[2])
    if kind == CYLINDER:
        return _cylinder(x, y, z, sizes[0], sizes[1], least)
    if kind == HULL:
        return _hull(x, y, z, planes, run[0], run[1])
    radius = sizes[0]
    if kind == CAPSULE:
        radius = sizes[1]
        z -= min(max(z, -sizes[0]), sizes[0])
    length = np.sqrt(x * x + y * y + z * z) + least
    return length - radius, x / length, y / length, z / length


@numba.njit(cache=True, error_model="numpy")
def distance_in(meetings, c, kind, planes, runs, x, y, z, least):  # type: ignore[no-untyped-def]
    """Return signed distance of a point from shape `c` [m] and the way out, both in the object's frame.

    It takes the tables one by one: a call with all of them costs more than what it computes.
    """
    x, y, z = x - meetings[c, PLACE], y - meetings[c, PLACE + 1], z - meetings[c, PLACE + 2]
    r0, r1, r2 = meetings[c, TURN], meetings[c, TURN + 1], meetings[c, TURN + 2]
    r3, r4, r5 = meetings[c, TURN + 3], meetings[c, TURN + 4], meetings[c, TURN + 5]
    r6, r7, r8 = meetings[c, TURN + 6], meetings[c, TURN + 7], meetings[c, TURN + 8]
    sizes = (meetings[c, SIZE], meetings[c, SIZE + 1], meetings[c, SIZE + 2])
    x, y, z = r0 * x + r3 * y + r6 * z, r1 * x + r4 * y + r7 * z, r2 * x + r5 * y + r8 * z
    run = (runs[c, 0], runs[c, 1])
    d, a, b, e = signed_distance(kind, sizes, planes, run, x, y, z, least)
    return d, r0 * a + r1 * b + r2 * e, r3 * a + r4 * b + r5 * e, r6 * a + r7 * b + r8 * e


@numba.njit(cache=True, error_model="numpy", inline="always")
def distance(s, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return what `distance_in` does for a shape of some, in single precision."""
    return distance_in(s.meetings, c, s.kinds[c], s.planes, s.runs, x, y, z, LEAST)


@numba.njit(cache=True, error_model="numpy")
def find_pairs(x, skin, shapes, reach, pairs) -> int:  # type: ignore[no-untyped-def]
    """Write (particle, shape) for each particle of the skin within `reach` [m]; return how many."""
    shapes = Shapes(*shapes)
    count, moving = 0, shapes.meetings
    for c in range(moving.shape[0]):
        square = moving[c, SLIDE] ** 2 + moving[c, SLIDE + 1] ** 2 + moving[c, SLIDE + 2] ** 2
        speed = np.sqrt(square)
        for i in skin:
            if x[i, 3] <= _ZERO or count >= pairs.shape[0]:
                continue
            d, _, _, _ = distance(shapes, c, x[i, 0], x[i, 1], x[i, 2])
            if d < reach * (_ONE + speed):
                pairs[count, 0], pairs[count, 1] = i, c
                count += 1
    return count


@numba.njit(cache=True, error_model="numpy")
def move_meetings(meetings, dt) -> None:  # type: ignore[no-untyped-def]
    """Move the shapes on by `dt` [s]."""
    for c in range(meetings.shape[0]):
        row = meetings[c]
        wx, wy, wz = row[SPIN] * dt, row[SPIN + 1] * dt, row[SPIN + 2] * dt
        for a in range(3):
            row[PLACE + a] += row[SLIDE + a] * dt
        half = np.float32(0.5)
        for b in range(3):  # each axis a of the shape: a + w x a + w x (w x a) / 2
            ax, ay, az = row[TURN + b], row[TURN + 3 + b], row[TURN + 6 + b]
            ux, uy, uz = wy * az - wz * ay, wz * ax - wx * az, wx * ay - wy * ax
            row[TURN + b] = ax + ux + half * (wy * uz - wz * uy)
            row[TURN + 3 + b] = ay + uy + half * (wz * ux - wx * uz)
            row[TURN + 6 + b] = az + uz + half * (wx * uy - wy * ux)


@numba.njit(cache=True, error_model="numpy")
def solve_contacts(x, previous, pairs, count, shapes, dt, surface) -> None:  # type: ignore[no-untyped-def]
    """Push particles out of the shapes and hold them back by friction.

    A shape with flesh that is not simulated pushes as an elastic foundation: in proportion to the depth
    [m], the area of the skin around the particle [m²] and its stiffness [Pa/m].

    A particle slides on a shape if it would have to be held by more than the friction coefficient
    times what pushes it out (Coulomb), as positions: M. Müller et al., "Detailed Rigid Body Simulation
    with Extended Position Based Dynamics" (SCA 2020), equation 27.
    """
    shapes = Shapes(*shapes)
    (_, areas, touch, normals), softness = surface, shapes.foundations
    for p in range(count):
        touch[pairs[p, 0]] = 0
    for p in range(count):
        i, c = pairs[p, 0], pairs[p, 1]
        row = shapes.meetings[c]
        d, nx, ny, nz = distance(shapes, c, x[i, 0], x[i, 1], x[i, 2])
        if d >= _ZERO:
            continue
        if softness[c] > _ZERO:
            d *= x[i, 3] / (x[i, 3] + _ONE / (softness[c] * areas[i] * dt * dt))
        add(x, i, 0, -d * nx, -d * ny, -d * nz)
        touch[i] = c + 1
        normals[i, 0], normals[i, 1], normals[i, 2] = nx, ny, nz
        rx, ry, rz = x[i, 0] - row[PLACE], x[i, 1] - row[PLACE + 1], x[i, 2] - row[PLACE + 2]
        sx = x[i, 0] - previous[i, 0] - dt * (row[SLIDE] + row[SPIN + 1] * rz - row[SPIN + 2] * ry)
        sy = x[i, 1] - previous[i, 1] - dt * (row[SLIDE + 1] + row[SPIN + 2] * rx - row[SPIN] * rz)
        sz = x[i, 2] - previous[i, 2] - dt * (row[SLIDE + 2] + row[SPIN] * ry - row[SPIN + 1] * rx)
        along = sx * nx + sy * ny + sz * nz
        if along > _ZERO:  # it was inside before: coming out must not become speed
            add(previous, i, 0, along * nx, along * ny, along * nz)
        sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
        slip = np.sqrt(sx * sx + sy * sy + sz * sz) + LEAST
        held = min(_ONE, -d * row[GRIP] / slip)
        add(x, i, 0, -held * sx, -held * sy, -held * sz)


@numba.njit(cache=True, error_model="numpy")
def least_gap(x, skin, shapes, c):  # type: ignore[no-untyped-def]
    """Return the least distance of the skin's particles from shape `c` [m]."""
    best = np.float32(1e9)
    for i in skin:
        d, _, _, _ = distance(shapes, c, x[i, 0], x[i, 1], x[i, 2])
        best = min(best, d)
    return best


@numba.njit(cache=True, error_model="numpy")
def widen(x, shapes, inner, outer, active) -> bool:  # type: ignore[no-untyped-def]
    """Make all particles within `outer` [m] of a shape active if one within `inner` is not.

    Returns:
        Whether any became active.
    """
    shapes, changed = Shapes(*shapes), False
    for c in range(shapes.meetings.shape[0]):
        lacks = False
        for i in range(active.shape[0]):
            if not active[i] and not lacks:
                d, _, _, _ = distance(shapes, c, x[i, 0], x[i, 1], x[i, 2])
                lacks = d < inner
        if lacks:
            changed = True
            for i in range(active.shape[0]):
                d, _, _, _ = distance(shapes, c, x[i, 0], x[i, 1], x[i, 2])
                if d < outer:
                    active[i] = True
    return changed
