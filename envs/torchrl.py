"""A task as a TorchRL environment, its agents in groups."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torchrl.envs import PettingZooWrapper

from . import make
from .registry import group_map as group_map


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
