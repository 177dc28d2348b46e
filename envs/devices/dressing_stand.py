"""A dressing stand: it holds a garment with one sleeve open, on a hoop that slides along."""

from __future__ import annotations

from collections.abc import Sequence

from rcare_marl.model.shape import Shape, Triple

from .device import Device


class DressingStand(Device):
    """A post with a beam, along which a spring draws a hoop slowly, once its latch is open.

    It does not tip over. The origin is on the floor under the armhole of the garment; x points away from
    the person, z up.

    Frames: `armhole`, `hoop` (on the slide, its middle).
    """

    def __init__(self, height: float, clips: Sequence[Triple] = ()) -> None:
        """Choose the height of the armhole [m], and where clips are from there [m].

        Raises:
            ConfigError: If the post does not go so far up or down.
        """
        super().__init__("dressing_stand", fixed={"height": height})
        beam = self.model.links["beam"]
        shapes, (_, y, z) = list(beam.visual), self.model.joints["slide"].at
        for clip in clips:  # wires that give way
            wire = ((clip[0], y, z), clip)
            shapes += [
                Shape(kind="tube", material="steel", radius=0.0015, points=wire).coarse(),
                Shape(kind="sphere", material="clip", radius=0.007, at=clip).coarse(),
            ]
        self.model = self.model.with_shapes("beam", shapes)

    @property
    def travel(self) -> float:
        """How far the hoop can slide [m]."""
        return self.model.joints["slide"].upper

    def reset(self) -> None:
        super().reset()
        self._drive_slide(0.0, self.model.figure("latch"))

    def open_latch(self) -> None:
        """Let the spring draw the hoop."""
        self._drive_slide(self.model.figure("speed"), self.model.figure("spring"))

    def _drive_slide(self, speed: float, force: float) -> None:
        self.body.drive_velocities([self.body.joint("slide").index], [speed], [force])

    @property
    def travelled(self) -> float:
        """How far the hoop has slid towards the person [m]."""
        return self.body.joint_states([self.body.joint("slide").index])[0][0]
