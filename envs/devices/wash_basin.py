"""A wash basin with water in it, as one carries it to a bed; it can be pushed and tipped."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rcare_marl.pose import Array
from rcare_marl.urdf import Model, Shape

from .assembly import Assembly, weigh
from .device import Device, Frame

# Our own choices, in the size of common wash basins.
SIZE = (0.32, 0.25, 0.105)  # [m] outside
WALL = 0.006  # [m]
WATER = 0.075  # [m] from the floor of the basin to the water
BASIN_MASS, DENSITY = 0.6, 1000.0  # [kg] empty, [kg/m³] of the water
FRICTION = 0.6  # of plastic on a table
RGBA = {"plastic": (0.86, 0.90, 0.93, 1.0), "water": (0.45, 0.66, 0.80, 0.55)}


class WashBasin(Device):
    """A rectangular basin, z up, origin in the middle of its underside.

    The water weighs and is where it is, but does not move: things do not float on it. Tilted so far
    that it runs over the rim, all of it counts as spilled.

    Frames: `water` (middle of its surface), `rim` (middle of the plane of the rim).
    """

    _fixed = False

    @property
    def frames(self) -> Mapping[str, Frame]:
        return {
            "water": Frame((0.0, 0.0, WALL + WATER), note="middle of the surface of the water"),
            "rim": Frame((0.0, 0.0, SIZE[2]), note="middle of the plane of the rim"),
        }

    def tilt(self) -> float:
        """Return how far it leans from upright [rad]."""
        return math.acos(min(float(self.pose.matrix()[2, 2]), 1.0))

    def spills(self) -> bool:
        """Return whether it leans so far that the water runs over the rim."""
        return self.tilt() > math.atan2(SIZE[2] - WALL - WATER, 0.5 * SIZE[1] - WALL)

    def submerged(self, points: Array) -> float:
        """Return the share of points in the world [m], shape [n, 3], that are in the water."""
        pose = self.pose.matrix()
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        half = 0.5 * np.array(SIZE[:2]) - WALL
        inside = (np.abs(local[:, :2]) < half).all(axis=1)
        return float((inside & (local[:, 2] > WALL) & (local[:, 2] < WALL + WATER)).mean())

    def model(self) -> Model:
        length, width, height = SIZE
        inner = (length - 2 * WALL, width - 2 * WALL)
        water_mass = DENSITY * inner[0] * inner[1] * WATER
        made = Assembly("basin", BASIN_MASS + water_mass)
        root = made.parts["basin"]
        sides = [((0.0, 0.0, 0.5 * WALL), (length, width, WALL))]
        # The walls stand on the floor of the basin: it rests on four points, not on twenty.
        middle, tall = 0.5 * (height + WALL), height - WALL
        for sign in (1, -1):
            sides += [
                ((sign * 0.5 * (length - WALL), 0.0, middle), (WALL, width, tall)),
                ((0.0, sign * 0.5 * (width - WALL), middle), (length, WALL, tall)),
            ]
        for at, size in sides:
            root.visual.append(Shape(kind="box", material="plastic", at=at, size=size, bevel=0.002))
            root.collision.append(Shape(kind="box", at=at, size=size))
        # Weighed with its water, which nothing touches.
        bulk = Shape(kind="box", at=(0.0, 0.0, WALL + 0.5 * WATER), size=(*inner, WATER))
        root.inertia = weigh(BASIN_MASS + water_mass, [bulk])
        surface = (0.0, 0.0, WALL + WATER - 0.001)
        root.visual.append(Shape(kind="box", material="water", at=surface, size=(*inner, 0.002)))
        return made.model("wash_basin", "own choice", RGBA)


__all__ = ["SIZE", "WashBasin"]
