"""Proximal policy optimisation for one learner (Schulman et al. 2017)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rcare_marl.errors import ConfigError

from .network import GroupShape
from .on_policy import OnPolicy, OnPolicyConfig


@dataclass(frozen=True)
class PpoConfig(OnPolicyConfig):
    """Settings of PPO, see `OnPolicyConfig`."""


class Ppo(OnPolicy):
    """PPO: one actor, one critic on the same observation."""

    def _check(self, shapes: Mapping[str, GroupShape]) -> None:
        learners = {name: shape.agents for name, shape in shapes.items()}
        if sum(learners.values()) != 1:
            raise ConfigError(
                f"PPO trains one learner, here learn {learners} (agents by group): take ippo or mappo, "
                "or give the others a policy"
            )
