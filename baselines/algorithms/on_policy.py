"""PPO, IPPO and MAPPO: each group learns from whole batches of its own episodes, once.

TorchRL gives the clipped loss (Schulman et al. 2017, Proximal policy optimization algorithms) and the
advantages (Schulman et al. 2016, High-dimensional continuous control using generalized advantage
estimation). A step that ends by the time limit is bootstrapped, one that ends in success or failure is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase
from torch import Tensor, nn
from torchrl.objectives import ClipPPOLoss, IPPOLoss, MAPPOLoss
from torchrl.objectives.value import MultiAgentGAE

from rcare_marl.errors import ConfigError

from .network import (
    Actor,
    ActorArrays,
    Critic,
    ExploringPolicy,
    GroupShape,
    actor_module,
    group_shapes,
    meant,
)

LEAST_SPREAD = 1e-6  # returns that spread less are not rescaled
AGENTS = -2  # axis of the agents in values [..., agents, 1]
LOGGED = {  # name in TorchRL's loss -> ours
    "loss_objective": "loss_actor",
    "loss_critic": "loss_critic",
    "entropy": "entropy",
    "clip_fraction": "clip_fraction",
    "explained_variance": "explained_variance",
}


@dataclass(frozen=True)
class OnPolicyConfig:
    """Settings of PPO and its kin. Where no source stands, the values are our own choice.

    Attributes:
        hidden: Sizes of the hidden layers, of actor and critic.
        layer_norm: Whether the critic normalises before each ReLU.
        rollout: Steps of each environment between two updates.
        epochs: How often a batch is gone through.
        minibatch: Steps of one gradient step, about.
        gamma: Discount of one step.
        gae_lambda: Discount of further steps in the advantage; 0.95 in Schulman et al. 2017.
        clip: How far the probability ratio may leave 1; 0.2 in Schulman et al. 2017.
        target_kl: Kullback-Leibler divergence from the policy that collected [nat] at which the
            epochs end early; never if None.
        learning_rate: Of Adam.
        entropy: Weight of the bonus for randomness.
        value_loss: Distance of the values from their targets.
        value_weight: Its weight.
        max_grad_norm: Bound of the norm of the gradient, of actor and critic each.
        scale_rewards: Whether rewards are divided by the standard deviation of the discounted
            returns seen so far.
        initial_log_std: Log of the actor's standard deviation to begin with.
        last_layer_scale: Factor on the first weights of the actor's last layer; 0.01 as found best
            by Andrychowicz et al. 2021, What matters in on-policy reinforcement learning?
        cloning_updates: Gradient steps that imitate the demonstrations before anything else.

    Raises:
        ConfigError: If a value is impossible.
    """

    hidden: tuple[int, ...] = (256, 256)
    layer_norm: bool = False
    rollout: int = 256
    epochs: int = 8
    minibatch: int = 256
    gamma: float = 0.97
    gae_lambda: float = 0.95
    clip: float = 0.2
    target_kl: float | None = 0.03
    learning_rate: float = 3e-4
    entropy: float = 0.0
    value_loss: Literal["l2", "smooth_l1"] = "smooth_l1"
    value_weight: float = 1.0
    max_grad_norm: float = 0.5
    scale_rewards: bool = True
    initial_log_std: float = -0.5
    last_layer_scale: float = 0.01
    cloning_updates: int = 0

    def __post_init__(self) -> None:
        positive = ("rollout", "epochs", "minibatch", "clip", "learning_rate", "max_grad_norm")
        for name in positive:
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("gamma", "gae_lambda"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(f"{name} must lie in [0, 1], got {getattr(self, name)}")
        for name in ("entropy", "value_weight", "cloning_updates", "last_layer_scale"):
            if getattr(self, name) < 0:
                raise ConfigError(f"{name} must not be negative, got {getattr(self, name)}")
        if self.target_kl is not None and not self.target_kl > 0:
            raise ConfigError(f"target_kl must be positive or left out, got {self.target_kl}")
        if not self.hidden or min(self.hidden) < 1:
            raise ConfigError(f"hidden needs layers of at least 1 unit, got {list(self.hidden)}")


class ReturnSpread(nn.Module):
    """Standard deviation of discounted returns over all batches so far.

    Batches are joined as by Chan et al. (1979), Updating formulae and a pairwise algorithm for computing
    sample variances.
    """

    count: Tensor
    mean: Tensor
    squares: Tensor

    def __init__(self) -> None:
        super().__init__()
        for name in ("count", "mean", "squares"):
            self.register_buffer(name, torch.zeros((), dtype=torch.float64))

    def update(self, rewards: Tensor, done: Tensor, gamma: float) -> None:
        """Take the rewards and ends of a batch, each [environments, steps, agents, 1].

        What comes after the last step of the batch counts as nothing: it is a scale, no estimate.
        """
        returns = rewards.double()
        for step in range(rewards.shape[1] - 2, -1, -1):
            returns[:, step] += gamma * returns[:, step + 1] * ~done[:, step]
        count, mean = returns.numel(), returns.mean()
        both, apart = self.count + count, mean - self.mean
        self.squares += (returns - mean).square().sum() + apart**2 * self.count * count / both
        self.mean += apart * count / both
        self.count.copy_(both)

    def scale(self) -> float:
        """Return the standard deviation; 1 if all returns were the same."""
        spread = float((self.squares / self.count.clamp(min=1)).sqrt())
        return spread if spread > LEAST_SPREAD else 1.0


class GroupLearner(nn.Module):
    """Actor, critic and optimiser of one group, and its reward scale.

    Args:
        shape: Sizes of the group.
        config: Settings.
        loss_class: Which loss of TorchRL.
        central: Whether the critic sees the state and values every agent of the group from it, or
            sees each agent's own observation.
    """

    def __init__(
        self,
        shape: GroupShape,
        config: OnPolicyConfig,
        *,
        loss_class: type[ClipPPOLoss],
        central: bool,
    ) -> None:
        super().__init__()
        self._config = config
        self._seen = "state" if central else "observation"
        self.actor = Actor.of(shape, config)
        self.critic = Critic(
            shape.state if central else shape.observation,
            0,
            config.hidden,
            outputs=shape.agents if central else 1,
            layer_norm=config.layer_norm,
        )
        per_agent = nn.Unflatten(-1, (shape.agents, 1)) if central else nn.Identity()
        self.value = nn.Sequential(self.critic, per_agent)
        self.spread = ReturnSpread()
        self._loss = loss_class(
            actor_module(self.actor, log_prob=True),
            TensorDictModule(self.value, in_keys=[self._seen], out_keys=["state_value"]),
            clip_epsilon=config.clip,
            entropy_bonus=config.entropy > 0,
            entropy_coeff=config.entropy,
            critic_coeff=config.value_weight,
            loss_critic_type=config.value_loss,
            normalize_advantage=True,
            normalize_advantage_exclude_dims=(AGENTS,),
            functional=False,
        )
        self._advantage = MultiAgentGAE(
            gamma=config.gamma, lmbda=config.gae_lambda, value_network=None
        )
        self._parts = [list(net.parameters()) for net in (self.actor, self.critic)]
        self._optimiser = torch.optim.Adam(
            [p for part in self._parts for p in part], lr=config.learning_rate, fused=True
        )

    @property
    def fitted(self) -> bool:
        """Whether observations are normalised already."""
        return bool(self.actor.normaliser.fitted)

    def fit(self, data: TensorDictBase) -> None:
        """Take the scales of observations from data with "observation" and "state"."""
        self.actor.normaliser.fit(data["observation"])
        self.critic.normaliser.fit(data[self._seen])

    @torch.no_grad()
    def estimate(self, data: TensorDictBase) -> None:
        """Write "advantage", "value_target" and "action_log_prob" into a batch [environments, steps].

        Rewards are rescaled in place. The log-probability is computed here and not while acting: then
        the ratio of the first gradient step is exactly 1, also of actions at their bounds, where the
        inverse of tanh is clipped.
        """
        if self._config.scale_rewards:
            rewards, done = data["next", "reward"], data["next", "done"]
            self.spread.update(rewards, done, self._config.gamma)
            data["next", "reward"] = rewards / self.spread.scale()
        data["state_value"] = self.value(data[self._seen])
        data["next", "state_value"] = self.value(data["next", self._seen])
        self._advantage(data)
        distribution = self._loss.actor_network.get_dist(data)
        data["action_log_prob"] = distribution.log_prob(data["action"])

    def learn(self, data: TensorDictBase) -> tuple[dict[str, float], int]:
        """Return figures of the learning from a batch [environments, steps], and how many updates."""
        self.estimate(data)
        keys = ("action", "action_log_prob", "advantage", "value_target", "state_value")
        rows = data.select("observation", self._seen, *keys).reshape(-1)
        figures: list[TensorDictBase] = []
        for _ in range(self._config.epochs):
            if not self._epoch(rows, figures):
                break
        mean: Any = torch.stack(figures).mean()
        logged = {name: float(mean[key]) for key, name in LOGGED.items() if key in mean.keys()}
        with torch.no_grad():
            noise = float(self.actor(rows["observation"])[1].mean())
        kl = float(mean["kl"])
        return {**logged, "kl": kl, "action_std": noise}, len(figures)

    def _epoch(self, rows: TensorDictBase, figures: list[TensorDictBase]) -> bool:
        """Go through all rows once; return False if the policy has moved too far."""
        pieces = -(-rows.shape[0] // self._config.minibatch)
        for chosen in torch.randperm(rows.shape[0]).chunk(pieces):
            out = self._loss(rows[chosen])
            # Mean of r - 1 - log r, which is never negative: Schulman (2020), Approximating KL divergence
            out["kl"] = out["mean_ratio"] - 1 + out["kl_approx"]
            limit = self._config.target_kl
            if limit is not None and float(out["kl"]) > limit:
                return False
            losses = [value for key, value in out.items() if key.startswith("loss_")]
            self._step(torch.stack(losses).sum())
            figures.append(out.detach())
        return True

    def clone(self, rows: TensorDictBase) -> float:
        """Imitate demonstrated actions [M] and return the last mean squared error."""
        error = torch.zeros(())
        for _ in range(self._config.cloning_updates):
            chosen = rows[torch.randint(rows.shape[0], (self._config.minibatch,))]
            location, _ = self.actor(chosen["observation"])
            error = (self.actor.squash(location) - chosen["meant"]).square().mean()
            self._step(error)
        return float(error.detach())

    def _step(self, loss: Tensor) -> None:
        self._optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        for part in self._parts:
            nn.utils.clip_grad_norm_(part, self._config.max_grad_norm)
        self._optimiser.step()

    def to_state(self) -> dict[str, Any]:
        """Return everything that changes."""
        modules = {name: getattr(self, name) for name in ("actor", "critic", "spread")}
        state = {name: module.state_dict() for name, module in modules.items()}
        return deepcopy({**state, "optimiser": self._optimiser.state_dict()})

    def from_state(self, state: Mapping[str, Any]) -> None:
        """Take back what `to_state` gave."""
        for name in ("actor", "critic", "spread"):
            getattr(self, name).load_state_dict(state[name])
        self._optimiser.load_state_dict(state["optimiser"])


class OnPolicy:
    """Learns from each batch that its own policy collected, then forgets it.

    The first batch only gives the scales of observations, unless demonstrations gave them before: a
    policy whose observations are rescaled is no longer the one that acted.

    Attributes:
        rollout: Steps of each environment that a batch should have.
        updates: Gradient steps so far, of all groups together.
        learners: The learner of each group.
    """

    LOSS: ClassVar[type[ClipPPOLoss]] = ClipPPOLoss
    CENTRAL: ClassVar[bool] = False

    def __init__(self, config: OnPolicyConfig, env: Any, *, seed: int = 0) -> None:
        """Make the networks.

        Args:
            config: Settings.
            env: A TorchRL environment in groups, see `network.group_shapes`; only its specs are read.
            seed: Of the first weights.

        Raises:
            ConfigError: If the environment does not suit.
        """
        shapes = group_shapes(env)
        self._check(shapes)
        self._config, self.rollout, self.updates = config, config.rollout, 0
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.learners = {
                name: GroupLearner(shape, config, loss_class=self.LOSS, central=self.CENTRAL)
                for name, shape in shapes.items()
            }
        actors = {name: learner.actor for name, learner in self.learners.items()}
        self._policy = ExploringPolicy(actors, warming=False)

    def _check(self, shapes: Mapping[str, GroupShape]) -> None:
        """Raise a ConfigError if it cannot learn in such an environment."""
        if self.CENTRAL and any(shape.state == 0 for shape in shapes.values()):
            raise ConfigError(
                f"{type(self).__name__} needs the state of the environment, which has none"
            )

    def policy(self) -> TensorDictModuleBase:
        """Return the module that writes (group, "action")."""
        return self._policy

    def learn(self, batch: TensorDictBase) -> dict[str, float]:
        """Learn from a batch [environments, steps].

        Returns:
            "updates", and losses and other figures by name, after it the group if there are several.
            Of the batch that gives the scales, only "updates".
        """
        figures = {"updates": 0.0}
        for name, learner in self.learners.items():
            data = self.data_of(batch, name)
            if not learner.fitted:
                learner.fit(data)
                continue
            found, updates = learner.learn(data)
            self.updates += updates
            figures["updates"] += updates
            figures |= {f"{key}{self._mark(name)}": value for key, value in found.items()}
        return figures

    def add_demonstrations(self, demonstrations: TensorDictBase) -> dict[str, float]:
        """Imitate transitions [M], and take the scales of observations from them.

        Returns:
            The mean squared error of the actions of each group.

        Raises:
            ConfigError: If `cloning_updates` is 0, for nothing else can be learned from them.
        """
        if not self._config.cloning_updates:
            raise ConfigError(
                f"{type(self).__name__} learns from its own episodes only: leave demonstrations out "
                "(--set demonstrations.episodes=0), or imitate them first "
                "(--set algorithm.cloning_updates=2000)"
            )
        errors: dict[str, float] = {}
        for name, learner in self.learners.items():
            data = self.data_of(demonstrations, name)
            learner.fit(data)
            errors[f"loss_cloning{self._mark(name)}"] = learner.clone(data)
            self.updates += self._config.cloning_updates
        return errors

    def _mark(self, group: str) -> str:
        return f"_{group}" if len(self.learners) > 1 else ""

    def data_of(self, batch: TensorDictBase, group: str) -> TensorDict:
        """Return what one group learns from, with flat keys; the tensors are shared."""
        own, after = batch[group], batch["next", group]
        later = {key: after[key] for key in ("observation", "reward", "done", "terminated")}
        flat = {"observation": own["observation"], "action": own["action"]}
        flat["meant"] = meant(batch, group)
        if self.CENTRAL:
            flat["state"], later["state"] = batch["state"], batch["next", "state"]
        size = batch.batch_size
        return TensorDict({**flat, "next": TensorDict(later, batch_size=size)}, batch_size=size)

    def actor_arrays(self) -> dict[str, ActorArrays]:
        """Return each group's actor as arrays."""
        return {name: learner.actor.arrays() for name, learner in self.learners.items()}

    def state_dict(self) -> dict[str, Any]:
        """Return everything that changes, of tensors and plain values only."""
        groups = {name: learner.to_state() for name, learner in self.learners.items()}
        return {"updates": self.updates, "groups": groups}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take back what `state_dict` gave.

        Raises:
            ConfigError: If it is of other groups.
        """
        if set(state["groups"]) != set(self.learners):
            raise ConfigError(
                f"the saved groups are {sorted(state['groups'])}, here learn {sorted(self.learners)}"
            )
        self.updates = int(state["updates"])
        for name, learner in self.learners.items():
            learner.from_state(state["groups"][name])


class Ppo(OnPolicy):
    """Proximal policy optimisation for one learner: one actor, one critic on the same observation."""

    def _check(self, shapes: Mapping[str, GroupShape]) -> None:
        learners = {name: shape.agents for name, shape in shapes.items()}
        if sum(learners.values()) != 1:
            raise ConfigError(
                f"PPO trains one learner, here learn {learners} (agents by group): take ippo or mappo, "
                "or give the others a policy"
            )


class Ippo(OnPolicy):
    """Independent PPO: an actor for each group, and a critic on the same observation; agents share them.

    Source: de Witt et al. (2020), Is independent learning all you need in the StarCraft multi-agent
    challenge?
    """

    LOSS = IPPOLoss


class Mappo(OnPolicy):
    """Multi-agent PPO: an actor for each group, and a critic that values its agents from all states.

    Source: Yu et al. (2022), The surprising effectiveness of PPO in cooperative multi-agent games.
    """

    LOSS = MAPPOLoss
    CENTRAL = True
