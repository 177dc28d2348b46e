"""Floor plans as drawings: walls, doors and windows, furniture, ways."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyBboxPatch
from matplotlib.patches import Rectangle as Patch

from rcare_marl.envs.homes.care_home import CareHome
from rcare_marl.envs.homes.furnishing import Placed
from rcare_marl.envs.homes.plan import JAMB, Opening
from rcare_marl.envs.homes.rectangle import Rectangle
from rcare_marl.envs.homes.route import Route

INK, WALL, PALE = "#2b2f36", "#3d434c", "#8b929c"
FLOORS = {
    "kitchen": "#f6ead2",
    "dining": "#f8f0dd",
    "living": "#eef1e2",
    "lounge": "#e6eee6",
    "bedroom": "#e9ebf4",
    "bathroom": "#ddeef2",
    "other": "#f3f2ef",
}
LEVELS = {1: "usual", 2: "partially barrier-free", 3: "barrier-free"}
_SOFT = ("rug", "bath_mat", "exercise_mat", "picture", "wall_clock", "towel_rail", "pendant_lamp")


def draw(axes: Axes, home: CareHome, *, labels: bool = True, route: Route | None = None) -> None:
    """Draw the plan of a home, and a way through it, into axes in metres."""
    for room in home.rooms():
        _box(axes, room.inside.grown(0.06), facecolor=FLOORS[room.kind], zorder=0)
    for placed in home.placed:
        _piece(axes, placed)
    for wall in home.plan.walls:
        _box(axes, wall.area, facecolor=WALL, zorder=3)
    for opening in home.plan.openings.values():
        _opening(axes, opening)
    if labels:
        for room in home.rooms():
            _label(axes, room.name, room.inside)
    if route is not None:
        axes.plot(*route.points.T, color="#c2491d", lw=1.6, zorder=7)
        x, y = route.narrowest_at
        axes.add_patch(
            Circle((x, y), 0.5 * route.narrowest, fill=False, ec="#c2491d", lw=1.2, zorder=7)
        )
        axes.annotate(
            f"{route.narrowest:.2f} m", (x, y), (8, 8), textcoords="offset points",
            color="#c2491d", fontsize=7, zorder=8,
        )  # fmt: skip
    areas = home.plan.outline
    axes.set_xlim(min(a.x0 for a in areas) - 0.4, max(a.x1 for a in areas) + 0.4)
    axes.set_ylim(min(a.y0 for a in areas) - 0.4, max(a.y1 for a in areas) + 0.4)
    axes.set_aspect("equal")
    axes.axis("off")


def figure(home: CareHome, *, width: float = 11.0, route: Route | None = None) -> Figure:
    """Return a figure of one home with a title and a scale bar; `width` in inches."""
    areas = home.plan.outline
    across = max(a.x1 for a in areas) - min(a.x0 for a in areas) + 0.8
    along = max(a.y1 for a in areas) - min(a.y0 for a in areas) + 0.8
    made = Figure(figsize=(width, width * along / across + 0.9), layout="constrained")
    FigureCanvasAgg(made)
    axes = made.add_subplot()
    draw(axes, home, route=route)
    axes.set_title(
        f"{home.name} · {home.plan.title} · level {home.level}, {LEVELS[home.level]}",
        fontsize=11, color=INK,
    )  # fmt: skip
    x, y = axes.get_xlim()[0] + 0.5, axes.get_ylim()[0] + 0.1
    axes.plot((x, x + 2), (y, y), color=INK, lw=2, zorder=6)
    axes.text(x + 2.1, y, "2 m", va="center", fontsize=8, color=INK)
    return made


def png(made: Figure, *, dpi: int = 110) -> bytes:
    """Return a figure as the bytes of a PNG."""
    out = io.BytesIO()
    made.savefig(out, dpi=dpi, facecolor="white")
    return out.getvalue()


def _box(axes: Axes, area: Rectangle, **style: Any) -> None:
    axes.add_patch(Patch((area.x0, area.y0), area.width, area.depth, lw=0, **style))


def _piece(axes: Axes, placed: Placed) -> None:
    area, kind = placed.footprint, placed.piece.kind
    is_soft = kind in _SOFT or not placed.piece.blocks
    axes.add_patch(
        FancyBboxPatch(
            (area.x0, area.y0), max(area.width, 0.02), max(area.depth, 0.02),
            boxstyle="round,pad=0,rounding_size=0.04",
            fc="#ffffff00" if is_soft else "#ffffff", ec="#b9bec6" if is_soft else PALE,
            lw=0.6, ls=":" if is_soft else "-", zorder=1 if is_soft else 2,
        )
    )  # fmt: skip
    turn = placed.pose.matrix()[:2, :2]
    own = placed.piece.footprint
    if kind in ("bed", "hospital_bed"):  # pillows
        for side in (-1, 1) if own.depth > 1.2 else (0,):
            middle = np.array((own.x0 + 0.28, side * 0.25 * own.depth))
            x, y = turn @ middle + placed.pose.position[:2]
            wide, deep = np.abs(turn @ (0.34, min(0.42 * own.depth, 0.6)))
            pillow = Patch((x - wide / 2, y - deep / 2), wide, deep, fc="#f2f2f2", ec=PALE, lw=0.5)
            pillow.set_zorder(2)
            axes.add_patch(pillow)
    elif kind == "toilet":
        x, y = turn @ (own.x1 - 0.24, 0.0) + placed.pose.position[:2]
        axes.add_patch(Circle((x, y), 0.17, fc="white", ec=PALE, lw=0.6, zorder=2))
    elif kind == "washbasin":
        axes.add_patch(Circle(area.centre, 0.16, fc="#dff1f6", ec=PALE, lw=0.6, zorder=2))
    elif kind in ("bathtub", "bathtub_with_seat"):
        _box(axes, area.grown(-0.07), facecolor="#e3f3f7", edgecolor=PALE, zorder=2)
    elif "shower" in kind:
        axes.plot((area.x0, area.x1), (area.y0, area.y1), color="#bcd3da", lw=0.5, zorder=2)
        axes.plot((area.x0, area.x1), (area.y1, area.y0), color="#bcd3da", lw=0.5, zorder=2)


def _opening(axes: Axes, opening: Opening) -> None:
    gap = opening.gap
    if opening.kind == "window":
        _box(axes, gap, facecolor="white", zorder=4)
        (x0, x1), (y0, y1) = (gap.x0, gap.x1), (gap.y0, gap.y1)
        x, y = gap.centre
        line = ((x0, x1), (y, y)) if opening.axis == "x" else ((x, x), (y0, y1))
        axes.plot(*line, color="#5b87a6", lw=1.4, zorder=5)
        return
    _box(axes, gap, facecolor="#f3f2ef", zorder=4)
    if opening.kind == "passage":
        return
    frame = opening.pose
    turn, at = frame.matrix()[:2, :2], np.array(frame.position[:2])
    is_along = float(turn[:, 0] @ ((1, 0) if opening.axis == "x" else (0, 1))) > 0
    hinge = -1.0 if (opening.hinge == "low") == is_along else 1.0
    half = 0.5 * opening.width - JAMB
    if opening.hardware == "slider":
        ends = np.array(((hinge * half, 0.0), (hinge * (half + opening.width), 0.0)))
        axes.plot(*(ends @ turn.T + at).T, color="#d9a35b", lw=1.6, zorder=5)
        return
    face = 0.5 * opening.thickness
    pivot = turn @ (hinge * half, face) + at
    tip = turn @ (hinge * half, face + 2 * half) + at
    axes.plot((pivot[0], tip[0]), (pivot[1], tip[1]), color="#a9742f", lw=1.3, zorder=5)
    closed = turn @ (-hinge * half, face) + at
    angles = [math.degrees(math.atan2(*(end - pivot)[::-1])) for end in (closed, tip)]
    low, high = min(angles), max(angles)
    if high - low > 180:
        low, high = high, low + 360
    axes.add_patch(
        Arc(tuple(pivot), 4 * half, 4 * half, theta1=low, theta2=high, color="#c9b392", lw=0.7, zorder=5)
    )  # fmt: skip


def _label(axes: Axes, name: str, inside: Rectangle) -> None:
    upright = inside.width < 0.8 and inside.depth > inside.width
    small = inside.area < 6
    axes.text(
        *inside.centre, f"{name}\n{inside.area:.0f} m²" if not small else name,
        ha="center", va="center", fontsize=6 if small else 7, color=INK, zorder=6,
        rotation=90 if upright else 0,
        bbox={"boxstyle": "round,pad=0.15", "fc": "#ffffffb0", "ec": "none"},
    )  # fmt: skip


__all__ = ["LEVELS", "draw", "figure", "png"]
