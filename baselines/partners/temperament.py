"""How a person takes part: policies of several temperaments, for the recipient of any task.

    passive    at a meal: opens the mouth late and little, and does not turn to the spoon; elsewhere lets
               the limbs go where they are taken
    resisting  by spells: at a meal turns away and presses the lips; elsewhere pulls back to where the
               limbs were; between two spells does what is asked

A temperament draws its habits anew in each episode, from the seed of the episode. An individual, such as
`resisting_1`, has habits of its own that stay.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.agents.people.behaviour.avatar_tree import (
    AvatarBehaviour,
    Surroundings,
    behaviour_of,
)
from rcare_marl.agents.people.behaviour.go_along import GoAlong
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.policy import Policy
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import register_policy, task_class, task_names
from rcare_marl.envs.tasks.drinking import Drinking
from rcare_marl.envs.tasks.feeding import OPEN_MOUTH, Feeding
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

Mood = Literal["passive", "resisting"]
MOODS: tuple[Mood, ...] = ("passive", "resisting")
INDIVIDUALS = 3  # of each mood, with habits that stay
RECIPIENT = "recipient"

# All our own choices. A spoon that waits 9 cm in front of the mouth is near for everybody.
OPENS_WITHIN = (0.11, 0.16)  # [m] of a passive person; the cooperative one opens at 0.20
OPENING = (0.45, 0.65)  # share of the active range that a passive mouth opens; else 0.8
LEAST_OPENING = OPEN_MOUTH + math.radians(2)  # what anybody opens who opens at all [rad]
FIRST_SPELL = (1.0, 3.0)  # [s] of resistance from the start on
SPELL = (1.0, 2.5)  # [s] of each further one
LULL = (2.0, 4.0)  # [s] between two


@dataclass(frozen=True)
class Habits:
    """What differs between two people of one temperament.

    Attributes:
        opens_within: Distance of the spoon at which a passive mouth opens [m].
        opening: Share of the active range that it opens.
        first: Length of the first spell of resistance, from the start of an episode [s].
        spell: Length of each further one [s].
        lull: Time between two [s].
    """

    opens_within: float
    opening: float
    first: float
    spell: float
    lull: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Habits:
        """Return habits drawn uniformly."""
        ranges = (OPENS_WITHIN, OPENING, FIRST_SPELL, SPELL, LULL)
        return cls(*(float(rng.uniform(*each)) for each in ranges))

    def resists_at(self, time: float) -> bool:
        """Return whether a resisting person resists at a time of the episode [s]."""
        if time < self.first:
            return True
        return (time - self.first) % (self.lull + self.spell) >= self.lull


class Temperament:
    """A person of one mood: a policy for the recipient of any task.

    Attributes:
        habits: Those of the running episode.
    """

    def __init__(self, env: CareEnv, role: str, mood: Mood, *, seed: int | None = None) -> None:
        """Prepare a spawned person.

        Args:
            env: The environment.
            role: Whom to play.
            mood: Of which temperament.
            seed: Draws the habits, once; each episode draws its own if None.

        Raises:
            ConfigError: If a robot plays the role.
        """
        person = env.cast[role]
        if not isinstance(person, Human):
            raise ConfigError(
                f"policy {mood!r} is for people, and {role!r} is played by {type(person).__name__}"
            )
        self._env, self._person, self._mood, self._seed = env, person, mood, seed
        self._slack = GoAlong(person, env.task.control_dt)
        self._offer = offer_of(env)
        self._eater: AvatarBehaviour | None = None
        self._start: Mapping[str, float] = {}
        self.habits = Habits.drawn(np.random.default_rng(seed or 0))

    def reset(self, rng: np.random.Generator) -> None:
        own = rng if self._seed is None else np.random.default_rng(self._seed)
        self.habits = Habits.drawn(own)
        self._start = dict(
            zip(self._person.movable, map(float, self._person.positions), strict=True)
        )
        if self._offer is not None:
            self._eater = self._make_eater(self._offer)
            self._eater.reset(rng)

    def _make_eater(self, offer: Callable[[], Array]) -> AvatarBehaviour:
        config, person = behaviour_of(self._person), self._person
        if self._mood == "passive":
            jaw = person.movable.index("jaw_opening") if "jaw_opening" in person.movable else None
            widest = float(person.active[jaw, 1]) if jaw is not None else LEAST_OPENING
            opening = max(self.habits.opening, LEAST_OPENING / max(widest, LEAST_OPENING))
            config = dataclasses.replace(
                config,
                activities=("mouth",),
                opens_within=self.habits.opens_within,
                opening=opening,
            )
        around = Surroundings(clock=lambda: self._env.world.time, spoon=offer)
        return AvatarBehaviour(person, around, self._env.task.control_dt, config=config)

    def act(self) -> Array:
        resists = self._mood == "resisting" and self.habits.resists_at(self._env.world.time)
        if self._eater is not None:
            self._eater.cues.refuses = resists
            return self._eater.act()
        if resists:
            return self._person.action_towards(self._start, self._env.task.control_dt)
        return self._slack.act()


def offer_of(env: CareEnv) -> Callable[[], Array] | None:
    """Return what tells where the food or drink of a meal is in the world [m]; None without a meal."""
    task = env.task
    if isinstance(task, Feeding):
        return lambda: task.state.bowl
    return (lambda: task.state.rim) if isinstance(task, Drinking) else None


@dataclass(frozen=True)
class TemperamentFactory:
    """Makes the policy of a mood, perhaps of one individual; it can be pickled.

    Attributes:
        mood: Which.
        seed: Of the habits of an individual; None draws them anew in each episode.
    """

    mood: Mood
    seed: int | None = None

    def __call__(self, env: CareEnv, role: str) -> Policy:
        """Return the policy for a role of a built environment."""
        return Temperament(env, role, self.mood, seed=self.seed)


def mood_names() -> tuple[str, ...]:
    """Return the names of the policies here: each mood and its individuals."""
    return tuple(_factories())


def _factories() -> dict[str, TemperamentFactory]:
    out: dict[str, TemperamentFactory] = {}
    for mood in MOODS:
        out[mood] = TemperamentFactory(mood)
        out |= {f"{mood}_{k}": TemperamentFactory(mood, k) for k in range(1, INDIVIDUALS + 1)}
    return out


def _register() -> None:
    for task in task_names():
        role = task_class(task).roles().get(RECIPIENT)
        if role is not None and role.kind is Human:
            for name, factory in _factories().items():
                register_policy(task, RECIPIENT, name)(factory)


_register()
