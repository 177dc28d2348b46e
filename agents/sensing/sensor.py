"""What every sensor has in common, and where on an agent it is: a link, or a segment of a person."""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.model.urdf import Model
from rcare_marl.pose import Pose, quaternion_from_matrix
from rcare_marl.rendering.shot import Light
from rcare_marl.world import World

from ..agent import Agent
from ..people.body.skeleton import JOINT_INDEX, JOINTS
from ..people.human import Human
from ..robots.mobile_base import with_base
from ..robots.robot import Robot
from ..robots.robot_config import ZERO, RobotConfig, Triple, frame
from ..robots.robot_model import robot_model

# Of noise, in the unit of a channel, our own choice: above any reading, far below what float32 holds.
LOUDEST = 1e6


@dataclass(frozen=True)
class SensorConfig:
    """The options of a sensor, off by default: a perfect sensor.

    Attributes:
        name: Prefix of its observables, unique in an agent, not empty.
        rate: Samples a second [Hz]; between two the last one is observed. Zero samples whenever
            the agent observes.
        latency: Age of a sample when it is first observed [s].
        noise: Standard deviation of Gaussian noise on each value, in the unit of the channel, up to
            a million.
    """

    name: str
    rate: float = 0.0
    latency: float = 0.0
    noise: float = 0.0

    def __post_init__(self) -> None:
        if not self.name:
            raise ConfigError("a sensor needs a name, got ''")
        for option in ("rate", "latency", "noise"):
            value = getattr(self, option)
            if not 0 <= value < math.inf:
                raise ConfigError(f"sensor {self.name!r}: {option} must be 0 or more, got {value}")
        if self.noise > LOUDEST:
            raise ConfigError(
                f"sensor {self.name!r}: noise must be {LOUDEST:g} or less, got {self.noise:g}"
            )

    def check_once(self, option: str, names: Sequence[str]) -> None:
        """Raise ConfigError if an option names something twice."""
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConfigError(f"sensor {self.name!r}: {option} names {', '.join(twice)} twice")


@dataclass(frozen=True)
class Channel:
    """One kind of reading of a sensor.

    Attributes:
        name: What it is, such as `force`; the observable is called `<sensor>_<channel>`.
        unit: SI unit of a value.
        shape: Shape of a reading.
        is_array: Whether it stays an array of its own in the observation, as pictures do, or joins
            the flat vector.
        dtype: Kind of number.
        low: Least value.
        high: Greatest value.
        is_noisy: Whether `noise` applies (it does not to labels).
    """

    name: str
    unit: str
    shape: tuple[int, ...]
    is_array: bool = False
    dtype: Literal["float32", "uint8", "int32"] = "float32"
    low: float = -math.inf
    high: float = math.inf
    is_noisy: bool = True


class Sensor(abc.ABC):
    """Measures the world around, on or in an agent. It reads the physics and never changes it.

    Attributes:
        Config: Class of its options.
        config: Its options.
        watches: Whether `after_substep` must be called after every physics step.
    """

    Config: ClassVar[type[SensorConfig]] = SensorConfig
    config: SensorConfig
    watches: bool = False

    def __init__(self, config: SensorConfig) -> None:
        self.config = config

    def links(self, agent: Agent) -> Sequence[str]:
        """Return the links of `agent` that must stay links of their own; asked before `spawn`."""
        return ()

    @abc.abstractmethod
    def bind(self, world: World, agent: Agent) -> None:
        """Take hold of the spawned agent, once; raises UnknownNameError for what it lacks."""

    @abc.abstractmethod
    def channels(self) -> Sequence[Channel]:
        """Return what it measures, once bound."""

    @abc.abstractmethod
    def measure(self) -> Sequence[npt.NDArray[Any]]:
        """Return the true present readings, one a channel."""

    def disturb(
        self, readings: Sequence[npt.NDArray[Any]], rng: np.random.Generator
    ) -> Sequence[npt.NDArray[Any]]:
        """Return readings that `measure` has just given, with noise; the suite calls it then."""
        if not self.config.noise:
            return readings
        return [
            reading + rng.normal(0.0, self.config.noise, reading.shape)
            if channel.is_noisy
            else reading
            for channel, reading in zip(self.channels(), readings, strict=True)
        ]

    def reset(self) -> None:
        """Clear any memory of the last episode."""

    def misplace(self, error: Pose, light: Light) -> bool:
        """Take pictures from an `error` beside where their place is believed to be, in another light.

        Returns:
            Whether it takes any.
        """
        return False

    def after_substep(self) -> None:
        """Look at the world after a physics step, for what is integrated or differentiated."""

    def close(self) -> None:
        """Free what the sensor holds; safe to call twice."""


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
