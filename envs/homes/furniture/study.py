"""What stands in studies. Sizes are common ones, from memory, unless a rule sets them."""

from __future__ import annotations

import math

from ...rectangle import Rectangle
from .joinery import BOARD, Joinery, furniture


@furniture("desk")
def make_desk(
    made: Joinery, *, width: float = 1.4, depth: float = 0.7, monitor: bool = True
) -> None:
    """Make a desk with three drawers on the left and knee space beside them; a computer on it if asked."""
    top, half, thick = made.ruled("table_height"), 0.5 * width, 0.025
    made.measures["table_knee_height"] = under = top - thick
    wood, front, low, y0, y1 = "wood_light", depth - 0.03, 0.05 + BOARD, half - 0.42, half - 0.02
    made.box((0.0, -half, under), (depth, half, top), wood)
    made.box((0.03, -half + 0.02, 0.0), (front, -half + 0.045, under), wood)
    made.box((0.03, -half + 0.045, 0.35), (0.045, y0, under), wood)
    made.sides((0.03, y0, 0.0), (front, y1, under), BOARD, wood)
    made.box((0.03, y0 + BOARD, 0.05), (0.045, y1 - BOARD, under), wood)
    made.box((0.03, y0 + BOARD, 0.05), (front, y1 - BOARD, low), wood)
    step = (under - low) / 3
    for k in range(3):
        a = (0.05, y0 + BOARD, low + k * step)
        b = (front, y1 - BOARD, low + (k + 1) * step)
        made.drawer(f"drawer_{3 - k}", a, b, "front")
    seat = 0.5 * (-half + 0.045 + y0)  # in the middle of the knee space
    if monitor:
        _computer(made, seat, top)
    made.knee.append(Rectangle(0.045, -half + 0.045, depth, y0))
    made.frame("tabletop", (0.6 * depth, y1 - 0.2, top), "free part of the top")
    note = "floor where one sits, facing the desk"
    made.frame("place_1", (depth + 0.35, seat, 0.0), note, yaw_deg=180.0)
    made.stand_zone(seat - 0.4, seat + 0.4, 0.8 if made.rules.level == 1 else 0.95, x=depth)


def _computer(made: Joinery, y: float, top: float) -> None:
    """Put a screen, a keyboard and a mouse on a desk at `y` [m]."""
    made.box((0.1, y - 0.3, top + 0.12), (0.13, y + 0.3, top + 0.46), "black")
    made.show((0.13, y - 0.29, top + 0.135), (0.132, y + 0.29, top + 0.45), "metal_dark")
    made.show((0.08, y - 0.02, top), (0.1, y + 0.02, top + 0.3), "metal")
    made.show((0.05, y - 0.12, top), (0.23, y + 0.12, top + 0.01), "metal")
    made.show((0.36, y - 0.22, top), (0.5, y + 0.22, top + 0.02), "metal_dark")
    made.slab((0.43, y - 0.3, top + 0.015), (0.1, 0.06, 0.03), "metal_dark", solid=False)
    made.frame("monitor", (0.132, y, top + 0.29), "middle of the screen, x out of it")


