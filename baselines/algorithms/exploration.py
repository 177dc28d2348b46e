"""The policy that collects: every group's actor, and chance before anything was learned."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, exploration_type

from .network import Actor


class ExploringPolicy(TensorDictModuleBase):  # type: ignore[misc]  # untyped in tensordict
    """Writes (group, "action"), drawn where TorchRL's exploration type is RANDOM.

    It does what TorchRL's ProbabilisticActor does, without the distribution's bookkeeping, which
    costs more than the network for a few environments.

    Args:
        actors: The actor of each group.
        warming: Draw uniformly, and do not ask the actors, where it explores.
        warm_up_scale: Share of the range of actions, about its middle, that is drawn from then.
    """

    warming: Tensor

    def __init__(
        self, actors: Mapping[str, Actor], *, warming: bool, warm_up_scale: float = 1.0
    ) -> None:
        super().__init__()
        self.in_keys = [(group, "observation") for group in actors]
        self.out_keys = [(group, "action") for group in actors]
        self.actors = nn.ModuleDict(actors)
        self._scale = warm_up_scale
        self.register_buffer("warming", torch.tensor(warming))

    @torch.no_grad()
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        explore = exploration_type() in (ExplorationType.RANDOM, None)
        warming = explore and bool(self.warming)
        for group, actor in self.actors.items():
            assert isinstance(actor, Actor)
            observation = tensordict[group, "observation"]
            if warming:
                low = actor.shape.low
                drawn = torch.rand(*observation.shape[:-1], actor.shape.action) - 0.5
                action = (1 + low) / 2 + (1 - low) * self._scale * drawn
            else:
                action = actor.act(observation, explore=explore)
            tensordict[group, "action"] = action
        return tensordict
