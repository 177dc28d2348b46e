"""What stands in studies. Sizes are common ones, from memory, unless a rule sets them."""

from __future__ import annotations

import math

from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from ..piece import Piece, Setting, maker
from .joinery import BOARD, Joinery


@maker("desk")
def make_desk(
    setting: Setting, *, width: float = 1.4, depth: float = 0.7, monitor: bool = True
) -> Piece:
    """Make a desk with three drawers on the left and knee space beside them; a computer on it if asked."""
    rules = setting.rules
    top, half, thick = rules.figure("table_height"), 0.5 * width, 0.025
    under = top - thick
    desk = Joinery("desk", setting)
    desk.box((0.0, -half, under), (depth, half, top), "wood_light")
    desk.box((0.03, -half + 0.02, 0.0), (depth - 0.03, -half + 0.045, under), "wood_light")
    desk.box((0.03, -half + 0.045, 0.35), (0.045, half - 0.42, under), "wood_light")
    y0, y1 = half - 0.42, half - 0.02
    for y in (y0, y1 - BOARD):
        desk.box((0.03, y, 0.0), (depth - 0.03, y + BOARD, under), "wood_light")
    desk.box((0.03, y0 + BOARD, 0.05), (0.045, y1 - BOARD, under), "wood_light")
    desk.box((0.03, y0 + BOARD, 0.05), (depth - 0.03, y1 - BOARD, 0.05 + BOARD), "wood_light")
    low = 0.05 + BOARD
    step = (under - low) / 3
    for k in range(3):
        desk.drawer(
            f"drawer_{3 - k}",
            (0.05, y0 + BOARD, low + k * step),
            (depth - 0.03, y1 - BOARD, low + (k + 1) * step),
            "front",
        )
    seat = 0.5 * (-half + 0.045 + y0)  # in the middle of the knee space
    if monitor:
        _computer(desk, seat, top)
    desk.measures.update(table_height=top, table_knee_height=under)
    desk.knee.append(Rectangle(0.045, -half + 0.045, depth, y0))
    desk.frame("tabletop", (0.6 * depth, y1 - 0.2, top), "free part of the top")
    desk.frame(
        "place_1", (depth + 0.35, seat, 0.0), "floor where one sits, facing the desk", yaw_deg=180.0
    )
    deep = 0.8 if rules.level == 1 else 0.95
    desk.stand_zone(seat - 0.4, seat + 0.4, deep, x=depth)
    return desk.piece()


def _computer(desk: Joinery, y: float, top: float) -> None:
    """Put a screen, a keyboard and a mouse on a desk at `y` [m]."""
    desk.box((0.1, y - 0.3, top + 0.12), (0.13, y + 0.3, top + 0.46), "black")
    desk.box(
        (0.13, y - 0.29, top + 0.135), (0.132, y + 0.29, top + 0.45), "metal_dark", solid=False
    )
    desk.box((0.08, y - 0.02, top), (0.1, y + 0.02, top + 0.3), "metal", solid=False)
    desk.box((0.05, y - 0.12, top), (0.23, y + 0.12, top + 0.01), "metal", solid=False)
    desk.box((0.36, y - 0.22, top), (0.5, y + 0.22, top + 0.02), "metal_dark", solid=False)
    desk.slab((0.43, y - 0.3, top + 0.015), (0.1, 0.06, 0.03), "metal_dark", solid=False)
    desk.frame("monitor", (0.132, y, top + 0.29), "middle of the screen, x out of it")


