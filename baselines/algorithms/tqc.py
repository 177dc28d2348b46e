"""Truncated quantile critics (Kuznetsov et al. 2020): SAC whose critics predict quantiles."""

from __future__ import annotations

from dataclasses import dataclass

from tensordict.nn import TensorDictModule
from torchrl.objectives import SACLoss, TQCLoss

from rcare_marl.errors import ConfigError

from .network import Actor, GroupShape, actor_module
from .off_policy import OffPolicyConfig, target_entropy
from .sac import Sac


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

    def _loss(self, actor: Actor, shape: GroupShape) -> tuple[SACLoss, TensorDictModule]:
        config = self.config
        critics = [self._critic(shape, config.quantiles) for _ in range(config.critics)]
        loss = TQCLoss(
            actor_module(actor),
            critics,
            num_qvalue_nets=config.critics,
            top_quantiles_to_drop_per_net=config.dropped,
            alpha_init=config.alpha_init,
            target_entropy=target_entropy(config, shape),
        )
        return loss, critics[0]
