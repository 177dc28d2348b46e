"""Populations: people by number, the same on every machine, and names that stand for them."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load, plain
from rcare_marl.errors import ConfigError, check_name

from ..avatar import AvatarConfig, load_avatar
from .sampler import sample_person

PREFIX = "population:"
SIX = "six"


@dataclass(frozen=True)
class Drawn:
    """How many people, and the seed that they are drawn from."""

    count: int
    seed: int


@dataclass(frozen=True)
class Populations:
    """The file `assets/clinical/populations.yaml`.

    Attributes:
        version: Goes up when the same number shall be another person.
        populations: Those who are drawn.
        conditions: Probability of each condition.
        six: The avatars that ship and are cared for.
    """

    version: int
    populations: dict[str, Drawn]
    conditions: dict[str, float]
    six: tuple[str, ...]


@lru_cache(maxsize=1)
def _populations() -> Populations:
    return load(Populations, assets.find("clinical", "populations"))


def population_names() -> tuple[str, ...]:
    """Return the names of all populations."""
    return (*_populations().populations, SIX)


def population_size(name: str) -> int:
    """Return how many people a population has.

    Raises:
        UnknownNameError: If there is none of that name.
    """
    check_name("population", name, population_names())
    found = _populations()
    return len(found.six) if name == SIX else found.populations[name].count


def person_of(name: str, number: int) -> AvatarConfig:
    """Return a person of a population.

    Raises:
        UnknownNameError: If there is no such population.
        ConfigError: If it has no person of that number.
    """
    size = population_size(name)
    if not 0 <= number < size:
        raise ConfigError(f"population {name!r} has people 0..{size - 1}, got {number}")
    if name == SIX:
        return load_avatar(_populations().six[number])
    return _person(name, number)


@lru_cache(maxsize=2048)
def _person(name: str, number: int) -> AvatarConfig:
    found = _populations()
    rng = np.random.default_rng([found.version, found.populations[name].seed, number])
    shares = np.array(list(found.conditions.values()))
    condition = list(found.conditions)[int(rng.choice(len(shares), p=shares / shares.sum()))]
    return sample_person(condition, seed=int(rng.integers(2**31)))


def people_of(name: str) -> Iterator[AvatarConfig]:
    """Return all people of a population in turn."""
    return (person_of(name, number) for number in range(population_size(name)))


@lru_cache(maxsize=4)
def population_hash(name: str) -> str:
    """Return a hash of everything that the people of a population are, 12 hexadecimal digits."""
    digest = hashlib.sha256()
    for person in people_of(name):
        digest.update(_text(person))
    return digest.hexdigest()[:12]


def person_hash(avatar: AvatarConfig) -> str:
    """Return a hash of everything that a person is, 12 hexadecimal digits."""
    return hashlib.sha256(_text(avatar)).hexdigest()[:12]


def _text(avatar: AvatarConfig) -> bytes:
    return json.dumps(avatar_fields(avatar), sort_keys=True).encode()


def find_avatar(name: str | Path) -> AvatarConfig:
    """Return an avatar by name or YAML file, or a person of a population: `population:test:17`.

    Raises:
        UnknownNameError: If there is no such avatar or population.
        ConfigError: If the population has no person of that number, or the name stands for several.
    """
    if isinstance(name, str) and names_several(name):
        several = people_named(name)
        raise ConfigError(
            f"{name!r} names {len(several)} people; what is cast here takes one of them, "
            f"{several[0]} to {several[-1]}"
        )
    if not isinstance(name, str) or not name.startswith(PREFIX):
        return load_avatar(name)
    which, _, number = name.removeprefix(PREFIX).partition(":")
    return person_of(which, int(number))


def names_several(name: object) -> bool:
    """Return whether a name stands for people of a population: `six`, `population:test`, `:0-9`."""
    if not isinstance(name, str):
        return False
    if name == SIX:
        return True
    _, _, number = name.removeprefix(PREFIX).partition(":")
    return name.startswith(PREFIX) and not number.isdecimal()


def population_of(name: str) -> str:
    """Return the name of the population that a name stands for people of."""
    return name.removeprefix(PREFIX).partition(":")[0]


def populations_among(names: Iterable[str]) -> set[str]:
    """Return the names of the populations whose people some names of a cast stand for."""
    return {population_of(name) for name in names if name == SIX or name.startswith(PREFIX)}


def people_named(name: str) -> tuple[str, ...]:
    """Return those whom a name stands for, by name; itself if that is one person.

    `population:test` is everybody of it, `population:test:0-9` its first ten, and `six` those who ship.

    Raises:
        UnknownNameError: If there is no such population.
        ConfigError: If it has no such people.
    """
    if not names_several(name):
        return (name,)
    which, span = population_of(name), name.removeprefix(PREFIX).partition(":")[2]
    size = population_size(which)
    first, dash, last = span.partition("-") if span else ("0", "-", str(size - 1))
    if not (dash and first.isdecimal() and last.isdecimal() and int(first) <= int(last) < size):
        raise ConfigError(
            f"{name!r}: {span!r} is none of its people; write one from 0 to {size - 1}, or several as "
            f"{PREFIX}{which}:0-{min(9, size - 1)}"
        )
    chosen = range(int(first), int(last) + 1)
    if which == SIX:
        return tuple(_populations().six[number] for number in chosen)
    return tuple(f"{PREFIX}{which}:{number}" for number in chosen)


def avatar_fields(avatar: AvatarConfig) -> dict[str, Any]:
    """Return what a YAML file of an avatar holds; what is as in a healthy adult is left out."""
    return plain(_departures(avatar), avatar.name)


def _departures(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that are not its defaults."""
    out: dict[str, Any] = {}
    for entry in dataclasses.fields(value):
        mine = getattr(value, entry.name)
        default = entry.default
        if entry.default_factory is not dataclasses.MISSING:
            default = entry.default_factory()
        if mine == default and entry.name != "body":
            continue
        out[entry.name] = _data(mine)
    return out


def _data(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return _departures(value)
    if isinstance(value, list | tuple):
        return [_data(item) for item in value]
    return value
