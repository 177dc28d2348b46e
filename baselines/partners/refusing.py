"""People who do not want what is offered, and say and show so until it is over."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.agents.people.behaviour.avatar_tree import AvatarBehaviour
from rcare_marl.agents.people.human import Human
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import (
    Offers,
    policy_factory,
    register_policy,
    task_class,
    task_names,
)
from rcare_marl.envs.task import part_name
from rcare_marl.pose import Array

# All our own choices.
WITHIN = (0.0, 0.30)  # [m] from the mouth, where food or drink begins to be refused
AFTER = (0.0, 1.0)  # [s] that passes then; so some have it between the lips
ELSEWHERE = (0.0, 6.0)  # [s] from the start of an episode without a meal


class Refusing:
    """A person who behaves as their tree says, until they refuse for good.

    When that is is drawn in each episode: at a meal by how near food or drink is, elsewhere by time.
    """

    def __init__(self, env: CareEnv, role: str) -> None:
        """Prepare a spawned person.

        Raises:
            ConfigError: If a robot plays the role.
        """
        made = policy_factory("", role, "behaviour")(env, role)
        assert isinstance(made, AvatarBehaviour) and isinstance(person := env.cast[role], Human)
        self._env, self._tree, self._person = env, made, person
        self._within = self._after = 0.0
        self._since = math.inf

    def reset(self, rng: np.random.Generator) -> None:
        self._tree.reset(rng)
        self._within = float(rng.uniform(*WITHIN))
        is_meal = isinstance(self._env.task, Offers)
        self._after = float(rng.uniform(*(AFTER if is_meal else ELSEWHERE)))
        self._since = math.inf

    def act(self) -> Array:
        time = self._env.world.time
        if self._since == math.inf and self._is_near():
            self._since = time
        self._tree.cues.refuses = time >= self._since + self._after
        return self._tree.act()

    def _is_near(self) -> bool:
        task = self._env.task
        if not isinstance(task, Offers):
            return True
        return math.dist(task.offered_position(), self._person.mouth_position()) < self._within


def _register() -> None:
    for task in task_names():
        for name, role in task_class(task).roles().items():
            if role.speaks:
                register_policy(task, part_name(name), "refusing")(Refusing)


_register()
