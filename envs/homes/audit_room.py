"""Measures the floor of rooms: halls, room to turn and to pass."""

from __future__ import annotations

from collections.abc import Iterator

from .care_home import CareHome
from .doorway import gate
from .ground import Ground
from .measurement import Measurement, near
from .plan import Room

TURNING = ("kitchen", "bedroom", "bathroom", "living", "dining")
REACHED_INTO = ("closet", "pantry")  # rooms that one reaches into, without ways of their own


def measure_rooms(home: CareHome) -> Iterator[Measurement]:
    """Yield what is measured of the floor of rooms."""
    for room in home.plan.rooms.values():
        if room.use == "hall":
            narrow = min(room.inside.width, room.inside.depth)
            yield Measurement("hallway_width", room.name, room.name, narrow)
        things = [thing.area for thing in near(home.wheel_clearance, room.inside)]
        ground = Ground(room.inside, things)
        if room.kind in TURNING:
            yield Measurement("turning_diameter", room.name, room.name, ground.circle[0])
        if room.use not in REACHED_INTO:
            width = _passage(home, room, ground)
            if width is not None:
                yield Measurement("passage_width", room.name, room.name, width)


def _passage(home: CareHome, room: Room, ground: Ground) -> float | None:
    """Return the free width of the ways from each door of a room to its freest place [m].

    A way starts in line with its door, so a leaf that stands open there makes it narrower.
    None for a room without doors.
    """
    ways = [o for o in home.plan.openings_of(room.name) if o.kind != "window"]
    return ground.width([gate(way, room.name) for way in ways]) if ways else None
