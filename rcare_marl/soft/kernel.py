"""The loops over the particles of a soft body: motion, and what they did to the rigid bodies.

They are called one by one. In one function the compiler would inline the tetrahedra, and then no longer
see through their lanes: three times slower.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from .collider import turning
from .contact import note

# Columns of what a shape got from a body in a step: force [N], moment about the body's origin [N·m] and
# later a point of the line of action [m], then of the particles that it touches: middle [m], normal,
# count, load [N], area [m²].
FORCE, MOMENT, MIDDLE, NORMAL, COUNT, LOAD, AREA = 0, 3, 6, 9, 12, 13, 14
OUTCOME = 15

_ZERO = np.float32(0)


class Motion(NamedTuple):
    """The motion of a body's particles in a physics step.

    Attributes:
        x: Positions [m] and inverse masses [1/kg] in the frame of the body, shape [n + SPARE, 4].
        v: Velocities [m/s], shape [n, 3].
        previous: Scratch: positions before a small step [m], shape [n, 3].
        start: Velocities at the start of the step [m/s], shape [n, 3].
        forces: Elastic forces [N], shape [n + SPARE, 3].
    """

    x: npt.NDArray[np.float32]
    v: npt.NDArray[np.float32]
    previous: npt.NDArray[np.float32]
    start: npt.NDArray[np.float32]
    forces: npt.NDArray[np.float32]


@numba.njit(cache=True, error_model="numpy")
def predict(motion, dt) -> None:  # type: ignore[no-untyped-def]
    """Begin a small step of `dt` [s]: move particles on by their velocities."""
    x, v, previous, _, _ = motion
    for i in range(v.shape[0]):
        if x[i, 3] > _ZERO:
            for a in range(3):
                previous[i, a] = x[i, a]
                x[i, a] += dt * v[i, a]


@numba.njit(cache=True, error_model="numpy")
def finish(motion, keep, dt) -> None:  # type: ignore[no-untyped-def]
    """End a small step: find the velocities [m/s] from where particles came to, and damp them."""
    x, v, previous, _, _ = motion
    scale = keep / dt
    for i in range(v.shape[0]):
        if x[i, 3] > _ZERO:
            for a in range(3):
                v[i, a] = (x[i, a] - previous[i, a]) * scale


@numba.njit(cache=True)
def find_touching(motion, surface, outcome) -> int:  # type: ignore[no-untyped-def]
    """Write middle, normal, count, load and area of what each shape touches; return how many do."""
    (x, _, _, _, forces), (_, areas, touch, normals) = motion, surface
    outcome[:] = 0.0
    for i in range(touch.shape[0]):
        if touch[i]:
            row = outcome[touch[i] - 1]
            for a in range(3):
                row[MIDDLE + a] += x[i, a]
                row[NORMAL + a] += normals[i, a]
            row[COUNT] += 1
            row[AREA] += areas[i]
    touching = 0
    for c in range(outcome.shape[0]):
        row = outcome[c]
        if row[COUNT] > 0:
            touching += 1
            size = np.sqrt(row[NORMAL] ** 2 + row[NORMAL + 1] ** 2 + row[NORMAL + 2] ** 2) + 1e-12
            for a in range(3):
                row[MIDDLE + a] /= row[COUNT]
                row[NORMAL + a] /= size
    for i in range(touch.shape[0]):
        if touch[i]:
            row, push, along = outcome[touch[i] - 1], 0.0, 0.0
            for a in range(3):
                push -= forces[i, a] * normals[i, a]
                along += normals[i, a] * row[NORMAL + a]
            row[LOAD] += max(push, 0.0) * max(along, 0.0)
    return touching


@numba.njit(cache=True)
def share_out(motion, touch, damping, period, outcome) -> None:  # type: ignore[no-untyped-def]
    """Add up what the particles press on each shape with: force [N] and moment [N·m].

    What presses on a particle is what its elastic force and drag leave of its change of
    momentum. The sum over all free particles is what presses on the body. A particle that touches a
    shape counts for that shape; the rest, which one iteration a step has not brought to balance,
    counts for the nearest shape that is touched.
    """
    x, v, _, start, forces = motion
    for i in range(v.shape[0]):
        if x[i, 3] <= _ZERO:
            continue
        chosen = touch[i] - 1
        if chosen < 0:
            nearest = np.inf
            for c in range(outcome.shape[0]):
                if outcome[c, COUNT] > 0:
                    square = 0.0
                    for a in range(3):
                        square += (x[i, a] - outcome[c, MIDDLE + a]) ** 2
                    if square < nearest:
                        nearest, chosen = square, c
        mass = 1.0 / x[i, 3]
        fx = forces[i, 0] + mass * (-(v[i, 0] - start[i, 0]) / period - damping * v[i, 0])
        fy = forces[i, 1] + mass * (-(v[i, 1] - start[i, 1]) / period - damping * v[i, 1])
        fz = forces[i, 2] + mass * (-(v[i, 2] - start[i, 2]) / period - damping * v[i, 2])
        note(outcome, chosen, x[i, 0], x[i, 1], x[i, 2], fx, fy, fz)


@numba.njit(cache=True)
def spread_pressure(forces, surface, outcome, pressure) -> None:  # type: ignore[no-untyped-def]
    """Write the pressure on each particle [Pa], so that it adds up to the force on each shape.

    Single particles bear uneven shares, so pressure goes by the share of the elastic force.
    """
    _, areas, touch, normals = surface
    pressure[:] = _ZERO
    for i in range(touch.shape[0]):
        if touch[i] == 0 or areas[i] <= _ZERO:
            continue
        row, push, total = outcome[touch[i] - 1], 0.0, 0.0
        for a in range(3):
            push -= forces[i, a] * normals[i, a]
            total -= row[FORCE + a] * row[NORMAL + a]
        if push > 0 and total > 0 and row[LOAD] > 0:
            pressure[i] = push / areas[i] * total / row[LOAD]


@numba.njit(cache=True)
def smooth(outcome, shapes, last) -> None:  # type: ignore[no-untyped-def]
    """Average forces with those of the last step, which a light body answered with its motion.

    Args:
        outcome: Of each shape near, shape [m, OUTCOME].
        shapes: Which those are among all shapes, shape [m].
        last: Force and moment of all shapes in the last step, and whether they touched, shape [s, 7];
            brought up to date.
    """
    touched = last[:, 6].copy()
    last[:, 6] = 0.0
    for c in range(shapes.shape[0]):
        row, before = outcome[c], last[shapes[c]]
        if row[COUNT] == 0:
            continue
        for a in range(6):
            if touched[shapes[c]] > 0:
                row[a] = 0.5 * (row[a] + before[a])
            before[a] = row[a]
        before[6] = 1.0


@numba.njit(cache=True)
def to_world(outcome, frame) -> None:  # type: ignore[no-untyped-def]
    """Turn forces into the world and moments into points of the line of action in the world [m].

    What pulls is no contact: its count becomes zero.
    """
    turn = turning(frame[3:7])
    force, point = np.empty(3), np.empty(3)
    for c in range(outcome.shape[0]):
        row = outcome[c]
        push = 0.0
        for a in range(3):
            force[a] = row[FORCE + a]
            push -= force[a] * row[NORMAL + a]
        if row[COUNT] == 0 or push <= 0:
            row[COUNT] = 0.0
            continue
        line_point(force, row[MOMENT : MOMENT + 3], row[MIDDLE : MIDDLE + 3], point)
        for a in range(3):
            row[FORCE + a] = row[MOMENT + a] = 0.0
            for b in range(3):
                row[FORCE + a] += turn[3 * a + b] * force[b]
                row[MOMENT + a] += turn[3 * a + b] * point[b]
            row[MOMENT + a] += frame[a]


@numba.njit(cache=True)
def line_point(force, moment, near, out) -> None:  # type: ignore[no-untyped-def]
    """Write the point nearest to `near` on the line along which a force has a moment [m].

    What a moment has along the force itself no line can give; it is left out.
    """
    square = force[0] ** 2 + force[1] ** 2 + force[2] ** 2
    if square < 1e-18:
        out[0], out[1], out[2] = near[0], near[1], near[2]
        return
    along = (force[0] * near[0] + force[1] * near[1] + force[2] * near[2]) / square
    out[0] = (force[1] * moment[2] - force[2] * moment[1]) / square + force[0] * along
    out[1] = (force[2] * moment[0] - force[0] * moment[2]) / square + force[1] * along
    out[2] = (force[0] * moment[1] - force[1] * moment[0]) / square + force[2] * along


@numba.njit(cache=True)
def foresee(state, mass, inertia, push, gravity, period) -> None:  # type: ignore[no-untyped-def]
    """Add to the velocities of a free link what weight and a push will do to them in a step.

    Args:
        state: Of the link, see `collider`.
        mass: Of the link [kg].
        inertia: Its principal moments of inertia [kg·m²], shape [3].
        push: Force [N] and moment about its centre of mass [N·m] in the world, shape [6].
        gravity: In the world [m/s²], shape [3].
        period: Length of the step [s].
    """
    turn = turning(state[3:7])
    for a in range(3):
        state[7 + a] += period * (gravity[a] + push[a] / mass)
    for b in range(3):
        turned = turn[b] * push[3] + turn[3 + b] * push[4] + turn[6 + b] * push[5]
        for a in range(3):
            state[10 + a] += period * turn[3 * a + b] * turned / inertia[b]


@numba.njit(cache=True)
def answer(before, now, mass, push, gravity, period):  # type: ignore[no-untyped-def]
    """Return which share of the change of velocity that weight and push cause came about, in [0, 1].

    Args:
        before: State of a link a step ago.
        now: Its present state.
        mass: Of the link [kg].
        push: Force [N] and moment on it in that step, shape [6].
        gravity: In the world [m/s²], shape [3].
        period: Length of the step [s].
    """
    came, square = 0.0, 0.0
    for a in range(3):
        due = period * (gravity[a] + push[a] / mass)
        came += due * (now[7 + a] - before[7 + a])
        square += due * due
    if square < 1e-10:  # [m²/s²]: it is at rest, and nothing can be told
        return 1.0
    return min(max(came / square, 0.0), 1.0)


@numba.njit(cache=True)
def farthest_from(x, rest):  # type: ignore[no-untyped-def]
    """Return how far any particle is from its place at rest [m]."""
    worst = _ZERO
    for i in range(rest.shape[0]):
        dx, dy, dz = x[i, 0] - rest[i, 0], x[i, 1] - rest[i, 1], x[i, 2] - rest[i, 2]
        worst = max(worst, dx * dx + dy * dy + dz * dz)
    return np.sqrt(worst)
