"""Toilets with their grab bars, and rails for towels."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError

from ...rectangle import Rectangle
from ..piece import Zone
from ..rule import Rules
from .joinery import Joinery, front_zone, furniture
from .plumbing import grab_bar
from .stock import solid_rods

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
_OVAL = (1.0, _HALF / _LONG, 1.0)  # what is turned is stretched lengthwise
_REAR_SHORT = 0.305  # of the bar behind it, from the middle to the side wall: ADA 604.5.2
_SIDE_START = 0.3  # of the bar beside it, from the wall behind: ADA 604.5.1, 12 in at most
_FOLD_ASIDE = 0.36  # from the middle to the fold-down bar: 0.7 between bars, common
_FOLD_LONG = 0.75
_FOLD_FRICTION = 3.0  # [N·m] of its hinge: it stays up, and 15 N lift it; own choice
_BESIDE = 0.38  # free on both sides of its middle: IRC R307.1, 15 in, from memory
_FRONT_SPACE = (0.6, 0.76, 1.2)  # ADA 604.3.1: 56 in from the wall behind; level 1, 3: own choice


@furniture("toilet")
def toilet(made: Joinery, *, wall: str = "left") -> None:
    """Make a toilet with tank, lid and seat on hinges, and what bars the rules want.

    `wall` is the side on which the wall beside it is, as one sits: `left`, `right` or `none`; ConfigError
    if it is none of these. Its footprint ends there. Bars beside it are on that wall; one that folds down
    is on the other side. They hang over clear floor, as ADA 604.3.2 lets them, and are no part of it.
    """
    if wall not in ("left", "right", "none"):
        raise ConfigError(f"wall must be one of left, right, none, got {wall!r}")
    rules, side = made.rules, -1.0 if wall == "right" else 1.0
    seat = made.ruled("toilet_seat_height")
    rim = seat - _SEAT - _GAP
    _bowl(made, rim)
    _tank(made, rim, side)
    _seat(made, rim + _GAP)
    _lid(made, seat + _GAP)
    made.frame("seat", (_CENTRE, 0.0, seat), "middle of the seat, facing out")
    reach = 0.23 if wall == "none" else made.ruled("toilet_centre_to_wall")
    bars = rules.choice("grab_bars")
    if bars != "none":
        _wall_bars(made, side, reach if wall != "none" else None)
    folds = bars == "wall_and_fold_down"
    if folds:
        top = rules.figure("grab_bar_height")
        fold_down(made, -side * _FOLD_ASIDE, top=top, length=_FOLD_LONG, diameter=0.035)
    made.zones = [front_zone(_FRONT, _BESIDE, _FRONT_SPACE[rules.level - 1])]
    if rules.has("toilet_side_space"):
        free = made.ruled("toilet_side_space")
        low, high = sorted((-side * 0.21, -side * (0.21 + free)))
        made.zones.append(Zone(Rectangle(0.0, low, 1.42, high)))  # ADA 604.3.1: 56 in deep
    near, far = sorted((side * reach, -side * 0.21))
    made.footprint = Rectangle(0.0, near, _FRONT, far)
    made.height = 1.62 if folds else max(0.86, rim + 0.48)


def _bowl(made: Joinery, rim: float) -> None:
    """Add foot and bowl: a turned body, stretched lengthwise, with a real hollow."""
    outside = ((0.125, 0.0), (0.13, 0.05), (0.125, 0.45 * rim), (0.165, 0.7 * rim))
    brim = ((_LONG - 0.008, rim - 0.035), (_LONG, rim - 0.02), (_LONG - 0.005, rim))
    inside = ((0.165, rim), (0.158, rim - 0.03), (0.125, rim - 0.13), (0.06, rim - 0.2))
    floor, back = rim - 0.2, _TANK_FRONT - 0.1
    made.lathe((_CENTRE, 0.0, 0.0), (*outside, *brim, *inside), "ceramic", scale=_OVAL)
    made.show((0.03, -0.105, 0.0), (_CENTRE, 0.105, rim - 0.1), "ceramic")
    made.show((back, -0.15, rim - 0.1), (_HINGE + 0.06, 0.15, rim - 0.002), "ceramic")
    water = ((0.09, 0.0), (0.001, 0.001))
    made.lathe((_CENTRE, 0.0, rim - 0.165), water, "mirror", scale=_OVAL)
    ends = (_CENTRE - _SLIM[0], _CENTRE + _SLIM[0])
    wide = 0.155  # the boxes stay within the oval where it is narrower
    made.block((0.03, -0.11, 0.0), (_CENTRE + 0.13, 0.11, floor))
    made.block((0.03, -0.13, floor), (ends[0], 0.13, rim))
    made.block((ends[1], -0.11, floor + 0.1), (_FRONT - 0.01, 0.11, rim))
    made.block((ends[0], _SLIM[1], floor + 0.05), (ends[1], wide + 0.02, rim))
    made.block((ends[0], -wide - 0.02, floor + 0.05), (ends[1], -_SLIM[1], rim))
    made.frame("bowl", (_CENTRE, 0.0, floor), "bottom of the bowl")


def _tank(made: Joinery, rim: float, side: float) -> None:
    """Add the tank, with its lever on the open side, as ADA 604.6 wants it."""
    half, x, top = 0.5 * _TANK_WIDTH, _TANK_FRONT, min(rim + 0.37, 0.78)
    made.show((0.02, -half, rim - 0.002), (x, half, top - 0.03), "ceramic", bevel=0.025)
    made.show((0.012, -half - 0.008, top - 0.03), (x + 0.008, half + 0.008, top), "ceramic")
    made.block((0.012, -half, rim - 0.002), (x, half, top))
    y, z = -side * (half - 0.05), top - 0.08
    tip, pivot, axis = y + side * 0.09, (x + 0.012, y, z), (-side, 0.0, 0.0)
    arm = (x + 0.006, min(y, tip), z - 0.008), (x + 0.018, max(y, tip), z + 0.008)
    made.rod(((x, y, z), (x + 0.016, y, z)), 0.014, "metal")
    lever = made.joint(
        "flush", pivot, axis, math.radians(35), mass=0.08, fills=arm, slowing=0.02, friction=0.15
    )
    lever.rod(((x + 0.02, y, z), (x + 0.02, tip, z)), 0.007, "metal", solid=True)
    lever.frame("handle_flush", (x + 0.02, tip, z), "end of the lever; push it down")


def _seat(made: Joinery, low: float) -> None:
    """Add the seat: a ring that lies on the bowl and leans on the lid when it is up."""
    high, front = low + _SEAT, _FRONT + 0.002
    whole = (_HINGE, -_HALF, low), (front, _HALF, high)
    up = math.radians(95)
    seat = made.joint("seat", (_HINGE, 0.0, low), "-y", up, mass=1.3, fills=whole, slowing=0.06)
    long, slim = _LONG + 0.002, _SLIM[0]
    outside = ((slim, low), (long, low), (long, high - 0.007), (long - 0.015, high))
    ring = (*outside, (slim + 0.012, high), (slim, low))
    seat.lathe((_CENTRE, 0.0, 0.0), ring, "white", scale=_OVAL)
    ends = (_CENTRE - slim, _CENTRE + slim)
    seat.block((_HINGE + 0.005, -0.13, low), (ends[0], 0.13, high))
    seat.block((ends[1], -0.11, low), (front, 0.11, high))
    seat.block((ends[0], _SLIM[1], low), (ends[1], _HALF - 0.01, high))
    seat.block((ends[0], 0.01 - _HALF, low), (ends[1], -_SLIM[1], high))
    seat.frame("handle_seat", (front, 0.0, low), "front edge; lift it")


def _lid(made: Joinery, low: float) -> None:
    """Add the lid, which leans past vertical when it is up."""
    high, long, x = low + _LID, _LONG + 0.001, _HINGE - 0.005
    whole = (_HINGE, -_HALF, low), (_FRONT, _HALF, high)
    up = math.radians(98)
    lid = made.joint(
        "lid", (_HINGE, 0.0, low - _SEAT), "-y", up, mass=1.2, fills=whole, slowing=0.06
    )
    shell = ((long, low), (long, high - 0.008), (long - 0.02, high))
    lid.lathe((_CENTRE, 0.0, 0.0), shell, "white", scale=_OVAL)
    lid.rod(((x, -0.1, low - 0.01), (x, 0.1, low - 0.01)), 0.009, "metal")
    lid.block((_HINGE + 0.03, -0.16, low), (_FRONT, 0.16, high))
    out, wide, thick = _LIP
    tip = (_FRONT + out, 0.5 * wide, low + thick)
    lid.box((_FRONT - 0.03, -0.5 * wide, low), tip, "white", bevel=0.004)
    lid.frame("handle_lid", (tip[0] - 0.5 * out, 0.0, low), "under its lip; lift it")
    made.frame("lid", (_CENTRE, 0.0, high), "middle of the lid when it is shut")


def _wall_bars(made: Joinery, side: float, reach: float | None) -> None:
    """Add the bar behind the toilet and, where a wall is at `reach` [m], the one beside it."""
    top, length = made.ruled("grab_bar_height"), made.ruled("grab_bar_rear_length")
    diameter, gap = made.ruled("grab_bar_diameter"), made.ruled("grab_bar_gap")
    z, start, away = top - 0.5 * diameter, side * _REAR_SHORT, gap + 0.5 * diameter
    ends = ((0.0, start, z), (0.0, start - side * length, z))
    grab_bar(made, *ends, (1.0, 0.0, 0.0), diameter=diameter, gap=gap)
    made.frame("grab_bar_rear", (away, start - side * 0.5 * length, z), "middle of the bar")
    if reach is None:
        return
    long, y = made.ruled("grab_bar_side_length"), side * reach
    ends = ((_SIDE_START, y, z), (_SIDE_START + long, y, z))
    grab_bar(made, *ends, (0.0, -side, 0.0), diameter=diameter, gap=gap)
    middle = (_SIDE_START + 0.5 * long, y - side * away, z)
    made.frame("grab_bar_side", middle, "middle of the bar")


def fold_down(made: Joinery, y: float, *, top: float, length: float, diameter: float) -> None:
    """Add a bar on the wall behind that stands up against it and folds down, joint `fold_down`.

    Args:
        made: What it is part of.
        y: Where [m].
        top: Height of its top when it is down [m].
        length: From the wall to its front end [m].
        diameter: Of the bar [m].
    """
    radius, hinge = 0.5 * diameter, 0.12
    z = top - radius
    made.box((0.0, y - 0.05, z - 0.2), (0.012, y + 0.05, z + 0.06), "metal")
    for aside in (-0.03, 0.03):
        made.rod(((0.01, y + aside, z), (hinge, y + aside, z)), 0.012, "metal")
    made.rod(((hinge, y - 0.038, z), (hinge, y + 0.038, z)), 0.016, "metal")
    made.solid(*solid_rods(0.03, (0.0, y, z), (hinge, y, z)))
    fills = ((hinge, y - radius, z - 0.15), (length, y + radius, z + radius))
    name, pivot, turn, friction = "fold_down", (hinge, y, z), math.radians(95), _FOLD_FRICTION
    bar = made.joint(
        name,
        pivot,
        "y",
        turn,
        mass=2.5,
        fills=fills,
        slowing=0.1,
        friction=friction,
        drawn_open=True,
    )
    front, below = length - radius, z - 0.14
    path = ((hinge, y, z), (front, y, z), (front, y, below), (hinge + 0.06, y, below))
    bar.rod((*path, path[0]), radius, "metal", bend=0.06)
    bar.solid(*solid_rods(radius, *path))
    bar.frame("handle_fold_down", (front, y, z), "front end; pull it down")
    made.frame("fold_down", (0.5 * (hinge + front), y, z), "middle of the bar when it is down")


def bar_figures(rules: Rules) -> tuple[float, float, float]:
    """Return height of the top, diameter and gap to the wall of grab bars [m].

    Where the rules of a level want none they are as at the other levels.
    """
    usual = {"grab_bar_height": 0.86, "grab_bar_diameter": 0.035, "grab_bar_gap": 0.038}
    height, diameter, gap = (rules.figure(name, size) for name, size in usual.items())
    return height, diameter, gap


@furniture("towel_rail")
def towel_rail(made: Joinery, *, length: float = 0.6) -> None:
    """Make a rail `length` [m] long with a towel over it, which is only to see."""
    z = (1.3, 1.15, 1.1)[made.rules.level - 1]  # ADA 308: 48 in at most; level 1, 3: own choice
    half, x = 0.5 * length, 0.07
    rail = ((0.0, -half, z), (x, -half, z), (x, half, z), (0.0, half, z))
    made.rod(rail, 0.008, "metal", bend=0.02, solid=True)
    for y in (-half, half):
        made.disc((0.004, y, z), 0.022, 0.008, "metal", along="x")
    low, high = 0.2 - half, 0.2 - half + 0.34
    made.show((x + 0.008, low, z - 0.55), (x + 0.018, high, z), "towel")
    made.show((x - 0.018, low, z - 0.4), (x - 0.008, high, z), "towel")
    made.rod(((x, low, z), (x, high, z)), 0.018, "towel")
    made.show((x + 0.007, low, z - 0.5), (x + 0.0195, high, z - 0.47), "linen")
    made.frame("towel", (x + 0.02, low + 0.5 * 0.34, z - 0.3), "middle of the towel")
    made.outline(0.095, half + 0.025, z + 0.025)
    made.blocks = False
