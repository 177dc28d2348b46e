"""Ways through a home for somebody of a certain width, such as a wheelchair."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, sparse  # type: ignore[import-untyped]
from scipy.sparse import csgraph  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from ..rectangle import Rectangle
from .occupancy import Mask, Occupancy

WHEELCHAIR_WIDTH = 0.66  # [m], 26 in: ADA/ABA guides of the U.S. Access Board
HAND_ROOM = 0.04  # [m] that hands on the rims need beside the chair, both together; own choice
HUG = 0.4  # [m] from what is too near, up to where a way is no better for being freer; own choice
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))


@dataclass(frozen=True, eq=False)
class Route:
    """A way between two places.

    Attributes:
        points: Shape [n, 2] [m], from start to goal.
        length: [m].
        narrowest: Free width where it is narrowest [m].
        narrowest_at: Where that is [m].
    """

    points: Array
    length: float
    narrowest: float
    narrowest_at: tuple[float, float]


class Way:
    """The floor on which something of a width can move.

    Attributes:
        width: Of what moves, with the room that it needs [m].
    """

    def __init__(self, occupancy: Occupancy, width: float = WHEELCHAIR_WIDTH + HAND_ROOM) -> None:
        """Find the floor.

        Args:
            occupancy: The map.
            width: Of what moves [m].

        Raises:
            ConfigError: If `width` is not positive.
        """
        if not width > 0:
            raise ConfigError(f"who moves must have a positive width, got {width} m")
        self.width, self._map = width, occupancy
        self._mask: Mask = occupancy.distances >= 0.5 * width
        self._labels = ndimage.label(self._mask, structure=np.ones((3, 3)))[0]

    def regions_in(self, area: Rectangle) -> set[int]:
        """Return the numbers of the connected regions that reach into `area`."""
        return set(np.unique(self._labels[self._map.window(area)]).tolist()) - {0}

    def route(self, start: Rectangle, goal: Rectangle) -> Route | None:
        """Return a short way from the freest place in `start` to that in `goal`; None if there is none.

        It keeps off walls and furniture where there is room.
        """
        shared = self.regions_in(start) & self.regions_in(goal)
        if not shared:
            return None
        ends = [self._freest(area, shared) for area in (start, goal)]
        label = self._labels[ends[0]]
        if self._labels[ends[1]] != label:
            ends[1] = (
                self._freest(goal, {int(label)}) if label in self.regions_in(goal) else ends[1]
            )
        if self._labels[ends[1]] != self._labels[ends[0]]:
            return None
        cells = self._search(self._labels == label, ends[0], ends[1])
        points = np.array([self._map.point(row, column) for row, column in cells])
        clear = np.array([self._map.clearance(x, y) for x, y in points])
        narrow = int(clear.argmin())
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        x, y = points[narrow].tolist()
        return Route(points, float(steps.sum()), 2 * float(clear[narrow]), (x, y))

    def between(
        self,
        start: tuple[float, float],
        goal: tuple[float, float],
        *,
        within: float,
        wide: float,
    ) -> Array | None:
        """Return corners of a short way, shape [n, 2] [m]; None if there is none.

        It begins and ends at the free places nearest to two points.

        Args:
            start: Where it begins [m].
            goal: Where it ends [m].
            within: How far from these it may begin and end [m].
            wide: Width that is kept free where there is room for it [m].
        """
        if not self._mask.any():
            return None
        rows, columns = first = self._nearest(start, self._mask)
        last = self._nearest(goal, self._labels == self._labels[rows, columns])
        ends = zip((start, goal), (first, last), strict=True)
        if any(math.dist(point, self._map.point(*cell)) > within for point, cell in ends):
            return None
        cells = self._search(self._labels == self._labels[rows, columns], first, last)
        kept, room = [cells[0]], np.inf
        for before, cell in itertools.pairwise(cells):
            # A corner is cut only where that comes no nearer to things than the way round it does.
            room = min(room, 0.5 * wide, self._map.distances[cell])
            if not self._sees(kept[-1], cell, room):
                kept.append(before)
                room = self._map.distances[before]
        return np.array([self._map.point(*cell) for cell in (*kept, cells[-1])])

    def _nearest(self, point: tuple[float, float], mask: Mask) -> tuple[int, int]:
        cells = np.argwhere(mask)
        at = np.array(self._map.origin)[::-1] + (cells + 0.5) * self._map.cell
        row, column = cells[((at - point[::-1]) ** 2).sum(axis=1).argmin()].tolist()
        return row, column

    def _sees(self, a: tuple[int, int], b: tuple[int, int], room: float) -> bool:
        """Return whether all cells on the straight line between two are `room` [m] from things."""
        count = 2 * max(abs(a[0] - b[0]), abs(a[1] - b[1]), 1)
        rows, columns = (np.rint(np.linspace(a[i], b[i], count + 1)).astype(int) for i in (0, 1))
        return bool((self._map.distances[rows, columns] >= room).all())

    def is_free(
        self, start: tuple[float, float], goal: tuple[float, float], *, near: float, wide: float
    ) -> bool:
        """Return whether one can go straight, `wide` [m].

        Less than `near` [m] from an end one may be as close to things as there.
        """
        length = math.dist(start, goal)
        shares = np.linspace(0.0, 1.0, max(math.ceil(2 * length / self._map.cell), 1) + 1)
        ends = [self._map.clearance(*point) for point in (start, goal)]
        for share in shares.tolist():
            x, y = (a + share * (b - a) for a, b in zip(start, goal, strict=True))
            ways = (share * length, (1 - share) * length)
            close = [end for end, way in zip(ends, ways, strict=True) if way <= near]
            if self._map.clearance(x, y) < min((0.5 * wide, *close)) - 1e-9:
                return False
        return True

    def _freest(self, area: Rectangle, labels: set[int]) -> tuple[int, int]:
        rows, columns = self._map.window(area)
        far = np.where(
            np.isin(self._labels[rows, columns], list(labels)),
            self._map.distances[rows, columns],
            -1,
        )
        row, column = np.unravel_index(int(far.argmax()), far.shape)
        return rows.start + int(row), columns.start + int(column)

    def _search(
        self, mask: Mask, start: tuple[int, int], goal: tuple[int, int]
    ) -> list[tuple[int, int]]:
        """Return the cells of the cheapest way by Dijkstra's algorithm on eight neighbours."""
        number = np.full(mask.shape, -1, np.int64)
        number[mask] = np.arange(int(mask.sum()))
        cells = np.argwhere(mask)
        # Near obstacles a step costs up to five times as much: ways lead through the middle.
        near = np.clip((self._map.distances[mask] - 0.5 * self.width) / HUG, 0.0, 1.0)
        cost = 1.0 + 4.0 * (1.0 - near) ** 2
        rows, columns, weights = [], [], []
        for dy, dx in _STEPS:
            a = number[: mask.shape[0] - dy, max(-dx, 0) : mask.shape[1] - max(dx, 0)]
            b = number[dy:, max(dx, 0) : mask.shape[1] - max(-dx, 0)]
            both = (a >= 0) & (b >= 0)
            i, j = a[both], b[both]
            rows.append(i)
            columns.append(j)
            weights.append(0.5 * math.hypot(dy, dx) * (cost[i] + cost[j]))
        graph = sparse.coo_matrix(
            (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))),
            shape=(len(cells), len(cells)),
        ).tocsr()
        first, last = int(number[start]), int(number[goal])
        _, before = csgraph.dijkstra(graph, directed=False, indices=first, return_predecessors=True)
        way = [last]
        while way[-1] != first:
            way.append(int(before[way[-1]]))
        return [(int(row), int(column)) for row, column in cells[way[::-1]]]
