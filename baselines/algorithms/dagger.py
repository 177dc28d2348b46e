"""Imitation of a script on one's own episodes (DAgger; Ross et al. 2011, A reduction of imitation learning).

The script says in each control step what it would do, wherever the network has got to. The script may read
the true state; the network reads what the robot observes, noise and delay and all (Chen et al. 2020, Learning
by cheating). What the script keeps in mind, such as which phase it is in, the network learns to write down
with each action, and reads in the next control step: so it has a memory without being unrolled in time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, exploration_type

from rcare_marl.envs.learning.learner_env import MEMORY
from rcare_marl.errors import ConfigError

from .network import Actor, ActorArrays, GroupShape, group_shapes
from .off_policy import Memory


@dataclass(frozen=True)
class DaggerConfig:
    """Settings of DAgger; the values are our own choice.

    Attributes:
        TAUGHT: That a script says what it would do.
        rollout: Steps of each environment between two rounds of updates.
        hidden: Sizes of the hidden layers.
        batch_size: Steps of a minibatch.
        update_to_data: Updates for each step of an environment.
        learning_rate: Of Adam.
        buffer_size: Steps kept.
        warm_up: Steps before the first update.
        handover: Steps within which the script gives up acting, on a straight line; its share is drawn
            anew for each step of each environment.
        noise: Standard deviation of what is added to its actions then, so that it also shows how to come
            back.
        memory_weight: Of what is to be kept in mind, against what is to be done.
        average: Share of the averaged weights, which are those that are kept, that each update leaves.

    Raises:
        ConfigError: If a value is impossible.
    """

    TAUGHT: ClassVar[bool] = True

    rollout: int = 16
    hidden: tuple[int, ...] = (256, 256)
    batch_size: int = 512
    update_to_data: float = 0.5
    learning_rate: float = 5e-4
    buffer_size: int = 400_000
    warm_up: int = 2_000
    handover: int = 20_000
    noise: float = 0.1
    memory_weight: float = 0.3
    average: float = 0.999

    def __post_init__(self) -> None:
        for name in ("rollout", "batch_size", "update_to_data", "learning_rate", "buffer_size"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("warm_up", "handover", "noise", "memory_weight"):
            if getattr(self, name) < 0:
                raise ConfigError(f"{name} must not be negative, got {getattr(self, name)}")
        if not 0 <= self.average < 1:
            raise ConfigError(f"average must lie in [0, 1), got {self.average}")
        if not self.hidden or min(self.hidden) < 1:
            raise ConfigError(f"hidden needs sizes of at least 1, got {list(self.hidden)}")


def _split(observation: Tensor, shape: GroupShape) -> tuple[Tensor, Tensor]:
    """Return what a network reads, and what the script would do, which is at the end."""
    taught = observation[..., -shape.action :].clamp(shape.low, 1.0)
    return observation[..., : -shape.action], taught


class _Pupil:
    """One group's actor, its average, and what it has seen."""

    def __init__(self, shape: GroupShape, memory: int, config: DaggerConfig) -> None:
        own = dataclasses.replace(shape, observation=shape.observation - shape.action)
        self.actor = Actor(own, config.hidden)
        self.average = deepcopy(self.actor)
        self.optimiser = torch.optim.Adam(self.actor.parameters(), lr=config.learning_rate)
        self.memory = Memory(config.buffer_size)
        self.config, self.updates = config, 0
        count = shape.action - memory
        shares = [1 / count] * count + [config.memory_weight / max(memory, 1)] * memory
        self._weights = torch.tensor(shares)

    def remember(self, observation: Tensor) -> None:
        """Keep what was observed, shape [..., observation]."""
        seen, taught = _split(observation, self.actor.shape)
        rows = {"seen": seen, "taught": taught}
        flat = {name: value.reshape(-1, value.shape[-1]) for name, value in rows.items()}
        self.memory.extend(TensorDict(flat, batch_size=[len(flat["seen"])]))

    def update(self) -> Tensor:
        """Do one update, and return the weighted mean squared distance to what the script would do."""
        batch = self.memory.sample(self.config.batch_size)
        location, _ = self.actor(batch["seen"])
        squares = (self.actor.squash(location) - batch["taught"]).square().mean(0)
        loss: Tensor = (squares * self._weights).sum()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()
        self.optimiser.zero_grad(set_to_none=True)
        self.updates += 1
        # While there are few updates the average is over these, not over the first weights.
        kept = min(self.config.average, self.updates / (self.updates + 10))
        with torch.no_grad():
            pairs = zip(self.average.parameters(), self.actor.parameters(), strict=True)
            for mean, latest in pairs:
                mean.lerp_(latest, 1 - kept)
        return loss.detach()

    def fit(self) -> None:
        """Take the figures that normalise, once."""
        for actor in (self.actor, self.average):
            actor.normaliser.fit(self.memory.all()["seen"])


