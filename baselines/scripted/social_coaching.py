"""The robot that coaches one person or a group by its behaviour tree; see docs/coaching.md."""

from __future__ import annotations

import numpy as np

from rcare_marl.agents.coaching.style import BRISK, Style
from rcare_marl.agents.coaching.tree import CoachTree
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.coaching.coaching_task import CoachingTask, encode
from rcare_marl.envs.registry import register_policy
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array


class ScriptedCoaching:
    """Ticks the coach's tree once a control step, and gives what it orders as an action.

    Attributes:
        tree: The tree; its `session` takes requests such as `must_pause`.
    """

    def __init__(self, env: CareEnv, role: str, style: Style = Style()) -> None:
        """Take the environment, the robot's role, and how the tree leads.

        Raises:
            ConfigError: If the task is no coaching, or the robot is not the one that coaches.
        """
        task = env.task
        if not isinstance(task, CoachingTask):
            raise ConfigError(f"the scripted coach cannot play {type(task).__name__}")
        if env.cast[role] is not task.robot:
            raise ConfigError(f"{role!r} only watches: the scripted coach plays the first robot")
        self.tree, self._style = CoachTree(task.session), style

    def reset(self, rng: np.random.Generator) -> None:
        self.tree.reset()

    def act(self) -> Array:
        return encode(self.tree.tick(), self._style)


for _task in ("social_coaching", "group_coaching"):
    register_policy(_task, "robot", "scripted")(ScriptedCoaching)


@register_policy("social_coaching", "robot", "brisk")
def brisk(env: CareEnv, role: str) -> ScriptedCoaching:
    """Return the tree that leads in the style `BRISK`: short pauses, soon calls."""
    return ScriptedCoaching(env, role, BRISK)
