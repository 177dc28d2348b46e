"""Light switches, which hang beside doors."""

from __future__ import annotations

from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Link, Model

from ...devices import Frame
from ...rectangle import Rectangle
from ..piece import Piece, Setting, maker

# Plates of rocker switches are 2 3/4 by 4 1/2 in: common US sizes, from memory [m].
PLATE = (0.07, 0.115, 0.006)  # wide, high, thick
_ROCKER = (0.033, 0.066, 0.006)


@maker("light_switch")
def make_light_switch(setting: Setting) -> Piece:
    """Make a light switch with a rocker, at the height that the level wants.

    It has no solid shape: nobody bumps into a plate of 6 mm.
    """
    height = setting.rules.figure("switch_height")
    wide, high, thick = PLATE
    out = thick + _ROCKER[2]
    shapes = (
        Shape(kind="box", material="trim", at=(0.5 * thick, 0.0, height), size=(thick, wide, high)),
        Shape(
            kind="box",
            material="white",
            at=(thick + 0.5 * _ROCKER[2], 0.0, height),
            size=(_ROCKER[2], _ROCKER[0], _ROCKER[1]),
        ),
    )
    colours = setting.palette.materials()
    model = Model(
        name="light_switch",
        source="common sizes, from memory; rules of accessibility",
        links={"plate": Link(visual=shapes)},
        materials={name: colours[name] for name in ("trim", "white")},
    )
    return Piece(
        kind="light_switch",
        model=model,
        footprint=Rectangle(0.0, -0.5 * wide, out, 0.5 * wide),
        height=height + 0.5 * high,
        frames={"rocker": Frame((out, 0.0, height), note="to press, x out of the wall")},
        measures={"switch_height": height},
        blocks=False,
    )
