"""A home with everything taken away that stands between somebody outside of a room and the room."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

from rcare_marl.errors import ConfigError

from ..rectangle import Rectangle

if TYPE_CHECKING:
    from .care_home import CareHome

SIDES = "swne"
ON_WALL = 0.2  # [m] from a wall; what stands out less hangs on it, and goes with it


def cutaway(home: CareHome, room: str, open_sides: str = "") -> CareHome:
    """Return a home without the walls on some sides of a room, and what stands beyond them.

    Floors and ceilings stay.

    Args:
        home: The home.
        room: Name of the room.
        open_sides: Sides to look in from, letters of `swne` for south, west, north and east.

    Raises:
        UnknownNameError: If there is no such room.
        ConfigError: If a side is none of these.
    """
    inside = home.room(room).inside
    if set(open_sides) - set(SIDES):
        raise ConfigError(f"open sides must be letters of {SIDES}, got {open_sides!r}")
    kept = Rectangle(
        inside.x0 if "w" in open_sides else -math.inf,
        inside.y0 if "s" in open_sides else -math.inf,
        inside.x1 if "e" in open_sides else math.inf,
        inside.y1 if "n" in open_sides else math.inf,
    )
    walls = [
        dataclasses.replace(wall, area=area)
        for wall in home.plan.walls
        if (area := wall.area.common(kept)) is not None and min(area.width, area.depth) > 0.01
    ]
    openings = {
        o.name: o
        for o in home.plan.openings.values()
        if any(wall.axis == o.axis and wall.area.contains(o.gap, by=1e-6) for wall in walls)
    }
    plan = dataclasses.replace(
        home.plan,
        name=f"{home.plan.name}_{room}_{open_sides}",
        walls=tuple(walls),
        openings=openings,
    )
    near = inside.grown(-ON_WALL)
    gone = {
        "w": lambda a: a.x1 <= near.x0,
        "s": lambda a: a.y1 <= near.y0,
        "e": lambda a: a.x0 >= near.x1,
        "n": lambda a: a.y0 >= near.y1,
    }
    placed = tuple(p for p in home.placed if not any(gone[s](p.footprint) for s in open_sides))
    return dataclasses.replace(home, plan=plan, name=plan.name, placed=placed)
