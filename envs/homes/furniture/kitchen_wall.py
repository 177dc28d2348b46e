"""What hangs on the wall over a worktop: cabinets, extractor hood, tiles."""

from __future__ import annotations

import math

from .joinery import Joinery
from .kitchen_layout import CORNER, NARROWEST, WIDEST, RunPlan, Unit
from .kitchen_unit import BOARD, FRONT

# [m]; common, from memory.
DEPTH = 0.32
HEIGHT = 0.72
HOOD_OVER_HOB = 0.68
HOOD_WIDTH = 0.6
TILE = 0.2


def add_cabinets(made: Joinery, plan: RunPlan, units: tuple[Unit, ...], bottom: float) -> float:
    """Hang cabinets with their lowest shelf at `bottom` [m] and return the height of their tops [m].

    They leave free the window and the hood over the hob; into a corner they go as open shelves.
    """
    half = 0.5 * plan.length
    taken = []
    if plan.window is not None:
        taken.append((plan.window[0] - half, plan.window[1] - half))
    hob = next((unit for unit in units if unit.kind.endswith("hob")), None)
    if hob is not None:
        taken.append((hob.middle - 0.5 * HOOD_WIDTH, hob.middle + 0.5 * HOOD_WIDTH))
    corner = (half - CORNER, half) if plan.corner == "left" else (-half, CORNER - half)
    number = 0
    for y0, y1 in _free(-half, half, [*taken, corner] if plan.corner else taken):
        number = _cabinet(made, y0, y1, bottom, number)
    if plan.corner and not any(low < corner[1] and high > corner[0] for low, high in taken):
        _shelves(made, *corner, bottom)
    return bottom - BOARD + HEIGHT


def _free(low: float, high: float, taken: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the stretches between `low` and `high` that nothing takes and a cabinet fits into."""
    out, start = [], low
    for a, b in [*sorted(taken), (high, high)]:
        if a - start >= NARROWEST - 1e-9:
            out.append((start, min(a, high)))
        start = max(start, b)
    return out


def _cabinet(made: Joinery, y0: float, y1: float, bottom: float, number: int) -> int:
    """Hang one row of cabinets and return the number of doors so far."""
    low, top = bottom - BOARD, bottom - BOARD + HEIGHT
    for z in (low, top - BOARD):
        made.box((0.0, y0, z), (DEPTH, y1, z + BOARD), "front")
    shelf = low + 0.5 * HEIGHT
    made.box((0.0, y0, shelf), (DEPTH - 0.03, y1, shelf + BOARD), "trim")
    made.show((0.0, y0, low), (0.006, y1, top), "trim")
    count = math.ceil((y1 - y0 - 1e-9) / WIDEST)
    width = (y1 - y0) / count
    for place in range(count + 1):
        y = min(max(y0 + place * width, y0 + 0.5 * BOARD), y1 - 0.5 * BOARD)
        made.box((0.0, y - 0.5 * BOARD, low), (DEPTH, y + 0.5 * BOARD, top), "front")
    for place in range(count):
        a = y0 + place * width
        ends = (a, a + width) if width <= 0.5 + 1e-9 else (a, a + 0.5 * width, a + width)
        for leaf, (c, d) in enumerate(zip(ends, ends[1:], strict=False)):
            number += 1
            leaf_at, name = ((DEPTH, c, low), (DEPTH + FRONT, d, top)), f"wall_door_{number}"
            made.door(name, *leaf_at, "front", left=leaf > 0, handle_z=low + 0.12, framed=True)
        # Crockery and food, for the eye only.
        y, over = 0.5 * (a + (a + width)), shelf + BOARD
        made.post((0.16, y - 0.08, bottom), bottom + 0.07, 0.10, "ceramic")
        for k, material in enumerate(("glass", "clay", "accent", "paper")):
            at = (0.12, a + 0.06 + k * (a + width - a - 0.12) / 3, over)
            made.post(at, over + 0.12 + 0.03 * (k % 2), 0.035, material)
    return number


def _shelves(made: Joinery, y0: float, y1: float, bottom: float) -> None:
    for z in (bottom - BOARD, bottom - BOARD + 0.5 * HEIGHT):
        made.box((0.0, y0, z), (0.24, y1, z + BOARD), "wood")
        for k, material in enumerate(("clay", "ceramic", "glass", "accent")):
            foot = (0.12, y0 + 0.09 + k * (y1 - y0 - 0.18) / 3, z + BOARD)
            tall = (0.16, 0.09, 0.13, 0.11)[(k + (z > bottom)) % 4]
            made.post(foot, z + BOARD + tall, 0.045, material)


def add_hood(made: Joinery, y: float, worktop: float) -> float:
    """Hang an extractor hood over the hob, its middle at `y`, and return the height of its top [m]."""
    z, half = worktop + HOOD_OVER_HOB, 0.5 * HOOD_WIDTH
    top = max(z + 0.45, 2.05)
    made.box((0.0, y - half, z), (0.46, y + half, z + 0.05), "metal")
    made.show((0.0, y - 0.2, z + 0.05), (0.32, y + 0.2, z + 0.11), "metal")
    made.box((0.0, y - 0.13, z + 0.05), (0.26, y + 0.13, top), "metal")
    made.show((0.06, y - half + 0.05, z - 0.003), (0.42, y + half - 0.05, z), "metal_dark")
    for side in (-1, 1):
        made.post((0.36, y + 0.18 * side, z - 0.006), z - 0.002, 0.025, "lamp")
    return top


def add_tiles(made: Joinery, plan: RunPlan, low: float, high: float) -> None:
    """Tile the wall over the worktop; under a window only a strip."""
    half = 0.5 * plan.length
    free = [(-half, half)]
    if plan.window is not None:
        a, b = plan.window[0] - half, plan.window[1] - half
        made.show((0.0, max(a, -half), low), (0.006, min(b, half), low + 0.06), "wall_tile")
        free = [span for span in ((-half, a), (b, half)) if span[1] - span[0] > 0.02]
    for y0, y1 in free:
        made.show((0.0, y0, low), (0.006, y1, high), "wall_tile")
        for k in range(1, math.ceil((y1 - y0) / TILE - 1e-6)):
            y = y0 + k * TILE
            made.show((0.006, y - 0.0015, low), (0.0068, y + 0.0015, high), "trim")
        for k in range(1, math.ceil((high - low) / TILE - 1e-6)):
            z = low + k * TILE
            made.show((0.006, y0, z - 0.0015), (0.0068, y1, z + 0.0015), "trim")
