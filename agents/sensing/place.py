"""Where on an agent a sensor is: a link of a robot, or a segment of a person."""

from __future__ import annotations

from dataclasses import dataclass

from rcare_marl.errors import check_name
from rcare_marl.model.urdf import Model
from rcare_marl.pose import Pose, quaternion_from_matrix

from ..agent import Agent
from ..people.body.skeleton import JOINT_INDEX, JOINTS
from ..people.human import Human
from ..robots.mobile_base import with_base
from ..robots.robot import Robot
from ..robots.robot_config import ZERO, RobotConfig, Triple, frame
from ..robots.robot_model import robot_model


@dataclass(frozen=True)
class Place:
    """A frame on a link of a spawned body.

    Attributes:
        link: Link index.
        pose: The frame, in the frame of the link.
    """

    link: int
    pose: Pose = Pose()


def default_link(agent: Agent) -> str:
    """Return where a sensor is if nobody says: the tool of the main arm, or the head."""
    if isinstance(agent, Robot):
        return agent.config.arms[agent.config.main_arm].tool_link
    return "head"


def wrist_link(robot: Robot, arm: str = "") -> str:
    """Return the link whose joint carries the hand of an arm; of the main one if nothing is named."""
    config = robot.config
    chosen = config.arms[arm or config.main_arm]
    if chosen.wrist_link is not None:
        return chosen.wrist_link
    return _model(config).joints[chosen.joints[-1]].child


def kept_links(agent: Agent, *links: str) -> tuple[str, ...]:
    """Return those of `links` that must stay links of their own: a person's need not.

    Raises:
        UnknownNameError: If a robot has no such link.
    """
    if not isinstance(agent, Robot):
        return ()
    known = _links(agent)
    for link in links:
        check_name(f"link of {agent.name!r}", link, known)
    return links


def _links(robot: Robot) -> set[str]:
    """Return the links of a robot's model, with those that are added where they are needed."""
    config, model = robot.config, _model(robot.config)
    if config.base is not None:
        model = with_base(model, config.base, is_driven=True)
    own_tools = (f"{name}_tool_frame" for name, arm in config.arms.items() if arm.has_own_tool)
    return {*model.links, *own_tools}


def _model(config: RobotConfig) -> Model:
    return robot_model(config.model, urdf=config.urdf)


def find_place(agent: Agent, link: str = "", at: Triple = ZERO, rpy_deg: Triple = ZERO) -> Place:
    """Return a frame on a spawned agent.

    Args:
        agent: The agent.
        link: A link of a robot, or an SMPL-X joint of a person for the segment behind it, whose frame
            has x to the left, y up and z forward in the T-pose; `default_link` if empty.
        at: Origin of the frame in that of the link [m].
        rpy_deg: Its turn there, fixed-axis roll, pitch, yaw [degrees].

    Raises:
        UnknownNameError: If the agent has no such link.
    """
    name, local = link or default_link(agent), frame(at, rpy_deg)
    if not isinstance(agent, Human):
        return Place(agent.body.link_index(name), local)
    check_name("segment of a person", name, JOINTS)
    carrier = agent.frames[JOINT_INDEX[name]]
    turn = tuple(quaternion_from_matrix(carrier.rotation).tolist())
    return Place(carrier.link, Pose(tuple(carrier.offset.tolist()), turn) @ local)
