"""Muscle paths as kernels: from the frames of a person's parts to lengths, rates and moment arms.

A path is straight between its spots; spots on surfaces and pulleys follow their neighbours. Its pull is a
wrench through each segment, so that a moment arm needs no derivative of where a spot is. Work goes over
all spots at once, and not muscle by muscle: the loop over segments then runs in vectors.
"""

from __future__ import annotations

import math

import numba

from rcare_marl.tree.dynamics import AXIS_NOW

from ..body.scapula import turn_scapula
from .muscle_layout import (
    ARM,
    ARM_BEFORE,
    AWAY,
    BLADE_ROWS,
    COLLAR,
    COLLAR_TURN,
    FIRST_DOF,
    FIRST_ROW,
    HUMERUS,
    RADIUS,
    SECOND_DOF,
    SHAFT,
    SHOULDER,
    SIDE,
)
from .muscle_wrap import CENTRE, IS_CYLINDER, TURN, WRAP_RADIUS, wrapped

LENGTH, RATE = 2, 3  # rows of the state of the units, see `muscle_kernel.py`

# Columns of the frames, one row a part after one for the pelvis: rotation, origin, axis, origin x axis.
_ORIGIN, _AXIS, _SWEEP = 9, 12, 15
FRAME_COLUMNS = 18

# Rows of the spots: where each is, the direction from the one before, and how far that is.
X, _U, SPAN = 0, 3, 6
SPOT_ROWS = 7
WRENCH_COLUMNS = 6  # moment about the pelvis and force
# Columns of the pulleys' scratch: arm as the part carries it, direction between both arms, radius by length,
# radius.
_ARM_NOW, _MIDDLE, _LEVER, _RADIUS = 0, 3, 6, 7
# Columns of the surfaces' scratch: push on the point before and on that after, what the arc is longer.
_PUSH, _OTHER, _EXTRA = 0, 3, 6
LINK_COLUMNS = 8  # of both
BLADE_ROOM = (2, 3, 3)  # shape of the scratch of a scapula


@numba.njit(cache=True, error_model="numpy")
def gather_frames(muscles) -> None:  # type: ignore[no-untyped-def]
    """Write the frames of all parts close together; the row of the pelvis is never written."""
    work, frames = muscles.work, muscles.frames
    for i in range(work.shape[0]):
        for a in range(12):
            frames[i + 1, a] = work[i, a]
        for a in range(3):
            frames[i + 1, _AXIS + a] = work[i, AXIS_NOW + a]
        _sweep(frames[i + 1])
    for s in range(muscles.scapulae.shape[0]):
        _place_scapula(muscles.scapulae[s], muscles.blades[s], frames, muscles.blade_work)


@numba.njit(cache=True, error_model="numpy", inline="always")
def _sweep(frame) -> None:  # type: ignore[no-untyped-def]
    """Write how the pelvis' origin would move, turned about an axis at unit rate."""
    x, y, z = frame[_ORIGIN], frame[_ORIGIN + 1], frame[_ORIGIN + 2]
    frame[_SWEEP] = y * frame[_AXIS + 2] - z * frame[_AXIS + 1]
    frame[_SWEEP + 1] = z * frame[_AXIS] - x * frame[_AXIS + 2]
    frame[_SWEEP + 2] = x * frame[_AXIS + 1] - y * frame[_AXIS]


