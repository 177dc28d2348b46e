"""Settings that every task has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from rcare_marl.errors import check_name

from .state import Values, clip

FORCE_LIMIT = 20.0  # [N] on a person; comfort ended there for the user of the RCareWorld paper

LARGEST = 1e6  # of a force limit [N] or a tolerance; above it is a slip


@dataclass(frozen=True)
class TaskOptions:
    """Settings of a task: which reward, how its terms weigh, and how much force is too much.

    Attributes:
        reward: `paper` as in the RCareWorld paper, graded, and with its ends paid for; `paper_literal` its
            terms alone; `shaped` as the page of the task says.
        weights: Of terms of the shaped reward by name; those not named keep the weights of the task.
        force_limit: Force on the person that ends the episode as a failure [N].
        spread: Share of what the task randomises at reset, 0 to 1; about its middle. The whole of it,
            1, is the task as it is evaluated; less is for the beginning of a curriculum.
        tolerance: Times the tolerance of success, from 1 on; the page of the task says what that is.
            Rewards and observations stay as they are.
        crowded: In a home, take the place with most furniture and walls close by, push nothing aside, and
            do with less free floor (`Task.slack`); else the place where most floor is free. A task at a
            door, a toilet or the like is where that is.

    Raises:
        ValueError: If a value is impossible, or the paper's reward is given weights.
        UnknownNameError: If the shaped reward has no such term.
    """

    SHAPED_WEIGHTS: ClassVar[Mapping[str, float]] = {}

    reward: Literal["paper", "paper_literal", "shaped"] = "paper"
    weights: dict[str, float] = field(default_factory=dict)
    force_limit: float = FORCE_LIMIT
    spread: float = 1.0
    tolerance: float = 1.0
    crowded: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.force_limit <= LARGEST:
            raise ValueError(
                f"force_limit must be positive and at most {LARGEST:g} N, got {self.force_limit} N"
            )
        if not 0 <= self.spread <= 1:
            raise ValueError(f"spread must lie in [0, 1], got {self.spread}")
        if not 1 <= self.tolerance <= LARGEST:
            raise ValueError(
                f"tolerance must be at least 1 and at most {LARGEST:g}, got {self.tolerance}"
            )
        if self.weights and self.reward != "shaped":
            raise ValueError("the paper's reward has no weights: use them with reward 'shaped'")
        for name in self.weights:
            check_name("term of the shaped reward", name, self.SHAPED_WEIGHTS)

    def weight(self, name: str) -> float:
        """Return the weight of a term of the shaped reward."""
        return self.weights.get(name, self.SHAPED_WEIGHTS[name])

    def weighted(self, terms: Mapping[str, Values]) -> dict[str, Values]:
        """Return terms of the shaped reward times their weights."""
        return {name: self.weight(name) * value for name, value in terms.items()}

    def discomfort(self, force: Values, comfort: float) -> Values:
        """Return how far a force is from comfortable to the limit, 0 to 1.

        Args:
            force: On the person [N].
            comfort: What is comfortable [N]; half the limit if that is less.
        """
        free = min(comfort, 0.5 * self.force_limit)
        return clip((force - free) / (self.force_limit - free), 0.0, 1.0)
