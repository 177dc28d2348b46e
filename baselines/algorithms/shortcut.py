"""Shorter ways through TorchRL's soft actor-critic losses: the same numbers in less time.

The critics are asked by batched products and not by vmap, and the squashed normal distribution
comes without its bookkeeping. On one core that saves about a third of an update of 2x256 networks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import nullcontext

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torch.nn import functional
from torchrl.objectives import SACLoss

from .network import CLIP, Actor, Critic


def shorten(loss: SACLoss, actor: Actor, critic: TensorDictModule) -> None:
    """Make a loss take the shorter ways.

    Args:
        loss: SACLoss or TQCLoss of `actor`, whose critics are all like `critic`.
        actor: The network that the loss trains.
        critic: A `Critic` with its keys.
    """
    # TorchRL 0.14 has its two ways here; a later one that has not must be noticed.
    if not hasattr(loss, "_vmap_qnetworkN0"):
        raise AttributeError("this version of TorchRL asks its critics in another way")
    loss._vmap_qnetworkN0 = _Critics(critic)
    key = loss.actor_network.in_keys[0]

    def distribution(batch: TensorDictBase) -> SquashedNormal:
        location, scale = actor(batch[key])
        return SquashedNormal(location, scale, actor.shape.low)

    loss.actor_network.get_dist = distribution
    # `actor` has its weights where the loss's own copy would be lent them at each question.
    loss.actor_network_params.__dict__["to_module"] = lambda *_, **__: nullcontext()


class SquashedNormal:
    """A normal distribution squashed by tanh into low..1: what a loss needs of TorchRL's TanhNormal.

    Args:
        location: Before the squashing, shape [..., action].
        scale: Standard deviation before the squashing, shape [..., action].
        low: Lower bound.
    """

    def __init__(self, location: Tensor, scale: Tensor, low: float) -> None:
        self.location, self.scale, self.low = location, scale, low

    def rsample_and_log_prob(self, sample_shape: Sequence[int] = ()) -> tuple[Tensor, Tensor]:
        """Return actions [..., action] and their log-probabilities [...], with gradients."""
        noise = torch.randn(*sample_shape, *self.location.shape)
        value = self.location + self.scale * noise
        half = (1 - self.low) / 2
        # log(1 - tanh(x)^2) = 2 (log 2 - x - softplus(-2 x)), which does not underflow
        bent = 2 * (math.log(2) - value - functional.softplus(-2 * value))
        each = -0.5 * noise.square() - self.scale.log() - bent
        constant = value.shape[-1] * (0.5 * math.log(2 * math.pi) + math.log(half))
        return self.low + half * (torch.tanh(value) + 1), each.sum(-1) - constant


class _Critics:
    """All critics of a loss at once.

    Args:
        critic: A `Critic` with its keys.
    """

    def __init__(self, critic: TensorDictModule) -> None:
        network = critic.module
        assert isinstance(network, Critic)
        self._per_agent = network.per_agent
        self._seen, *self._actions = critic.in_keys
        (self._out,) = critic.out_keys
        self._layers = [
            (str(index), isinstance(layer, nn.Linear))
            for index, layer in enumerate(network.layers)
            if not isinstance(layer, nn.ReLU)
        ]

    def __call__(self, batch: TensorDictBase, parameters: TensorDictBase) -> TensorDictBase:
        """Return the values [critics, B, ...] of a batch [B], by stacked parameters."""
        found = parameters["module"]
        seen, norm = batch[self._seen], found["normaliser"]
        normed = ((seen - norm["mean"][0]) / norm["scale"][0]).clamp(-CLIP, CLIP)
        flat = (batch[key].flatten(seen.ndim - 1) for key in self._actions)
        value = self._through(torch.cat([normed, *flat], dim=-1), found["layers"])
        if self._per_agent:
            value = value.unsqueeze(-1)
        return TensorDict({self._out: value}, batch_size=value.shape[: 1 + batch.ndim])

    def _through(self, value: Tensor, parameters: TensorDictBase) -> Tensor:
        """Return [critics, B, out] of [B, in]."""
        for index, (name, linear) in enumerate(self._layers):
            layer = parameters[name]
            weight, bias = layer["weight"], layer["bias"]
            if not linear:
                value = functional.layer_norm(value, value.shape[-1:])
                value = torch.addcmul(bias.unsqueeze(1), value, weight.unsqueeze(1))
            elif index:
                value = torch.baddbmm(bias.unsqueeze(1), value.relu(), weight.transpose(1, 2))
            else:  # all see the same: one product for the first layers of all
                value = functional.linear(value, weight.flatten(0, 1), bias.flatten())
                value = value.view(-1, *weight.shape[:2]).transpose(0, 1)
        return value
