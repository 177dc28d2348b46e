"""Errors raised for bad input. Each message names the culprit, what was got and what is allowed."""

from __future__ import annotations

import os
import reprlib
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

LONGEST = 2000  # characters of a message
SHOWN = reprlib.Repr()
SHOWN.maxstring = SHOWN.maxother = SHOWN.maxlong = 200
SHOWN.maxlist = SHOWN.maxtuple = SHOWN.maxdict = SHOWN.maxset = 20


class RcareError(Exception):
    """Base class of every error that this package raises on purpose."""

    longest = LONGEST

    def __init__(self, *args: object) -> None:
        super().__init__(*(self._brief(each) for each in args))

    def _brief(self, message: object) -> object:
        if not isinstance(message, str) or len(message) <= self.longest:
            return message
        half = self.longest // 2 - 20
        return f"{message[:half]} … {len(message):,} characters … {message[-half:]}"


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

    longest = 10 * LONGEST


class PlanningError(RcareError, RuntimeError):
    """There is no path, or none was found in time; the message says what is in the way."""


class MissingPackageError(RcareError, ImportError):
    """An optional package is needed and is not installed."""

    def __init__(self, what: str, extra: str = "", *, package: str = "") -> None:
        wanted = package or f"'rcare-marl[{extra}]'"
        super().__init__(f"{what} needs a package that is not installed: pip install {wanted}")
        self._given = (what, extra, package)

    def __reduce__(self) -> tuple[Any, ...]:  # so that it comes back from another process
        what, extra, package = self._given
        return partial(type(self), package=package), (what, extra)


def check_package(module: str, what: str, extra: str) -> None:
    """Raise a MissingPackageError where a module is not installed, before any work that needs it."""
    if find_spec(module) is None:
        raise MissingPackageError(what, extra)


class CastWarning(UserWarning):
    """A policy plays with somebody, or somewhere, that it was not trained for."""


class UnknownNameError(RcareError, KeyError):
    """A task, robot, avatar, joint or link of that name does not exist."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        known = sorted(map(str, known))
        near = get_close_matches(name[:LONGEST], known, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        super().__init__(f"no {kind} named {shown(name)}.{hint} Known: {', '.join(known)}")
        self._given = (kind, name, known)

    def __reduce__(self) -> tuple[Any, ...]:  # so that it comes back from another process
        return type(self), self._given

    def __str__(self) -> str:
        return str(self.args[0])


class UnknownArgumentError(UnknownNameError, TypeError):
    """A function has no such keyword argument, and a task no such role."""

    def __init__(self, message: str) -> None:  # one text, as Gymnasium makes it again
        RcareError.__init__(self, message)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self.args

    @classmethod
    def of(cls, task: str, name: str, known: Iterable[str], hint: str = "") -> UnknownArgumentError:
        """Return the error for a name; it says what is near, as Python itself says what is wrong."""
        said = UnknownNameError(f"role of task {task!r} or argument", name, known)
        told = f"{hint}. " if hint else ""
        return cls(f"{told}got an unexpected keyword argument {shown(name)}: {said}")


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
    if not isinstance(name, str):
        raise UnknownNameError(kind, shown(name), known)
    if name not in known:
        raise UnknownNameError(kind, name, known)


def shown(value: object) -> str:
    """Return a value as an error shows it, however large or deep it is."""
    try:
        return SHOWN.repr(value)
    except Exception:  # a `repr` of somebody else's, or a number of many thousand digits
        return f"a {type(value).__name__}"


def check_type(name: str, value: object, wanted: type | tuple[type, ...], said: str) -> None:
    """Raise a ConfigError where a value is of none of the types; `said` tells what it must be."""
    if not isinstance(value, wanted) or (isinstance(value, bool) and wanted is not bool):
        raise ConfigError(f"{name} must be {said}, got {type(value).__name__} {shown(value)}")


def near_files(file: Path) -> str:
    """Return a hint at what is there in place of a file that is missing; empty where nothing is."""
    suffix = file.suffix
    said = "" if os.path.isdir(file.parent) else f" There is no folder {file.parent}."
    while not os.path.isdir(file.parent) and file.parent != file.parent.parent:
        file = file.parent
    try:
        there = [each for each in file.parent.iterdir() if not each.name.startswith(".")]
    except OSError:  # which may not be looked into
        return said
    names = [each.name for each in there if each.is_dir() or each.suffix == suffix]
    if near := get_close_matches(file.name, names, n=1):
        return f"{said} Did you mean {file.parent / near[0]}?"
    files = sorted(name for name in names if name.endswith(suffix))
    return f"{said} In {file.parent} there are {', '.join(files)}." if files else said
