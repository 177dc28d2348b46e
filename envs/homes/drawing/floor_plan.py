"""Floor plans as drawings: walls, doors and windows, furniture by its symbols, ways."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyBboxPatch, Polygon
from matplotlib.patches import Rectangle as Patch
from matplotlib.transforms import Affine2D

from rcare_marl.envs.homes.care_home import CareHome
from rcare_marl.envs.homes.door import hinge_side
from rcare_marl.envs.homes.furnishing import Placed
from rcare_marl.envs.homes.piece import Piece
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
LINE, PAPER = "#7d848e", "#ffffff"
WOOD, WATER, CLOTH, GREEN, STEEL = "#ecdcc3", "#dcedf2", "#e6e1ec", "#a9c39a", "#e3e6ea"
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
    for placed in home.placed:
        draw_piece(axes, placed, weight=weight)
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


class Pen:
    """Draws in the frame of a piece: x out of the wall that it stands against, in metres."""

    def __init__(self, axes: Axes, placed: Placed, *, weight: float = 1.0) -> None:
        x, y, _ = placed.pose.position
        matrix = placed.pose.matrix()
        turn = Affine2D.from_values(matrix[0, 0], matrix[1, 0], matrix[0, 1], matrix[1, 1], x, y)
        self._axes, self._weight = axes, weight
        self._transform = turn + axes.transData

    def _style(self, fill: str, style: dict[str, Any]) -> dict[str, Any]:
        plain = {"fc": fill, "ec": LINE, "lw": 0.6 * self._weight, "zorder": 2}
        return {"transform": self._transform, **plain, **style}

    def box(
        self, area: Rectangle, fill: str = PAPER, *, rounding: float = 0.02, **style: Any
    ) -> None:
        """Draw a box with round corners."""
        size = min(rounding, 0.45 * min(area.width, area.depth))
        shape = f"round,pad=0,rounding_size={max(size, 0.001)}"
        low = area.x0, area.y0
        self._axes.add_patch(
            FancyBboxPatch(low, area.width, area.depth, shape, **self._style(fill, style))
        )

    def round(self, x: float, y: float, radius: float, fill: str = PAPER, **style: Any) -> None:
        """Draw a circle."""
        self._axes.add_patch(Circle((x, y), radius, **self._style(fill, style)))

    def polygon(self, points: list[tuple[float, float]], fill: str, **style: Any) -> None:
        """Draw a polygon."""
        self._axes.add_patch(Polygon(points, **self._style(fill, style)))

    def line(self, *points: tuple[float, float], **style: Any) -> None:
        """Draw a line."""
        plain = {"color": LINE, "lw": 0.5 * self._weight, "zorder": 2}
        xs, ys = zip(*points, strict=True)
        self._axes.plot(xs, ys, transform=self._transform, **{**plain, **style})


Symbol = Callable[[Pen, Piece, Rectangle], None]


def draw_piece(axes: Axes, placed: Placed, *, weight: float = 1.0) -> None:
    """Draw a piece of furniture into a floor plan; `weight` scales its lines."""
    piece = placed.piece
    if piece.kind in _LEFT_OUT:
        return
    _SYMBOLS.get(piece.kind, _plain)(Pen(axes, placed, weight=weight), piece, piece.footprint)


def _plain(pen: Pen, piece: Piece, area: Rectangle) -> None:
    if piece.blocks:
        pen.box(area, WOOD)
    else:
        pen.box(area, "none", ls=":")


def _rug(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, "#f0ddd2", ec="#dcbfae", zorder=0.5)
    pen.box(area.grown(-0.12 * min(area.width, area.depth)), "none", ec="#dcbfae", zorder=0.5)


def _mat(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, WATER, ec="#b5d3dc", zorder=0.5)


def _bed(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, PAPER)
    pen.box(Rectangle(area.x0 + 0.6, area.y0 + 0.02, area.x1 - 0.02, area.y1 - 0.02), CLOTH)
    count = 2 if area.depth > 1.2 else 1
    wide = area.depth / count
    for i in range(count):
        low = area.y0 + i * wide
        pillow = Rectangle(area.x0 + 0.1, low + 0.1 * wide, area.x0 + 0.48, low + 0.9 * wide)
        pen.box(pillow, PAPER, rounding=0.08)


def _hospital_bed(pen: Pen, piece: Piece, area: Rectangle) -> None:
    _bed(pen, piece, area)
    for y in (area.y0, area.y1):
        pen.line((area.x0 + 0.3, y), (area.x0 + 1.3, y), lw=1.4, color="#4d7ea8")


def _seat(pen: Pen, piece: Piece, area: Rectangle) -> None:
    """A sofa or an armchair: arms, back, cushions."""
    arm, back = 0.12 * min(area.depth, 1.2), 0.26 * min(area.width, 0.9)
    pen.box(area, CLOTH, rounding=0.07)
    seats = max(round((area.depth - 2 * arm) / 0.65), 1)
    wide = (area.depth - 2 * arm) / seats
    for i in range(seats):
        low = area.y0 + arm + i * wide
        pen.box(Rectangle(area.x0 + back, low, area.x1 - 0.01, low + wide), PAPER, rounding=0.06)


def _chair(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, PAPER, rounding=0.05)
    pen.box(Rectangle(area.x0, area.y0, area.x0 + 0.07, area.y1), WOOD)


def _table(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, WOOD, rounding=0.03, zorder=2.1)


def _round_table(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.round(*area.centre, 0.5 * min(area.width, area.depth), WOOD, zorder=2.1)


def _shelf(pen: Pen, piece: Piece, area: Rectangle) -> None:
    """Cupboards as high as somebody stands are crossed out, as architects do."""
    pen.box(area, WOOD)
    pen.line((area.x0, area.y0), (area.x1, area.y1))
    if area.depth > 0.9:
        pen.line((area.x0, area.y1), (area.x1, area.y0))


def _desk(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, WOOD)
    x, y = piece.frames["monitor"].pose.position[:2] if "monitor" in piece.frames else (0.2, 0.0)
    pen.box(Rectangle(x - 0.03, y - 0.28, x + 0.03, y + 0.28), "#59616b")


def _television(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, WOOD)
    x = 0.5 * (area.x0 + area.x1)
    pen.box(Rectangle(x - 0.03, -0.45 * area.depth, x + 0.03, 0.45 * area.depth), "#59616b")


def _plant(pen: Pen, piece: Piece, area: Rectangle) -> None:
    radius = 0.42 * min(area.width, area.depth)
    pen.round(*area.centre, radius, GREEN, ec="#7e9a70")
    pen.round(*area.centre, 0.35 * radius, "#8fae7f", ec="#7e9a70")


def _lamp(pen: Pen, piece: Piece, area: Rectangle) -> None:
    radius = 0.45 * min(area.width, area.depth)
    pen.round(*area.centre, radius, "#fdf3d0")
    pen.round(*area.centre, 0.25 * radius, PAPER)


def _kitchen(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, STEEL)
    for knee in piece.knee:
        pen.box(knee.common(area) or knee, "#f4f5f7", ls=":")
    if "basin" in piece.frames:
        x, y = piece.frames["basin"].pose.position[:2]
        pen.box(Rectangle(x - 0.2, y - 0.26, x + 0.2, y + 0.26), WATER, rounding=0.06)
    if "hob" in piece.frames:
        x, y = piece.frames["hob"].pose.position[:2]
        pen.box(Rectangle(x - 0.25, y - 0.28, x + 0.25, y + 0.28), "#59616b")
        for dx in (-0.12, 0.12):
            for dy in (-0.14, 0.14):
                pen.round(x + dx, y + dy, 0.08, "#59616b", ec=PAPER)


def _machine(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, PAPER)
    pen.round(*area.centre, 0.33 * min(area.width, area.depth), WATER)


def _fridge(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, STEEL)
    x = area.x1 - 0.06
    pen.line((x, area.y0), (x, area.y1))


def _toilet(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(Rectangle(0.0, -0.2, 0.2, 0.2), PAPER, rounding=0.04)
    x = piece.frames["seat"].pose.position[0]
    pen.box(Rectangle(x - 0.27, -0.19, x + 0.24, 0.19), PAPER, rounding=0.17)
    pen.box(Rectangle(x - 0.17, -0.12, x + 0.17, 0.12), WATER, rounding=0.11)
    for name in ("grab_bar_side", "fold_down"):
        if name in piece.frames:
            y = piece.frames[name].pose.position[1]
            pen.line((0.05, y), (0.85, y), lw=1.4, color="#4d7ea8")


def _basin(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, PAPER, rounding=0.08)
    x, y = piece.frames["basin"].pose.position[:2] if "basin" in piece.frames else area.centre
    half = 0.36 * min(area.depth, 0.7)
    pen.box(Rectangle(x - 0.16, y - half, x + 0.16, y + half), WATER, rounding=0.12)


def _bath(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, PAPER)
    pen.box(area.grown(-0.08), WATER, rounding=0.25)


def _shower(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, WATER, zorder=1)
    pen.line((area.x0, area.y0), (area.x1, area.y1), color="#b7d0d8", zorder=1)
    pen.line((area.x0, area.y1), (area.x1, area.y0), color="#b7d0d8", zorder=1)
    if "seat" in piece.frames:
        x, y = piece.frames["seat"].pose.position[:2]
        pen.box(Rectangle(x - 0.2, y - 0.2, x + 0.2, y + 0.2), WOOD)


def _wheelchair(pen: Pen, piece: Piece, area: Rectangle) -> None:
    for y in (area.y0, area.y1 - 0.06):
        pen.box(Rectangle(0.05, y, 0.66, y + 0.06), "#59616b")
    pen.box(Rectangle(0.2, area.y0 + 0.1, 0.68, area.y1 - 0.1), "#7fa3c7")
    pen.box(Rectangle(0.8, area.y0 + 0.14, 1.0, area.y1 - 0.14), STEEL)


def _piano(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(Rectangle(area.x0, area.y0, area.x0 + 0.6, area.y1), "#59616b")
    pen.box(Rectangle(area.x0 + 0.4, area.y0 + 0.06, area.x0 + 0.56, area.y1 - 0.06), PAPER)
    pen.box(Rectangle(area.x1 - 0.36, -0.35, area.x1, 0.35), CLOTH)


def _fire(pen: Pen, piece: Piece, area: Rectangle) -> None:
    pen.box(area, STEEL)
    pen.polygon([(0.12, -0.35), (0.12, 0.35), (0.45, 0.22), (0.45, -0.22)], "#e8a25c")


# Which pieces each symbol stands for.
_KINDS: dict[Symbol, str] = {
    _seat: "armchair recliner sofa",
    _mat: "bath_mat exercise_mat",
    _bath: "bathtub bathtub_with_seat",
    _bed: "bed",
    _shelf: (
        "bookshelf closet_shelves dresser_cabinet oven_tower pantry_shelves "
        "shelf_linen tall_cupboard wardrobe"
    ),
    _chair: "chair office_chair",
    _table: "coffee_table dining_table garden_table",
    _desk: "desk",
    _machine: "dryer washing_machine",
    _fire: "fireplace",
    _lamp: "floor_lamp",
    _fridge: "fridge",
    _hospital_bed: "hospital_bed",
    _kitchen: "kitchen_run",
    _basin: "laundry_sink washbasin",
    _wheelchair: "manual_wheelchair",
    _piano: "piano",
    _plant: "plant plant_stand",
    _shower: "roll_in_shower shower_cabin transfer_shower",
    _round_table: "round_table side_table",
    _rug: "rug",
    _toilet: "toilet",
    _television: "tv_stand",
}
_SYMBOLS = {kind: symbol for symbol, kinds in _KINDS.items() for kind in kinds.split()}
