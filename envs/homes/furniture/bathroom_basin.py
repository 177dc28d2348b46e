"""Washbasins, with what hangs over them."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape, Triple

from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker
from .bathroom_storage import BOARD, LEAF, bottle, carcase
from .joinery import Joinery
from .plumbing import drain, tap, trap
from .stock import box, rod

_TILT = math.radians(8)  # of a mirror that somebody who sits looks into; own choice
_MIRROR_EDGE = 0.98  # [m], lower edge of mirrors: ADA 603.3, 40 in at most
_APPROACH = 0.38  # [m], half the width that a wheelchair needs: ADA 305.3, 30 in


@maker("washbasin")
def washbasin(setting: Setting, *, width: float | None = None) -> Piece:
    """Return a washbasin with its tap and mirror.

    Level 1 is a cupboard with two doors under a basin with knobs, and a cabinet with mirrors over it;
    level 2 hangs on the wall over half a pedestal, level 3 alone, with an insulated trap and a mirror
    that is tilted; both have a lever and room for knees.

    Args:
        setting: What it is made for.
        width: Along the wall [m]; 0.8 at level 1, 0.56 at level 2, 0.65 at level 3 if None.

    Raises:
        ConfigError: If it is less than 0.5 m, or 0.6 m at level 1.
    """
    least = 0.6 if setting.rules.level == 1 else 0.5
    if width is not None and width < least:
        raise ConfigError(f"a washbasin must be at least {least} m wide here, got {width}")
    made = Joinery("washbasin", setting)
    rules = setting.rules
    rim = rules.figure("basin_rim_height")
    made.measures["basin_rim_height"] = rim
    if rules.level == 1:
        return _vanity(made, rim, width or 0.8)
    knee = rules.figure("basin_knee_height")
    made.measures["basin_knee_height"] = knee
    if rules.level == 2:
        return _semi_pedestal(made, rim, knee, width or 0.56)
    return _wall_hung(made, rim, knee, width or 0.65)


def _hollow(made: Joinery, low: Triple, high: Triple, inner: Rectangle, floor: float) -> None:
    """Add a slab of ceramic between two corners [m], with a hollow over `inner` down to `floor`."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    made.box((x0, y0, z0), (inner.x0, y1, z1), "ceramic")
    made.box((inner.x1, y0, z0), (x1, y1, z1), "ceramic")
    made.box((inner.x0, y0, z0), (inner.x1, inner.y0, z1), "ceramic")
    made.box((inner.x0, inner.y1, z0), (inner.x1, y1, z1), "ceramic")
    made.box((inner.x0, inner.y0, z0), (inner.x1, inner.y1, floor), "ceramic")
    for x, y in (
        (inner.x0, inner.y0),
        (inner.x0, inner.y1),
        (inner.x1, inner.y0),
        (inner.x1, inner.y1),
    ):
        made.draw(rod("ceramic", 0.012, (x, y, floor), (x, y, z1 - 0.0125)))
    made.frame("basin", (*inner.centre, floor), "bottom of the basin")
    drain(made, (*inner.centre, floor))


def _vanity(made: Joinery, rim: float, width: float) -> Piece:
    half, deep = 0.5 * width, 0.5
    made.box((0.0, 0.02 - half, 0.0), (deep - 0.1, half - 0.02, 0.09), "wood_dark")
    under = rim - 0.145
    carcase(made, (0.0, -half, 0.09), (deep - 0.02, half, under))
    made.box((deep - 0.02, -half, under), (deep, half, rim - 0.03), "front")
    for y in (-half, half - BOARD):
        made.box((0.0, y, under), (deep - 0.02, y + BOARD, rim - 0.03), "front")
    inner = Rectangle(0.14, -0.24, 0.44, 0.24)
    low: Triple = (0.11, -0.265, under)
    _hollow(made, low, (0.465, 0.265, rim), inner, rim - 0.125)
    x0, y0, z0 = 0.0, -half - 0.01, rim - 0.03
    x1, y1, z1 = deep + 0.01, half + 0.01, rim - 0.005
    made.box((x0, y0, z0), (low[0], y1, z1), "worktop")
    made.box((0.465, y0, z0), (x1, y1, z1), "worktop")
    made.box((low[0], y0, z0), (0.465, -0.265, z1), "worktop")
    made.box((low[0], 0.265, z0), (0.465, y1, z1), "worktop")
    tap(made, (0.065, 0.0, z1), style=made.setting.rules.choice("tap"))
    bottle(made, (0.06, 0.05 - half, z1), "accent")
    for name, side in (("door_left", 1.0), ("door_right", -1.0)):
        y0, y1 = sorted((0.0, side * half))
        a, b = (deep - LEAF, y0, 0.095), (deep, y1, under - 0.002)
        made.door(name, a, b, "front", hinge="left" if side > 0 else "right", handle_z=under - 0.1)
    _mirror_cabinet(made, half)
    front = deep + 0.045
    zones = (
        Zone(Rectangle(front, -half, front + 0.6, half)),
        Zone(Rectangle(front, -half, deep + half, half), "sweep"),
    )
    return made.piece(Rectangle(0.0, -half - 0.01, front, half + 0.01), 1.8, zones=zones)


