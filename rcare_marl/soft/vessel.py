"""A vessel for fluids: a round bottom and a wall that widens or narrows upwards."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..body import Body
from ..errors import ConfigError
from ..pose import Pose, Vector, conjugate, matrix_from_quaternion, rotate
from . import vessel_kernel as kernel

Array = npt.NDArray[np.float64]


class Vessel:
    """The inside of a cup on a link, as fluids know it: a signed distance, open at the top.

    Its frame: origin in the middle of the bottom's inside, z up the axis.

    Attributes:
        body: The body that carries it.
        link: Its link; -1 for the base.
        bottom_radius: Of the inside, at the bottom [m].
        rim_radius: Of the inside, at the rim [m].
        depth: From the inside of the bottom to the rim [m].
        wall: Thickness of wall and bottom [m].
    """

    def __init__(
        self,
        body: Body,
        link: int,
        pose: Pose,
        *,
        bottom_radius: float,
        rim_radius: float,
        depth: float,
        wall: float,
    ) -> None:
        """Take sizes [m] and the pose of the vessel's frame in that of the link.

        Raises:
            ConfigError: If a size is not above 0.
        """
        sizes = (bottom_radius, rim_radius, depth, wall)
        if not min(sizes) > 0:
            raise ConfigError(f"radii, depth and wall of a vessel must be above 0, got {sizes}")
        self.body, self.link, self.pose = body, link, pose
        self.bottom_radius, self.rim_radius = bottom_radius, rim_radius
        self.depth, self.wall = depth, wall
        at = body.inertial_pose(link).inverse() @ pose
        self._place = np.array((*at.position, *at.quaternion))

    @property
    def volume(self) -> float:
        """What it holds up to the rim [m³]."""
        a, b = self.bottom_radius, self.rim_radius
        return float(np.pi * self.depth * (a * a + a * b + b * b) / 3)

    def level(self, volume: float) -> float:
        """Return how high a volume [m³] stands in it [m].

        Raises:
            ConfigError: If it holds less.
        """
        if not 0 <= volume <= self.volume:
            raise ConfigError(
                f"the vessel holds {1e6 * self.volume:.0f} ml, got {1e6 * volume:.0f} ml"
            )
        slope = (self.rim_radius - self.bottom_radius) / self.depth
        heights = np.linspace(0.0, self.depth, 1001)
        a, b = self.bottom_radius, self.bottom_radius + slope * heights
        volumes = np.pi * heights * (a * a + a * b + b * b) / 3
        return float(np.interp(volume, volumes, heights))

    def frame(self) -> Pose:
        """Return its frame in the world: z up its axis."""
        return self.body.link_pose(self.link) @ self.pose

    def holds(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which points of the world [m], shape [n, 3], are in it, shape [n]."""
        frame = self.frame()
        local = (points - np.array(frame.position)) @ matrix_from_quaternion(frame.quaternion)
        slope = (self.rim_radius - self.bottom_radius) / self.depth
        across = np.hypot(local[:, 0], local[:, 1])
        up = local[:, 2]
        inside: npt.NDArray[np.bool_] = (
            (up > -self.wall) & (up < self.depth) & (across < self.bottom_radius + slope * up)
        )
        return inside

    def rim_point(self, direction: Vector) -> Array:
        """Return the point of the rim that lies farthest in a direction of the world [m], shape [3]."""
        frame = self.frame()
        x, y, _ = rotate(conjugate(frame.quaternion), direction)
        length = max(float(np.hypot(x, y)), 1e-9)
        radius = self.rim_radius / length
        return rotate(frame.quaternion, (radius * x, radius * y, self.depth)) + frame.position

    def write(self, row: Array, state: Array) -> None:
        """Write its row of the kernel's table, for the state of its link, see `collider`."""
        kernel.set_vessel(
            state, self._place, self.bottom_radius, self.rim_radius, self.depth, self.wall, row
        )
