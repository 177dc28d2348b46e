"""Rotational inertias: which ones a real body can have, and what to put in place of others."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.pose import Array, matrix_from_quaternion, quaternion_from_rpy

Inertia = tuple[float, float, float, float, float, float]

ROUNDING = 0.01  # share of the sum of the principal moments; files round to few digits
_MARGIN = 1e-6  # same share; Bullet drops an inertia that misses the triangle inequality by a hair
_THINNEST = 0.01  # [m], own choice: least edge of the box that stands for a link
_DENSITY = 1000.0  # [kg/m³], own choice: of the ball that stands for a link without shape


def matrix(inertia: Sequence[float]) -> Array:
    """Return ixx, ixy, ixz, iyy, iyz, izz as a matrix, shape [3, 3]."""
    xx, xy, xz, yy, yz, zz = inertia
    return np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))


def values(tensor: Array) -> Inertia:
    """Return ixx, ixy, ixz, iyy, iyz, izz of a matrix, shape [3, 3]."""
    xx, xy, xz, yy, yz, zz = (
        float(tensor[at]) for at in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    )
    return xx, xy, xz, yy, yz, zz


def turned(inertia: Sequence[float], rpy: Sequence[float]) -> Inertia:
    """Return an inertia, given along axes that are turned by `rpy` [rad], along the outer axes."""
    if not any(rpy):
        xx, xy, xz, yy, yz, zz = inertia
        return xx, xy, xz, yy, yz, zz
    turn = matrix_from_quaternion(quaternion_from_rpy(*rpy))
    return values(turn @ matrix(inertia) @ turn.T)


def fault(inertia: Sequence[float]) -> str:
    """Return why no rigid body has this inertia, within rounding; empty if one could have.

    The principal moments of a body are positive, and none exceeds the sum of the others.
    """
    low, middle, high = np.linalg.eigvalsh(matrix(inertia))
    if low <= 0 and (low < -ROUNDING * high or high <= 0 or middle <= 0):
        return f"principal moments {low:.3g}, {middle:.3g}, {high:.3g} kg·m² are not all positive"
    if high - low - middle > ROUNDING * (low + middle + high):
        return (
            f"principal moment {high:.3g} kg·m² exceeds the sum of the others, {low:.3g} and "
            f"{middle:.3g}"
        )
    return ""


def nearest(inertia: Sequence[float]) -> Inertia:
    """Return the inertia itself if a body can have it, else one close by that a body can have.

    A body can have it where the second moments of its mass, trace / 2 - inertia, are not negative:
    those that are become a millionth of the trace.
    """
    tensor = matrix(inertia)
    half = np.trace(tensor) / 2
    moments, axes = np.linalg.eigh(half * np.eye(3) - tensor)
    least = 2 * half * _MARGIN
    if moments[0] >= least:
        xx, xy, xz, yy, yz, zz = inertia
        return xx, xy, xz, yy, yz, zz
    moments = np.maximum(moments, least)
    return values(moments.sum() * np.eye(3) - axes * moments @ axes.T)


def of_box(mass: float, size: Sequence[float]) -> Inertia:
    """Return the inertia of a solid box of `mass` [kg] and edges `size` [m], shape [3]."""
    x, y, z = (max(edge, _THINNEST) ** 2 for edge in size)
    return (mass * (y + z) / 12, 0.0, 0.0, mass * (x + z) / 12, 0.0, mass * (x + y) / 12)


def of_ball(mass: float, radius: float | None = None) -> Inertia:
    """Return the inertia of a ball of `mass` [kg] and `radius` [m]; as dense as water if None."""
    if radius is None:
        radius = (3 * mass / (4 * math.pi * _DENSITY)) ** (1 / 3)
    moment = 0.4 * mass * radius**2
    return (moment, 0.0, 0.0, moment, 0.0, moment)
