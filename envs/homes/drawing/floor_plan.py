"""Floor plans as drawings: walls, doors and windows, furniture as seen from above, ways."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle
from matplotlib.patches import Rectangle as Patch
from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from rcare_marl.envs.homes.care_home import CareHome
from rcare_marl.envs.homes.door import hinge_side
from rcare_marl.envs.homes.furnishing import Placed
from rcare_marl.envs.homes.merging import link_poses
from rcare_marl.envs.homes.plan import JAMB, Opening, Room
from rcare_marl.envs.homes.route import Route
from rcare_marl.envs.rectangle import Rectangle

INK, WALL, ROUTE = "#2b2f36", "#3d434c", "#c2491d"
MARGIN = 0.4  # [m] around a house; own choice
FLOORS = {
    "kitchen": "#f6ead2",
    "dining": "#f8f0dd",
    "living": "#eef1e2",
    "lounge": "#e6eee6",
    "bedroom": "#e9ebf4",
    "bathroom": "#ddeef2",
    "other": "#f3f2ef",
}
_SHORT = {"bathroom": "bath", "bedroom": "bed", "hall": "hall"}
LEVELS = {1: "usual", 2: "partially barrier-free", 3: "barrier-free"}
LINE = "#7d848e"
FADED = 0.55  # of the colours of furniture, so that letters and ways stand out; own choice
HANGING = 1.15  # [m] up, from where on what hangs is left out; own choice
# What hangs on walls and stands on furniture says nothing in a plan.
_LEFT_OUT = ("light_switch", "picture", "towel_rail", "wall_clock")


def draw(
    axes: Axes,
    home: CareHome,
    *,
    labels: str = "names",
    routes: Sequence[Route] = (),
    weight: float = 1.0,
) -> None:
    """Draw the plan of a home, and ways through it, into axes in metres.

    Args:
        axes: Where to.
        home: The home.
        labels: What is written into rooms: their `names` with areas, or their `kinds`.
        routes: Ways to draw.
        weight: Scale of lines and letters.
    """
    for room in home.rooms():
        _box(axes, room.inside.grown(0.06), facecolor=FLOORS[room.kind], zorder=0)
    _furniture(axes, home.placed, weight)
    for wall in home.plan.walls:
        _box(axes, wall.area, facecolor=WALL, zorder=3)
    for opening in home.plan.openings.values():
        _opening(axes, opening, weight)
    for room in home.rooms():
        _label(axes, room, labels, weight)
    for route in routes:
        axes.plot(*route.points.T, color=ROUTE, lw=0.9 * weight, alpha=0.7, zorder=2.5)
    bounds = extent(home)
    axes.set_xlim(bounds.x0, bounds.x1)
    axes.set_ylim(bounds.y0, bounds.y1)
    axes.set_aspect("equal")
    axes.axis("off")


def extent(home: CareHome) -> Rectangle:
    """Return the floor that a plan shows [m]."""
    return Rectangle.around(home.plan.outline).grown(MARGIN)


def figure(home: CareHome, *, width: float = 11.0, route: Route | None = None) -> Figure:
    """Return a figure of one home with a title and a scale bar; `width` in inches."""
    bounds = extent(home)
    made = Figure(figsize=(width, width * bounds.depth / bounds.width + 0.9), layout="constrained")
    FigureCanvasAgg(made)
    axes = made.add_subplot()
    draw(axes, home, routes=() if route is None else (route,))
    if route is not None:
        x, y = route.narrowest_at
        axes.add_patch(
            Circle((x, y), 0.5 * route.narrowest, fill=False, ec=ROUTE, lw=1.2, zorder=7)
        )
        axes.annotate(
            f"{route.narrowest:.2f} m",
            (x, y),
            (22, 14),
            textcoords="offset points",
            color=ROUTE,
            fontsize=7,
            zorder=8,
        )
    axes.set_title(
        f"{home.name} · {home.plan.title} · level {home.level}, {LEVELS[home.level]}",
        fontsize=11,
        color=INK,
    )
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


def _opening(axes: Axes, opening: Opening, weight: float) -> None:
    gap = opening.gap
    if opening.kind == "window":
        _box(axes, gap, facecolor="white", zorder=4)
        (x0, x1), (y0, y1) = (gap.x0, gap.x1), (gap.y0, gap.y1)
        x, y = gap.centre
        line = ((x0, x1), (y, y)) if opening.axis == "x" else ((x, x), (y0, y1))
        axes.plot(*line, color="#5b87a6", lw=1.4 * weight, zorder=5)
        return
    _box(axes, gap, facecolor="#f3f2ef", zorder=4)
    if opening.kind == "passage":
        return
    frame = opening.pose
    turn, at = frame.matrix()[:2, :2], np.array(frame.position[:2])
    hinge = hinge_side(opening)
    half = 0.5 * opening.width - JAMB
    if opening.hardware == "slider":
        ends = np.array(((hinge * half, 0.0), (hinge * (half + opening.width), 0.0)))
        axes.plot(*(ends @ turn.T + at).T, color="#d9a35b", lw=1.6 * weight, zorder=5)
        return
    face = 0.5 * opening.thickness
    pivot = turn @ (hinge * half, face) + at
    tip = turn @ (hinge * half, face + 2 * half) + at
    axes.plot((pivot[0], tip[0]), (pivot[1], tip[1]), color="#a9742f", lw=1.3 * weight, zorder=5)
    closed = turn @ (-hinge * half, face) + at
    angles = [math.degrees(math.atan2(*(end - pivot)[::-1])) for end in (closed, tip)]
    low, high = min(angles), max(angles)
    if high - low > 180:
        low, high = high, low + 360
    size = 4 * half
    style: dict[str, Any] = {"color": "#c9b392", "lw": 0.7 * weight, "zorder": 5}
    axes.add_patch(Arc(tuple(pivot), size, size, theta1=low, theta2=high, **style))


def _label(axes: Axes, room: Room, labels: str, weight: float) -> None:
    inside = room.inside
    upright = inside.width < 1.6 and inside.depth > inside.width
    small = inside.area < 6
    if labels == "kinds":
        text = _SHORT.get(room.use, room.use.replace("_", " "))
    else:
        text = room.name if small else f"{room.name}\n{inside.area:.0f} m²"
    axes.text(
        *inside.centre,
        text,
        ha="center",
        va="center",
        fontsize=(6 if small else 7) * weight,
        color=INK,
        zorder=6,
        rotation=90 if upright else 0,
        bbox={"boxstyle": "round,pad=0.12", "fc": "#ffffffb8", "ec": "none"},
    )


def _furniture(axes: Axes, pieces: Sequence[Placed], weight: float) -> None:
    """Draw furniture as it is seen from above: each part by its outline, the highest last."""
    seen = []
    for piece, pose in ((p.piece, p.pose) for p in pieces if p.piece.kind not in _LEFT_OUT):
        for link, at in link_poses(piece.model, pose).items():
            for shape in piece.model.links[link].visual:
                points = shape.mesh(at).vertices
                flat = np.unique(np.round(points[:, :2], 3), axis=0)
                if points[:, 2].min() < HANGING and np.linalg.matrix_rank(flat - flat[0]) == 2:
                    rgba = piece.model.materials[shape.material]
                    seen.append((points[:, 2].max(), flat[ConvexHull(flat).vertices], rgba))
    seen.sort(key=lambda part: part[0])
    paints = np.array([rgba for *_, rgba in seen]).reshape(-1, 4)
    faded = np.column_stack((1 - FADED * (1 - paints[:, :3]), paints[:, 3]))
    style: dict[str, Any] = {"facecolors": faded, "edgecolors": LINE, "linewidths": 0.25 * weight}
    outlines = PolyCollection([outline for _, outline, _ in seen], zorder=2, **style)
    axes.add_collection(outlines, autolim=False)