@numba.njit(cache=True, error_model="numpy")
def _place_scapula(rows, blade, frames, room) -> None:  # type: ignore[no-untyped-def]
    """Write the frame of a shoulder blade, and the axes about which DoFs turn it and turn against it."""
    collar, humerus, first = frames[rows[COLLAR]], frames[rows[HUMERUS]], rows[FIRST_ROW]
    turn, spin = room[0], room[1]
    base = _collar_columns(collar, blade)
    x0, x1, x2 = _rotated(humerus, blade[SHAFT], blade[SHAFT + 1], blade[SHAFT + 2])
    c0, c1, c2 = _rotated(humerus, blade[SHOULDER], blade[SHOULDER + 1], blade[SHOULDER + 2])
    c0, c1, c2 = c0 + humerus[_ORIGIN], c1 + humerus[_ORIGIN + 1], c2 + humerus[_ORIGIN + 2]
    d0, d1, d2 = _back(base, x0, x1, x2)
    turn_scapula(rows[SIDE], d0, d1, d2, turn, spin)
    for b in range(3):
        y0, y1, y2 = _ahead(base, turn[0, b], turn[1, b], turn[2, b])
        frames[first, b], frames[first, 3 + b], frames[first, 6 + b] = y0, y1, y2
    b0, b1, b2 = _ahead(base, blade[AWAY], blade[AWAY + 1], blade[AWAY + 2])
    for k in range(BLADE_ROWS):
        frames[first + k, _ORIGIN] = c0 + b0
        frames[first + k, _ORIGIN + 1] = c1 + b1
        frames[first + k, _ORIGIN + 2] = c2 + b2
    for k in range(2):
        dof = rows[FIRST_DOF] if k == 0 else rows[SECOND_DOF]
        if dof == 0:
            continue
        a0, a1, a2 = frames[dof, _AXIS], frames[dof, _AXIS + 1], frames[dof, _AXIS + 2]
        v0, v1, v2 = _back(base, a1 * x2 - a2 * x1, a2 * x0 - a0 * x2, a0 * x1 - a1 * x0)
        w0, w1, w2 = _ahead(
            base,
            spin[0, 0] * v0 + spin[0, 1] * v1 + spin[0, 2] * v2,
            spin[1, 0] * v0 + spin[1, 1] * v1 + spin[1, 2] * v2,
            spin[2, 0] * v0 + spin[2, 1] * v1 + spin[2, 2] * v2,
        )
        frames[first + k, _AXIS] = w0
        frames[first + k, _AXIS + 1] = w1
        frames[first + k, _AXIS + 2] = w2
        _sweep(frames[first + k])
        for a in range(_AXIS, _SWEEP + 3):
            frames[first + 2 + k, a] = frames[dof, a] - frames[first + k, a]


@numba.njit(cache=True, error_model="numpy", inline="always")
def _rotated(frame, x, y, z):  # type: ignore[no-untyped-def]
    """Return a vector of a frame in that of the pelvis."""
    return (
        frame[0] * x + frame[1] * y + frame[2] * z,
        frame[3] * x + frame[4] * y + frame[5] * z,
        frame[6] * x + frame[7] * y + frame[8] * z,
    )


@numba.njit(cache=True, error_model="numpy")
def _collar_columns(part, blade):  # type: ignore[no-untyped-def]
    """Return the columns of the rotation of the collar."""
    m = blade[COLLAR_TURN : COLLAR_TURN + 9]
    a, b, c = (
        _rotated(part, m[0], m[3], m[6]),
        _rotated(part, m[1], m[4], m[7]),
        _rotated(part, m[2], m[5], m[8]),
    )
    return a, b, c


@numba.njit(cache=True, error_model="numpy", inline="always")
def _ahead(columns, x, y, z):  # type: ignore[no-untyped-def]
    a, b, c = columns
    return (
        a[0] * x + b[0] * y + c[0] * z,
        a[1] * x + b[1] * y + c[1] * z,
        a[2] * x + b[2] * y + c[2] * z,
    )


@numba.njit(cache=True, error_model="numpy", inline="always")
def _back(columns, x, y, z):  # type: ignore[no-untyped-def]
    a, b, c = columns
    return (
        a[0] * x + a[1] * y + a[2] * z,
        b[0] * x + b[1] * y + b[2] * z,
        c[0] * x + c[1] * y + c[2] * z,
    )


@numba.njit(cache=True, error_model="numpy", inline="always")
def _turned(frames, row, x, y, z):  # type: ignore[no-untyped-def]
    """Return a vector of a part's frame in that of the pelvis."""
    return (
        frames[row, 0] * x + frames[row, 1] * y + frames[row, 2] * z,
        frames[row, 3] * x + frames[row, 4] * y + frames[row, 5] * z,
        frames[row, 6] * x + frames[row, 7] * y + frames[row, 8] * z,
    )


@numba.njit(cache=True, error_model="numpy")
def _place_points(points, rows, frames, spots) -> None:  # type: ignore[no-untyped-def]
    """Write where the points are that their parts carry; of pulleys, where the centres are."""
    for p in range(points.shape[0]):
        row = rows[p]
        x, y, z = _turned(frames, row, points[p, 0], points[p, 1], points[p, 2])
        spots[X, p] = x + frames[row, _ORIGIN]
        spots[X + 1, p] = y + frames[row, _ORIGIN + 1]
        spots[X + 2, p] = z + frames[row, _ORIGIN + 2]


