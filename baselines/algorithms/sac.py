"""Soft actor-critic (Haarnoja et al. 2018), for one learner or several that do not share critics.

And its form with truncated quantile critics (Kuznetsov et al. 2020).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.objectives import SACLoss, TQCLoss

from rcare_marl.errors import ConfigError

from .network import Critic, GroupShape, meant
from .off_policy import OffPolicy, OffPolicyConfig


class Sac(OffPolicy):
    """Soft actor-critic with two critics on one agent's observation and action.

    Each agent's transition stands for itself, so agents of a group are more data for one network.
    """

    def _critics(self, shape: GroupShape) -> list[TensorDictModule]:
        return [self._critic(shape, 1) for _ in range(2)]

    def _critic(self, shape: GroupShape, outputs: int) -> TensorDictModule:
        network = Critic(
            shape.observation,
            shape.action,
            self.config.hidden,
            outputs=outputs,
            layer_norm=self.config.layer_norm,
        )
        return TensorDictModule(
            network, in_keys=["observation", "action"], out_keys=["state_action_value"]
        )

    def _transitions(self, batch: TensorDictBase) -> dict[str, TensorDict]:
        found = {}
        for group, shape in self.shapes.items():
            own = {key: batch[group, key] for key in ("observation", "action")}
            own["meant"] = meant(batch, group)
            rows = {name: value.flatten(0, 1) for name, value in own.items()}
            after = {n: v.flatten(0, 1) for n, v in self._after(batch, group).items()}
            size = [batch.shape[0] * shape.agents]
            found[group] = TensorDict({**rows, "next": after}, batch_size=size)
        return found

    def _memory_of(self, group: str) -> str:
        return group

    def _inputs(self, group: str, transitions: TensorDictBase) -> tuple[Tensor, Tensor]:
        return transitions["observation"], transitions["observation"]


@dataclass(frozen=True)
class TqcConfig(OffPolicyConfig):
    """Settings of truncated quantile critics.

    Attributes:
        critics: How many critics. The paper has 5; 2 take a quarter of the time.
        quantiles: Quantiles that each predicts (25 in the paper).
        dropped: Of each critic, how many of the highest do not reach the target (2 in the paper).
    """

    critics: int = 2
    quantiles: int = 25
    dropped: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.critics < 1 or not 0 <= self.dropped < self.quantiles:
            raise ConfigError(
                "there must be a critic, and fewer dropped than quantiles; got "
                f"{self.critics} critics, {self.dropped} dropped of {self.quantiles} quantiles"
            )


class Tqc(Sac):
    """Soft actor-critic with the highest quantiles of all critics' pool left out of the target."""

    config: TqcConfig

    def _critics(self, shape: GroupShape) -> list[TensorDictModule]:
        return [self._critic(shape, self.config.quantiles) for _ in range(self.config.critics)]

    def _loss(self, **parts: Any) -> SACLoss:
        return TQCLoss(**parts, top_quantiles_to_drop_per_net=self.config.dropped)