def _mirror_cabinet(made: Joinery, half: float) -> None:
    """Add a cabinet over the basin, with two mirrors for doors."""
    low, high, deep = 1.2, 1.8, 0.14
    carcase(made, (0.0, -half, low), (deep - 0.02, half, high))
    made.box((0.012, BOARD - half, 1.49), (deep - 0.03, half - BOARD, 1.49 + BOARD), "front")
    for name, side in (("mirror_left", 1.0), ("mirror_right", -1.0)):
        y0, y1 = sorted((0.0, side * half))
        a, b = (deep - LEAF, y0, low), (deep, y1, high)
        made.door(name, a, b, "mirror", hinge="left" if side > 0 else "right", handle_z=low + 0.1)
    made.frame("place_1", (0.07, 0.0, 1.49 + BOARD), "shelf behind the mirrors")
    for y, colour in ((0.2, "accent"), (-0.15, "leaf"), (-0.22, "white")):
        made.draw(rod(colour, 0.022, (0.06, y, low + BOARD), (0.06, y, low + 0.15)))


def _semi_pedestal(made: Joinery, rim: float, knee: float, width: float) -> Piece:
    half, front = 0.5 * width, 0.5
    centre, long = 0.29, 0.21
    made.draw(
        Shape(
            kind="lathe",
            material="ceramic",
            at=(centre, 0.0, 0.0),
            profile=(
                (0.1, knee),
                (0.165, knee + 0.045),
                (long, rim - 0.02),
                (long, rim),
                (long - 0.022, rim),
                (long - 0.035, rim - 0.03),
                (0.13, rim - 0.105),
                (0.05, rim - 0.122),
            ),
            scale=(1.0, half / long, 1.0),
        ),
        box("ceramic", (0.0, -half * 0.93, rim - 0.06), (0.1, half * 0.93, rim)),
    )
    floor, inner = rim - 0.115, Rectangle(0.135, -0.19, 0.44, 0.19)
    made.solid(
        box("", (0.0, -half * 0.93, rim - 0.06), (0.1, half * 0.93, rim)),
        box("", (0.09, -0.19, knee + 0.03), (0.135, 0.19, rim)),
        box("", (0.44, -0.16, knee + 0.04), (front, 0.16, rim)),
        box("", (0.11, 0.19, knee + 0.04), (0.44, half - 0.02, rim)),
        box("", (0.11, 0.02 - half, knee + 0.04), (0.44, -0.19, rim)),
        box("", (0.11, -0.19, knee), (0.44, 0.19, floor)),
    )
    made.frame("basin", (*inner.centre, floor), "bottom of the basin")
    drain(made, (centre, 0.0, rim - 0.122))
    sections = ((0.38, 0.085, 0.0, 0.07, 0.075), (knee + 0.012, 0.11, 0.0, 0.1, 0.12))
    made.draw(Shape(kind="loft", material="ceramic", sections=sections))
    made.solid(box("", (0.0, -0.09, 0.38), (0.18, 0.09, knee)))
    tap(made, (0.07, 0.0, rim), style=made.setting.rules.choice("tap"))
    bottle(made, (0.06, -0.18, rim), "accent")
    _mirror(made, 0.0, 0.53, 0.8)
    return _with_knees(made, half, front, 0.22)


def _wall_hung(made: Joinery, rim: float, knee: float, width: float) -> Piece:
    half, front = 0.5 * width, 0.55
    inner = Rectangle(0.15, 0.1 - half, 0.49, half - 0.1)
    _hollow(made, (0.0, -half, knee), (front, half, rim), inner, rim - 0.095)
    edge = ((0.0, -half), (front, -half), (front, half), (0.0, half))
    path = [(x, y, rim - 0.012) for x, y in edge]
    made.draw(rod("ceramic", 0.0125, *path, bend=0.03))
    trap(made, (0.2, 0.0, knee), sleeve=True)
    made.solid(box("", (0.0, -0.03, knee - 0.14), (0.2, 0.03, knee)))
    tap(made, (0.07, 0.0, rim), style=made.setting.rules.choice("tap"))
    bottle(made, (0.07, -0.2, rim), "accent")
    _mirror(made, _TILT, 0.64, 0.85)
    return _with_knees(made, half + 0.0125, front + 0.0125, 0.24)


def _mirror(made: Joinery, tilt: float, width: float, height: float) -> None:
    """Add a mirror on the wall in a thin frame, its top tilted forward."""
    half, middle = 0.5 * width, _MIRROR_EDGE + 0.5 * height * math.cos(tilt)
    x = 0.015 + 0.5 * height * math.sin(tilt)
    turn: Triple = (0.0, tilt, 0.0)
    size = (0.02, width + 0.03, height + 0.03)
    made.draw(Shape(kind="box", material="wood_light", at=(x, 0.0, middle), size=size, rpy=turn))
    glass = (0.01, width, height)
    made.draw(
        Shape(kind="box", material="mirror", at=(x + 0.006, 0.0, middle), size=glass, rpy=turn)
    )
    made.solid(Shape(kind="box", at=(x, 0.0, middle), size=size, rpy=turn))
    if tilt:
        top = _MIRROR_EDGE + height * math.cos(tilt) - 0.05
        for y in (0.1 - half, half - 0.1):
            made.draw(rod("metal", 0.006, (0.0, y, top), (2 * x - 0.02, y, top)))
    made.frame("mirror", (x + 0.012, 0.0, middle), "middle of the mirror")


def _with_knees(made: Joinery, half: float, front: float, back: float) -> Piece:
    """Return the piece with room for knees from `back` [m] to its front."""
    free = (0.0, 0.8, 0.92)[
        made.setting.rules.level - 1
    ]  # 48 in less what is below: ADA 305.3, 306
    use = Rectangle(front, -_APPROACH, front + free, _APPROACH)
    knee = Rectangle(back, -half, front, half)
    made.frame("knees", (front, 0.0, 0.5), "where knees go under it", yaw_deg=180.0)
    footprint = Rectangle(0.0, -half, front, half)
    made.knee += (knee,)
    return made.piece(footprint, 1.86, zones=(Zone(use),))
