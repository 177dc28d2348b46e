"""Scenes in which another one of a population plays in each episode."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import Any, NamedTuple, TypeVar

from rcare_marl.agents.agent import Agent
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.sampling.population import names_several, people_named
from rcare_marl.errors import ConfigError

from .registry import PolicyFactory
from .task import Role, Task, part_name

TRIES = 20  # people who may be refused one after the other; our own choice
T = TypeVar("T")


class Scene(NamedTuple):
    """What `CareEnv` builds: a task, who plays in it, and the policies of those who are not learned."""

    task: Task
    cast: dict[str, Agent]
    policies: dict[str, PolicyFactory]


class Company:
    """Those of whom another one plays in each episode, and who plays now.

    The seed of the episode says who: person `seed % n` of n, so that as many seeds in a row meet
    everybody once. Who cannot be cast, by the task or by the robot's reach, is noted with the reason, and
    the next one plays; so it is in an episode that has no start in which nobody touches a robot.

    Attributes:
        called: By role, the name that stands for all who may play it, such as `population:train`.
        drawn: By role, the names of all who may play it.
        playing: By role, the name of who plays now.
        refused: By name, why somebody cannot be cast.
    """

    def __init__(
        self,
        cast: Mapping[str, Any],
        drawn: Mapping[str, tuple[str, ...]],
        make_scene: Callable[[Mapping[str, Any]], Scene],
    ) -> None:
        """Take a cast in which entries of `drawn` stand for several, and what makes a scene of a cast."""
        self._cast, self.drawn, self._make_scene = dict(cast), dict(drawn), make_scene
        self.called = {role: str(model_of(cast[role])) for role in drawn}
        self.playing: dict[str, str] = {}
        self.refused: dict[str, str] = {}

    def is_next(self, seed: int) -> bool:
        """Return whether those who play now are those of an episode's seed."""
        return next(self._order(seed), None) == self.playing

    def play(self, seed: int, build: Callable[[Scene], T], passed: Mapping[str, str]) -> T:
        """Return what `build` makes of the scene with those of an episode's seed.

        Args:
            seed: Of the episode.
            build: Makes something of a scene.
            passed: Who does not play in this episode, and why.

        Raises:
            ConfigError: If nobody can be cast; it gives the last reason.
        """
        reason = ["everybody was refused before", *passed.values()][-1]
        for chosen in islice(self._order(seed), TRIES):
            self.playing = chosen
            if self.who() in passed:
                continue
            try:
                return build(self._make_scene(self.resolved(self._cast)))
            except ConfigError as error:
                reason = str(error)
                self.refused[self.who()] = reason
        raise ConfigError(f"cannot cast {self.who()}, nor those before: {reason}")

    def _order(self, seed: int) -> Iterator[dict[str, str]]:
        """Yield who may play, beginning with those of a seed, without those who were refused."""
        counts = [len(names) for names in self.drawn.values()]
        for number in range(seed, seed + max(counts)):
            later = 1 + number // counts[0]  # so that a second role meets others in each round
            chosen = {
                role: names[(number + k * later) % len(names)]
                for k, (role, names) in enumerate(self.drawn.items())
            }
            if " and ".join(chosen.values()) not in self.refused:
                yield chosen

    def who(self) -> str:
        """Return the names of those who play now."""
        return " and ".join(self.playing.values())

    def numbers(self) -> dict[str, float]:
        """Return the place of who plays each role among all who may, by `<role>_person`."""
        return {
            f"{role}_person": float(self.drawn[role].index(name))
            for role, name in self.playing.items()
        }

    def resolved(self, cast: Mapping[str, Any]) -> dict[str, Any]:
        """Return a cast with those who play now in place of all who may."""
        out = dict(cast)
        for role, name in self.playing.items():
            entry = cast[role]
            out[role] = {**entry, "model": name} if isinstance(entry, Mapping) else name
        return out


def model_of(entry: Any) -> Any:
    """Return the model that a cast's entry names; None if it leaves that to the role."""
    return entry.get("model") if isinstance(entry, Mapping) else entry


def drawn_people(
    roles: Mapping[str, Role[Any]], cast: Mapping[str, Any]
) -> dict[str, tuple[str, ...]]:
    """Return the people of whom another one plays in each episode, by role; none where one is cast.

    Raises:
        UnknownNameError: If there is no such population.
        ConfigError: If it has no such people.
    """
    out = {}
    for role, entry in cast.items():
        model = model_of(entry)
        part = roles.get(part_name(role))
        if part is not None and part.kind is Human and names_several(model):
            out[role] = people_named(model)
    return out
