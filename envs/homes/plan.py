"""A floor plan: rooms, walls, and the openings in them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

from rcare_marl.errors import check_name
from rcare_marl.pose import Pose, quaternion_from_rpy

from ..rectangle import Rectangle

OUTSIDE = "outside"
ROOM_KINDS = ("kitchen", "bedroom", "bathroom", "living", "dining", "lounge", "other")

INNER_WALL = 0.12  # [m] thick; common, from memory
OUTER_WALL = 0.25  # [m]; own choice
CEILING_HEIGHT = 2.5  # [m]; own choice
DOOR_HEIGHT = 2.03  # [m], 80 in, common in the US, from memory
JAMB = 0.03  # [m] that the lining of a door takes on each side of the gap in the wall; own choice
LEAF = 0.04  # [m] thick; common, from memory
# A hinged leaf that stands open at 90 degrees still takes its thickness from the way through.
HINGED_LOSS = 2 * JAMB + LEAF + 0.01
SLIDING_LOSS = 2 * JAMB


@dataclass(frozen=True)
class Room:
    """A room.

    Attributes:
        name: Its kind and a number, such as `bedroom_2`; `hall_1`, `laundry_1` and so on for others.
        kind: One of `ROOM_KINDS`.
        use: What it is furnished as: the kind, or for other rooms `hall`, `study`, `laundry`, ...
        inside: The floor between its walls [m].
        options: What the house wants in it, such as `{"beds": 2}`.
        finish: What its floor is of: `wood`, `tile` or `carpet`.
    """

    name: str
    kind: str
    use: str
    inside: Rectangle
    options: dict[str, object] = field(default_factory=dict)
    finish: str = "wood"


OpeningKind = Literal["door", "entrance", "passage", "window"]


@dataclass(frozen=True)
class Opening:
    """A gap in a wall: a door, a passage without a door, or a window.

    Attributes:
        name: Unique in the house, such as `door_3`.
        kind: `door`, `entrance` (a door to the outside), `passage` or `window`.
        rooms: The rooms on both sides; the second of an entrance or window is `outside`. A hinged door
            swings into the first.
        axis: Direction in which the wall runs.
        centre: Middle of the gap, on the middle line of the wall [m].
        width: Of the gap between the ends of the walls, without lining [m].
        thickness: Of the wall [m].
        sill: Height of its lower edge over the floor [m]; 0 for doors.
        head: Height of its upper edge [m].
        hardware: `knob`, `lever` or `slider` of doors; empty else.
        hinge: The end of the gap, along the axis, where the hinges are; for sliding doors, where the
            pocket is that the panel vanishes into, within the wall.
        threshold: Height of the threshold [m].
        normal: Direction out of the wall into the first room, a unit vector along x or y.
    """

    name: str
    kind: OpeningKind
    rooms: tuple[str, str]
    axis: Literal["x", "y"]
    centre: tuple[float, float]
    width: float
    thickness: float
    sill: float = 0.0
    head: float = DOOR_HEIGHT
    hardware: str = ""
    hinge: Literal["low", "high"] = "low"
    threshold: float = 0.0
    normal: tuple[int, int] = (0, 1)

    @property
    def clear_width(self) -> float:
        """Free width when it is open [m]."""
        if self.kind == "window":
            return 0.0
        if self.kind == "passage":
            return self.width
        return self.width - (SLIDING_LOSS if self.hardware == "slider" else HINGED_LOSS)

    @property
    def pose(self) -> Pose:
        """Frame of the opening: on the floor in its middle, y into the first room, z up."""
        yaw = math.atan2(self.normal[1], self.normal[0]) - math.pi / 2
        turn = tuple(quaternion_from_rpy(0, 0, yaw).tolist())
        return Pose((self.centre[0], self.centre[1], 0.0), turn)

    @property
    def gap(self) -> Rectangle:
        """The floor within the wall that it opens [m]."""
        (x, y), w, t = self.centre, 0.5 * self.width, 0.5 * self.thickness
        if self.axis == "x":
            return Rectangle(x - w, y - t, x + w, y + t)
        return Rectangle(x - t, y - w, x + t, y + w)


@dataclass(frozen=True)
class Wall:
    """A straight wall.

    Attributes:
        area: The floor that it stands on, openings included [m]; walls meet and do not overlap.
        axis: Direction in which it runs.
        is_outer: Whether it faces the outside.
    """

    area: Rectangle
    axis: Literal["x", "y"]
    is_outer: bool


@dataclass(frozen=True)
class Plan:
    """A floor plan, in metres, x east and y north; floors are at z = 0.

    Attributes:
        name: Name of the house.
        title: What kind of house it is.
        level: Level of accessibility that it is drawn for.
        rooms: By name.
        walls: All walls.
        openings: By name.
        outline: Rectangles that cover the house, outer walls included.
    """

    name: str
    title: str
    level: int
    rooms: dict[str, Room]
    walls: tuple[Wall, ...]
    openings: dict[str, Opening]
    outline: tuple[Rectangle, ...]

    def room(self, name: str) -> Room:
        """Return a room by name; UnknownNameError if there is none."""
        check_name(f"room in {self.name}", name, self.rooms)
        return self.rooms[name]

    def required_rooms(self) -> tuple[str, ...]:
        """Return the rooms that everybody must reach: all but the closets, halls and other rooms."""
        return tuple(room.name for room in self.rooms.values() if room.kind != "other")

    def openings_of(self, room: str) -> Iterable[Opening]:
        """Return the openings in the walls of a room."""
        return [opening for opening in self.openings.values() if room in opening.rooms]
