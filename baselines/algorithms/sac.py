"""Soft actor-critic (Haarnoja et al. 2018), for one learner or several that do not share critics.

And its forms with truncated quantile critics (Kuznetsov et al. 2020) and for several agents: with
centralised critics after Lowe et al. 2017 (MADDPG) and the losses of soft actor-critic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.objectives import SACLoss, TQCLoss

from rcare_marl.errors import ConfigError

from .network import Critic, GroupShape, group_shapes, meant
from .off_policy import Learner, OffPolicy, OffPolicyConfig

JOINT = "joint"  # name of the one memory


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


class Masac(OffPolicy):
    """Soft actor-critic with a loss and an optimiser for each group.

    Critics need everybody's transition, so there is one memory of joint transitions; each group
    draws its own minibatches from it. In the target the other groups act as they would now, in
    the actor's loss as they did then.

    Raises:
        ConfigError: If the environment has no "state".
    """

    def __init__(self, config: OffPolicyConfig, env: Any, *, seed: int = 0) -> None:
        shapes = group_shapes(env)
        if any(shape.state == 0 for shape in shapes.values()):
            raise ConfigError("masac needs an environment with a 'state' for its central critics")
        self._acting = sum(shape.agents * shape.action for shape in shapes.values())
        self._groups = tuple(shapes)
        super().__init__(config, env, seed=seed)

    def _learner(self, shape: GroupShape, prefix: tuple[str, ...] = ()) -> Learner:
        group = shape.name
        learner = super()._learner(shape, (group,))
        names = ("action", "reward", "done", "terminated", "state_action_value")
        learner.loss.set_keys(
            **{name: (group, name) for name in names},
            value=(group, "state_value"),
            log_prob=(group, "action_log_prob"),
            priority=(group, "td_error"),
        )
        return learner

    def _critics(self, shape: GroupShape) -> list[TensorDictModule]:
        return [self._critic(shape) for _ in range(2)]

    def _critic(self, shape: GroupShape) -> TensorDictModule:
        network = Critic(
            shape.state,
            self._acting,
            self.config.hidden,
            outputs=shape.agents,
            layer_norm=self.config.layer_norm,
            per_agent=True,
        )
        return TensorDictModule(
            network,
            in_keys=["state", *((group, "action") for group in self._groups)],
            out_keys=[(shape.name, "state_action_value")],
        )

    def _transitions(self, batch: TensorDictBase) -> dict[str, TensorDict]:
        found = TensorDict(
            {"state": batch["state"], "next": {"state": batch["next", "state"]}}, [len(batch)]
        )
        for group in self._groups:
            for key in ("observation", "action"):
                found[group, key] = batch[group, key]
            found[group, "meant"] = meant(batch, group)
            for key, value in self._after(batch, group).items():
                found["next", group, key] = value
        return {JOINT: found}

    def _memory_of(self, group: str) -> str:
        return JOINT

    def _inputs(self, group: str, transitions: TensorDictBase) -> tuple[Tensor, Tensor]:
        return transitions[group, "observation"], transitions["state"]

    @torch.no_grad()
    def _prepared(self, group: str, batch: TensorDictBase) -> TensorDictBase:
        for other in self._groups:
            if other != group:
                actor = self.learners[other].actor
                after = batch["next", other, "observation"]
                batch["next", other, "action"] = actor.act(after, explore=True)
        return batch
