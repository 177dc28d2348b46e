"""How a coach leads where the tree leaves it open: what a learned coach chooses, exercise by exercise."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields

import numpy as np

from rcare_marl.pose import Array

# What a value of 0 means; all our own choice.
PAUSE = 1.2  # [s] at rest after a repetition is shown, for the person to come to rest, too
TIRED, RESTED = 0.6, 2 / 3  # fatigue from which the coach rests, and the share of it until which
NEVER = math.inf


@dataclass(frozen=True)
class Style:
    """Seven values in [-1, 1]; with 0 throughout the coach leads as its tree alone does.

    Attributes:
        fast: How fast the next repetition is shown.
        long: How long the pause after it is.
        call: How soon somebody who looks away is called.
        anew: How soon a repetition is begun anew that nobody has joined.
        remind: How soon a hint that was not heeded is said again.
        fresh: How early the coach rests.
        rested: How long.
    """

    fast: float = 0.0
    long: float = 0.0
    call: float = 0.0
    anew: float = 0.0
    remind: float = 0.0
    fresh: float = 0.0
    rested: float = 0.0

    @classmethod
    def of(cls, values: Array) -> Style:
        """Return the style of values [7], cut to [-1, 1]."""
        return cls(*np.clip(values, -1.0, 1.0).tolist())

    def values(self) -> Array:
        """Return it as an array, shape [7]."""
        return np.array(astuple(self))

    @property
    def tempo(self) -> float:
        """Factor on the tempo, 0.6 to 1.6."""
        return float(1.6**self.fast)

    @property
    def pause(self) -> float:
        """After a repetition is shown [s], 0.1 to 2.3."""
        return PAUSE + 1.1 * self.long

    @property
    def calls_after(self) -> float:
        """How long somebody may look away [s], 0.3 to 6; for ever where `call` is not positive."""
        return 0.3 * 20 ** (1.0 - self.call) if self.call > 0 else NEVER

    @property
    def anew_from(self) -> float:
        """How far a repetition is shown, of 1, that nobody joins: 0.3 to 1; to its end where not positive."""
        return 1.0 - 0.7 * self.anew if self.anew > 0 else NEVER

    @property
    def reminds_after(self) -> float:
        """How long after a wrong repetition its hint is said again [s], 0.3 to 8; else never."""
        return 0.3 * 26 ** (1.0 - self.remind) if self.remind > 0 else NEVER

    @property
    def tired(self) -> float:
        """Fatigue from which the coach rests, 0.3 to 0.9."""
        return TIRED - 0.3 * self.fresh

    @property
    def rests_to(self) -> float:
        """Share of that fatigue until which it rests, 0.37 to 0.97."""
        return RESTED - 0.3 * self.rested


# The best of ten that were tried on training's learners, see docs/coaching.md.
BRISK = Style(long=-0.9, call=0.8, anew=0.5, remind=0.7)
STYLES = tuple(each.name for each in fields(Style))