@furniture("office_chair")
def make_office_chair(made: Joinery) -> None:
    """Make an office chair on a five-armed foot; its seat turns about the column."""
    x, top, dark = 0.32, made.ruled("seat_height"), "metal_dark"
    for k in range(5):
        angle = 2 * math.pi * (k + 0.5) / 5
        a, b = x + 0.27 * math.cos(angle), 0.27 * math.sin(angle)
        made.rod([(x, 0.0, 0.1), (a, b, 0.075)], 0.018, dark, solid=True)
        made.rod([(a, b - 0.02, 0.03), (a, b + 0.02, 0.03)], 0.03, "rubber", solid=True)
    made.post((x, 0.0, 0.08), top - 0.12, 0.03, dark, solid=True)
    seat = made.joint("turn", (x, 0.0, top - 0.1), "z", math.pi, density=100.0, damping=0.3)
    seat.box((x - 0.23, -0.24, top - 0.08), (x + 0.25, 0.24, top), "fabric", bevel=0.035)
    seat.box((x - 0.12, -0.1, top - 0.11), (x + 0.12, 0.1, top - 0.08), dark)
    back, lean = (x - 0.24, 0.0, top + 0.36), (0.0, -0.12, 0.0)
    seat.slab(back, (0.06, 0.44, 0.46), "fabric", rpy=lean, bevel=0.028)
    seat.slab((x - 0.255, 0.0, top + 0.05), (0.02, 0.08, 0.36), dark, rpy=lean)
    z = top + 0.19
    for y in (-0.28, 0.28):
        arm = [(x, 0.75 * y, top - 0.09), (x, y, top - 0.05), (x, y, z)]
        seat.rod(arm, 0.013, dark, solid=True)
        seat.box((x - 0.12, y - 0.03, z), (x + 0.14, y + 0.03, top + 0.22), "rubber")
    made.frame("seat", (x + 0.02, 0.0, top), "middle of the seat")
    grip = (x + 0.14, 0.28, top + 0.2)
    made.frame("handle_turn", grip, "front of the left armrest", yaw_deg=90.0)


@furniture("piano")
def make_piano(made: Joinery) -> None:
    """Make an upright piano with a lid over the keys that turns up and rests against the case."""
    half, high, wood = 0.74, 1.2, "wood_dark"
    made.box((0.0, -half, 0.0), (0.34, half, high - 0.03), wood)
    made.box((0.0, -half - 0.02, high - 0.03), (0.37, half + 0.02, high), wood)
    made.box((0.34, -half, 0.58), (0.6, half, 0.68), wood)
    for y in (-half, half - 0.06):
        made.box((0.34, y, 0.68), (0.6, y + 0.06, 0.78), wood)
        made.box((0.52, y, 0.0), (0.58, y + 0.06, 0.58), wood)
        made.box((0.34, y, 0.0), (0.6, y + 0.06, 0.06), wood)
    keys = half - 0.07
    made.box((0.43, -keys, 0.68), (0.58, keys, 0.7), "white")
    for k in range(36):  # five of seven steps of an octave
        if k % 7 not in (2, 6):
            y = -keys + (k + 1) * 2 * keys / 36
            made.show((0.43, y - 0.008, 0.7), (0.52, y + 0.008, 0.71), "black")
    # The lid lies over the keys; friction holds it wherever it is left.
    pivot, turn = (0.39, 0.0, 0.775), math.radians(88.0)
    lid = made.joint("lid", pivot, "-y", turn, density=300.0, damping=0.3, friction=1.9)
    lid.box((0.39, -keys, 0.765), (0.595, keys, 0.78), wood)
    made.box((0.34, -keys, 0.76), (0.386, keys, 0.78), wood)
    made.frame("handle_lid", (0.595, 0.0, 0.77), "front edge of the lid")
    for y in (-0.05, 0.05):
        made.rod([(0.34, y, 0.05), (0.44, y, 0.04)], 0.012, "brass")
    made.show((0.34, -0.32, 0.9), (0.355, 0.32, 1.12), "paper")
    top = made.rules.figure("seat_height") + 0.03
    made.box((0.85, -0.4, top - 0.06), (1.18, 0.4, top), "rubber", bevel=0.02)
    made.legs(Rectangle(0.87, -0.37, 1.16, 0.37), top - 0.06, 0.05, wood)
    note = "middle of the stool, x away from the keys"
    made.frame("seat", (1.02, 0.0, top), note, yaw_deg=180.0)
    vase = ((0.05, 0.0), (0.07, 0.1), (0.035, 0.18), (0.045, 0.22))
    made.lathe((0.15, -0.5, high), vase, "leaf")
    made.stand_zone(-0.5, 0.5, 0.5, x=1.18)