@maker("office_chair")
def make_office_chair(setting: Setting) -> Piece:
    """Make an office chair on a five-armed foot; its seat turns about the column."""
    chair, x = Joinery("office_chair", setting), 0.32
    top = setting.rules.figure("seat_height")
    for k in range(5):
        angle = 2 * math.pi * (k + 0.5) / 5
        tip = (x + 0.27 * math.cos(angle), 0.27 * math.sin(angle))
        chair.rod([(x, 0.0, 0.1), (*tip, 0.075)], 0.018, "metal_dark", solid=True)
        chair.rod(
            [(tip[0], tip[1] - 0.02, 0.03), (tip[0], tip[1] + 0.02, 0.03)],
            0.03,
            "rubber",
            solid=True,
        )
    chair.rod([(x, 0.0, 0.08), (x, 0.0, top - 0.12)], 0.03, "metal_dark", solid=True)
    chair.moving(
        "turn",
        "revolute",
        (x, 0.0, top - 0.1),
        (0.0, 0.0, 1.0),
        math.pi,
        density=100.0,
        damping=0.3,
    )
    chair.box(
        (x - 0.23, -0.24, top - 0.08), (x + 0.25, 0.24, top), "fabric", link="turn", bevel=0.035
    )
    chair.box((x - 0.12, -0.1, top - 0.11), (x + 0.12, 0.1, top - 0.08), "metal_dark", link="turn")
    chair.slab(
        (x - 0.24, 0.0, top + 0.36),
        (0.06, 0.44, 0.46),
        "fabric",
        rpy=(0.0, -0.12, 0.0),
        link="turn",
        bevel=0.028,
    )
    chair.slab(
        (x - 0.255, 0.0, top + 0.05),
        (0.02, 0.08, 0.36),
        "metal_dark",
        rpy=(0.0, -0.12, 0.0),
        link="turn",
    )
    for y in (-0.28, 0.28):
        chair.rod(
            [(x, 0.75 * y, top - 0.09), (x, y, top - 0.05), (x, y, top + 0.19)],
            0.013,
            "metal_dark",
            link="turn",
            solid=True,
        )
        chair.box(
            (x - 0.12, y - 0.03, top + 0.19),
            (x + 0.14, y + 0.03, top + 0.22),
            "rubber",
            link="turn",
        )
    chair.measures["seat_height"] = top
    chair.frame("seat", (x + 0.02, 0.0, top), "middle of the seat")
    chair.frame(
        "handle_turn", (x + 0.14, 0.28, top + 0.2), "front of the left armrest", yaw_deg=90.0
    )
    return chair.piece()


@maker("piano")
def make_piano(setting: Setting) -> Piece:
    """Make an upright piano with a lid over the keys that turns up and rests against the case."""
    piano, half, high = Joinery("piano", setting), 0.74, 1.2
    piano.box((0.0, -half, 0.0), (0.34, half, high - 0.03), "wood_dark")
    piano.box((0.0, -half - 0.02, high - 0.03), (0.37, half + 0.02, high), "wood_dark")
    piano.box((0.34, -half, 0.58), (0.6, half, 0.68), "wood_dark")
    for y in (-half, half - 0.06):
        piano.box((0.34, y, 0.68), (0.6, y + 0.06, 0.78), "wood_dark")
        piano.box((0.52, y, 0.0), (0.58, y + 0.06, 0.58), "wood_dark")
        piano.box((0.34, y, 0.0), (0.6, y + 0.06, 0.06), "wood_dark")
    keys = half - 0.07
    piano.box((0.43, -keys, 0.68), (0.58, keys, 0.7), "white")
    for k in range(36):  # five of seven steps of an octave
        if k % 7 not in (2, 6):
            y = -keys + (k + 1) * 2 * keys / 36
            piano.box((0.43, y - 0.008, 0.7), (0.52, y + 0.008, 0.71), "black", solid=False)
    # The lid lies over the keys; friction holds it wherever it is left.
    piano.moving(
        "lid",
        "revolute",
        (0.39, 0.0, 0.775),
        (0.0, -1.0, 0.0),
        math.radians(88.0),
        density=300.0,
        damping=0.3,
        friction=1.9,
    )
    piano.box((0.39, -keys, 0.765), (0.595, keys, 0.78), "wood_dark", link="lid")
    piano.box((0.34, -keys, 0.76), (0.386, keys, 0.78), "wood_dark")
    piano.frame("handle_lid", (0.595, 0.0, 0.77), "front edge of the lid")
    for y in (-0.05, 0.05):
        piano.rod([(0.34, y, 0.05), (0.44, y, 0.04)], 0.012, "brass")
    piano.box((0.34, -0.32, 0.9), (0.355, 0.32, 1.12), "paper", solid=False)
    top = setting.rules.figure("seat_height") + 0.03
    piano.box((0.85, -0.4, top - 0.06), (1.18, 0.4, top), "rubber", bevel=0.02)
    piano.legs(Rectangle(0.87, -0.37, 1.16, 0.37), top - 0.06, 0.05, "wood_dark")
    piano.frame(
        "seat", (1.02, 0.0, top), "middle of the stool, x away from the keys", yaw_deg=180.0
    )
    piano.draw(
        Shape(
            kind="lathe",
            material="leaf",
            at=(0.15, -0.5, high),
            profile=((0.05, 0.0), (0.07, 0.1), (0.035, 0.18), (0.045, 0.22)),
        )
    )
    piano.stand_zone(-0.5, 0.5, 0.5, x=1.18)
    return piano.piece()
