"""From a joint's rotation to the angles of its anatomical axes."""

from __future__ import annotations

import math

import numba
import numpy as np

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

from ..body.skeleton import DOFS_OF, JOINTS

_ALIGNED = 1e-6  # cosine of the middle angle below which the outer two axes count as aligned
_ROUNDS = 40  # of one axis after the other, where a joint has two: the error quarters each time
_OUTSIDE = 4.0  # what a radian outside the range counts beside a radian of jump: our own choice


def decompose(joint: str, rotations: Array, limits: Array | None = None) -> Array:
    """Return the angles of a joint's DoFs [rad], shape [t, n], whose rotation is nearest to the given.

    Three axes give every rotation exactly, in two ways: the one is taken that lies in the range and
    goes on from the frame before. One or two axes give the nearest rotation that there is.

    Args:
        joint: SMPL-X joint.
        rotations: Its local rotations over time, shape [t, 3, 3].
        limits: Range of each DoF [rad], shape [n, 2]; half a turn each way if None. Angles outside
            are not cut.

    Raises:
        UnknownNameError: If there is no such joint, or it is the pelvis, which has no DoF.
        ConfigError: If a matrix is no rotation.
    """
    check_name("joint with degrees of freedom", joint, JOINTS[1:])
    turns = np.ascontiguousarray(rotations, np.float64)
    if turns.ndim != 3 or turns.shape[1:] != (3, 3):
        raise ConfigError(f"rotations must have shape [t, 3, 3], got {turns.shape}")
    off = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
    if not off < 1e-4:
        raise ConfigError(f"the rotations of {joint} are no rotations: off by {off:.2g}")
    axes = np.array([dof.axis for dof in DOFS_OF[joint]])
    out = np.zeros((len(turns), len(axes)))
    if len(axes) == 3:
        bounds = np.tile((-math.pi, math.pi), (3, 1)) if limits is None else np.asarray(limits)
        _three(turns, axes, np.ascontiguousarray(bounds, np.float64), out)
    elif len(axes) == 2:
        _two(turns, axes, out)
    else:
        for t, turn in enumerate(turns):
            out[t, 0] = _about(turn, axes[0])
    return out


@numba.njit(cache=True)
def _about(turn, axis):  # type: ignore[no-untyped-def]
    """Return the angle about `axis` of the rotation nearest to `turn`: greatest trace of A(θ)ᵀ R."""
    along = 0.0
    for r in range(3):
        for c in range(3):
            along += axis[r] * turn[r, c] * axis[c]
    sine = (
        axis[0] * (turn[2, 1] - turn[1, 2])
        + axis[1] * (turn[0, 2] - turn[2, 0])
        + axis[2] * (turn[1, 0] - turn[0, 1])
    )
    return math.atan2(sine, turn[0, 0] + turn[1, 1] + turn[2, 2] - along)


@numba.njit(cache=True)
def _turn(axis, angle):  # type: ignore[no-untyped-def]
    x, y, z = axis
    s, c = math.sin(angle), math.cos(angle)
    k = 1 - c
    return np.array(
        (
            (c + k * x * x, k * x * y - s * z, k * x * z + s * y),
            (k * x * y + s * z, c + k * y * y, k * y * z - s * x),
            (k * x * z - s * y, k * y * z + s * x, c + k * z * z),
        )
    )


@numba.njit(cache=True)
def _two(turns, axes, out):  # type: ignore[no-untyped-def]
    a = b = 0.0
    for t in range(turns.shape[0]):
        for _ in range(_ROUNDS):
            a = _about(np.dot(turns[t], _turn(axes[1], -b)), axes[0])
            b = _about(np.dot(_turn(axes[0], -a), turns[t]), axes[1])
        out[t, 0], out[t, 1] = a, b


@numba.njit(cache=True)
def _three(turns, axes, limits, out):  # type: ignore[no-untyped-def]
    """Davenport angles about three orthogonal axes, of either handedness."""
    determinant = np.dot(axes[0], np.cross(axes[1], axes[2]))
    sign = 1.0 if determinant > 0 else -1.0  # a left-handed triple: all axes and angles reversed
    frame = np.empty((3, 3))
    for i in range(3):
        frame[:, i] = sign * axes[i]
    middle = 0.5 * (limits[:, 0] + limits[:, 1])
    last = np.minimum(np.maximum(np.zeros(3), limits[:, 0]), limits[:, 1])
    trial = np.empty((2, 3))
    for t in range(turns.shape[0]):
        m = np.dot(np.dot(frame.T, turns[t]), frame)
        b = math.asin(min(max(m[0, 2], -1.0), 1.0))
        if math.cos(b) > _ALIGNED:
            a, c = math.atan2(-m[1, 2], m[2, 2]), math.atan2(-m[0, 1], m[0, 0])
        else:  # only the sum or difference of the outer angles counts: keep the third
            c = sign * last[2]
            both = math.atan2(m[1, 0], m[1, 1])
            a = both - c if b > 0 else c - both
        trial[0] = sign * a, sign * b, sign * c
        trial[1] = sign * (a + math.pi), sign * (math.pi - b), sign * (c + math.pi)
        best = 1e300
        for k in range(2):
            cost = 0.0
            for i in range(3):
                turned = (trial[k, i] - middle[i] + math.pi) % (2 * math.pi)
                angle = middle[i] - math.pi + turned
                trial[k, i] = angle
                cost += _OUTSIDE * max(0.0, limits[i, 0] - angle, angle - limits[i, 1])
                cost += abs(angle - last[i])
            if cost < best:
                best = cost
                out[t] = trial[k]
        last = out[t]
