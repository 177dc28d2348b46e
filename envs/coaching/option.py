"""Settings of the social coaching task."""

from __future__ import annotations

from dataclasses import dataclass

from rcare_marl.agents.coaching.exercise import exercise_names
from rcare_marl.errors import ConfigError, check_name

from ..task_options import TaskOptions


@dataclass(frozen=True)
class SocialCoachingOptions(TaskOptions):
    """Settings of the social coaching task.

    Attributes:
        reward: `paper`: right repetitions alone, for the paper has no reward here; `shaped` adds engagement,
            wrong repetitions, pain, fatigue and talk.
        exercises: Which ones, in this order; what a person cannot do is left out.
        repetitions: Right repetitions asked of each.
    """

    SHAPED_WEIGHTS = {
        "repetition": 1.0,
        "wrong": 0.2,
        "engagement": 0.02,
        "pain": 0.05,
        "fatigue": 0.02,
        "talk": 0.002,
    }

    exercises: tuple[str, ...] = tuple(
        """
        lateral_raise upper_lift front_raise chest_expansion head_rotation
        """.split()
    )
    repetitions: int = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.exercises:
            check_name("exercise", name, exercise_names())
        if len(set(self.exercises)) != len(self.exercises) or not self.exercises:
            raise ConfigError(f"exercises must name some, each once, got {self.exercises}")
        if self.repetitions < 1:
            raise ConfigError(f"repetitions must be at least 1, got {self.repetitions}")
