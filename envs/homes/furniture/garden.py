"""What stands in sunrooms and gardens. Sizes are our own choice, unless a rule sets them."""

from __future__ import annotations

from ...rectangle import Rectangle
from ..piece import Piece, Setting, maker
from .joinery import Joinery


@maker("garden_table")
def make_garden_table(setting: Setting, *, width: float = 1.2, depth: float = 0.9) -> Piece:
    """Make a slatted table with room for knees and for a chair on each of its long sides."""
    table, half, top = (
        Joinery("garden_table", setting),
        0.5 * width,
        setting.rules.figure("table_height"),
    )
    slats = round(depth / 0.1)
    for k in range(slats):
        x = k * depth / slats
        table.box(
            (x, -half, top - 0.025),
            (x + depth / slats - 0.008, half, top),
            "wood_light",
            solid=False,
        )
    table.box((0.0, -half, top - 0.025), (depth, half, top), "", seen=False)
    for y in (-half + 0.08, half - 0.12):
        table.box((0.03, y, top - 0.055), (depth - 0.03, y + 0.04, top - 0.025), "wood")
    table.legs(Rectangle(0.03, -half + 0.07, depth - 0.03, half - 0.07), top - 0.055, 0.06, "wood")
    table.rod([(0.5 * depth, 0.1, top), (0.5 * depth, 0.1, top + 0.2)], 0.05, "glass")
    for x, y in ((0.3, -0.2), (0.62, -0.3), (0.6, 0.3)):
        table.rod([(x, y, top), (x, y, top + 0.11)], 0.032, "glass")
    table.measures.update(table_height=top, table_knee_height=top - 0.025)
    table.knee.append(Rectangle(0.0, -half + 0.13, depth, half - 0.13))
    table.frame("tabletop", (0.5 * depth, 0.0, top), "middle of the top")
    table.frame(
        "place_1",
        (depth + 0.35, 0.0, 0.0),
        "floor of a chair's back that faces the table",
        yaw_deg=180.0,
    )
    table.frame("place_2", (-0.35, 0.0, 0.0), "floor of a chair's back that faces the table")
    return table.piece()
