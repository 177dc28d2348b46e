"""Soft actor-critic (Haarnoja et al. 2018), for one learner or several that do not share critics."""

from __future__ import annotations

from dataclasses import dataclass

from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.objectives import SACLoss

from .network import Actor, Critic, GroupShape, actor_module, meant
from .off_policy import Learner, OffPolicy, OffPolicyConfig, target_entropy
from .shortcut import shorten


@dataclass(frozen=True)
class SacConfig(OffPolicyConfig):
    """Settings of soft actor-critic, which are all in `OffPolicyConfig`."""


class Sac(OffPolicy):
    """Soft actor-critic with two critics on one agent's observation and action.

    Each agent's transition stands for itself, so agents of a group are more data for one network.
    """

    def _learner(self, shape: GroupShape) -> Learner:
        config = self.config
        actor = Actor.of(shape, config)
        loss, critic = self._loss(actor, shape)
        shorten(loss, actor, critic)
        return Learner(actor, loss, config, ())

    def _loss(self, actor: Actor, shape: GroupShape) -> tuple[SACLoss, TensorDictModule]:
        """Return the loss and one of its critics."""
        critics = [self._critic(shape, 1) for _ in range(2)]
        loss = SACLoss(
            actor_module(actor),
            critics,
            num_qvalue_nets=2,
            loss_function="l2",
            alpha_init=self.config.alpha_init,
            target_entropy=target_entropy(self.config, shape),
        )
        return loss, critics[0]

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
            after = batch["next", group]
            parts: dict[str, Tensor | dict[str, Tensor]] = {
                "observation": batch[group, "observation"].flatten(0, 1),
                "action": batch[group, "action"].flatten(0, 1),
                "meant": meant(batch, group).flatten(0, 1),
                "next": {
                    "observation": after["observation"].flatten(0, 1),
                    "reward": after["reward"].flatten(0, 1) * self.config.reward_scale,
                    "terminated": after["terminated"].flatten(0, 1),
                    "done": after["done"].flatten(0, 1),
                },
            }
            found[group] = TensorDict(parts, batch_size=[batch.shape[0] * shape.agents])
        return found

    def _memory_of(self, group: str) -> str:
        return group

    def _inputs(self, group: str, transitions: TensorDictBase) -> tuple[Tensor, Tensor]:
        return transitions["observation"], transitions["observation"]
