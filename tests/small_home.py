"""A floor plan of two rooms, for what is tested of shells and doors."""

from __future__ import annotations

from typing import Literal

from rcare_marl.envs.homes.plan import OUTSIDE, Opening, Plan, Room, Wall
from rcare_marl.envs.homes.rule import Rules
from rcare_marl.envs.rectangle import Rectangle

Hardware = Literal["knob", "lever", "slider"]
_WIDTHS = {1: 0.77, 2: 0.94, 3: 0.99}
_IN, _OUT = 0.12, 0.25


def small_home(level: int) -> Plan:
    """A bedroom in the west, a hall in the east with the entrance in the south."""
    rules = Rules(level)
    west, east = Rectangle(0.0, 0.0, 3.0, 4.0), Rectangle(3.0 + _IN, 0.0, 6.0, 4.0)
    x0, y0, x1, y1 = -_OUT, -_OUT, 6.0 + _OUT, 4.0 + _OUT
    walls = (
        Wall(Rectangle(x0, y0, x1, 0.0), "x", True),
        Wall(Rectangle(x0, 4.0, x1, y1), "x", True),
        Wall(Rectangle(x0, 0.0, 0.0, 4.0), "y", True),
        Wall(Rectangle(6.0, 0.0, x1, 4.0), "y", True),
        Wall(Rectangle(3.0, 0.0, 3.0 + _IN, 4.0), "y", False),
    )
    openings = (
        Opening(
            "door_1",
            "door",
            ("bedroom_1", "hall_1"),
            "y",
            (3.0 + 0.5 * _IN, 1.4),
            _WIDTHS[level],
            _IN,
            hardware=rules.choice("door_hardware"),
            hinge="high",
            normal=(-1, 0),
            threshold=rules.figure("door_threshold"),
        ),
        Opening(
            "passage_1",
            "passage",
            ("bedroom_1", "hall_1"),
            "y",
            (3.06, 3.4),
            0.9,
            _IN,
            head=2.2,
            normal=(-1, 0),
        ),
        Opening(
            "entrance_1",
            "entrance",
            ("hall_1", OUTSIDE),
            "x",
            (4.5, -0.5 * _OUT),
            0.97,
            _OUT,
            hardware="knob" if level == 1 else "lever",
            normal=(0, 1),
            threshold=rules.figure("entrance_threshold"),
        ),
        Opening(
            "window_1",
            "window",
            ("bedroom_1", OUTSIDE),
            "y",
            (-0.5 * _OUT, 2.0),
            1.5,
            _OUT,
            sill=0.85,
            head=2.1,
            normal=(1, 0),
        ),
    )
    rooms = (
        Room("bedroom_1", "bedroom", "bedroom", west),
        Room("hall_1", "other", "hall", east),
    )
    return Plan(
        name="small",
        title="two rooms",
        level=level,
        rooms={room.name: room for room in rooms},
        walls=walls,
        openings={opening.name: opening for opening in openings},
        outline=(Rectangle(x0, y0, 3.06, y1), Rectangle(3.06, y0, x1, y1)),
    )
