"""The command `bench`: which benchmark is meant, and what it may be told."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rcare_marl.envs import task_names
from rcare_marl.errors import UnknownNameError

# Options of the benchmarks that are no task.
TAKES = {
    "all": ("steps", "seed"),
    "avatars": ("avatar", "seconds"),
    "homes": ("home", "level", "steps"),
    "learning": ("task", "processes", "seconds"),
}
NOT_OF_TASKS = ("avatar", "seconds", "task", "processes")
STEPS = 300  # control steps


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
        what: `all`, `avatars`, `homes`, `learning` or a task.
        options: Those of the command that were given.
    """
    rest = dict(options)
    if what == "avatars":
        from . import avatar_benchmark

        return avatar_benchmark.bench(rest.get("avatar", "karan"), rest.get("seconds", 5.0))
    if what == "learning":
        from . import learning_benchmark

        return learning_benchmark.bench(**rest)
    steps = rest.pop("steps", STEPS)
    if what == "homes":
        from . import home_benchmark

        return home_benchmark.bench(rest.get("home", "house_07"), rest.get("level", 1), steps)
    from . import benchmark, task_suite

    seed = rest.pop("seed", 0)
    if what == "all":
        return task_suite.bench(steps, seed)
    return benchmark.bench(what, steps, seed, rest) | benchmark.surroundings()


def show(what: str, result: Mapping[str, Any]) -> None:
    """Print what `measure` returned as a table."""
    from . import avatar_benchmark, benchmark, home_benchmark, learning_benchmark, task_suite

    shows = {
        "all": task_suite.show,
        "avatars": avatar_benchmark.show,
        "homes": home_benchmark.show,
        "learning": learning_benchmark.show,
    }
    shows.get(what, benchmark.show)(result)
