"""What leads up to the entrance: a porch with steps, or a landing with a ramp."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape, Triple
from rcare_marl.pose import Pose, quaternion_from_rpy

from ..rectangle import Rectangle
from .plan import JAMB, Opening, Plan
from .rule import Rules
from .shell_canvas import Canvas

# Lengths in metres.
LANDING = 1.525  # ADA 405.7.3, 60 in
PORCH = (1.5, 1.1)  # of usual homes, width and depth; own choice
RISER, TREAD = 0.178, 0.3  # greatest rise of a step, 7 in, and its depth; ADA 504.2
CURB = (0.05, 0.06)  # width and height; ADA 405.9.2 asks for what keeps a 4 in sphere in
RAIL_HEIGHT, RAIL_RADIUS = 0.9, 0.019  # ADA 505.4, 34 to 38 in; 505.7.1
POST_APART = 1.2
PATH = 4.0  # paved beyond the foot; own choice
_THICK = 0.12  # of a ramp


def build_entrance(canvas: Canvas, opening: Opening, plan: Plan, rules: Rules) -> None:
    """Build what leads from the ground up to an entrance door.

    Raises:
        ConfigError: If there is room for it in no direction.
    """
    rise, way = rules.figure("entrance_rise"), rules.choice("entrance_way")
    door, back = opening.pose, -0.5 * opening.thickness
    house = [area.moved(door.inverse()) for area in plan.outline]
    yard = _courtyard(house, back)
    if yard is not None:  # as high as the floor: nobody comes from elsewhere
        canvas.box("paving", yard.moved(door), (-rise, 0.0), solid=True)
        return
    if way == "steps":
        wide, deep = max(PORCH[0], opening.width + 0.3), PORCH[1]
    else:
        wide = max(LANDING, opening.width - 2 * JAMB, _outer_width(rules))
        deep = wide  # so that a chair can turn on it, and the ramp can leave on any side
    landing = _landing(house, wide, deep, back, opening)
    canvas.box("paving", landing.moved(door), (-rise, 0.0), solid=True)
    mat = Rectangle(-0.4, back - 0.65, 0.4, back - 0.15)
    canvas.box("rubber", mat.moved(door), (0.0, 0.008))
    if way == "steps":
        _steps(canvas, door, landing, rise)
    elif way == "ramp":
        _ramp(canvas, opening, landing, plan, rules)


def _courtyard(house: list[Rectangle], back: float) -> Rectangle | None:
    """Return the floor outside a door if the house is all around it, in the frame of the door."""
    near = Rectangle(-0.1, back - 0.2, 0.1, back - 0.1)
    beside = [a for a in house if a.y0 < near.y0 and a.y1 > near.y1]
    left = [a.x1 for a in beside if a.x1 <= near.x0]
    right = [a.x0 for a in beside if a.x0 >= near.x1]
    if not left or not right:
        return None
    low, high = max(left), min(right)
    ahead = [a for a in house if a.x0 < high - 0.01 and a.x1 > low + 0.01 and a.y1 < near.y0]
    if not ahead:
        return None
    yard = Rectangle(low, max(a.y1 for a in ahead), high, back)
    # A yard that is open at a corner is none.
    last = [a for a in ahead if abs(a.y1 - yard.y0) < 0.01]
    spans = sorted((max(a.x0, low), min(a.x1, high)) for a in last)
    walled = sum(b - a for a, b in spans) > yard.width - 0.02
    flanked = all(
        any(a.y0 < y < a.y1 for a in house if abs(getattr(a, side) - x) < 0.01)
        for side, x in (("x1", low), ("x0", high))
        for y in (yard.y0 + 0.02, yard.centre[1])
    )
    return yard if walled and flanked else None


def _landing(
    house: list[Rectangle], wide: float, deep: float, back: float, opening: Opening
) -> Rectangle:
    """Return a landing before a door, moved aside where the house is in its way."""
    spare = 0.5 * (wide - opening.width)
    shifts = [sign * 0.05 * k for k in range(int(spare / 0.05) + 1) for sign in (1, -1)]
    for shift in (*shifts, spare, -spare):
        landing = Rectangle(shift - 0.5 * wide, back - deep, shift + 0.5 * wide, back)
        if not any(area.overlaps(landing, by=0.01) for area in house):
            return landing
    return Rectangle(-0.5 * wide, back - deep, 0.5 * wide, back)


def _outer_width(rules: Rules) -> float:
    return rules.figure("ramp_width") + 2 * CURB[0]


def _steps(canvas: Canvas, door: Pose, landing: Rectangle, rise: float) -> None:
    """Steps straight out, with a handrail on the right as one leaves."""
    count = math.ceil(rise / RISER - 1e-6)
    foot = landing.y0
    for k in range(1, count):
        foot = landing.y0 - k * TREAD
        area = Rectangle(landing.x0, foot, landing.x1, foot + TREAD)
        canvas.box("paving", area.moved(door), (-rise, -rise * k / count), solid=True)
    x, edge = landing.x0 + 0.05, landing.y0
    _rail(canvas, door, (x, landing.y1 - 0.1, 0.0), (x, edge, 0.0))
    if foot < edge:
        _rail(canvas, door, (x, edge, 0.0), (x, foot, -rise + rise / count))
    _path(canvas, door @ Pose((landing.centre[0], foot, 0.0), _turn(-90.0)), 1.2, rise)


def _ramp(canvas: Canvas, opening: Opening, landing: Rectangle, plan: Plan, rules: Rules) -> None:
    """A ramp with curbs and handrails, straight out, or along the house where that is not free."""
    rise, slope = rules.figure("entrance_rise"), rules.figure("ramp_slope")
    run, clear, outer = rise / slope, rules.figure("ramp_width"), _outer_width(rules)
    door, middle = opening.pose, landing.centre
    # Frames at the edge of the landing, x away from it.
    starts = {
        "out": Pose((middle[0], landing.y0, 0.0), _turn(-90.0)),
        "left": Pose((landing.x1, landing.y0 + 0.5 * outer, 0.0), _turn(0.0)),
        "right": Pose((landing.x0, landing.y0 + 0.5 * outer, 0.0), _turn(180.0)),
    }
    for start in starts.values():
        frame = door @ start
        needed = Rectangle(0.0, -0.5 * outer, run + LANDING, 0.5 * outer).moved(frame)
        if not any(area.overlaps(needed, by=0.01) for area in plan.outline):
            break
    else:
        raise ConfigError(
            f"no room for a ramp of {run:.2f} m before {opening.name!r} of {plan.name}"
        )
    pitch = math.atan2(rise, run)
    tilted = frame @ Pose((0.0, 0.0, 0.0), tuple(quaternion_from_rpy(0.0, pitch, 0.0).tolist()))
    long = math.hypot(run, rise)
    # At its foot the ramp goes on into the ground.
    area = Rectangle(0.0, -0.5 * outer, long + _THICK * slope, 0.5 * outer)
    canvas.box("paving", area, (-_THICK, 0.0), solid=True, pose=tilted)
    for side in (-1, 1):
        y = (0.5 * side * clear, 0.5 * side * outer)
        curb = Rectangle(0.0, min(y), long, max(y))
        canvas.box("paving", curb, (-_THICK, CURB[1]), solid=True, pose=tilted)
        low, high = (0.0, y[1], -rise), (run, y[1], -rise)
        canvas.face("paving", [_at(frame, p) for p in (low, high, high, (0.0, y[1], 0.0))])
        middle_y = 0.5 * (y[0] + y[1])
        _rail(canvas, frame, (0.0, middle_y, 0.0), (run, middle_y, -rise))
    _path(canvas, frame @ Pose((run, 0.0, 0.0)), outer, rise)


def _turn(degrees: float) -> tuple[float, ...]:
    return tuple(quaternion_from_rpy(0.0, 0.0, math.radians(degrees)).tolist())


def _at(frame: Pose, point: Triple) -> Triple:
    x, y, z = (frame @ Pose(point)).position
    return (x, y, z)


def _path(canvas: Canvas, frame: Pose, width: float, rise: float) -> None:
    """Pave the ground beyond the foot of steps or a ramp; x of the frame leads away."""
    area = Rectangle(0.0, -0.5 * width, PATH, 0.5 * width).moved(frame)
    canvas.box("paving", area, (-rise - 0.05, -rise + 0.004))


def _rail(canvas: Canvas, frame: Pose, start: Triple, end: Triple) -> None:
    """Set a handrail on posts above a line on the ground, in the frame [m]."""
    count = max(math.ceil(math.dist(start, end) / POST_APART), 1)
    feet = [
        tuple(a + (b - a) * k / count for a, b in zip(start, end, strict=True))
        for k in range(count + 1)
    ]
    bars = [((x, y, z), (x, y, z + RAIL_HEIGHT), 0.016) for x, y, z in feet]
    (x0, y0, z0), (x1, y1, z1) = start, end
    bars.append(((x0, y0, z0 + RAIL_HEIGHT), (x1, y1, z1 + RAIL_HEIGHT), RAIL_RADIUS))
    for a, b, radius in bars:
        points = (_at(frame, a), _at(frame, b))
        canvas.visual.append(Shape("tube", "metal_dark", radius=radius, points=points))
        canvas.solids.append(Shape("capsule", radius=radius, points=points))
