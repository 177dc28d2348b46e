"""Surfaces that a muscle's path wraps round: cylinders and spheres fixed to a segment.

A wrap puts two spots into a path, both carried by the surface's segment: where the path touches the surface
and where it leaves. Between them it takes the geodesic, which is stationary: to first order a moment arm is
that of a path through two fixed points, and the arc adds nothing but its length. Where the straight line
clears the surface both spots are one point of that line.

The side of a cylinder is data: from origin to insertion the path turns about its axis by the right-hand
rule, and only so. It wraps by up to 315 degrees between the directions of its neighbours and never jumps to
the other side. A sphere is gone round the short way. Length and moment arm are continuous where contact
begins.

Where a surface makes room for a neighbour of its path, that neighbour feels a push along its distance, as a
derivative has it; `wrapped` returns it, and moment arms stay exact.
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
# A surface makes room for a point that comes nearer than `NEAR` radii: its radius falls smoothly, in the end
# to `CLEAR` of the point's distance, so that no posture puts a point inside.
NEAR, CLEAR = 1.25, 0.95
BLEND = 2.0 * (NEAR - 1.0 / CLEAR)
_BEND = 0.5 * CLEAR / BLEND
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


@numba.njit(cache=True, error_model="numpy")
def _room(distance):  # type: ignore[no-untyped-def]
    """Return the share of a radius that is left at a distance [radii], and its slope."""
    short = NEAR - distance
    if short <= 0.0:
        return 1.0, 0.0
    if short < BLEND:
        return 1.0 - _BEND * short * short, 2.0 * _BEND * short
    return CLEAR * distance, CLEAR


@numba.njit(cache=True, error_model="numpy")
def _round(dot, cross, p, s, radius):  # type: ignore[no-untyped-def]
    """Return where a way round a circle, counter-clockwise, touches and leaves it.

    Args:
        dot, cross: Products of both points.
        p, s: Their distances from the centre, squared.
        radius: Radius.

    Returns:
        Both spots, in axes towards the first point and left of it, per its distance; radius and angle of
        the arc, -1 where there is none; both tangents' lengths; and how fast the radius grows with the
        distance of either point, per that distance.
    """
    r, by_p, by_s = radius, 0.0, 0.0
    reach = NEAR * NEAR * radius * radius
    if p < reach or s < reach:
        far, away = math.sqrt(p), math.sqrt(s)
        (share, slope), (other, other_slope) = _room(far / radius), _room(away / radius)
        r = radius * share * other
        by_p, by_s = slope * other / far, other_slope * share / away
    if cross < 0.0:
        touches = dot < -cross
    else:  # the nearest point of the line lies between both, and inside
        touches = p > dot and s > dot and cross * cross < r * r * (p + s - 2.0 * dot)
    if not touches:
        return 0.0, 0.0, 0.0, 0.0, r, -1.0, 0.0, 0.0, 0.0, 0.0
    out, back = math.sqrt(p - r * r), math.sqrt(s - r * r)
    a0, a1 = r * r / p, r * out / p
    per = r / (s * p)
    b0, b1 = per * (r * dot + back * cross), per * (r * cross - back * dot)
    angle = math.atan2(a0 * b1 - a1 * b0, a0 * b0 + a1 * b1)
    if angle < 0.0:
        angle += 2.0 * math.pi
    return a0, a1, b0, b1, r, angle, out, back, by_p, by_s


@numba.njit(cache=True, error_model="numpy")
def wrapped(p0, p1, p2, s0, s1, s2, radius, is_cylinder):  # type: ignore[no-untyped-def]
    """Return both spots, and how much longer than their distance the way between them is [m].

    All in the frame of the surface: centre at the origin, axis along the last coordinate. Where the
    straight line clears the surface the difference is negative and the spots are not found. The last two
    figures are the push on either point [1/m], of its way from the axis or the centre.
    """
    if is_cylinder:
        dot, cross = p0 * s0 + p1 * s1, p0 * s1 - p1 * s0
        p, s = p0 * p0 + p1 * p1, s0 * s0 + s1 * s1
        a0, a1, b0, b1, r, angle, out, back, by_p, by_s = _round(dot, cross, p, s, radius)
        arc = r * angle
        plane = out + arc + back
        rise = (s2 - p2) / plane if angle >= 0.0 else 0.0
        t0, t1, u0, u1 = p0 * a0 - p1 * a1, p1 * a0 + p0 * a1, p0 * b0 - p1 * b1, p1 * b0 + p0 * b1
        t2, u2 = p2 + rise * out, s2 - rise * back
        climb = rise * rise * arc * arc
        way, push = math.sqrt(arc * arc + climb), angle / math.sqrt(1.0 + rise * rise)
    else:
        dot = p0 * s0 + p1 * s1 + p2 * s2
        p, s = p0 * p0 + p1 * p1 + p2 * p2, s0 * s0 + s1 * s1 + s2 * s2
        cross = math.sqrt(max(p * s - dot * dot, TINY * TINY))
        a0, a1, b0, b1, r, angle, out, back, by_p, by_s = _round(dot, cross, p, s, radius)
        # Left of the first point, of its length and in the plane of both.
        along, per = dot / cross, p / cross
        f0, f1, f2 = per * s0 - along * p0, per * s1 - along * p1, per * s2 - along * p2
        t0, t1, t2 = p0 * a0 + f0 * a1, p1 * a0 + f1 * a1, p2 * a0 + f2 * a1
        u0, u1, u2 = p0 * b0 + f0 * b1, p1 * b0 + f1 * b1, p2 * b0 + f2 * b1
        way, push = r * angle, angle
    extra = -1.0
    if angle >= 0.0:
        chord = math.sqrt((u0 - t0) ** 2 + (u1 - t1) ** 2 + (u2 - t2) ** 2)
        extra = max(way - chord, 0.0)
    return t0, t1, t2, u0, u1, u2, extra, push * by_p, push * by_s