class _Together(TensorDictModuleBase):  # type: ignore[misc]  # untyped in tensordict
    """Writes (group, "action"): the network's, or, where it explores, sometimes the script's."""

    share: Tensor

    def __init__(self, pupils: Mapping[str, _Pupil], noise: float) -> None:
        super().__init__()
        self.in_keys = [(group, "observation") for group in pupils]
        self.out_keys = [(group, "action") for group in pupils]
        self.actors = nn.ModuleDict({group: pupil.actor for group, pupil in pupils.items()})
        self._noise = noise
        self.register_buffer("share", torch.ones(()))

    @torch.no_grad()
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        explores = exploration_type() in (ExplorationType.RANDOM, None)
        for group, actor in self.actors.items():
            assert isinstance(actor, Actor)
            seen, taught = _split(tensordict[group, "observation"], actor.shape)
            action = actor.act(seen, explore=False)
            if explores and self.share > 0:
                shown = taught + self._noise * torch.randn_like(taught)
                is_shown = torch.rand(*action.shape[:-1], 1) < self.share
                action = torch.where(is_shown, shown.clamp(actor.shape.low, 1.0), action)
            tensordict[group, "action"] = action
        return tensordict


class Dagger:
    """Learns to do what a script would do, see the module.

    Args:
        config: Settings.
        env: The environment it will learn in, taught by a script; only its specs and layout are read.
        seed: Of the first weights.
    """

    def __init__(self, config: DaggerConfig, env: Any, *, seed: int = 0) -> None:
        self.config = config
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self._pupils = {
                name: _Pupil(shape, dict(env.layout.observed[name]).get(MEMORY, 0), config)
                for name, shape in group_shapes(env).items()
            }
        self._policy = _Together(self._pupils, config.noise)
        self._steps, self._owed = 0, 0.0

    @property
    def updates(self) -> int:
        """How many updates were done, of all groups together."""
        return sum(pupil.updates for pupil in self._pupils.values())

    def policy(self) -> TensorDictModuleBase:
        """Return the module that writes (group, "action")."""
        return self._policy

    def actor_arrays(self) -> dict[str, ActorArrays]:
        """Return each group's averaged actor as arrays."""
        return {name: pupil.average.arrays() for name, pupil in self._pupils.items()}

    def add_demonstrations(self, demonstrations: TensorDictBase) -> dict[str, float]:
        """Refuse them: a training is shown what to do all along."""
        raise ConfigError("dagger takes no demonstrations: a script shows what to do all along")

    def learn(self, batch: TensorDictBase) -> dict[str, float]:
        """Remember a batch [environments, steps], do the updates that are due, return their means."""
        rows = batch.reshape(-1)
        for group, pupil in self._pupils.items():
            pupil.remember(rows[group, "observation"])
        self._steps += len(rows)
        self._policy.share.fill_(max(0.0, 1 - self._steps / max(self.config.handover, 1)))
        self._owed += self.config.update_to_data * len(rows)
        if self._steps < self.config.warm_up:
            return {"updates": 0.0}
        due = int(self._owed)
        self._owed -= due
        figures = {"updates": float(due), "share": float(self._policy.share)}
        for group, pupil in self._pupils.items():
            pupil.fit()
            losses = [pupil.update() for _ in range(due)]
            mark = "" if len(self._pupils) == 1 else f"_{group}"
            if losses:
                figures[f"distance{mark}"] = float(torch.stack(losses).mean())
        return figures

    def state_dict(self) -> dict[str, Any]:
        """Return everything that changes; torch's global generator is not in it."""
        pupils = {
            name: {
                "actor": pupil.actor.state_dict(),
                "average": pupil.average.state_dict(),
                "optimiser": pupil.optimiser.state_dict(),
                "memory": pupil.memory.state_dict(),
                "updates": pupil.updates,
            }
            for name, pupil in self._pupils.items()
        }
        own = {"steps": self._steps, "owed": self._owed, "share": float(self._policy.share)}
        return deepcopy({"pupils": pupils, **own})

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take back what `state_dict` gave."""
        for name, pupil in self._pupils.items():
            saved = state["pupils"][name]
            for part in ("actor", "average", "optimiser", "memory"):
                getattr(pupil, part).load_state_dict(saved[part])
            pupil.updates = saved["updates"]
        self._steps, self._owed = state["steps"], state["owed"]
        self._policy.share.fill_(state["share"])
