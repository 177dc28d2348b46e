"""The free floor of a room, measured: how wide its ways are, and how large a circle it holds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage  # type: ignore[import-untyped]

from rcare_marl.pose import Array

from ..rectangle import Rectangle
from .occupancy import Mask

STEP = 0.06  # [m] between the lines of the grid, beside those that walls and furniture ask for
COARSE = 0.04  # [m] between the places from which the largest circle is sought
TOUCH = 1e-6  # [m] by which a round thing may overlap what it touches
WIDTH_WITHIN = 0.001  # [m] to which widths are measured
_STARTS = 4  # places from which the largest circle is sought
_APART = 0.2  # [m] between them, at least
_ANGLES = np.linspace(0.0, 2 * math.pi, 16, endpoint=False)
_TURNS = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)), axis=1)


@dataclass(frozen=True)
class Gate:
    """Where one comes into a room.

    Attributes:
        line: The free part of a door, on the face of its wall, without depth [m].
        inward: Direction into the room, a unit vector along x or y.
    """

    line: Rectangle
    inward: tuple[int, int]

    def place(self, width: float) -> Rectangle:
        """Return where something round of a width [m] has its middle when it is just within.

        It is in line with the door. In one that is too narrow it is in the middle.
        """
        r, (x, y) = 0.5 * width, self.line.centre
        wide = max(0.5 * self.line.width - r, 0.0)
        deep = max(0.5 * self.line.depth - r, 0.0)
        x, y = x + r * self.inward[0], y + r * self.inward[1]
        return Rectangle(x - wide, y - deep, x + wide, y + deep)


class Ground:
    """The floor of a room between its walls and what stands there.

    What moves there is round. It keeps within the walls: it is there as soon as it is through a door.
    Distances are exact; ways are sought on a grid whose lines include all on which something round
    touches a wall or a piece, so the width of a straight gap is found to the millimetre. A way that
    squeezes slantwise past two corners may be found to be up to 4 cm narrower than it is. None is found
    to be wider, but for what a slant step of the grid cuts off a corner: 2 mm for ways of 0.9 m.
    """

    def __init__(self, inside: Rectangle, things: Iterable[Rectangle]) -> None:
        """Look at a floor.

        Args:
            inside: Between the walls [m].
            things: What stands there [m].
        """
        self.inside = inside
        rows = [thing.row for thing in things if thing.overlaps(inside)]
        self._things: Array = np.array(rows).reshape(-1, 4)

    @cached_property
    def circle(self) -> tuple[float, tuple[float, float]]:
        """Diameter, to 1 mm, and middle of the largest circle that fits in [m].

        A grid finds about where it may lie; from there middles climb to where they have most room.
        """
        inside = self.inside
        xs = np.arange(inside.x0 + 0.5 * COARSE, inside.x1, COARSE)
        ys = np.arange(inside.y0 + 0.5 * COARSE, inside.y1, COARSE)
        if not len(xs) or not len(ys):
            return 0.0, inside.centre
        room, starts = self._room(xs, ys), []
        for _ in range(_STARTS):
            row, column = np.unravel_index(int(room.argmax()), room.shape)
            if room[row, column] <= 0.0:
                break
            starts.append((xs[column], ys[row]))
            near = (xs[None, :] - xs[column]) ** 2 + (ys[:, None] - ys[row]) ** 2 < _APART**2
            room[near] = 0.0  # elsewhere next time
        return self._climb(np.array(starts)) if starts else (0.0, inside.centre)

    def joins(self, places: Sequence[Rectangle], goal: tuple[float, float], width: float) -> bool:
        """Return whether something of a width [m] gets from all of the places to a goal [m]."""
        xs, ys = self._lines(width, goal, places)
        if not len(xs) or not len(ys):
            return False
        labels = ndimage.label(self._free(xs, ys, width), structure=np.ones((3, 3)))[0]
        row, column = (
            int(np.abs(line - at).argmin()) for line, at in zip((ys, xs), goal[::-1], strict=True)
        )
        region = labels[row, column]
        if not region:
            return False
        for place in places:
            rows = slice(*np.searchsorted(ys, (place.y0 - TOUCH, place.y1 + TOUCH)))
            columns = slice(*np.searchsorted(xs, (place.x0 - TOUCH, place.x1 + TOUCH)))
            if not (labels[rows, columns] == region).any():
                return False
        return True

    def width(self, gates: Sequence[Gate]) -> float:
        """Return the free width of the ways from all of the gates to the freest place [m]."""
        high, goal = self.circle
        low = 0.0
        while high - low > WIDTH_WITHIN:
            middle = 0.5 * (low + high)
            if self.joins([gate.place(middle) for gate in gates], goal, middle):
                low = middle
            else:
                high = middle
        return low

    def _lines(
        self, width: float, goal: tuple[float, float], places: Sequence[Rectangle]
    ) -> tuple[Array, Array]:
        """Return where something round of a width may have its middle, along x and y [m]."""
        inside, r, out = self.inside, 0.5 * width, []
        rims = np.array([place.row for place in places]).reshape(-1, 4)
        for low, high, axis in ((inside.x0, inside.x1, 0), (inside.y0, inside.y1, 1)):
            edges = (self._things[:, axis] - r, self._things[:, axis + 2] + r)
            ends = np.array((low + r, high - r, goal[axis]))
            sides = (rims[:, axis], rims[:, axis + 2])
            even = np.arange(low + r, high - r, STEP)
            line = np.sort(np.concatenate((ends, even, *sides, *edges)))
            out.append(line[(line >= low + r - TOUCH) & (line <= high - r + TOUCH)])
        return out[0], out[1]

    def _free(self, xs: Array, ys: Array, width: float) -> Mask:
        """Return where something round of a width is clear of all things, shape [ys, xs]."""
        return np.asarray(self._squares(xs, ys) >= (0.5 * width - TOUCH) ** 2)

    def _room(self, xs: Array, ys: Array) -> Array:
        """Return the distance to the nearest thing or wall, shape [ys, xs] [m]."""
        inside = self.inside
        wide = np.minimum(xs - inside.x0, inside.x1 - xs)
        deep = np.minimum(ys - inside.y0, inside.y1 - ys)
        walls = np.minimum(wide[None, :], deep[:, None])
        return np.asarray(np.minimum(np.sqrt(self._squares(xs, ys)), np.maximum(walls, 0.0)))

    def _squares(self, xs: Array, ys: Array) -> Array:
        """Return the squared distance to the nearest thing, shape [ys, xs] [m²]."""
        t = self._things
        dx = np.maximum(np.maximum(t[:, :1] - xs, xs - t[:, 2:3]), 0.0) ** 2
        dy = np.maximum(np.maximum(t[:, 1:2] - ys, ys - t[:, 3:4]), 0.0) ** 2
        out: Array = np.full((len(ys), len(xs)), np.inf)
        for across, along in zip(dx, dy, strict=True):
            np.minimum(out, along[:, None] + across[None, :], out=out)
        return out

    def _climb(self, at: Array) -> tuple[float, tuple[float, float]]:
        """Return diameter and middle of the largest circle near any of some points, shape [n, 2] [m]."""
        step, room = COARSE, self._room_at(at[:, 0], at[:, 1])
        while step > 2e-4:
            around = at[:, None] + step * _TURNS
            rooms = self._room_at(around[..., 0].ravel(), around[..., 1].ravel())
            rooms = rooms.reshape(len(at), -1)
            k = rooms.argmax(axis=1)[:, None]
            better = np.take_along_axis(rooms, k, 1)[:, 0]
            is_up = better > room + 1e-9
            if is_up.any():
                room = np.where(is_up, better, room)
                there = np.take_along_axis(around, k[..., None], 1)[:, 0]
                at = np.where(is_up[:, None], there, at)
            else:
                step *= 0.5
        best = int(room.argmax())
        x, y = at[best].tolist()
        return 2 * max(float(room[best]), 0.0), (x, y)

    def _room_at(self, x: Array, y: Array) -> Array:
        """Return the distance of points to the nearest thing or wall, shape [n] [m]."""
        inside, t = self.inside, self._things
        out: Array = np.minimum(
            np.minimum(x - inside.x0, inside.x1 - x), np.minimum(y - inside.y0, inside.y1 - y)
        )
        if len(t):
            dx = np.maximum(np.maximum(t[:, :1] - x, x - t[:, 2:3]), 0.0)
            dy = np.maximum(np.maximum(t[:, 1:2] - y, y - t[:, 3:4]), 0.0)
            out = np.minimum(out, np.sqrt(dx * dx + dy * dy).min(axis=0))
        return out
