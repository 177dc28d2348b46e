"""What stands in sunrooms and gardens. Sizes are our own choice, unless a rule sets them."""

from __future__ import annotations

from ...rectangle import Rectangle
from .joinery import Joinery, furniture


@furniture("garden_table")
def make_garden_table(made: Joinery, *, width: float = 1.2, depth: float = 0.9) -> None:
    """Make a slatted table with room for knees and for a chair on each of its long sides."""
    half, top = 0.5 * width, made.ruled("table_height")
    made.measures["table_knee_height"] = under = top - 0.025
    slats = round(depth / 0.1)
    for k in range(slats):
        x = k * depth / slats
        made.show((x, -half, under), (x + depth / slats - 0.008, half, top), "wood_light")
    made.block((0.0, -half, under), (depth, half, top))
    for y in (-half + 0.08, half - 0.12):
        made.box((0.03, y, top - 0.055), (depth - 0.03, y + 0.04, under), "wood")
    feet = Rectangle(0.03, -half + 0.07, depth - 0.03, half - 0.07)
    made.legs(feet, top - 0.055, 0.06, "wood")
    made.post((0.5 * depth, 0.1, top), top + 0.2, 0.05, "glass")
    for x, y in ((0.3, -0.2), (0.62, -0.3), (0.6, 0.3)):
        made.post((x, y, top), top + 0.11, 0.032, "glass")
    made.knee.append(Rectangle(0.0, -half + 0.13, depth, half - 0.13))
    made.frame("tabletop", (0.5 * depth, 0.0, top), "middle of the top")
    note = "floor of a chair's back that faces the table"
    made.frame("place_1", (depth + 0.35, 0.0, 0.0), note, yaw_deg=180.0)
    made.frame("place_2", (-0.35, 0.0, 0.0), note)
