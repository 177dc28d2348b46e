"""The floor of a house: one slab to roll on, finished room by room, and the ground around it."""

from __future__ import annotations

from rcare_marl.model.urdf import Model

from ..rectangle import Rectangle
from .entrance import build_entrance
from .palette import Palette
from .plan import Opening, Plan, Room
from .rule import Rules
from .shell_canvas import Axis, Canvas, shade
from .shell_outline import maximal

# Sizes of what floors are laid of [m]; common, from memory.
PLANK = (1.6, 0.17)
TILE = {"bathroom": 0.33, "laundry": 0.33}
WIDE_TILE = 0.5
PLANK_GAP, TILE_GAP = 0.003, 0.005
UNDER = -0.004  # height of what shows in the gaps
GROUND = 0.5  # [m] thick
GARDEN = 20.0  # [m] of ground around the house; own choice
PLANK_TONES = (0.9, 0.97, 1.03, 1.1)
_TILED = ("kitchen", "bathroom", "laundry", "entry", "pantry", "sunroom")
_CARPETED = ("bedroom", "library")
_DEEP = -0.35  # renderers take what is flatter than 0.3 m for a floor without end


def floor_model(plan: Plan, rules: Rules, palette: Palette) -> Model:
    """Return the floor of a house, thresholds, ground and way to the entrance, as one still link.

    Floors are at z = 0 and level, all of them one piece to whoever rolls over them.
    """
    canvas = Canvas()
    rise = rules.figure("entrance_rise")
    for area in maximal(plan.outline):
        # Slabs overlap, so that no edge lies where the other's surface ends.
        canvas.box("", area, (-max(rise, 0.1), 0.0), solid=True)
        _plinth(canvas, area, rise)
    for room in plan.rooms.values():
        _finish(canvas, room, is_plain=rules.level > 1)
    for opening in plan.openings.values():
        if opening.kind != "window":
            _doorway(canvas, opening)
    _ground(canvas, plan, rise)
    for opening in plan.openings.values():
        if opening.kind == "entrance":
            build_entrance(canvas, opening, plan, rules)
    tones = {f"plank_{k}": shade(palette.floor_wood, f) for k, f in enumerate(PLANK_TONES)}
    tones["tile_gap"] = shade(palette.floor_tile, 0.78)
    tones["plank_gap"] = shade(palette.floor_wood, 0.55)
    tones["carpet_edge"] = shade(palette.floor_carpet, 0.88)
    return canvas.model(f"{plan.name}_floor", palette, tones)


def _plinth(canvas: Canvas, area: Rectangle, rise: float) -> None:
    sides: tuple[tuple[Axis, Axis], ...] = (("x", "y"), ("y", "x"))
    for axis, across in sides:
        for at, sign in zip(area.span(across), (-1, 1), strict=True):
            canvas.upright("paving", axis, at, area.span(axis), (-rise, 0.0), sign)


def _finish(canvas: Canvas, room: Room, *, is_plain: bool) -> None:
    """Lay planks, tiles or a carpet; carpets are hard to roll on, so only usual homes have them."""
    area = room.inside
    if room.use in _TILED:
        _lay_tiles(canvas, area, TILE.get(room.use, WIDE_TILE))
    elif room.use in _CARPETED and not is_plain:
        canvas.level("carpet_edge", area, UNDER)
        canvas.level("floor_carpet", area.grown(-min(0.12, 0.2 * area.width)), 0.0)
        _stake(canvas, area, ("carpet_edge", "floor_carpet"))
    else:
        _lay_planks(canvas, area)


def _stake(canvas: Canvas, area: Rectangle, materials: tuple[str, ...]) -> None:
    """Let floors reach into the ground at one place, so that they are drawn as they are."""
    x, y = area.centre
    for material in materials:
        canvas.upright(material, "x", y, (x, x + 0.001), (_DEEP, UNDER), 1)


def _lay_tiles(canvas: Canvas, area: Rectangle, size: float) -> None:
    canvas.level("tile_gap", area, UNDER)
    half = 0.5 * TILE_GAP
    columns, rows = (max(round(e / size), 1) for e in (area.width, area.depth))
    wide, deep = area.width / columns, area.depth / rows
    for i in range(columns):
        for j in range(rows):
            x, y = area.x0 + i * wide, area.y0 + j * deep
            tile = Rectangle(x + half, y + half, x + wide - half, y + deep - half)
            canvas.level("floor_tile", tile, 0.0)
    _stake(canvas, area, ("tile_gap", "floor_tile"))


def _lay_planks(canvas: Canvas, area: Rectangle) -> None:
    """Planks run along the room, each row shifted against the last."""
    canvas.level("plank_gap", area, UNDER)
    is_along_x = area.width >= area.depth
    length, across = (area.width, area.depth) if is_along_x else (area.depth, area.width)
    half, rows = 0.5 * PLANK_GAP, max(round(across / PLANK[1]), 1)
    wide, used = across / rows, set()
    for row in range(rows):
        start = -PLANK[0] * ((row * 0.381966) % 1.0)  # golden section: no pattern shows
        number = 0
        while start < length:
            a, b = max(start, 0.0) + half, min(start + PLANK[0], length) - half
            if b - a > PLANK_GAP:
                low, high = row * wide + half, (row + 1) * wide - half
                x0, y0, x1, y1 = (a, low, b, high) if is_along_x else (low, a, high, b)
                tone = (
                    f"plank_{(row * row * 3 + 5 * number * (row % 7) + number) % len(PLANK_TONES)}"
                )
                used.add(tone)
                plank = Rectangle(area.x0 + x0, area.y0 + y0, area.x0 + x1, area.y0 + y1)
                canvas.level(tone, plank, 0.0)
            start, number = start + PLANK[0], number + 1
    _stake(canvas, area, ("plank_gap", *sorted(used)))


def _doorway(canvas: Canvas, opening: Opening) -> None:
    """Close the floor between two rooms, by a threshold if there is one."""
    gap = opening.gap
    if opening.threshold > 0:
        canvas.box("wood_dark", gap, (_DEEP, opening.threshold))
        canvas.box("", gap, (-0.01, opening.threshold), solid=True)
    elif opening.kind == "passage":
        canvas.level("plank_1", gap, 0.0)
    else:
        canvas.box("wood_dark", gap, (_DEEP, 0.0))


def _ground(canvas: Canvas, plan: Plan, rise: float) -> None:
    area = Rectangle.around(plan.outline).grown(GARDEN)
    canvas.box("grass", area, (-rise - GROUND, -rise), solid=True)
