"""What all control modes have in common, and those of a base and of a gripper."""

from __future__ import annotations

import abc
from collections.abc import Container, Sequence

import numpy as np

from rcare_marl.pose import Array
from rcare_marl.separation import Near

from ..gripper import Gripper
from ..mobile_base import MobileBase


class Control(abc.ABC):
    """Turns actions into motor commands.

    Attributes:
        size: Number of action values.
        names: What each value moves, with its unit.
        max: What a value of 1 means in that unit, shape [size].
        needs_actuation: Whether `actuate` must be called before every physics step.
        near: Where links are near what they are to be kept clear of, by who looks in each control step;
            heeded by `ToolDelta` and its kinds.
        carried: Links of who is near that go as the tool does, such as an arm that lies in a cradle: they
            are not to be carried against the robot's own arm.
    """

    size: int
    names: tuple[str, ...]
    max: Array
    needs_actuation: bool = False
    near: Sequence[Near] = ()
    carried: Container[int] = ()

    @abc.abstractmethod
    def reset(self) -> None:
        """Take the present posture as the one to hold, and hold it."""

    @abc.abstractmethod
    def command(self, action: Array, duration: float) -> None:
        """Accept an action, each value in [-1, 1], for the coming `duration` [s]."""

    def actuate(self) -> None:
        """Act before each physics step, where motors cannot hold the command by themselves."""


class BaseVelocity(Control):
    """Action values are speeds in the robot's own frame: forward, to the left if it can, and turning.

    The base takes `RAMP` to come from rest to its full speed, since a jolt would throw arms and head
    about.
    """

    RAMP = 0.2  # [s]; our own choice
    needs_actuation = True

    def __init__(self, base: MobileBase, name: str = "base") -> None:
        self._base = base
        config = base.config
        slides = ("forward", "left") if config.kind == "omnidirectional" else ("forward",)
        self.size = len(slides) + 1
        self.names = (*(f"{name} {way} [m/s]" for way in slides), f"{name} turning [rad/s]")
        self.max = np.array([config.speed] * len(slides) + [config.turn])
        self._velocity = np.zeros(3)

    def reset(self) -> None:
        self._velocity = np.zeros(3)
        self._base.drive(self._velocity)

    def command(self, action: Array, duration: float) -> None:
        speeds = self.max * action
        left = float(speeds[1]) if self.size == 3 else 0.0
        wanted = np.array((speeds[0], left, speeds[-1]))
        config = self._base.config
        # Going aslant is no faster than going straight.
        along = float(np.hypot(wanted[0], wanted[1]))
        if along > config.speed:
            wanted[:2] *= config.speed / along
        change = np.array((config.speed, config.speed, config.turn)) * duration / self.RAMP
        self._velocity = np.clip(wanted, self._velocity - change, self._velocity + change)

    def actuate(self) -> None:
        """Drive on along the present heading."""
        self._base.drive(self._velocity)


class GripperClosing(Control):
    """One value closes the gripper (1) or opens it (-1), at its greatest speed.

    Attributes:
        gripper: The gripper.
    """

    size = 1

    def __init__(self, gripper: Gripper, name: str) -> None:
        self.gripper = gripper
        self.names = (f"{name} closing [1]",)
        self.max = np.array([1.0])

    def reset(self) -> None:
        self.gripper.drive(self.gripper.target)

    def command(self, action: Array, duration: float) -> None:
        self.gripper.advance(float(action[0]), duration)


class ToolMotion(Control):
    """Six values move where the tool is to be: three along, three about the world's axes."""

    SPEED = 0.25  # [m/s]
    TURN = 1.0  # [rad/s]
    NAMES = (
        *(f"tool {axis} [m/s]" for axis in "xyz"),
        *(f"tool about {axis} [rad/s]" for axis in "xyz"),
    )

    def __init__(self) -> None:
        self.size, self.names = len(self.NAMES), self.NAMES
        self.max = np.array([self.SPEED] * 3 + [self.TURN] * 3)

    def action(self, linear: Array, angular: Array) -> Array:
        """Return the action that moves the tool so; slower, where it would be too fast.

        Args:
            linear: Velocity of the tool in the world [m/s], shape [3].
            angular: How fast it turns about the world's axes [rad/s], shape [3].
        """
        action = np.zeros(self.size)
        action[:6] = np.concatenate((linear, angular)) / self.max[:6]
        return np.asarray(action / max(1.0, float(np.abs(action).max())))
