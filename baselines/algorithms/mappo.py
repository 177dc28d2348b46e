"""Multi-agent PPO: a central critic values every agent from the state, the actors see only their own.

Source: Yu et al. (2022), The surprising effectiveness of PPO in cooperative multi-agent games.
"""

from __future__ import annotations

from dataclasses import dataclass

from torchrl.objectives import MAPPOLoss

from .on_policy import OnPolicy, OnPolicyConfig


@dataclass(frozen=True)
class MappoConfig(OnPolicyConfig):
    """Settings of MAPPO, see `OnPolicyConfig`."""


class Mappo(OnPolicy):
    """MAPPO: an actor for each group, and a critic that values its agents from everybody's state."""

    LOSS = MAPPOLoss
    CENTRAL = True
