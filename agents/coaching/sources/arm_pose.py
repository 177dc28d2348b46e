"""The five angles of an arm from where its upper arm and forearm point.

Rotations of one frame are in plain numbers, which take a tenth of the time of arrays this short.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.pose import Array

from ..upper_body import HAND_IN_FOREARM, SIGN

STRAIGHT = math.radians(
    20
)  # of an elbow less bent the axial rotation cannot be told; our own choice


def trunk_axes(flexion: float, lateral: float, rotation: float) -> Array:
    """Return the axes of a trunk, as `upper_body.trunk_turn` does, shape [3, 3]."""
    cf, sf, cl, sl = math.cos(flexion), math.sin(flexion), math.cos(lateral), math.sin(lateral)
    cr, sr = math.cos(rotation), math.sin(rotation)
    return np.array(
        (
            (cf * cr - sf * sl * sr, -cf * sr - sf * sl * cr, sf * cl),
            (cl * sr, cl * cr, sl),
            (-sf * cr - cf * sl * sr, sf * sr - cf * sl * cr, cf * cl),
        )
    )


def swing_axes(side: str, elevation: float, plane: float) -> Array:
    """Return the axes of an arm that was swung up, as `upper_body.swing` does, shape [3, 3]."""
    sign = SIGN[side]
    c, s = math.cos(elevation), sign * math.sin(elevation)
    x, y = math.cos(plane), -sign * math.sin(plane)  # what it is swung about, level
    k = 1.0 - c
    return np.array(
        (
            (c + k * x * x, k * x * y, s * y),
            (k * x * y, c + k * y * y, -s * x),
            (-s * y, s * x, c),
        )
    )


def forearm_axes(side: str, rotation: float, elbow: float) -> Array:
    """Return the axes of a forearm against an arm that was swung up, shape [3, 3]."""
    cr, sr = math.cos(rotation), -SIGN[side] * math.sin(rotation)
    ce, se = math.cos(elbow), math.sin(elbow)
    return np.array(((cr * ce, -sr, -cr * se), (sr * ce, cr, -sr * se), (se, 0.0, ce)))


def axes_of(quaternion: Sequence[float]) -> Array:
    """Return the axes of a quaternion (x, y, z, w) of any length but 0, shape [3, 3]."""
    x, y, z, w = quaternion
    k = 2.0 / (x * x + y * y + z * z + w * w)
    return np.array(
        (
            (1 - k * (y * y + z * z), k * (x * y - z * w), k * (x * z + y * w)),
            (k * (x * y + z * w), 1 - k * (x * x + z * z), k * (y * z - x * w)),
            (k * (x * z - y * w), k * (y * z + x * w), 1 - k * (x * x + y * y)),
        )
    )


def arm_motion(
    side: str, upper: Array, fore: Array, hand: Array | None, *, rotation: float = 0.0
) -> tuple[float, float, float, float, float]:
    """Return elevation, plane, rotation, elbow flexion and pronation of an arm [rad].

    Args:
        side: `left` or `right`.
        upper: Where the upper arm points in the frame of the trunk, a unit vector [3].
        fore: Where the forearm points there, a unit vector [3].
        hand: Axes of the hand there, shape [3, 3]; the pronation is NaN without.
        rotation: Shoulder rotation to take where a nearly straight arm shows none [rad].
    """
    sign = SIGN[side]
    x, y, z = upper.tolist()
    elevation, plane = math.atan2(math.hypot(x, y), -z), math.atan2(x, sign * y)
    elbow = math.acos(min(max(float(upper @ fore), -1.0), 1.0))
    swung = swing_axes(side, elevation, plane)
    if elbow > STRAIGHT:
        gx, gy, _ = (fore @ swung).tolist()
        rotation = math.atan2(-sign * gy, gx)
    pronation = math.nan
    if hand is not None:
        forearm = swung @ forearm_axes(side, rotation, elbow)
        twist = forearm.T @ hand @ HAND_IN_FOREARM[side].T
        pronation = -sign * math.atan2(twist[1, 0] - twist[0, 1], twist[0, 0] + twist[1, 1])
    return elevation, plane, rotation, elbow, pronation
