"""How much floor a room needs at a level of accessibility."""

from __future__ import annotations

from .rule import Rules

# What a room is for beside the kinds that are counted; own choice.
OTHER_USES = tuple(
    "closet entry gym hall laundry library office pantry playroom study sunroom workshop".split()
)
# How readily rooms take floor that is left over; own choice: halls never grow wider.
_GIVE = {"bathroom": 0.2, "closet": 0.2, "pantry": 0.2, "laundry": 0.25, "entry": 0.2}

# Furniture that sizes a room [m]; common sizes, from memory.
_BED = (1.6, 2.1)
_UNITS = 0.62  # depth of kitchen units
_KITCHEN_RUN = 3.0
_TUB_DEPTH = 0.78
_BASIN_WIDTH = 0.6
_SOFA_GROUP = (2.9, 3.1)
_TABLE = (0.9, 1.5)
_CHAIR = 0.5  # depth that a pulled-in chair adds
_HALF_TOILET = 0.2
_BATH_SPARE = 0.25  # more than the parts, since doors take corners; own choice


def room_kind_give(use: str) -> float:
    """Return how readily a room takes floor that is left over."""
    return _GIVE.get(use, 1.0)


def least_size(use: str, rules: Rules) -> tuple[float, float]:
    """Return the least inner extent of a room [m], the shorter side first.

    Halls have no least length. Furniture and ways between are own choice; all else is by the rules.
    """
    turn = rules.figure("turning_diameter", 0.0)
    way = rules.figure("passage_width")
    room = max(way, turn)
    if use == "hall":
        return rules.figure("hallway_width"), rules.figure("hallway_width")
    if use == "bathroom":
        return _bathroom(rules, max(turn, 0.8))
    if use == "bedroom":
        return _BED[0] + 2 * rules.figure("bed_side_space"), _BED[1] + room + 0.3
    if use == "kitchen":
        knee = rules.figure("counter_knee_width", 0.0)
        return 2 * _UNITS + max(rules.figure("kitchen_aisle"), turn), _KITCHEN_RUN + knee
    if use == "living":
        return _SOFA_GROUP[0] + way, _SOFA_GROUP[1] + room
    if use == "lounge":
        return _SOFA_GROUP[0] + 0.2 * room, _SOFA_GROUP[0] + room
    if use == "dining":
        return _TABLE[0] + 2 * (_CHAIR + way) - 0.2, _TABLE[1] + 2 * _CHAIR + room
    if use in ("study", "office", "gym", "workshop", "library", "playroom", "sunroom"):
        return 1.4 + max(way, 0.8 * turn), 2.0 + way
    return {"closet": 0.8, "pantry": 0.9, "laundry": 0.9, "entry": 0.8}[use] + way, 1.2 + way


def _bathroom(rules: Rules, room: float) -> tuple[float, float]:
    """Toilet and basin along one wall, bath or shower along the next, room to turn between."""
    depth = rules.figure("shower_depth", _TUB_DEPTH)
    beside = rules.figure("toilet_side_space", 0.2)
    latch = rules.figure("latch_side_space")
    wall = rules.figure("toilet_centre_to_wall") + _HALF_TOILET + beside + _BASIN_WIDTH + latch
    spare = _BATH_SPARE if rules.has("turning_diameter") else 0.0
    across, wall = depth + room + spare, wall + spare
    return min(wall, across), max(wall, across)
