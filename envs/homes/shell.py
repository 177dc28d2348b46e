"""The shell of a house: walls with what fills their openings, ceilings and a roof; and its floor."""

from __future__ import annotations

from collections.abc import Iterable

from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import Model

from ..rectangle import Rectangle
from .door import hinge_side
from .entrance import build_entrance
from .palette import Palette
from .plan import CEILING_HEIGHT, JAMB, LEAF, OUTSIDE, Opening, Plan, Room
from .rule import Rules
from .shell_canvas import Axis, Canvas, Span, shade
from .shell_wall import CAVITY, Painter, wall_boxes

EAVES = 0.45  # [m] that the roof stands out
PITCH = 0.42  # rise of the roof over its run; own choice
CEILING = 0.1  # [m] thick
# Lengths in metres; common sizes, from memory, and own choice.
CASING, CASING_OUT = 0.06, 0.015
FRAME, FRAME_DEEP = 0.055, 0.07
PANE = 0.03  # thickness of what collides
WIDEST_PANE = 1.1  # wider windows have a mullion
STOP = 0.012  # strip that a shut leaf rests against
# Sizes of what floors are laid of [m]; common, from memory.
PLANK = (1.6, 0.17)
TILE = {"bathroom": 0.33, "laundry": 0.33}
WIDE_TILE = 0.5
PLANK_GAP, TILE_GAP = 0.003, 0.005
UNDER = -0.004  # height of what shows in the gaps
GROUND = 0.5  # [m] thick
GARDEN = 20.0  # [m] of ground around the house; own choice
PLANK_TONES = (0.9, 0.97, 1.03, 1.1)
_DEEP = -0.35  # renderers take what is flatter than 0.3 m for a floor without end


def shell_model(
    plan: Plan,
    palette: Palette,
    *,
    ceilings: bool = True,
    wall_height: float | None = None,
) -> Model:
    """Return the walls of a house as one still link; doors are not among them, their linings are.

    Args:
        plan: The floor plan.
        palette: The colours of the house.
        ceilings: Whether to build ceilings, and over a whole house a roof.
        wall_height: Where to cut walls [m]; at the ceiling if None.

    Raises:
        ConfigError: If `wall_height` is not above the floor and below the ceiling.
    """
    height = CEILING_HEIGHT if wall_height is None else wall_height
    if not 0 < height <= CEILING_HEIGHT:
        raise ConfigError(f"wall_height must be within 0 and {CEILING_HEIGHT} m, got {height}")
    canvas = Canvas()
    painter = Painter(plan, canvas, height)
    for block in wall_boxes(plan, height=height):
        canvas.box("", block.area, (block.low, block.high), solid=True)
    for wall in plan.walls:
        painter.paint(wall)
    for opening in plan.openings.values():
        fit(canvas, opening, height)
    if ceilings:
        for room in plan.rooms.values():
            canvas.level("ceiling", room.inside.grown(0.02), height, up=False)
            area = room.inside.grown(0.06)
            x, y = area.centre
            # Renderers take what is flatter than 0.3 m for a floor: reach up at one place.
            canvas.upright("ceiling", "x", y, (x, x + 0.001), (height, height + 0.35), 1)
            canvas.box("", area, (height, height + CEILING), solid=True)
        if wall_height is None:
            for area in maximal(plan.outline):
                _roof(canvas, area.grown(EAVES), height)
    tones = {"grout": shade(palette.wall_tile, 0.8)}
    return canvas.model(f"{plan.name}_walls", palette, tones)


def _roof(canvas: Canvas, area: Rectangle, height: float) -> None:
    """A hipped roof over a rectangle, with boards under and along its eaves."""
    low = height + 0.12
    run = 0.5 * min(area.width, area.depth)
    top = low + PITCH * run
    (x0, y0, x1, y1), (cx, cy) = (area.x0, area.y0, area.x1, area.y1), area.centre
    if area.width >= area.depth:
        a, b = (x0 + run, cy, top), (x1 - run, cy, top)
    else:
        a, b = (cx, y0 + run, top), (cx, y1 - run, top)
    p, q, r, s = (x0, y0, low), (x1, y0, low), (x1, y1, low), (x0, y1, low)
    if area.width >= area.depth:
        faces = [(p, q, b, a), (q, r, b, b), (r, s, a, b), (s, p, a, a)]
    else:
        faces = [(p, q, a, a), (q, r, b, a), (r, s, b, b), (s, p, a, b)]
    for face in faces:
        canvas.face("clay", face)
    canvas.box("trim", area.grown(-0.02), (height + 0.01, low - 0.005))


def fit(canvas: Canvas, opening: Opening, height: float) -> None:
    """Fit what belongs into an opening; nothing above where walls are cut, at `height` [m]."""
    if opening.sill < height:
        _Fitting(canvas, opening, height).fit()


