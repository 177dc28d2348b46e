"""Washbasins, with what hangs over them."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape, Triple

from ...rectangle import Rectangle
from ..piece import Zone
from .bathroom_storage import BOARD, LEAF, bottle, carcase
from .joinery import Joinery, front_zone, furniture
from .plumbing import drain, tap, trap

_TILT = math.radians(8)  # of a mirror that somebody who sits looks into; own choice
_MIRROR_EDGE = 0.98  # [m], lower edge of mirrors: ADA 603.3, 40 in at most
_APPROACH = 0.38  # [m], half the width that a wheelchair needs: ADA 305.3, 30 in


@furniture("washbasin")
def washbasin(made: Joinery, *, width: float | None = None) -> None:
    """Make a washbasin with its tap and mirror.

    Level 1 is a cupboard with two doors under a basin with knobs, and a cabinet with mirrors over it;
    level 2 hangs on the wall over half a pedestal, level 3 alone, with an insulated trap and a mirror
    that is tilted; both have a lever and room for knees. It is `width` [m] wide; 0.8 at level 1, 0.56 at
    level 2, 0.65 at level 3 if None. ConfigError if that is less than 0.5, or 0.6 at level 1.
    """
    level = made.rules.level
    least = 0.6 if level == 1 else 0.5
    if width is not None and width < least:
        raise ConfigError(f"a washbasin must be at least {least} m wide here, got {width}")
    rim, half = made.ruled("basin_rim_height"), 0.5 * (width or (0.8, 0.56, 0.65)[level - 1])
    if level == 1:
        _vanity(made, rim, half)
    elif level == 2:
        _semi_pedestal(made, rim, made.ruled("basin_knee_height"), half)
    else:
        _wall_hung(made, rim, made.ruled("basin_knee_height"), half)


def _hollow(
    made: Joinery, outer: Rectangle, inner: Rectangle, low: float, high: float, floor: float
) -> None:
    """Add a slab of ceramic between two heights [m], with a hollow over `inner` down to `floor`."""
    made.ring(outer, inner, (low, high), "ceramic")
    made.box((inner.x0, inner.y0, low), (inner.x1, inner.y1, floor), "ceramic")
    for x in (inner.x0, inner.x1):
        for y in (inner.y0, inner.y1):
            made.post((x, y, floor), high - 0.0125, 0.012, "ceramic")
    made.frame("basin", (*inner.centre, floor), "bottom of the basin")
    drain(made, (*inner.centre, floor))


def _vanity(made: Joinery, rim: float, half: float) -> None:
    deep, under = 0.5, rim - 0.145
    made.box((0.0, 0.02 - half, 0.0), (deep - 0.1, half - 0.02, 0.09), "wood_dark")
    carcase(made, (0.0, -half, 0.09), (deep - 0.02, half, under))
    made.box((deep - 0.02, -half, under), (deep, half, rim - 0.03), "front")
    made.sides((0.0, -half, under), (deep - 0.02, half, rim - 0.03), BOARD, "front")
    outer, inner = Rectangle(0.11, -0.265, 0.465, 0.265), Rectangle(0.14, -0.24, 0.44, 0.24)
    _hollow(made, outer, inner, under, rim, rim - 0.125)
    top = rim - 0.005
    whole = Rectangle(0.0, -half - 0.01, deep + 0.01, half + 0.01)
    made.ring(whole, outer, (rim - 0.03, top), "worktop")
    tap(made, (0.065, 0.0, top))
    bottle(made, (0.06, 0.05 - half, top), "accent")
    _doors(made, "door", (deep, half), (0.095, under - 0.002), "front", under - 0.1)
    _mirror_cabinet(made, half)
    front = deep + 0.045
    sweep = Rectangle(front, -half, deep + half, half)
    made.outline(front, half + 0.01, 1.8, front_zone(front, half, 0.6), Zone(sweep, "sweep"))


def _doors(
    made: Joinery,
    name: str,
    front: tuple[float, float],
    span: tuple[float, float],
    material: str,
    grip: float,
) -> None:
    """Hang two doors of a cupboard, given its depth, half its width, and their heights [m]."""
    (deep, half), (low, high) = front, span
    a, b = (deep - LEAF, 0.0, low), (deep, half, high)
    made.door(f"{name}_left", a, b, material, left=True, handle_z=grip)
    a, b = (deep - LEAF, -half, low), (deep, 0.0, high)
    made.door(f"{name}_right", a, b, material, left=False, handle_z=grip)


def _mirror_cabinet(made: Joinery, half: float) -> None:
    """Add a cabinet over the basin, with two mirrors for doors."""
    low, high, deep = 1.2, 1.8, 0.14
    carcase(made, (0.0, -half, low), (deep - 0.02, half, high))
    made.box((0.012, BOARD - half, 1.49), (deep - 0.03, half - BOARD, 1.49 + BOARD), "front")
    _doors(made, "mirror", (deep, half), (low, high), "mirror", low + 0.1)
    made.frame("place_1", (0.07, 0.0, 1.49 + BOARD), "shelf behind the mirrors")
    for y, colour in ((0.2, "accent"), (-0.15, "leaf"), (-0.22, "white")):
        made.post((0.06, y, low + BOARD), low + 0.15, 0.022, colour)


def _semi_pedestal(made: Joinery, rim: float, knee: float, half: float) -> None:
    front, centre, long, back = 0.5, 0.29, 0.21, half * 0.93
    outside = ((0.1, knee), (0.165, knee + 0.045), (long, rim - 0.02), (long, rim))
    inside = ((long - 0.022, rim), (long - 0.035, rim - 0.03), (0.13, rim - 0.105))
    profile, oval = (*outside, *inside, (0.05, rim - 0.122)), (1.0, half / long, 1.0)
    made.lathe((centre, 0.0, 0.0), profile, "ceramic", scale=oval)
    made.box((0.0, -back, rim - 0.06), (0.1, back, rim), "ceramic")
    floor, inner = rim - 0.115, Rectangle(0.135, -0.19, 0.44, 0.19)
    made.block((0.09, -0.19, knee + 0.03), (0.135, 0.19, rim))
    made.block((0.44, -0.16, knee + 0.04), (front, 0.16, rim))
    made.block((0.11, 0.19, knee + 0.04), (0.44, half - 0.02, rim))
    made.block((0.11, 0.02 - half, knee + 0.04), (0.44, -0.19, rim))
    made.block((0.11, -0.19, knee), (0.44, 0.19, floor))
    made.frame("basin", (*inner.centre, floor), "bottom of the basin")
    drain(made, (centre, 0.0, rim - 0.122))
    sections = ((0.38, 0.085, 0.0, 0.07, 0.075), (knee + 0.012, 0.11, 0.0, 0.1, 0.12))
    made.draw(Shape("loft", "ceramic", sections=sections))
    made.block((0.0, -0.09, 0.38), (0.18, 0.09, knee))
    tap(made, (0.07, 0.0, rim))
    bottle(made, (0.06, -0.18, rim), "accent")
    _mirror(made, 0.0, 0.53, 0.8)
    _with_knees(made, half, front, 0.22)


def _wall_hung(made: Joinery, rim: float, knee: float, half: float) -> None:
    front, inner = 0.55, Rectangle(0.15, 0.1 - half, 0.49, half - 0.1)
    _hollow(made, Rectangle(0.0, -half, front, half), inner, knee, rim, rim - 0.095)
    edge = ((0.0, -half), (front, -half), (front, half), (0.0, half))
    made.rod([(x, y, rim - 0.012) for x, y in edge], 0.0125, "ceramic", bend=0.03)
    trap(made, (0.2, 0.0, knee), sleeve=True)
    made.block((0.0, -0.03, knee - 0.14), (0.2, 0.03, knee))
    tap(made, (0.07, 0.0, rim))
    bottle(made, (0.07, -0.2, rim), "accent")
    _mirror(made, _TILT, 0.64, 0.85)
    _with_knees(made, half + 0.0125, front + 0.0125, 0.24)


def _mirror(made: Joinery, tilt: float, width: float, height: float) -> None:
    """Add a mirror on the wall in a thin frame, its top tilted forward."""
    half, middle = 0.5 * width, _MIRROR_EDGE + 0.5 * height * math.cos(tilt)
    x = 0.015 + 0.5 * height * math.sin(tilt)
    turn: Triple = (0.0, tilt, 0.0)
    made.slab((x, 0.0, middle), (0.02, width + 0.03, height + 0.03), "wood_light", rpy=turn)
    glass = (x + 0.006, 0.0, middle)
    made.slab(glass, (0.01, width, height), "mirror", rpy=turn, solid=False)
    if tilt:
        top = _MIRROR_EDGE + height * math.cos(tilt) - 0.05
        for y in (0.1 - half, half - 0.1):
            made.rod(((0.0, y, top), (2 * x - 0.02, y, top)), 0.006, "metal")
    made.frame("mirror", (x + 0.012, 0.0, middle), "middle of the mirror")


def _with_knees(made: Joinery, half: float, front: float, back: float) -> None:
    """Leave room for knees from `back` [m] to its front."""
    # 48 in less what is below: ADA 305.3, 306
    use = front_zone(front, _APPROACH, (0.0, 0.8, 0.92)[made.rules.level - 1])
    made.frame("knees", (front, 0.0, 0.5), "where knees go under it", yaw_deg=180.0)
    made.knee.append(Rectangle(back, -half, front, half))
    made.outline(front, half, 1.86, use)
