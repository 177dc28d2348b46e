"""Recognition, as all recognisers and sources of poses have it: frames in, judgements out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

from ..exercise import Exercise
from ..upper_body import MOTIONS

# What can be wrong with a repetition, and what the coach says of it.
ERRORS: Mapping[str, str] = {
    "no_movement": "I see no movement. Please try it with me.",
    "unknown_movement": "I do not know that movement. Please watch me and do the same.",
    "other_exercise": "That is another exercise. Please watch me and do the same.",
    "head_only": "Only your head moves. Please move your arms, too.",
    "arms_only": "Your arms move. This one is for the head alone.",
    "wrong_side": "That is the other side. Please change sides.",
    "one_side": "Please do it on both sides.",
    "range": "Please go a little further.",
    "too_far": "That is too far. Please stop where I stop.",
    "part_missing": "A part of it is missing. Please watch me to the end.",
    "direction": "Please watch the direction in which I move.",
    "asymmetric": "Please move both sides alike.",
    "too_fast": "That was too fast. Please take your time.",
    "too_slow": "Please go a little faster.",
    "bent_elbows": "Please keep your arms straighter.",
    "trunk_lean": "Please sit upright; do not lean.",
    "trunk_turn": "Please keep your shoulders still; do not turn them.",
    "head_moved": "Please keep your head still.",
    "arm_moved": "Please keep the other arm still.",
    "not_seen": "I cannot see you well enough.",
}


@dataclass(frozen=True, eq=False)
class Frame:
    """What is known of the upper body at one time.

    Attributes:
        time: On the clock of the source [s]; it only grows.
        angles: Angles of `MOTIONS` [rad], shape [16]; NaN where the source does not know.
        unsure: Standard deviation of each [rad], shape [16]; next to nothing if None. Limits give way by it.
    """

    time: float
    angles: Array
    unsure: Array | None = None

    def __post_init__(self) -> None:
        if np.shape(self.angles) != (len(MOTIONS),):
            raise ConfigError(f"a frame has {len(MOTIONS)} angles, got {np.shape(self.angles)}")


class PoseSource(Protocol):
    """Makes frames of what some device sees."""

    def update(self, raw: Any, time: float) -> Frame | None:
        """Return what is known at a time [s]; None where nothing is."""


@dataclass(frozen=True)
class Repetition:
    """One repetition, judged.

    Attributes:
        start: When it began [s].
        end: When it ended [s].
        right: Whether it was right.
        errors: What was wrong, names of `ERRORS`, the one to speak of first.
        score: How likely it is right, 0 to 1.
        measures: What was measured, by name; the recogniser's own.
        nearly: Whether it is not right but little of it is to be mended.
        used: How much of each limit was used, by name of `ERRORS`: 1 is at the limit.
    """

    start: float
    end: float
    right: bool
    errors: tuple[str, ...]
    score: float
    measures: Mapping[str, float] = field(default_factory=dict)
    nearly: bool = False
    used: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for error in self.errors:
            check_name("error of a repetition", error, ERRORS)

    @property
    def verdict(self) -> str:
        """`right`, `nearly` or `wrong`."""
        return "right" if self.right else "nearly" if self.nearly else "wrong"

    @property
    def words(self) -> str:
        """What the coach says of it; empty if there is nothing to mend."""
        if not self.errors:
            return ""
        return ("Nearly right. " if self.nearly else "") + ERRORS[self.errors[0]]


@dataclass(frozen=True)
class Judgement:
    """What a recogniser makes of a frame.

    Attributes:
        following: Whether the person follows: the green window.
        progress: How far the present repetition is, 0 to 1.
        finished: A repetition, only in the frame in which it was judged.
        hint: Plain words for the person; empty if there is nothing to say.
    """

    following: bool = False
    progress: float = 0.0
    finished: Repetition | None = None
    hint: str = ""


class Recogniser(Protocol):
    """Tells whether a person does an exercise."""

    def begin(self, exercise: Exercise) -> None:
        """Expect an exercise from now on; what was seen of an unfinished repetition is dropped."""

    def update(self, frame: Frame) -> Judgement:
        """Take the next frame."""