@numba.njit(cache=True, error_model="numpy")
def _turn_pulleys(pulleys, places, frames, spots, links) -> None:  # type: ignore[no-untyped-def]
    """Move points from the centres of their pulleys to the rims."""
    for k in range(pulleys.shape[0]):
        p, row, before = places[k, 0], places[k, 1], places[k, 2]
        a0, a1, a2 = _turned(frames, row, pulleys[k, ARM], pulleys[k, ARM + 1], pulleys[k, ARM + 2])
        c0, c1, c2 = pulleys[k, ARM_BEFORE], pulleys[k, ARM_BEFORE + 1], pulleys[k, ARM_BEFORE + 2]
        b0, b1, b2 = _turned(frames, before, c0, c1, c2)
        links[k, _ARM_NOW], links[k, _ARM_NOW + 1], links[k, _ARM_NOW + 2] = a0, a1, a2
        b0, b1, b2 = a0 + b0, a1 + b1, a2 + b2
        norm = 1.0 / (math.sqrt(b0 * b0 + b1 * b1 + b2 * b2) + 1e-12)
        b0, b1, b2 = b0 * norm, b1 * norm, b2 * norm
        radius = pulleys[k, RADIUS]
        links[k, _MIDDLE], links[k, _MIDDLE + 1], links[k, _MIDDLE + 2] = b0, b1, b2
        links[k, _LEVER], links[k, _RADIUS] = radius * norm, radius
        spots[X, p] += radius * b0
        spots[X + 1, p] += radius * b1
        spots[X + 2, p] += radius * b2


@numba.njit(cache=True, error_model="numpy", inline="always")
def _on_surface(wraps, w, frames, row, spots, k):  # type: ignore[no-untyped-def]
    """Return a spot in the frame of a surface."""
    d0 = spots[X, k] - frames[row, _ORIGIN]
    d1 = spots[X + 1, k] - frames[row, _ORIGIN + 1]
    d2 = spots[X + 2, k] - frames[row, _ORIGIN + 2]
    x = frames[row, 0] * d0 + frames[row, 3] * d1 + frames[row, 6] * d2 - wraps[w, CENTRE]
    y = frames[row, 1] * d0 + frames[row, 4] * d1 + frames[row, 7] * d2 - wraps[w, CENTRE + 1]
    z = frames[row, 2] * d0 + frames[row, 5] * d1 + frames[row, 8] * d2 - wraps[w, CENTRE + 2]
    return (
        wraps[w, TURN] * x + wraps[w, TURN + 1] * y + wraps[w, TURN + 2] * z,
        wraps[w, TURN + 3] * x + wraps[w, TURN + 4] * y + wraps[w, TURN + 5] * z,
        wraps[w, TURN + 6] * x + wraps[w, TURN + 7] * y + wraps[w, TURN + 8] * z,
    )


@numba.njit(cache=True, error_model="numpy")
def _from_surface(wraps, w, frames, row, e0, e1, e2, is_spot):  # type: ignore[no-untyped-def]
    """Return a spot, or with `is_spot` 0 a direction, that is given in the frame of a surface."""
    x, y, z = _turned(
        frames,
        row,
        wraps[w, TURN] * e0
        + wraps[w, TURN + 3] * e1
        + wraps[w, TURN + 6] * e2
        + wraps[w, CENTRE] * is_spot,
        wraps[w, TURN + 1] * e0
        + wraps[w, TURN + 4] * e1
        + wraps[w, TURN + 7] * e2
        + wraps[w, CENTRE + 1] * is_spot,
        wraps[w, TURN + 2] * e0
        + wraps[w, TURN + 5] * e1
        + wraps[w, TURN + 8] * e2
        + wraps[w, CENTRE + 2] * is_spot,
    )
    return (
        x + frames[row, _ORIGIN] * is_spot,
        y + frames[row, _ORIGIN + 1] * is_spot,
        z + frames[row, _ORIGIN + 2] * is_spot,
    )


