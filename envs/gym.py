"""A task as a Gymnasium environment: one role is learned, all others are played by policies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError, UnknownNameError

from . import make
from .care_env import RENDER_MODES
from .registry import task_class
from .task import part_name

Obs = npt.NDArray[np.float32]


class SingleAgentEnv(gymnasium.Env[Obs, Obs]):
    """A `CareEnv` seen by its one learner.

    Attributes:
        care_env: The environment behind.
        role: The role that is learned.
    """

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 10}

    def __init__(
        self,
        task: str,
        *,
        role: str = "robot",
        options: dict[str, Any] | None = None,
        policies: dict[str, Any] | None = None,
        render_mode: str | None = None,
        **cast: Any,
    ) -> None:
        """Make the environment.

        Args:
            task: Task name.
            role: The role that is learned.
            options: Settings of the task.
            policies: Policies of the other roles; the task's default policy where none is given.
            render_mode: `rgb_array`, `human` or None.
            **cast: As for `rcare_marl.make`.

        Raises:
            ConfigError: If another role than `role` has no policy.
            UnknownNameError: If the task has no such role.
        """
        played = task_class(task).roles()
        if part_name(role) not in played:
            raise UnknownNameError(f"role in task {task!r}", role, played)
        others = {}
        for name, part in played.items():
            player = name if f"{name}_0" not in cast and f"{name}_1" not in cast else f"{name}_0"
            entry = cast.get(player)
            has_policy = isinstance(entry, Mapping) and "policy" in entry
            is_there = part.default is not None or entry is not None
            if player != role and part.partner is not None and is_there and not has_policy:
                others[player] = part.partner
        self.care_env = make(
            task,
            options=options,
            policies={**others, **(policies or {})},
            render_mode=render_mode,
            **cast,
        )
        if self.care_env.possible_agents != [role]:
            learned = self.care_env.possible_agents
            self.care_env.close()
            raise ConfigError(
                f"one role must be left to learn, {role!r}; left are {', '.join(learned) or 'none'}: "
                "give the others a policy"
            )
        self.role, self.render_mode = role, render_mode
        self.metadata = dict(self.care_env.metadata)
        self.observation_space = self.care_env.observation_space(role)
        self.action_space = self.care_env.action_space(role)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Obs, dict[str, Any]]:
        super().reset(seed=seed)
        observations, infos = self.care_env.reset(seed, options)
        return observations[self.role], infos[self.role]

    def step(self, action: Obs) -> tuple[Obs, float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.care_env.step({self.role: action})
        r = self.role
        return observation[r], reward[r], terminated[r], truncated[r], info[r]

    def render(self) -> Any:
        return self.care_env.render()

    def close(self) -> None:
        self.care_env.close()
