"""What was measured of shipped policies with casts other than their own, and who is refused for it.

Of a trained policy that is what differs from its training; of a scripted one the robot.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from rcare_marl import assets
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.sampling.population import PREFIX, find_avatar, names_several
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.config import load, read_yaml
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.company import model_of
from rcare_marl.envs.registry import task_class
from rcare_marl.envs.task import part_name
from rcare_marl.envs.task_options import TaskOptions
from rcare_marl.errors import CastWarning, ConfigError

from ..policy_file import PolicyFile

MEASURED = Path(__file__).with_name("elsewhere.yaml")
SCRIPTS = Path(__file__).parents[1] / "scripted" / "robots.yaml"
SELDOM = 0.1  # share of episodes up to which a cast is refused; our own choice
ANYWAY = "learned_anyway"  # name under which a refused policy plays
ROBOT = "robot"
MOSTLY = 0.9  # share of episodes from which on a script is played with a robot; our own choice
USUAL_LEVEL = 1
COMMON = frozenset(field.name for field in dataclasses.fields(TaskOptions))


@dataclass(frozen=True)
class Figure:
    """What a policy came to with a cast.

    Attributes:
        cast: What differs from its training: roles, `home`, `level`, and options as `options.mount`; also
            the level if something else comes off there otherwise. Of a script the robot, and the level if
            its task is measured at each.
        done: Episodes that ended in success.
        of: Episodes.
        force: Greatest force on the person in any of them [N].
        seeds: Of the episodes, as a text.
    """

    cast: dict[str, Any]
    done: int
    of: int
    force: float
    seeds: str

    def __str__(self) -> str:
        return (
            f"{self.done} of {self.of} episodes ended well (seeds {self.seeds}), with up to "
            f"{self.force:.0f} N on the person"
        )


@lru_cache(maxsize=2)
def figures(file: Path = MEASURED) -> dict[str, tuple[Figure, ...]]:
    """Return what was measured of each trained policy, by the name of its file; of `SCRIPTS`, by the task."""
    data = read_yaml(file)
    data.pop("about", None)
    out = {}
    for name, groups in data.items():
        rows = [(seeds, *row) for seeds, given in groups.items() for row in given]
        out[name] = tuple(
            load(
                Figure,
                {"seeds": seeds, "cast": cast, "done": done, "of": of, "force": force},
                file.name,
            )
            for seeds, cast, done, of, force in rows
        )
    return out


def differences(env: CareEnv, file: PolicyFile) -> dict[str, Any]:
    """Return what of an environment the policy of a file was not trained with, as `Figure.cast` has it."""
    recipe: Mapping[str, Any] = file.recipe
    variants: Sequence[Mapping[str, Any]] = recipe.get("variants") or ({},)
    casts = [{**recipe.get("cast", {}), **each} for each in variants]
    roles = task_class(file.task).roles()
    out: dict[str, Any] = {}
    place = env.task.place
    alike = [cast for cast in casts if (cast.get("level") or USUAL_LEVEL) == place.level] or casts
    for role, here in _played(env).items():
        known = {
            str(model_of(cast.get(role)) or (roles[role].default if role in roles else None))
            for cast in alike
        }
        is_one_of = isinstance(env.cast[role], Human) and any(map(names_several, known))
        if here not in known and not is_one_of:
            out[role] = here
    home = place.facts().get("home")
    if home not in {cast.get("home") for cast in casts}:
        out["home"] = home or "a bare floor"
    if place.level not in {cast.get("level") or USUAL_LEVEL for cast in casts}:
        out["level"] = place.level
    kind = type(env.task).Options
    given = [{**recipe.get("options", {}), **each.get("options", {})} for each in variants]
    learned_in = [load(kind, options, "options") for options in given]
    for field in dataclasses.fields(kind):
        now = getattr(env.task.options, field.name)
        met = [getattr(o, field.name) for o in learned_in]
        is_among = isinstance(now, tuple) and any(set(now) <= set(then) for then in met)
        if field.name not in COMMON and now not in met and not is_among:
            out[f"options.{field.name}"] = now
    return out


def _played(env: CareEnv) -> dict[str, str]:
    """Return who plays each role, by the names of `_model`."""
    named = {role: str(model_of(entry)) for role, entry in env.setup.get("cast", {}).items()}
    called = {role: name for role, name in named.items() if name.startswith(PREFIX)}
    called |= {} if env.company is None else env.company.called
    return {role: called.get(role) or _model(agent) for role, agent in env.cast.items()}


def _model(agent: object) -> str:
    """Return the name by which a cast calls who plays; of an avatar that does not ship its own."""
    if isinstance(agent, Human):
        ours = (name for name in assets.names("avatars") if find_avatar(name) == agent.avatar)
        return next(ours, f"{agent.avatar.name} (an avatar of their own)")
    return agent.files.model.name if isinstance(agent, Robot) else type(agent).__name__


def measured(
    name: str, differing: Mapping[str, Any], played: Mapping[str, str], level: int
) -> Figure | None:
    """Return what was measured of the policy of that name with just these differences, at this level.

    Else, where it seldom came off, with some of who plays: in the same place and with the same options,
    but with other people or robots besides; whom it was trained with, too. A figure without a level is of
    all at which it was trained, and one with `population` of whoever is sampled.
    """
    differing = {key: _anybody(value) for key, value in differing.items()}
    here = {**differing, "level": level}
    found = [f for f in figures().get(name, ()) if f.cast == here]
    found += [f for f in figures().get(name, ()) if f.cast == dict(differing)]
    place = {key: value for key, value in here.items() if _is_place(key)}
    for figure in figures().get(name, ()):
        cast = figure.cast if "level" in differing else {"level": level, **figure.cast}
        fits = all({**played, **here}.get(key) == value for key, value in cast.items())
        same = {key: value for key, value in cast.items() if _is_place(key)} == place
        if fits and same and figure.done <= SELDOM * figure.of:
            found.append(figure)
    return found[0] if found else None


def _anybody(value: Any) -> Any:
    """Return `population` for people of one, and anything else as it is."""
    return PREFIX[:-1] if isinstance(value, str) and value.startswith(PREFIX) else value


def _is_place(key: str) -> bool:
    return key in ("home", "level") or key.startswith("options.")


def refusal(env: CareEnv, file: PolicyFile, name: str) -> str:
    """Return why a shipped policy is not played in an environment; empty if it may be."""
    differing = differences(env, file)
    figure = measured(name, differing, _played(env), env.task.place.level)
    if figure is None or env.company is not None or figure.done > SELDOM * figure.of:
        return ""
    unknown = f"was not trained with {_told(differing)}, and " if differing else ""
    robot, level = _played(env).get(ROBOT, ""), env.task.place.level
    is_poor = any(is_refused(file.task, row) for row in of_script(file.task, robot, level))
    advice = (
        "Its script is refused there, too: take another robot" if is_poor else "Take 'scripted'"
    )
    return (
        f"the learned policy of {file.task!r} {unknown}hardly ever works with "
        f"{_told(figure.cast)}: {figure}. {advice}, or {ANYWAY!r} to play it all the same"
    )


def check_cast(env: CareEnv, file: PolicyFile, name: str, *, anyway: bool = False) -> None:
    """Warn of a cast that a shipped policy was not trained with; refuse where it hardly ever works.

    Args:
        env: The environment.
        file: The policy.
        name: Of its file, without the ending.
        anyway: Whether to warn only.

    Raises:
        ConfigError: If it came off in a tenth of the measured episodes at most.
    """
    differing = differences(env, file)
    reason = refusal(env, file, name)
    if reason and not anyway:
        raise ConfigError(reason)
    if not differing and not reason:
        return
    figure = measured(name, differing, _played(env), env.task.place.level)
    said = f"measured with {_told(figure.cast)}: {figure}" if figure else "that was not measured"
    unknown = f"was not trained with {_told(differing)}; " if differing else ""
    warnings.warn(f"the learned policy of {file.task!r} {unknown}{said}", CastWarning, stacklevel=2)


def of_script(task: str, robot: str, level: int | None = None) -> list[Figure]:
    """Return what was measured of the scripted policy of a task with a robot.

    Args:
        task: Name of the task.
        robot: Name of the robot.
        level: The level of accessibility; all that were measured if None.
    """
    rows = [row for row in figures(SCRIPTS).get(task, ()) if row.cast["robot"] == robot]
    return [row for row in rows if level is None or row.cast.get("level", level) == level]


def is_refused(task: str, figure: Figure) -> bool:
    """Return whether a script came off too seldom to be played with that robot, if not the task's own."""
    is_own = figure.cast["robot"] == task_class(task).roles()[ROBOT].default
    return not is_own and figure.done < MOSTLY * figure.of


