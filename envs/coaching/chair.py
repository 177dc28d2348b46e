"""A wheelchair whose armrests are taken off where an arm exercises."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from rcare_marl.agents.body.skeleton import SIDES
from rcare_marl.errors import UnknownNameError
from rcare_marl.urdf import Model, Shape

from ..devices.wheelchair import Wheelchair


class ExerciseChair(Wheelchair):
    """A wheelchair with removable armrests, as most have: an arm hangs and is raised freely beside the seat.

    Attributes:
        bare: Sides without an armrest.
    """

    def __init__(self, bare: Collection[str]) -> None:
        """Take the armrests off some sides.

        Raises:
            UnknownNameError: If a side is neither `left` nor `right`.
        """
        super().__init__(mounts="none")
        for side in bare:
            if side not in SIDES:
                raise UnknownNameError("side", side, SIDES)
        self.bare = tuple(bare)

    def model(self) -> Model:
        whole, frame = super().model(), self._frame()
        off: list[Shape] = []
        for sign in (1 if side == "left" else -1 for side in self.bare):
            pads = [frame.armrest_pad(sign), frame.armrest_pad(sign, bevel=0.012)]
            off += [*pads, frame.armrest_hoop(sign)]
        links = {
            name: dataclasses.replace(
                link,
                visual=tuple(shape for shape in link.visual if shape not in off),
                collision=tuple(shape for shape in link.collision if shape not in off),
            )
            for name, link in whole.links.items()
        }
        return dataclasses.replace(whole, links=links)


__all__ = ["ExerciseChair"]
