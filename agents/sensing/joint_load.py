"""What joints transmit: six components, the torque about their axes, or what the wrist feels of the hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.own_load import OwnMotion, OwnWeight
from rcare_marl.pose import Array, matrix_from_quaternion
from rcare_marl.world import World

from ..agent import Agent
from ..robots.robot import Robot
from ..robots.robot_config import ArmConfig, frame
from .sensor import Channel, Sensor, SensorConfig, wrist_link


@dataclass(frozen=True)
class JointWrenchConfig(SensorConfig):
    """Options of `joint_wrench` and `joint_torque`.

    Attributes:
        joints: Movable joints; those of a robot's main arm, or all of a person's, if empty.
    """

    joints: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_once("joints", self.joints)


class JointWrench(Sensor):
    """Force and torque that joints transmit, as a six-axis sensor in each joint feels them.

    Channels: `force` [N] and `torque` [N·m], three values a joint, in the frame of the joint's child
    link, about its origin, which lies on the joint. It is what the child side does to the parent side,
    as drivers of force-torque sensors in ROS tell it: a weight that hangs on an arm pulls down, and a
    table that the hand presses on pushes up. All is felt that the joint bears: weight, inertia,
    contacts, things held. The torque about the joint's own axis is that of its drive; what a stop at
    the end of the range bears there is not told. Before the first physics step of an episode it is the
    weight of the body's own links at rest.
    """

    Config = JointWrenchConfig
    config: JointWrenchConfig

    def bind(self, world: World, agent: Agent) -> None:
        joints = self.config.joints
        if not joints and isinstance(agent, Robot):
            arm = agent.config.main_arm
            joints = agent.config.arms[arm].joints
            if any(joint not in agent.body.joints for joint in joints):
                raise ConfigError(
                    f"sensor {self.config.name!r}: {arm!r} does not move: name it in `moves`, or "
                    "name other joints"
                )
        self.joints = joints or tuple(agent.body.joints)
        self._world, self._body = world, agent.body
        self._indices = self._body.indices(self.joints)
        self._body.feedback.enable(self._indices)
        self._weight = OwnWeight(self._body, self._indices)
        self.reset()

    def reset(self) -> None:
        self._begun = self._world.step_count

    def channels(self) -> Sequence[Channel]:
        shape = (len(self.joints), 3)
        return Channel("force", "N", shape), Channel("torque", "N·m", shape)

    def measure(self) -> Sequence[Array]:
        wrenches = self._wrenches()
        return wrenches[:, :3], wrenches[:, 3:]

    def _wrenches(self) -> Array:
        if self._world.step_count == self._begun:  # what Bullet tells is of the last episode
            return self._weight.wrenches()
        return self._body.feedback.wrenches(self._indices)


class JointTorque(JointWrench):
    """Torque [N·m], or force [N] of a sliding joint, that the drives of joints put on them.

    Channel: `effort`, one value a joint, positive where it moves the joint up, as `effort` in the joint
    states of ROS. It is what a torque sensor behind the gears feels: it holds the weight of the arm.
    Before the first physics step of an episode it is what holds the body's own links at rest.
    """

    def channels(self) -> Sequence[Channel]:
        kinds = {self._body.joint(name).kind for name in self.joints}
        unit = "N" if kinds == {"prismatic"} else "N·m" if kinds == {"revolute"} else "N·m or N"
        return (Channel("effort", unit, (len(self.joints),)),)

    def measure(self) -> Sequence[Array]:
        return (self._body.feedback.along_axes(self._indices, -self._wrenches()),)


@dataclass(frozen=True)
class WristWrenchConfig(SensorConfig):
    """Options of `wrist_wrench`.

    Attributes:
        arm: Name of the arm; the main one if empty.
        tare: Whether the weight of the hand is taken off: of all that the robot's own model has
            beyond the wrist, in any posture.
        tare_inertia: Whether the force that the hand's own motion needs is taken off as well, so that
            a hand that is swung without a load reads zero.
        about: Whether the torque is about the origin of the wrist's link or of the tool's frame.
    """

    arm: str = ""
    tare: bool = False
    tare_inertia: bool = False
    about: Literal["wrist", "tool"] = "wrist"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tare_inertia and not self.tare:
            raise ConfigError("tare_inertia without tare: the weight would stay")


class WristWrench(Sensor):
    """Force [N] and torque [N·m] that the hand puts on the arm, felt in front of the wrist's link.

    Channels: `force` and `torque`, three values each, in the axes of the tool's frame (z forward, x up
    in the hand), about the origin of the wrist's link or of the tool. The sign is that of force-torque
    sensors in ROS: what the outside does to the hand. A weight of 1 kg in the hand reads 9.81 N
    downward; a table that the hand presses on reads upward. All beyond the wrist is felt: weight,
    inertia, contacts, and what is held, be it bonded or by friction. Before the first physics step of
    an episode it is the weight of the hand, or nothing with `tare`.
    """

    Config = WristWrenchConfig
    config: WristWrenchConfig

    def links(self, agent: Agent) -> Sequence[str]:
        # All of an arm that does not move would melt together.
        arm, robot = self._arm(agent)
        return wrist_link(robot, self.config.arm), arm.tool_link

    def _arm(self, agent: Agent) -> tuple[ArmConfig, Robot]:
        if not isinstance(agent, Robot):
            raise ConfigError(f"sensor {self.config.name!r}: {agent.name!r} is not a robot")
        name = self.config.arm or agent.config.main_arm
        check_name(f"arm of {agent.name!r}", name, agent.config.arms)
        return agent.config.arms[name], agent

    def bind(self, world: World, agent: Agent) -> None:
        (arm, robot), body = self._arm(agent), agent.body
        self._world, self._body = world, body
        self._wrist = body.link_index(wrist_link(robot, self.config.arm))
        if self._wrist < 0:
            raise ConfigError(f"sensor {self.config.name!r}: the wrist cannot be the robot's base")
        self._tool = body.link_index(arm.tool_link)
        self._tool_in_link = frame(arm.tool_at, arm.tool_rpy_deg)
        body.feedback.enable([self._wrist])
        self._weight = OwnWeight(body, [self._wrist])
        self._motion = OwnMotion(body, body.carried_by(self._wrist))
        self.watches = self.config.tare_inertia
        self.reset()

    def reset(self) -> None:
        self._begun = self._world.step_count
        self._motion.reset()

    def after_substep(self) -> None:
        self._motion.after_substep()

    def channels(self) -> Sequence[Channel]:
        return Channel("force", "N", (3,)), Channel("torque", "N·m", (3,))

    def measure(self) -> Sequence[Array]:
        felt = self._felt()
        wrist = self._body.link_pose(self._wrist)
        tool = self._body.link_pose(self._tool) @ self._tool_in_link
        tool_in_wrist = wrist.inverse() @ tool
        force, torque = felt[:3], felt[3:]
        if self.config.about == "tool":
            torque = torque - np.cross(tool_in_wrist.position, force)
        turn = matrix_from_quaternion(tool_in_wrist.quaternion).T
        return turn @ force, turn @ torque

    def _felt(self) -> Array:
        """Return the wrench in the frame of the wrist's link, tared if so wished, shape [6]."""
        if self._world.step_count == self._begun:  # what Bullet tells is of the last episode
            return np.zeros(6) if self.config.tare else self._weight.wrenches()[0]
        felt = self._body.feedback.wrenches([self._wrist])[0]
        if self.config.tare:
            felt = felt - self._weight.wrenches()[0]
        if self.config.tare_inertia:
            felt = felt + self._motion.wrench(
                self._body.link_pose(self._wrist), self._world.physics_dt
            )
        return felt
