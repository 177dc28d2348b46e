"""What is remembered of a bathing challenge, and what it scores."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.people.body.skeleton import SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.pinch import Pinch
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array
from rcare_marl.world import World

from ..state import State
from .bath_scene import BathScene, WashedLimbs
from .phyrc_score import PICK_UP_TIME, ScoreSheet, ScoreState, Stopwatch

# Of the challenge's scene, as read from its player of October 2024 (docs/phyrc.md):
GRASP_RADIUS = 0.10  # [m] from tool to handle, within which the sponge can be taken
EXCEEDED = 12.0  # [N] on the person: five points less, remembered
GENTLE = (1.0, 6.0)  # [N] of a good sample: above the first, not above the second
TIPPED = math.radians(3.0)  # of the basin
PICK_UP, DIP, MOVE, COVERAGE, FORCE = 5, 5, 5, 10, 25  # points
# The challenge says 3 % of how far the basin is from the origin, wherever that is: here of 1.5 m.
PUSHED = 0.045  # [m] of the basin; our own choice
# What closes holes of the challenge, our own choices:
LIFTED = 0.03  # [m] over where it lay, from where a sponge counts as picked up
TOUCH = 0.5  # [N] on the person that counts as brought there, and with which a sponge wipes
DIPPED, SOAK = 0.5, 0.5  # share of the sponge under water, and for how long [s], that wets it
LEAST_SAMPLES = 100  # control steps of contact, 10 s: fewer count as if the rest had been bad
FAR = 1.0  # [m] from what is next, where the reward does not get less any more; our own choice
ITEMS = ("pick_up", "dip", "move", "wash")
SEEN = tuple(
    f"{side}_{joint}"
    for side in SIDES
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)
FULL_SHARE_AT = 0.05  # coverage from which on gentleness counts in full


@dataclass(frozen=True, eq=False)
class BathState(ScoreState):
    """What the bathing challenge reads; the way is to sponge, water or the nearest limb, `FAR` at most."""

    face: Array  # middle of the face of the sponge [m], shape [3]
    to_sponge: Array  # from the tool to the handle of the sponge [m], shape [3]
    water: Array  # middle of the surface of the water [m], shape [3]
    joints: Array  # of the limbs, see `SEEN`, left ones first [m], shape [12, 3]
    push: float  # mean force of the sponge on the person in the control step [N]
    wetness: float  # of the sponge, 0 dry to 1 wet
    coverages: Array  # share of each limb that was washed, shape [8]
    coverage: float  # share of all the skin that was
    gentleness: float  # share of good samples of force, of what is demanded at least
    is_tipped: bool  # whether the basin was tipped or pushed away


class BathScore:
    """Watches sponge, basin and skin in an episode.

    Attributes:
        sheet: The points.
    """

    def __init__(
        self, world: World, scene: BathScene, person: Human, robot: Robot, limbs: WashedLimbs
    ) -> None:
        """Watch a robot that bathes a person; ConfigError if its fingers do not move."""
        self._world, self._scene, self._person, self._robot = world, scene, person, robot
        self._limbs = limbs
        self._pinch = Pinch(world, robot, scene.sponge.body)
        self._held, self._dipped = Stopwatch(), Stopwatch()
        self.sheet = ScoreSheet(
            dict(zip(ITEMS, (self._pick_up, self._dip, self._move, self._wash), strict=True))
        )
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        for part in (self._pinch, self._limbs, self.sheet, self._held, self._dipped):
            part.reset()
        self._wetness = self._coverage = self._pushes = 0.0
        self._samples = self._good = self._steps = 0
        self._is_tipped = self._is_exceeded = self._has_touched = self._is_held = False

    def after_substep(self) -> None:
        """Look at the force of the sponge in a physics step."""
        sponge = self._scene.sponge
        if sponge.soft.contacts:
            push = sponge.force_on(self._person.body)
            self._pushes += math.sqrt(float(push @ push))
        self._steps += 1

    def read(self, now: State, duration: float) -> BathState:
        """Look at everything at the end of a control step of `duration` [s]."""
        self._pinch.update()
        points = self._scene.sponge.face_points()
        face, push = points.mean(axis=0), self._pushes / max(self._steps, 1)
        self._pushes, self._steps = 0.0, 0
        to_sponge = np.subtract(self._scene.sponge.pose.position, self._robot.tool_pose().position)
        self._see_sponge(duration)
        self._see_basin()
        covered = self._coverage
        self._see_skin(points, push, now.force, duration)
        points_now = self.sheet.read(now.time)
        water = np.array(self._scene.water())
        return BathState(
            **vars(now),
            **points_now,
            face=face,
            to_sponge=to_sponge,
            water=water,
            joints=np.array([self._person.joint_pose(joint).position for joint in SEEN]),
            way=min(self._way(face, to_sponge, water), FAR),
            is_held=self._is_held,
            push=push,
            wetness=self._wetness,
            coverages=np.array(self._limbs.coverages()),
            coverage=self._coverage,
            gained=self._coverage - covered,
            gentleness=self._gentleness(),
            is_tipped=self._is_tipped,
        )

    def _way(self, face: Array, to_sponge: Array, water: Array) -> float:
        if not self._is_held:
            return float(np.linalg.norm(to_sponge))
        if self._wetness < 1.0:
            return math.dist(face, water)
        limbs = self._limbs.limbs.values()
        return min(math.dist(face, limb.place(0.5)[0]) for limb in limbs)

    def _see_sponge(self, duration: float) -> None:
        """Take note of whether the sponge is in the hand, and in the water."""
        sponge, basin = self._scene.sponge, self._scene.basin
        handle = sponge.pose.position
        reach = math.dist(handle, self._robot.tool_pose().position)
        self._is_held = self._pinch.is_held and reach < GRASP_RADIUS
        is_up = handle[2] > self._scene.sponge_at.position[2] + LIFTED
        self._held.update(self._is_held and is_up, duration)
        if self._wetness < 1.0:
            wets = not basin.spills() and basin.submerged(sponge.points()) >= DIPPED
            self._dipped.update(wets, duration)
            self._wetness = max(self._wetness, min(self._dipped.time / SOAK, 1.0))

    def _see_basin(self) -> None:
        basin, start = self._scene.basin, self._scene.basin_at
        pushed = math.dist(basin.pose.position, start.position)
        self._is_tipped |= pushed > PUSHED or basin.tilt() > TIPPED

    def _see_skin(self, points: Array, push: float, force: float, duration: float) -> None:
        """Take note of what the sponge does to the person, whom all together press with `force`."""
        presses = self._is_held and self._wetness >= 1.0 and push >= TOUCH
        if self.sheet.stage >= 2:
            self._is_exceeded |= force > EXCEEDED
            self._has_touched |= presses
        self._limbs.follow()
        if presses and self.sheet.stage >= 3:
            self._samples += 1
            self._good += GENTLE[0] < push <= GENTLE[1]
            touched = self._person.contact_forces(self._scene.sponge.body)
            self._limbs.wipe(touched, points, duration)
            self._coverage = self._limbs.coverage

    def _pick_up(self) -> int | None:
        return PICK_UP if self._held.time >= PICK_UP_TIME - 1e-9 else None

    def _dip(self) -> int | None:
        is_done = self._wetness >= 1.0 and self._is_held and not self._is_tipped
        return DIP if is_done else None

    def _move(self) -> int | None:
        if not self._has_touched:
            return None
        return -MOVE if self._is_exceeded else MOVE

    def _wash(self) -> int | None:
        return int(COVERAGE * self._coverage) + int(FORCE * self._gentleness())

    def _gentleness(self) -> float:
        """Return the share of good samples of force, of what is demanded at least."""
        share = self._good / max(self._samples, LEAST_SAMPLES)
        return share * min(self._coverage / FULL_SHARE_AT, 1.0)
