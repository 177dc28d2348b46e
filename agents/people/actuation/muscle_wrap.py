"""Surfaces that a muscle's path wraps round: cylinders and spheres fixed to a segment.

A wrap puts two spots into a path, both carried by the surface's segment: where the path touches the surface
and where it leaves. Between them it takes the geodesic, which is stationary: to first order a moment arm is
that of a path through two fixed points, and the arc adds nothing but its length. Where the straight line
clears the surface both spots are one point of that line.

The side of a cylinder is data: from origin to insertion the path turns about its axis by the right-hand rule,
and only so. It wraps by up to 270 degrees between the directions of its neighbours and never jumps to the other
side. A sphere is gone round the short way. Length and moment arm are continuous where contact begins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numba
import numpy as np

from rcare_marl.pose import Array

Kind = Literal["cylinder", "sphere"]
KINDS: tuple[Kind, ...] = get_args(Kind)

# Columns of the table of wraps: the surface's frame in its part (rows; the axis is the last), its centre.
TURN, CENTRE, WRAP_RADIUS, IS_CYLINDER = 0, 9, 12, 13
WRAP_COLUMNS = 14
CLEAR = 0.999  # a point inside a surface shrinks it to this share of its distance
TINY = 1e-12  # [m]: keeps a path through the middle of a sphere from a division by zero


@dataclass(frozen=True)
class Surface:
    """A surface that a path wraps round.

    Attributes:
        kind: `cylinder`, of any length, or `sphere`.
        radius: Radius [m].
        axis: Of a cylinder, in T-pose axes: the path turns about it by the right-hand rule from origin to
            insertion. Its length does not matter; of a sphere neither does its direction.
    """

    kind: Kind
    radius: float
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)


def surface_frame(axis: Array) -> Array:
    """Return a right-handed frame whose last row is the direction of `axis`, shape [3, 3]."""
    last = axis / np.linalg.norm(axis)
    beside = np.eye(3)[int(np.argmin(np.abs(last)))]
    first = np.cross(beside, last)
    first /= np.linalg.norm(first)
    return np.array((first, np.cross(last, first), last))


@numba.njit(cache=True, error_model="numpy", inline="always")
def _round(p, s0, s1, radius):  # type: ignore[no-untyped-def]
    """Return tangent points round a circle, arc and both tangents' lengths; arc < 0: no contact.

    The first point is (p, 0) with p > 0, the second (s0, s1); the path turns counter-clockwise.
    """
    s = math.sqrt(s0 * s0 + s1 * s1)
    r = min(radius, CLEAR * p, CLEAR * s)
    out, back = math.sqrt(p * p - r * r), math.sqrt(s * s - r * r)
    per_p, per_s = 1.0 / p, 1.0 / (s * s)
    a0, a1 = r * r * per_p, r * out * per_p
    b0, b1 = r * (r * s0 + back * s1) * per_s, r * (r * s1 - back * s0) * per_s
    sine = a0 * b1 - a1 * b0
    if s1 < 0.0:
        touches = s0 < 0.0
    else:
        touches = sine > 0.0
    if not touches:
        return a0, a1, b0, b1, -1.0, out, back
    angle = math.atan2(sine, a0 * b0 + a1 * b1)
    if angle < 0.0:
        angle += 2.0 * math.pi
    return a0, a1, b0, b1, r * angle, out, back


@numba.njit(cache=True, error_model="numpy")
def wrapped(p0, p1, p2, s0, s1, s2, radius, is_cylinder):  # type: ignore[no-untyped-def]
    """Return both spots, and how much longer than their distance the way between them is [m].

    All in the frame of the surface: centre at the origin, axis along the last coordinate.
    """
    if is_cylinder:
        p, s = math.sqrt(p0 * p0 + p1 * p1), s0
        e0, e1 = p0 / p, p1 / p
        a0, a1, b0, b1, arc, out, back = _round(p, e0 * s + e1 * s1, e0 * s1 - e1 * s, radius)
        if arc >= 0.0:
            rise = (s2 - p2) / (out + arc + back)
            t0, t1, t2 = e0 * a0 - e1 * a1, e1 * a0 + e0 * a1, p2 + rise * out
            u0, u1, u2 = e0 * b0 - e1 * b1, e1 * b0 + e0 * b1, s2 - rise * back
            chord = (u0 - t0) ** 2 + (u1 - t1) ** 2
            climb = rise * rise * arc * arc
            return t0, t1, t2, u0, u1, u2, math.sqrt(arc * arc + climb) - math.sqrt(chord + climb)
    else:
        p = math.sqrt(p0 * p0 + p1 * p1 + p2 * p2)
        e0, e1, e2 = p0 / p, p1 / p, p2 / p
        along = e0 * s0 + e1 * s1 + e2 * s2
        f0, f1, f2 = s0 - along * e0, s1 - along * e1, s2 - along * e2
        beside = math.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
        each = 1.0 / max(beside, TINY)
        f0, f1, f2 = f0 * each, f1 * each, f2 * each
        a0, a1, b0, b1, arc, _, _ = _round(p, along, beside, radius)
        if arc >= 0.0:
            chord = math.sqrt((b0 - a0) ** 2 + (b1 - a1) ** 2)
            return (
                e0 * a0 + f0 * a1,
                e1 * a0 + f1 * a1,
                e2 * a0 + f2 * a1,
                e0 * b0 + f0 * b1,
                e1 * b0 + f1 * b1,
                e2 * b0 + f2 * b1,
                arc - chord,
            )
    m0, m1, m2 = 0.5 * (p0 + s0), 0.5 * (p1 + s1), 0.5 * (p2 + s2)
    return m0, m1, m2, m0, m1, m2, 0.0
