"""What soft actor-critic, its quantile form and its multi-agent form share: memory, updates, state.

Demonstrations fill a fixed share of every minibatch (Ball et al. 2023, Efficient online
reinforcement learning with offline data), and can also be copied at the start or along the way.
"""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase
from torch import Tensor
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.objectives import SACLoss, SoftUpdate

from rcare_marl.errors import ConfigError

from .network import (
    Actor,
    ActorArrays,
    ExploringPolicy,
    GroupShape,
    Normaliser,
    actor_module,
    group_shapes,
)
from .shortcut import shorten

CHUNK = 8  # minibatches drawn by one call: one indexing for many is quicker; our own choice


@dataclass(frozen=True)
class BehaviourCloning:
    """Copying of the demonstrations, besides learning from their rewards.

    Attributes:
        updates: Updates of the actor alone, when the demonstrations come.
        weight: Of the squared distance to the demonstrated actions in the actor's loss.
        decay: Updates after which that weight has fallen to nothing; it falls on a straight line.
    """

    updates: int = 0
    weight: float = 0.0
    decay: int = 10_000

    def __post_init__(self) -> None:
        if self.updates < 0 or self.weight < 0 or self.decay < 1:
            raise ConfigError(
                "behaviour_cloning: updates and weight must be at least 0 and decay at least 1, "
                f"got {self.updates}, {self.weight}, {self.decay}"
            )

    def weight_at(self, update: int) -> float:
        """Return the weight at an update."""
        return self.weight * max(0.0, 1 - update / self.decay)


