"""How actions move the parts of a robot: one class a control mode."""

from __future__ import annotations

from collections.abc import Callable

from rcare_marl.errors import ConfigError, check_name

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
_GROUP_CONTROLS: dict[str, Callable[[JointGroup], Control]] = {
    "joint_position": JointPosition,
    "joint_velocity": JointVelocity,
}


def make_control(name: str, arm: Arm) -> Control:
    """Return the control mode `name` for an arm; UnknownNameError if there is none."""
    check_name("control mode", name, CONTROLS)
    return CONTROLS[name](arm)


def moving_tool(control: Control) -> ToolDelta:
    """Return a control whose actions move a tool; ConfigError if it is another mode."""
    if not isinstance(control, ToolDelta):
        raise ConfigError(
            "motions of the tool need the control mode 'tool_delta', got "
            f"{type(control).__name__}: make(..., robot={{'control': 'tool_delta'}})"
        )
    return control


def make_group_control(name: str, group: JointGroup) -> Control:
    """Return the control of a head or torso beside arms under the mode `name`.

    Modes that need an arm's kinematics leave such groups to `joint_delta`.
    """
    return _GROUP_CONTROLS.get(name, JointDelta)(group)


__all__ = [
    "CONTROLS",
    "WEIGHT_CARRYING",
    "BaseVelocity",
    "Control",
    "GripperClosing",
    "JointDelta",
    "JointPosition",
    "JointTorque",
    "JointVelocity",
    "ToolDelta",
    "make_control",
    "make_group_control",
    "moving_tool",
]
