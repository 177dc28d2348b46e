"""What recognition looks at in a frame: directions of arms, head and trunk, which have no jumps."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.pose import Array

from ..upper_body import FOREARM, UPPER_ARM

# Seven vectors in the frame of the trunk (the trunk's own: in that of the hips), then three angles [rad].
VECTORS = ("left_arm", "right_arm", "head", "crown", "trunk", "left_wrist", "right_wrist")
ANGLES = ("left_elbow", "right_elbow", "trunk_rotation")
COLUMN = {name: slice(3 * i, 3 * i + 3) for i, name in enumerate(VECTORS)}
ANGLE_COLUMN = {name: 3 * len(VECTORS) + i for i, name in enumerate(ANGLES)}
SIZE = 3 * len(VECTORS) + len(ANGLES)
NEARLY_STRAIGHT, CLEARLY_BENT = math.radians(60), math.radians(90)  # of elbows; our own choice
_UPPER_SHARE = UPPER_ARM / (UPPER_ARM + FOREARM)


def feature(angles: Array) -> Array:
    """Return the features of one frame, shape [24]; NaN where they are unknown.

    Head and trunk are unit vectors as of `upper_body.directions`. So are arms, but an arm that is nearly
    straight points to its wrist: a source that takes an arm for too long sees it bent, and its upper arm
    elsewhere, but knows where the wrist is. A wrist is where it is from its shoulder, as a share of the arm.

    Args:
        angles: Angles of `MOTIONS` [rad], shape [16].
    """
    a = angles.tolist()  # in plain numbers: arrays this short take ten times as long
    left, left_wrist = _arm(1.0, *a[6:10])
    right, right_wrist = _arm(-1.0, *a[11:15])
    flexion, lateral = a[0], a[1]
    trunk = (
        math.sin(flexion) * math.cos(lateral),
        math.sin(lateral),
        math.cos(flexion) * math.cos(lateral),
    )
    nose, crown = _head(a[3], a[4], a[5])
    angle = (a[9], a[14], a[2])
    return np.array((*left, *right, *nose, *crown, *trunk, *left_wrist, *right_wrist, *angle))


_Vector = tuple[float, float, float]


def _arm(
    sign: float, elevation: float, plane: float, rotation: float, elbow: float
) -> tuple[_Vector, _Vector]:
    """Return where the arm points, and where its wrist is as a share of the arm's length."""
    ce, se, cp, sp = math.cos(elevation), math.sin(elevation), math.cos(plane), math.sin(plane)
    upper = (se * sp, sign * se * cp, -ce)
    # The forearm in the hanging arm, then swung up as in `upper_body.swing`.
    bend = math.sin(elbow)
    fx, fy, fz = bend * math.cos(rotation), -sign * bend * math.sin(rotation), -math.cos(elbow)
    px, py = fx * cp - sign * fy * sp, sign * fx * sp + fy * cp
    qy, qz = ce * py - sign * se * fz, sign * se * py + ce * fz
    fore = (px * cp + sign * qy * sp, -sign * px * sp + qy * cp, qz)
    share = _UPPER_SHARE
    x, y, z = (share * u + (1 - share) * f for u, f in zip(upper, fore, strict=True))
    bent = (elbow - NEARLY_STRAIGHT) / (CLEARLY_BENT - NEARLY_STRAIGHT)
    if bent >= 1.0 or not math.isfinite(x):  # a source may not know the forearm
        return upper, (x, y, z)
    bent, length = max(bent, 0.0), math.sqrt(x * x + y * y + z * z)
    points = [bent * u + (1 - bent) * w / length for u, w in zip(upper, (x, y, z), strict=True)]
    size = math.sqrt(sum(value * value for value in points))
    return (points[0] / size, points[1] / size, points[2] / size), (x, y, z)


def _head(flexion: float, lateral: float, rotation: float) -> tuple[_Vector, _Vector]:
    """Return where the nose and the top of the head point."""
    cf, sf, cr, sr = math.cos(flexion), math.sin(flexion), math.cos(rotation), math.sin(rotation)
    cl, sl = math.cos(lateral), math.sin(lateral)
    nose = (cr * cf, sr * cf, -sf)
    crown = (cr * sf * cl - sr * sl, sr * sf * cl + cr * sl, cf * cl)
    return nose, crown


def features(angles: Array) -> Array:
    """Return the features of frames of angles [n, 16], shape [n, 24]."""
    return np.array([feature(row) for row in angles])
