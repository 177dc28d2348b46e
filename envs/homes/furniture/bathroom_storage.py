"""Cupboards, shelves and small things of bathrooms and laundries."""

from __future__ import annotations

from rcare_marl.model.shape import Shape

from ...rectangle import Rectangle
from ..piece import Piece, Setting, Zone, maker
from .joinery import Joinery
from .stock import box, rod

BOARD = 0.016  # [m] thick; common chipboard, from memory
LEAF = 0.018  # [m], thickness of doors; common, from memory


def carcase(
    made: Joinery, low: tuple[float, float, float], high: tuple[float, float, float]
) -> None:
    """Add sides, back, bottom and top of a cupboard that is open along x."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    made.box((x0, y0, z0), (x1, y0 + BOARD, z1), "front")
    made.box((x0, y1 - BOARD, z0), (x1, y1, z1), "front")
    made.box((x0, y0 + BOARD, z0), (x0 + 0.012, y1 - BOARD, z1), "front")
    made.box((x0 + 0.012, y0 + BOARD, z0), (x1, y1 - BOARD, z0 + BOARD), "front")
    made.box((x0 + 0.012, y0 + BOARD, z1 - BOARD), (x1, y1 - BOARD, z1), "front")


def towels(
    made: Joinery, at: tuple[float, float, float], *, count: int, size: tuple[float, float]
) -> None:
    """Add a pile of folded towels on `at` [m], `size` deep and wide."""
    x, y, z = at
    deep, wide = 0.5 * size[0], 0.5 * size[1]
    colours = ("towel", "linen", "blanket")
    for i in range(count):
        low, high = (x - deep, y - wide, z + 0.045 * i), (x + deep, y + wide, z + 0.045 * (i + 1))
        made.draw(box(colours[i % 3], low, high))
        nose = (x + deep, y - wide + 0.005, z + 0.045 * (i + 0.5))
        made.draw(rod(colours[i % 3], 0.022, nose, (nose[0], y + wide - 0.005, nose[2])))
    made.solid(box("", (x - deep, y - wide, z), (x + deep, y + wide, z + 0.045 * count)))


def bottle(
    made: Joinery, at: tuple[float, float, float], material: str, *, height: float = 0.14
) -> None:
    """Add a dispenser for soap that stands on `at` [m], for the eye."""
    x, y, z = at
    made.draw(
        rod(material, 0.028, at, (x, y, z + height)),
        rod(
            "metal",
            0.006,
            (x, y, z + height),
            (x, y, z + height + 0.03),
            (x + 0.04, y, z + height + 0.03),
        ),
    )


@maker("bathroom_cabinet")
def bathroom_cabinet(
    setting: Setting, *, width: float = 0.4, depth: float = 0.35, height: float = 1.7
) -> Piece:
    """Return a tall cupboard with shelves behind two doors, and towels between them.

    Args:
        setting: What it is made for.
        width: Along the wall [m].
        depth: Out of the wall [m].
        height: Of its top [m].
    """
    made = Joinery("bathroom_cabinet", setting)
    half, front, inner = 0.5 * width, depth, depth - 0.02
    made.box((0.0, 0.02 - half, 0.0), (inner - 0.04, half - 0.02, 0.08), "wood_dark")
    carcase(made, (0.0, -half, 0.08), (inner, half, height))
    levels = (0.45, 0.8, 1.12, 1.4)
    for z in levels:
        made.box((0.012, BOARD - half, z), (inner, half - BOARD, z + BOARD), "front")
    for name, low, high, grip in (
        ("door_low", 0.085, levels[1] + 0.006, 0.68),
        ("door_high", levels[2] + 0.01, height - 0.002, 1.2),
    ):
        a, b = (front - LEAF, -half, low), (front, half, high)
        made.door(name, a, b, "front", hinge="left", handle_z=grip)
    towels(made, (0.16, 0.0, levels[1] + BOARD), count=4, size=(0.24, 0.28))
    made.frame("shelf_open", (0.5 * depth, 0.0, levels[1] + BOARD), "open shelf")
    sweep = Rectangle(front, -half, front + width, half + 0.05)
    use = Rectangle(front, -half, front + 0.6, half)
    return made.piece(
        Rectangle(0.0, -half, front + 0.05, half),
        height,
        zones=(Zone(use), Zone(sweep, "sweep")),
    )


@maker("shelf_linen")
def shelf_linen(setting: Setting, *, width: float = 0.8, depth: float = 0.38) -> Piece:
    """Return an open shelf with linen and boxes.

    Args:
        setting: What it is made for.
        width: Along the wall [m].
        depth: Out of the wall [m].
    """
    made = Joinery("shelf_linen", setting)
    half, high = 0.5 * width, (1.7, 1.4, 1.25)[setting.rules.level - 1]  # within reach; own choice
    for y in (-half, half - 0.02):
        made.box((0.0, y, 0.0), (depth, y + 0.02, high), "wood_light")
    rise = (high - 0.12) / 4
    for i in range(5):
        z = 0.08 + rise * i
        made.box((0.0, 0.02 - half, z), (depth, half - 0.02, z + 0.02), "wood_light")
        made.frame(f"place_{i + 1}", (0.5 * depth, 0.0, z + 0.02), "middle of a board")
        if i in (1, 2, 3):
            counts = ((2, 4), (4, 3), (3, 2))[i - 1]
            for side, count in zip((-1, 1), counts, strict=True):
                towels(made, (0.17, side * 0.19, z + 0.02), count=count, size=(0.28, 0.32))
    for y in (-0.19, 0.19):  # boxes below
        made.box((0.03, y - 0.16, 0.1), (depth - 0.02, y + 0.16, 0.27), "fabric_light")
        made.draw(rod("wood_dark", 0.01, (depth - 0.02, y, 0.22), (depth - 0.014, y, 0.22)))
    use = Rectangle(depth, -half, depth + 0.6, half)
    return made.piece(Rectangle(0.0, -half, depth, half), high, zones=(Zone(use),))


@maker("laundry_basket")
def laundry_basket(setting: Setting, *, width: float = 0.4, height: float = 0.55) -> Piece:
    """Return an open basket with clothes at its bottom.

    Args:
        setting: What it is made for.
        width: Across its top [m].
        height: Of its rim [m].
    """
    made = Joinery("laundry_basket", setting)
    radius, low, wall = 0.5 * width, 0.42 * width, 0.012
    centre = radius + 0.02
    made.draw(
        Shape(
            kind="lathe",
            material="fabric_light",
            at=(centre, 0.0, 0.0),
            profile=(
                (low, 0.0),
                (radius - 0.008, height - 0.03),
                (radius, height),
                (radius - wall, height),
                (low - wall, 0.02),
            ),
        ),
    )
    for z in (0.18, 0.36):
        share = z / height
        ring = low + share * (radius - 0.008 - low)
        profile = ((ring, z), (ring + 0.006, z + 0.01), (ring, z + 0.02), (ring, z))
        made.draw(
            Shape(kind="lathe", material="wood_light", at=(centre, 0.0, 0.0), profile=profile)
        )
    made.draw(
        Shape(
            kind="sphere",
            material="linen",
            at=(centre + 0.03, 0.04, 0.2),
            radius=0.11,
            scale=(1, 1, 0.7),
        ),
        Shape(
            kind="sphere",
            material="towel",
            at=(centre - 0.06, -0.04, 0.2),
            radius=0.1,
            scale=(1, 1, 0.8),
        ),
    )
    inner = 0.7 * radius  # of a square about as large as the circle within
    made.solid(box("", (centre - low, -low, 0.0), (centre + low, low, 0.15)))
    for sign in (-1.0, 1.0):
        a, b = sorted((sign * (radius - 0.03), sign * (radius - 0.015)))
        made.solid(box("", (centre + a, -inner, 0.15), (centre + b, inner, height)))
        made.solid(box("", (centre - inner, a, 0.15), (centre + inner, b, height)))
    made.frame("inside", (centre, 0.0, 0.28), "on the clothes")
    return made.piece(Rectangle(0.0, -radius, centre + radius, radius), height)


@maker("bath_mat")
def bath_mat(setting: Setting, *, width: float = 0.8, depth: float = 0.5) -> Piece:
    """Return a mat, which is only to see: it lies flat enough to step and roll over.

    Args:
        setting: What it is made for.
        width: Along y [m].
        depth: Along x [m].
    """
    made = Joinery("bath_mat", setting)
    half = 0.5 * width
    made.draw(
        box("towel", (0.0, -half, 0.0), (depth, half, 0.008)),
        box("linen", (0.05, 0.05 - half, 0.008), (depth - 0.05, half - 0.05, 0.01)),
        box("towel", (0.07, 0.07 - half, 0.01), (depth - 0.07, half - 0.07, 0.012)),
    )
    return made.piece(Rectangle(0.0, -half, depth, half), 0.012, blocks=False)
