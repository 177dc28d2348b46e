"""The floor at doors: what must stay free there, and what linings and open leaves take."""

from __future__ import annotations

import numpy as np

from rcare_marl.pose import Array

from ..rectangle import Rectangle
from .door import hinge_side
from .ground import Gate
from .plan import JAMB, LEAF, Opening
from .rule import Rules

DOORSTEP = 0.75  # [m] that stays free before a door at least; own choice
MOUTH = 0.3  # [m] that stays free before wide passages; own choice
# Depth of the floor beside a latch, for somebody who stands or sits there and pulls; own choice, the
# ADA asks for 60 in of clear floor before the whole door.
LATCH_DEPTH = DOORSTEP
SWITCH = 0.15  # [m] from the gap of a door to a switch; own choice
BEHIND = 0.3  # [m] by which a place beside the hinges counts as if it were farther; own choice
OFF_WALL = 0.01  # [m] from the wall, where that floor starts: skirtings do not count


def doorway(opening: Opening, room: str, rules: Rules) -> tuple[Rectangle, ...]:
    """Return the floor before a door or passage that must stay free in a room [m].

    That is the sweep of its leaf, or what somebody who walks in needs, and where a leaf is pulled
    open the floor beside its latch.

    Args:
        opening: The door.
        room: Name of the room on whose side.
        rules: The rules of the house.
    """
    sign, passage = _side(opening, room), rules.figure("passage_width")
    is_swept = opening.hardware in ("knob", "lever") and sign > 0
    # A leaf that opens by more than a right angle also takes floor beside the gap.
    deep = max(DOORSTEP, opening.width if is_swept else 0.0)
    if opening.kind == "passage" and opening.width > 2 * passage:
        deep = MOUTH  # one walks round what stands farther in
    half = 0.5 * max(opening.width, passage) + (LEAF if is_swept else 0.0)
    near = 0.5 * opening.thickness
    low, high = sorted((sign * near, sign * (near + deep)))
    areas = [Rectangle(-half, low, half, high)]
    if is_swept:
        areas.append(_beside_latch(opening, rules.figure("latch_side_space")))
    return tuple(area.moved(opening.pose) for area in areas)


def _beside_latch(opening: Opening, wide: float) -> Rectangle:
    """Return the floor beside a latch, as wide as the rules build it, in the frame of the door [m]."""
    start = latch_edge(opening)
    low, high = sorted((start, start - hinge_side(opening) * wide))
    near = 0.5 * opening.thickness
    return Rectangle(low, near, high, near + OFF_WALL + LATCH_DEPTH)


def latch_edge(opening: Opening) -> float:
    """Return where the leaf of a hinged door ends at its latch, along x of the door's frame [m]."""
    return -hinge_side(opening) * (0.5 * opening.width - JAMB)


def gate(opening: Opening, room: str) -> Gate:
    """Return where one comes through a door into a room."""
    sign = _side(opening, room)
    at = sign * 0.5 * opening.thickness
    low, high = _clear(opening)
    line = Rectangle(low, at, high, at).moved(opening.pose)
    normal = opening.normal
    return Gate(line, (round(sign) * normal[0], round(sign) * normal[1]))


def narrowing(opening: Opening) -> list[Rectangle]:
    """Return the floor that the lining of a door takes, and its leaf that stands open [m]."""
    if opening.kind == "passage":
        return []
    half, deep = 0.5 * opening.width, 0.5 * opening.thickness
    low, high = _clear(opening)
    parts = [Rectangle(-half, -deep, low, deep), Rectangle(high, -deep, half, deep)]
    if opening.hardware != "slider":
        at = -half + JAMB if hinge_side(opening) < 0 else half - JAMB - LEAF
        parts.append(Rectangle(at, deep, at + LEAF, deep + opening.width - 2 * JAMB))
    return [part.moved(opening.pose) for part in parts]


def off_switch(opening: Opening, room: str, at: Array) -> Array:
    """Return how far places on the walls of a room are from where its switch is looked for [m].

    That is beside the latch; the side of the hinges, where a leaf may stand before it, and that of a
    pocket count as if they were farther.

    Args:
        opening: The door.
        room: Name of the room.
        at: Places, shape [n, 2] [m].
    """
    (x, y), turn = opening.centre, opening.pose.matrix()[:2, :2]
    local: Array = (at - (x, y)) @ turn
    local[:, 1] -= 0.5 * _side(opening, room) * opening.thickness
    wanted = 0.5 * opening.width + SWITCH
    far: Array = np.abs(np.linalg.norm(local, axis=1) - wanted)
    if opening.hardware:
        far += BEHIND * (local[:, 0] * hinge_side(opening) > 0)
    return far


def _clear(opening: Opening) -> tuple[float, float]:
    """Return where the free part of a gap begins and ends, along x of the frame of the door [m]."""
    half = 0.5 * opening.width
    if opening.kind == "passage":
        return -half, half
    low, high = -half + JAMB, half - JAMB
    thick = opening.width - opening.clear_width - 2 * JAMB
    return (low + thick, high) if hinge_side(opening) < 0 else (low, high - thick)


def _side(opening: Opening, room: str) -> float:
    """Return 1 for the side of a door into which y of its frame points, -1 for the other."""
    return 1.0 if opening.rooms[0] == room else -1.0
