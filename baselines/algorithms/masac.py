"""Multi-agent soft actor-critic: each group's critics see the whole state and everybody's actions.

Centralised critics after Lowe et al. 2017 (MADDPG), with the losses of soft actor-critic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.objectives import SACLoss

from rcare_marl.errors import ConfigError

from .network import Actor, Critic, GroupShape, actor_module, group_shapes, meant
from .off_policy import Learner, OffPolicy, OffPolicyConfig, target_entropy
from .shortcut import shorten

JOINT = "joint"  # name of the one memory


@dataclass(frozen=True)
class MasacConfig(OffPolicyConfig):
    """Settings of multi-agent soft actor-critic, which are all in `OffPolicyConfig`."""


class Masac(OffPolicy):
    """Soft actor-critic with a loss and an optimiser for each group.

    Critics need everybody's transition, so there is one memory of joint transitions; each group
    draws its own minibatches from it. In the target the other groups act as they would now, in
    the actor's loss as they did then.

    Raises:
        ConfigError: If the environment has no "state".
    """

    def __init__(self, config: MasacConfig, env: Any, *, seed: int = 0) -> None:
        shapes = group_shapes(env)
        if any(shape.state == 0 for shape in shapes.values()):
            raise ConfigError("masac needs an environment with a 'state' for its central critics")
        self._acting = sum(shape.agents * shape.action for shape in shapes.values())
        self._groups = tuple(shapes)
        super().__init__(config, env, seed=seed)

    def _learner(self, shape: GroupShape) -> Learner:
        config, group = self.config, shape.name
        actor = Actor.of(shape, config)
        critics = [self._critic(shape) for _ in range(2)]
        loss = SACLoss(
            actor_module(actor, group),
            critics,
            num_qvalue_nets=2,
            loss_function="l2",
            alpha_init=config.alpha_init,
            target_entropy=target_entropy(config, shape),
        )
        loss.set_keys(
            action=(group, "action"),
            reward=(group, "reward"),
            done=(group, "done"),
            terminated=(group, "terminated"),
            state_action_value=(group, "state_action_value"),
            value=(group, "state_value"),
            log_prob=(group, "action_log_prob"),
            priority=(group, "td_error"),
        )
        shorten(loss, actor, critics[0])
        return Learner(actor, loss, config, (group,))

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
            for key in ("observation", "reward", "terminated", "done"):
                found["next", group, key] = batch["next", group, key]
            found["next", group, "reward"] = (
                found["next", group, "reward"] * self.config.reward_scale
            )
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
