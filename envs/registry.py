"""Names of tasks and of policies, and who learns. Other packages add theirs by decorator or entry point."""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Callable, Collection
from functools import lru_cache, partial, wraps
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, runtime_checkable

import gymnasium

from rcare_marl.agents.agent import Array
from rcare_marl.agents.people.behaviour.avatar_tree import AvatarBehaviour, Surroundings
from rcare_marl.agents.people.behaviour.behaviour_tree import RandomPolicy, StayStill
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.policy import Policy
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.engines import ENGINES
from rcare_marl.errors import ConfigError, check_name

from .task import Task, part_name

if TYPE_CHECKING:
    from .care_env import CareEnv


@runtime_checkable
class Offers(Protocol):
    """A task with food or drink that a person can see."""

    def offered_position(self) -> Array:
        """Return where it is in the world [m], shape [3]."""


@runtime_checkable
class FillsMouth(Protocol):
    """A task that knows what is in somebody's mouth."""

    def mouth_is_full(self, role: str) -> bool:
        """Return whether something is in the mouth of who plays a role."""

    def chokes(self, role: str) -> bool:
        """Return whether something went the wrong way there in the last control step."""


TaskClass = TypeVar("TaskClass", bound=type[Task])
PolicyFactory = Callable[["CareEnv", str], Policy]
FactoryT = TypeVar("FactoryT", bound=PolicyFactory)
PolicyLoader = Callable[[Path], PolicyFactory]
LoaderT = TypeVar("LoaderT", bound=PolicyLoader)

_TASKS: dict[str, type[Task]] = {}
_POLICIES: dict[tuple[str, str, str], PolicyFactory] = {}
_POLICY_FILES: dict[str, PolicyLoader] = {}


def _behaviour(env: CareEnv, role: str) -> Policy:
    """Return a person who behaves as the tree of their avatar says; see docs/behaviour.md.

    Raises:
        ConfigError: If the role is played by a robot.
    """
    person, task = env.cast[role], env.task
    if not isinstance(person, Human):
        raise ConfigError(
            f"policy 'behaviour' is for people, and {role!r} is played by {type(person).__name__}"
        )
    others = [a for a in env.cast.values() if isinstance(a, Human) and a is not person]
    around = Surroundings(
        clock=lambda: env.world.time,
        spoon=task.offered_position if isinstance(task, Offers) else None,
        partner=others[0].mouth_position if others else None,
        job=_job(env, role),
    )
    if isinstance(task, FillsMouth):
        full, chokes = partial(task.mouth_is_full, role), partial(task.chokes, role)
        around = dataclasses.replace(around, is_full=full, chokes=chokes)
    return AvatarBehaviour(person, around, task.control_dt)


def _job(env: CareEnv, role: str) -> Policy | None:
    """Return the usual partner in a role, where that is more than to be still or to eat and drink."""
    part = env.task.roles().get(part_name(role))
    (name,) = [name for name, kind in _TASKS.items() if kind is type(env.task)] or [""]
    if part is None or part.partner in (None, "still") or isinstance(env.task, Offers):
        return None
    return policy_factory(name, part_name(role), part.partner)(env, role) if name else None


_COMMON: dict[str, PolicyFactory] = {  # known for every role
    "behaviour": _behaviour,
    "random": lambda env, r: RandomPolicy(env.cast[r].action_size, env.cast[r].action_low),
    "still": lambda env, r: StayStill(env.cast[r].action_size),
}


def _make(task: str, **arguments: Any) -> CareEnv:
    from . import make

    return make(task, **arguments)


def _make_in_turn(task: str, **arguments: Any) -> Any:
    from pettingzoo.utils.conversions import parallel_to_aec

    made: Any = _make(task, **arguments)
    return parallel_to_aec(made)


def register_task(name: str) -> Callable[[TaskClass], TaskClass]:
    """Return a decorator that makes a task known as `name` to `rcare_marl.make`.

    Gymnasium then knows it too, as `rcare_marl/<Name>-v0`, and PettingZoo's way in is there: the module
    `rcare_marl.envs.<name>_v0` with its `parallel_env` and, one agent after the other, its `env`; both
    take what `rcare_marl.make` takes.

    Raises:
        ConfigError: If the name is taken.
    """

    def register(cls: TaskClass) -> TaskClass:
        if name in _TASKS:
            raise ConfigError(f"task {name!r} is already {_TASKS[name].__qualname__}")
        _TASKS[name] = cls
        module = ModuleType(f"rcare_marl.envs.{name}_v0", f"PettingZoo's way in to {name!r}.")
        module.parallel_env = partial(_make, name)  # type: ignore[attr-defined]
        module.env = partial(_make_in_turn, name)  # type: ignore[attr-defined]
        sys.modules[module.__name__] = module
        setattr(sys.modules["rcare_marl.envs"], f"{name}_v0", module)
        title = "".join(word.capitalize() for word in name.split("_"))
        identifier = f"rcare_marl/{title}-v0"
        if identifier not in gymnasium.registry:  # those of the package have theirs without import
            gymnasium.register(
                identifier, entry_point="rcare_marl.envs.gym:SingleAgentEnv", kwargs={"task": name}
            )
        return cls

    return register


def task_class(name: str) -> type[Task]:
    """Return the task class registered as `name`; UnknownNameError if there is none."""
    check_name("task", name, _TASKS)
    return _TASKS[name]


def task_names() -> tuple[str, ...]:
    """Return the names of all registered tasks, sorted."""
    return tuple(sorted(_TASKS))


