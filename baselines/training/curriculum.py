"""A curriculum: easier stages of a task first, the next one once the present one mostly succeeds."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rcare_marl.errors import ConfigError


@dataclass(frozen=True)
class Stage:
    """How hard a task is; as it comes is the full stage, with all values 1.

    Attributes:
        spread: Share of the randomisation at reset, 0 to 1.
        tolerance: Times the tolerance of success of the task, from 1 on; each task says what that is.
        force: Times the force limit of the task, from 1 on.

    Raises:
        ConfigError: If a value is out of its range.
    """

    spread: float = 1.0
    tolerance: float = 1.0
    force: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.spread <= 1:
            raise ConfigError(f"spread must lie in [0, 1], got {self.spread}")
        for name in ("tolerance", "force"):
            if not getattr(self, name) >= 1:
                raise ConfigError(f"{name} must be at least 1, got {getattr(self, name)}")


FULL = Stage()


@dataclass(frozen=True)
class CurriculumConfig:
    """Which stages there are, and when the next one comes.

    Attributes:
        stages: The easiest first; the full one follows if it is not the last. Without any, training is
            at the full stage from the beginning.
        episodes: How many the running success is over.
        success: What it must exceed for the next stage, 0 to 1.

    Raises:
        ConfigError: If a value is out of its range.
    """

    stages: tuple[Stage, ...] = ()
    episodes: int = 50
    success: float = 0.8

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ConfigError(f"a curriculum needs at least 1 episode, got {self.episodes}")
        if not 0 <= self.success < 1:
            raise ConfigError(
                f"success must lie in [0, 1), or it is never exceeded, got {self.success}"
            )


class Curriculum:
    """Where a training is in its curriculum.

    Attributes:
        level: Number of the stage, from 0 on.
    """

    def __init__(self, config: CurriculumConfig = CurriculumConfig()) -> None:
        """Begin at the first stage."""
        self._config = config
        self._stages = list(config.stages)
        if self._stages and self._stages[-1] != FULL:
            self._stages.append(FULL)
        self._recent: deque[bool] = deque(maxlen=config.episodes)
        self.level = 0

    @property
    def stage(self) -> dict[str, float]:
        """The present stage, as `BatchedEnv.set_stage` takes it; empty where there is no curriculum."""
        return asdict(self._stages[self.level]) if self._stages else {}

    @property
    def is_full(self) -> bool:
        """Whether the task is as hard as it comes."""
        return self.level >= len(self._stages) - 1

    def observe(self, finished: Sequence[bool]) -> bool:
        """Take note of episodes that ended, and return whether the next stage begins.

        The running success then begins anew: it was that of an easier task.

        Args:
            finished: Of each, whether it succeeded; in their order.
        """
        if self.is_full:
            return False
        self._recent.extend(finished)
        is_enough = len(self._recent) == self._config.episodes
        if not is_enough or sum(self._recent) <= self._config.success * self._config.episodes:
            return False
        self.level += 1
        self._recent.clear()
        return True

    def state_dict(self) -> dict[str, Any]:
        """Return what changes."""
        return {"level": self.level, "recent": list(self._recent)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from there.

        Raises:
            ConfigError: If there is no such stage.
        """
        if not 0 <= state["level"] < max(len(self._stages), 1):
            raise ConfigError(
                f"the checkpoint is at stage {state['level']}, the curriculum has {len(self._stages)}"
            )
        self.level = state["level"]
        self._recent = deque(state["recent"], maxlen=self._config.episodes)
