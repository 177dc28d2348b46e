"""Who learns, and in which groups."""

from __future__ import annotations

from collections.abc import Collection

from rcare_marl.agents.robots.robot import Robot

from .care_env import CareEnv
from .registry import task_class


def lead_roles(task: str) -> tuple[str, ...]:
    """Return the roles whose policy is in question: the robots of the task, or all its roles."""
    roles = task_class(task).roles()
    return tuple(name for name, role in roles.items() if role.kind is Robot) or tuple(roles)


def group_map(env: CareEnv, *, extended: Collection[str] = ()) -> dict[str, list[str]]:
    """Return the learned roles by group: robots, recipients, caregivers.

    Roles of one kind share a group only if all their spaces are equal, as TorchRL wants them stacked;
    if they are not, each role of that kind is a group of its own, called as the role.

    Args:
        env: The environment.
        extended: Roles whose observation is made longer outside of the environment.
    """
    kinds: dict[str, list[str]] = {}
    for role in env.possible_agents:
        kind = "robots" if isinstance(env.cast[role], Robot) else f"{role.rsplit('_', 1)[0]}s"
        kinds.setdefault(kind, []).append(role)
    groups: dict[str, list[str]] = {}
    for kind, (first, *others) in kinds.items():
        same = all(
            space(first) == space(role) and (first in extended) == (role in extended)
            for role in others
            for space in (env.observation_space, env.action_space)
        )
        groups |= {kind: [first, *others]} if same else {role: [role] for role in (first, *others)}
    return groups
