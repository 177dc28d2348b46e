"""Independent PPO for several learners: every agent is valued from its own observation.

Source: de Witt et al. (2020), Is independent learning all you need in the StarCraft multi-agent challenge?
"""

from __future__ import annotations

from dataclasses import dataclass

from torchrl.objectives import IPPOLoss

from .on_policy import OnPolicy, OnPolicyConfig


@dataclass(frozen=True)
class IppoConfig(OnPolicyConfig):
    """Settings of IPPO, see `OnPolicyConfig`."""


class Ippo(OnPolicy):
    """IPPO: an actor and a critic for each group, which its agents share."""

    LOSS = IPPOLoss
