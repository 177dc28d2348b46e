"""The five angles of an arm from where its upper arm and forearm point, and two-link kinematics."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..turn import forearm_axes, swing_axes
from ..upper_body import HAND_IN_FOREARM, SIGN

Array = npt.NDArray[np.float64]

STRAIGHT = math.radians(
    20
)  # of an elbow less bent the axial rotation cannot be told; our own choice


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


def elbow_at(wrist: Array, upper_arm: float, forearm: float, hint: Array) -> tuple[Array, Array]:
    """Return where upper arm and forearm point, unit vectors [3] each, that reach a wrist.

    A wrist out of reach is reached for with the arm straight.

    Args:
        wrist: From the shoulder [m], shape [3].
        upper_arm: Its length [m].
        forearm: Its length [m].
        hint: Roughly where the elbow is, from the shoulder [m], shape [3].
    """
    far = math.sqrt(float(wrist @ wrist))
    if far < 1e-6:
        return np.array((0.0, 0.0, -1.0)), np.array((0.0, 0.0, 1.0))
    along = wrist / far
    far = min(max(far, abs(upper_arm - forearm) + 1e-3), (upper_arm + forearm) * (1 - 1e-6))
    near = (upper_arm**2 - forearm**2 + far**2) / (2 * far)
    radius = math.sqrt(max(upper_arm**2 - near**2, 0.0))
    across = hint - (hint @ along) * along
    length = math.sqrt(float(across @ across))
    elbow = near * along + (radius / length if length > 1e-9 else 0.0) * across
    fore = far * along - elbow
    return elbow / math.sqrt(float(elbow @ elbow)), fore / math.sqrt(float(fore @ fore))
