"""What is remembered of a dressing challenge, and what it scores."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rcare_marl.agents.cloth_pinch import ClothPinch
from rcare_marl.pose import Array
from rcare_marl.soft.cloth import Cloth
from rcare_marl.world import World

from .arm_cover import NEAR, ArmCover
from .hung_gown import HungGown
from .phyrc_score import PICK_UP_TIME, ScoreSheet, Stopwatch

# Of the challenge's scene, as read from its player of September 2024 (docs/phyrc.md):
PICK_UP, SLEEVE, SHOULDER, LEFT, RIGHT = 5, 5, 5, 10, 20  # points
RING_SHARE = 0.7  # of the ring of a sleeve that is near the arm
# The challenge counts 200 particles within 5 cm of a shoulder, and does not tell of how many: here a share
# of the gown's own.
SHOULDER_SHARE = 0.025  # our own choice: 20 particles, a hand's breadth of cloth


class DressingScore:
    """Watches the gown in an episode.

    Attributes:
        sheet: The points.
        cuff: Middle of the left cuff [m], shape [3].
        covered: Share of the slices of each arm that the gown goes round, `left` and `right`.
        gained: What `covered` grew by in the last control step, both together.
        scored: What the score grew by then.
    """

    def __init__(
        self, world: World, cloth: Cloth, gown: HungGown, covers: Mapping[str, ArmCover],
        pinch: ClothPinch,
    ) -> None:  # fmt: skip
        """Watch a gown on a person with these arms."""
        self._world, self._cloth, self._gown = world, cloth, gown
        self._covers, self._pinch, self._held = covers, pinch, Stopwatch()
        items = {
            "pick_up": self._pick_up,
            "sleeve": self._sleeve,
            "left_shoulder": lambda: self._shoulder("left"),
            "right_shoulder": lambda: self._shoulder("right"),
            "dressing": self._dressing,
        }
        self.sheet = ScoreSheet(items, loose=("left_shoulder", "right_shoulder"))
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self.sheet.reset()
        self._held.reset()
        self.covered = dict.fromkeys(self._covers, 0.0)
        self.gained, self.scored = 0.0, 0

    def after_step(self, duration: float) -> None:
        """Look at everything at the end of a control step of `duration` [s]."""
        points = self._cloth.positions
        self.cuff = points[self._gown.cuffs["left"]].mean(axis=0)
        self._held.update(self._pinch.is_held, duration)
        before = sum(self.covered.values())
        for side, cover in self._covers.items():
            cover.follow()
            self.covered[side] = float(cover.slices(points[self._gown.sleeves[side]]).mean())
        self.gained = sum(self.covered.values()) - before
        score = self.sheet.total
        self.sheet.update(self._world.time)
        self.scored = self.sheet.total - score

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

    def metrics(self) -> Mapping[str, float]:
        """Return what is reported beside safety."""
        return {
            "score": float(self.sheet.total),
            **{f"score_{name}": float(points) for name, points in self.sheet.points.items()},
            **{f"covered_{side}": share for side, share in self.covered.items()},
            "near_left_shoulder": self.near_shoulder("left"),
            "peak_strain": float(self._cloth.strain.max()),
        }


__all__ = ["DressingScore"]
