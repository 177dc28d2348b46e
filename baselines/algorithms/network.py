"""Networks of the learners: actor, critic, what they know of a group, what a policy file keeps.

Every actor is a multilayer perceptron on its agent's own observation. Agents of a group share it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import torch
from tensordict import TensorDictBase
from tensordict.nn import ProbabilisticTensorDictSequential, TensorDictModule, TensorDictModuleBase
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, exploration_type
from torchrl.modules import MLP, ProbabilisticActor, TanhNormal

from rcare_marl.errors import ConfigError

if TYPE_CHECKING:
    from .off_policy import OffPolicyConfig
    from .on_policy import OnPolicyConfig

Array = npt.NDArray[np.float32]
CLIP = 10.0  # bound of a normalised observation; our own choice, as common elsewhere
LOG_STD = (
    -5.0,
    2.0,
)  # bounds of the log of an actor's standard deviation; CleanRL's SAC, from memory
LEAST_SCALE = 1e-3  # an entry that spreads less than this in the first data is not rescaled


@dataclass(frozen=True)
class GroupShape:
    """Sizes of one group of agents.

    Attributes:
        name: Name of the group.
        agents: How many agents it has.
        observation: Entries of one agent's observation.
        action: Entries of one agent's action.
        low: Lower bound of each of them; the upper one is 1.
        state: Entries of the state that a central critic sees; 0 where there is none.
    """

    name: str
    agents: int
    observation: int
    action: int
    low: float
    state: int


def group_shapes(env: Any) -> dict[str, GroupShape]:
    """Return the sizes of every group of a TorchRL environment.

    Args:
        env: Has `group_map`, `full_action_spec` and `observation_spec` with the keys
            (group, "action"), (group, "observation") and "state", as `envs.learning.BatchedEnv`.

    Raises:
        ConfigError: If the actions of a group are not between one number and 1.
    """
    shapes: dict[str, GroupShape] = {}
    state = env.observation_spec["state"].shape[-1] if "state" in env.observation_spec.keys() else 0
    for name, roles in env.group_map.items():
        action = env.full_action_spec[name, "action"]
        lows, highs = action.space.low.unique(), action.space.high.unique()
        if lows.numel() > 1 or highs.numel() > 1 or highs.item() != 1.0 or lows.item() >= 1.0:
            raise ConfigError(
                f"actions of group {name!r} must all lie between one number and 1, "
                f"got {lows.tolist()} to {highs.tolist()}"
            )
        shapes[name] = GroupShape(
            name=name,
            agents=len(roles),
            observation=env.observation_spec[name, "observation"].shape[-1],
            action=action.shape[-1],
            low=float(lows.item()),
            state=state,
        )
    return shapes


class Normaliser(nn.Module):
    """Shifts and scales observations by figures taken once, then frozen.

    Args:
        size: Entries of an observation.
    """

    mean: Tensor
    scale: Tensor
    fitted: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("scale", torch.ones(size))
        self.register_buffer("fitted", torch.zeros((), dtype=torch.bool))

    def fit(self, observations: Tensor) -> None:
        """Take mean and standard deviation of observations, shape [..., size]; once."""
        if self.fitted:
            return
        rows = observations.reshape(-1, observations.shape[-1]).double()
        spread = rows.std(dim=0, correction=0)
        self.mean.copy_(rows.mean(dim=0))
        self.scale.copy_(torch.where(spread < LEAST_SCALE, 1.0, spread))
        self.fitted.fill_(True)

    def forward(self, observation: Tensor) -> Tensor:
        return ((observation - self.mean) / self.scale).clamp(-CLIP, CLIP)


class Actor(nn.Module):
    """Observation to location and scale of a normal distribution, squashed by tanh afterwards.

    Args:
        shape: Sizes of the group that acts with it.
        hidden: Sizes of the hidden layers.
        initial_log_std: Log of the standard deviation to begin with, before the squashing.
        last_layer_scale: Factor on the first weights of the last layer; small values make the
            first actions nearly the middle of the range.
    """

    def __init__(
        self,
        shape: GroupShape,
        hidden: Sequence[int],
        *,
        initial_log_std: float = 0.0,
        last_layer_scale: float = 1.0,
    ) -> None:
        super().__init__()
        self.shape = shape
        self.normaliser = Normaliser(shape.observation)
        self.layers = MLP(
            shape.observation, 2 * shape.action, num_cells=list(hidden), activation_class=nn.ReLU
        )
        low, high = LOG_STD
        if not low < initial_log_std < high:
            raise ConfigError(f"initial_log_std must be in {LOG_STD}, got {initial_log_std}")
        last = self.layers[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.weight *= last_layer_scale
            last.bias.zero_()
            last.bias[shape.action :] = math.atanh(
                (2 * initial_log_std - low - high) / (high - low)
            )

    @classmethod
    def of(cls, shape: GroupShape, config: OnPolicyConfig | OffPolicyConfig) -> Actor:
        """Return the actor that an algorithm's settings ask for."""
        return cls(
            shape,
            config.hidden,
            initial_log_std=config.initial_log_std,
            last_layer_scale=config.last_layer_scale,
        )

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Return location and scale, each [..., action], of observations [..., observation]."""
        location, raw = self.layers(self.normaliser(observation)).chunk(2, dim=-1)
        low, high = LOG_STD
        return location, (low + (high - low) / 2 * (torch.tanh(raw) + 1)).exp()

    def squash(self, value: Tensor) -> Tensor:
        """Bring values of the normal distribution into the bounds of actions."""
        return self.shape.low + (torch.tanh(value) + 1) / 2 * (1 - self.shape.low)

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """Return actions [..., action] of observations [..., observation].

        Args:
            observation: What the agents observe.
            explore: Draw from the distribution (with torch's global generator) and do not take
                its middle.
        """
        location, scale = self(observation)
        return self.squash(location + scale * torch.randn_like(scale) if explore else location)

    def arrays(self) -> ActorArrays:
        """Return what it takes to act without torch."""
        layers = [
            (_array(layer.weight), _array(layer.bias))
            for layer in self.layers
            if isinstance(layer, nn.Linear)
        ]
        weight, bias = layers[-1]
        layers[-1] = weight[: self.shape.action].copy(), bias[: self.shape.action].copy()
        return ActorArrays(
            layers=tuple(layers),
            mean=_array(self.normaliser.mean),
            scale=_array(self.normaliser.scale),
            low=self.shape.low,
        )


def meant(batch: TensorDictBase, group: str) -> Tensor:
    """Return the actions of a group that a batch means: a demonstration's without its noise.

    Args:
        batch: Transitions; (group, "meant") holds those actions, where they differ from (group, "action").
        group: Whose.
    """
    found = batch.get((group, "meant"), None)
    return batch[group, "action"] if found is None else found


def actor_module(
    actor: Actor, *prefix: str, log_prob: bool = False
) -> ProbabilisticTensorDictSequential:
    """Return an actor as TorchRL's losses want it.

    Args:
        actor: The network.
        prefix: What its keys stand under; nothing for flat keys.
        log_prob: Also write the log-probability of the action, as "action_log_prob".
    """
    parameters = TensorDictModule(
        actor, in_keys=[(*prefix, "observation")], out_keys=[(*prefix, "loc"), (*prefix, "scale")]
    )
    return ProbabilisticActor(
        parameters,
        in_keys={"loc": (*prefix, "loc"), "scale": (*prefix, "scale")},
        out_keys=[(*prefix, "action")],
        distribution_class=TanhNormal,
        distribution_kwargs={"low": actor.shape.low, "high": 1.0, "event_dims": 1},
        return_log_prob=log_prob,
        log_prob_key=(*prefix, "action_log_prob"),
    )


class Critic(nn.Module):
    """Values of what agents see and do; the inputs are joined.

    Args:
        seen: Entries of the observation or state.
        done: Entries of the actions, all together; 0 for a value of the state alone.
        hidden: Sizes of the hidden layers.
        outputs: How many numbers to predict.
        layer_norm: Normalise before each ReLU, which keeps critics from extrapolating wildly
            (Ball et al. 2023, Efficient online reinforcement learning with offline data).
        per_agent: The outputs are one value of each agent of a group, so [..., outputs, 1].
    """

    def __init__(
        self,
        seen: int,
        done: int,
        hidden: Sequence[int],
        *,
        outputs: int = 1,
        layer_norm: bool = True,
        per_agent: bool = False,
    ) -> None:
        super().__init__()
        self.normaliser = Normaliser(seen)
        self.layers = MLP(
            seen + done,
            outputs,
            num_cells=list(hidden),
            activation_class=nn.ReLU,
            norm_class=nn.LayerNorm if layer_norm else None,
            norm_kwargs=[{"normalized_shape": size} for size in hidden],
        )
        self.per_agent = per_agent

    def forward(self, seen: Tensor, *actions: Tensor) -> Tensor:
        """Return [..., outputs] of seen [..., seen] and actions [..., agents, action] or [..., action]."""
        flat = (action.flatten(seen.ndim - 1) for action in actions)
        values: Tensor = self.layers(torch.cat([self.normaliser(seen), *flat], dim=-1))
        return values.unsqueeze(-1) if self.per_agent else values


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


@dataclass(frozen=True)
class ActorArrays:
    """An actor as plain arrays, for a policy file.

    Attributes:
        layers: Weights [out, in] and biases [out], float32; ReLU between them. The last layer
            gives the location only.
        mean: Of the observations [observation].
        scale: Of the observations [observation].
        low: Lower bound of the actions.
    """

    layers: tuple[tuple[Array, Array], ...]
    mean: Array
    scale: Array
    low: float

    def act(self, observation: npt.ArrayLike) -> Array:
        """Return the deterministic action [..., action] of observations [..., observation]."""
        value = np.asarray(observation, dtype=np.float32)
        value = np.clip((value - self.mean) / self.scale, -CLIP, CLIP)
        for weight, bias in self.layers[:-1]:
            value = np.maximum(value @ weight.T + bias, 0)
        weight, bias = self.layers[-1]
        action = self.low + (np.tanh(value @ weight.T + bias) + 1) / 2 * (1 - self.low)
        return action.astype(np.float32)


def _array(tensor: Tensor) -> Array:
    return tensor.detach().cpu().numpy().astype(np.float32, copy=True)
