"""Toilets."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker
from .joinery import Joinery
from .plumbing import grab_bar
from .stock import box, rod, solid_rods

# All in metres; common sizes of toilets with a tank, from memory.
_TANK_FRONT = 0.17  # the lid leans back past vertical and does not reach it
_TANK_WIDTH = 0.40
_HINGE = 0.27  # of seat and lid, from the wall
_FRONT = 0.73  # of the bowl
_HALF = 0.19  # half its width
_SEAT = 0.022  # thick
_LID = 0.018
_GAP = 0.006  # pads between bowl, seat and lid
_LIP = (0.03, 0.12, 0.010)  # out over the seat, wide, thick: what a lid is lifted by; own choice
_SLIM = (0.155, 0.115)  # half length and half width of the hole in the seat
_CENTRE = 0.5 * (_HINGE + _FRONT) - 0.005  # of the bowl
_LONG = 0.5 * (_FRONT - _HINGE)
_REAR_SHORT = 0.305  # of the bar behind it, from the middle to the side wall: ADA 604.5.2
_SIDE_START = 0.3  # of the bar beside it, from the wall behind: ADA 604.5.1, 12 in at most
_FOLD_ASIDE = 0.36  # from the middle to the fold-down bar: 0.7 between bars, common
_FOLD_LONG = 0.75
_FOLD_FRICTION = 3.0  # [N·m] of its hinge: it stays up, and 15 N lift it; own choice
_BESIDE = 0.38  # free on both sides of its middle: IRC R307.1, 15 in, from memory
_FRONT_SPACE = (0.6, 0.76, 1.2)  # ADA 604.3.1: 56 in from the wall behind; level 1, 3: own choice


@maker("toilet")
def toilet(setting: Setting, *, wall: str = "left") -> Piece:
    """Return a toilet with tank, lid and seat on hinges, and what bars the rules want.

    Its footprint ends at the wall beside it. Bars hang over clear floor, as ADA 604.3.2 lets them,
    and are no part of it.

    Args:
        setting: What it is made for.
        wall: Side on which the wall beside it is, as one sits: `left`, `right` or `none`. Bars
            beside it are on that wall; a bar that folds down is on the other side.

    Raises:
        ConfigError: If `wall` is none of these.
    """
    if wall not in ("left", "right", "none"):
        raise ConfigError(f"wall must be one of left, right, none, got {wall!r}")
    rules = setting.rules
    side = -1.0 if wall == "right" else 1.0
    made = Joinery("toilet", setting)
    seat = rules.figure("toilet_seat_height")
    rim = seat - _SEAT - _GAP
    _bowl(made, rim)
    _tank(made, rim, side)
    _seat(made, rim + _GAP)
    _lid(made, seat + _GAP)
    made.measures["toilet_seat_height"] = seat
    made.frame("seat", (_CENTRE, 0.0, seat), "middle of the seat, facing out")
    reach = 0.23
    if wall != "none":
        reach = rules.figure("toilet_centre_to_wall")
        made.measures["toilet_centre_to_wall"] = reach
    bars = rules.choice("grab_bars")
    if bars != "none":
        _wall_bars(made, side, reach if wall != "none" else None)
    if bars == "wall_and_fold_down":
        _fold_down(made, -side * _FOLD_ASIDE, rules.figure("grab_bar_height"))
    near, far = sorted((side * reach, -side * 0.21))
    front = _FRONT_SPACE[rules.level - 1]
    zones = [Zone(Rectangle(_FRONT, -_BESIDE, _FRONT + front, _BESIDE))]
    if rules.has("toilet_side_space"):
        free = rules.figure("toilet_side_space")
        made.measures["toilet_side_space"] = free
        low, high = sorted((-side * 0.21, -side * (0.21 + free)))
        zones.append(Zone(Rectangle(0.0, low, 1.42, high)))  # ADA 604.3.1: 56 in deep
    height = 1.62 if bars == "wall_and_fold_down" else max(0.86, rim + 0.48)
    return made.piece(Rectangle(0.0, near, _FRONT, far), height, zones=zones)


def _bowl(made: Joinery, rim: float) -> None:
    """Add foot and bowl: a turned body, stretched lengthwise, with a real hollow."""
    flat = _HALF / _LONG
    outside = ((0.125, 0.0), (0.13, 0.05), (0.125, 0.45 * rim), (0.165, 0.7 * rim))
    brim = ((_LONG - 0.008, rim - 0.035), (_LONG, rim - 0.02), (_LONG - 0.005, rim))
    inside = ((0.165, rim), (0.158, rim - 0.03), (0.125, rim - 0.13), (0.06, rim - 0.2))
    made.draw(
        Shape(
            kind="lathe",
            material="ceramic",
            at=(_CENTRE, 0.0, 0.0),
            profile=(*outside, *brim, *inside),
            scale=(1.0, flat, 1.0),
        ),
        box("ceramic", (0.03, -0.105, 0.0), (_CENTRE, 0.105, rim - 0.1)),
        box("ceramic", (_TANK_FRONT - 0.1, -0.15, rim - 0.1), (_HINGE + 0.06, 0.15, rim - 0.002)),
        Shape(  # the water
            kind="lathe",
            material="mirror",
            at=(_CENTRE, 0.0, rim - 0.165),
            profile=((0.09, 0.0), (0.001, 0.001)),
            scale=(1.0, flat, 1.0),
        ),
    )
    floor = rim - 0.2
    ends = (_CENTRE - _SLIM[0], _CENTRE + _SLIM[0])
    wide = 0.155  # the boxes stay within the oval where it is narrower
    made.solid(
        box("", (0.03, -0.11, 0.0), (_CENTRE + 0.13, 0.11, floor)),
        box("", (0.03, -0.13, floor), (ends[0], 0.13, rim)),
        box("", (ends[1], -0.11, floor + 0.1), (_FRONT - 0.01, 0.11, rim)),
        box("", (ends[0], _SLIM[1], floor + 0.05), (ends[1], wide + 0.02, rim)),
        box("", (ends[0], -wide - 0.02, floor + 0.05), (ends[1], -_SLIM[1], rim)),
    )
    made.frame("bowl", (_CENTRE, 0.0, floor), "bottom of the bowl")


def _tank(made: Joinery, rim: float, side: float) -> None:
    """Add the tank, with its lever on the open side, as ADA 604.6 wants it."""
    half, top = 0.5 * _TANK_WIDTH, min(rim + 0.37, 0.78)
    low, high = (0.02, -half, rim - 0.002), (_TANK_FRONT, half, top - 0.03)
    made.draw(
        box("ceramic", low, high, bevel=0.025),
        box(
            "ceramic", (0.012, -half - 0.008, top - 0.03), (_TANK_FRONT + 0.008, half + 0.008, top)
        ),
    )
    made.solid(box("", (0.012, -half, rim - 0.002), (_TANK_FRONT, half, top)))
    y, z = -side * (half - 0.05), top - 0.08
    made.moving(
        "flush",
        "revolute",
        (_TANK_FRONT + 0.012, y, z),
        (-side, 0.0, 0.0),
        math.radians(35),
        mass=0.08,
        fills=(
            (_TANK_FRONT + 0.006, min(y, y + side * 0.09), z - 0.008),
            (_TANK_FRONT + 0.018, max(y, y + side * 0.09), z + 0.008),
        ),
        slowing=0.02,
        friction=0.15,
    )
    end = (_TANK_FRONT + 0.02, y + side * 0.09, z)
    made.draw(rod("metal", 0.014, (_TANK_FRONT, y, z), (_TANK_FRONT + 0.016, y, z)))
    made.rod(((_TANK_FRONT + 0.02, y, z), end), 0.007, "metal", link="flush", solid=True)
    made.frame("handle_flush", end, "end of the lever; push it down", link="flush")


def _seat(made: Joinery, low: float) -> None:
    """Add the seat: a ring that lies on the bowl and leans on the lid when it is up."""
    high = low + _SEAT
    front = _FRONT + 0.002
    made.moving(
        "seat",
        "revolute",
        (_HINGE, 0.0, low),
        (0.0, -1.0, 0.0),
        math.radians(95),
        mass=1.3,
        fills=((_HINGE, -_HALF, low), (front, _HALF, high)),
        slowing=0.06,
    )
    long, slim = _LONG + 0.002, _SLIM[0]
    ring = (
        (slim, low),
        (long, low),
        (long, high - 0.007),
        (long - 0.015, high),
        (slim + 0.012, high),
    )
    made.draw(
        Shape(
            kind="lathe",
            material="white",
            at=(_CENTRE, 0.0, 0.0),
            profile=(*ring, (slim, low)),
            scale=(1.0, _HALF / _LONG, 1.0),
        ),
        link="seat",
    )
    ends = (_CENTRE - slim, _CENTRE + slim)
    made.solid(
        box("", (_HINGE + 0.005, -0.13, low), (ends[0], 0.13, high)),
        box("", (ends[1], -0.11, low), (front, 0.11, high)),
        box("", (ends[0], _SLIM[1], low), (ends[1], _HALF - 0.01, high)),
        box("", (ends[0], 0.01 - _HALF, low), (ends[1], -_SLIM[1], high)),
        link="seat",
    )
    made.frame("handle_seat", (front, 0.0, low), "front edge; lift it", link="seat")


def _lid(made: Joinery, low: float) -> None:
    """Add the lid, which leans past vertical when it is up."""
    high = low + _LID
    made.moving(
        "lid",
        "revolute",
        (_HINGE, 0.0, low - _SEAT),
        (0.0, -1.0, 0.0),
        math.radians(98),
        mass=1.2,
        fills=((_HINGE, -_HALF, low), (_FRONT, _HALF, high)),
        slowing=0.06,
    )
    long = _LONG + 0.001
    made.draw(
        Shape(
            kind="lathe",
            material="white",
            at=(_CENTRE, 0.0, 0.0),
            profile=((long, low), (long, high - 0.008), (long - 0.02, high)),
            scale=(1.0, _HALF / _LONG, 1.0),
        ),
        rod("metal", 0.009, (_HINGE - 0.005, -0.1, low - 0.01), (_HINGE - 0.005, 0.1, low - 0.01)),
        link="lid",
    )
    made.solid(box("", (_HINGE + 0.03, -0.16, low), (_FRONT, 0.16, high)), link="lid")
    out, wide, thick = _LIP
    tip = _FRONT + out
    made.box(
        (_FRONT - 0.03, -0.5 * wide, low),
        (tip, 0.5 * wide, low + thick),
        "white",
        link="lid",
        bevel=0.004,
    )
    made.frame("handle_lid", (tip - 0.5 * out, 0.0, low), "under its lip; lift it", link="lid")
    made.frame("lid", (_CENTRE, 0.0, high), "middle of the lid when it is shut")


def _wall_bars(made: Joinery, side: float, reach: float | None) -> None:
    """Add the bar behind the toilet and, where a wall is at `reach` [m], the one beside it."""
    rules = made.setting.rules
    diameter, gap = rules.figure("grab_bar_diameter"), rules.figure("grab_bar_gap")
    top, length = rules.figure("grab_bar_height"), rules.figure("grab_bar_rear_length")
    z = top - 0.5 * diameter
    start = side * _REAR_SHORT
    ends = ((0.0, start, z), (0.0, start - side * length, z))
    grab_bar(made, *ends, (1.0, 0.0, 0.0), diameter=diameter, gap=gap)
    made.measures |= {
        "grab_bar_height": top,
        "grab_bar_rear_length": length,
        "grab_bar_diameter": diameter,
        "grab_bar_gap": gap,
    }
    away = gap + 0.5 * diameter
    made.frame("grab_bar_rear", (away, start - side * 0.5 * length, z), "middle of the bar")
    if reach is None:
        return
    long, y = rules.figure("grab_bar_side_length"), side * reach
    ends = ((_SIDE_START, y, z), (_SIDE_START + long, y, z))
    grab_bar(made, *ends, (0.0, -side, 0.0), diameter=diameter, gap=gap)
    made.measures["grab_bar_side_length"] = long
    middle = (_SIDE_START + 0.5 * long, y - side * away, z)
    made.frame("grab_bar_side", middle, "middle of the bar")


def _fold_down(made: Joinery, y: float, top: float) -> None:
    fold_down(made, y, top=top, length=_FOLD_LONG, diameter=0.035)


def fold_down(made: Joinery, y: float, *, top: float, length: float, diameter: float) -> None:
    """Add a bar on the wall behind that stands up against it and folds down, joint `fold_down`.

    Args:
        made: What it is part of.
        y: Where [m].
        top: Height of its top when it is down [m].
        length: From the wall to its front end [m].
        diameter: Of the bar [m].
    """
    radius = 0.5 * diameter
    hinge, z = 0.12, top - radius
    made.box((0.0, y - 0.05, z - 0.2), (0.012, y + 0.05, z + 0.06), "metal")
    for aside in (-0.03, 0.03):
        made.draw(rod("metal", 0.012, (0.01, y + aside, z), (hinge, y + aside, z)))
    made.draw(rod("metal", 0.016, (hinge, y - 0.038, z), (hinge, y + 0.038, z)))
    made.solid(*solid_rods(0.03, (0.0, y, z), (hinge, y, z)))
    made.moving(
        "fold_down",
        "revolute",
        (hinge, y, z),
        (0.0, 1.0, 0.0),
        math.radians(95),
        mass=2.5,
        fills=((hinge, y - radius, z - 0.15), (length, y + radius, z + radius)),
        slowing=0.1,
        friction=_FOLD_FRICTION,
        drawn_open=True,
    )
    front, below = length - radius, z - 0.14
    path = (
        (hinge, y, z),
        (front, y, z),
        (front, y, below),
        (hinge + 0.06, y, below),
        (hinge, y, z),
    )
    made.draw(rod("metal", radius, *path[:4], path[4], bend=0.06), link="fold_down")
    made.solid(*solid_rods(radius, *path[:4]), link="fold_down")
    made.frame("handle_fold_down", (front, y, z), "front end; pull it down", link="fold_down")
    made.frame("fold_down", (0.5 * (hinge + front), y, z), "middle of the bar when it is down")
