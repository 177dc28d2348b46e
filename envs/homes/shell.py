"""The shell of a house: walls with what fills their openings, ceilings and a roof; and its floor."""

from __future__ import annotations

from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import Model

from ..rectangle import Rectangle
from .palette import Palette
from .plan import CEILING_HEIGHT, Plan
from .shell_canvas import Canvas, shade
from .shell_outline import maximal
from .shell_wall import Painter, wall_boxes
from .window import fit

EAVES = 0.45  # [m] that the roof stands out
PITCH = 0.42  # rise of the roof over its run; own choice
CEILING = 0.1  # [m] thick


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
