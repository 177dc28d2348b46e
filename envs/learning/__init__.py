"""Environments for learners: arrays by group, many at once; see docs/learning_environments.md."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .learner_env import LearnerEnv
from .making import make_batch, make_vector
from .recipe import EnvRecipe
from .vector import CareVectorEnv

if TYPE_CHECKING:
    from .batched import BatchedEnv

__all__ = ["BatchedEnv", "CareVectorEnv", "EnvRecipe", "LearnerEnv", "make_batch", "make_vector"]


def __getattr__(name: str) -> Any:
    if name == "BatchedEnv":  # loaded when asked for: workers do without torch
        from .batched import BatchedEnv

        return BatchedEnv
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
