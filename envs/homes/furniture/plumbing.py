"""Taps, showers, drains, traps and grab bars, as parts of pieces of furniture."""

from __future__ import annotations

import math

from rcare_marl.model.shape import Shape, Triple

from .joinery import Joinery
from .stock import box, rod, solid_rods

_LEVER = 0.12  # [m] of a lever tap; common, from memory
# Dry friction of a cartridge [N·m]: it holds the lever, and 4 N at its end move it; own choice.
_CARTRIDGE = 0.25


def disc(material: str, at: Triple, radius: float, thick: float, *, along: str = "z") -> Shape:
    """Return a flat disc about `at` [m], its axis along x, y or z."""
    x, y, z = at
    dx, dy, dz = ((0.5 * thick if along == axis else 0.0) for axis in "xyz")
    return rod(material, radius, (x - dx, y - dy, z - dz), (x + dx, y + dy, z + dz))


def drain(assembly: Joinery, at: Triple, *, radius: float = 0.025) -> None:
    """Add a drain to see at `at` [m], on the floor of a basin."""
    x, y, z = at
    assembly.draw(disc("metal", (x, y, z + 0.001), radius, 0.004))
    assembly.draw(disc("metal_dark", (x, y, z + 0.0035), 0.55 * radius, 0.001))
    assembly.frame("drain", (x, y, z), "the drain")


def tap(assembly: Joinery, at: Triple, *, style: str, reach: float = 0.13) -> None:
    """Add a tap that stands on `at` [m] and pours along x.

    Two knobs turn, `tap_hot` and `tap_cold`; or one lever lifts, `tap_lift`, and turns, `tap_turn`,
    from cold in the middle to hot at the left. Frame `tap` is where the water leaves.

    Args:
        assembly: What it is part of.
        at: Middle of its foot.
        style: `knob` or `lever`.
        reach: From the foot to where the water leaves [m].
    """
    x, y, z = at
    high = z + 0.12
    spout = ((x, y, z), (x, y, high), (x + reach, y, high), (x + reach, y, high - 0.035))
    assembly.draw(
        rod("metal", 0.011, *spout, bend=0.05), disc("metal", (x, y, z + 0.006), 0.026, 0.012)
    )
    assembly.solid(*solid_rods(0.012, (x, y, z), (x, y, high), (x + reach, y, high)))
    assembly.frame("tap", (x + reach, y, high - 0.035), "where the water leaves")
    if style == "knob":
        _knob(assembly, (x, y + 0.1, z), "tap_hot", 1.0)
        _knob(assembly, (x, y - 0.1, z), "tap_cold", -1.0)
    else:
        _lever(assembly, (x, y, high + 0.012))


def _knob(assembly: Joinery, at: Triple, name: str, side: float) -> None:
    """Add a knob with four spokes, which three quarters of a turn open."""
    x, y, z = at
    assembly.draw(rod("metal", 0.014, at, (x, y, z + 0.035)))
    top = z + 0.045
    assembly.moving(
        name,
        "revolute",
        (x, y, top),
        (0.0, 0.0, side),
        1.5 * math.pi,
        mass=0.12,
        fills=((x - 0.026, y - 0.026, top - 0.012), (x + 0.026, y + 0.026, top + 0.012)),
        slowing=0.05,
    )
    assembly.draw(
        disc("metal", (x, y, top), 0.018, 0.024),
        rod("metal", 0.006, (x - 0.028, y, top), (x + 0.028, y, top)),
        rod("metal", 0.006, (x, y - 0.028, top), (x, y + 0.028, top)),
        disc("rug" if side > 0 else "blanket", (x, y, top + 0.0125), 0.008, 0.002),
        link=name,
    )
    assembly.solid(Shape(kind="cylinder", at=(x, y, top), radius=0.026, length=0.024), link=name)
    assembly.frame(f"handle_{name}", (x + 0.026, y, top), "rim of the knob", link=name)


