"""A dressing stand: it holds a garment with one sleeve open, on a hoop that slides along."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rcare_marl.urdf import Model, Shape, Triple

from .assembly import Assembly
from .device import Frame
from .jointed_device import JointedDevice

# All our own choices.
TRAVEL = 0.46  # [m] of the hoop towards the person
LATCH = 20.0  # [N] that the latch of the slide holds
SPRING, SPEED = 15.0, 0.08  # [N] of the spring that draws it, and [m/s] that its brake lets it go
HOOP, WIRE = 0.085, 0.004  # [m] radius of the hoop, and of its wire
AHEAD = 0.20  # [m] from armhole to hoop
BEAM = (0.25, 0.30)  # [m] from the middle of the hoop: to the right, and up
POST = 0.80  # [m] from the armhole to the post, out of the way of feet and garment
RGBA = {"steel": (0.78, 0.79, 0.82, 1.0), "clip": (0.85, 0.35, 0.20, 1.0)}


class DressingStand(JointedDevice):
    """A post with a beam, along which a spring draws a hoop slowly, once its latch is open.

    It does not tip over. The origin is on the floor under the armhole of the garment; x points away from
    the person, z up.

    Frames: `armhole`, `hoop` (on the slide, its middle).

    Attributes:
        height: Of the armhole over the floor [m].
    """

    _on = {"hoop": "slide"}

    def __init__(self, height: float, clips: Sequence[Triple] = ()) -> None:
        """Choose the height of the armhole [m], and where clips are from there [m]."""
        self.height = height
        self._clips = tuple(clips)

    @property
    def frames(self) -> Mapping[str, Frame]:
        return {
            "armhole": Frame((0.0, 0.0, self.height), note="where the armhole is held"),
            "hoop": Frame((AHEAD, 0.0, self.height), note="middle of the cuff"),
        }

    def reset(self) -> None:
        super().reset()
        self._drive_slide(0.0, LATCH)

    def open_latch(self) -> None:
        """Let the spring draw the hoop."""
        self._drive_slide(SPEED, SPRING)

    def _drive_slide(self, speed: float, force: float) -> None:
        self.body.drive_velocities([self.body.joint("slide").index], [speed], [force])

    @property
    def travelled(self) -> float:
        """How far the hoop has slid towards the person [m]."""
        return self.body.joint_states([self.body.joint("slide").index])[0][0]

    def model(self) -> Model:
        made = Assembly("stand", 15.0)
        root, beam = made.parts["stand"], (-BEAM[0], self.height + BEAM[1])
        end = AHEAD - TRAVEL - 0.04
        rods = [
            (0.02, ((POST, beam[0], 0.03), (POST, beam[0], beam[1]))),
            (0.012, ((POST, beam[0], beam[1]), (end, beam[0], beam[1]))),
        ]
        for radius, ends in rods:
            root.visual.append(Shape(kind="cylinder", material="steel", radius=radius, points=ends))
            root.collision.append(Shape(kind="capsule", radius=radius, points=ends))
        foot, at = (0.45, 0.35, 0.03), (POST, beam[0], 0.015)
        root.visual.append(Shape(kind="box", material="steel", size=foot, at=at, bevel=0.01))
        root.collision.append(Shape(kind="box", size=foot, at=at))
        for x, y, z in self._clips:  # wires that give way
            place = (x, y, self.height + z)
            wire = ((x, beam[0], beam[1]), place)
            root.visual += [
                Shape(kind="tube", material="steel", radius=0.0015, points=wire),
                Shape(kind="sphere", material="clip", radius=0.007, at=place),
            ]
        slide = made.hang(
            "slide", "stand", 0.15, kind="prismatic", at=(AHEAD, beam[0], beam[1]),
            axis=(-1.0, 0.0, 0.0), upper=TRAVEL, effort=LATCH,
        )  # fmt: skip
        slide.inertia = ((AHEAD, beam[0], beam[1]), (1e-3, 0.0, 0.0, 1e-3, 0.0, 1e-3))
        slide.visual.append(
            Shape(
                kind="box", material="clip", at=(AHEAD, beam[0], beam[1]), size=(0.04, 0.04, 0.04)
            )
        )
        rim = [
            (AHEAD, HOOP * math.sin(a), self.height + HOOP * math.cos(a))
            for a in (2 * math.pi * k / 24 for k in range(25))
        ]
        strut = ((AHEAD, beam[0], beam[1]), (AHEAD, -0.06, self.height + 0.14), rim[0])
        for points in (tuple(rim), strut):
            slide.visual.append(Shape(kind="tube", material="steel", radius=WIRE, points=points))
        return made.model("dressing_stand", "own choice", RGBA)


__all__ = ["AHEAD", "TRAVEL", "DressingStand"]