@numba.njit(cache=True, error_model="numpy")
def _wrap_round(wraps, places, frames, spots, links) -> None:  # type: ignore[no-untyped-def]
    """Write both spots on each surface, and how it pushes the points beside them."""
    for w in range(wraps.shape[0]):
        k, row = places[w, 0], places[w, 1]
        p0, p1, p2 = _on_surface(wraps, w, frames, row, spots, k - 1)
        s0, s1, s2 = _on_surface(wraps, w, frames, row, spots, k + 2)
        is_cylinder = wraps[w, IS_CYLINDER] > 0.5
        t0, t1, t2, u0, u1, u2, extra, push, other = wrapped(
            p0, p1, p2, s0, s1, s2, wraps[w, WRAP_RADIUS], is_cylinder
        )
        links[w, _EXTRA] = max(extra, 0.0)
        for a in range(6):
            links[w, a] = 0.0
        if extra < 0.0:
            for a in range(3):
                spots[a, k] = spots[a, k + 1] = 0.5 * (spots[a, k - 1] + spots[a, k + 2])
            continue
        spots[X, k], spots[X + 1, k], spots[X + 2, k] = _from_surface(
            wraps, w, frames, row, t0, t1, t2, 1.0
        )
        spots[X, k + 1], spots[X + 1, k + 1], spots[X + 2, k + 1] = _from_surface(
            wraps, w, frames, row, u0, u1, u2, 1.0
        )
        if push != 0.0 or other != 0.0:
            p2, s2 = (0.0, 0.0) if is_cylinder else (p2, s2)
            links[w, _PUSH], links[w, _PUSH + 1], links[w, _PUSH + 2] = _from_surface(
                wraps, w, frames, row, push * p0, push * p1, push * p2, 0.0
            )
            links[w, _OTHER], links[w, _OTHER + 1], links[w, _OTHER + 2] = _from_surface(
                wraps, w, frames, row, other * s0, other * s1, other * s2, 0.0
            )


@numba.njit(cache=True, error_model="numpy")
def _segments(x, y, z, u, v, w, spans) -> None:  # type: ignore[no-untyped-def]
    """Write the way to each spot from the one before, whether or not of one path."""
    for k in range(1, x.shape[0]):
        d0, d1, d2 = x[k] - x[k - 1], y[k] - y[k - 1], z[k] - z[k - 1]
        span = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        each = 1.0 / max(span, 1e-12)
        u[k], v[k], w[k], spans[k] = d0 * each, d1 * each, d2 * each, span


@numba.njit(cache=True, error_model="numpy")
def _push(places, links, spots) -> None:  # type: ignore[no-untyped-def]
    """Add arcs to lengths, and to the pulls on points beside a surface how it makes room for them."""
    for w in range(links.shape[0]):
        k = places[w, 0]
        spots[SPAN, k + 1] += links[w, _EXTRA]
        for a in range(3):
            spots[_U + a, k] -= links[w, _PUSH + a]
            spots[_U + a, k + 2] += links[w, _OTHER + a]


@numba.njit(cache=True, error_model="numpy")
def _pull(cuts, spots, wrenches) -> None:  # type: ignore[no-untyped-def]
    """Write the wrench of a unit pull through each segment that a joint cuts."""
    for c in range(cuts.shape[0]):
        k, at = cuts[c, 0], cuts[c, 1]
        x, y, z = spots[X, at], spots[X + 1, at], spots[X + 2, at]
        _write_wrench(wrenches[c], x, y, z, spots[_U, k], spots[_U + 1, k], spots[_U + 2, k])


@numba.njit(cache=True, error_model="numpy", inline="always")
def _write_wrench(wrench, x, y, z, u, v, w) -> None:  # type: ignore[no-untyped-def]
    """Write moment and force of a pull through a point."""
    wrench[0], wrench[1], wrench[2] = y * w - z * v, z * u - x * w, x * v - y * u
    wrench[3], wrench[4], wrench[5] = u, v, w


