"""Base units of a fitted kitchen: cupboards, drawers, sink, hob, oven and dishwasher."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rcare_marl.model.shape import Shape, Triple

from ...rectangle import Rectangle
from .joinery import Joinery
from .kitchen_layout import Unit, joined

# Depths and heights [m]; common, from memory.
DEPTH = 0.6  # of the worktop; bar handles stay within it
CARCASS = 0.54
FRONT = 0.018
FACE = CARCASS + FRONT  # of doors and drawers
DRAWER = 0.07  # where drawers end at the back
BOARD = 0.016
WORKTOP = 0.04
PLINTH = 0.10
TOE = 0.06  # that the plinth stands back
BOWL = (0.10, 0.48)  # of the sink, along the depth
SHELL = 0.012
# Springs carry most of a drop-down door of 5 to 8 kg, which Bullet has no joint for: the mass is what
# they leave, so that friction holds it wherever it is let go of, and 22 N close it; own choice.
OVEN_DOOR = (1.9, 4.2)  # [kg], [N·m]
WASHER_DOOR = (1.5, 5.0)


@dataclass(frozen=True)
class Run:
    """What the units of one run have in common; their x counts from their backs.

    Attributes:
        made: What they are added to.
        back: Where their backs are along x [m]; 0 at a wall.
        top: Height of the worktop [m].
        knee: Free height for knees where a unit is open [m]; 0 where none is.
        knee_depth: Free depth for knees from the front edge of the worktop [m].
    """

    made: Joinery
    back: float
    top: float
    knee: float = 0.0
    knee_depth: float = 0.0

    @property
    def under(self) -> float:
        """Height of the underside of the worktop [m]."""
        return self.top - WORKTOP

    @property
    def bowl_bottom(self) -> float:
        """Height of the underside of the bowl of the sink [m]."""
        return max(self.top - 0.19, self.knee)

    def at(self, x: float, y: float, z: float) -> Triple:
        """Return a point in the piece."""
        return self.back + x, y, z

    def box(self, low: Triple, high: Triple, material: str) -> None:
        """Add a box; see `Joinery.box`."""
        self.made.box(self.at(*low), self.at(*high), material)

    def show(self, low: Triple, high: Triple, material: str, link: str = "") -> None:
        """Add a box for the eye, to a link if one is named; see `Joinery.show`."""
        made = self.made.on(link) if link else self.made
        made.show(self.at(*low), self.at(*high), material)

    def post(self, foot: Triple, top: float, radius: float, material: str) -> None:
        """Add an upright rod for the eye; see `Joinery.post`."""
        self.made.post(self.at(*foot), top, radius, material)

    def frame(self, name: str, at: Triple, note: str, *, yaw_deg: float = 0.0) -> None:
        """Name a place; see `Joinery.frame`."""
        self.made.frame(name, self.at(*at), note, yaw_deg=yaw_deg)


def add_units(run: Run, units: tuple[Unit, ...], front: float = 0.0) -> None:
    """Add units with their worktop, of which `front` [m] more hangs over behind an island."""
    for number, unit in enumerate(units, start=1):
        _unit(run, unit, number)
    _boards(run, units)
    _worktop(run, units, front)


def _unit(run: Run, unit: Unit, number: int) -> None:
    """Add what stands under the worktop at one unit, without the boards between units."""
    makers = {
        "drawers": _drawers,
        "oven_hob": _oven,
        "oven": _oven,
        "dishwasher": _dishwasher,
        "knee_sink": _knee,
        "knee_hob": _knee,
        "corner": _blind,
        "filler": _blind,
    }
    makers.get(unit.kind, _cupboard)(run, unit, number)
    if unit.kind.endswith("sink"):
        _bowl(run, unit)
        _tap(run, unit)
    if unit.kind.endswith("hob"):
        _hob(run, unit)


def _boards(run: Run, units: tuple[Unit, ...]) -> None:
    """Add the boards between units, plinth and back."""
    top = run.under
    ends = [units[0].y0, *(unit.y1 for unit in units)]
    for place, y in enumerate(ends):
        beside = units[max(place - 1, 0) : place + 1]
        if all(unit.is_open for unit in beside):
            continue
        # Between units it takes from both; beside an open one, only from the closed one.
        low, high = y - 0.5 * BOARD, y + 0.5 * BOARD
        if place == 0 or beside[0].is_open:
            low, high = y, y + BOARD
        elif place == len(units) or beside[-1].is_open:
            low, high = y - BOARD, y
        run.box((0.0, low, 0.0), (CARCASS, high, top), "front")
    for low, high in joined(unit for unit in units if not unit.is_open):
        run.box((CARCASS - TOE - BOARD, low, 0.0), (CARCASS - TOE, high, PLINTH), "front")
        run.box((0.0, low, PLINTH), (CARCASS, high, PLINTH + BOARD), "trim")
        run.box((0.0, low, PLINTH), (SHELL, high, top), "trim")


def _worktop(run: Run, units: tuple[Unit, ...], front: float) -> None:
    """Add the worktop, with a hole for the bowl."""
    low, high, z0, z1 = units[0].y0, units[-1].y1, run.under, run.top
    sink = next((unit for unit in units if unit.kind.endswith("sink")), None)
    spans = [(-front, low, DEPTH, high)]
    if sink is not None:
        y0, y1 = _bowl_span(sink)
        spans = [(-front, low, DEPTH, y0), (-front, y1, DEPTH, high)]
        spans += [(-front, y0, BOWL[0], y1), (BOWL[1], y0, DEPTH, y1)]
    for a, b, c, d in spans:
        run.box((a, b, z0), (c, d, z1), "worktop")


def _drawers(run: Run, unit: Unit, number: int) -> None:
    low, high = PLINTH, run.under - 0.006
    first = 0.16  # [m] of the uppermost, for cutlery
    rest = 0.5 * (high - low - first)
    levels = (high, high - first, high - first - rest, low)
    for place in range(3):
        a = run.at(DRAWER, unit.y0, levels[place + 1])
        b, name = run.at(FACE, unit.y1, levels[place]), f"drawer_{number}_{place + 1}"
        run.made.drawer(name, a, b, "front", travel=0.4, inner="trim", framed=place > 0)
    lanes, z = max(2, int((unit.y1 - unit.y0 - 0.12) / 0.09)), levels[1] + 0.034
    for lane in range(lanes):
        y, material = unit.y0 + 0.08 + 0.09 * lane, "metal" if lane % 2 else "wood_light"
        run.show((0.20, y, z), (0.40, y + 0.045, z + 0.012), material, f"drawer_{number}_1")


def _cupboard(run: Run, unit: Unit, number: int) -> None:
    low, high = PLINTH, run.under - 0.006
    is_single = unit.y1 - unit.y0 <= 0.5 + 1e-9 and not unit.kind.endswith("sink")
    spans = [(unit.y0, unit.y1)] if is_single else [(unit.y0, unit.middle), (unit.middle, unit.y1)]
    for place, (y0, y1) in enumerate(spans):
        name = f"door_{number}" if is_single else f"door_{number}_{place + 1}"
        a, b, z = run.at(CARCASS, y0, low), run.at(FACE, y1, high), high - 0.12
        run.made.door(name, a, b, "front", left=place > 0, handle_z=z, framed=True)
    if unit.kind == "doors":
        z, y = 0.5 * (low + high), unit.y0 + 0.16
        run.box((0.01, unit.y0, z), (0.46, unit.y1, z + BOARD), "trim")
        z += BOARD
        run.post((0.25, y, z), z + 0.08, 0.12, "ceramic")
        if unit.y1 - unit.y0 > 0.45:
            run.post((0.25, unit.y1 - 0.14, z), z + 0.1, 0.08, "clay")
        run.post((0.25, unit.middle, PLINTH + BOARD), PLINTH + 0.16, 0.11, "metal")
    else:  # what drains and feeds needs the room; soap stands beside
        foot, y = (0.30, unit.y0 + 0.06, PLINTH + BOARD), unit.y0 + 0.12
        run.show(foot, (0.37, y, PLINTH + 0.24), "accent")


def _drop_door(
    run: Run,
    name: str,
    unit: Unit,
    z: tuple[float, float],
    weight: tuple[float, float],
    material: str,
    thickness: float,
) -> None:
    """Hang a door on its lower edge; `weight` is its mass [kg] and the friction that holds it [N·m]."""
    turn, pivot = 0.5 * math.pi - 0.02, run.at(FACE, unit.middle, z[0])
    mass, friction = weight
    door = run.made.joint(name, pivot, "y", turn, mass=mass, damping=0.6, friction=friction)
    low = run.at(FACE - thickness, unit.y0 + 0.003, z[0])
    door.box(low, run.at(FACE, unit.y1 - 0.003, z[1]), material)
    at = run.at(FACE, unit.middle, z[1] - 0.045)
    door.handle(at, length=unit.y1 - unit.y0 - 0.14, style="bar")


def _oven(run: Run, unit: Unit, number: int) -> None:
    high = run.under - 0.006
    bottom = high - 0.10 - 0.46
    if bottom > PLINTH + 0.1:  # a drawer for trays is left below
        a, b = run.at(DRAWER, unit.y0, PLINTH), run.at(FACE, unit.y1, bottom)
        run.made.drawer(f"drawer_{number}", a, b, "front", travel=0.4, inner="trim")
    else:
        run.box((CARCASS, unit.y0 + 0.002, PLINTH), (FACE, unit.y1 - 0.002, bottom), "front")
    top = bottom + 0.46
    oven_front(run, unit, bottom, top)
    run.box((0.3, unit.y0 + 0.01, top), (FACE, unit.y1 - 0.01, high), "metal")
    oven_controls(run, unit, 0.5 * (top + high))


def oven_front(run: Run, unit: Unit, z0: float, z1: float) -> None:
    """Add the cavity of an oven and its drop-down door, between two heights [m]."""
    oven_cavity(run, unit, z0, z1)
    _drop_door(run, "oven_door", unit, (z0, z1 - 0.002), OVEN_DOOR, "metal_dark", 0.03)
    a, b = (FACE, unit.y0 + 0.08, z0 + 0.08), (FACE + 0.002, unit.y1 - 0.08, z1 - 0.1)
    run.show(a, b, "black", "oven_door")


def oven_cavity(run: Run, unit: Unit, z0: float, z1: float) -> None:
    """Add the hollow of an oven with its rack and tray."""
    low, high, front = unit.y0 + 0.03, unit.y1 - 0.03, FACE - 0.03
    run.box((0.05, low, z0), (front, high, z0 + 0.02), "metal_dark")
    run.box((0.05, low, z1 - 0.03), (front, high, z1), "metal_dark")
    run.box((0.05, low, z0), (0.07, high, z1), "metal_dark")
    for y0, y1 in ((low, low + 0.015), (high - 0.015, high)):
        run.box((0.05, y0, z0), (front, y1, z1), "metal_dark")
    for z, material in ((z0 + 0.16, "metal"), (z0 + 0.27, "black")):
        run.box((0.08, low + 0.016, z), (0.46, high - 0.016, z + 0.012), material)


def oven_controls(run: Run, unit: Unit, z: float) -> None:
    """Add the knobs and the clock of an oven, for the eye only."""
    for k in (-2, -1, 1, 2):
        y = unit.middle + 0.1 * k
        run.made.rod((run.at(FACE, y, z), run.at(FACE + 0.022, y, z)), 0.017, "metal_dark")
    y = unit.middle
    run.show((FACE, y - 0.05, z - 0.018), (FACE + 0.002, y + 0.05, z + 0.018), "black")


def _dishwasher(run: Run, unit: Unit, number: int) -> None:
    high, low, top = run.under - 0.006, unit.y0 + 0.03, unit.y1 - 0.03
    _drop_door(run, "dishwasher_door", unit, (PLINTH, high), WASHER_DOOR, "front", 0.025)
    for z, count, tall in ((PLINTH + 0.10, 6, 0.20), (PLINTH + 0.38, 5, 0.09)):  # racks
        run.box((0.05, low, z), (0.50, top, z + 0.012), "metal")
        for k in range(count):
            y = low + 0.06 + k * (top - low - 0.12) / (count - 1)
            material = "ceramic" if k % 3 else "glass"
            run.show((0.12, y, z + 0.012), (0.36, y + 0.008, z + 0.012 + tall), material)
    for y0, y1 in ((low - 0.014, low), (top, top + 0.014)):
        run.show((0.02, y0, PLINTH + BOARD), (0.51, y1, high), "metal")


def _knee(run: Run, unit: Unit, number: int) -> None:
    """Leave room for knees: only a panel at the back, in front of trap and pipes."""
    face = DEPTH - run.knee_depth
    top = run.under if unit.kind == "knee_hob" else run.bowl_bottom
    run.box((face - SHELL, unit.y0, 0.0), (face, unit.y1, top), "front")
    if unit.kind == "knee_hob":  # what keeps the heat of the hob from knees
        run.box((0.1, unit.y0 + 0.05, run.knee), (0.55, unit.y1 - 0.05, run.under), "metal")
    else:  # insulated trap, behind the panel's upper edge
        y, z = unit.middle, run.bowl_bottom - 0.05
        run.made.rod((run.at(0.02, y, z), run.at(face - SHELL, y, z)), 0.024, "plastic")
        low = (DEPTH - 0.06, unit.y0, run.under - 0.02)
        run.show(low, (DEPTH - 0.04, unit.y1, run.under), "front")


def _blind(run: Run, unit: Unit, number: int) -> None:
    """Close a unit by a board that does not open."""
    run.box((CARCASS, unit.y0 + 0.001, PLINTH), (FACE, unit.y1 - 0.001, run.under), "front")


def _bowl_span(sink: Unit) -> tuple[float, float]:
    half = min(0.26, 0.5 * (sink.y1 - sink.y0) - 0.05)
    return sink.middle - half, sink.middle + half


def _bowl(run: Run, unit: Unit) -> None:
    (y0, y1), (x0, x1), z0, z1 = _bowl_span(unit), BOWL, run.bowl_bottom, run.top + 0.002
    run.box((x0, y0, z0), (x1, y1, z0 + SHELL), "metal")
    for low, high in ((x0, x0 + SHELL), (x1 - SHELL, x1)):
        run.box((low, y0, z0), (high, y1, z1), "metal")
    for low, high in ((y0, y0 + SHELL), (y1 - SHELL, y1)):
        run.box((x0, low, z0), (x1, high, z1), "metal")
    hole = Rectangle(run.back + x0, y0, run.back + x1, y1)  # its rim laps over the worktop
    run.made.ring(hole.grown(0.018), hole, (run.top, run.top + 0.003), "metal", solid=False)
    x, y, floor = 0.5 * (x0 + x1), unit.middle, z0 + SHELL
    run.post((x, y, floor), floor + 0.003, 0.035, "metal_dark")
    run.frame("basin", (x, y, floor), "bottom of the bowl")
    note = "where one stands or wheels at the sink"
    run.frame("stand_sink", (DEPTH + 0.3, y, 0.0), note, yaw_deg=180.0)


def _tap(run: Run, unit: Unit) -> None:
    """Add the spout, and what works it: two knobs, or a lever that is lifted."""
    made, x, y, z = run.made, run.back + 0.05, unit.middle, run.top
    made.post((x, y, z), z + 0.03, 0.026, "metal", solid=True)
    path = ((x, y, z + 0.02), (x, y, z + 0.27), (x + 0.19, y, z + 0.27), (x + 0.19, y, z + 0.2))
    made.rod(path, 0.011, "metal", bend=0.07)
    made.solid(Shape("capsule", points=path[:2], radius=0.012))
    made.frame("tap", path[-1], "mouth of the spout")
    if made.rules.choice("tap") == "knob":
        for name, side in (("tap_cold", -1), ("tap_hot", 1)):
            at = (x, y + 0.085 * side, z + 0.05)
            made.post((*at[:2], z), z + 0.035, 0.014, "metal")
            knob = made.joint(name, at, "z", 3.0, mass=0.1, damping=0.002)
            knob.post((*at[:2], z + 0.036), z + 0.066, 0.02, "metal", solid=True)
            low, high = (x - 0.028, at[1] - 0.006, z + 0.045), (x + 0.028, at[1] + 0.006, z + 0.06)
            knob.show(low, high, "metal")
            made.frame(f"handle_{name}", (x + 0.028, at[1], z + 0.052), f"rim of {name}")
        return
    at = (x, y - 0.03, z + 0.1)
    made.rod(((x, y, at[2]), at), 0.014, "metal")
    # Lifted about x, it reaches out along -y: a loop that a hand or an arm can lift.
    lever = made.joint("tap", at, "-x", 0.6, mass=0.12, damping=0.004, friction=0.1)
    lever.box((x - 0.010, at[1] - 0.13, at[2] - 0.006), (x + 0.010, at[1], at[2] + 0.006), "metal")
    made.frame("handle_tap", (x, at[1] - 0.12, at[2]), "end of the lever")


def _hob(run: Run, unit: Unit) -> None:
    y, z, half = unit.middle, run.top + 0.006, 0.285
    run.box((0.06, y - half, run.top), (0.56, y + half, z), "black")
    for x, aside, radius in (
        (0.19, -0.14, 0.08),
        (0.19, 0.14, 0.1),
        (0.42, -0.14, 0.1),
        (0.42, 0.14, 0.08),
    ):
        run.post((x, y + aside, z), z + 0.001, radius, "metal_dark")
        run.post((x, y + aside, z + 0.001), z + 0.002, radius - 0.012, "black")
    for k in range(4):
        run.post((0.535, y - 0.06 + 0.04 * k, z), z + 0.002, 0.010, "plastic")
    run.frame("hob", (0.31, y, run.top + 0.008), "middle of the hob")
    note = "where one stands or wheels at the hob"
    run.frame("stand_hob", (DEPTH + 0.3, y, 0.0), note, yaw_deg=180.0)
