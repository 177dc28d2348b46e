"""An overbed table: a top on one column, whose foot goes under the bed."""

from __future__ import annotations

from collections.abc import Mapping

from rcare_marl.errors import ConfigError
from rcare_marl.urdf import Model, Shape

from .assembly import Assembly
from .device import Device, Frame

# Our own choices, in the look of common overbed tables, whose tops stand 0.7 to 1.15 m high.
LENGTH, DEPTH, THICKNESS = 0.95, 0.40, 0.022  # [m] of the top
LOW, HIGH = 0.70, 1.15  # [m]
COLUMN = (0.07, 0.05)  # [m] along and across the bed
FOOT = (0.60, 0.045)  # [m] how far its legs go under the bed, and how high they are
MASS = 18.0  # [kg]
RGBA = {
    "top": (0.80, 0.70, 0.56, 1.0),
    "steel": (0.82, 0.83, 0.85, 1.0),
    "rubber": (0.15, 0.15, 0.16, 1.0),
}


class OverbedTable(Device):
    """A table over a bed: x along its depth, y from the free end of the top to the column.

    The origin is on the floor under the middle of the top. Its castors are locked: it stays where it is
    put.

    Frames: `top` (middle of the surface).

    Attributes:
        height: Of the surface [m].
    """

    def __init__(self, height: float) -> None:
        """Choose the height of the surface [m]; ConfigError if the column does not reach it."""
        if not LOW <= height <= HIGH:
            raise ConfigError(f"an overbed table is {LOW} to {HIGH} m high, not {height} m")
        self.height = height

    @property
    def frames(self) -> Mapping[str, Frame]:
        return {"top": Frame((0.0, 0.0, self.height), note="middle of the surface")}

    def model(self) -> Model:
        made = Assembly("table", MASS)
        root, top = made.parts["table"], self.height - 0.5 * THICKNESS
        y = 0.5 * LENGTH - 0.5 * COLUMN[1]
        low = FOOT[1] + 0.03
        pillar = (*COLUMN, self.height - THICKNESS - low)
        at = (0.0, y, low + 0.5 * pillar[2])
        board, middle = (DEPTH, LENGTH, THICKNESS), (0.0, 0.0, top)
        root.visual += [
            Shape(kind="box", material="top", at=middle, size=board, bevel=0.008),
            Shape(kind="box", material="steel", at=at, size=pillar, bevel=0.006),
        ]
        root.collision += [
            Shape(kind="box", at=middle, size=board),
            Shape(kind="box", at=at, size=pillar),
        ]
        for sign in (1, -1):
            leg = (0.04, FOOT[0], 0.03)
            place = (sign * 0.5 * (DEPTH - 0.06), y + 0.03 - 0.5 * FOOT[0], FOOT[1] + 0.015)
            root.visual.append(Shape(kind="box", material="steel", at=place, size=leg, bevel=0.004))
            root.collision.append(Shape(kind="box", at=place, size=leg))
            for end in (0.03, FOOT[0] - 0.03):
                wheel = (place[0], y + 0.03 - end, 0.5 * FOOT[1])
                ends = ((wheel[0] - 0.01, *wheel[1:]), (wheel[0] + 0.01, *wheel[1:]))
                root.visual.append(
                    Shape(kind="cylinder", material="rubber", radius=0.5 * FOOT[1], points=ends)
                )
        cross = (0.0, y, FOOT[1] + 0.015)
        root.visual.append(
            Shape(kind="box", material="steel", at=cross, size=(DEPTH - 0.02, 0.05, 0.03))
        )
        return made.model("overbed_table", "own choice", RGBA)


__all__ = ["OverbedTable"]
