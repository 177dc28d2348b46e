"""A hospital gown on a dressing stand: one sleeve held open towards the person's hand."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.body.skeleton import SIDES
from rcare_marl.agents.people.garment import tailor
from rcare_marl.agents.people.human import Human
from rcare_marl.body import Body
from rcare_marl.pose import Array, Pose, about_z
from rcare_marl.soft.cloth import Cloth, Grip
from rcare_marl.soft.garment import Garment
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.world import World

from ..devices import DressingStand

Indices = npt.NDArray[np.int32]

# All our own choices.
GARMENT = "bed_jacket"  # a gown that reaches the lap: a longer one hooks on the feet of who sits
HOLD_FORCE, PAST = 30.0, 0.07  # [N] of the hoop; it lets go so far past the wrist [m]
END = 0.01  # [m] before the end of the beam, where it lets go at the latest
LATCH_WAY = 0.03  # [m] that the seam is pulled towards the person when the stand lets its hoop go
# How it hangs: about the gown in the frame of the body that it is cut for.
SLEEVE_BEGINS = 0.26  # [m] from the middle, from where cloth is sleeve
ARMHOLE, HEIGHT, DEPTH = 0.24, 1.30, 0.035  # [m] middle of the left one: left, up, forwards
HALF = 0.10  # [m] from there to the front edge of the armhole
BESIDE = 0.085  # [m] that front and back are beside the sleeve
SPLAY = math.radians(30)  # by which they stand off from it
NECK = 0.12  # [m] from the middle to the edge of the neck
BEHIND = 0.05  # [m] between the right halves of front and back
RISE = 0.1  # [m] for each metre that the shoulders rise towards the neck
SLEEVE_SHARE = (0.8, 0.9)  # of its depth and height that the sleeve has in the hoop
NEXT = 0.06  # [m] of front and back that count to a sleeve
MIDDLE = 0.01  # [m] from the middle of the back that is still the middle
# What the stand holds it by: near which place of the gown, how many particles, and with what force [N].
CLIPS = (
    ((0.20, 1.42, 0.03), 4, 4.0),  # the shoulder seam, which the robot takes
    ((-0.20, 1.41, 0.03), 3, 6.0),  # the other one
    ((0.24, 1.14, 0.04), 2, 2.0),  # armhole: below, front and back
    ((0.21, 1.28, 0.11), 2, 2.0),
    ((0.21, 1.28, -0.04), 2, 2.0),
)


@dataclass(frozen=True, eq=False)
class HungGown:
    """A gown on a stand.

    Attributes:
        positions: Of its particles in the frame of the armhole [m], shape [n, 3]: x out of the hoop away
            from the person, y to the left, z up.
        faces: Its faces without the tie at the neck, shape [m, 3].
        cuffs: Particles of each cuff, in order, `left` and `right`.
        sleeves: Particles of each sleeve and what is next to its armhole.
        clips: Particles that clips hold, and with what force [N].
    """

    positions: Array
    faces: Indices
    cuffs: dict[str, Indices]
    sleeves: dict[str, Indices]
    clips: tuple[tuple[Indices, float], ...]

    def placed(self, armhole: Pose) -> Array:
        """Return the positions in the world for the armhole at a pose [m], shape [n, 3]."""
        matrix = armhole.matrix()
        return np.asarray(self.positions @ matrix[:3, :3].T + matrix[:3, 3])


def hang(gown: Garment) -> HungGown:
    """Hang a gown that is open at the back, untied, so that an arm goes straight into its left sleeve.

    Front and back lie beside the sleeve, ahead of the armhole, as where somebody has gathered it to
    dress another.
    """
    rest = gown.rest
    x, y, z = rest.T
    faces, is_right = _untie(gown)
    is_sleeve = x > SLEEVE_BEGINS
    forwards, away = np.clip((z - DEPTH) / HALF, -1, 1), np.maximum(ARMHOLE - x, 0.0)
    is_back = z < DEPTH
    # The right half goes to the right altogether, the neck on the way there.
    share = np.maximum(forwards, np.clip(1 - x / NECK, 0, 1))
    share = np.where(is_back & ~is_right, forwards, share)
    across = -share * (BESIDE + away * math.sin(SPLAY)) - BEHIND * (is_right & is_back)
    ahead = (ARMHOLE - x) * math.cos(SPLAY)
    up = y - HEIGHT + RISE * np.minimum(away, 0.3) * (y > HEIGHT)
    deep, tall = SLEEVE_SHARE
    positions = np.column_stack(
        (
            np.where(is_sleeve, x - ARMHOLE, ahead),
            np.where(is_sleeve, -(z - DEPTH) * deep, across),
            np.where(is_sleeve, (y - HEIGHT) * tall, up),
        )
    )
    clips = tuple((_nearest(rest, place, count), force) for place, count, force in CLIPS)
    cuffs = {side: gown.rings[f"{side}_cuff"] for side in SIDES}
    upper = y > HEIGHT - 2 * HALF
    sleeves = {
        side: np.flatnonzero((sign * x > SLEEVE_BEGINS - NEXT) & upper).astype(np.int32)
        for side, sign in (("left", 1), ("right", -1))
    }
    return HungGown(positions, faces, cuffs, sleeves, clips)


def _untie(gown: Garment) -> tuple[Indices, npt.NDArray[np.bool_]]:
    """Return the faces without the tie at the neck, and which particles are of the right half."""
    x, y, z = gown.rest.T
    middle = np.flatnonzero((np.abs(x) < MIDDLE) & (z < 0))
    tie = middle[np.argmax(y[middle])]
    touches = (gown.faces == tie).any(axis=1)
    faces = gown.faces[~(touches & (x[gown.faces].min(axis=1) < -MIDDLE))]
    of_left = np.unique(faces[x[faces].max(axis=1) > MIDDLE])
    is_right = x < -1e-6
    is_right[np.setdiff1d(middle, of_left)] = True
    return faces, is_right


def _nearest(rest: Array, place: tuple[float, float, float], count: int) -> Indices:
    gaps = np.linalg.norm(rest - np.array(place), axis=1)
    return np.argsort(gaps, kind="stable")[:count].astype(np.int32)


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
        turn = about_z(math.atan2(out[1], out[0]))
        body = self.stand.spawn(world, Pose((float(armhole[0]), float(armhole[1]), 0.0), turn))
        self.cloth = Cloth(
            GARMENT,
            garment.rest,
            self.gown.faces,
            fabric=garment.config.fabric,
            grain=garment.grain,
            positions=self.gown.placed(self.stand.frame_in_world("armhole")),
        )
        soft_world = SoftWorld.of(world)
        soft_world.join_limbs(person.body)
        soft_world.ignore([*ignored, body], by=Cloth)
        skins = [skin for skin in world.skins if skin.body is person.body]
        soft_world.add(self.cloth, color=garment.config.rgb, beneath=skins)
        for rows, force in self.gown.clips:
            self.cloth.hold(rows, body, -1, force=force)
        self._cuff: Grip = self.cloth.hold(cuff, body, "slide", force=HOLD_FORCE)
        wrist = person.joint_pose("left_wrist").position
        way = float((self.cloth.positions[cuff].mean(axis=0) - wrist) @ out) + PAST
        self._way = min(way, self.stand.travel - END)
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
        if self._cuff.is_active and self.stand.travelled >= self._way:
            self.cloth.release(self._cuff)

    def _look(self) -> None:
        self.seam: Array = np.asarray(self.cloth.positions[self.gown.clips[0][0]].mean(axis=0))
