"""What a robot holds upright: how it is turned, and the feeding spoon."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, Vector, quaternion_from_matrix

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
