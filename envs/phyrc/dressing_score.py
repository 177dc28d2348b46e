"""What is remembered of a dressing challenge, and what it scores."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.people.body.skeleton import SIDES
from rcare_marl.agents.robots.pinch import ClothPinch
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array

from ..state import State
from .arm_cover import NEAR, ArmCover
from .gown_stand import GownStand
from .phyrc_score import PICK_UP_TIME, ScoreSheet, ScoreState, Stopwatch

# Of the challenge's scene, as read from its player of September 2024 (docs/phyrc.md):
PICK_UP, SLEEVE, SHOULDER, LEFT, RIGHT = 5, 5, 5, 10, 20  # points
ITEMS = ("pick_up", "sleeve", "left_shoulder", "right_shoulder", "dressing")
RING_SHARE = 0.7  # of the ring of a sleeve that is near the arm
# The challenge counts 200 particles within 5 cm of a shoulder, and does not tell of how many: here a share
# of the gown's own.
SHOULDER_SHARE = 0.025  # our own choice: 20 particles, a hand's breadth of cloth


@dataclass(frozen=True, eq=False)
class GownState(ScoreState):
    """What the dressing challenge reads; the way is from the tool to seam or shoulder."""

    seam: Array  # where the seam is that a robot takes [m], shape [3]
    tool: Array  # where its tool is [m], shape [3]
    cuff: Array  # middle of the left cuff [m], shape [3]
    arm: Array  # left wrist, elbow and shoulder [m], shape [3, 3]
    pull: float  # with which it pulls [N]
    covered: Array  # share of the slices of each of `SIDES` that the gown goes round, shape [2]
    near_left: float  # share of the gown's particles that are near the left shoulder
    strain: float  # greatest strain of the cloth so far


class DressingScore:
    """Watches the gown in an episode.

    Attributes:
        sheet: The points.
        covered: Share of the slices of each arm that the gown goes round, `left` and `right`.
    """

    def __init__(
        self, robot: Robot, stand: GownStand, covers: Mapping[str, ArmCover], pinch: ClothPinch
    ) -> None:
        """Watch a gown on a person with these arms, whom a robot dresses."""
        self._robot, self._stand = robot, stand
        self._cloth, self._gown = stand.cloth, stand.gown
        self._covers, self._pinch, self._held = covers, pinch, Stopwatch()
        items = (
            self._pick_up,
            self._sleeve,
            lambda: self._shoulder("left"),
            lambda: self._shoulder("right"),
            self._dressing,
        )
        self.sheet = ScoreSheet(
            dict(zip(ITEMS, items, strict=True)), loose=("left_shoulder", "right_shoulder")
        )
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self.sheet.reset()
        self._held.reset()
        self.covered = dict.fromkeys(self._covers, 0.0)

    def read(self, now: State, duration: float) -> GownState:
        """Look at everything at the end of a control step of `duration` [s]."""
        points, left = self._cloth.positions, self._covers["left"]
        self._held.update(self._pinch.is_held, duration)
        before = sum(self.covered.values())
        for side, cover in self._covers.items():
            cover.follow()
            self.covered[side] = float(cover.slices(points[self._gown.sleeves[side]]).mean())
        seam, tool = self._stand.seam, np.array(self._robot.tool_pose().position)
        return GownState(
            **vars(now),
            **self.sheet.read(now.time),
            seam=seam,
            tool=tool,
            cuff=points[self._gown.cuffs["left"]].mean(axis=0),
            arm=left.ends,
            way=math.dist(left.ends[2] if self._pinch.is_held else seam, tool),
            is_held=self._pinch.is_held,
            pull=self._pinch.pull,
            covered=np.array([self.covered[side] for side in SIDES]),
            gained=sum(self.covered.values()) - before,
            near_left=self.near_shoulder("left"),
            strain=float(self._cloth.strain.max()),
        )

    def _pick_up(self) -> int | None:
        return PICK_UP if self._held.time >= PICK_UP_TIME - 1e-9 else None

    def _sleeve(self) -> int | None:
        points = self._cloth.positions
        for side, cover in self._covers.items():
            ring = points[self._gown.cuffs[side]]
            if cover.near(ring).mean() >= RING_SHARE and cover.is_round(ring):
                return SLEEVE
        return None

    def _shoulder(self, side: str) -> int | None:
        """Cloth over a shoulder counts where the sleeve is on that arm."""
        is_on = self._covers[side].is_round(self._cloth.positions[self._gown.cuffs[side]])
        return SHOULDER if is_on and self.near_shoulder(side) >= SHOULDER_SHARE else None

    def _dressing(self) -> int | None:
        return int(LEFT * self.covered["left"]) + int(RIGHT * self.covered["right"])

    def near_shoulder(self, side: str) -> float:
        """Return the share of the gown's particles that are near a shoulder."""
        cover, points = self._covers[side], self._cloth.positions
        apart: Array = np.linalg.norm(points - cover.ends[2], axis=1)
        return float((apart < cover.shoulder_radius + NEAR).mean())
