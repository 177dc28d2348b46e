"""Base units of a fitted kitchen: cupboards, drawers, sink, hob, oven and dishwasher."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from rcare_marl.model.shape import Shape, Triple

from .joinery import Joinery
from .kitchen_layout import Unit

# Depths and heights [m]; common, from memory.
DEPTH = 0.6  # of the worktop; bar handles stay within it
CARCASS = 0.54
FRONT = 0.018
DRAWER = 0.07  # where drawers end at the back
BOARD = 0.016
WORKTOP = 0.04
PLINTH = 0.10
TOE = 0.06  # that the plinth stands back
BOWL = (0.10, 0.48)  # of the sink, along the depth
SHELL = 0.012
# Springs carry most of a drop-down door of 5 to 8 kg, which Bullet has no joint for: the mass is what
# they leave, so that friction holds it wherever it is let go of, and 22 N close it; own choice.
OVEN_DOOR, OVEN_FRICTION = 1.9, 4.2  # [kg], [N·m]
WASHER_DOOR, WASHER_FRICTION = 1.5, 5.0


@dataclass(frozen=True)
class Run:
    """What the units of one run have in common.

    Attributes:
        assembly: What they are added to.
        back: Where their backs are along x [m]; 0 at a wall.
        top: Height of the worktop [m].
        knee: Free height for knees where a unit is open [m]; 0 where none is.
        knee_depth: Free depth for knees from the front edge of the worktop [m].
    """

    assembly: Joinery
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
        """Return a point whose x counts from the back of the units."""
        return self.back + x, y, z


def add_unit(run: Run, unit: Unit, number: int) -> None:
    """Add what stands under the worktop at one unit, without the boards between units."""
    makers = {
        "drawers": _drawers,
        "doors": _cupboard,
        "sink": _cupboard,
        "hob": _cupboard,
        "oven_hob": _oven,
        "oven": _oven,
        "dishwasher": _dishwasher,
        "knee_sink": _knee,
        "knee_hob": _knee,
        "corner": _blind,
        "filler": _blind,
    }
    makers[unit.kind](run, unit, number)
    if unit.kind.endswith("sink"):
        _bowl(run, unit)
        _tap(run, unit)
    if unit.kind.endswith("hob"):
        _hob(run, unit)


def add_boards(run: Run, units: tuple[Unit, ...]) -> None:
    """Add the boards between units, plinth and back."""
    add, top = run.assembly, run.under
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
        add.box(run.at(0, low, 0.0), run.at(CARCASS, high, top), "front")
    for low, high in _closed_stretches(units):
        add.box(
            run.at(CARCASS - TOE - BOARD, low, 0.0), run.at(CARCASS - TOE, high, PLINTH), "front"
        )
        add.box(run.at(0, low, PLINTH), run.at(CARCASS, high, PLINTH + BOARD), "trim")
        add.box(run.at(0, low, PLINTH), run.at(SHELL, high, top), "trim")


def add_worktop(run: Run, units: tuple[Unit, ...], depth: float, front: float = 0.0) -> None:
    """Add the worktop, with a hole for the bowl; `front` [m] more hangs over behind an island."""
    add, low, high = run.assembly, units[0].y0, units[-1].y1
    sink = next((unit for unit in units if unit.kind.endswith("sink")), None)
    z0, z1 = run.under, run.top
    if sink is None:
        add.box(run.at(-front, low, z0), run.at(depth, high, z1), "worktop")
        return
    y0, y1 = _bowl_span(sink)
    add.box(run.at(-front, low, z0), run.at(depth, y0, z1), "worktop")
    add.box(run.at(-front, y1, z0), run.at(depth, high, z1), "worktop")
    add.box(run.at(-front, y0, z0), run.at(BOWL[0], y1, z1), "worktop")
    add.box(run.at(BOWL[1], y0, z0), run.at(depth, y1, z1), "worktop")


def _closed_stretches(units: tuple[Unit, ...]) -> list[tuple[float, float]]:
    out: list[tuple[float, float]] = []
    for unit in units:
        if unit.is_open:
            continue
        if out and abs(out[-1][1] - unit.y0) < 1e-9:
            out[-1] = (out[-1][0], unit.y1)
        else:
            out.append((unit.y0, unit.y1))
    return out


def _drawers(run: Run, unit: Unit, number: int) -> None:
    low, high = PLINTH, run.under - 0.006
    first = 0.16  # [m] of the uppermost, for cutlery
    rest = 0.5 * (high - low - first)
    levels = (high, high - first, high - first - rest, low)
    for place in range(3):
        joint = f"drawer_{number}_{place + 1}"
        a = run.at(DRAWER, unit.y0, levels[place + 1])
        b = run.at(CARCASS + FRONT, unit.y1, levels[place])
        run.assembly.drawer(joint, a, b, "front", travel=0.4, inner="trim", framed=place > 0)
        if place == 0:
            _cutlery(run, unit, joint, levels[1] + 0.034)


def _cutlery(run: Run, unit: Unit, joint: str, z: float) -> None:
    lanes = max(2, int((unit.y1 - unit.y0 - 0.12) / 0.09))
    for lane in range(lanes):
        y = unit.y0 + 0.08 + 0.09 * lane
        a, b = run.at(0.20, y, z), run.at(0.40, y + 0.045, z + 0.012)
        run.assembly.box(a, b, "metal" if lane % 2 else "wood_light", link=joint, solid=False)


def _cupboard(run: Run, unit: Unit, number: int) -> None:
    add, (low, high) = run.assembly, (PLINTH, run.under - 0.006)
    is_single = unit.y1 - unit.y0 <= 0.5 + 1e-9 and not unit.kind.endswith("sink")
    handle = high - 0.12
    spans = [(unit.y0, unit.y1)] if is_single else [(unit.y0, unit.middle), (unit.middle, unit.y1)]
    for place, (y0, y1) in enumerate(spans):
        joint = f"door_{number}" if is_single else f"door_{number}_{place + 1}"
        a, b = run.at(CARCASS, y0, low), run.at(CARCASS + FRONT, y1, high)
        hinge: Literal["left", "right"] = "left" if place else "right"
        add.door(joint, a, b, "front", hinge=hinge, handle_z=handle, framed=True)
    if unit.kind == "doors":
        z = 0.5 * (low + high)
        add.box(run.at(0.01, unit.y0, z), run.at(0.46, unit.y1, z + BOARD), "trim")
        _crockery(run, unit, z + BOARD)
        add.rod(
            (run.at(0.25, unit.middle, PLINTH + BOARD), run.at(0.25, unit.middle, PLINTH + 0.16)),
            0.11,
            "metal",
        )
    else:  # what drains and feeds needs the room; soap stands beside
        a = run.at(0.30, unit.y0 + 0.06, PLINTH + BOARD)
        add.box(a, run.at(0.37, unit.y0 + 0.12, PLINTH + 0.24), "accent", solid=False)


def _crockery(run: Run, unit: Unit, z: float) -> None:
    add, y = run.assembly, unit.y0 + 0.16
    add.rod((run.at(0.25, y, z), run.at(0.25, y, z + 0.08)), 0.12, "ceramic")
    if unit.y1 - unit.y0 > 0.45:
        add.rod(
            (run.at(0.25, unit.y1 - 0.14, z), run.at(0.25, unit.y1 - 0.14, z + 0.1)), 0.08, "clay"
        )


def drop_door(
    run: Run,
    joint: str,
    unit: Unit,
    z: tuple[float, float],
    *,
    mass: float,
    friction: float,
    material: str,
    thickness: float = 0.03,
) -> None:
    """Hang a door on its lower edge; friction holds it wherever it is let go of."""
    add, face = run.assembly, CARCASS + FRONT
    back = face - thickness
    add.moving(
        joint,
        "revolute",
        run.at(face, unit.middle, z[0]),
        (0.0, 1.0, 0.0),
        0.5 * math.pi - 0.02,
        mass=mass,
        damping=0.6,
        friction=friction,
    )
    low, high = run.at(back, unit.y0 + 0.003, z[0]), run.at(face, unit.y1 - 0.003, z[1])
    add.box(low, high, material, link=joint)
    at = run.at(face, unit.middle, z[1] - 0.045)
    add.handle(joint, at, length=unit.y1 - unit.y0 - 0.14, style="bar")


def _oven(run: Run, unit: Unit, number: int) -> None:
    add, high = run.assembly, run.under - 0.006
    panel = 0.10
    bottom = high - panel - 0.46
    if bottom > PLINTH + 0.1:  # a drawer for trays is left below
        a, b = run.at(DRAWER, unit.y0, PLINTH), run.at(CARCASS + FRONT, unit.y1, bottom)
        add.drawer(f"drawer_{number}", a, b, "front", travel=0.4, inner="trim")
    else:
        a = run.at(CARCASS, unit.y0 + 0.002, PLINTH)
        add.box(a, run.at(CARCASS + FRONT, unit.y1 - 0.002, bottom), "front")
    oven_front(run, unit, bottom, bottom + 0.46)
    controls = (bottom + 0.46, high)
    a = run.at(0.3, unit.y0 + 0.01, controls[0])
    add.box(a, run.at(CARCASS + FRONT, unit.y1 - 0.01, controls[1]), "metal")
    oven_controls(run, unit, 0.5 * (controls[0] + controls[1]))


def oven_front(run: Run, unit: Unit, z0: float, z1: float) -> None:
    """Add the cavity of an oven and its drop-down door, between two heights [m]."""
    oven_cavity(run, unit, z0, z1)
    drop_door(
        run,
        "oven_door",
        unit,
        (z0, z1 - 0.002),
        mass=OVEN_DOOR,
        friction=OVEN_FRICTION,
        material="metal_dark",
    )
    face = CARCASS + FRONT
    a = run.at(face, unit.y0 + 0.08, z0 + 0.08)
    run.assembly.box(
        a, run.at(face + 0.002, unit.y1 - 0.08, z1 - 0.1), "black", link="oven_door", solid=False
    )


def oven_cavity(run: Run, unit: Unit, z0: float, z1: float) -> None:
    """Add the hollow of an oven with its rack and tray."""
    add, low, high = run.assembly, unit.y0 + 0.03, unit.y1 - 0.03
    front = CARCASS + FRONT - 0.03
    add.box(run.at(0.05, low, z0), run.at(front, high, z0 + 0.02), "metal_dark")
    add.box(run.at(0.05, low, z1 - 0.03), run.at(front, high, z1), "metal_dark")
    add.box(run.at(0.05, low, z0), run.at(0.07, high, z1), "metal_dark")
    for y0, y1 in ((low, low + 0.015), (high - 0.015, high)):
        add.box(run.at(0.05, y0, z0), run.at(front, y1, z1), "metal_dark")
    for z, material in ((z0 + 0.16, "metal"), (z0 + 0.27, "black")):
        add.box(run.at(0.08, low + 0.016, z), run.at(0.46, high - 0.016, z + 0.012), material)


def oven_controls(run: Run, unit: Unit, z: float) -> None:
    """Add the knobs and the clock of an oven, for the eye only."""
    add, face = run.assembly, CARCASS + FRONT
    for k in (-2, -1, 1, 2):
        y = unit.middle + 0.1 * k
        add.rod((run.at(face, y, z), run.at(face + 0.022, y, z)), 0.017, "metal_dark")
    a = run.at(face, unit.middle - 0.05, z - 0.018)
    add.box(a, run.at(face + 0.002, unit.middle + 0.05, z + 0.018), "black", solid=False)


def _dishwasher(run: Run, unit: Unit, number: int) -> None:
    add, high, name = run.assembly, run.under - 0.006, "dishwasher_door"
    drop_door(
        run,
        name,
        unit,
        (PLINTH, high),
        mass=WASHER_DOOR,
        friction=WASHER_FRICTION,
        material="front",
        thickness=0.025,
    )
    low, top = unit.y0 + 0.03, unit.y1 - 0.03
    for z, count in ((PLINTH + 0.10, 6), (PLINTH + 0.38, 5)):  # racks
        add.box(run.at(0.05, low, z), run.at(0.50, top, z + 0.012), "metal")
        for k in range(count):
            y = low + 0.06 + k * (top - low - 0.12) / (count - 1)
            tall = 0.20 if count == 6 else 0.09
            a, b = run.at(0.12, y, z + 0.012), run.at(0.36, y + 0.008, z + 0.012 + tall)
            add.box(a, b, "ceramic" if k % 3 else "glass", solid=False)
    for y0, y1 in ((low - 0.014, low), (top, top + 0.014)):
        add.box(run.at(0.02, y0, PLINTH + BOARD), run.at(0.51, y1, high), "metal", solid=False)


def _knee(run: Run, unit: Unit, number: int) -> None:
    """Leave room for knees: only a panel at the back, in front of trap and pipes."""
    add, face = run.assembly, DEPTH - run.knee_depth
    top = run.under if unit.kind == "knee_hob" else run.bowl_bottom
    add.box(run.at(face - SHELL, unit.y0, 0.0), run.at(face, unit.y1, top), "front")
    if unit.kind == "knee_hob":  # what keeps the heat of the hob from knees
        low, high = run.at(0.1, unit.y0 + 0.05, run.knee), run.at(0.55, unit.y1 - 0.05, run.under)
        add.box(low, high, "metal")
    else:  # insulated trap, behind the panel's upper edge
        z = run.bowl_bottom - 0.05
        a, b = run.at(0.02, unit.middle, z), run.at(face - SHELL, unit.middle, z)
        add.rod((a, b), 0.024, "plastic")
        rail = 0.02
        low = run.at(DEPTH - 0.06, unit.y0, run.under - rail)
        add.box(low, run.at(DEPTH - 0.04, unit.y1, run.under), "front", solid=False)


def _blind(run: Run, unit: Unit, number: int) -> None:
    """Close a unit by a board that does not open."""
    a = run.at(CARCASS, unit.y0 + 0.001, PLINTH)
    run.assembly.box(a, run.at(CARCASS + FRONT, unit.y1 - 0.001, run.under), "front")


def _bowl_span(sink: Unit) -> tuple[float, float]:
    half = min(0.26, 0.5 * (sink.y1 - sink.y0) - 0.05)
    return sink.middle - half, sink.middle + half


def _bowl(run: Run, unit: Unit) -> None:
    add, (y0, y1), (x0, x1) = run.assembly, _bowl_span(unit), BOWL
    z0, z1 = run.bowl_bottom, run.top + 0.002
    add.box(run.at(x0, y0, z0), run.at(x1, y1, z0 + SHELL), "metal")
    for low, high in ((x0, x0 + SHELL), (x1 - SHELL, x1)):
        add.box(run.at(low, y0, z0), run.at(high, y1, z1), "metal")
    for low, high in ((y0, y0 + SHELL), (y1 - SHELL, y1)):
        add.box(run.at(x0, low, z0), run.at(x1, high, z1), "metal")
    rim = 0.018  # laps over the worktop
    for a, b, c, d in (
        (x0 - rim, y0 - rim, x0, y1 + rim),
        (x1, y0 - rim, x1 + rim, y1 + rim),
        (x0, y0 - rim, x1, y0),
        (x0, y1, x1, y1 + rim),
    ):
        add.box(run.at(a, b, run.top), run.at(c, d, run.top + 0.003), "metal", solid=False)
    x = 0.5 * (x0 + x1)
    drain = run.at(x, unit.middle, z0 + SHELL)
    add.rod((drain, run.at(x, unit.middle, z0 + SHELL + 0.003)), 0.035, "metal_dark")
    add.frame("basin", run.at(x, unit.middle, z0 + SHELL), note="bottom of the bowl")
    stand = run.at(DEPTH + 0.3, unit.middle, 0.0)
    add.frame("stand_sink", stand, yaw_deg=180.0, note="where one stands or wheels at the sink")


def _tap(run: Run, unit: Unit) -> None:
    """Add the spout, and what works it: two knobs, or a lever that is lifted."""
    add, x, y, z = run.assembly, 0.05, unit.middle, run.top
    add.rod((run.at(x, y, z), run.at(x, y, z + 0.03)), 0.026, "metal", solid=True)
    path = ((x, y, z + 0.02), (x, y, z + 0.27), (x + 0.19, y, z + 0.27), (x + 0.19, y, z + 0.2))
    points = tuple(run.at(*point) for point in path)
    add.draw(Shape("tube", "metal", points=points, radius=0.011, bend=0.07))
    add.solid(Shape("capsule", points=points[:2], radius=0.012))
    add.frame("tap", points[-1], note="mouth of the spout")
    if add.rules.choice("tap") == "knob":
        for name, side in (("tap_cold", -1), ("tap_hot", 1)):
            at = run.at(x, y + 0.085 * side, z + 0.05)
            add.rod(((at[0], at[1], z), (at[0], at[1], z + 0.035)), 0.014, "metal")
            add.moving(name, "revolute", at, (0.0, 0.0, 1.0), 3.0, mass=0.1, damping=0.002)
            low, high = (at[0], at[1], z + 0.036), (at[0], at[1], z + 0.066)
            add.rod((low, high), 0.02, "metal", link=name, solid=True)
            a, b = (
                (at[0] - 0.028, at[1] - 0.006, z + 0.045),
                (at[0] + 0.028, at[1] + 0.006, z + 0.06),
            )
            add.box(a, b, "metal", link=name, solid=False)
            add.frame(f"handle_{name}", (at[0] + 0.028, at[1], z + 0.052), note=f"rim of {name}")
        return
    at = run.at(x, y - 0.03, z + 0.1)
    add.rod(((at[0], y, at[2]), (at[0], y - 0.03, at[2])), 0.014, "metal")
    # Lifted about x, it reaches out along -y: a loop that a hand or an arm can lift.
    add.moving("tap", "revolute", at, (-1.0, 0.0, 0.0), 0.6, mass=0.12, damping=0.004, friction=0.1)
    low, high = (at[0] - 0.010, at[1] - 0.13, at[2] - 0.006), (at[0] + 0.010, at[1], at[2] + 0.006)
    add.box(low, high, "metal", link="tap")
    add.frame("handle_tap", (at[0], at[1] - 0.12, at[2]), note="end of the lever")


def _hob(run: Run, unit: Unit) -> None:
    add, z = run.assembly, run.top
    half = 0.285
    a = run.at(0.06, unit.middle - half, z)
    add.box(a, run.at(0.56, unit.middle + half, z + 0.006), "black")
    for x, y, radius in (
        (0.19, -0.14, 0.08),
        (0.19, 0.14, 0.1),
        (0.42, -0.14, 0.1),
        (0.42, 0.14, 0.08),
    ):
        at = run.at(x, unit.middle + y, z + 0.006)
        add.rod((at, (at[0], at[1], at[2] + 0.001)), radius, "metal_dark")
        add.rod(
            ((at[0], at[1], at[2] + 0.001), (at[0], at[1], at[2] + 0.002)), radius - 0.012, "black"
        )
    for k in range(4):
        at = run.at(0.535, unit.middle - 0.06 + 0.04 * k, z + 0.006)
        add.rod((at, (at[0], at[1], at[2] + 0.002)), 0.010, "plastic")
    add.frame("hob", run.at(0.31, unit.middle, z + 0.008), note="middle of the hob")
    stand = run.at(DEPTH + 0.3, unit.middle, 0.0)
    add.frame("stand_hob", stand, yaw_deg=180.0, note="where one stands or wheels at the hob")
