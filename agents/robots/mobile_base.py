"""A base that drives on a flat floor: three joints in its plane, with the force of its wheels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import Joint, Link, Model
from rcare_marl.pose import Array, Vector

from .robot_config import BASE_JOINTS, BaseConfig

ROOM = 100.0  # [m] that a base may drive each way; any house is smaller
FLOOR_LINK = "floor_frame"  # root of a robot that drives: where it stood at the start


def with_base(model: Model, config: BaseConfig, *, is_driven: bool) -> Model:
    """Return `model` on joints that slide and turn on the floor.

    Args:
        model: The robot.
        config: Its base.
        is_driven: Whether it drives by itself; else it only helps an arm, within `config.reach`.

    Raises:
        ConfigError: If the model has links or joints of these names already.
    """
    frames = (FLOOR_LINK, "base_slide_x", "base_slide_y")
    taken = [n for n in frames if n in model.links] + [n for n in BASE_JOINTS if n in model.joints]
    if taken:
        raise ConfigError(f"{model.name} already has {taken}, which its base would add")
    slide, turn = (ROOM, math.inf) if is_driven else config.reach
    links = {name: Link() for name in frames} | model.links
    ends = (*frames, model.root)
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    joints = {}
    for i, name in enumerate(BASE_JOINTS):
        way = turn if name == "base_turn" else slide
        joints[name] = Joint(
            kind="prismatic" if i < 2 else "continuous" if math.isinf(way) else "revolute",
            parent=ends[i],
            child=ends[i + 1],
            axis=axes[i],
            lower=0.0 if math.isinf(way) else -way,
            upper=0.0 if math.isinf(way) else way,
            effort=config.force if i < 2 else config.torque,
            velocity=config.speed if i < 2 else config.turn,
        )
    return replace(model, links=links, joints=joints | model.joints)


class MobileBase:
    """The base of a spawned robot.

    Attributes:
        config: Its data.
    """

    def __init__(self, body: Body, config: BaseConfig) -> None:
        self.config, self._body = config, body
        self._indices = body.indices(BASE_JOINTS)
        self._limits = [config.force, config.force, config.torque]

    def place(self) -> Array:
        """Return (x, y, heading) from where it was spawned [m, m, rad], shape [3]."""
        x, y, heading = self._body.joint_states(self._indices)[0]
        return np.array((x, y, math.remainder(heading, 2 * math.pi)))

    def velocity(self) -> Array:
        """Return (forward, left, turning) in its own frame [m/s, m/s, rad/s], shape [3]."""
        (_, _, heading), (vx, vy, turning) = self._body.joint_states(self._indices)
        c, s = math.cos(heading), math.sin(heading)
        return np.array((c * vx + s * vy, c * vy - s * vx, turning))

    def drive(self, velocity: Vector) -> None:
        """Drive at (forward, left, turning) in its own frame, for a physics step."""
        forward, left, turning = (float(v) for v in velocity)
        heading = self._body.joint_states(self._indices[2:])[0][0]
        c, s = math.cos(heading), math.sin(heading)
        wanted = [c * forward - s * left, s * forward + c * left, turning]
        self._body.drive_velocities(self._indices, wanted, self._limits)

    def teleport(self, x: float = 0.0, y: float = 0.0, heading: float = 0.0) -> None:
        """Put it at (x, y) [m] and `heading` [rad] from where it was spawned, at rest."""
        self._body.set_joints(self._indices, (x, y, heading))
