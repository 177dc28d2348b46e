"""A hospital gown on a dressing stand before somebody's hand."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.agents.people.garment import tailor
from rcare_marl.agents.people.human import Human
from rcare_marl.body import Body
from rcare_marl.pose import Array, Pose
from rcare_marl.soft.cloth import Cloth, Grip
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.world import World

from ..devices import DressingStand
from .hung_gown import hang

# All our own choices.
GARMENT = "bed_jacket"  # a gown that reaches the lap: a longer one hooks on the feet of who sits
HOLD_FORCE, HOLD_SHORT = (
    30.0,
    0.06,
)  # [N] of the hoop; it lets the cuff go so far before its end [m]
LATCH_WAY = 0.03  # [m] that the seam is pulled towards the person when the stand lets its hoop go


class GownStand:
    """A gown, the stand that holds it, and what the stand does by itself.

    When the shoulder seam is pulled towards the person, the latch of the hoop opens: a spring draws it
    along, so that the hand comes through the cuff. Over the wrist the clips of the hoop open.

    Attributes:
        stand: The stand.
        gown: How the gown is made and hangs.
        cloth: The gown.
        out: From the person to the stand, a level unit vector, shape [3].
        seam: Where the seam is that a robot takes [m], shape [3].
    """

    def __init__(
        self, world: World, person: Human, before: Array, out: Array, *, ignored: list[Body]
    ) -> None:
        """Put the stand before a hand, and the gown on it.

        Args:
            world: Where.
            person: Whom the gown is cut for; spawned.
            before: Middle of the plane of its left armhole, before the hand, so that the hand comes
                through the middle of the cuff [m], shape [3].
            out: From the person to the stand, a level unit vector, shape [3].
            ignored: Bodies that the gown passes through.
        """
        garment, self.out = tailor(GARMENT, person.model), out
        self.gown = hang(garment)
        cuff = self.gown.cuffs["left"]
        hole = self.gown.positions[cuff]
        _, aside, up = 0.5 * (hole.min(axis=0) + hole.max(axis=0))
        armhole = before - aside * np.cross((0.0, 0.0, 1.0), out) - (0.0, 0.0, up)
        clips = [self.gown.positions[rows].mean(axis=0).tolist() for rows, _ in self.gown.clips]
        self.stand = DressingStand(float(armhole[2]), [(x, y, z) for x, y, z in clips])
        half = 0.5 * math.atan2(out[1], out[0])
        turn = (0.0, 0.0, math.sin(half), math.cos(half))
        body = self.stand.spawn(world, Pose((float(armhole[0]), float(armhole[1]), 0.0), turn))
        self.cloth = Cloth(
            GARMENT, garment.rest, self.gown.faces, fabric=garment.config.fabric, grain=garment.grain,
            positions=self.gown.placed(self.stand.frame_in_world("armhole")),
        )  # fmt: skip
        soft_world = SoftWorld.of(world)
        soft_world.join_limbs(person.body)
        soft_world.ignore([*ignored, body], by=Cloth)
        skins = [skin for skin in world.skins if skin.body is person.body]
        soft_world.add(self.cloth, color=garment.config.rgb, beneath=skins)
        for rows, force in self.gown.clips:
            self.cloth.hold(rows, body, -1, force=force)
        self._cuff: Grip = self.cloth.hold(cuff, body, "slide", force=HOLD_FORCE)
        self.reset()

    def reset(self) -> None:
        """Begin an episode, the gown on the stand."""
        self.stand.reset()
        self._is_open = False
        self._look()
        self._hung = self.seam

    def after_step(self) -> None:
        """Work latch and clips; once a control step."""
        self._look()
        if not self._is_open and float((self._hung - self.seam) @ self.out) > LATCH_WAY:
            self.stand.open_latch()
            self._is_open = True
        if self._cuff.is_active and self.stand.travelled >= self.stand.travel - HOLD_SHORT:
            self.cloth.release(self._cuff)

    def _look(self) -> None:
        self.seam: Array = np.asarray(self.cloth.positions[self.gown.clips[0][0]].mean(axis=0))
