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
HOLD_FORCE, PAST = 30.0, 0.07  # [N] of each hoop; it lets go so far past the wrist [m]
END = 0.01  # [m] before the end of the beam, where it lets go at the latest
LATCH_WAY = 0.03  # [m] that the seam is pulled towards the person when the stand lets its hoops go
# How it hangs, from the left armhole of the gown as it is cut for a body.
BEGINS = 0.02  # [m] from the outermost of the armhole, from where cloth is sleeve
HALF = 0.85  # of half the depth of the armhole, where its front edge hangs
BESIDE = 0.085  # [m] that front and back are beside the sleeve
SPLAY = math.radians(30)  # by which they stand off from it
NECK = 0.12  # [m] from the middle to the edge of the neck
BEHIND = 0.05  # [m] between the right halves of front and back
RISE = 0.1  # [m] for each metre that the shoulders rise towards the neck
SLEEVE_SHARE = (0.8, 0.9)  # of its depth and height that the sleeve has in the hoop
NEXT = 0.04  # [m] of front and back, from the armhole inwards and down, that count to a sleeve
MIDDLE = 0.01  # [m] from the middle of the back that is still the middle
# Clips on the shoulder seams at the armholes: how many particles, and with what force [N]. The robot takes
# the left one.
CLIPS = {"left": (4, 4.0), "right": (3, 6.0)}


@dataclass(frozen=True, eq=False)
class HungGown:
    """A gown on a stand.

    Attributes:
        positions: Of its particles in the frame of the armhole [m], shape [n, 3]: x out of the hoop away
            from the person, y to the left, z up.
        faces: Its faces without the tie at the neck, shape [m, 3].
        cuffs: Particles of each cuff, in order, `left` and `right`.
        sleeves: Particles of each sleeve and what is next to its armhole.
        armhole: Particles of the left armhole that its hoop holds, from the back of the shoulder seam
            below the arm to the front of it.
        clips: Particles that clips hold at the `left` and `right` shoulder seam.
    """

    positions: Array
    faces: Indices
    cuffs: dict[str, Indices]
    sleeves: dict[str, Indices]
    armhole: Indices
    clips: dict[str, Indices]

    def placed(self, armhole: Pose) -> Array:
        """Return the positions in the world for the armhole at a pose [m], shape [n, 3]."""
        matrix = armhole.matrix()
        return np.asarray(self.positions @ matrix[:3, :3].T + matrix[:3, 3])


def hang(gown: Garment) -> HungGown:
    """Hang a gown that is open at the back, untied, so that an arm goes straight into its left sleeve.

    Front and back lie beside the sleeve, ahead of the armhole, as where somebody has gathered it to
    dress another. The right half is laid back beside the front, its sleeve ahead again: hung out ahead,
    it is a pocket that knees are drawn into.
    """
    rest = gown.rest
    x, y, z = rest.T
    faces, is_right = _untie(gown)
    hole = rest[gown.rings["left_armhole"]]
    low, high = hole.min(axis=0), hole.max(axis=0)
    armhole, height, depth = 0.5 * (low + high)
    # The higher, the farther in is the edge of the armhole: it stays as slanting as it is cut.
    edge = np.interp(y, (low[1], high[1]), (high[0], low[0]))
    is_sleeve = x > high[0] + BEGINS
    # The rows of the sleeve hang round one line, that of the middle of the armhole.
    middles = np.full((len(rest), 2), (height, depth))
    for place in np.unique(x[is_sleeve]):
        middles[x == place] = rest[x == place, 1:].mean(axis=0)
    up, front = (rest[:, 1:] - middles).T
    half = HALF * 0.5 * (high[2] - low[2])
    forwards, away = np.clip((z - depth) / half, -1, 1), np.clip(edge - x, 0.0, armhole)
    is_back = z < depth
    # The right half goes to the right altogether, the neck on the way there.
    share = np.maximum(forwards, np.clip(1 - x / NECK, 0, 1))
    share = np.where(is_back & ~is_right, forwards, share)
    past = np.maximum(-x, 0.0)  # the middle of the front
    ahead = edge - armhole + (edge - np.maximum(x, 0.0)) * math.cos(SPLAY)
    ahead -= past - 2 * np.maximum(past - armhole, 0.0)
    across = -share * (BESIDE + away * math.sin(SPLAY))
    across -= BEHIND * ((is_right & is_back).astype(float) + (past > armhole))
    deep, tall = SLEEVE_SHARE
    positions = np.column_stack(
        (
            np.where(is_sleeve, x - armhole, ahead),
            np.where(is_sleeve, -front * deep, across),
            np.where(is_sleeve, up * tall, up + RISE * away * (y > height)),
        )
    )
    rings = {side: gown.rings[f"{side}_armhole"] for side in SIDES}  # from the armpit
    clips = {
        side: _nearest(rest, rest[ring[len(ring) // 2]], CLIPS[side][0])
        for side, ring in rings.items()
    }
    free = np.roll(rings["left"], len(rings["left"]) // 2)
    free = free[~np.isin(free, clips["left"])]
    cuffs = {side: gown.rings[f"{side}_cuff"] for side in SIDES}
    upper = y > low[1] - NEXT
    sleeves = {
        side: np.flatnonzero((sign * x > armhole - NEXT) & upper).astype(np.int32)
        for side, sign in (("left", 1), ("right", -1))
    }
    return HungGown(positions, faces, cuffs, sleeves, free, clips)


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


def _nearest(rest: Array, place: Array, count: int) -> Indices:
    gaps = np.linalg.norm(rest - place, axis=1)
    return np.argsort(gaps, kind="stable")[:count].astype(np.int32)


class GownStand:
    """A gown, the stand that holds it, and what the stand does by itself.

    Two hoops on one slide hold its left sleeve open, at the armhole and at the cuff. When the shoulder
    seam is pulled towards the person, their latch opens: a spring draws them along, so that the hand comes
    through both. Past the wrist the clips of each open, and after the second the slide is braked.

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
        clips = [self.gown.positions[rows].mean(axis=0) for rows in self.gown.clips.values()]
        self.stand = DressingStand(float(armhole[2]), clips, self.gown.positions[self.gown.armhole])
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
        for side, rows in self.gown.clips.items():
            self.cloth.hold(rows, body, -1, force=CLIPS[side][1])
        wrist = person.joint_pose("left_wrist").position
        self._hoops = list[tuple[Grip, float]]()  # and how far each goes until it opens [m]
        for rows in (self.gown.armhole, cuff):
            way = float((self.cloth.positions[rows].mean(axis=0) - wrist) @ out) + PAST
            hoop = self.cloth.hold(rows, body, "slide", force=HOLD_FORCE)
            self._hoops.append((hoop, min(way, self.stand.travel - END)))
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
        for hoop, way in self._hoops:
            if hoop.is_active and self.stand.travelled >= way:
                self.cloth.release(hoop)
                if not any(left.is_active for left, _ in self._hoops):
                    self.stand.brake()

    def _look(self) -> None:
        self.seam: Array = np.asarray(self.cloth.positions[self.gown.clips["left"]].mean(axis=0))
