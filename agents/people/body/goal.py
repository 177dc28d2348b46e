"""What whole-body inverse kinematics is asked for: goals on the joints of a person, in the world.

A goal names one of the 55 SMPL-X joints and, where a point matters, an offset in the frame of that
joint, so that a fingertip, a palm or the sole of a foot can be meant. Weights say what a metre and a
radian count; tolerances say what counts as reached. A length of 0.3 m to the radian is our own choice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, Pose

from .skeleton import JOINTS

Point = Sequence[float] | Array

TURN_WEIGHT = 0.3  # of a radian against a metre
NEAR = 0.01  # [m] that counts as reached
ALIGNED = math.radians(3)  # [rad] that counts as reached


def _settle(goal: Goal, *, unit: bool = False, **sizes: int) -> None:
    """Check a goal, and keep its vectors of the given sizes as tuples, of unit length if so wished."""
    kind = type(goal).__name__
    for name in ("weight", "tolerance"):
        value = getattr(goal, name)
        if not (math.isfinite(value) and value > 0):
            raise ConfigError(f"the {name} of a {kind} goal must be positive, got {value}")
    if not isinstance(goal, Balance):
        check_name("joint", goal.joint, JOINTS)
    for name, size in sizes.items():
        given, what = getattr(goal, name), f"the {name} of a goal of {kind}"
        values = np.asarray(given, np.float64)
        if values.shape != (size,) or not np.isfinite(values).all():
            raise ConfigError(f"{what} must be {size} finite numbers, got {given!r}")
        if unit:
            length = float(np.linalg.norm(values))
            if length < 1e-9:
                raise ConfigError(f"{what} must not be zero")
            values = values / length
        object.__setattr__(goal, name, tuple(values.tolist()))


@dataclass(frozen=True)
class Position:
    """A point of a joint's segment at a place.

    Attributes:
        joint: SMPL-X joint.
        target: Where in the world [m], shape [3].
        offset: The point in the frame of the joint [m], shape [3].
        weight: Of a metre.
        tolerance: Distance that counts as reached [m].
    """

    joint: str
    target: Point
    offset: Point = (0.0, 0.0, 0.0)
    weight: float = 1.0
    tolerance: float = NEAR

    def __post_init__(self) -> None:
        _settle(self, target=3, offset=3)


@dataclass(frozen=True)
class Orientation:
    """The frame of a joint turned in a given way.

    Attributes:
        joint: SMPL-X joint.
        quaternion: In the world (x, y, z, w), shape [4].
        weight: Of a radian.
        tolerance: Angle that counts as reached [rad].
    """

    joint: str
    quaternion: Point
    weight: float = TURN_WEIGHT
    tolerance: float = ALIGNED

    def __post_init__(self) -> None:
        _settle(self, quaternion=4)
        length = float(np.linalg.norm(self.quaternion))
        if abs(length - 1) > 1e-3:
            raise ConfigError(f"the quaternion of an Orientation has length {length:.4g}, not 1")
        _settle(self, unit=True, quaternion=4)


@dataclass(frozen=True)
class Direction:
    """A direction fixed in a joint's segment along one in the world: a palm up, a finger pointing.

    Attributes:
        joint: SMPL-X joint.
        target: Direction in the world, any length, shape [3].
        local: Direction in the frame of the joint, any length, shape [3].
        weight: Of a radian.
        tolerance: Angle that counts as reached [rad].
    """

    joint: str
    target: Point
    local: Point
    weight: float = TURN_WEIGHT
    tolerance: float = ALIGNED

    def __post_init__(self) -> None:
        _settle(self, unit=True, target=3, local=3)


@dataclass(frozen=True)
class Gaze:
    """A look at a point: with the face (joint `head`) or with an eye (`left_eye_smplhf`).

    Attributes:
        target: What is looked at, in the world [m], shape [3].
        joint: SMPL-X joint that looks; its z axis is the line of sight.
        offset: Where the line of sight begins, in the frame of the joint [m], shape [3].
        weight: Of a radian.
        tolerance: Angle that counts as reached [rad].
    """

    target: Point
    joint: str = "head"
    offset: Point = (0.0, 0.0, 0.0)
    weight: float = TURN_WEIGHT
    tolerance: float = ALIGNED

    def __post_init__(self) -> None:
        _settle(self, target=3, offset=3)


@dataclass(frozen=True)
class Balance:
    """The whole body's centre of mass above a support: that of somebody who stands still.

    Attributes:
        support: Points of the support on the floor [m], shape [k, 2]; their convex hull counts.
        weight: Of a metre outside the support.
        tolerance: Distance outside that counts as reached [m].
    """

    support: Sequence[Sequence[float]] | Array
    weight: float = 1.0
    tolerance: float = NEAR

    def __post_init__(self) -> None:
        _settle(self)
        points = np.asarray(self.support, np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not len(points):
            raise ConfigError(f"the support of a Balance has shape [k, 2], got {points.shape}")
        if not np.isfinite(points).all():
            raise ConfigError("the support of a Balance holds values that are not finite")
        object.__setattr__(self, "support", convex_hull(points))


Goal = Position | Orientation | Direction | Gaze | Balance


def place(joint: str, pose: Pose, *, offset: Point = (0.0, 0.0, 0.0)) -> tuple[Goal, Goal]:
    """Return the two goals that put the point `offset` [m] of a joint's frame at `pose`."""
    return Position(joint, pose.position, offset), Orientation(joint, pose.quaternion)


def convex_hull(points: Array) -> Array:
    """Return the convex hull of points in the plane [m], shape [k, 2], counter-clockwise.

    Andrew's monotone chain: the lower and the upper half, each from points sorted by x.
    """
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) < 3:
        return np.array(ordered)

    def half(row: list[tuple[float, float]]) -> list[tuple[float, float]]:
        out: list[tuple[float, float]] = []
        for p in row:
            while len(out) > 1 and _cross(out[-2], out[-1], p) <= 0:
                out.pop()
            out.append(p)
        return out[:-1]

    return np.array(half(ordered) + half(ordered[::-1]))


def _cross(o: tuple[float, float], a: tuple[float, float], b: tuple[float, float]) -> float:
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])
