"""How a robot's actions move its arm: one class a control mode."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from rcare_marl.errors import UnknownNameError
from rcare_marl.pose import Array

from ..arm import Arm
from .joint_position import JointPosition
from .joint_torque import JointTorque
from .joint_velocity import JointVelocity
from .tool_delta import ToolDelta


class Control(Protocol):
    """Turns actions into motor commands.

    Attributes:
        size: Number of action values.
        names: What each value moves, with its unit.
        max: What a value of 1 means in that unit, shape [size].
    """

    size: int
    names: tuple[str, ...]
    max: Array

    def reset(self) -> None:
        """Take the present posture as the one to hold, and hold it."""

    def command(self, action: Array, duration: float) -> None:
        """Accept an action, each value in [-1, 1], for the coming `duration` [s]."""

    def actuate(self) -> None:
        """Act before each physics step; only torques need this."""


CONTROLS: dict[str, Callable[[Arm], Control]] = {
    "joint_position": JointPosition,
    "joint_velocity": JointVelocity,
    "joint_torque": JointTorque,
    "tool_delta": ToolDelta,
}


def make_control(name: str, arm: Arm) -> Control:
    """Return the control mode `name` for an arm; UnknownNameError if there is none."""
    if name not in CONTROLS:
        raise UnknownNameError("control mode", name, CONTROLS)
    return CONTROLS[name](arm)


__all__ = [
    "CONTROLS",
    "Control",
    "JointPosition",
    "JointTorque",
    "JointVelocity",
    "ToolDelta",
    "make_control",
]