def _lever(assembly: Joinery, at: Triple) -> None:
    """Add a lever that turns about z and, on that, lifts."""
    x, y, z = at
    assembly.moving(
        "tap_turn",
        "revolute",
        at,
        (0.0, 0.0, 1.0),
        math.radians(70),
        mass=0.1,
        fills=((x - 0.02, y - 0.02, z - 0.012), (x + 0.02, y + 0.02, z + 0.012)),
        slowing=0.05,
    )
    assembly.draw(disc("metal", at, 0.02, 0.026), link="tap_turn")
    end: Triple = (x + _LEVER, y, z + 0.032)
    assembly.moving(
        "tap_lift",
        "revolute",
        (x, y, z + 0.014),
        (0.0, -1.0, 0.0),
        math.radians(25),
        mass=0.1,
        fills=((x - 0.02, y - 0.01, z + 0.008), (x + _LEVER, y + 0.01, z + 0.03)),
        slowing=0.02,
        friction=_CARTRIDGE,
        parent="tap_turn",
    )
    assembly.rod(((x - 0.01, y, z + 0.018), end), 0.008, "metal", link="tap_lift", solid=True)
    assembly.frame("handle_tap_lift", end, "end of the lever", link="tap_lift")
    assembly.frame("handle_tap_turn", end, "end of the lever", link="tap_lift")


def hand_shower(assembly: Joinery, wall: Triple, out: Triple, *, low: float, high: float) -> None:
    """Add a hand shower on a bar that it slides along, `shower_slider`, with its hose and mixer.

    Args:
        assembly: What it is part of.
        wall: Point of the wall at the height of the floor [m].
        out: Direction out of the wall, a unit vector along x or y.
        low: Height of the lower end of the bar [m]; the shower head rests near it.
        high: Height of its upper end [m].
    """
    (x, y, z), (dx, dy, _) = wall, out

    def point(away: float, height: float, aside: float = 0.0) -> Triple:
        return (x + away * dx - aside * dy, y + away * dy + aside * dx, z + height)

    assembly.rod((point(0.06, low), point(0.06, high)), 0.011, "metal", solid=True)
    for height in (low + 0.03, high - 0.03):
        assembly.draw(rod("metal", 0.009, point(0.0, height), point(0.06, height)))
    middle = point(0.06, low + 0.12)
    a, b, c = middle
    assembly.moving(
        "shower_slider",
        "prismatic",
        middle,
        (0.0, 0.0, 1.0),
        high - low - 0.2,
        mass=0.35,
        fills=((a - 0.04, b - 0.04, c - 0.06), (a + 0.04, b + 0.04, c + 0.06)),
        slowing=0.05,
        friction=7.0,
    )
    grip = (point(0.1, low + 0.03), point(0.12, low + 0.2), point(0.17, low + 0.25))
    head = point(0.19, low + 0.235)
    assembly.draw(
        rod("metal", 0.02, point(0.06, low + 0.09), point(0.06, low + 0.15)),
        rod("metal", 0.008, point(0.06, low + 0.12), point(0.11, low + 0.12)),
        rod("white", 0.013, *grip, bend=0.04),
        rod("white", 0.05, point(0.165, low + 0.255), head),
        rod("metal_dark", 0.042, head, point(0.192, low + 0.232)),
        link="shower_slider",
    )
    assembly.solid(*solid_rods(0.016, grip[0], grip[1]), link="shower_slider")
    assembly.solid(Shape(kind="sphere", at=head, radius=0.04), link="shower_slider")
    assembly.frame("handle_shower_slider", grip[1], "grip of the hand shower", link="shower_slider")
    _mixer(assembly, point(0.0, low - 0.08), out, point(0.1, low + 0.03))


