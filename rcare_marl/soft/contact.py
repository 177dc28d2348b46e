"""Contact of particles with rigid shapes: signed distance, projection out of the shape, friction."""

from __future__ import annotations

import numba
import numpy as np

SPHERE, BOX, CAPSULE, CYLINDER, HULL = range(5)

_ZERO, _ONE = np.float32(0), np.float32(1)
_LEAST = np.float32(1e-9)


@numba.njit(cache=True, error_model="numpy")
def _box_distance(x, y, z, size):  # type: ignore[no-untyped-def]
    ox, oy, oz = abs(x) - size[0], abs(y) - size[1], abs(z) - size[2]
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


@numba.njit(cache=True, error_model="numpy")
def _cylinder_distance(x, y, z, half, radius):  # type: ignore[no-untyped-def]
    across = np.sqrt(x * x + y * y) + _LEAST
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
def _hull_distance(x, y, z, planes, first, last):  # type: ignore[no-untyped-def]
    """Exact inside; outside it is the distance from the furthest plane, which is never too long."""
    best, face = planes[first, 0] * x + planes[first, 1] * y + planes[first, 2] * z, first
    best -= planes[first, 3]
    for k in range(first + 1, last):
        d = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z - planes[k, 3]
        if d > best:
            best, face = d, k
    return best, planes[face, 0], planes[face, 1], planes[face, 2]


@numba.njit(cache=True, error_model="numpy")
def signed_distance(kind, size, planes, run, x, y, z):  # type: ignore[no-untyped-def]
    """Return how far a point is from a shape's surface [m], negative inside, and the way out.

    Args:
        kind: One of the constants above.
        size: Sphere: radius; box: three half edges; capsule, cylinder: half length, radius [m].
        planes: Of all hulls: unit normal and distance from the origin, shape [p, 4].
        run: First and last plus one of the planes of this hull.
        x: Point in the frame of the shape [m].
        y: Its second coordinate.
        z: Its third coordinate.
    """
    if kind == BOX:
        return _box_distance(x, y, z, size)
    if kind == CYLINDER:
        return _cylinder_distance(x, y, z, size[0], size[1])
    if kind == HULL:
        return _hull_distance(x, y, z, planes, run[0], run[1])
    radius = size[0]
    if kind == CAPSULE:
        radius = size[1]
        z -= min(max(z, -size[0]), size[0])
    length = np.sqrt(x * x + y * y + z * z) + _LEAST
    return length - radius, x / length, y / length, z / length


# Columns of the table of shapes as one body meets them, in its own frame.
PLACE, TURN, SLIDE, SPIN, GRIP = 0, 3, 12, 15, 18  # position, rotation, velocities, friction
SIZE = 19
MEETING = 22


@numba.njit(cache=True, error_model="numpy")
def distance_to(row, kind, planes, run, x, y, z):  # type: ignore[no-untyped-def]
    """Return signed distance [m] and way out, both in the frame of the body."""
    x, y, z = x - row[PLACE], y - row[PLACE + 1], z - row[PLACE + 2]
    d, a, b, c = signed_distance(
        kind,
        row[SIZE:],
        planes,
        run,
        row[TURN] * x + row[TURN + 3] * y + row[TURN + 6] * z,
        row[TURN + 1] * x + row[TURN + 4] * y + row[TURN + 7] * z,
        row[TURN + 2] * x + row[TURN + 5] * y + row[TURN + 8] * z,
    )
    return (
        d,
        row[TURN] * a + row[TURN + 1] * b + row[TURN + 2] * c,
        row[TURN + 3] * a + row[TURN + 4] * b + row[TURN + 5] * c,
        row[TURN + 6] * a + row[TURN + 7] * b + row[TURN + 8] * c,
    )


