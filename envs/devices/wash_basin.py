"""A wash basin with water in it, as one carries it to a bed; it can be pushed and tipped."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.pose import Array

from .device import Device


class WashBasin(Device):
    """A rectangular basin, z up, origin in the middle of its underside.

    The water weighs and is where it is, but does not move: things do not float on it. Tilted so far
    that it runs over the rim, all of it counts as spilled.

    Frames: `water` (middle of its surface), `rim` (middle of the plane of the rim). Figures: `length`,
    `width`, `height`, `wall`, and `water`, its depth.
    """

    def __init__(self, source: str = "wash_basin") -> None:
        """Make the basin of that name or YAML file; UnknownNameError if it lacks one of the figures."""
        super().__init__(source)
        figures = ("length", "width", "height", "wall", "water")
        self._length, self._width, self._height, self._wall, self._deep = map(
            self.model.figure, figures
        )

    def tilt(self) -> float:
        """Return how far it leans from upright [rad]."""
        return math.acos(min(float(self.pose.matrix()[2, 2]), 1.0))

    def spills(self) -> bool:
        """Return whether it leans so far that the water runs over the rim."""
        freeboard = self._height - self._wall - self._deep
        return self.tilt() > math.atan2(freeboard, 0.5 * self._width - self._wall)

    def submerged(self, points: Array) -> float:
        """Return the share of points in the world [m], shape [n, 3], that are in the water."""
        pose = self.pose.matrix()
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        half = 0.5 * np.array((self._length, self._width)) - self._wall
        inside = (np.abs(local[:, :2]) < half).all(axis=1)
        low, high = self._wall, self._wall + self._deep
        return float((inside & (local[:, 2] > low) & (local[:, 2] < high)).mean())
