"""A dressing stand: it holds a garment with one sleeve open, on hoops that slide along."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from rcare_marl.model.shape import Shape, Triple
from rcare_marl.pose import Array

from .device import Device


class DressingStand(Device):
    """A post with a beam, along which a spring draws a hoop slowly, once its latch is open.

    It does not tip over. The origin is on the floor under the armhole of the garment; x points away from
    the person, z up.

    Frames: `armhole`, `hoop` (on the slide, its middle).
    """

    def __init__(
        self, height: float, clips: Sequence[Array] = (), armhole: Array | None = None
    ) -> None:
        """Choose the height of the armhole, where clips are, and how a second hoop goes along it.

        Args:
            height: Of the armhole [m].
            clips: Where they are from there [m], each of shape [3].
            armhole: Points of the second hoop, which is open above, from there [m], shape [n, 3].

        Raises:
            ConfigError: If the post does not go so far up or down.
        """
        super().__init__("dressing_stand", fixed={"height": height})
        middle = np.array(self.model.joints["slide"].at)
        wires = [((clip[0], *middle[1:]), clip) for clip in clips]  # that give way
        balls = [
            Shape(kind="sphere", material="clip", radius=0.007, at=_triple(clip)) for clip in clips
        ]
        self._draw("beam", [*(_wire(wire, 0.0015) for wire in wires), *balls])
        if armhole is not None:
            self._draw("slide", [_wire((np.zeros(3), *(armhole - middle)), 0.003)])

    def _draw(self, link: str, shapes: Iterable[Shape]) -> None:
        drawn = [*self.model.links[link].visual, *(shape.coarse() for shape in shapes)]
        self.model = self.model.with_shapes(link, drawn)

    @property
    def travel(self) -> float:
        """How far the hoop can slide [m]."""
        return self.model.joints["slide"].upper

    def reset(self) -> None:
        super().reset()
        self.brake()

    def open_latch(self) -> None:
        """Let the spring draw the hoop."""
        self._drive_slide(self.model.figure("speed"), self.model.figure("spring"))

    def brake(self) -> None:
        """Brake the hoops where they are."""
        self._drive_slide(0.0, self.model.figure("latch"))

    def _drive_slide(self, speed: float, force: float) -> None:
        self.body.drive_velocities([self.body.joint("slide").index], [speed], [force])

    @property
    def travelled(self) -> float:
        """How far the hoop has slid towards the person [m]."""
        return self.body.joint_states([self.body.joint("slide").index])[0][0]


def _wire(way: Iterable[Iterable[float]], radius: float) -> Shape:
    points = tuple(_triple(point) for point in way)
    return Shape(kind="tube", material="steel", radius=radius, points=points)


def _triple(point: Iterable[float]) -> Triple:
    x, y, z = (float(value) for value in point)
    return x, y, z
