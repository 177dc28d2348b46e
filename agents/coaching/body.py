"""What a coach acts with: a robot, simulated or real."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from rcare_marl.pose import Array

from ..robots.robot import Robot
from .retarget import Retarget, Shown
from .upper_body import MOTIONS

# [rad/s] at most, so that a limb swings round, and does not jump, where two postures of the robot meet; half
# of what NAO's slowest arm joint does. Our own choice.
SWIFT = 3.5


class CoachBody(Protocol):
    """What the coach's tree drives; implement it for a robot of your own, then `Coach` coaches with it."""

    def show(self, angles: Array) -> None:
        """Take a pose, angles of `MOTIONS` [rad], shape [16]; called once a step."""

    def say(self, text: str) -> None:
        """Say something; it does not wait until it is said."""

    def stand_still(self) -> None:
        """Lower the arms, look ahead and keep still."""


class RobotBody:
    """A simulated robot as the body of a coach.

    Attributes:
        shown: What it was told last, as its joints.
        said: All that it said since the last reset, the last one at the end.
    """

    def __init__(self, robot: Robot) -> None:
        """Take a robot that has been spawned, whose arms and head move by `joint_position`.

        Raises:
            ConfigError: If it has no arms and head like a person's.
        """
        self._robot = robot
        self._retarget = Retarget(robot.config)
        self._rest: Array = np.zeros(len(MOTIONS))
        self.said: list[str] = []
        self.reset(self._rest)

    def reset(self, rest: Array) -> None:
        """Begin an episode where the robot stands; `rest` is how it stands still [rad], shape [16]."""
        self._rest = rest
        self.said.clear()
        self.shown: Shown = self._retarget(rest)
        self._targets = {
            name: part.joints.positions()
            for name, part in self._robot.parts.items()
            if part.joints is not None
        }

    def take(self, angles: Array) -> None:
        """Be in a pose at once, at rest."""
        self.show(angles)
        for name, targets in self._targets.items():
            joints = self._robot.parts[name].joints
            assert joints is not None  # only such have targets
            for i, joint in enumerate(joints.names):
                targets[i] = self.shown.joints.get(joint, targets[i])
            joints.teleport(targets)
            self._robot.parts[name].control.reset()

    def show(self, angles: Array) -> None:
        self.shown = self._retarget(angles)

    def say(self, text: str) -> None:
        self.said.append(text)

    def stand_still(self) -> None:
        self.shown = self._retarget(self._rest)

    def target(self, part: str, duration: float) -> Array:
        """Return where the joints of a part shall be after the coming `duration` [s], [rad]."""
        joints = self._robot.parts[part].joints
        assert joints is not None
        targets, most = self._targets[part], SWIFT * duration
        for i, joint in enumerate(joints.names):
            if joint in self.shown.joints:
                way = self.shown.joints[joint] - targets[i]
                targets[i] += min(max(way, -most), most)
        return targets
