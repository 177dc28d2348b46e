"""Friction along the directions and at the points that Bullet has."""

from __future__ import annotations

import numba
import numpy as np

from . import native
from .native import CONTACT_ROW, real, whole, word


@numba.njit(cache=True, error_model="numpy")
def place_frictions(places, rows, told, surfaces, trees, bearers, ways, velocities) -> None:  # type: ignore[no-untyped-def]
    """Let friction act along Bullet's directions, and on the surface of each body, not halfway.

    The directions count: Bullet takes what goes beyond the cone from each by what the body gives way
    there, so that what slides is pulled a little aside, and is not at rest after so few sweeps.
    Links of one tree that touch each other have it halfway.
    """
    kinds, speeds = told
    data = places[native.DATA]
    start = word(data + places[native.CONTACT])
    for i in range(whole(data + places[native.NCON], 1)[0]):
        here = start + i * places[native.CONTACT_SIZE]
        first = whole(here + places[native.EFC_ADDRESS], 1)[0]
        size = whole(here + places[native.DIM], 1)[0]
        if first < 0 or kinds[first] != CONTACT_ROW or size < 3:
            continue
        frame = real(here + places[native.FRAME], 9)
        cosine, sine = _turn_frame(frame)
        for row in range(first + 1, first + size, 3):  # the two of sliding, then the two of rolling
            _turn_rows(rows, speeds, row, cosine, sine)
        geoms = whole(here + places[native.GEOM], 2)
        one, other = geoms[0], geoms[1]
        if bearers[one] != bearers[other]:
            half = 0.5 * real(here + places[native.DIST], 1)[0]
            outs = half - surfaces[one, 3], half - surfaces[other, 3], bearers[other]
            _shift(rows, speeds, first, frame, outs, trees, ways, velocities)


@numba.njit(cache=True, error_model="numpy")
def _turn_frame(frame):  # type: ignore[no-untyped-def]
    """Turn the tangents of a contact to Bullet's; return cosine and sine of the angle."""
    x, y, z = frame[0], frame[1], frame[2]
    if abs(z) > np.sqrt(0.5):
        long = np.sqrt(y * y + z * z)
        along = (0.0, -z / long, y / long)
    else:
        long = np.sqrt(x * x + y * y)
        along = (-y / long, x / long, 0.0)
    cosine = sine = 0.0
    for k in range(3):
        cosine += along[k] * frame[3 + k]
        sine += along[k] * frame[6 + k]
    for k in range(3):
        one, other = frame[3 + k], frame[6 + k]
        frame[3 + k], frame[6 + k] = cosine * one + sine * other, cosine * other - sine * one
    return cosine, sine


@numba.njit(cache=True, error_model="numpy")
def _turn_rows(rows, speeds, row, cosine, sine) -> None:  # type: ignore[no-untyped-def]
    """Turn a row and the next, which are along the tangents of a contact."""
    sizes, starts, _, jacobian = rows
    for k in range(sizes[row]):
        at, beside = starts[row] + k, starts[row + 1] + k
        one, other = jacobian[at], jacobian[beside]
        jacobian[at], jacobian[beside] = cosine * one + sine * other, cosine * other - sine * one
    one, other = speeds[row], speeds[row + 1]
    speeds[row], speeds[row + 1] = cosine * one + sine * other, cosine * other - sine * one


@numba.njit(cache=True, error_model="numpy")
def _shift(rows, speeds, first, frame, outs, trees, ways, velocities) -> None:  # type: ignore[no-untyped-def]
    """Let the friction of a contact act beyond its middle: `outs` on each body [m]; and the second's tree."""
    sizes, starts, columns, jacobian = rows
    a, b, c = _cross(frame, 3)
    x, y, z = _cross(frame, 6)
    for k in range(sizes[first]):  # the same degrees of freedom in each row
        dof = columns[starts[first] + k]
        # (turn x way of the point) . side; of one it is the other way, and counts negatively.
        out = outs[1] if trees[dof] == outs[2] else outs[0]
        turn, speed = ways[dof], velocities[dof]
        change = out * (turn[0] * a + turn[1] * b + turn[2] * c)
        jacobian[starts[first + 1] + k] += change
        speeds[first + 1] += change * speed
        change = out * (turn[0] * x + turn[1] * y + turn[2] * z)
        jacobian[starts[first + 2] + k] += change
        speeds[first + 2] += change * speed


@numba.njit(cache=True, error_model="numpy", inline="always")
def _cross(frame, at):  # type: ignore[no-untyped-def]
    """Return normal x the tangent that begins at a place of the frame of a contact."""
    return (
        frame[1] * frame[at + 2] - frame[2] * frame[at + 1],
        frame[2] * frame[at] - frame[0] * frame[at + 2],
        frame[0] * frame[at + 1] - frame[1] * frame[at],
    )
