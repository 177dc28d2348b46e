"""One room of a home by itself, with walls taken away, to look into it."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from .plan import OUTER_WALL, Wall
from .rectangle import Rectangle

if TYPE_CHECKING:
    from .care_home import CareHome

SIDES = ("s", "w", "n", "e")


def cutaway(home: CareHome, room: str, open_sides: str = "") -> CareHome:
    """Return a home of one room, with what stands in it.

    Args:
        home: The home.
        room: Name of the room.
        open_sides: Sides without a wall, letters of `swne`.

    Raises:
        UnknownNameError: If there is no such room.
    """
    inside = home.room(room).inside
    walls = []
    for side in SIDES:
        strip = _strip(inside, side)
        if side in open_sides:
            continue
        for wall in home.plan.walls:
            area = _common(wall.area, strip)
            if area is not None and wall.axis == ("x" if side in "sn" else "y"):
                walls.append(Wall(area, wall.axis, wall.is_outer))
    openings = {
        o.name: o
        for o in home.plan.openings_of(room)
        if any(wall.axis == o.axis and wall.area.contains(o.gap, by=1e-6) for wall in walls)
    }
    floor = inside.grown(0.02)
    plan = dataclasses.replace(
        home.plan,
        name=f"{home.plan.name}_{room}_{open_sides}",
        rooms={room: home.room(room)},
        walls=tuple(walls),
        openings=openings,
        outline=(floor,),
    )
    return dataclasses.replace(home, plan=plan, name=plan.name, placed=home.furniture(room))


def _strip(inside: Rectangle, side: str) -> Rectangle:
    """Return where the wall on one side of a room can be [m]."""
    wide = OUTER_WALL + 0.01
    x0, y0, x1, y1 = inside.x0, inside.y0, inside.x1, inside.y1
    return {
        "s": Rectangle(x0 - wide, y0 - wide, x1 + wide, y0),
        "n": Rectangle(x0 - wide, y1, x1 + wide, y1 + wide),
        "w": Rectangle(x0 - wide, y0, x0, y1),
        "e": Rectangle(x1, y0, x1 + wide, y1),
    }[side]


def _common(a: Rectangle, b: Rectangle) -> Rectangle | None:
    x0, y0, x1, y1 = max(a.x0, b.x0), max(a.y0, b.y0), min(a.x1, b.x1), min(a.y1, b.y1)
    return Rectangle(x0, y0, x1, y1) if x1 - x0 > 0.01 and y1 - y0 > 0.01 else None


__all__ = ["cutaway"]