class _Fitting:
    """What is fitted into one opening, in its frame."""

    def __init__(self, canvas: Canvas, opening: Opening, height: float) -> None:
        self._canvas, self._opening, self._height = canvas, opening, height
        self._half, self._deep = 0.5 * opening.width, 0.5 * opening.thickness

    def fit(self) -> None:
        """Fit it."""
        opening = self._opening
        if opening.kind == "window":
            self._window()
        elif opening.kind == "passage":
            self._reveal("wall")
            self._casings(0.0)
        else:
            self._lining()
            self._casings(0.0 if opening.hardware == "slider" else 0.5 * JAMB)

    def _box(self, material: str, x: Span, y: Span, z: Span, *, solid: bool = False) -> None:
        """Add a box, cut where walls are."""
        top = min(z[1], self._height)
        if top - z[0] > 1e-6:
            area = Rectangle(x[0], y[0], x[1], y[1]).moved(self._opening.pose)
            self._canvas.box(material, area, (z[0], top), solid=solid)

    def _casings(self, inward: float) -> None:
        """Frame an opening on both faces of the wall; windows on that of the room."""
        opening, half, deep = self._opening, self._half - inward, self._deep
        head, low, out = opening.head - inward, opening.sill, half + CASING
        faces = [(deep, deep + CASING_OUT), (-deep - CASING_OUT, -deep)]
        if opening.rooms[1] == OUTSIDE and opening.kind == "window":
            faces.pop()
        for y in faces:
            for x in ((-half - CASING, -half), (half, out)):
                self._box("trim", x, y, (low, head))
            self._box("trim", (-half - CASING, out), y, (head, head + CASING))

    def _reveal(self, material: str) -> None:
        """Paint the sides of a gap and what is over it."""
        half, y, thin = self._half, (-self._deep, self._deep), 0.001
        low, top = self._opening.sill, self._opening.head
        for x in ((-half, -half + thin), (half - thin, half)):
            self._box(material, x, y, (low, min(top, self._height)))
        self._box(material, (-half, half), y, (top - thin, top))

    def _lining(self) -> None:
        half, deep, head = self._half, self._deep, self._opening.head
        side, is_slider = hinge_side(self._opening), self._opening.hardware == "slider"
        for end in (-1, 1):
            if is_slider and end == side:
                x = (end * half - 0.002, end * half + 0.002)
                for y in ((-deep, -0.5 * CAVITY), (0.5 * CAVITY, deep)):
                    self._box("trim", x, y, (0.0, head))
            else:
                x = (end * half - JAMB, end * half) if end > 0 else (-half, -half + JAMB)
                self._box("trim", x, (-deep, deep), (0.0, head), solid=True)
        self._box("trim", (-half, half), (-deep, deep), (head - JAMB, head), solid=True)
        if not is_slider:
            back, clear, over = deep - LEAF - 0.004, half - JAMB, head - JAMB
            y = (back - STOP, back)
            for x in ((-clear, -clear + STOP), (clear - STOP, clear)):
                self._box("trim", x, y, (0.0, over))
            self._box("trim", (-clear, clear), y, (over - STOP, over))

    def _window(self) -> None:
        opening, half, deep = self._opening, self._half, self._deep
        low, head = opening.sill, opening.head
        self._reveal("trim")
        back = -0.25 * opening.thickness  # panes sit towards the outside
        y = (back - 0.5 * FRAME_DEEP, back + 0.5 * FRAME_DEEP)
        bars = [(-half, -half + FRAME), (half - FRAME, half)]
        count = int(opening.width / WIDEST_PANE)
        for k in range(count):
            at = -half + (k + 1) * opening.width / (count + 1)
            bars.append((at - 0.5 * FRAME, at + 0.5 * FRAME))
        for x in bars:
            self._box("trim", x, y, (low, head))
        for z in ((low, low + FRAME), (head - FRAME, head)):
            self._box("trim", (-half, half), y, z)
        self._box("glass", (-half, half), (back - 0.003, back + 0.003), (low, head))
        pane = (back - 0.5 * PANE, back + 0.5 * PANE)
        self._box("", (-half, half), pane, (low, head), solid=True)
        board, out = (y[1], deep + 0.04), (-deep - 0.04, y[0])  # window board inside, sill outside
        self._box("trim", (-half - 0.04, half + 0.04), board, (low - 0.025, low + 0.004))
        self._box("paving", (-half - 0.03, half + 0.03), out, (low - 0.04, low + 0.004))
        self._casings(0.0)


def maximal(areas: Iterable[Rectangle]) -> tuple[Rectangle, ...]:
    """Return the widest and the deepest rectangle over each of some that touch; they may overlap."""
    parts = tuple(areas)
    found: list[Rectangle] = []
    for part in parts:
        for first in ("x", "y"):
            grown = part
            for axis in (first, "y" if first == "x" else "x"):
                grown = _stretched(grown, axis, parts)
            if not any(other.contains(grown, by=1e-6) for other in found):
                found = [other for other in found if not grown.contains(other, by=1e-6)]
                found.append(grown)
    return tuple(found)


def _stretched(area: Rectangle, axis: str, parts: tuple[Rectangle, ...]) -> Rectangle:
    """Return a rectangle made as long along an axis as the parts together cover it."""
    edges = sorted({edge for part in parts for edge in part.span(axis)})
    start, end = area.span(axis)
    best, across = area, area.span("y" if axis == "x" else "x")
    for low in edges:
        for high in edges:
            if low <= start and end <= high:
                tried = Rectangle.of(axis, (low, high), across)
                if tried.area > best.area and _covers(parts, tried):
                    best = tried
    return best


def _covers(parts: tuple[Rectangle, ...], area: Rectangle) -> bool:
    """Return whether rectangles without overlap cover an area."""
    covered = 0.0
    for part in parts:
        width = min(part.x1, area.x1) - max(part.x0, area.x0)
        depth = min(part.y1, area.y1) - max(part.y0, area.y0)
        covered += max(width, 0.0) * max(depth, 0.0)
    return covered > area.area - 1e-6


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
        _finish(canvas, room)
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


def _finish(canvas: Canvas, room: Room) -> None:
    """Lay planks, tiles or a carpet."""
    area = room.inside
    if room.finish == "tile":
        _lay_tiles(canvas, area, TILE.get(room.use, WIDE_TILE))
    elif room.finish == "carpet":
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
