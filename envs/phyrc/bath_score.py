"""What is remembered of a bathing challenge, and what it scores."""

from __future__ import annotations

import math
from collections.abc import Mapping

from rcare_marl.agents.human import Human
from rcare_marl.agents.pinch import Pinch
from rcare_marl.agents.robot import Robot
from rcare_marl.pose import Array
from rcare_marl.world import World

from ..safety import SafetyMeter
from .bath_scene import BathScene
from .phyrc_score import PICK_UP_TIME, ScoreSheet, Stopwatch
from .washed_limbs import WashedLimbs

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
FULL_SHARE_AT = 0.05  # coverage from which on gentleness counts in full


class BathScore:
    """Watches sponge, basin and skin in an episode.

    Attributes:
        sheet: The points.
        face: Middle of the face of the sponge in the world [m], shape [3].
        force: Mean force of the sponge on the person in the last control step [N].
        wetness: Of the sponge, 0 dry to 1 wet.
        coverage: Share of the skin that was washed.
        gained: What it grew by in the last control step.
        scored: What the score grew by then.
        is_held: Whether the robot holds the sponge.
    """

    face: Array

    def __init__(
        self, world: World, scene: BathScene, person: Human, robot: Robot, safety: SafetyMeter,
        limbs: WashedLimbs,
    ) -> None:  # fmt: skip
        """Watch a robot that bathes a person; ConfigError if its fingers do not move."""
        self._world, self._scene, self._person, self._robot = world, scene, person, robot
        self._safety, self._limbs = safety, limbs
        self._pinch = Pinch(world, robot, scene.sponge.body)
        self._held, self._dipped = Stopwatch(), Stopwatch()
        self.sheet = ScoreSheet(
            {"pick_up": self._pick_up, "dip": self._dip, "move": self._move, "wash": self._wash}
        )
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        for part in (self._pinch, self._limbs, self.sheet, self._held, self._dipped):
            part.reset()
        self.wetness = self.force = self.coverage = self.gained = 0.0
        self._samples = self._good = self.scored = 0
        self._pushes, self._steps = 0.0, 0
        self._is_tipped = self._is_exceeded = self._has_touched = self.is_held = False

    def after_substep(self) -> None:
        """Look at the force of the sponge in a physics step."""
        sponge = self._scene.sponge
        if sponge.soft.contacts:
            push = sponge.force_on(self._person.body)
            self._pushes += math.sqrt(float(push @ push))
        self._steps += 1

    def after_step(self, duration: float) -> None:
        """Look at everything at the end of a control step of `duration` [s]; after the safety meter."""
        self._pinch.update()
        points = self._scene.sponge.face_points()
        self.face = points.mean(axis=0)
        self.force, self._pushes, self._steps = self._pushes / max(self._steps, 1), 0.0, 0
        self._see_sponge(duration)
        self._see_basin()
        self._see_skin(points, duration)
        before = self.sheet.total
        self.sheet.update(self._world.time)
        self.scored = self.sheet.total - before

    def _see_sponge(self, duration: float) -> None:
        """Take note of whether the sponge is in the hand, and in the water."""
        sponge, basin = self._scene.sponge, self._scene.basin
        handle = sponge.pose.position
        reach = math.dist(handle, self._robot.tool_pose().position)
        self.is_held = self._pinch.is_held and reach < GRASP_RADIUS
        is_up = handle[2] > self._scene.sponge_at.position[2] + LIFTED
        self._held.update(self.is_held and is_up, duration)
        if self.wetness < 1.0:
            wets = not basin.spills() and basin.submerged(sponge.points()) >= DIPPED
            self._dipped.update(wets, duration)
            self.wetness = max(self.wetness, min(self._dipped.time / SOAK, 1.0))

    def _see_basin(self) -> None:
        basin, start = self._scene.basin, self._scene.basin_at
        pushed = math.dist(basin.pose.position, start.position)
        self._is_tipped |= pushed > PUSHED or basin.tilt() > TIPPED

    def _see_skin(self, points: Array, duration: float) -> None:
        """Take note of what the sponge does to the person."""
        presses = self.is_held and self.wetness >= 1.0 and self.force >= TOUCH
        if self.sheet.stage >= 2:
            self._is_exceeded |= self._safety.force > EXCEEDED
            self._has_touched |= presses
        before = self.coverage
        self._limbs.follow()
        if presses and self.sheet.stage >= 3:
            self._samples += 1
            self._good += GENTLE[0] < self.force <= GENTLE[1]
            touched = self._person.contact_forces(self._scene.sponge.body)
            self._limbs.wipe(touched, points, duration)
            self.coverage = self._limbs.coverage
        self.gained = self.coverage - before

    def _pick_up(self) -> int | None:
        return PICK_UP if self._held.time >= PICK_UP_TIME - 1e-9 else None

    def _dip(self) -> int | None:
        is_done = self.wetness >= 1.0 and self.is_held and not self._is_tipped
        return DIP if is_done else None

    def _move(self) -> int | None:
        if not self._has_touched:
            return None
        return -MOVE if self._is_exceeded else MOVE

    def _wash(self) -> int | None:
        return int(COVERAGE * self.coverage) + int(FORCE * self.gentleness())

    def gentleness(self) -> float:
        """Return the share of good samples of force, of what is demanded at least."""
        share = self._good / max(self._samples, LEAST_SAMPLES)
        return share * min(self.coverage / FULL_SHARE_AT, 1.0)

    def metrics(self) -> Mapping[str, float]:
        """Return what is reported beside safety."""
        return {
            "score": float(self.sheet.total),
            **{f"score_{name}": float(points) for name, points in self.sheet.points.items()},
            "coverage": self.coverage,
            "gentle_share": self.gentleness(),
            "sponge_force_n": self.force,
            "wetness": self.wetness,
            "basin_tipped": float(self._is_tipped),
        }


__all__ = ["BathScore"]
