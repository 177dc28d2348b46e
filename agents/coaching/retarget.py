"""Angles of an upper body as joints of a robot that has two arms and a head, such as NAO and Pepper.

Upper arms and forearms point where a person's would, the head turns as theirs does, and the back of the
hand looks the same way, as far as the robot's joints allow. Where they do not, the direction that comes
nearest is taken from the shoulder outwards: a forearm may still point right where the upper arm cannot.
What is left is told. A robot that cannot bend its trunk shows everything as from an upright one.

All robots here have shoulders that pitch (about y) and roll (about z), and elbows that yaw (about the upper
arm) and roll. With all joints at zero the arms point forward, palms down.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, matrix_from_quaternion, quaternion_from_rpy

from ..robots.robot_config import RobotConfig, load_robot
from ..robots.robot_model import robot_model
from .upper_body import (
    ARM,
    HAND_IN_FOREARM,
    MOTION_INDEX,
    SIDES,
    SIGN,
    swing,
    turn_x,
    turn_y,
    turn_z,
)

ARM_JOINTS = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
HEAD_JOINTS = ("HeadYaw", "HeadPitch")
# Sine of the bend below which an elbow counts as straight, and the plane of the shoulder's rotation decides
# how it yaws; our own choice.
STRAIGHT = 0.12
# Share by which an arm that points to the side leans forward, where its pitch has no meaning; our own choice.
SIDEWAYS = 0.02


@dataclass(frozen=True)
class Shown:
    """What a robot shows of a pose.

    Attributes:
        joints: Position by joint [rad], within its limits.
        short: By part how far the robot falls short [rad]: of the upper arms and forearms the angle
            between where they point and where they should, of the head and the hands that of the turn
            that is left, of the trunk the angle by which it should bend or turn.
    """

    joints: Mapping[str, float]
    short: Mapping[str, float]

    @property
    def worst(self) -> float:
        """Greatest of what is left [rad]."""
        return max(self.short.values())


class Retarget:
    """Turns angles of an upper body into joints of one robot.

    Attributes:
        joints: The joints that it sets, those of the left arm first.
    """

    def __init__(self, config: RobotConfig) -> None:
        """Read limits from the robot's model.

        Raises:
            ConfigError: If it has no arms and head of the kind that this knows.
        """
        model = robot_model(config.model, urdf=config.urdf)
        self.joints = (*_arm_joints("left"), *_arm_joints("right"), *HEAD_JOINTS)
        missing = [joint for joint in self.joints if joint not in model.joints]
        if missing:
            raise ConfigError(
                f"{model.name} has no arm that reaches out as a person's does, or no head that turns, to "
                f"show exercises with: no joint {missing[0]!r}. Cast nao or pepper"
            )
        self._limits = {
            name: (model.joints[name].lower, model.joints[name].upper) for name in self.joints
        }
        # Pepper's forearm is tilted against its upper arm.
        self._elbow = {
            side: matrix_from_quaternion(
                quaternion_from_rpy(*model.joints[f"{side[0].upper()}ElbowYaw"].rpy)
            )
            for side in SIDES
        }

    def __call__(self, angles: Array) -> Shown:
        """Return how the robot shows a pose.

        Args:
            angles: Angles of `MOTIONS` [rad], shape [16]; an unknown one counts as zero.

        Raises:
            ConfigError: If they have another shape.
        """
        angles = np.nan_to_num(np.asarray(angles, np.float64))
        if angles.shape != (len(MOTION_INDEX),):
            raise ConfigError(f"angles must have shape [{len(MOTION_INDEX)}], got {angles.shape}")
        joints: dict[str, float] = {}
        short = {"trunk": float(np.abs(angles[:3]).max())}
        self._show_head(angles, joints, short)
        for side in SIDES:
            self._show_arm(side, angles[ARM[side]], joints, short)
        return Shown(joints, short)

    def _show_head(self, angles: Array, joints: dict[str, float], short: dict[str, float]) -> None:
        flexion, lateral, rotation = (
            float(angles[MOTION_INDEX[f"neck_{name}"]])
            for name in ("flexion", "lateral_flexion_left", "rotation_left")
        )
        joints["HeadYaw"] = self._within("HeadYaw", rotation)
        joints["HeadPitch"] = self._within("HeadPitch", flexion)
        left = (rotation - joints["HeadYaw"], flexion - joints["HeadPitch"], lateral)
        short["head"] = max(map(abs, left))

    def _show_arm(
        self, side: str, angles: Array, joints: dict[str, float], short: dict[str, float]
    ) -> None:
        upper, fore, hand = arm_turns(side, angles)
        pitch, roll, elbow_yaw, elbow_roll, wrist = _arm_joints(side)
        joints[pitch], joints[roll] = self._shoulder(side, -upper[:, 2])
        shoulder = turn_y(joints[pitch]) @ turn_z(joints[roll])
        short[f"{side}_upper_arm"] = angle_between(shoulder[:, 0], -upper[:, 2])
        base = shoulder @ self._elbow[side]
        joints[elbow_yaw], joints[elbow_roll] = self._bend(
            side, base.T @ -fore[:, 2], base.T @ upper[:, 0]
        )
        forearm = base @ turn_x(joints[elbow_yaw]) @ turn_z(joints[elbow_roll])
        short[f"{side}_forearm"] = angle_between(forearm[:, 0], -fore[:, 2])
        _, across, back = (forearm.T @ hand[:, 2]).tolist()
        turn = math.atan2(-across, back)
        joints[wrist] = self._within(wrist, turn)
        short[f"{side}_hand"] = abs(turn - joints[wrist])

    def _shoulder(self, side: str, way: Array) -> tuple[float, float]:
        """Return pitch and roll with which the upper arm points nearest along `way`."""
        pitch_name, roll_name = _arm_joints(side)[:2]
        x, y, z = way.tolist()
        lean = max(SIDEWAYS - math.hypot(x, z), 0.0)
        pitch = self._within(pitch_name, math.atan2(-z, x + lean))
        ahead = math.cos(pitch) * x - math.sin(pitch) * z
        return pitch, self._nearest(roll_name, math.atan2(y, ahead))

    def _bend(self, side: str, way: Array, plane: Array) -> tuple[float, float]:
        """Return yaw and roll of an elbow whose forearm then points nearest along `way`.

        Args:
            side: `left` or `right`.
            way: Where the forearm should point, in the frame of the elbow.
            plane: Where the forearm of a person would move to if it bent, in the same frame.
        """
        yaw_name, roll_name = _arm_joints(side)[2:4]
        out = np.array((way[1], way[2]))
        size = float(np.hypot(*out))
        if size < STRAIGHT:
            out = out + (STRAIGHT - size) * np.array((plane[1], plane[2]))
        sign = -SIGN[side]  # a left elbow rolls below zero, a right one above
        yaw = self._within(yaw_name, math.atan2(sign * out[1], sign * out[0]))
        side_on = math.cos(yaw) * way[1] + math.sin(yaw) * way[2]
        return yaw, self._nearest(roll_name, math.atan2(side_on, float(way[0])))

    def _within(self, joint: str, angle: float) -> float:
        low, high = self._limits[joint]
        return min(max(angle, low), high)

    def _nearest(self, joint: str, angle: float) -> float:
        """Return the angle of the range that is nearest to `angle` around the circle."""
        low, high = self._limits[joint]
        if low <= angle <= high:
            return angle
        return min((low, high), key=lambda end: -math.cos(end - angle))


def arm_turns(side: str, angles: Array) -> tuple[Array, Array, Array]:
    """Return how upper arm, forearm and hand are turned against the trunk, each [3, 3].

    Args:
        side: `left` or `right`.
        angles: Those of the arm, in the order of `ARM_MOTIONS` [rad], shape [5].
    """
    elevation, plane, rotation, elbow, pronation = angles
    upper = swing(side, elevation, plane) @ turn_z(-SIGN[side] * rotation)
    fore = upper @ turn_y(-elbow)
    return upper, fore, fore @ turn_z(-SIGN[side] * pronation) @ HAND_IN_FOREARM[side]


def angle_between(a: Array, b: Array) -> float:
    """Return the angle between two unit vectors [rad]."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def robot_joints(robot: str | RobotConfig, angles: Array) -> Shown:
    """Return how a robot, by name or as its model, shows angles of `MOTIONS` [rad], shape [16].

    Raises:
        ConfigError: If it has no arms and head of the kind that this knows.
        UnknownNameError: If there is no robot of that name.
    """
    return (Retarget(robot) if isinstance(robot, RobotConfig) else _named(robot))(angles)


@lru_cache(maxsize=8)
def _named(robot: str) -> Retarget:
    return Retarget(load_robot(robot))


def _arm_joints(side: str) -> tuple[str, ...]:
    return tuple(f"{side[0].upper()}{joint}" for joint in ARM_JOINTS)