def check_engine(task: str, engine: str) -> None:
    """Refuse an engine that a task does not run on.

    Raises:
        UnknownNameError: If there is no such task or engine.
        ConfigError: If the task does not run on it.
    """
    check_name("engine", engine, ENGINES)
    if engine not in task_class(task).engines:
        able = ", ".join(name for name in task_names() if engine in task_class(name).engines)
        raise ConfigError(f"{task!r} does not run on engine {engine!r}; these do: {able}")


def lead_roles(task: str) -> tuple[str, ...]:
    """Return the roles whose policy is in question: the robots of the task, or all its roles."""
    roles = task_class(task).roles()
    return tuple(name for name, role in roles.items() if role.kind is Robot) or tuple(roles)


def group_map(env: CareEnv, *, extended: Collection[str] = ()) -> dict[str, list[str]]:
    """Return the learned roles by group: robots, recipients, caregivers.

    Roles of one kind share a group only if all their spaces are equal, as TorchRL wants them stacked;
    if they are not, each role of that kind is a group of its own, called as the role.

    Args:
        env: The environment.
        extended: Roles whose observation is made longer outside of the environment.
    """
    kinds: dict[str, list[str]] = {}
    for role in env.possible_agents:
        kind = "robots" if isinstance(env.cast[role], Robot) else f"{role.rsplit('_', 1)[0]}s"
        kinds.setdefault(kind, []).append(role)
    groups: dict[str, list[str]] = {}
    for kind, (first, *others) in kinds.items():
        same = all(
            space(first) == space(role) and (first in extended) == (role in extended)
            for role in others
            for space in (env.observation_space, env.action_space)
        )
        groups |= {kind: [first, *others]} if same else {role: [role] for role in (first, *others)}
    return groups


def register_policy(task: str, role: str, name: str) -> Callable[[FactoryT], FactoryT]:
    """Return a decorator that makes a policy known as `name` for a role of a task.

    The decorated factory takes the environment and the role, once the scene is built, and returns
    the policy. A package of its own lists the module under the entry point `rcare_marl.policies`.

    Raises:
        ConfigError: If the name is taken for that role.
    """

    def register(factory: FactoryT) -> FactoryT:
        if (task, role, name) in _POLICIES:
            raise ConfigError(f"policy {name!r} of {role!r} in {task!r} is there already")
        _POLICIES[task, role, name] = factory
        return factory

    return register


def guard_policy(task: str, role: str, name: str, check: Callable[[CareEnv], None]) -> None:
    """Have the cast checked before a policy plays; as `<name>_anyway` it plays unchecked.

    Args:
        task: Name of the task.
        role: Who plays it.
        name: Of the policy, which is registered already.
        check: Raises a ConfigError where the policy is refused.

    Raises:
        UnknownNameError: If there is no such policy.
    """
    known = [n for t, r, n in _POLICIES if (t, r) == (task, role)]
    check_name(f"policy of {role!r} in task {task!r}", name, known)
    plain = _POLICIES[task, role, name]

    @wraps(plain, updated=())
    def checked(env: CareEnv, role: str) -> Policy:
        check(env)
        return plain(env, role)

    _POLICIES[task, role, name], _POLICIES[task, role, f"{name}_anyway"] = checked, plain


def register_policy_file(suffix: str) -> Callable[[LoaderT], LoaderT]:
    """Return a decorator that makes files of an ending, such as `.npz`, known as policies.

    The decorated function takes the path and returns the policy's factory. The path then stands
    wherever the name of a policy does.

    Raises:
        ConfigError: If the ending is taken, or has no dot.
    """
    if not suffix.startswith("."):
        raise ConfigError(f"the ending of a file begins with a dot, got {suffix!r}")

    def register(loader: LoaderT) -> LoaderT:
        if suffix in _POLICY_FILES:
            raise ConfigError(f"files {suffix!r} are policies already")
        _POLICY_FILES[suffix] = loader
        return loader

    return register


def policy_factory(task: str, role: str, name: str | Path) -> PolicyFactory:
    """Return the factory of a policy from its name or its file.

    Raises:
        UnknownNameError: If the role has no policy of that name; it lists those that it has.
        ConfigError: If the file is missing or is no policy.
    """
    known = policy_names(task, role)
    load = _POLICY_FILES.get(Path(name).suffix)
    if load is not None:
        return load(Path(name))
    name = str(name)
    check_name(f"policy of {role!r} in task {task!r}", name, known)
    return _POLICIES.get((task, role, name)) or _COMMON[name]


def unguarded(task: str, role: str, name: str) -> PolicyFactory:
    """Return the factory of a policy by its name, whatever `guard_policy` checks; errors likewise."""
    return inspect.unwrap(policy_factory(task, part_name(role), name))


def is_policy_file(policy: object) -> bool:
    """Return whether a policy is given as a file of a trained one."""
    _load_plugins()
    return isinstance(policy, str | Path) and Path(policy).suffix in _POLICY_FILES


def policy_names(task: str, role: str) -> tuple[str, ...]:
    """Return the names of the policies of a role of a task, sorted."""
    _load_plugins()
    own = {n for t, r, n in _POLICIES if (t, r) == (task, role)}
    part = _TASKS[task].roles().get(role) if task in _TASKS else None
    common = [n for n in _COMMON if n != "behaviour" or part is None or part.kind is Human]
    return tuple(sorted(own.union(common)))


@lru_cache(maxsize=1)
def _load_plugins() -> None:
    for plugin in entry_points(group="rcare_marl.policies"):
        plugin.load()