def _mixer(assembly: Joinery, at: Triple, out: Triple, hose_end: Triple) -> None:
    """Add a mixer on the wall with a hose, and its lever, `shower_lever`, that turns."""
    (x, y, z), (dx, dy, _) = at, out
    away: Triple = (x + 0.055 * dx, y + 0.055 * dy, z)
    along = "x" if dx else "y"
    flange = (x + 0.004 * dx, y + 0.004 * dy, z)
    sag = min(0.45, z - 0.1)
    low = (x + 0.06 * dx + 0.02 * dy, y + 0.06 * dy - 0.02 * dx, z - sag)
    back = (x + 0.12 * dx + 0.08 * dy, y + 0.12 * dy - 0.08 * dx, z - sag)
    assembly.draw(
        disc("metal", flange, 0.06, 0.008, along=along),
        rod("metal", 0.025, at, away),
        rod("metal", 0.007, away, low, back, hose_end, bend=0.12),
    )
    assembly.solid(*solid_rods(0.025, at, away))
    assembly.moving(
        "shower_lever",
        "revolute",
        away,
        out,
        math.radians(90),
        mass=0.12,
        fills=((away[0] - 0.012, away[1] - 0.012, z - 0.1), (away[0] + 0.012, away[1] + 0.012, z)),
        slowing=0.02,
        friction=_CARTRIDGE,
    )
    tip = (away[0] + 0.02 * dx, away[1] + 0.02 * dy, z - 0.11)
    start = (away[0] + 0.008 * dx, away[1] + 0.008 * dy, z)
    assembly.draw(rod("metal", 0.028, away, start), link="shower_lever")
    assembly.rod((start, tip), 0.009, "metal", link="shower_lever", solid=True)
    assembly.frame("handle_shower_lever", tip, "end of the lever", link="shower_lever")


def trap(assembly: Joinery, at: Triple, *, sleeve: bool) -> None:
    """Add the trap of a basin, for the eye, from its drain at `at` [m] to the wall.

    Args:
        assembly: What it is part of.
        at: Underside of the basin at its drain.
        sleeve: Whether it is insulated: ADA 606.5 wants no hot pipe where legs are.
    """
    x, y, z = at
    path = (
        (x, y, z),
        (x, y, z - 0.1),
        (0.5 * x, y, z - 0.1),
        (0.5 * x, y, z - 0.05),
        (0.0, y, z - 0.05),
    )
    colour, radius = ("plastic", 0.028) if sleeve else ("metal", 0.018)
    assembly.draw(rod(colour, radius, *path, bend=0.03))


def grab_bar(
    assembly: Joinery, start: Triple, end: Triple, out: Triple, *, diameter: float, gap: float
) -> None:
    """Add a grab bar to a wall: bent back to the wall at its ends, with flanges.

    Args:
        assembly: What it is part of.
        start: One end, on the wall [m].
        end: The other end, on the wall [m].
        out: Direction out of the wall, a unit vector along x or y.
        diameter: Of the bar [m].
        gap: Between the bar and the wall [m].
    """
    radius = 0.5 * diameter
    away = gap + radius
    length = math.dist(start, end)
    inset = tuple(radius * (b - a) / length for a, b in zip(start, end, strict=True))
    a = (start[0] + inset[0], start[1] + inset[1], start[2] + inset[2])
    b = (end[0] - inset[0], end[1] - inset[1], end[2] - inset[2])

    def off(point: Triple, by: float) -> Triple:
        return (point[0] + by * out[0], point[1] + by * out[1], point[2] + by * out[2])

    path = (a, off(a, away), off(b, away), b)
    assembly.draw(rod("metal", radius, *path, bend=0.035))
    for foot in (a, b):
        assembly.draw(rod("metal", 2.2 * radius, foot, off(foot, 0.006)))
    # Capsules bulge by their radius: those along the wall end where the bar does.
    assembly.solid(*solid_rods(radius, off(start, away), off(end, away)))
    for foot in (a, b):
        assembly.solid(Shape(kind="cylinder", radius=radius, points=(foot, off(foot, away))))


def tiled_panel(assembly: Joinery, low: Triple, high: Triple) -> None:
    """Add a thin tiled wall between two corners [m], with a rail of metal on top."""
    assembly.box(low, high, "wall_tile")
    rim = 0.004
    cap = box(
        "metal",
        (low[0] - rim, low[1] - rim, high[2]),
        (high[0] + rim, high[1] + rim, high[2] + 0.012),
    )
    assembly.draw(cap)
