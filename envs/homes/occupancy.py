"""Where the floor of a home is free: a grid, and how far each place is from what stands there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import ndimage  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from ..rectangle import Rectangle

CELL = 0.025  # [m]; own choice
BORDER = 1.0  # [m] of ground around the house that the grid covers as well; own choice

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Obstacle:
    """Something that stands on the floor.

    Attributes:
        area: The floor that it takes.
        name: What it is.
        room: Where it stands; empty for walls and doors.
    """

    area: Rectangle
    name: str
    room: str = ""


class Occupancy:
    """A map of free floor.

    Attributes:
        obstacles: What stands there.
        cell: Width of a cell [m].
        origin: Lower corner of the first cell [m].
        free: Whether the middle of each cell is free, shape [rows along y, columns along x].
    """

    def __init__(
        self, bounds: Rectangle, obstacles: Sequence[Obstacle], *, cell: float = CELL
    ) -> None:
        """Draw the map.

        Args:
            bounds: What to cover.
            obstacles: What stands there.
            cell: Width of a cell [m].

        Raises:
            ConfigError: If `cell` is not positive.
        """
        if not cell > 0:
            raise ConfigError(f"a cell must have a positive width, got {cell} m")
        self.obstacles, self.cell = tuple(obstacles), cell
        self.origin = (bounds.x0, bounds.y0)
        self._corners = np.array([o.area.row for o in self.obstacles]).reshape(-1, 4)
        shape = (math.ceil(bounds.depth / cell), math.ceil(bounds.width / cell))
        self.free: Mask = np.ones(shape, np.bool_)
        for obstacle in self.obstacles:
            self.free[self.window(obstacle.area)] = False

    def window(self, area: Rectangle) -> tuple[slice, slice]:
        """Return the rows and columns whose cells have their middle in `area`."""
        x0, y0 = self.origin
        low = (
            math.ceil((area.y0 - y0) / self.cell - 0.5),
            math.ceil((area.x0 - x0) / self.cell - 0.5),
        )
        high = (
            math.ceil((area.y1 - y0) / self.cell - 0.5),
            math.ceil((area.x1 - x0) / self.cell - 0.5),
        )
        rows, columns = (
            slice(min(max(a, 0), n), min(max(b, 0), n))
            for a, b, n in zip(low, high, self.free.shape, strict=True)
        )
        return rows, columns

    def point(self, row: int, column: int) -> tuple[float, float]:
        """Return the middle of a cell [m]."""
        x0, y0 = self.origin
        return x0 + (column + 0.5) * self.cell, y0 + (row + 0.5) * self.cell

    @cached_property
    def distances(self) -> Array:
        """How far the middle of each cell is from the nearest taken cell [m], to half a cell."""
        grown = np.pad(self.free, 1, constant_values=True)
        far: Array = ndimage.distance_transform_edt(grown)[1:-1, 1:-1]
        return np.asarray(np.maximum(far - 0.5, 0.0) * self.cell)

    def clearance(self, x: float, y: float) -> float:
        """Return how far a point [m] is from the nearest obstacle, exactly; 0 inside of one [m]."""
        if not len(self._corners):
            return math.inf
        x0, y0, x1, y1 = self._corners.T
        dx = np.maximum(np.maximum(x0 - x, x - x1), 0.0)
        dy = np.maximum(np.maximum(y0 - y, y - y1), 0.0)
        return float(np.sqrt((dx * dx + dy * dy).min()))

    def free_circle(self, area: Rectangle) -> tuple[float, tuple[float, float]]:
        """Return diameter [m] and middle [m] of the largest free circle within `area`."""
        rows, columns = self.window(area)
        part = np.pad(self.free[rows, columns], 1, constant_values=False)
        far = ndimage.distance_transform_edt(part)[1:-1, 1:-1]
        if not far.size or not far.any():
            return 0.0, area.centre
        row, column = np.unravel_index(int(far.argmax()), far.shape)
        x, y = self.point(rows.start + int(row), columns.start + int(column))
        inside = min(x - area.x0, area.x1 - x, y - area.y0, area.y1 - y)
        return 2 * min(self.clearance(x, y), inside), (x, y)