@numba.njit(cache=True, error_model="numpy")
def _pull_pulleys(places, links, spots, wrenches) -> None:  # type: ignore[no-untyped-def]
    """Write what each pulley's arm is pulled with, as a wrench."""
    for k in range(places.shape[0]):
        p, link, wrench = places[k, 0], links[k], wrenches[k]
        # The rim moves by lever (I - m mT) (axis x arm), and with the centre.
        into, on = places[k, 3], places[k, 4]
        f0 = into * spots[_U, p] - on * spots[_U, p + on]
        f1 = into * spots[_U + 1, p] - on * spots[_U + 1, p + on]
        f2 = into * spots[_U + 2, p] - on * spots[_U + 2, p + on]
        m0, m1, m2 = link[_MIDDLE], link[_MIDDLE + 1], link[_MIDDLE + 2]
        along, lever, radius = f0 * m0 + f1 * m1 + f2 * m2, link[_LEVER], link[_RADIUS]
        g0 = lever * (f0 - along * m0)
        g1 = lever * (f1 - along * m1)
        g2 = lever * (f2 - along * m2)
        x, y, z = (
            spots[X, p] - radius * m0,
            spots[X + 1, p] - radius * m1,
            spots[X + 2, p] - radius * m2,
        )
        _write_wrench(wrench, x, y, z, f0, f1, f2)
        a0, a1, a2 = link[_ARM_NOW], link[_ARM_NOW + 1], link[_ARM_NOW + 2]
        wrench[0] += a1 * g2 - a2 * g1
        wrench[1] += a2 * g0 - a0 * g2
        wrench[2] += a0 * g1 - a1 * g0


@numba.njit(cache=True, error_model="numpy")
def place_paths(muscles) -> None:  # type: ignore[no-untyped-def]
    """Write the spots of all paths and the wrenches of unit pulls, after `gather_frames`."""
    frames, spots, wrenches, cuts = muscles.frames, muscles.spots, muscles.wrenches, muscles.cuts
    pulleys, places, links = muscles.pulley_spots, muscles.wrap_spots, muscles.wrap_work
    _place_points(muscles.points, muscles.rows, frames, spots)
    _turn_pulleys(muscles.pulleys, pulleys, frames, spots, muscles.pulley_work)
    _wrap_round(muscles.wraps, places, frames, spots, links)
    _segments(spots[0], spots[1], spots[2], spots[3], spots[4], spots[5], spots[6])
    _push(places, links, spots)
    _pull(cuts, spots, wrenches)
    _pull_pulleys(pulleys, muscles.pulley_work, spots, wrenches[cuts.shape[0] :])


@numba.njit(cache=True, error_model="numpy")
def _project(entries, wrenches, frames, arms) -> None:  # type: ignore[no-untyped-def]
    """Write moment arms: a joint's screw times a path's wrench, both lines in space."""
    arms[:] = 0.0
    for e in range(entries.shape[0]):
        wrench, screw = wrenches[entries[e, 1]], frames[entries[e, 3]]
        power = (
            wrench[0] * screw[_AXIS] + wrench[1] * screw[_AXIS + 1] + wrench[2] * screw[_AXIS + 2]
        ) + (
            wrench[3] * screw[_SWEEP]
            + wrench[4] * screw[_SWEEP + 1]
            + wrench[5] * screw[_SWEEP + 2]
        )
        arms[entries[e, 0]] -= entries[e, 2] * power


@numba.njit(cache=True, error_model="numpy")
def find_arms(muscles, velocities, state) -> None:  # type: ignore[no-untyped-def]
    """Write the length and rate of each unit into `state`, and each crossing's moment arm."""
    place_paths(muscles)
    starts, crossed, arms = muscles.starts, muscles.crossed, muscles.arms
    _project(muscles.entries, muscles.wrenches, muscles.frames, arms)
    spans = muscles.spots[SPAN]
    for m in range(starts.shape[0] - 1):
        length = rate = 0.0
        for k in range(starts[m, 0] + 1, starts[m + 1, 0]):
            length += spans[k]
        for c in range(starts[m, 1], starts[m + 1, 1]):
            rate -= arms[c] * velocities[crossed[c]]
        state[LENGTH, m], state[RATE, m] = length, rate


def release_scapulae(muscles) -> None:  # type: ignore[no-untyped-def]
    """Find moment arms anew, after `find_arms`, as if shoulder blades did not follow arms."""
    frames, columns = muscles.frames, slice(_AXIS, _SWEEP + 3)
    for rows in muscles.scapulae:
        for k, dof in enumerate(rows[[FIRST_DOF, SECOND_DOF]]):
            blade = rows[FIRST_ROW] + k
            frames[blade, columns] = 0.0
            frames[blade + 2, columns] = frames[dof, columns]
    _project(muscles.entries, muscles.wrenches, frames, muscles.arms)
