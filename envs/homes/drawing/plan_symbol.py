"""How pieces of furniture are drawn in floor plans."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Polygon
from matplotlib.transforms import Affine2D

from rcare_marl.envs.homes.furnishing import Placed
from rcare_marl.envs.homes.piece import Piece
from rcare_marl.envs.rectangle import Rectangle

LINE, PAPER = "#7d848e", "#ffffff"
WOOD, WATER, CLOTH, GREEN, STEEL = "#ecdcc3", "#dcedf2", "#e6e1ec", "#a9c39a", "#e3e6ea"
# What hangs on walls and stands on furniture says nothing in a plan.
_LEFT_OUT = tuple(
    """
    blind curtain_window fruit_bowl grab_bar kettle knife_block light_switch mirror_wall
    pendant_lamp picture radiator toilet_paper towel_rail wall_clock
    """.split()
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
        "bookshelf closet_shelves dresser_cabinet oven_tower pantry_cupboard pantry_shelves "
        "shelf_linen tall_cupboard wardrobe"
    ),
    _chair: "chair office_chair",
    _table: "coffee_table dining_table garden_table",
    _desk: "desk",
    _machine: "dryer washing_machine",
    _fire: "fireplace",
    _lamp: "floor_lamp stool",
    _fridge: "fridge",
    _hospital_bed: "hospital_bed",
    _kitchen: "kitchen_run",
    _basin: "laundry_sink vanity washbasin",
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