@dataclass(frozen=True)
class OffPolicyConfig:
    """Settings of every off-policy algorithm here. Defaults are our own choice where none is named.

    Attributes:
        rollout: Steps of each environment between two rounds of updates.
        hidden: Sizes of the hidden layers of actor and critics.
        layer_norm: LayerNorm in the critics (Ball et al. 2023).
        batch_size: Transitions of a minibatch.
        update_to_data: Updates for each step of an environment.
        gamma: Discount.
        tau: Share of the critics that their targets take over at each update.
        actor_lr: Learning rate of the actor.
        critic_lr: Learning rate of the critics.
        alpha_lr: Learning rate of the entropy's weight.
        actor_delay: Updates before the actor follows the critics, which know nothing at first; for
            actors that can do something already.
        alpha_init: The entropy's weight to begin with.
        target_entropy: Of one agent's actions; None takes minus their number (Haarnoja et al.
            2018), for actions in -1..1, and as much narrower as their range is.
        buffer_size: Transitions kept.
        warm_up: Steps of random actions before learning; none where there are demonstrations.
        warm_up_scale: Share of the range of actions that these random actions fill.
        demonstration_fraction: Share of demonstrations in each minibatch, if there are any.
        behaviour_cloning: Copying of the demonstrations.
        reward_scale: Factor on every reward.
        initial_log_std: Log of the actor's standard deviation to begin with.
        last_layer_scale: Factor on the first weights of the actor's last layer; 0.01 suits a
            residual, which should begin near zero.
    """

    rollout: int = 4
    hidden: tuple[int, ...] = (256, 256)
    layer_norm: bool = True
    batch_size: int = 256
    update_to_data: float = 0.5
    gamma: float = 0.97
    tau: float = 0.005
    actor_lr: float = 3e-4
    critic_lr: float = 3e-4
    alpha_lr: float = 3e-4
    actor_delay: int = 0
    alpha_init: float = 0.2
    target_entropy: float | None = None
    buffer_size: int = 200_000
    warm_up: int = 2_000
    warm_up_scale: float = 1.0
    demonstration_fraction: float = 0.5
    behaviour_cloning: BehaviourCloning = field(default_factory=BehaviourCloning)
    reward_scale: float = 1.0
    initial_log_std: float = 0.0
    last_layer_scale: float = 1.0

    def __post_init__(self) -> None:
        positive = ("rollout", "batch_size", "update_to_data", "tau", "actor_lr", "critic_lr")
        for name in (*positive, "alpha_init", "buffer_size", "reward_scale", "last_layer_scale"):
            if getattr(self, name) <= 0:
                raise ConfigError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("gamma", "tau", "warm_up_scale", "demonstration_fraction"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(f"{name} must be between 0 and 1, got {getattr(self, name)}")
        if min(self.alpha_lr, self.warm_up, self.actor_delay) < 0:
            raise ConfigError(
                "alpha_lr, warm_up and actor_delay must not be negative, got "
                f"{self.alpha_lr}, {self.warm_up}, {self.actor_delay}"
            )
        if not self.hidden or min(self.hidden) < 1:
            raise ConfigError(f"hidden needs sizes of at least 1, got {list(self.hidden)}")


_TORCHRL = logging.getLogger("torchrl")


class Memory:
    """The latest transitions, drawn from uniformly with torch's global generator.

    Args:
        capacity: How many are kept.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._buffer = ReplayBuffer(storage=LazyTensorStorage(capacity))

    def __len__(self) -> int:
        return len(self._buffer)

    def extend(self, transitions: TensorDictBase) -> None:
        """Add transitions [M]; the oldest give way."""
        level = _TORCHRL.level
        _TORCHRL.setLevel(logging.WARNING)  # it announces each storage on the terminal
        try:
            self._buffer.extend(transitions[-self.capacity :])
        finally:
            _TORCHRL.setLevel(level)

    def sample(self, count: int) -> TensorDictBase:
        """Return `count` transitions, with replacement."""
        return self._buffer.sample(count)

    def all(self) -> TensorDictBase:
        """Return all transitions, as they lie."""
        return self._buffer[:]

    def state_dict(self) -> dict[str, Any]:
        """Return a copy of what is kept, and where the next one goes."""
        kept = self.all().clone().to_dict() if len(self) else {}
        return {"transitions": kept, "count": len(self), "writer": self._buffer.writer.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take back what `state_dict` gave."""
        self._buffer.empty()
        if state["count"]:
            self.extend(TensorDict.from_dict(state["transitions"], batch_size=[state["count"]]))
        self._buffer.writer.load_state_dict(state["writer"])


class Learner:
    """One group's actor, critics and optimiser.

    Args:
        actor: The network that acts.
        loss: TorchRL's loss over the actor and the critics.
        config: Settings.
        prefix: What the keys of the group stand under in a minibatch; nothing for flat keys.
    """

    def __init__(
        self, actor: Actor, loss: SACLoss, config: OffPolicyConfig, prefix: tuple[str, ...]
    ) -> None:
        self.actor, self.loss, self.config, self.prefix = actor, loss, config, prefix
        loss.make_value_estimator(gamma=config.gamma)
        self._critics = critics = _parameters(loss.qvalue_network_params)
        SoftUpdate(loss, tau=config.tau)  # else the loss warns that nobody moves its targets
        self._targets = _parameters(loss.target_qvalue_network_params)
        self.optimiser = torch.optim.Adam(
            [
                {"params": list(actor.parameters()), "lr": config.actor_lr},
                {"params": critics, "lr": config.critic_lr},
                {"params": [loss.log_alpha], "lr": config.alpha_lr},
            ],
            fused=True,
        )
        self.updates = 0

    def fit(self, observations: Tensor, seen: Tensor) -> None:
        """Take the figures that normalise the actor's and the critics' inputs; once."""
        self.actor.normaliser.fit(observations)
        normaliser = Normaliser(seen.shape[-1])
        normaliser.fit(seen)
        for critics in (self.loss.qvalue_network_params, self.loss.target_qvalue_network_params):
            if not critics["module", "normaliser", "fitted"].all():
                for name, value in normaliser.named_buffers():
                    critics["module", "normaliser", name].copy_(value)

    def update(self, batch: TensorDictBase, demonstrated: int) -> dict[str, Tensor]:
        """Do one update and return its losses.

        Args:
            batch: Minibatch.
            demonstrated: How many of its last transitions are demonstrations.
        """
        found = self.loss(batch)
        total = found["loss_qvalue"]
        if self.updates >= self.config.actor_delay:
            total = total + found["loss_actor"] + found["loss_alpha"]
        weight = self.config.behaviour_cloning.weight_at(self.updates) if demonstrated else 0.0
        if weight > 0:
            total = total + weight * self.distance(batch[-demonstrated:])
        total.backward()
        self.optimiser.step()
        self.optimiser.zero_grad(set_to_none=True)
        with torch.no_grad():  # as SoftUpdate.step, which takes 0.6 ms to find them
            torch._foreach_lerp_(self._targets, self._critics, self.config.tau)
        self.updates += 1
        names = ("loss_actor", "loss_qvalue", "loss_alpha", "alpha", "entropy")
        out = {name: found[name].detach() for name in names}
        return out | {"q": -out["alpha"] * out["entropy"] - out["loss_actor"]}

    def copy(self, batch: TensorDictBase) -> Tensor:
        """Do one update of the actor towards demonstrated actions and return the distance."""
        distance = self.distance(batch)
        distance.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()  # only the actor has gradients
        self.optimiser.zero_grad(set_to_none=True)
        return distance.detach()

    def distance(self, batch: TensorDictBase) -> Tensor:
        """Return the mean squared distance of the actor's actions to those that a batch means."""
        seen, meant = (batch.get((*self.prefix, key)) for key in ("observation", "meant"))
        location, _ = self.actor(seen)
        return (self.actor.squash(location) - meant).square().mean()

    def state_dict(self) -> dict[str, Any]:
        """Return all that changes."""
        parts: dict[str, Any] = {"actor": self.actor, "loss": self.loss}
        parts["optimiser"] = self.optimiser
        states = {name: part.state_dict() for name, part in parts.items()}
        return deepcopy({**states, "updates": self.updates})

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take back what `state_dict` gave."""
        self.loss.load_state_dict(state["loss"])
        self.actor.load_state_dict(state["actor"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.updates = state["updates"]


class OffPolicy(ABC):
    """Learns from a memory of transitions, a group at a time.

    Args:
        config: Settings.
        env: The environment it will learn in; only its specs are read.
        seed: Of the first weights.

    Raises:
        ConfigError: If the environment does not suit.
    """

    def __init__(self, config: OffPolicyConfig, env: Any, *, seed: int = 0) -> None:
        self.config = config
        self.shapes = group_shapes(env)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.learners = {name: self._learner(shape) for name, shape in self.shapes.items()}
        self._memories: dict[str, Memory] = {}
        self._demonstrations: dict[str, Memory] = {}
        self._policy = ExploringPolicy(
            {name: learner.actor for name, learner in self.learners.items()},
            warming=config.warm_up > 0,
            warm_up_scale=config.warm_up_scale,
        )
        self._steps, self._owed = 0, 0.0

    def _learner(self, shape: GroupShape, prefix: tuple[str, ...] = ()) -> Learner:
        """Build the networks, the loss and the optimiser of a group, whose keys have a prefix."""
        actor = Actor.of(shape, self.config)
        critics = self._critics(shape)
        loss = self._loss(
            actor_network=actor_module(actor, *prefix),
            qvalue_network=critics,
            num_qvalue_nets=len(critics),
            alpha_init=self.config.alpha_init,
            target_entropy=target_entropy(self.config, shape),
        )
        shorten(loss, actor, critics[0])
        return Learner(actor, loss, self.config, prefix)

    @abstractmethod
    def _critics(self, shape: GroupShape) -> list[TensorDictModule]:
        """Return the critics of a group, with their keys."""

    def _loss(self, **parts: Any) -> SACLoss:
        """Return TorchRL's loss over the networks; `parts` are arguments of it."""
        return SACLoss(**parts, loss_function="l2")

    def _after(self, batch: TensorDictBase, group: str) -> dict[str, Tensor]:
        """Return what a step led a group to, with its rewards as they are learned from."""
        after = batch["next", group]
        found = {key: after[key] for key in ("observation", "reward", "terminated", "done")}
        return {**found, "reward": found["reward"] * self.config.reward_scale}

    @abstractmethod
    def _transitions(self, batch: TensorDictBase) -> dict[str, TensorDict]:
        """Return what the losses need of a batch [M], by the memory it goes to."""

    @abstractmethod
    def _memory_of(self, group: str) -> str:
        """Return the name of the memory that a group learns from."""

    @abstractmethod
    def _inputs(self, group: str, transitions: TensorDictBase) -> tuple[Tensor, Tensor]:
        """Return what a group's actor and what its critics see."""

    def _prepared(self, group: str, batch: TensorDictBase) -> TensorDictBase:
        """Return a minibatch with what a group's loss needs besides the memory."""
        return batch

    @property
    def updates(self) -> int:
        """How many updates were done, of all groups together."""
        return sum(learner.updates for learner in self.learners.values())

    def policy(self) -> TensorDictModuleBase:
        """Return the module that writes (group, "action")."""
        return self._policy

    def actor_arrays(self) -> dict[str, ActorArrays]:
        """Return each group's actor as arrays."""
        return {name: learner.actor.arrays() for name, learner in self.learners.items()}

    def add_demonstrations(self, demonstrations: TensorDictBase) -> dict[str, float]:
        """Take transitions [M] of the layout of batches; copy them first, if so configured."""
        for name, new in self._transitions(demonstrations).items():
            old = self._demonstrations.get(name)
            new = torch.cat([old.all(), new]) if old is not None else new
            self._demonstrations[name] = Memory(len(new))
            self._demonstrations[name].extend(new)
        self._policy.warming.fill_(False)
        if self.config.behaviour_cloning.updates == 0:
            return {}
        self._fit()
        return self._copy(self.config.behaviour_cloning.updates)

    def learn(self, batch: TensorDictBase) -> dict[str, float]:
        """Remember a batch [environments, steps], do the updates that are due, return their means.

        In the warm-up none are due, and only "updates" is returned.
        """
        rows = batch.reshape(-1)
        for name, new in self._transitions(rows).items():
            self._memories.setdefault(name, Memory(self.config.buffer_size)).extend(new)
        self._steps += len(rows)
        if not self._demonstrations and self._steps < self.config.warm_up:
            return {"updates": 0.0}
        self._fit()
        self._policy.warming.fill_(False)
        self._owed += self.config.update_to_data * len(rows)
        due = int(self._owed)
        self._owed -= due
        figures = {"updates": float(due)}
        for group in self.learners:
            mark = "" if len(self.learners) == 1 else f"_{group}"
            means = self._update(group, due)
            figures |= {f"{name}{mark}": value for name, value in means.items()}
        return figures

    def _update(self, group: str, due: int) -> dict[str, float]:
        sums: dict[str, Tensor] = {}
        learner, place = self.learners[group], self._memory_of(group)
        demonstrated = 0
        if place in self._demonstrations:
            demonstrated = round(self.config.demonstration_fraction * self.config.batch_size)
        for start in range(0, due, CHUNK):
            for batch in self._minibatches(place, min(CHUNK, due - start), demonstrated):
                for name, value in learner.update(
                    self._prepared(group, batch), demonstrated
                ).items():
                    sums[name] = sums[name] + value if name in sums else value
        return {name: float(value) / due for name, value in sums.items()}

    def _minibatches(self, place: str, count: int, demonstrated: int) -> tuple[TensorDictBase, ...]:
        """Draw `count` minibatches; in each the demonstrations come last."""
        size = self.config.batch_size
        parts = []
        if demonstrated < size:
            parts.append(self._memories[place].sample(count * (size - demonstrated)))
        if demonstrated:
            parts.append(self._demonstrations[place].sample(count * demonstrated))
        parts = [part.reshape(count, -1) for part in parts]
        both: TensorDictBase = torch.cat(parts, dim=1) if len(parts) > 1 else parts[0]
        return both.unbind(0)

    def _copy(self, updates: int) -> dict[str, float]:
        figures = {}
        for group, learner in self.learners.items():
            memory = self._demonstrations[self._memory_of(group)]
            distances = [
                learner.copy(memory.sample(self.config.batch_size)) for _ in range(updates)
            ]
            figures[f"copied_{group}"] = float(distances[-1])
        return figures

    def _fit(self) -> None:
        for group, learner in self.learners.items():
            if learner.actor.normaliser.fitted:
                continue
            place = self._memory_of(group)
            known = [
                kept[place] for kept in (self._memories, self._demonstrations) if place in kept
            ]
            parts = [self._inputs(group, memory.all()) for memory in known]
            observations, seen = (torch.cat(each) for each in zip(*parts, strict=True))
            learner.fit(observations, seen)

    def state_dict(self) -> dict[str, Any]:
        """Return everything that changes; torch's global generator is not in it."""
        return {
            "learners": {name: learner.state_dict() for name, learner in self.learners.items()},
            "memories": _states(self._memories),
            "demonstrations": _states(self._demonstrations),
            "warming": bool(self._policy.warming),
            "steps": self._steps,
            "owed": self._owed,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take back what `state_dict` gave."""
        for name, learner in self.learners.items():
            learner.load_state_dict(state["learners"][name])
        self._memories = _restored(state["memories"], self.config.buffer_size)
        self._demonstrations = _restored(state["demonstrations"], None)
        self._policy.warming.fill_(state["warming"])
        self._steps, self._owed = state["steps"], state["owed"]


def target_entropy(config: OffPolicyConfig, shape: GroupShape) -> float:
    """Return the entropy to keep, of one agent's actions; see `OffPolicyConfig`."""
    if config.target_entropy is not None:
        return config.target_entropy
    return shape.action * (math.log((1 - shape.low) / 2) - 1)


def _parameters(tree: TensorDictBase) -> list[Tensor]:
    leaves = tree["module", "layers"].items(include_nested=True, leaves_only=True)
    return [value for _, value in sorted(leaves, key=lambda item: item[0])]


def _states(memories: Mapping[str, Memory]) -> dict[str, Any]:
    return {name: memory.state_dict() for name, memory in memories.items()}


def _restored(states: Mapping[str, Any], capacity: int | None) -> dict[str, Memory]:
    memories = {}
    for name, state in states.items():
        memories[name] = Memory(state["count"] if capacity is None else capacity)
        memories[name].load_state_dict(state)
    return memories
