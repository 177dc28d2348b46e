"""Kinds of learners as data: how quick, heedful, fresh and free of pain somebody comes to a lesson."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError

Range = tuple[float, float]


@dataclass(frozen=True)
class LearnerKind:
    """A kind of learner; one of it is drawn uniformly from its ranges. All figures are our own choice.

    Attributes:
        description: Who it is.
        delay: Time between what is shown and what is done [s].
        size: Share of the way that is gone.
        speed: Fastest change of an angle that is followed [rad/s].
        slips: Chance to misunderstand an exercise at first, 0 to 1.
        heeds: Factor on the chances that a word or one more demonstration sets a mistake right.
        drifts_after: Attention, on average [s].
        returns_after: Until who is not called comes back, on average [s].
        fatigue: Of arms and neck at the beginning, 0 to 1.
        hurts_from: Elevation of an arm from which it hurts [deg]; above 180 nothing does.
        flinches: Share of the way that is left out for each unit of pain, of 10.
    """

    description: str = ""
    delay: Range = (0.3, 0.8)
    size: Range = (0.92, 1.05)
    speed: Range = (4.0, 4.0)
    slips: float = 0.3
    heeds: float = 1.0
    drifts_after: Range = (40.0, 120.0)
    returns_after: float = 15.0
    fatigue: Range = (0.0, 0.0)
    hurts_from: Range = (181.0, 181.0)
    flinches: float = 0.04

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name == "description":
                continue
            ends = value if isinstance(value, tuple) else (value, value)
            if not 0 <= ends[0] <= ends[1] or not math.isfinite(ends[1]):
                raise ConfigError(
                    f"{name} of a learner must be finite, not negative, the least first, got {value}"
                )
        for name in ("speed", "drifts_after", "returns_after"):
            value = getattr(self, name)
            if (value[0] if isinstance(value, tuple) else value) <= 0:
                raise ConfigError(f"{name} of a learner must be positive, got {value}")
        for name in ("slips", "flinches", "fatigue"):
            value = getattr(self, name)
            if (value[1] if isinstance(value, tuple) else value) > 1:
                raise ConfigError(f"{name} of a learner is at most 1, got {value}")


def load_learner_kind(name: str) -> LearnerKind:
    """Return a kind of learner by its name, or from a YAML file of your own.

    Raises:
        UnknownNameError: If there is none of that name, or the file names something that no kind has.
        ConfigError: If a value is impossible.
    """
    path = assets.find("learners", name)
    return load(LearnerKind, path)
