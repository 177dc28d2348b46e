"""A toy to learn in: points that are to reach goals. Batches are laid out as BatchedEnv's."""

from __future__ import annotations

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs.utils import ExplorationType, set_exploration_type

HORIZON = 20
REACH = 0.15  # an episode ends in success when every point is this near to its goal


class PointReach:
    """Each agent moves its point in a plane by at most 0.2 a step; the reward is minus the distance.

    Args:
        groups: How many agents each group has.
        count: Environments.
        low: Lower bound of the actions.
        shared: The reward is the mean over all agents of all groups.
        seed: Of starts and goals.
    """

    def __init__(
        self,
        groups: dict[str, int],
        *,
        count: int = 8,
        low: float = -1.0,
        shared: bool = False,
        seed: int = 0,
    ) -> None:
        self.group_map = {g: [f"{g}_{i}" for i in range(n)] for g, n in groups.items()}
        self.batch_size = torch.Size([count])
        self.low, self.shared, self.count = low, shared, count
        self._random = torch.Generator().manual_seed(seed)
        self._agents = sum(groups.values())
        self.full_action_spec = Composite(
            {
                g: Composite({"action": Bounded(low, 1.0, torch.Size((count, n, 2)))})
                for g, n in groups.items()
            }
        )
        self.observation_spec = Composite(
            {
                g: Composite({"observation": Unbounded(torch.Size((count, n, 4)))})
                for g, n in groups.items()
            }
            | {"state": Unbounded(torch.Size((count, 4 * self._agents)))}
        )
        self._points = torch.zeros(count, self._agents, 4)  # place and goal
        self._clock = torch.zeros(count, dtype=torch.long)
        self._begin(torch.ones(count, dtype=torch.bool))

    def rollout(
        self, policy: TensorDictModuleBase, steps: int, *, explore: bool = True
    ) -> TensorDict:
        """Return a batch [environments, steps]; episodes that end start again at once."""
        kind = ExplorationType.RANDOM if explore else ExplorationType.DETERMINISTIC
        with set_exploration_type(kind), torch.no_grad():
            return torch.stack([self._step(policy) for _ in range(steps)], dim=1)

    def _step(self, policy: TensorDictModuleBase) -> TensorDict:
        now = policy(self._seen())
        actions = torch.cat([now[g, "action"] for g in self.group_map], dim=1)
        speed = 0.2 * (2 * (actions - self.low) / (1 - self.low) - 1)
        self._points[..., :2] = (self._points[..., :2] + speed).clamp(-1, 1)
        self._clock += 1
        distance = (self._points[..., :2] - self._points[..., 2:]).norm(dim=-1)
        terminated = (distance < REACH).all(dim=-1)
        truncated = ~terminated & (self._clock >= HORIZON)
        rewards = (
            -distance.mean(dim=1, keepdim=True).expand_as(distance) if self.shared else -distance
        )
        after, first = self._seen(), 0
        for group, roles in self.group_map.items():
            shape = (self.count, len(roles), 1)
            after[group, "reward"] = rewards[:, first : first + len(roles)].unsqueeze(-1).clone()
            for name, value in (
                ("terminated", terminated),
                ("truncated", truncated),
                ("done", terminated | truncated),
            ):
                after[group, name] = value.view(-1, 1, 1).expand(shape).clone()
            first += len(roles)
        after["success"] = terminated.float().unsqueeze(-1)
        now["next"] = after
        self._begin(terminated | truncated)
        return now

    def _seen(self) -> TensorDict:
        parts = torch.split(self._points.clone(), [len(r) for r in self.group_map.values()], dim=1)
        found: dict[str, Tensor | dict[str, Tensor]] = {
            group: {"observation": part} for group, part in zip(self.group_map, parts, strict=True)
        }
        return TensorDict(found | {"state": self._points.flatten(1).clone()}, [self.count])

    def _begin(self, which: Tensor) -> None:
        fresh = torch.rand(self._points.shape, generator=self._random) * 1.6 - 0.8
        self._points = torch.where(which.view(-1, 1, 1), fresh, self._points)
        self._clock = torch.where(which, 0, self._clock)


def mean_reward(env: PointReach, policy: TensorDictModuleBase, steps: int = 100) -> float:
    """Return the mean reward of a step, acting without chance."""
    batch = env.rollout(policy, steps, explore=False)
    return float(torch.cat([batch["next", g, "reward"].flatten() for g in env.group_map]).mean())
