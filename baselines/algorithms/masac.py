"""Multi-agent soft actor-critic: each group's critics see the whole state and everybody's actions.

Centralised critics after Lowe et al. 2017 (MADDPG), with the losses of soft actor-critic.
"""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor

from rcare_marl.errors import ConfigError

from .network import Critic, GroupShape, group_shapes, meant
from .off_policy import Learner, OffPolicy, OffPolicyConfig

JOINT = "joint"  # name of the one memory


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
