"""Rectangles on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.pose import Array, Pose, rotate


@dataclass(frozen=True)
class Rectangle:
    """A rectangle on the floor with its sides along x and y [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    def __post_init__(self) -> None:
        if not (self.x0 <= self.x1 and self.y0 <= self.y1):
            raise ValueError(f"the corners of {self} are the wrong way round")

    @staticmethod
    def around(areas: Sequence[Rectangle]) -> Rectangle:
        """Return the rectangle round some."""
        return Rectangle(
            min(a.x0 for a in areas),
            min(a.y0 for a in areas),
            max(a.x1 for a in areas),
            max(a.y1 for a in areas),
        )

    @staticmethod
    def of(axis: str, along: tuple[float, float], across: tuple[float, float]) -> Rectangle:
        """Return the rectangle of two extents, along an axis and across it [m]."""
        (a, b), (c, d) = along, across
        return Rectangle(a, c, b, d) if axis == "x" else Rectangle(c, a, d, b)

    def span(self, axis: str) -> tuple[float, float]:
        """Return its extent along an axis [m]."""
        return (self.x0, self.x1) if axis == "x" else (self.y0, self.y1)

    @property
    def row(self) -> Array:
        """Its lower and its upper corner, shape [4] [m]."""
        return np.array((self.x0, self.y0, self.x1, self.y1))

    @property
    def width(self) -> float:
        """Extent along x [m]."""
        return self.x1 - self.x0

    @property
    def depth(self) -> float:
        """Extent along y [m]."""
        return self.y1 - self.y0

    @property
    def area(self) -> float:
        """Area [m²]."""
        return self.width * self.depth

    @property
    def centre(self) -> tuple[float, float]:
        """Its middle [m]."""
        return 0.5 * (self.x0 + self.x1), 0.5 * (self.y0 + self.y1)

    def grown(self, by: float) -> Rectangle:
        """Return it with each side moved outwards by `by` [m]."""
        return Rectangle(self.x0 - by, self.y0 - by, self.x1 + by, self.y1 + by)

    def overlaps(self, other: Rectangle, *, by: float = 1e-9) -> bool:
        """Return whether the two share more than a rim of `by` [m]."""
        return (
            min(self.x1, other.x1) - max(self.x0, other.x0) > by
            and min(self.y1, other.y1) - max(self.y0, other.y0) > by
        )

    def contains(self, other: Rectangle, *, by: float = 1e-9) -> bool:
        """Return whether `other` lies in it, give or take `by` [m]."""
        return (
            other.x0 >= self.x0 - by
            and other.y0 >= self.y0 - by
            and other.x1 <= self.x1 + by
            and other.y1 <= self.y1 + by
        )

    def has(self, x: float, y: float) -> bool:
        """Return whether a point [m] lies in it."""
        return self.x0 <= x <= self.x1 and self.y0 <= y <= self.y1

    def without(self, hole: Rectangle) -> list[Rectangle]:
        """Return what is left where `hole` is cut out."""
        x0, y0 = max(self.x0, hole.x0), max(self.y0, hole.y0)
        x1, y1 = min(self.x1, hole.x1), min(self.y1, hole.y1)
        if x1 - x0 <= 1e-9 or y1 - y0 <= 1e-9:
            return [self]
        parts = [
            (self.x0, self.y0, x0, self.y1),
            (x1, self.y0, self.x1, self.y1),
            (x0, self.y0, x1, y0),
            (x0, y1, x1, self.y1),
        ]
        return [Rectangle(*p) for p in parts if p[2] - p[0] > 1e-9 and p[3] - p[1] > 1e-9]

    def common(self, other: Rectangle) -> Rectangle | None:
        """Return what the two share; None if that is nothing."""
        x0, y0 = max(self.x0, other.x0), max(self.y0, other.y0)
        x1, y1 = min(self.x1, other.x1), min(self.y1, other.y1)
        return Rectangle(x0, y0, x1, y1) if x0 <= x1 and y0 <= y1 else None

    def moved(self, pose: Pose) -> Rectangle:
        """Return the rectangle round it when it is carried by `pose`; exact for quarter turns."""
        corners = [
            rotate(pose.quaternion, (x, y, 0.0))
            for x in (self.x0, self.x1)
            for y in (self.y0, self.y1)
        ]
        xs = [float(corner[0]) + pose.position[0] for corner in corners]
        ys = [float(corner[1]) + pose.position[1] for corner in corners]
        return Rectangle(min(xs), min(ys), max(xs), max(ys))
