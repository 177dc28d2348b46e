"""Taps, showers, drains, traps and grab bars, as parts of pieces of furniture."""

from __future__ import annotations

import math

from rcare_marl.model.shape import Shape, Triple

from .joinery import Joinery
from .stock import about, solid_rods

_LEVER = 0.12  # [m] of a lever tap; common, from memory
# Dry friction of a cartridge [N·m]: it holds the lever, and 4 N at its end move it; own choice.
_CARTRIDGE = 0.25


def drain(made: Joinery, at: Triple, *, radius: float = 0.025) -> None:
    """Add a drain to see at `at` [m], on the floor of a basin."""
    x, y, z = at
    made.disc((x, y, z + 0.001), radius, 0.004, "metal")
    made.disc((x, y, z + 0.0035), 0.55 * radius, 0.001, "metal_dark")
    made.frame("drain", (x, y, z), "the drain")


def tap(made: Joinery, at: Triple, *, reach: float = 0.13) -> None:
    """Add a tap that stands on `at` [m] and pours along x, worked as the rules want it.

    Two knobs turn, `tap_hot` and `tap_cold`; or one lever lifts, `tap_lift`, and turns, `tap_turn`,
    from cold in the middle to hot at the left. Frame `tap` is where the water leaves.

    Args:
        made: What it is part of.
        at: Middle of its foot.
        reach: From the foot to where the water leaves [m].
    """
    x, y, z = at
    high = z + 0.12
    mouth = (x + reach, y, high - 0.035)
    made.rod((at, (x, y, high), (x + reach, y, high), mouth), 0.011, "metal", bend=0.05)
    made.disc((x, y, z + 0.006), 0.026, 0.012, "metal")
    made.solid(*solid_rods(0.012, at, (x, y, high), (x + reach, y, high)))
    made.frame("tap", mouth, "where the water leaves")
    if made.rules.choice("tap") == "knob":
        _knob(made, (x, y + 0.1, z), "tap_hot", 1.0)
        _knob(made, (x, y - 0.1, z), "tap_cold", -1.0)
    else:
        _lever(made, (x, y, high + 0.012))


def _knob(made: Joinery, at: Triple, name: str, side: float) -> None:
    """Add a knob with four spokes, which three quarters of a turn open."""
    x, y, z = at
    made.post(at, z + 0.035, 0.014, "metal")
    top = (x, y, z + 0.045)
    fills, axis = about(top, 0.026, 0.026, 0.012), (0.0, 0.0, side)
    knob = made.joint(name, top, axis, 1.5 * math.pi, mass=0.12, fills=fills, slowing=0.05)
    knob.disc(top, 0.018, 0.024, "metal")
    knob.rod(about(top, 0.028, 0.0, 0.0), 0.006, "metal")
    knob.rod(about(top, 0.0, 0.028, 0.0), 0.006, "metal")
    knob.disc((x, y, top[2] + 0.0125), 0.008, 0.002, "rug" if side > 0 else "blanket")
    knob.cylinder(top, 0.026, 0.024)
    knob.frame(f"handle_{name}", (x + 0.026, y, top[2]), "rim of the knob")


def _lever(made: Joinery, at: Triple) -> None:
    """Add a lever that turns about z and, on that, lifts."""
    x, y, z = at
    fills = about(at, 0.02, 0.02, 0.012)
    turn = made.joint("tap_turn", at, "z", math.radians(70), mass=0.1, fills=fills, slowing=0.05)
    turn.disc(at, 0.02, 0.026, "metal")
    end = (x + _LEVER, y, z + 0.032)
    pivot, rise = (x, y, z + 0.014), math.radians(25)
    fills = (x - 0.02, y - 0.01, z + 0.008), (x + _LEVER, y + 0.01, z + 0.03)
    lift = turn.joint(
        "tap_lift", pivot, "-y", rise, mass=0.1, fills=fills, slowing=0.02, friction=_CARTRIDGE
    )
    lift.rod(((x - 0.01, y, z + 0.018), end), 0.008, "metal", solid=True)
    for name in ("lift", "turn"):
        lift.frame(f"handle_tap_{name}", end, "end of the lever")


