"""Measures the floor of rooms: halls, room to turn and to pass."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from scipy import ndimage  # type: ignore[import-untyped]

from rcare_marl.pose import Array

from .furnishing import DOORSTEP
from .measurement import FurnishedHome, Measurement, near
from .occupancy import Obstacle, Occupancy
from .plan import Opening, Room
from .rectangle import Rectangle

TURNING = ("kitchen", "bedroom", "bathroom", "living", "dining")
REACHED_INTO = ("closet", "pantry")  # rooms that one reaches into, without ways of their own
_STARTS = 4  # places from which the largest circle is sought
FINE = 0.01  # [m], cell of the map on which ways are measured


def measure_rooms(home: FurnishedHome) -> Iterator[Measurement]:
    """Yield what is measured of the floor of rooms."""
    for room in home.plan.rooms.values():
        if room.use == "hall":
            narrow = min(room.inside.width, room.inside.depth)
            yield Measurement("hallway_width", room.name, room.name, narrow)
        things = tuple(near(home.wheel_clearance, room.inside.grown(0.05)))
        if room.kind in TURNING:
            circle = turning_diameter(room.inside, things)
            yield Measurement("turning_diameter", room.name, room.name, circle)
        if room.use not in REACHED_INTO:
            width = _passage(home, room, things)
            if width is not None:
                yield Measurement("passage_width", room.name, room.name, width)


def turning_diameter(area: Rectangle, things: Sequence[Obstacle]) -> float:
    """Return the diameter of the largest circle between `things` within `area` [m], to 1 mm.

    A grid finds about where it may lie; from there middles climb to where they have most room.
    """
    occupancy = Occupancy(area, things, cell=2 * FINE)
    far = ndimage.distance_transform_edt(np.pad(occupancy.free, 1, constant_values=False))[
        1:-1, 1:-1
    ]
    best = 0.0
    for _ in range(_STARTS):
        row, column = np.unravel_index(int(far.argmax()), far.shape)
        if not far[row, column]:
            break
        best = max(best, _climb(occupancy, area, occupancy.point(int(row), int(column))))
        far[max(row - 8, 0) : row + 9, max(column - 8, 0) : column + 9] = 0.0  # elsewhere next time
    return best


def _climb(occupancy: Occupancy, area: Rectangle, start: tuple[float, float]) -> float:
    """Return the diameter of the largest free circle near a point, within `area` [m]."""
    turns = [(math.cos(a), math.sin(a)) for a in np.linspace(0.0, 2 * math.pi, 16, endpoint=False)]

    def width(x: float, y: float) -> float:
        inside = min(x - area.x0, area.x1 - x, y - area.y0, area.y1 - y)
        return 2 * min(occupancy.clearance(x, y), inside)

    (x, y), step = start, 2 * FINE
    diameter = width(x, y)
    while step > 2e-4:
        better = max(((x + step * c, y + step * s) for c, s in turns), key=lambda at: width(*at))
        if width(*better) > diameter + 1e-9:
            (x, y), diameter = better, width(*better)
        else:
            step *= 0.5
    return diameter


def _passage(home: FurnishedHome, room: Room, things: Sequence[Obstacle]) -> float | None:
    """Return the free width of the ways from each door of a room to its freest place [m].

    It is read off a grid, to two cells in favour of the home. None for a room without doors.
    """
    doorsteps = [_doorstep(o, room) for o in home.plan.openings_of(room.name) if o.kind != "window"]
    if not doorsteps:
        return None
    occupancy = Occupancy(room.inside, things, cell=FINE)
    far = ndimage.distance_transform_edt(np.pad(occupancy.free, 1, constant_values=False))
    widths: Array = (2 * far[1:-1, 1:-1] + 1) * FINE
    middle = int(widths.argmax())
    low, high = 0.0, float(widths.max())
    while high - low > 0.5 * FINE:
        width = 0.5 * (low + high)
        labels = ndimage.label(widths >= width, structure=np.ones((3, 3)))[0]
        goal = labels.flat[middle]
        if all(goal in labels[occupancy.window(step)] for step in doorsteps):
            low = width
        else:
            high = width
    return low


def _doorstep(opening: Opening, room: Room) -> Rectangle:
    """Return the floor before a door on the side of a room [m]."""
    sign = 1.0 if opening.rooms[0] == room.name else -1.0
    near_end = 0.5 * opening.thickness
    low, high = sorted((sign * near_end, sign * (near_end + DOORSTEP)))
    half = 0.5 * opening.clear_width
    return Rectangle(-half, low, half, high).moved(opening.pose)


__all__ = ["TURNING", "measure_rooms", "turning_diameter"]
