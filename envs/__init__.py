"""Environments: `make` is the way in."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_package, check_type

from . import tasks as tasks  # registers the built-in tasks
from .care_env import CareEnv
from .cast import CastEntry, check_entries, make_cast, speaking
from .company import Company, Scene, drawn_people
from .copying import Past
from .place import BareFloor
from .randomise import Randomisation, randomisation_names
from .registry import (
    check_engine,
    policy_names,
    register_policy,
    register_task,
    task_class,
    task_names,
)
from .state import Seen, State
from .task import STANDING_CAREGIVER, Role, Task
from .task_options import TaskOptions

if TYPE_CHECKING:
    from .homes import CareHome, home_names

__all__ = [
    "STANDING_CAREGIVER",
    "CareEnv",
    "CareHome",
    "Role",
    "Seen",
    "State",
    "Task",
    "TaskOptions",
    "home_names",
    "make",
    "policy_names",
    "randomisation_names",
    "register_policy",
    "register_task",
    "task_names",
]


def __getattr__(name: str) -> object:
    if name in ("CareHome", "home_names"):  # houses take a while to import
        from . import homes

        return getattr(homes, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def make(
    task: str,
    *,
    options: Mapping[str, Any] | None = None,
    policies: Mapping[str, Any] | None = None,
    physics_dt: float = 1 / 240,
    render_mode: str | None = None,
    home: str | None = None,
    level: int | None = None,
    room: str | None = None,
    engine: str = "bullet",
    randomise: Any = None,
    **cast: CastEntry,
) -> CareEnv:
    """Return a new environment, a PettingZoo parallel environment.

    Every role that acts is an agent to be learned, but those that are given a policy.

    Args:
        task: A task name, see `rcare_marl.task_names()`.
        options: Settings of the task, such as `{"reward": "shaped"}`; see its class.
        policies: For roles that are not learned: the name of a policy, see `policy_names`, or a
            function that takes the environment and the role and returns a policy.
        physics_dt: Physics step [s].
        render_mode: `rgb_array` for pictures, `human` for a live page, or None.
        home: Name of the house in which it takes place, see `rcare_marl.home_names()`; a bare floor
            if None.
        level: Level of accessibility: 1 usual, 2 partially barrier-free, 3 barrier-free; 1 if None. That
            of the house, or of the furniture or door that the task builds itself on a bare floor.
        room: Name of the room, such as `dining_1`; the first that suits the task if None.
        engine: What computes the motion: `bullet`, the reference, or `mujoco` where the task allows it.
        randomise: What is another in each episode, such as masses, delays and noise: the name of one
            that ships, a YAML file, or `{"robot_mass": {"factor": [0.7, 1.3]}}`; see docs/randomisation.md.
        **cast: For a role of the task: the name of a robot or avatar, a YAML file, or a mapping
            such as `{"model": "karan", "policy": "cooperative"}`; None leaves an optional role out.
            What is not named is played by the task's default. People of whom another one plays in
            each episode, chosen by its seed: `six`, `population:train`, `population:test:0-9`.

    Raises:
        UnknownNameError: If a task, role, model, option or policy does not exist.
        ConfigError: If a value is impossible.

    Example:
        >>> env = make("feeding", robot="kinova_gen3", recipient="karan")
        >>> env = make("feeding", policies={"recipient": "cooperative"})  # only the robot learns
        >>> env = make("feeding", home="house_07", level=2)
        >>> env = make("feeding", randomise="delay_1")
    """
    for name, value in (("options", options), ("policies", policies)):
        check_type(name, value, (Mapping, type(None)), "a mapping")
    options, policies = dict(options or {}), dict(policies or {})
    cls = task_class(task)
    if render_mode == "human":
        check_package("viser", "the viewer", "view")
    check_engine(task, engine)
    check_entries(task, cls.roles(), cast)
    given = load(cls.Options, options, f"options of {task!r}")
    place = {"home": home, "level": level, "room": room}
    perturbed = Randomisation.of(randomise)
    how: dict[str, Any] = {"physics_dt": physics_dt, "render_mode": render_mode}
    how |= {"engine": engine, "randomise": perturbed}
    rest: dict[str, Any] = {**place, **how, **cast}
    rest |= {"randomise": None if randomise is None else perturbed}
    again = partial(make, task, options=options or None, policies=policies or None, **rest)
    stage = partial(_scene, task, given, policies, (home, level, room))
    if drawn := drawn_people(cls.roles(), cast):
        company = Company(cast, drawn, stage)
        env = company.play(0, lambda scene: CareEnv(*scene, **how, company=company), {})
        cast = company.resolved(cast)
    else:
        env = CareEnv(*stage(cast), **how)
    env.past = Past(env, again)
    spoken: dict[str, Any] = dict(speaking(cast, env.cast))
    spoken |= {name: value for name, value in place.items() if value is not None}
    env.setup = {"task": task, "options": options, "physics_dt": physics_dt, "cast": spoken}
    env.setup |= {} if engine == "bullet" else {"engine": engine}
    env.setup |= {"randomise": perturbed.to_dict()} if perturbed.spreads else {}
    return env


def _scene(
    task: str,
    options: Any,
    policies: Mapping[str, Any],
    where: tuple[str | None, int | None, str | None],
    cast: Mapping[str, Any],
) -> Scene:
    """Return a task with its cast, in its place; see `make`."""
    cls, (home, level, room) = task_class(task), where
    agents, factories = make_cast(task, cls, cast, policies)
    scene = cls(options)
    scene.cast = agents
    if home is not None:
        from .homes import CareHome, find_place

        check_type("home", home, (str, Path), "the name of a house or a YAML file")
        check_type("level", level, (int, type(None)), "1, 2 or 3")

        house = CareHome.load(home, level=1 if level is None else level)
        floor = scene.floor_before if scene.site == "door" else scene.free_floor()
        slack = scene.slack if isinstance(options, TaskOptions) and options.crowded else None
        scene.place = find_place(
            house, scene.room_kinds, floor, room=room, site=scene.site, slack=slack
        )
    elif level is not None and room is None and scene.site:
        scene.place = BareFloor(level)
    elif level is not None or room is not None:
        raise ConfigError("level and room are those of a home: name one, such as home='house_07'")
    return Scene(scene, agents, factories)
