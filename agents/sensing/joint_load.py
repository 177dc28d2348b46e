"""What joints transmit: all six components, or the torque about their axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, conjugate, rotate
from rcare_marl.world import GRAVITY, World

from ..agent import Agent
from ..robots.robot import Robot
from .sensor import Channel, Sensor, SensorConfig


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


class OwnWeight:
    """The weight of what links carry of their own body, as those joints would feel it at rest."""

    def __init__(self, body: Body, links: Sequence[int]) -> None:
        """Read the masses of all that `links` carry."""
        self._body, self._links = body, tuple(links)
        self._carried = [body.carried_by(link) for link in links]
        self._all = sorted({index for carried in self._carried for index in carried})
        self._masses = {index: body.mass(index) for index in self._all}

    def wrenches(self) -> Array:
        """Return force [N] and torque [N·m] on each link in its frame, at its origin, shape [n, 6]."""
        centres = dict(zip(self._all, self._body.link_centres(self._all), strict=True))
        out = np.empty((len(self._links), 6))
        for row, link, carried in zip(out, self._links, self._carried, strict=True):
            pose = self._body.link_pose(link)
            mass = sum(self._masses[index] for index in carried)
            moment = sum((self._masses[i] * centres[i] for i in carried), np.zeros(3))
            weight = np.array((0.0, 0.0, -GRAVITY))
            arm = moment - mass * np.asarray(pose.position)
            back = conjugate(pose.quaternion)
            row[:3] = rotate(back, mass * weight)
            row[3:] = rotate(back, np.cross(arm, weight))
        return out


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
