"""Named places in a room where somebody can be put."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rcare_marl.pose import Pose, quaternion_from_rpy

from .plan import Room

if TYPE_CHECKING:
    from .care_home import CareHome
    from .furnishing import Placed
    from .piece import Zone

_KNOWN_AS = {"hospital_bed": "bed"}  # a task beside a bed takes either


@dataclass(frozen=True)
class Spot:
    """A place.

    Attributes:
        pose: Where, in the house; x points where somebody there looks.
        note: What it is.
    """

    pose: Pose
    note: str


def spots_of(home: CareHome, room: Room) -> dict[str, Spot]:
    """Return the places of a room: its freest one, those at furniture, and those on it.

    `before_sofa` and `beside_bed` are on the floor that a piece needs; `on_bed` and the like are its
    frames; `centre` is the middle of the largest free circle. A second of a kind is `beside_bed_2`.
    """
    _, (x, y) = home.clearance.free_circle(room.inside)
    out = {"centre": Spot(Pose((x, y, 0.0)), "middle of the largest free circle")}
    for placed in home.furniture(room.name):
        kind = _KNOWN_AS.get(placed.piece.kind, placed.piece.kind)
        for zone in placed.piece.zones:
            if zone.why == "use":
                name, spot = _at(placed, zone)
                out[_free(f"{name}_{kind}", out)] = spot
        for frame, what in placed.piece.frames.items():
            out[_free(f"{kind}_{frame}", out)] = Spot(placed.frame(frame), what.note or frame)
    return out


def _at(placed: Placed, zone: Zone) -> tuple[str, Spot]:
    """Return whether a zone is before or beside its piece, and the place in its middle."""
    own = placed.piece.footprint
    x, y = zone.area.centre
    is_before = zone.area.x0 >= own.x1 - 0.05
    ahead = (own.centre[0] - x, 0.0) if is_before else (0.0, own.centre[1] - y)
    yaw = math.atan2(ahead[1], ahead[0])
    pose = placed.pose @ Pose((x, y, 0.0), tuple(quaternion_from_rpy(0, 0, yaw).tolist()))
    word = "before" if is_before else "beside"
    return word, Spot(pose, f"floor {word} {placed.name}, looking at it")


def _free(name: str, taken: dict[str, Spot]) -> str:
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    return free
