"""Walls between cells: where rooms touch each other or the outside, and straight walls through all."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .layout_tree import HALF, Cell
from .plan import INNER_WALL, OUTER_WALL, OUTSIDE, Opening, OpeningKind

BEYOND = round(1000 * OUTER_WALL) - HALF  # [mm] of an outer wall beyond the line of the cells
Grid = NDArray[np.bool_]
_FREE, _WALL, _ROOM = -2, -1, 0  # rooms are counted from 0


@dataclass(frozen=True)
class Panel:
    """A stretch of wall between one room and another, or the outside.

    Attributes:
        rooms: Names; the second is `outside` for outer walls.
        axis: Direction in which it runs.
        area: Its floor [mm].
        normal: Direction from the wall into the first room.
    """

    rooms: tuple[str, str]
    axis: Literal["x", "y"]
    area: Cell
    normal: tuple[int, int]

    @property
    def span(self) -> tuple[int, int]:
        """Where it begins and ends along its axis [mm]."""
        return self.area.span(self.axis)

    def opening(self, name: str, kind: OpeningKind, low: int, high: int, **look: Any) -> Opening:
        """Return an opening in it from `low` to `high` [mm]; `look` has the other fields."""
        near, far = self.area.across(self.axis)
        middle, across = (low + high) / 2000, (near + far) / 2000
        return Opening(
            name,
            kind,
            axis=self.axis,
            centre=(middle, across) if self.axis == "x" else (across, middle),
            width=(high - low) / 1000,
            thickness=(far - near) / 1000,
            **{"rooms": self.rooms, "normal": self.normal} | look,
        )

    @property
    def side(self) -> str:
        """The side of the first room on which it stands."""
        return {(0, -1): "north", (0, 1): "south", (1, 0): "west", (-1, 0): "east"}[self.normal]


@dataclass(frozen=True)
class Run:
    """A straight wall, through all stretches in line [mm]."""

    area: Cell
    axis: Literal["x", "y"]
    is_outer: bool


class Masonry:
    """All walls of a house, found on the grid of all lines.

    Attributes:
        insides: Floor of each room [mm].
        panels: Stretches of wall between rooms.
        runs: Straight walls; they meet and never overlap.
        outline: Rectangles that fill the house with its walls, without overlap [mm].
    """

    def __init__(self, cells: dict[str, Cell]) -> None:
        self.insides = {name: cell.grown(-HALF) for name, cell in cells.items()}
        offsets = (-BEYOND, -HALF, HALF, BEYOND)
        self._xs = sorted(
            {x + o for cell in cells.values() for x in (cell.x0, cell.x1) for o in offsets}
        )
        self._ys = sorted(
            {y + o for cell in cells.values() for y in (cell.y0, cell.y1) for o in offsets}
        )
        self._names = list(cells)
        self._grid = np.full((len(self._xs) - 1, len(self._ys) - 1), _FREE, dtype=np.int32)
        for cell in cells.values():
            self._grid[self._slices(cell.grown(BEYOND))] = _WALL
        for number, inside in enumerate(self.insides.values()):
            self._grid[self._slices(inside)] = number
        self.panels = [panel for name in cells for panel in self._panels(name)]
        self.outline = _rectangles(self._grid != _FREE, self._xs, self._ys)
        self.runs = self._runs()

    def run_of(self, panel: Panel) -> Run:
        """Return the straight wall that a stretch is part of."""
        for run in self.runs:
            if run.axis == panel.axis and run.area.overlaps(panel.area):
                return run
        raise AssertionError(f"no wall holds {panel}")

    def _slices(self, area: Cell) -> tuple[slice, slice]:
        return (
            slice(bisect_left(self._xs, area.x0), bisect_left(self._xs, area.x1)),
            slice(bisect_left(self._ys, area.y0), bisect_left(self._ys, area.y1)),
        )

    def _panels(self, name: str) -> list[Panel]:
        """Stretches of wall round a room; between two rooms only those north and east of it."""
        inside, out = self.insides[name], []
        sides = {"north": (0, 1), "east": (1, 0), "south": (0, -1), "west": (-1, 0)}
        for step in sides.values():
            axis: Literal["x", "y"] = "x" if step[0] == 0 else "y"
            lines = self._xs if axis == "x" else self._ys
            low, high = inside.span(axis)
            found: list[tuple[str, int, int]] = []
            for k in range(bisect_left(lines, low), bisect_left(lines, high)):
                other = self._behind(inside, step, lines[k])
                if other is None or (other != OUTSIDE and step in ((0, -1), (-1, 0))):
                    continue
                if found and found[-1][0] == other and found[-1][2] == lines[k]:
                    found[-1] = other, found[-1][1], lines[k + 1]
                else:
                    found.append((other, lines[k], lines[k + 1]))
            for other, start, end in found:
                area = _behind(
                    inside, step, start, end, 1000 * (INNER_WALL, OUTER_WALL)[other == OUTSIDE]
                )
                out.append(Panel((name, other), axis, area, (-step[0], -step[1])))
        return out

    def _behind(self, inside: Cell, step: tuple[int, int], at: int) -> str | None:
        """What lies behind the wall of a room at a place; None where another wall runs into it."""
        for other, depth in (("", 1000 * INNER_WALL), (OUTSIDE, 1000 * OUTER_WALL)):
            strip = _behind(inside, step, at, at + 1, depth)
            i, j = bisect_left(self._xs, strip.x0 + 1) - 1, bisect_left(self._ys, strip.y0 + 1) - 1
            line = self._grid[i, :] if step[0] == 0 else self._grid[:, j]
            places = self._ys if step[0] == 0 else self._xs
            low, high = strip.across("x" if step[0] == 0 else "y")
            first, last = bisect_left(places, low), bisect_left(places, high)
            if last >= len(places) or places[last] != high or (line[first:last] != _WALL).any():
                continue
            k = last if sum(step) > 0 else first - 1
            value = int(line[k]) if 0 <= k < len(line) else _FREE
            if not other and value >= _ROOM:
                return self._names[value]
            if other and value == _FREE:
                return other
        return None

    def _runs(self) -> tuple[Run, ...]:
        """Lay walls, each as far as it goes straight: outer before inner, then long before short."""
        left, out = self._grid == _WALL, []
        straight = {panel: self._straight(left, panel) for panel in self.panels}
        for panel in sorted(
            self.panels,
            key=lambda p: (p.rooms[1] != OUTSIDE, -_length(straight[p], p.axis), p.axis, p.area),
        ):
            if not left[self._slices(panel.area)].all():
                continue  # within a wall laid before
            area = self._straight(left, panel)
            if panel.rooms[1] != OUTSIDE:
                area = self._trimmed(area, panel)
            left[self._slices(area)] = False
            out.append(Run(area, panel.axis, panel.rooms[1] == OUTSIDE))
        for area in _rectangles(left, self._xs, self._ys):
            axis: Literal["x", "y"] = "x" if area.x1 - area.x0 >= area.y1 - area.y0 else "y"
            out.append(Run(area, axis, self._is_outer(area)))
        return tuple(out)

    def _straight(self, left: Grid, panel: Panel) -> Cell:
        """Return a stretch of wall, made longer both ways as far as there is wall left."""
        i, j = self._slices(panel.area)
        if panel.axis == "x":
            i = _widened(np.asarray(left[:, j].all(axis=1)), i)
        else:
            j = _widened(np.asarray(left[i, :].all(axis=0)), j)
        return Cell(self._xs[i.start], self._ys[j.start], self._xs[i.stop], self._ys[j.stop])

    def _trimmed(self, area: Cell, panel: Panel) -> Cell:
        """Return a wall without an end that juts into a wall which goes on past it on both sides."""
        (low, high), (near, far) = area.span(panel.axis), area.across(panel.axis)
        thick = far - near
        ends = {low: (low, low + thick), high: (high - thick, high)}
        for end, (a, b) in ends.items():
            beyond = a >= panel.span[1] if end == high else b <= panel.span[0]
            if not beyond:
                continue
            sides = (near - 1, near), (far, far + 1)
            if all(self._is_wall(Cell.of(panel.axis, (a, b), side)) for side in sides):
                low, high = (low, a) if end == high else (b, high)
        return Cell.of(panel.axis, (low, high), (near, far))

    def _is_wall(self, strip: Cell) -> bool:
        """Return whether a strip, which need not end on lines, is wall all over."""
        i = slice(bisect_right(self._xs, strip.x0) - 1, bisect_left(self._xs, strip.x1))
        j = slice(bisect_right(self._ys, strip.y0) - 1, bisect_left(self._ys, strip.y1))
        return bool((self._grid[i, j] == _WALL).all())

    def _is_outer(self, area: Cell) -> bool:
        i, j = self._slices(area)
        around = np.pad(self._grid, 1, constant_values=_FREE)[
            i.start : i.stop + 2, j.start : j.stop + 2
        ]
        return bool((around == _FREE).any())


def _length(area: Cell, axis: str) -> int:
    low, high = area.span(axis)
    return high - low


def _behind(inside: Cell, step: tuple[int, int], start: int, end: int, depth: float) -> Cell:
    """Return the strip of a depth [mm] behind one side of a room."""
    axis, far = "x" if step[0] == 0 else "y", round(depth)
    low, high = inside.across(axis)
    return Cell.of(axis, (start, end), (high, high + far) if sum(step) > 0 else (low - far, low))


def _widened(free: Grid, part: slice) -> slice:
    """Return a slice grown both ways as far as all is free."""
    start, stop = part.start, part.stop
    while start > 0 and free[start - 1]:
        start -= 1
    while stop < len(free) and free[stop]:
        stop += 1
    return slice(start, stop)


def _rectangles(mask: Grid, xs: list[int], ys: list[int]) -> tuple[Cell, ...]:
    """Return rectangles without overlap that fill what is marked on a grid."""
    left, out = mask.copy(), []
    while left.any():
        i, j = (int(k) for k in np.argwhere(left)[0])
        columns = _widened(left[i, :], slice(j, j + 1))
        rows = _widened(left[:, columns].all(axis=1), slice(i, i + 1))
        left[rows, columns] = False
        out.append(Cell(xs[rows.start], ys[columns.start], xs[rows.stop], ys[columns.stop]))
    return tuple(out)
