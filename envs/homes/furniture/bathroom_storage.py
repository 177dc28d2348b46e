"""Cupboards, shelves and small things of bathrooms and laundries."""

from __future__ import annotations

from rcare_marl.model.shape import Shape, Triple

from ...rectangle import Rectangle
from ..piece import Zone
from .joinery import Joinery, front_zone, furniture

BOARD = 0.016  # [m] thick; common chipboard, from memory
LEAF = 0.018  # [m], thickness of doors; common, from memory


def carcase(made: Joinery, low: Triple, high: Triple) -> None:
    """Add sides, back, bottom and top of a cupboard that is open along x."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    made.box((x0, y0, z0), (x1, y0 + BOARD, z1), "front")
    made.box((x0, y1 - BOARD, z0), (x1, y1, z1), "front")
    made.box((x0, y0 + BOARD, z0), (x0 + 0.012, y1 - BOARD, z1), "front")
    made.box((x0 + 0.012, y0 + BOARD, z0), (x1, y1 - BOARD, z0 + BOARD), "front")
    made.box((x0 + 0.012, y0 + BOARD, z1 - BOARD), (x1, y1 - BOARD, z1), "front")


def towels(made: Joinery, at: Triple, *, count: int, size: tuple[float, float]) -> None:
    """Add a pile of folded towels on `at` [m], `size` deep and wide."""
    (x, y, z), deep, wide = at, 0.5 * size[0], 0.5 * size[1]
    for i in range(count):
        colour = ("towel", "linen", "blanket")[i % 3]
        made.show(
            (x - deep, y - wide, z + 0.045 * i), (x + deep, y + wide, z + 0.045 * (i + 1)), colour
        )
        nose, middle = y - wide + 0.005, z + 0.045 * (i + 0.5)
        made.rod(((x + deep, nose, middle), (x + deep, y + wide - 0.005, middle)), 0.022, colour)
    made.block((x - deep, y - wide, z), (x + deep, y + wide, z + 0.045 * count))


def bottle(made: Joinery, at: Triple, material: str) -> None:
    """Add a dispenser for soap that stands on `at` [m], for the eye."""
    x, y, z = at
    neck = z + 0.14
    made.post(at, neck, 0.028, material)
    made.rod(((x, y, neck), (x, y, neck + 0.03), (x + 0.04, y, neck + 0.03)), 0.006, "metal")


@furniture("bathroom_cabinet")
def bathroom_cabinet(
    made: Joinery, *, width: float = 0.4, depth: float = 0.35, height: float = 1.7
) -> None:
    """Make a tall cupboard with shelves behind two doors, and towels between them.

    It is `width` [m] wide along the wall, stands out by `depth` [m], and is `height` [m] high.
    """
    half, inner = 0.5 * width, depth - 0.02
    made.box((0.0, 0.02 - half, 0.0), (inner - 0.04, half - 0.02, 0.08), "wood_dark")
    carcase(made, (0.0, -half, 0.08), (inner, half, height))
    levels = (0.45, 0.8, 1.12, 1.4)
    for z in levels:
        made.box((0.012, BOARD - half, z), (inner, half - BOARD, z + BOARD), "front")
    for name, low, high, grip in (
        ("door_low", 0.085, levels[1] + 0.006, 0.68),
        ("door_high", levels[2] + 0.01, height - 0.002, 1.2),
    ):
        a, b = (depth - LEAF, -half, low), (depth, half, high)
        made.door(name, a, b, "front", left=True, handle_z=grip)
    towels(made, (0.16, 0.0, levels[1] + BOARD), count=4, size=(0.24, 0.28))
    made.frame("shelf_open", (0.5 * depth, 0.0, levels[1] + BOARD), "open shelf")
    sweep = Zone(Rectangle(depth, -half, depth + width, half + 0.05), "sweep")
    made.outline(depth + 0.05, half, height, front_zone(depth, half, 0.6), sweep)


@furniture("shelf_linen")
def shelf_linen(made: Joinery, *, width: float = 0.8, depth: float = 0.38) -> None:
    """Make an open shelf with linen and boxes, `width` [m] wide, that stands out by `depth` [m]."""
    half, high = 0.5 * width, (1.7, 1.4, 1.25)[made.rules.level - 1]  # within reach; own choice
    made.sides((0.0, -half, 0.0), (depth, half, high), 0.02, "wood_light")
    rise = (high - 0.12) / 4
    for i, counts in enumerate(((), (2, 4), (4, 3), (3, 2), ())):
        z = 0.08 + rise * i
        made.box((0.0, 0.02 - half, z), (depth, half - 0.02, z + 0.02), "wood_light")
        made.frame(f"place_{i + 1}", (0.5 * depth, 0.0, z + 0.02), "middle of a board")
        for side, count in zip((-1, 1), counts, strict=False):
            towels(made, (0.17, side * 0.19, z + 0.02), count=count, size=(0.28, 0.32))
    front = depth - 0.02
    for y in (-0.19, 0.19):  # boxes below
        made.box((0.03, y - 0.16, 0.1), (front, y + 0.16, 0.27), "fabric_light")
        made.rod(((front, y, 0.22), (depth - 0.014, y, 0.22)), 0.01, "wood_dark")
    made.outline(depth, half, high, front_zone(depth, half, 0.6))


@furniture("laundry_basket")
def laundry_basket(made: Joinery, *, width: float = 0.4, height: float = 0.55) -> None:
    """Make an open basket, `width` [m] across its top and `height` [m] high, with clothes at its bottom."""
    radius, low, wall = 0.5 * width, 0.42 * width, 0.012
    centre = radius + 0.02
    outside = ((low, 0.0), (radius - 0.008, height - 0.03), (radius, height))
    inside = ((radius - wall, height), (low - wall, 0.02))
    made.lathe((centre, 0.0, 0.0), (*outside, *inside), "fabric_light")
    for z in (0.18, 0.36):
        ring = low + z / height * (radius - 0.008 - low)
        profile = ((ring, z), (ring + 0.006, z + 0.01), (ring, z + 0.02), (ring, z))
        made.lathe((centre, 0.0, 0.0), profile, "wood_light")
    for material, dx, y, size, flat in (
        ("linen", 0.03, 0.04, 0.11, 0.7),
        ("towel", -0.06, -0.04, 0.1, 0.8),
    ):
        at = (centre + dx, y, 0.2)
        made.draw(Shape("sphere", material, at, radius=size, scale=(1, 1, flat)))
    inner = 0.7 * radius  # of a square about as large as the circle within
    made.block((centre - low, -low, 0.0), (centre + low, low, 0.15))
    for sign in (-1.0, 1.0):
        a, b = sorted((sign * (radius - 0.03), sign * (radius - 0.015)))
        made.block((centre + a, -inner, 0.15), (centre + b, inner, height))
        made.block((centre - inner, a, 0.15), (centre + inner, b, height))
    made.frame("inside", (centre, 0.0, 0.28), "on the clothes")
    made.outline(centre + radius, radius, height)


@furniture("bath_mat")
def bath_mat(made: Joinery, *, width: float = 0.8, depth: float = 0.5) -> None:
    """Make a mat, `width` by `depth` [m], only to see: it is flat enough to step and roll over."""
    half = 0.5 * width
    made.show((0.0, -half, 0.0), (depth, half, 0.008), "towel")
    made.show((0.05, 0.05 - half, 0.008), (depth - 0.05, half - 0.05, 0.01), "linen")
    made.show((0.07, 0.07 - half, 0.01), (depth - 0.07, half - 0.07, 0.012), "towel")
    made.outline(depth, half, 0.012)
    made.blocks = False
