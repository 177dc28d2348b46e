"""Rigid poses and quaternions.

Quaternions are (x, y, z, w) with unit length; positions are in metres; angles in radians.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Vector = Sequence[float] | Array

IDENTITY = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Pose:
    """A rigid pose: position [m], shape [3], and quaternion (x, y, z, w), shape [4]."""

    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, ...] = IDENTITY

    def __post_init__(self) -> None:
        if len(self.position) != 3 or len(self.quaternion) != 4:
            raise ValueError(
                f"a pose has 3 position and 4 quaternion values, got {len(self.position)} and "
                f"{len(self.quaternion)}"
            )

    def __matmul__(self, other: "Pose") -> "Pose":
        """Return `other`, given in the frame of this pose, in the frame that this pose is given in."""
        x, y, z = self.position
        dx, dy, dz = _rotated(self.quaternion, other.position)
        return Pose(
            (float(x + dx), float(y + dy), float(z + dz)),
            _product(self.quaternion, other.quaternion),
        )

    def inverse(self) -> "Pose":
        """Return the pose of the reference frame in this pose's frame."""
        back = conjugate(self.quaternion)
        return Pose(tuple((-rotate(back, self.position)).tolist()), tuple(back.tolist()))

    def matrix(self) -> Array:
        """Return the homogeneous transform, shape [4, 4]."""
        out = np.eye(4)
        out[:3, :3] = matrix_from_quaternion(self.quaternion)
        out[:3, 3] = self.position
        return out


def multiply(a: Vector, b: Vector) -> Array:
    """Return the quaternion product `a b` (first rotate by `b`, then by `a`), shape [4]."""
    return np.array(_product(a, b))


def _product(a: Vector, b: Vector) -> tuple[float, float, float, float]:
    # In plain numbers: arrays this short take ten times as long.
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        float(aw * bx + ax * bw + ay * bz - az * by),
        float(aw * by - ax * bz + ay * bw + az * bx),
        float(aw * bz + ax * by - ay * bx + az * bw),
        float(aw * bw - ax * bx - ay * by - az * bz),
    )


def conjugate(q: Vector) -> Array:
    """Return the inverse rotation, shape [4]."""
    x, y, z, w = q
    return np.array((-x, -y, -z, w))


def rotate(q: Vector, v: Vector) -> Array:
    """Return the vector `v` turned by `q`, shape [3]."""
    return np.array(_rotated(q, v))


def _rotated(q: Vector, v: Vector) -> tuple[float, float, float]:
    x, y, z, w = q
    vx, vy, vz = v
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        float(vx + w * tx + y * tz - z * ty),
        float(vy + w * ty + z * tx - x * tz),
        float(vz + w * tz + x * ty - y * tx),
    )


def matrix_from_quaternion(q: Vector) -> Array:
    """Return the rotation matrix, shape [3, 3]."""
    x, y, z, w = q
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
        )
    )


def axis_rotation(axis: Vector, angle: float) -> Array:
    """Return the rotation matrix about a unit axis by `angle` [rad], shape [3, 3]."""
    x, y, z = axis
    k = np.array(((0, -z, y), (z, 0, -x), (-y, x, 0)))
    return np.asarray(np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * (k @ k))


def quaternion_from_matrix(matrix: Array) -> Array:
    """Return the quaternion of a rotation matrix, shape [4], with w >= 0 (Shepperd's method)."""
    m = np.asarray(matrix, np.float64).tolist()  # plain numbers: see `_product`
    trace = m[0][0] + m[1][1] + m[2][2]
    choices = (m[0][0], m[1][1], m[2][2], trace)
    i = choices.index(max(choices))
    if i == 3:
        values = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1 + trace]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        values = [0.0] * 4
        values[i] = 1 - trace + 2 * m[i][i]
        values[j] = m[j][i] + m[i][j]
        values[k] = m[k][i] + m[i][k]
        values[3] = m[k][j] - m[j][k]
    q = np.array(values)
    q /= math.sqrt(q.dot(q))
    return q if q[3] >= 0 else -q


def quaternion_from_axis_angle(axis: Vector, angle: float) -> Array:
    """Return the rotation by `angle` [rad] about `axis` (any length but zero), shape [4]."""
    a = np.asarray(axis, np.float64)
    return np.append(a / np.linalg.norm(a) * math.sin(angle / 2), math.cos(angle / 2))


def quaternion_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return the rotation of URDF's fixed-axis roll, pitch, yaw [rad], shape [4]."""
    x, y, z = 0.5 * roll, 0.5 * pitch, 0.5 * yaw
    about_x = (math.sin(x), 0.0, 0.0, math.cos(x))
    about_y = (0.0, math.sin(y), 0.0, math.cos(y))
    about_z = (0.0, 0.0, math.sin(z), math.cos(z))
    return multiply(about_z, multiply(about_y, about_x))


def about_z(angle: float) -> tuple[float, float, float, float]:
    """Return the rotation by `angle` [rad] about z, as a quaternion."""
    return 0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)


def rpy_from_matrix(matrix: Array) -> tuple[float, float, float]:
    """Return URDF's fixed-axis roll, pitch, yaw [rad] of a rotation matrix."""
    m = matrix
    horizontal = math.hypot(m[0, 0], m[1, 0])
    pitch = math.atan2(-m[2, 0], horizontal)
    if horizontal < 1e-9:  # gimbal lock: yaw is free, take zero
        return math.atan2(-m[1, 2], m[1, 1]), pitch, 0.0
    return math.atan2(m[2, 1], m[2, 2]), pitch, math.atan2(m[1, 0], m[0, 0])


def rotation_vector(q: Vector) -> Array:
    """Return the axis times angle of a rotation [rad], shape [3], the angle in [0, pi]."""
    x, y, z, w = q
    if w < 0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if sine < 1e-12 else 2 * math.atan2(sine, w) / sine
    return np.array((x * scale, y * scale, z * scale))


def turn_to(wanted: Vector, now: Vector) -> Array:
    """Return the turn from one orientation to a wanted one, quaternions, in the world [rad], shape [3]."""
    return rotation_vector(multiply(wanted, conjugate(now)))


def turned_and_raised(way: Array, rest: Array) -> tuple[float, float]:
    """Return how far a way is to the left of another, seen from above, and how far above it [rad].

    Args:
        way: A unit vector, shape [3].
        rest: Another.
    """
    turned = math.atan2(rest[0] * way[1] - rest[1] * way[0], rest[0] * way[0] + rest[1] * way[1])
    up, up_at_rest = np.arcsin(np.clip((way[2], rest[2]), -1.0, 1.0))
    return turned, float(up - up_at_rest)
