"""Who plays: from names and options to agents and policies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rcare_marl.agents.actuation.drive import ActuationConfig
from rcare_marl.agents.actuation.muscle_model import Tendon
from rcare_marl.agents.agent import Agent
from rcare_marl.agents.avatar import AvatarConfig, load_avatar, load_posture
from rcare_marl.agents.human import Human
from rcare_marl.agents.robot import Robot, RobotConfig, load_robot
from rcare_marl.agents.strength import StrengthMap
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, UnknownNameError

from .registry import PolicyFactory, policy_factory
from .task import Role, Task

CastEntry = str | Path | RobotConfig | AvatarConfig | Mapping[str, Any] | None


@dataclass(frozen=True)
class RobotCast:
    """How a robot is cast.

    Attributes:
        model: A robot's name, a YAML file, or a `RobotConfig`; the role's default if None.
        control: Control mode; the role's default if None.
        meshes: Whether to draw the makers' meshes: `auto` if they are installed, `never`, `required`.
    """

    model: Any = None
    control: str | None = None
    meshes: Literal["auto", "never", "required"] = "auto"


@dataclass(frozen=True)
class HumanCast:
    """How a person is cast.

    Attributes:
        model: An avatar's name, a YAML file, or an `AvatarConfig`; the role's default if None.
        actuation: How the joints are driven: `skeletal` takes rates of target angles, `muscle`
            excitations in [0, 1].
        excitation: With muscles, one action value for each `unit` or for each `group` of them.
        tendon: With muscles, how tendons yield: `rigid`, `quasi_static` or `implicit`.
        musculature: With muscles, the user's own table (.csv) or MASS file (.xml); ours if None.
        strength: How MMT grades become strength: `linear`, the paper's map, or `gravity`.
        posture: A posture's name or YAML file; the role's default if None.
        movable: Joints or DoFs that move; the role's default if None.
        tissue: Segments whose flesh yields: `left_shoulder` (upper arm), `left_elbow` (forearm), `*_hip`,
            `*_knee`, `spine1` to `spine3`, or `left_arm`, `left_leg`, `torso`.
        physiology_observed: Whether the person observes their own vital signs, fatigue and pain.
    """

    model: Any = None
    actuation: Literal["skeletal", "muscle"] = "skeletal"
    excitation: Literal["unit", "group"] = "unit"
    tendon: Tendon = "quasi_static"
    musculature: str | Path | None = None
    strength: StrengthMap = "linear"
    posture: str | None = None
    movable: tuple[str, ...] | None = None
    tissue: tuple[str, ...] = ()
    physiology_observed: bool = False

    def __post_init__(self) -> None:
        if self.actuation == "muscle":
            return
        for name in ("excitation", "tendon", "musculature"):
            if getattr(self, name) != type(self).__dataclass_fields__[name].default:
                raise ValueError(f"{name} is for people with actuation: muscle")


def make_cast(
    task_name: str, task: type[Task], entries: Mapping[str, CastEntry]
) -> tuple[dict[str, Agent], dict[str, PolicyFactory]]:
    """Return the agents of a task by role, and the policies named in their entries.

    Args:
        task_name: Name of the task, for messages and for policies.
        task: The task.
        entries: For each role a model (name, YAML file or config), or a mapping of the fields of
            `RobotCast` or `HumanCast` and perhaps `policy`; None leaves an optional role empty.

    Raises:
        UnknownNameError: If a role, model, option or policy does not exist.
        ConfigError: If an option has an impossible value, or a needed role is left empty.
    """
    roles = task.roles()
    for role in entries:
        if role not in roles:
            raise UnknownNameError(f"role in task {task_name!r}", role, roles)
    cast: dict[str, Agent] = {}
    policies: dict[str, PolicyFactory] = {}
    for role, part in roles.items():
        entry = entries.get(role, {} if part.default is not None else None)
        if entry is None:
            if not part.optional:
                raise ConfigError(f"task {task_name!r} cannot do without its role {role!r}")
            continue
        fields = dict(entry) if isinstance(entry, Mapping) else {"model": entry}
        policy = fields.pop("policy", None)
        if policy is not None:
            policies[role] = find_policy(task_name, role, policy)
        cast[role] = _agent(role, part, fields)
    return cast, policies


def find_policy(task: str, role: str, policy: Any) -> PolicyFactory:
    """Return a policy's factory from its name, or the factory itself.

    Raises:
        UnknownNameError: If there is no policy of that name.
        ConfigError: If it is neither a name nor callable.
    """
    if isinstance(policy, str):
        return policy_factory(task, role, policy)
    if not callable(policy):
        raise ConfigError(
            f"policy of {role!r} must be a name or a function of environment and role, got {policy!r}"
        )
    factory: PolicyFactory = policy
    return factory


def _agent(name: str, role: Role[Any], fields: Mapping[str, Any]) -> Agent:
    if role.kind is Robot:
        robot = load(RobotCast, fields, f"cast of {name!r}")
        model = robot.model if robot.model is not None else role.default
        config = model if isinstance(model, RobotConfig) else load_robot(_named(name, model))
        return Robot(
            name,
            config,
            control=robot.control or role.control,
            meshes=robot.meshes,
        )
    person = load(HumanCast, fields, f"cast of {name!r}")
    model = person.model if person.model is not None else role.default
    avatar = model if isinstance(model, AvatarConfig) else load_avatar(_named(name, model))
    return Human(
        name,
        avatar,
        posture=load_posture(person.posture or role.posture),
        movable=person.movable if person.movable is not None else role.movable,
        tissue=person.tissue,
        physiology_observed=person.physiology_observed,
        actuation=ActuationConfig(
            kind=person.actuation,
            excitation=person.excitation,
            tendon=person.tendon,
            musculature=None if person.musculature is None else str(person.musculature),
            strength=person.strength,
        ),
    )


def _named(role: str, model: Any) -> str | Path:
    if not isinstance(model, str | Path):
        raise ConfigError(
            f"cast of {role!r}: expected a name or a YAML file, got {type(model).__name__} {model!r}"
        )
    return model
