"""How an arm is bent whose shoulder and hand are seen: all that is likely, not one guess.

Between shoulder and wrist an elbow may be anywhere on a circle, and how far it is bent shows in a distance
that hardly changes while the arm is nearly straight. So a grid of flexions and swivels is weighed by what
is known of lengths, by where the hand points, and by how elbows hang; the mean is told, and how far the
rest spreads.
"""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.pose import Array

from ..upper_body import SIGN

FLEXIONS = np.radians(np.arange(0.0, 151.0, 10.0))
SWIVELS = np.radians(np.arange(0.0, 360.0, 20.0))
# All our own choice. Standard deviations: of a wrist that bends, and of how an elbow hangs [rad].
WRIST, HANGING = math.radians(22), math.radians(50)
# Elbows are kept nearly straight in exercises like these: mean and spread of how far they are bent else
# [rad].
USUAL, SPREAD = math.radians(15), math.radians(35)
_COSINE, _SINE = np.cos(SWIVELS), np.sin(SWIVELS)


def elbow_posterior(
    side: str, wrist: Array, upper_arm: float, forearm: float, hand: Array, unsure: float
) -> tuple[Array, Array, float]:
    """Return where upper arm and forearm point, unit vectors [3] each, and how unsure the bend is [rad].

    Args:
        side: `left` or `right`.
        wrist: From the shoulder, in the frame of the trunk [m], shape [3].
        upper_arm: Its length [m].
        forearm: Its length [m].
        hand: Where the fingers point there, a unit vector [3].
        unsure: Standard deviation of the distance from shoulder to wrist as a share of it: what is not known
            of lengths and of where the shoulder is.
    """
    far = math.sqrt(float(wrist @ wrist))
    if far < 1e-6:
        return np.array((0.0, 0.0, -1.0)), np.array((0.0, 0.0, 1.0)), math.pi / 2
    along = wrist / far
    reach = np.sqrt(upper_arm**2 + forearm**2 + 2 * upper_arm * forearm * np.cos(FLEXIONS))
    # A triangle of each flexion, as large as the distance that was seen.
    near = (upper_arm**2 - forearm**2 + reach**2) / (2 * reach) / upper_arm
    near = np.minimum(near, 1.0)
    out = np.sqrt(1.0 - near**2)
    fore_near = (reach - near * upper_arm) / forearm
    fore_out = out * upper_arm / forearm
    hanging = np.array((-0.2, 0.35 * SIGN[side], -0.9))
    first = hanging - (hanging @ along) * along
    size = math.sqrt(float(first @ first))
    first = first / size if size > 1e-3 else _across(along)
    x, y, z = along.tolist()
    fx, fy, fz = first.tolist()
    second = np.array((y * fz - z * fy, z * fx - x * fz, x * fy - y * fx))
    a, b, c = float(hand @ along), float(hand @ first), float(hand @ second)
    # Cosine between forearm and hand: forearm = fore_near along - fore_out (cos first + sin second).
    across = b * _COSINE + c * _SINE
    cosine = fore_near[:, None] * a - fore_out[:, None] * across
    wrist_bend = np.arccos(np.clip(cosine, -1.0, 1.0))
    log = -0.5 * (wrist_bend / WRIST) ** 2
    swivel = np.minimum(SWIVELS, 2 * math.pi - SWIVELS)
    log -= 0.5 * (swivel / HANGING)[None, :] ** 2 * min(size, 1.0)
    gap = (np.log(far / reach) / unsure) ** 2
    log -= 0.5 * (gap + ((FLEXIONS - USUAL) / SPREAD) ** 2)[:, None]
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    by_flexion = weight.sum(axis=1)
    flexion = float(by_flexion @ FLEXIONS)
    spread = math.sqrt(float(by_flexion @ (FLEXIONS - flexion) ** 2))
    # The elbow of the mean flexion, on the mean side.
    turned_x, turned_y = float((weight @ _COSINE) @ out), float((weight @ _SINE) @ out)
    turned = math.hypot(turned_x, turned_y)
    side_of = (turned_x * first + turned_y * second) / turned if turned > 1e-9 else first
    whole = math.sqrt(upper_arm**2 + forearm**2 + 2 * upper_arm * forearm * math.cos(flexion))
    cosine_at = min((upper_arm**2 - forearm**2 + whole**2) / (2 * whole) / upper_arm, 1.0)
    upper = cosine_at * along + math.sqrt(1.0 - cosine_at**2) * side_of
    fore = (whole * along - upper_arm * upper) / forearm
    return upper, fore / math.sqrt(float(fore @ fore)), spread


def _across(vector: Array) -> Array:
    """Return some unit vector at right angles to a unit vector [3]."""
    other = np.eye(3)[int(np.argmin(np.abs(vector)))]
    across = np.cross(vector, other)
    return np.asarray(across / np.linalg.norm(across))
