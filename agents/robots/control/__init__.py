"""How actions move the parts of a robot: one class a control mode."""

from __future__ import annotations

from collections.abc import Callable

from rcare_marl.errors import ConfigError

from ..arm import Arm
from ..joint_group import JointGroup
from .control import BaseVelocity, Control, GripperClosing
from .joint_control import JointDelta, JointPosition, JointTorque, JointVelocity
from .tool_delta import ToolDelta

CONTROLS: dict[str, Callable[[Arm], Control]] = {
    "joint_delta": JointDelta,
    "joint_position": JointPosition,
    "joint_velocity": JointVelocity,
    "joint_torque": JointTorque,
    "tool_delta": ToolDelta,
}
WEIGHT_CARRYING = ("joint_torque", "tool_delta")  # modes that carry the arm's weight by themselves
# Of a head or torso beside arms; modes that need an arm's kinematics leave such groups to `joint_delta`.
GROUP_CONTROLS: dict[str, Callable[[JointGroup], Control]] = {
    "joint_position": JointPosition,
    "joint_velocity": JointVelocity,
}


def moving_tool(control: Control) -> ToolDelta:
    """Return a control whose actions move a tool; ConfigError if it is another mode."""
    if not isinstance(control, ToolDelta):
        raise ConfigError(
            "motions of the tool need the control mode 'tool_delta', got "
            f"{type(control).__name__}: make(..., robot={{'control': 'tool_delta'}})"
        )
    return control


__all__ = [
    "CONTROLS",
    "GROUP_CONTROLS",
    "WEIGHT_CARRYING",
    "BaseVelocity",
    "Control",
    "GripperClosing",
    "JointDelta",
    "JointPosition",
    "JointTorque",
    "JointVelocity",
    "ToolDelta",
    "moving_tool",
]
