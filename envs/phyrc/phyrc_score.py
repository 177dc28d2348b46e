"""The PhyRC challenges and their scoring: items in a fixed order, looked at once a second."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcare_marl.pose import Array

from ..state import State, Values, clip
from ..task import STANDING_CAREGIVER, Task
from ..task_options import TaskOptions

CHECK_EVERY = 1.0  # [s]: the challenge's scenes
PICK_UP_TIME = 3.0  # [s] that a thing is held without a break: the challenge's scenes
FULL_SCORE = 50  # points of a challenge
HURT = 1.0  # points for each step that is left when someone was hurt; our own choice

# What an item is worth now; None while it is not earned.
Item = Callable[[], "int | None"]


class ScoreSheet:
    """Points by item.

    Items are in order: one that is not earned yet keeps all later ones from counting, unless it is a
    loose one. What was earned stays; an item that still tells a number has that number.

    Attributes:
        points: Points of each item, 0 where it was not earned.
    """

    def __init__(self, items: Mapping[str, Item], *, loose: Collection[str] = ()) -> None:
        """Take the items by name, in their order, and the names of those that keep no other back."""
        self._items, self._loose = dict(items), frozenset(loose)
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self.points = dict.fromkeys(self._items, 0)
        self._earned: set[str] = set()
        self._checked = 0

    @property
    def stage(self) -> int:
        """How many items were earned."""
        return len(self._earned)

    @property
    def total(self) -> int:
        """Sum of the points."""
        return sum(self.points.values())

    def read(self, time: float) -> dict[str, Any]:
        """Look at the items, and return what `ScoreState` tells of them; `time` is of the episode [s]."""
        before = self.total
        self.update(time)
        points = np.array(list(self.points.values()))
        return {"points": points, "earned": self.stage, "scored": self.total - before}

    def update(self, time: float) -> None:
        """Look at the items if a second has passed since the last look; `time` is of the episode [s]."""
        second = int(time / CHECK_EVERY + 1e-9)
        if second == self._checked:
            return
        self._checked = second
        for name, item in self._items.items():
            worth = item()
            if worth is not None:
                self._earned.add(name)
                self.points[name] = worth
            elif name not in self._earned and name not in self._loose:
                return


class Stopwatch:
    """How long something has lasted without a break [s]."""

    def __init__(self) -> None:
        self.time = 0.0

    def reset(self) -> None:
        """Begin anew."""
        self.time = 0.0

    def update(self, lasts: bool, duration: float) -> None:
        """Count `duration` [s] if it lasts, else begin anew."""
        self.time = self.time + duration if lasts else 0.0


@dataclass(frozen=True)
class ChallengeOptions(TaskOptions):
    """Settings of a challenge; see its task."""

    success_score: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.success_score <= FULL_SCORE:
            raise ValueError(f"success_score must be 1 to {FULL_SCORE}, got {self.success_score}")


@dataclass(frozen=True, eq=False)
class ScoreState(State):
    """What every challenge reads."""

    points: Array  # of each item, shape [n]
    earned: int  # how many items were earned
    scored: int  # what the score grew by in the control step
    way: float  # how far it is to what is next [m]
    is_held: bool  # whether the robot holds what it is to take
    gained: float  # what the covered share grew by in the control step

    @property
    def score(self) -> Values:
        """Sum of the points."""
        return self.points.sum(axis=-1)


class Challenge(Task):
    """A challenge, which lasts until its time is over.

    Attributes:
        items: Names of what is scored.
        comfort: Force on the person that is free of penalty in `shaped` [N].
    """

    caregiver = STANDING_CAREGIVER
    room_kinds = ("bedroom", "living", "lounge", "dining")
    slack = 0.05
    options: ChallengeOptions
    state: Any
    items: Sequence[str]
    comfort: float

    def rewards(self, role: str, state: Any) -> Mapping[str, Values]:
        terms: dict[str, Values] = {"score": state.scored}
        if self.options.reward == "shaped":
            terms |= {"reach": -clip(state.way, 0.0, 1.0), "covered": state.gained}
            terms["comfort"] = -self.options.discomfort(state.force, self.comfort)
            terms = self.options.weighted(terms)
        # Else a robot that scores nothing any more would hurt to end its losses.
        return {**terms, "hurt": self.for_the_rest(state, self.failed(state), -HURT)}

    def metrics(self, state: Any) -> Mapping[str, Values]:
        points = {f"score_{name}": state.points[..., k] for k, name in enumerate(self.items)}
        return {"score": state.score, **points}

    def is_success(self, state: ScoreState) -> Values:
        """Return whether the time is over and the score is high enough."""
        is_over = state.time >= self.time_limit - 1e-9
        return is_over & (state.score * self.options.tolerance >= self.options.success_score)
