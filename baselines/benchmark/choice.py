"""The command `bench`: which benchmark is meant, and what it may be told."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

from rcare_marl.envs import task_names
from rcare_marl.errors import UnknownNameError

# Options of the benchmarks that are no task.
TAKES = {
    "all": ("steps", "seed"),
    "avatars": ("avatar", "seconds"),
    "homes": ("home", "level", "steps"),
    "learning": ("task", "processes", "seconds"),
    "parity": ("task", "level", "seed", "episodes", "processes", "policy"),
    "batch": ("task", "device", "steps", "seed", "processes"),
    "planning": ("robot", "queries", "rooms", "seed", "processes", "seconds"),
}
NOT_OF_TASKS = {"avatar", "seconds", "task", "processes", "device", "queries", "rooms"} | {
    "episodes",
    "policy",
}
MODULES = {
    **{"all": "task_suite", "avatars": "avatars", "homes": "homes"},
    **{"learning": ".training.throughput", "parity": "parity", "batch": "batch"},
    "planning": "planning",
}


def unwanted(what: str, options: Iterable[str]) -> list[str]:
    """Return the options that a benchmark does not take.

    Raises:
        UnknownNameError: If there is no such benchmark.
    """
    if what in TAKES:
        return [name for name in options if name not in TAKES[what]]
    if what not in task_names():
        raise UnknownNameError("task", what, (*task_names(), *TAKES))
    return [name for name in options if name in NOT_OF_TASKS]


def measure(what: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a benchmark measured, as plain values for JSON.

    Args:
        what: `all`, `avatars`, `batch`, `homes`, `learning`, `parity`, `planning` or a task.
        options: Those of the command that were given.
    """
    if what in TAKES:
        found: dict[str, Any] = _module(what).bench(**options)
        return found
    from . import environment

    rest = dict(options)
    steps, seed = rest.pop("steps", environment.STEPS), rest.pop("seed", 0)
    return environment.bench(what, steps, seed, rest) | environment.surroundings()


def show(what: str, result: Mapping[str, Any]) -> None:
    """Print what `measure` returned as a table."""
    _module(what).show(result)


def _module(what: str) -> Any:
    """Return the module of a benchmark, loaded on use."""
    return import_module(f".{MODULES.get(what, 'environment')}", __package__)
