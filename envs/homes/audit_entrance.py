"""Measures what leads up to the entrance, from the solids that are built there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from rcare_marl.model.shape import Shape
from rcare_marl.pose import Array

from ..rectangle import Rectangle
from .care_home import CareHome
from .entrance import build_entrance
from .measurement import Measurement
from .plan import Plan
from .shell_canvas import Canvas

TILTED = math.radians(0.5)  # least tilt of a ramp; own choice
RIM = 0.05  # [m] beyond a floor at which one looks for the house; own choice
FLUSH = 0.013  # [m], most rise that is no step: ADA 303.3


def measure_entrance(home: CareHome) -> Iterator[Measurement]:
    """Yield how one comes up to each entrance, how high, how steep and how wide."""
    for opening in home.plan.openings.values():
        if opening.kind != "entrance":
            continue
        canvas = Canvas()
        build_entrance(canvas, opening, home.plan, home.rules)
        boxes = [shape for shape in canvas.solids if shape.kind == "box"]
        ramps = [box for box in boxes if _tilt(box) > TILTED]
        level = [box for box in boxes if box not in ramps and not is_yard(box, home.plan)]
        rise = max((0.5 * box.size[2] - box.at[2] for box in level), default=0.0)
        room, name = opening.rooms[0], opening.name
        word = "ramp" if ramps else "steps" if rise > FLUSH else "level"
        yield Measurement("entrance_way", room, name, word)
        yield Measurement("entrance_rise", room, name, rise)
        if ramps:
            yield Measurement("ramp_slope", room, name, max(math.tan(_tilt(b)) for b in ramps))
            yield Measurement("ramp_width", room, name, ramp_width(ramps))


def ramp_width(ramps: Sequence[Shape]) -> float:
    """Return the free width of a ramp between its curbs, all boxes with the same turn [m].

    The widest box is what one goes on; those that stand higher are curbs.
    """
    deck = max(ramps, key=lambda box: box.size[1])
    back = deck.pose().inverse()
    low, high = -0.5 * deck.size[1], 0.5 * deck.size[1]
    for box in ramps:
        _, y, z = (back @ box.pose()).position
        if z + 0.5 * box.size[2] <= 0.5 * deck.size[2] + 1e-6:
            continue
        if y > 0:
            high = min(high, y - 0.5 * box.size[1])
        else:
            low = max(low, y + 0.5 * box.size[1])
    return high - low


def is_yard(box: Shape, plan: Plan) -> bool:
    """Return whether the house stands on all sides of a level floor, so that nobody steps off it."""
    (x, y, _), (wide, deep, _) = box.at, box.size
    area = Rectangle(x - 0.5 * wide, y - 0.5 * deep, x + 0.5 * wide, y + 0.5 * deep)
    rim = area.grown(RIM)
    xs, ys = (np.linspace(a, b, 40).tolist() for a, b in ((area.x0, area.x1), (area.y0, area.y1)))
    beside = [(x, y) for x in xs for y in (rim.y0, rim.y1)]
    beside += [(x, y) for y in ys for x in (rim.x0, rim.x1)]
    return all(any(part.has(*point) for part in plan.outline) for point in beside)


def _tilt(box: Shape) -> float:
    """Return the angle between the top of a box and the level [rad]."""
    up: Array = box.pose().matrix()[:3, 2]
    return math.atan2(math.hypot(float(up[0]), float(up[1])), float(up[2]))
