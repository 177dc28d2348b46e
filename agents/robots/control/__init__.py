"""How actions move the parts of a robot: one class a control mode."""

from __future__ import annotations

from collections.abc import Callable

from rcare_marl.errors import ConfigError

from ..arm import Arm
from ..joint_group import JointGroup
from .admittance import ToolAdmittance
from .control import BaseVelocity, Control, GripperClosing, ToolMotion
from .impedance import Compliance, ToolImpedance
from .joint_control import JointDelta, JointPosition, JointTorque, JointVelocity
from .tool_delta import ToolDelta, ToolPose, ToolServo

CONTROLS: dict[str, Callable[[Arm], Control]] = {
    "joint_delta": JointDelta,
    "joint_position": JointPosition,
    "joint_velocity": JointVelocity,
    "joint_torque": JointTorque,
    "tool_delta": ToolDelta,
    "tool_servo": ToolServo,
    "tool_pose": ToolPose,
    "impedance": lambda arm: ToolImpedance(arm, Compliance()),
    "admittance": lambda arm: ToolAdmittance(arm, Compliance()),
}
COMPLIANT: dict[str, type[ToolImpedance]] = {
    "impedance": ToolImpedance,
    "admittance": ToolAdmittance,
}
# Modes that carry the arm's weight by themselves.
WEIGHT_CARRYING = ("joint_torque", "tool_delta", "tool_servo", "tool_pose", *COMPLIANT)
# Of a head or torso beside arms; modes that need an arm's kinematics leave such groups to `joint_delta`.
GROUP_CONTROLS: dict[str, Callable[[JointGroup], Control]] = {
    "joint_position": JointPosition,
    "joint_velocity": JointVelocity,
}


def make_control(
    name: str, arm: Arm, contact: tuple[float, float], compliance: Compliance
) -> Control:
    """Return the control of an arm.

    Args:
        name: One of `CONTROLS`.
        arm: The arm.
        contact: Force at the tool from which `tool_delta` and `tool_pose` give way [N], and torque with which
            it may turn what it holds [N·m].
        compliance: How the tool yields under `impedance` and `admittance`.
    """
    if name in COMPLIANT:
        return COMPLIANT[name](arm, compliance)
    control = CONTROLS[name](arm)
    if isinstance(control, ToolDelta):
        control.contact_force, control.contact_torque = contact
    return control


def moving_tool(control: Control) -> ToolMotion:
    """Return a control whose actions move a tool; ConfigError if it is another mode."""
    if not isinstance(control, ToolMotion) or isinstance(control, ToolPose):
        raise ConfigError(
            "motions of the tool need the control mode 'tool_delta', 'impedance' or 'admittance', got "
            f"{type(control).__name__}: make(..., robot={{'control': 'tool_delta'}})"
        )
    return control


__all__ = [
    "CONTROLS",
    "GROUP_CONTROLS",
    "WEIGHT_CARRYING",
    "BaseVelocity",
    "Compliance",
    "Control",
    "GripperClosing",
    "JointDelta",
    "JointPosition",
    "JointTorque",
    "JointVelocity",
    "ToolAdmittance",
    "ToolDelta",
    "ToolImpedance",
    "ToolMotion",
    "ToolPose",
    "ToolServo",
    "make_control",
    "moving_tool",
]
