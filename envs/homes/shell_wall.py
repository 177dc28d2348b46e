"""Walls: what is solid of them, and how their faces are painted."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..rectangle import Rectangle
from .door import OVERLAP, hinge_side
from .plan import CEILING_HEIGHT, OUTSIDE, Opening, Plan, Room, Wall
from .shell_canvas import Axis, Canvas, Span

CAVITY = 0.06  # [m] wide, in walls that panels slide into
POCKET_SPARE = 0.01  # [m] behind a panel that is slid in
SKIRTING = (0.07, 0.012)  # [m] height, thickness; common, from memory
# Tiles on walls [m]: how high, and width and height of one; own choice.
TILED = {"bathroom": (2.0, 0.3, 0.2), "kitchen": (1.5, 0.2, 0.1), "laundry": (1.2, 0.2, 0.2)}
GROUT, TILE_OUT = 0.003, 0.002
_ACCENTED = ("bedroom", "living", "lounge", "dining", "study", "library")
_NEAR = 0.02  # [m] in front of a face, to see which room it looks into


@dataclass(frozen=True)
class Block:
    """A solid part of a wall.

    Attributes:
        wall: Place of the wall in the plan.
        area: Its floor [m].
        low: Height of its lower edge [m].
        high: Height of its upper edge [m].
    """

    wall: int
    area: Rectangle
    low: float
    high: float


def openings_in(plan: Plan, wall: Wall) -> list[Opening]:
    """Return the openings in a wall, in the order in which they come along it."""
    found = [o for o in plan.openings.values() if o.axis == wall.axis and wall.area.has(*o.centre)]
    return sorted(found, key=lambda o: o.gap.span(o.axis))


def pocket(opening: Opening) -> Rectangle | None:
    """Return the floor within the wall into which a panel slides [m]; None for other openings."""
    if opening.hardware != "slider":
        return None
    side, half = hinge_side(opening), 0.5 * opening.width
    far = side * (half + opening.clear_width + OVERLAP + POCKET_SPARE)
    near, deep = side * half, 0.5 * opening.thickness
    area = Rectangle(min(near, far), -deep, max(near, far), deep)
    return area.moved(opening.pose)


def wall_boxes(plan: Plan, *, height: float = CEILING_HEIGHT) -> tuple[Block, ...]:
    """Return all that is solid of the walls, as boxes; panes of windows are not."""
    return tuple(
        block
        for number, wall in enumerate(plan.walls)
        for block in _blocks(plan, number, wall, height)
        if block.high - block.low > 1e-6
    )


def _blocks(plan: Plan, number: int, wall: Wall, height: float) -> list[Block]:
    start, end = wall.area.span(wall.axis)
    across = wall.area.span("y" if wall.axis == "x" else "x")
    skin = 0.5 * (across[1] - across[0] - CAVITY)
    out, at = [], start

    def add(along: Span, low: float, high: float, over: Span = across) -> None:
        area = Rectangle.of(wall.axis, along, over)
        out.append(Block(number, area, low, min(high, height)))

    voids: list[tuple[Span, Opening, bool]] = []
    for opening in openings_in(plan, wall):
        voids.append((opening.gap.span(wall.axis), opening, False))
        slot = pocket(opening)
        if slot is not None:
            voids.append((slot.span(wall.axis), opening, True))
    for along, opening, is_pocket in sorted(voids, key=lambda v: v[0]):
        if along[0] - at > 1e-6:
            add((at, along[0]), 0.0, height)
        if is_pocket:
            add(along, 0.0, opening.head, (across[0], across[0] + skin))
            add(along, 0.0, opening.head, (across[1] - skin, across[1]))
        elif opening.sill > 0:
            add(along, 0.0, opening.sill)
        add(along, opening.head, height)
        at = along[1]
    if end - at > 1e-6:
        add((at, end), 0.0, height)
    return out


class Painter:
    """Paints the faces of walls, each stretch as the room wants it that it looks into."""

    def __init__(self, plan: Plan, canvas: Canvas, height: float) -> None:
        self._plan, self._canvas, self._height = plan, canvas, height
        self._accents = {room.name: _accent(plan, room) for room in plan.rooms.values()}

    def paint(self, wall: Wall) -> None:
        """Paint both faces of a wall, its ends and its top."""
        across: Axis = "y" if wall.axis == "x" else "x"
        low, high = wall.area.span(across)
        openings = openings_in(self._plan, wall)
        cuts = self._cuts(wall, openings)
        for at, sign in ((low, -1), (high, 1)):
            for along in zip(cuts, cuts[1:], strict=False):
                self._stretch_of_face(wall.axis, at, along, sign, openings)
        start, end = wall.area.span(wall.axis)
        for at, sign in ((start, -1), (end, 1)):
            self._plain(across, at, (low, high), sign)
        for along in zip(cuts, cuts[1:], strict=False):
            over = [o for o in openings if _has(o, wall.axis, 0.5 * (along[0] + along[1]))]
            if all(o.head < self._height or o.sill >= self._height for o in over):
                top = Rectangle.of(wall.axis, along, (low, high))
                self._canvas.level("trim", top, self._height)

    def _cuts(self, wall: Wall, openings: list[Opening]) -> list[float]:
        """Where the look of a face may change along the wall [m]."""
        start, end = wall.area.span(wall.axis)
        near = wall.area.grown(0.05)
        cuts = {start, end}
        for room in self._plan.rooms.values():
            if room.inside.overlaps(near):
                cuts.update(room.inside.span(wall.axis))
        for other in self._plan.walls:
            if other is not wall and other.area.overlaps(near):
                cuts.update(other.area.span(wall.axis))
        for opening in openings:
            cuts.update(opening.gap.span(wall.axis))
        inside = sorted(cut for cut in cuts if start <= cut <= end)
        return [
            c for c, before in zip(inside, [-math.inf, *inside], strict=False) if c - before > 1e-6
        ]

    def _stretch_of_face(
        self, axis: Axis, at: float, along: Span, sign: int, openings: list[Opening]
    ) -> None:
        middle = 0.5 * (along[0] + along[1])
        room = self._behind(axis, at + sign * _NEAR, middle)
        if room is None:
            return
        opening = next((o for o in openings if _has(o, axis, middle)), None)
        bands = [(0.0, self._height)]
        if opening is not None:
            bands = [(0.0, min(opening.sill, self._height)), (opening.head, self._height)]
        for low, high in bands:
            if high - low > 1e-6:
                self._band(room, axis, at, along, (low, high), sign)
        use = "" if room == OUTSIDE else self._plan.room(room).use
        is_open = opening is not None and opening.sill == 0
        if room != OUTSIDE and use not in TILED and not is_open:
            tall, out = SKIRTING
            front = at + sign * out
            self._canvas.upright("trim", axis, front, along, (0.0, tall), sign)
            ledge = (min(at, front), max(at, front))
            self._canvas.level("trim", Rectangle.of(axis, along, ledge), tall)

    def _plain(self, axis: Axis, at: float, along: Span, sign: int) -> None:
        """Paint the end of a wall, where it is not against another."""
        room = self._behind(axis, at + sign * _NEAR, 0.5 * (along[0] + along[1]))
        if room is not None:
            material = "facade" if room == OUTSIDE else "wall"
            self._canvas.upright(material, axis, at, along, (0.0, self._height), sign)

    def _band(self, room: str, axis: Axis, at: float, along: Span, high: Span, sign: int) -> None:
        low, top = high
        if room == OUTSIDE:
            self._canvas.upright("facade", axis, at, along, high, sign)
            return
        paint = "wall_accent" if self._accents[room] == (axis, sign) else "wall"
        tiles = TILED.get(self._plan.room(room).use)
        if tiles is None:
            self._canvas.upright(paint, axis, at, along, high, sign)
            return
        limit = min(max(tiles[0], low), top)
        if top > limit:
            self._canvas.upright("wall", axis, at, along, (limit, top), sign)
        if limit > low:
            self._canvas.upright("grout", axis, at, along, (low, limit), sign)
            self._tiles(axis, at + sign * TILE_OUT, along, (low, limit), sign, tiles[1:])

    def _tiles(
        self, axis: Axis, at: float, along: Span, high: Span, sign: int, size: tuple[float, ...]
    ) -> None:
        for a, b in _cells(along, size[0]):
            for low, top in _cells(high, size[1]):
                self._canvas.upright("wall_tile", axis, at, (a, b), (low, top), sign)

    def _behind(self, axis: Axis, across: float, along: float) -> str | None:
        """Return which room is at a place, `outside` if none, None within another wall."""
        x, y = (along, across) if axis == "x" else (across, along)
        for room in self._plan.rooms.values():
            if room.inside.has(x, y):
                return room.name
        if any(wall.area.has(x, y) for wall in self._plan.walls):
            return None
        return OUTSIDE


def _has(opening: Opening, axis: Axis, at: float) -> bool:
    low, high = opening.gap.span(axis)
    return low < at < high


def _cells(along: Span, step: float) -> list[Span]:
    """Cut a stretch at multiples of `step`, leaving room for grout."""
    first, last = math.floor(along[0] / step + 1e-6), math.ceil(along[1] / step - 1e-6)
    half = 0.5 * GROUT
    cells = [
        (max(along[0], k * step) + half, min(along[1], (k + 1) * step) - half)
        for k in range(first, last)
    ]
    return [(a, b) for a, b in cells if b - a > GROUT]


def _accent(plan: Plan, room: Room) -> tuple[Axis, int] | None:
    """Return the wall of a room that is painted otherwise: without openings, and the shortest."""
    if room.use not in _ACCENTED:
        return None
    taken = set()
    for opening in plan.openings_of(room.name):
        sign = sum(opening.normal) * (1 if opening.rooms[0] == room.name else -1)
        taken.add((opening.axis, sign))
    sides: list[tuple[Axis, int]] = [("x", 1), ("x", -1), ("y", 1), ("y", -1)]
    free = [side for side in sides if side not in taken]
    lengths = {"x": room.inside.width, "y": room.inside.depth}
    return min(free, key=lambda side: lengths[side[0]]) if free else None
