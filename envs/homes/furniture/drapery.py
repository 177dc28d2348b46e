"""What hangs beside doors."""

from __future__ import annotations

from .joinery import Joinery, furniture

# Plates of rocker switches are 2 3/4 by 4 1/2 in: common US sizes, from memory [m].
PLATE = (0.07, 0.115, 0.006)  # wide, high, thick
_ROCKER = (0.033, 0.066, 0.006)


@furniture("light_switch")
def make_light_switch(made: Joinery) -> None:
    """Make a light switch with a rocker, at the height that the level wants.

    It has no solid shape: nobody bumps into a plate of 6 mm.
    """
    z, (wide, high, thick), (a, b, c) = made.ruled("switch_height"), PLATE, _ROCKER
    made.slab((0.5 * thick, 0.0, z), (thick, wide, high), "trim", solid=False)
    made.slab((thick + 0.5 * c, 0.0, z), (c, a, b), "white", solid=False)
    made.frame("rocker", (thick + c, 0.0, z), "to press, x out of the wall")
    made.outline(thick + c, 0.5 * wide, z + 0.5 * high)
    made.blocks = False