@numba.njit(cache=True, error_model="numpy")
def find_pairs(x, skin, meetings, kinds, planes, runs, reach, pairs) -> int:  # type: ignore[no-untyped-def]
    """Write (particle, shape) for each particle of the skin within `reach` [m]; return how many."""
    count = 0
    for c in range(meetings.shape[0]):
        row = meetings[c]
        speed = np.sqrt(row[SLIDE] ** 2 + row[SLIDE + 1] ** 2 + row[SLIDE + 2] ** 2)
        for i in skin:
            if x[i, 3] <= _ZERO or count >= pairs.shape[0]:
                continue
            d, _, _, _ = distance_to(row, kinds[c], planes, runs[c], x[i, 0], x[i, 1], x[i, 2])
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
def solve_contacts(  # type: ignore[no-untyped-def]
    x, previous, pairs, count, meetings, kinds, planes, runs, dt, touch, normals, beds, areas
) -> None:
    """Push particles out of the shapes and hold them back by friction.

    A shape with flesh that is not simulated pushes as an elastic foundation: in proportion to the depth
    [m], the `areas` of the skin around the particle [m²] and its stiffness in `beds` [Pa/m]; where that
    is zero it is rigid.

    A particle slides on a shape if it would have to be held by more than the friction coefficient
    times what pushes it out (Coulomb), as positions: M. Müller et al., "Detailed Rigid Body Simulation
    with Extended Position Based Dynamics" (SCA 2020), equation 27.
    """
    for p in range(count):
        touch[pairs[p, 0]] = 0
    for p in range(count):
        i, c = pairs[p, 0], pairs[p, 1]
        row = meetings[c]
        d, nx, ny, nz = distance_to(row, kinds[c], planes, runs[c], x[i, 0], x[i, 1], x[i, 2])
        if d >= _ZERO:
            continue
        if beds[c] > _ZERO:
            d *= x[i, 3] / (x[i, 3] + _ONE / (beds[c] * areas[i] * dt * dt))
        x[i, 0] -= d * nx
        x[i, 1] -= d * ny
        x[i, 2] -= d * nz
        touch[i] = c + 1
        normals[i, 0], normals[i, 1], normals[i, 2] = nx, ny, nz
        rx, ry, rz = x[i, 0] - row[PLACE], x[i, 1] - row[PLACE + 1], x[i, 2] - row[PLACE + 2]
        sx = x[i, 0] - previous[i, 0] - dt * (row[SLIDE] + row[SPIN + 1] * rz - row[SPIN + 2] * ry)
        sy = x[i, 1] - previous[i, 1] - dt * (row[SLIDE + 1] + row[SPIN + 2] * rx - row[SPIN] * rz)
        sz = x[i, 2] - previous[i, 2] - dt * (row[SLIDE + 2] + row[SPIN] * ry - row[SPIN + 1] * rx)
        along = sx * nx + sy * ny + sz * nz
        if along > _ZERO:  # it was inside before: coming out must not become speed
            previous[i, 0] += along * nx
            previous[i, 1] += along * ny
            previous[i, 2] += along * nz
        sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
        slip = np.sqrt(sx * sx + sy * sy + sz * sz) + _LEAST
        held = min(_ONE, -d * row[GRIP] / slip)
        x[i, 0] -= held * sx
        x[i, 1] -= held * sy
        x[i, 2] -= held * sz


@numba.njit(cache=True, error_model="numpy")
def least_gap(x, skin, row, kind, planes, run):  # type: ignore[no-untyped-def]
    """Return the least distance of the skin's particles from a shape [m]."""
    best = np.float32(1e9)
    for i in skin:
        d, _, _, _ = distance_to(row, kind, planes, run, x[i, 0], x[i, 1], x[i, 2])
        best = min(best, d)
    return best


@numba.njit(cache=True, error_model="numpy")
def widen(x, meetings, kinds, planes, runs, inner, outer, active) -> bool:  # type: ignore[no-untyped-def]
    """Make all particles within `outer` [m] of a shape active if one within `inner` is not.

    Returns:
        Whether any became active.
    """
    changed = False
    for c in range(meetings.shape[0]):
        row, lacks = meetings[c], False
        for i in range(active.shape[0]):
            if not active[i] and not lacks:
                d, _, _, _ = distance_to(row, kinds[c], planes, runs[c], x[i, 0], x[i, 1], x[i, 2])
                lacks = d < inner
        if lacks:
            changed = True
            for i in range(active.shape[0]):
                d, _, _, _ = distance_to(row, kinds[c], planes, runs[c], x[i, 0], x[i, 1], x[i, 2])
                if d < outer:
                    active[i] = True
    return changed


__all__ = [
    "BOX",
    "CAPSULE",
    "CYLINDER",
    "GRIP",
    "HULL",
    "MEETING",
    "PLACE",
    "SIZE",
    "SLIDE",
    "SPHERE",
    "SPIN",
    "TURN",
    "distance_to",
    "find_pairs",
    "least_gap",
    "move_meetings",
    "signed_distance",
    "solve_contacts",
    "widen",
]
