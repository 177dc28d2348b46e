"""A part of a robot that actions move: an arm, a gripper, a head or torso, or the base."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass

import numpy as np

from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, rotation_vector

from .arm import Arm
from .control import Control, GripperClosing
from .gripper import Gripper
from .joint_group import JointGroup
from .mobile_base import MobileBase


@dataclass(eq=False)
class Part:
    """A part that moves, and what the robot senses of it.

    Attributes:
        name: Its name.
        control: Its control mode.
        joints: Its joints; None for a gripper or a base.
        base: The base, if it is that.
        tool: Returns the pose of its tool in the world, if it is an arm.
        prefix: Begins the names of an arm's observables.
    """

    name: str
    control: Control
    _: KW_ONLY
    joints: JointGroup | None = None
    base: MobileBase | None = None
    tool: Callable[[], Pose] | None = None
    prefix: str = ""

    def __post_init__(self) -> None:
        if self.joints is not None:  # a continuous joint is at the same place every turn
            self._turns = bool(np.isinf(self.joints.upper).any())
            self._period = np.where(np.isinf(self.joints.upper), 2 * np.pi, 1e9)

    def sense(self) -> None:
        """Read the state once, for all observables."""
        if self.joints is not None:
            self._positions, self._velocities, _ = self.joints.read()
            if self._turns:
                turns = np.rint(self._positions / self._period)
                self._positions = self._positions - self._period * turns
        if self.tool is not None:
            pose = self.tool()
            self._tool_position = pose.position
            self._tool_rotation = rotation_vector(pose.quaternion)

    def take_rates(self, velocities: Array) -> None:
        """Sense these joint velocities [rad/s or m/s], shape [n], told by another, until `sense`."""
        self._velocities = velocities

    def observables(self) -> list[Observable]:
        """Return what the robot senses of it."""
        if isinstance(self.control, GripperClosing):
            return [closing(self.name, self.control.gripper)]
        if self.base is not None:
            return [
                Observable(f"{self.name}_place", "m or rad", 3, self.base.place),
                Observable(f"{self.name}_velocity", "m/s or rad/s", 3, self.base.velocity),
            ]
        assert self.joints is not None  # or it is a gripper or a base
        unit = "rad" if set(self.joints.units) == {"rad"} else "rad or m"
        rate = "rad/s" if unit == "rad" else "rad/s or m/s"
        prefix = f"{self.prefix}joint" if isinstance(self.joints, Arm) else self.name
        count = len(self.joints)
        out = [
            Observable(f"{prefix}_position", unit, count, lambda: self._positions),
            Observable(f"{prefix}_velocity", rate, count, lambda: self._velocities),
        ]
        if self.tool is not None:
            place, turn = (f"{self.prefix}tool_{what}" for what in ("position", "rotation"))
            out += [
                Observable(place, "m", 3, lambda: self._tool_position),
                Observable(turn, "rad", 3, lambda: self._tool_rotation),
            ]
        return out


def closing(name: str, gripper: Gripper) -> Observable:
    """Return how far a gripper is closed, as an observable."""
    return Observable(f"{name}_closing", "1", 1, lambda: [gripper.closing()])
