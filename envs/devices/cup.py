"""What a robot holds upright: the feeding spoon, and a drinking cup that holds fluid."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, WorldError
from rcare_marl.pose import (
    Array,
    Pose,
    Vector,
    multiply,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
    rotate,
)
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.soft.vessel import Vessel
from rcare_marl.world import World

from .device import Device


def facing(direction: Vector) -> Array:
    """Return how a thing held level is turned, x up, whose z points along `direction`, shape [4].

    Raises:
        ConfigError: If `direction` is vertical.
    """
    length = math.hypot(direction[0], direction[1])
    if length < 1e-9:
        raise ConfigError(f"what is held level cannot point along {tuple(direction)}")
    x, y = direction[0] / length, direction[1] / length
    # Columns: x up, y to the right of who looks along z, z ahead.
    return quaternion_from_matrix(np.array([[0.0, y, x], [0.0, -x, y], [1.0, 0.0, 0.0]]))


class Spoon(Device):
    """A spoon: z along the handle towards the tip, x up, origin at the grip.

    It fits a robot's tool frame: held straight, its pose in the tool is `in_tool`.

    Frames: `grip`, `bowl` (middle of its inside), `floor` (of the bowl), `tip`.
    """

    in_tool = Pose()
    up = (1.0, 0.0, 0.0)  # out of the bowl, in the spoon's frame
    facing = staticmethod(facing)

    def __init__(self, source: str = "spoon") -> None:
        """Make the spoon of that name or YAML file."""
        super().__init__(source)


class Cup(Device):
    """A cup: z from the handle to its axis, x up, origin at the grip.

    It fits a robot's tool frame: held straight, its pose in the tool is `in_tool`; to tilt it to the side
    is then to turn the tool about its own axis.

    Frames: `grip`, `inside` (middle of the bottom, z up the axis), `middle` (of the cup). Figures of the
    inside: `bottom_radius`, `rim_radius`, `depth`, and `wall`.
    """

    in_tool = Pose()
    up = (1.0, 0.0, 0.0)  # up the axis, in the cup's frame
    facing = staticmethod(facing)

    def __init__(self, source: str = "cup") -> None:
        """Make the cup of that name or YAML file; UnknownNameError if it lacks one of the figures."""
        super().__init__(source)
        sizes = ("bottom_radius", "rim_radius", "depth", "wall")
        self._sizes = {name: self.model.figure(name) for name in sizes}
        self._vessel: Vessel | None = None

    @property
    def vessel(self) -> Vessel:
        """Its inside, for fluids; WorldError before `spawn`."""
        if self._vessel is None:
            raise WorldError("this Cup is in no world yet: spawn it first")
        return self._vessel

    def pouring(self, rim: Vector, way: Vector, tilt: float, handle: float) -> Pose:
        """Return where the cup is when a point of its rim is at a place.

        Args:
            rim: The place [m], shape [3].
            way: From the axis of the upright cup to that point of the rim, level, shape [3].
            tilt: How far the cup is tilted that way, about that point [rad].
            handle: Angle about z from `way` to the way from the handle to the axis [rad].
        """
        bottom, _, to_axis = self.frame("inside").position
        up = np.array((0.0, 0.0, 1.0))
        aside = rotate(quaternion_from_axis_angle(up, handle), way)
        tilting = quaternion_from_axis_angle(np.cross(up, way), tilt)
        to_rim = to_axis * aside + self._sizes["rim_radius"] * np.asarray(way)
        to_rim[2] += self._sizes["depth"] + bottom
        position = np.asarray(rim) - rotate(tilting, to_rim)
        turn = multiply(tilting, facing(aside))
        return Pose(tuple(position.tolist()), tuple(turn.tolist()))

    def up_in_world(self) -> Array:
        """Return where the axis of the cup points, a unit vector in the world, shape [3]."""
        return rotate(self.pose.quaternion, self.up)

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        self._vessel = Vessel(body, -1, self.frame("inside"), **self._sizes)
        SoftWorld.of(world).add_vessel(self._vessel)
        return body