def check_robot(env: CareEnv, task: str) -> None:
    """Refuse a robot with which the scripted policy of a task did not come off in nine of ten episodes.

    The task's own robot is not refused, nor one that is given a place of its own.

    Raises:
        ConfigError: If it is refused, with what was measured, and with the robots that do better.
    """
    level = env.task.place.level
    for role, agent in env.cast.items():
        if part_name(role) != ROBOT or not isinstance(agent, Robot) or agent.chosen_mount:
            continue
        poor = [r for r in of_script(task, agent.files.model.name, level) if is_refused(task, r)]
        if poor:
            others = {row.cast["robot"] for row in figures(SCRIPTS)[task]}
            rated = {each: of_script(task, each, level) for each in others}
            able = (
                n
                for n, rows in rated.items()
                if rows and not any(is_refused(task, r) for r in rows)
            )
            better = ", ".join(sorted({*able, str(task_class(task).roles()[ROBOT].default)}))
            raise ConfigError(
                f"the scripted policy of {task!r} does not come off often enough with {_told(poor[0].cast)}: "
                f"{poor[0]}; at least {MOSTLY:.0%} are asked for. Take one of {better}, a place of your own "
                "for the robot, or 'scripted_anyway' to play it all the same"
            )


def _told(differing: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{name.removeprefix('options.')} {value}" for name, value in differing.items()
    )
