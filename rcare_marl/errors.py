"""Errors raised for bad input. Each message names the culprit, what was got and what is allowed."""

from collections.abc import Collection, Iterable
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any


class RcareError(Exception):
    """Base class of every error that this package raises on purpose."""


class ConfigError(RcareError, ValueError):
    """A configuration has an unknown, missing or impossible value."""


class ActionError(RcareError, ValueError):
    """An action has the wrong agent, shape or a value that is not finite."""


class WorldError(RcareError, RuntimeError):
    """The physics world is asked for something that its present state forbids."""


class EpisodeError(RcareError, RuntimeError):
    """`step` came before `reset`, or after the end of the episode."""


class RenderingError(RcareError, RuntimeError):
    """No picture can be drawn with the backend that was asked for."""


class ClusterError(RcareError, RuntimeError):
    """A cluster of machines cannot be reached, or has nothing free."""


class WorkerError(RcareError, RuntimeError):
    """A process that runs environments failed; the message holds its traceback."""


class MissingPackageError(RcareError, ImportError):
    """An optional package is needed and is not installed."""

    def __init__(self, what: str, extra: str = "", *, package: str = "") -> None:
        wanted = package or f"'rcare-marl[{extra}]'"
        super().__init__(f"{what} needs a package that is not installed: pip install {wanted}")
        self._given = (what, extra, package)

    def __reduce__(self) -> tuple[Any, ...]:  # so that it comes back from another process
        what, extra, package = self._given
        return partial(type(self), package=package), (what, extra)


class CastWarning(UserWarning):
    """A policy plays with somebody, or somewhere, that it was not trained for."""


class UnknownNameError(RcareError, KeyError):
    """A task, robot, avatar, joint or link of that name does not exist."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        known = sorted(known)
        near = get_close_matches(name, known, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        super().__init__(f"no {kind} named {name!r}.{hint} Known: {', '.join(known)}")
        self._given = (kind, name, known)

    def __reduce__(self) -> tuple[Any, ...]:  # so that it comes back from another process
        return type(self), self._given

    def __str__(self) -> str:
        return str(self.args[0])


def check_positive(owner: object, *names: str) -> None:
    """Raise a ConfigError where an attribute is not above 0."""
    for name in names:
        if not getattr(owner, name) > 0:
            raise ConfigError(f"{name} must be above 0, got {getattr(owner, name)}")


def check_not_negative(owner: object, *names: str) -> None:
    """Raise a ConfigError where an attribute is below 0."""
    for name in names:
        if not getattr(owner, name) >= 0:
            raise ConfigError(f"{name} must not be negative, got {getattr(owner, name)}")


def check_name(kind: str, name: str, known: Collection[str]) -> None:
    """Raise an UnknownNameError, of a kind of name, where a name is none of those that are known."""
    if name not in known:
        raise UnknownNameError(kind, name, known)


def near_files(file: Path) -> str:
    """Return a hint at what is there in place of a file that is missing; empty where nothing is."""
    suffix, said = (
        file.suffix,
        "" if file.parent.is_dir() else f" There is no folder {file.parent}.",
    )
    while not file.parent.is_dir() and file.parent != file.parent.parent:
        file = file.parent
    there = [each for each in file.parent.iterdir() if not each.name.startswith(".")]
    names = [each.name for each in there if each.is_dir() or each.suffix == suffix]
    if near := get_close_matches(file.name, names, n=1):
        return f"{said} Did you mean {file.parent / near[0]}?"
    files = sorted(name for name in names if name.endswith(suffix))
    return f"{said} In {file.parent} there are {', '.join(files)}." if files else said
