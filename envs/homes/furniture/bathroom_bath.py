"""Bathtubs."""

from __future__ import annotations

import math

from ...rectangle import Rectangle
from .bathroom_bar import bar_figures
from .joinery import Joinery, front_zone, furniture
from .plumbing import drain, grab_bar, hand_shower, tap

_WALL = 0.07  # [m] thick, with its rim; common, from memory
_RIM = 0.035  # [m], radius of the rim
_FLOOR = 0.12  # [m] over the floor of the room; common, from memory
_RIM_ELSE = 0.45  # [m], where the rules of a level know no bath
_SEAT_DEPTH = 0.4  # [m]: ADA 610.2, 15 to 16 in
_SEAT_BOARD = 0.03  # [m] thick
_SLOPE = 0.24  # [m] by which the head end leans
_TAP_AT, _SHOWER_AT = -0.5, -0.66  # [m] along the wall
_BAR = (-0.33, 0.66)  # [m], ends of the bars along the wall


@furniture("bathtub")
def bathtub(made: Joinery, *, length: float = 1.52, width: float = 0.76) -> None:
    """Make a bathtub, hollow, with its long side at the wall, its tap and a hand shower.

    It is `length` [m] long and stands out by `width` [m].
    """
    rim = _tub(made, length, width)
    _slope(made, rim, length, width)


@furniture("bathtub_with_seat")
def bathtub_with_seat(made: Joinery, *, length: float = 1.52, width: float = 0.76) -> None:
    """Make a bathtub with a seat across its head end, to slide onto, and two bars on the wall.

    It is `length` [m] long and stands out by `width` [m].
    """
    rim = _tub(made, length, width)
    _seat(made, length, width)
    height, diameter, gap = bar_figures(made.rules)
    # ADA 607.4: one bar at the usual height, one 8 to 10 in over the rim.
    for top in (height, rim + 0.23):
        z = top - 0.5 * diameter
        ends = ((0.0, _BAR[0], z), (0.0, _BAR[1], z))
        grab_bar(made, *ends, (1.0, 0.0, 0.0), diameter=diameter, gap=gap)
    made.measures.update(grab_bar_height=height, grab_bar_diameter=diameter, grab_bar_gap=gap)
    middle = (gap + 0.5 * diameter, 0.5 * (_BAR[0] + _BAR[1]), height - 0.5 * diameter)
    made.frame("grab_bar", middle, "middle of the upper bar")


def _tub(made: Joinery, length: float, width: float) -> float:
    """Add floor, walls and rim, tap and drain, and say what floor it needs; return its rim's height [m]."""
    rim = made.ruled("bathtub_rim_height", _RIM_ELSE)
    half, top, level = 0.5 * length, rim - _RIM, made.rules.level
    made.box((0.0, -half, 0.0), (width, half, _FLOOR), "ceramic")
    hollow = Rectangle(_WALL, _WALL - half, width - _WALL, half - _WALL)
    for wall in Rectangle(0.0, -half, width, half).without(hollow):
        made.show((wall.x0, wall.y0, _FLOOR), (wall.x1, wall.y1, top), "ceramic")
        made.block((wall.x0, wall.y0, _FLOOR), (wall.x1, wall.y1, rim))
    start, (a, b), (c, d) = (_RIM, 0.0, top), (_RIM, width - _RIM), (_RIM - half, half - _RIM)
    corners = ((a, d, top), (b, d, top), (b, c, top), (a, c, top))
    made.rod((start, *corners, start), _RIM, "ceramic", bend=0.09)
    for x in (_WALL, width - _WALL):  # fillets where wall and floor meet
        made.rod(((x, _WALL - half, _FLOOR), (x, half - _WALL, _FLOOR)), 0.03, "ceramic")
    for y in (_WALL - half, half - _WALL):
        for x in (_WALL, width - _WALL):
            made.post((x, y, _FLOOR), top, 0.025, "ceramic")
    # A panel in front, set back a little, and its foot.
    front = width + 0.006
    made.show((width, 0.04 - half, 0.06), (front, half - 0.04, top - 0.045), "plastic")
    drain(made, (0.5 * width, 0.25 - half, _FLOOR), radius=0.03)
    tap(made, (0.04, _TAP_AT, rim - 0.004), reach=0.16)
    hand_shower(made, (0.0, _SHOWER_AT, 0.0), (1.0, 0.0, 0.0), low=1.0, high=1.65)
    lying = (0.5 * width, 0.1, _FLOOR)
    made.frame("bath", lying, "middle of the bottom; the head is at the left", yaw_deg=-90.0)
    made.frame("rim", (width - _RIM, 0.0, rim), "middle of the front rim")
    free = 0.6 if level == 1 else 0.76  # ADA 607.2: 30 in along the whole bath; level 1: own choice
    made.outline(front, half, 1.66, front_zone(front, 0.45 if level == 1 else half, free))
    return rim


def _slope(made: Joinery, rim: float, length: float, width: float) -> None:
    """Lean the head end back, to lie against."""
    end, rise, thick = 0.5 * length - _WALL, rim - _FLOOR - 0.02, 0.03
    tilt = math.atan2(_SLOPE, rise)
    y, z = end - 0.5 * _SLOPE, _FLOOR + 0.5 * rise
    # Its inner face runs from the foot of the slope to the rim.
    at = (0.5 * width, y + 0.5 * thick * math.cos(tilt), z - 0.5 * thick * math.sin(tilt))
    size = (width - 2 * _WALL, thick, math.hypot(_SLOPE, rise))
    made.slab(at, size, "ceramic", rpy=(-tilt, 0.0, 0.0))


def _seat(made: Joinery, length: float, width: float) -> None:
    """Add a seat of four boards that lies within the rim."""
    top = made.ruled("bath_seat_height", _RIM_ELSE)
    back = 0.5 * length - _WALL
    x0, x1, low = _WALL - 0.01, width - _WALL + 0.01, top - _SEAT_BOARD
    each = _SEAT_DEPTH / 4
    for i in range(4):
        y = back - each * (i + 1)
        made.show((x0, y + 0.006, low), (x1, y + each - 0.006, top), "wood_light")
    made.block((x0, back - _SEAT_DEPTH, low), (x1, back, top))
    z = low - 0.012
    for x in (x0 + 0.06, x1 - 0.06):
        made.rod(((x, back - _SEAT_DEPTH, z), (x, back, z)), 0.012, "metal")
    seat = (0.5 * width, back - 0.5 * _SEAT_DEPTH, top)
    made.frame("seat", seat, "middle of the seat, facing the tap", yaw_deg=-90.0)
