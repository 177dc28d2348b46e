"""Trained policies that ship, known to `make(..., policies=...)` as `learned`.

Each is a file `<task>.npz`, or `<task>_level<k>.npz` where the levels of a home have one each, or
`<task>_everybody.npz`, which was trained with a population and several robots. That one is `learned` where it
ships, and the one of the default cast is `specialist`. Beside each are its card (`.yaml`), its training curve
(`.csv`) and the record of its evaluation (`.json`). Other casts than those of the training are warned of, or
refused where it hardly ever works; see `elsewhere`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from rcare_marl.agents.policy import Policy
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import register_policy, task_names
from rcare_marl.errors import ConfigError

from ..policy_file import BASE, SUFFIX, LearnedPolicy, PolicyFile
from .elsewhere import ANYWAY as ANYWAY
from .elsewhere import check_cast, refusal

FOLDER = Path(__file__).parent
NAME = "learned"
SPECIALIST = "specialist"  # the policy of the default cast, where another one is for everybody
EVERYBODY = "everybody"
ROLE = "robot"
LEVEL = re.compile(rf"(?P<task>\w+?)_(?:level(?P<level>\d+)|{EVERYBODY})")


def shipped(task: str, folder: Path | None = None) -> dict[int | None, Path]:
    """Return the files of the trained policies of a task's default cast by level; None is all levels.

    Args:
        task: Name of the task.
        folder: Where they are; those of the package if None.
    """
    out: dict[int | None, Path] = {}
    for file in sorted((folder or FOLDER).glob(f"{task}*{SUFFIX}")):
        leveled = LEVEL.fullmatch(file.stem)
        if file.stem == task:
            out[None] = file
        elif leveled is not None and leveled["level"] and leveled["task"] == task:
            out[int(leveled["level"])] = file
    return out


def for_everybody(task: str, folder: Path | None = None) -> Path | None:
    """Return the file of the policy of a task for everybody; None if there is none."""
    file = (folder or FOLDER) / f"{task}_{EVERYBODY}{SUFFIX}"
    return file if file.is_file() else None


def file_for(
    task: str, level: int, folder: Path | None = None, *, specialist: bool = False
) -> Path:
    """Return the file of the policy for a task at a level.

    Args:
        task: Name of the task.
        level: Of the home.
        folder: Where the files are; those of the package if None.
        specialist: Whether the one of the default cast is wanted, where there is one for everybody.

    Raises:
        ConfigError: If none ships for it.
    """
    everybody = for_everybody(task, folder)
    if everybody is not None and not specialist:
        return everybody
    files = shipped(task, folder)
    if level not in files and None not in files:
        levels = ", ".join(str(known) for known in files) or "none"
        raise ConfigError(
            f"no trained policy of {task!r} ships for level {level}; there are: {levels}"
        )
    return files.get(level) or files[None]


def fits(env: CareEnv, task: str, role: str = ROLE, folder: Path | None = None) -> bool:
    """Return whether a trained policy ships that can play a role of this very environment."""
    if role not in env.cast:
        return False
    try:
        PolicyFile.read(file_for(task, env.task.place.level, folder)).check(env, role)
    except ConfigError:
        return False
    return True


def best_policy(env: CareEnv, task: str, role: str = ROLE) -> str:
    """Return the name of the policy that a robot is shown with.

    That is `learned` where one ships that fits its task, level and robot, and that does not hardly ever
    work there; `scripted` elsewhere.
    """
    if not fits(env, task, role):
        return BASE
    path = file_for(task, env.task.place.level)
    return BASE if refusal(env, PolicyFile.read(path), path.stem) else NAME


def _maker(
    task: str, *, anyway: bool = False, specialist: bool = False
) -> Callable[[CareEnv, str], Policy]:
    def make(env: CareEnv, role: str) -> Policy:
        path = file_for(task, env.task.place.level, specialist=specialist)
        file = PolicyFile.read(path)
        try:
            policy = LearnedPolicy(env, role, file)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from error
        check_cast(env, file, path.stem, anyway=anyway)
        return policy

    where = ", with any cast" if anyway else ""
    make.__doc__ = f"Return a network that was trained in {task}{where}; see docs/models.md."
    return make


def _register() -> None:
    for task in task_names():
        if shipped(task) or for_everybody(task):
            register_policy(task, ROLE, NAME)(_maker(task))
            register_policy(task, ROLE, ANYWAY)(_maker(task, anyway=True))
        if shipped(task) and for_everybody(task):
            register_policy(task, ROLE, SPECIALIST)(_maker(task, specialist=True))


_register()
