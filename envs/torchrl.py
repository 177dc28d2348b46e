"""A task as a TorchRL environment, its agents in groups."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torchrl.envs import PettingZooWrapper

from rcare_marl.agents.robot import Robot

from . import make
from .care_env import CareEnv


def group_map(env: CareEnv) -> dict[str, list[str]]:
    """Return the learned roles by group: robots, recipients, caregivers.

    Roles of one kind share a group only if their spaces are equal, as TorchRL wants them stacked.
    """
    groups: dict[str, list[str]] = {}
    for role in env.possible_agents:
        kind = "robots" if isinstance(env.cast[role], Robot) else f"{role.rsplit('_', 1)[0]}s"
        first = groups.get(kind, [role])[0]
        same = all(
            space(first) == space(role) for space in (env.observation_space, env.action_space)
        )
        groups.setdefault(kind if same else role, []).append(role)
    return groups


def make_env(
    task: str,
    *,
    options: Mapping[str, Any] | None = None,
    policies: Mapping[str, Any] | None = None,
    device: str = "cpu",
    **cast: Any,
) -> PettingZooWrapper:
    """Return a TorchRL environment; arguments as for `rcare_marl.make`.

    Args:
        task: Task name.
        options: Settings of the task.
        policies: Policies of roles that are not learned.
        device: Where its tensors live.
        **cast: Who plays.
    """
    env = make(task, options=options, policies=policies, **cast)
    return PettingZooWrapper(
        env=env, group_map=group_map(env), use_mask=False, return_state=True, device=device
    )
