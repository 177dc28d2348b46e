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

    Roles of one kind share a group only if all their spaces are equal, as TorchRL wants them stacked;
    if they are not, each role of that kind is a group of its own, called as the role.
    """
    kinds: dict[str, list[str]] = {}
    for role in env.possible_agents:
        kind = "robots" if isinstance(env.cast[role], Robot) else f"{role.rsplit('_', 1)[0]}s"
        kinds.setdefault(kind, []).append(role)
    groups: dict[str, list[str]] = {}
    for kind, (first, *others) in kinds.items():
        same = all(
            space(first) == space(role)
            for role in others
            for space in (env.observation_space, env.action_space)
        )
        groups |= {kind: [first, *others]} if same else {role: [role] for role in (first, *others)}
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