def hand_shower(made: Joinery, wall: Triple, out: Triple, *, low: float, high: float) -> None:
    """Add a hand shower on a bar that it slides along, `shower_slider`, with its hose and mixer.

    Args:
        made: What it is part of.
        wall: Point of the wall at the height of the floor [m].
        out: Direction out of the wall, a unit vector along x or y.
        low: Height of the lower end of the bar [m]; the shower head rests near it.
        high: Height of its upper end [m].
    """
    (x, y, z), (dx, dy, _) = wall, out

    def point(away: float, height: float) -> Triple:
        return (x + away * dx, y + away * dy, z + low + height)

    made.post(point(0.06, 0.0), z + high, 0.011, "metal", solid=True)
    for height in (low + 0.03, high - 0.03):
        ends = ((x, y, z + height), (x + 0.06 * dx, y + 0.06 * dy, z + height))
        made.rod(ends, 0.009, "metal")
    middle = point(0.06, 0.12)
    name, way, fills = "shower_slider", high - low - 0.2, about(middle, 0.04, 0.04, 0.06)
    slider = made.joint(
        name, middle, "z", way, slides=True, mass=0.35, fills=fills, slowing=0.05, friction=7.0
    )
    grip, head = (point(0.1, 0.03), point(0.12, 0.2), point(0.17, 0.25)), point(0.19, 0.235)
    slider.rod((point(0.06, 0.09), point(0.06, 0.15)), 0.02, "metal")
    slider.rod((middle, point(0.11, 0.12)), 0.008, "metal")
    slider.rod(grip, 0.013, "white", bend=0.04)
    slider.rod((point(0.165, 0.255), head), 0.05, "white")
    slider.rod((head, point(0.192, 0.232)), 0.042, "metal_dark")
    slider.solid(*solid_rods(0.016, *grip[:2]), Shape("sphere", at=head, radius=0.04))
    slider.frame("handle_shower_slider", grip[1], "grip of the hand shower")
    _mixer(made, point(0.0, -0.08), out, point(0.1, 0.03))


def _mixer(made: Joinery, at: Triple, out: Triple, hose_end: Triple) -> None:
    """Add a mixer on the wall with a hose, and its lever, `shower_lever`, that turns."""
    (x, y, z), (dx, dy, _) = at, out

    def point(away: float, height: float, aside: float = 0.0) -> Triple:
        return (x + away * dx + aside * dy, y + away * dy - aside * dx, height)

    away, sag = point(0.055, z), z - min(0.45, z - 0.1)
    made.disc(point(0.004, z), 0.06, 0.008, "metal", along="x" if dx else "y")
    made.rod((at, away), 0.025, "metal")
    hose = (away, point(0.06, sag, 0.02), point(0.12, sag, 0.08), hose_end)
    made.rod(hose, 0.007, "metal", bend=0.12)
    made.solid(*solid_rods(0.025, at, away))
    (a, b, _), name, turn = away, "shower_lever", math.radians(90)
    fills = (a - 0.012, b - 0.012, z - 0.1), (a + 0.012, b + 0.012, z)
    lever = made.joint(
        name, away, out, turn, mass=0.12, fills=fills, slowing=0.02, friction=_CARTRIDGE
    )
    start, tip = (a + 0.008 * dx, b + 0.008 * dy, z), (a + 0.02 * dx, b + 0.02 * dy, z - 0.11)
    lever.rod((away, start), 0.028, "metal")
    lever.rod((start, tip), 0.009, "metal", solid=True)
    lever.frame("handle_shower_lever", tip, "end of the lever")


def trap(made: Joinery, at: Triple, *, sleeve: bool) -> None:
    """Add the trap of a basin, for the eye, from its drain at `at` [m] to the wall.

    Args:
        made: What it is part of.
        at: Underside of the basin at its drain.
        sleeve: Whether it is insulated: ADA 606.5 wants no hot pipe where legs are.
    """
    (x, y, z), middle = at, 0.5 * at[0]
    rise = ((middle, y, z - 0.1), (middle, y, z - 0.05), (0.0, y, z - 0.05))
    colour, radius = ("plastic", 0.028) if sleeve else ("metal", 0.018)
    made.rod((at, (x, y, z - 0.1), *rise), radius, colour, bend=0.03)


def grab_bar(
    made: Joinery, start: Triple, end: Triple, out: Triple, *, diameter: float, gap: float
) -> None:
    """Add a grab bar to a wall: bent back to the wall at its ends, with flanges.

    Args:
        made: What it is part of.
        start: One end, on the wall [m].
        end: The other end, on the wall [m].
        out: Direction out of the wall, a unit vector along x or y.
        diameter: Of the bar [m].
        gap: Between the bar and the wall [m].
    """
    radius = 0.5 * diameter
    away, length = gap + radius, math.dist(start, end)

    def off(point: Triple, by: float) -> Triple:
        return (point[0] + by * out[0], point[1] + by * out[1], point[2] + by * out[2])

    dx, dy, dz = (radius * (b - a) / length for a, b in zip(start, end, strict=True))
    a, b = (start[0] + dx, start[1] + dy, start[2] + dz), (end[0] - dx, end[1] - dy, end[2] - dz)
    made.rod((a, off(a, away), off(b, away), b), radius, "metal", bend=0.035)
    # Capsules bulge by their radius: those along the wall end where the bar does.
    made.solid(*solid_rods(radius, off(start, away), off(end, away)))
    for foot in (a, b):
        made.rod((foot, off(foot, 0.006)), 2.2 * radius, "metal")
        made.solid(Shape("cylinder", points=(foot, off(foot, away)), radius=radius))


def tiled_panel(made: Joinery, low: Triple, high: Triple) -> None:
    """Add a thin tiled wall between two corners [m], with a rail of metal on top."""
    made.box(low, high, "wall_tile")
    (x0, y0, _), (x1, y1, z) = low, high
    made.show((x0 - 0.004, y0 - 0.004, z), (x1 + 0.004, y1 + 0.004, z + 0.012), "metal")
