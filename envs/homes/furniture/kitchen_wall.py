"""What hangs on the wall over a worktop: cabinets, extractor hood, tiles."""

from __future__ import annotations

import math
from typing import Literal

from .joinery import Joinery
from .kitchen_layout import CORNER, NARROWEST, WIDEST, RunPlan, Unit

# [m]; common, from memory.
DEPTH = 0.32
FRONT = 0.018
HEIGHT = 0.72
BOARD = 0.016
HOOD_OVER_HOB = 0.68
HOOD_WIDTH = 0.6
TILE = 0.2


def add_cabinets(assembly: Joinery, plan: RunPlan, units: tuple[Unit, ...], bottom: float) -> float:
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
        number = _cabinet(assembly, y0, y1, bottom, number)
    if plan.corner and not any(low < corner[1] and high > corner[0] for low, high in taken):
        _shelves(assembly, *corner, bottom)
    return bottom - BOARD + HEIGHT


def _free(low: float, high: float, taken: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the stretches between `low` and `high` that nothing takes and a cabinet fits into."""
    out, start = [], low
    for a, b in [*sorted(taken), (high, high)]:
        if a - start >= NARROWEST - 1e-9:
            out.append((start, min(a, high)))
        start = max(start, b)
    return out


def _cabinet(add: Joinery, y0: float, y1: float, bottom: float, number: int) -> int:
    """Hang one row of cabinets and return the number of doors so far."""
    low, top = bottom - BOARD, bottom - BOARD + HEIGHT
    for z in (low, top - BOARD):
        add.box((0.0, y0, z), (DEPTH, y1, z + BOARD), "front")
    shelf = low + 0.5 * HEIGHT
    add.box((0.0, y0, shelf), (DEPTH - 0.03, y1, shelf + BOARD), "trim")
    add.box((0.0, y0, low), (0.006, y1, top), "trim", solid=False)
    count = math.ceil((y1 - y0 - 1e-9) / WIDEST)
    width = (y1 - y0) / count
    for place in range(count + 1):
        y = min(max(y0 + place * width, y0 + 0.5 * BOARD), y1 - 0.5 * BOARD)
        add.box((0.0, y - 0.5 * BOARD, low), (DEPTH, y + 0.5 * BOARD, top), "front")
    for place in range(count):
        a = y0 + place * width
        leaves = (
            [(a, a + width)]
            if width <= 0.5 + 1e-9
            else [
                (a, a + 0.5 * width),
                (a + 0.5 * width, a + width),
            ]
        )
        for leaf, (c, d) in enumerate(leaves):
            number += 1
            at = ((DEPTH, c, low), (DEPTH + FRONT, d, top))
            hinge: Literal["left", "right"] = "left" if leaf else "right"
            name = f"wall_door_{number}"
            add.door(name, *at, "front", hinge=hinge, handle_z=low + 0.12, framed=True)
        _stores(add, a, a + width, bottom, shelf + BOARD)
    return number


def _stores(add: Joinery, y0: float, y1: float, low: float, high: float) -> None:
    """Put crockery and food into a cabinet, for the eye only."""
    y = 0.5 * (y0 + y1)
    add.rod(((0.16, y - 0.08, low), (0.16, y - 0.08, low + 0.07)), 0.10, "ceramic")
    for k, material in enumerate(("glass", "clay", "accent", "paper")):
        at = y0 + 0.06 + k * (y1 - y0 - 0.12) / 3
        add.rod(((0.12, at, high), (0.12, at, high + 0.12 + 0.03 * (k % 2))), 0.035, material)


def _shelves(add: Joinery, y0: float, y1: float, bottom: float) -> None:
    for z in (bottom - BOARD, bottom - BOARD + 0.5 * HEIGHT):
        add.box((0.0, y0, z), (0.24, y1, z + BOARD), "wood")
        for k, material in enumerate(("clay", "ceramic", "glass", "accent")):
            y = y0 + 0.09 + k * (y1 - y0 - 0.18) / 3
            tall = (0.16, 0.09, 0.13, 0.11)[(k + (z > bottom)) % 4]
            add.rod(((0.12, y, z + BOARD), (0.12, y, z + BOARD + tall)), 0.045, material)


def add_hood(add: Joinery, middle: float, worktop: float) -> float:
    """Hang an extractor hood over the hob and return the height of its top [m]."""
    z, half = worktop + HOOD_OVER_HOB, 0.5 * HOOD_WIDTH
    top = max(z + 0.45, 2.05)
    add.box((0.0, middle - half, z), (0.46, middle + half, z + 0.05), "metal")
    add.box((0.0, middle - 0.2, z + 0.05), (0.32, middle + 0.2, z + 0.11), "metal", solid=False)
    add.box((0.0, middle - 0.13, z + 0.05), (0.26, middle + 0.13, top), "metal")
    low, high = (0.06, middle - half + 0.05, z - 0.003), (0.42, middle + half - 0.05, z)
    add.box(low, high, "metal_dark", solid=False)
    for side in (-1, 1):
        at = (0.36, middle + 0.18 * side, z - 0.006)
        add.rod((at, (at[0], at[1], z - 0.002)), 0.025, "lamp")
    return top


def add_tiles(add: Joinery, plan: RunPlan, low: float, high: float) -> None:
    """Tile the wall over the worktop; under a window only a strip."""
    half = 0.5 * plan.length
    free = [(-half, half)]
    if plan.window is not None:
        a, b = plan.window[0] - half, plan.window[1] - half
        add.box(
            (0.0, max(a, -half), low), (0.006, min(b, half), low + 0.06), "wall_tile", solid=False
        )
        free = [span for span in ((-half, a), (b, half)) if span[1] - span[0] > 0.02]
    for y0, y1 in free:
        add.box((0.0, y0, low), (0.006, y1, high), "wall_tile", solid=False)
        for k in range(1, math.ceil((y1 - y0) / TILE - 1e-6)):
            y = y0 + k * TILE
            add.box((0.006, y - 0.0015, low), (0.0068, y + 0.0015, high), "trim", solid=False)
        for k in range(1, math.ceil((high - low) / TILE - 1e-6)):
            z = low + k * TILE
            add.box((0.006, y0, z - 0.0015), (0.0068, y1, z + 0.0015), "trim", solid=False)
