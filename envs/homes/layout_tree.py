"""A floor cut into rows and columns of rooms, and the sizes that they get."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from rcare_marl.errors import ConfigError

from .plan import INNER_WALL, OUTSIDE

HALF = round(500 * INNER_WALL)  # [mm] from the line between two cells to the floor of a room


class Cell(NamedTuple):
    """A rectangle [mm]; whole numbers, so that lines which should meet do meet."""

    x0: int
    y0: int
    x1: int
    y1: int

    @staticmethod
    def of(axis: str, along: tuple[int, int], across: tuple[int, int]) -> Cell:
        """Return the rectangle of two extents, along an axis and across it [mm]."""
        (a, b), (c, d) = along, across
        return Cell(a, c, b, d) if axis == "x" else Cell(c, a, d, b)

    def span(self, axis: str) -> tuple[int, int]:
        """Return its extent along an axis [mm]."""
        return (self.x0, self.x1) if axis == "x" else (self.y0, self.y1)

    def across(self, axis: str) -> tuple[int, int]:
        """Return its extent across an axis [mm]."""
        return self.span("y" if axis == "x" else "x")

    def grown(self, by: int) -> Cell:
        """Return it with each side moved outwards by `by` [mm]."""
        return Cell(self.x0 - by, self.y0 - by, self.x1 + by, self.y1 + by)

    def overlaps(self, other: Cell) -> bool:
        """Return whether the two share floor."""
        return all(
            min(a[1], b[1]) > max(a[0], b[0])
            for a, b in ((self.span(axis), other.span(axis)) for axis in "xy")
        )


@dataclass(frozen=True)
class Split:
    """A part of a floor: a row of parts, a column of parts, or a room.

    Attributes:
        row: Parts from west to east.
        column: Parts from north to south.
        room: Name of a room; `outside` for none, where a garden or court cuts into the house.
        size: Usual inner extent of the room, east and north [m]; rules may ask for more.
        options: What the house wants in the room.
    """

    row: tuple[Split, ...] = ()
    column: tuple[Split, ...] = ()
    room: str = ""
    size: tuple[float, float] | None = None
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if sum(map(bool, (self.row, self.column, self.room))) != 1:
            raise ConfigError("a part of a plan is one of: a row, a column, a room")
        if bool(self.room) != (self.size is not None):
            raise ConfigError(f"a room has a size, a row or column has none: {self.room or 'row'}")
        if self.size is not None and not all(0.5 <= extent <= 30 for extent in self.size):
            raise ConfigError(f"size of {self.room} must be within 0.5 and 30 m, got {self.size}")
        if len(self.parts) == 1:
            raise ConfigError("a row or column has at least two parts")
        if self.options and not self.room:
            raise ConfigError("only rooms have options")

    @property
    def parts(self) -> tuple[Split, ...]:
        """The parts of a row or column."""
        return self.row or self.column

    def leaves(self) -> Iterator[Split]:
        """Yield the rooms and outsides, west to east and north to south."""
        if self.room:
            yield self
        for part in self.parts:
            yield from part.leaves()


Least = Callable[[str, tuple[float, float]], tuple[float, float]]


class Tiling:
    """Cells for all rooms of a floor; together they fill a rectangle.

    Each cell is the inside of its room and half an inner wall around it.
    """

    def __init__(self, floor: Split, least: Least, give: Callable[[str], float]) -> None:
        """Cut the floor.

        Args:
            floor: What to cut.
            least: Least inner extent [m] of a room by its name and usual size.
            give: How readily a room takes what is left over, by its name; 0 for never.
        """
        self._least, self._give = least, give
        self.cells: list[tuple[Split, Cell]] = []
        self._needs: dict[tuple[int, int], int] = {}
        extent = self._need(floor, 0), self._need(floor, 1)
        self._place(floor, Cell(0, 0, *extent))

    def _need(self, part: Split, axis: int) -> int:
        """Least extent of a part along an axis [mm]."""
        key = id(part), axis
        if key not in self._needs:
            self._needs[key] = self._measure(part, axis)
        return self._needs[key]

    def _measure(self, part: Split, axis: int) -> int:
        if part.size is not None:
            least = part.size if part.room == OUTSIDE else self._least(part.room, part.size)
            return round(1000 * max(part.size[axis], least[axis])) + 2 * HALF
        needs = [self._need(inner, axis) for inner in part.parts]
        along = bool(part.row) == (axis == 0)
        return sum(needs) if along else max(needs)

    def _stretch(self, part: Split, axis: int) -> float:
        """How readily a part grows along an axis."""
        if part.size is not None:
            is_way = part.room.startswith("hall") and part.size[axis] <= part.size[1 - axis]
            return 0.0 if is_way else self._give(part.room) * part.size[axis]
        shares = [self._stretch(inner, axis) for inner in part.parts]
        along = bool(part.row) == (axis == 0)
        return sum(shares) if along else min(shares)

    def _place(self, part: Split, cell: Cell) -> None:
        if part.room:
            self.cells.append((part, cell))
            return
        axis = "x" if part.row else "y"
        low, high = cell.span(axis)
        parts = part.row or part.column[::-1]
        extents = self._share(parts, "xy".index(axis), high - low)
        for inner, extent in zip(parts, extents, strict=True):
            self._place(inner, Cell.of(axis, (low, low + extent), cell.across(axis)))
            low += extent

    def _share(self, parts: tuple[Split, ...], axis: int, total: int) -> list[int]:
        needs = [self._need(part, axis) for part in parts]
        spare = total - sum(needs)
        shares = [self._stretch(part, axis) for part in parts]
        if not any(shares):
            shares = [float(need) for need in needs]
        out, given, weight = [], 0, 0.0
        for need, share in zip(needs, shares, strict=True):
            weight += share
            upto = round(spare * weight / sum(shares))
            out.append(need + upto - given)
            given = upto
        return out
