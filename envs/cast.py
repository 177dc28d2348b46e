"""Who plays: from names and options to agents and policies."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rcare_marl.agents.agent import Agent, Array
from rcare_marl.agents.people.actuation.drive import ActuationConfig
from rcare_marl.agents.people.actuation.muscle_model import Tendon
from rcare_marl.agents.people.actuation.muscular import Excitation
from rcare_marl.agents.people.avatar import AvatarConfig, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.sampling.population import find_avatar
from rcare_marl.agents.people.strength import StrengthMap
from rcare_marl.agents.policy import Policy
from rcare_marl.agents.robots.control import Compliance
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import Mount, RobotConfig, load_robot, urdf_robot
from rcare_marl.agents.sensing.marker import MarkerConfig
from rcare_marl.agents.sensing.suite import SensorSuite
from rcare_marl.config import load
from rcare_marl.errors import (
    ConfigError,
    UnknownArgumentError,
    UnknownNameError,
    check_name,
    shown,
)

from .registry import PolicyFactory, is_policy_file, policy_factory
from .task import Role, Task, part_name

if TYPE_CHECKING:
    from .care_env import CareEnv

ARGUMENTS = tuple("options policies physics_dt render_mode home level room engine".split())
ELSEWHERE = {  # what others take where we do not
    "seed": "an episode gets its seed by env.reset(seed=...)",
    "num_envs": "rcare_marl.make_vector and make_batch make many",
    "max_episode_steps": "a task has a time limit of its own; gymnasium.wrappers.TimeLimit cuts it",
}

CastEntry = str | Path | RobotConfig | AvatarConfig | Mapping[str, Any] | None


@dataclass(frozen=True)
class RobotCast:
    """How a robot is cast.

    Attributes:
        model: A robot's name, a YAML file, or a `RobotConfig`; the role's default if None.
        control: Control mode; the role's default if None.
        moves: Parts that actions move, such as `(right_arm, base)`; the main arm if None.
        compliance: How the tool yields under `impedance` and `admittance`: the fields of a `Compliance`,
            see docs/control.md.
        posture: Name of the start posture, or joint positions [rad or m] by joint.
        posture_noise: Standard deviation of the start posture [rad or m].
        mount: A mount of the model by name, or a place of its own in the same frame.
        meshes: Whether to draw the makers' meshes: `auto` if they are installed, `never`, `required`,
            or the path of a URDF of the user's own to take them from.
        self_collision: Whether links of the robot collide with each other.
        urdf: A URDF of the user's own in place of a model.
        joints: With a URDF, the joints of its arm, base to tip.
        tool_link: With a URDF, the link that carries the tool.
        tool_at: With a URDF, where the tool's frame lies in that link [m].
        tool_rpy_deg: With a URDF, how it is turned there: z forward, x up [degrees].
        gripper: With a URDF, its gripper: the fields of a `GripperConfig`.
        sensors: Kinds of sensors, or mappings of their options; see docs/sensors.md.
        markers: Fiducial markers on its links.
    """

    model: Any = None
    control: str | None = None
    compliance: Compliance = Compliance()
    moves: tuple[str, ...] | None = None
    posture: str | dict[str, float] | None = None
    posture_noise: float = 0.0
    mount: str | Mount | None = None
    meshes: str = "auto"
    self_collision: bool = False
    urdf: str | Path | None = None
    joints: tuple[str, ...] | None = None
    tool_link: str | None = None
    tool_at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tool_rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gripper: Any = None
    sensors: tuple[Any, ...] = ()
    markers: tuple[MarkerConfig, ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.gripper, str):
            raise ConfigError(
                f"gripper is that of a urdf, got {self.gripper!r}; to command the gripper of a robot "
                "name it among `moves`, such as ['arm', 'gripper']"
            )
        if self.urdf is not None:
            if isinstance(self.posture, str) and self.posture != "home":
                raise UnknownNameError("posture of a urdf", self.posture, ("home",))

            if self.model is not None:
                raise ConfigError("give a model or a urdf, not both")
            if self.joints is None or self.tool_link is None:
                raise ConfigError(
                    "a urdf needs `joints`, those of its arm from base to tip, and `tool_link`"
                )
            return
        for name in ("joints", "tool_link", "gripper"):
            if getattr(self, name) is not None:
                raise ConfigError(f"{name} goes with a urdf; a model states its own")

    def config(self, role: str, default: Any) -> RobotConfig:
        """Return the robot that is meant, the role's `default` if none is named."""
        if self.urdf is not None:
            assert self.joints is not None and self.tool_link is not None  # checked above
            return urdf_robot(
                self.urdf,
                self.joints,
                self.tool_link,
                tool_at=self.tool_at,
                tool_rpy_deg=self.tool_rpy_deg,
                gripper=self.gripper,
                home=self.posture if isinstance(self.posture, Mapping) else None,
            )
        model = self.model if self.model is not None else default
        return model if isinstance(model, RobotConfig) else load_robot(_named(role, model))


@dataclass(frozen=True)
class HumanCast:
    """How a person is cast.

    Attributes:
        model: An avatar's name, a YAML file, a person of a population (`population:test:17`), or an
            `AvatarConfig`; the role's default if None. `make` also takes people of whom another one plays
            in each episode, such as `population:train`; see `envs.company`.
        actuation: How the joints are driven: `skeletal` pulls them towards target angles, `muscle` moves
            them by muscles.
        excitation: With muscles, what an action is: an excitation in [0, 1] of each `unit` or of each
            `group` of them, or as for `skeletal` the rates of target angles, a `posture` that the
            person's own controller pursues. If None `posture` where a script plays the person, and
            `unit` where they learn or a policy file plays.
        tendon: With muscles, how tendons yield: `rigid`, `quasi_static` or `implicit`.
        musculature: With muscles, the user's own table (.csv) or MASS file (.xml); ours if None.
        strength: How MMT grades become strength: `mmt`, what a clinician means by them, or `linear`, the
            paper's map.
        posture: A posture's name or YAML file; the role's default if None.
        movable: Joints or DoFs that move; the role's default if None.
        moves: What actions do beside moving the joints: `walk`, `kneel`, `grasp`, `speak`; the role's
            default if None, and `speak` where the task listens and a script plays the person.
        tissue: Segments whose flesh yields: `left_shoulder` (upper arm), `left_elbow` (forearm), `*_hip`,
            `*_knee`, `spine1` to `spine3`, or `left_arm`, `left_leg`, `torso`.
        physiology_observed: Whether the person observes their own vital signs, fatigue and pain.
        sensors: Kinds of sensors, or mappings of their options; see docs/sensors.md.
        markers: Fiducial markers on the person's segments.
    """

    model: Any = None
    actuation: Literal["skeletal", "muscle"] = "skeletal"
    excitation: Excitation | None = None
    tendon: Tendon = "quasi_static"
    musculature: str | Path | None = None
    strength: StrengthMap = "mmt"
    posture: str | None = None
    movable: tuple[str, ...] | None = None
    moves: tuple[str, ...] | None = None
    tissue: tuple[str, ...] = ()
    physiology_observed: bool = False
    sensors: tuple[Any, ...] = ()
    markers: tuple[MarkerConfig, ...] = ()

    def __post_init__(self) -> None:
        for name in ("movable", "moves", "tissue"):
            given = getattr(self, name) or ()
            if len(set(given)) < len(given):
                raise ValueError(f"{name} must name each once, got {shown(given)}")
        if self.actuation == "muscle":
            return
        for name in ("excitation", "tendon", "musculature"):
            if getattr(self, name) != type(self).__dataclass_fields__[name].default:
                raise ValueError(f"{name} is for people with actuation: muscle")


def make_cast(
    task_name: str, task: type[Task], entries: Mapping[str, CastEntry], policies: Mapping[str, Any]
) -> tuple[dict[str, Agent], dict[str, PolicyFactory]]:
    """Return the agents of a task by role, and the policies of those who are not learned.

    Args:
        task_name: Name of the task, for messages and for policies.
        task: The task.
        entries: For each role a model (name, YAML file or config), or a mapping of the fields of
            `RobotCast` or `HumanCast` and perhaps `policy`; None leaves an optional role empty.
            Several robots are called `robot_0`, `robot_1`; the first of them has the task's part.
        policies: Further policies by role: a name, a file or a factory.

    Raises:
        UnknownNameError: If a role, model, option or policy does not exist.
        ConfigError: If an option has an impossible value, or a needed role is left empty.
    """
    roles = _played(task_name, task.roles(), entries)
    cast: dict[str, Agent] = {}
    factories: dict[str, PolicyFactory] = {}
    for role, part in roles.items():
        entry = entries.get(role, {} if part.default is not None else None)
        if entry is None:
            if not part.optional:
                raise ConfigError(f"task {task_name!r} cannot do without its role {role!r}")
            continue
        fields = dict(entry) if isinstance(entry, Mapping) else {"model": entry}
        policy = fields.pop("policy", None)
        if policy is not None:
            factories[role] = find_policy(task_name, role, policy)
        player = policies.get(role, policy)
        is_scripted = player is not None and not is_policy_file(player)
        cast[role] = _agent(role, part, fields, is_scripted=is_scripted)
    for role, policy in policies.items():
        check_name(f"role in the cast of {task_name!r}", role, cast)
        if role in factories:
            raise ConfigError(f"two policies for {role!r}: one in the cast, one in policies")
        factories[role] = find_policy(task_name, role, policy)
    return cast, factories


def _played(
    task: str, roles: Mapping[str, Role[Any]], entries: Mapping[str, CastEntry]
) -> dict[str, Role[Any]]:
    """Return the roles to be played: robots may come several times, as `robot_0`, `robot_1`."""
    out: dict[str, Role[Any]] = {}
    for name, part in roles.items():
        several = [r for r in entries if part_name(r) == name and r != name]
        if not several or part.kind is not Robot:
            out[name] = part
            continue
        if name in entries:
            raise ConfigError(f"cast either {name!r} or {', '.join(several)}, not both")
        numbers = sorted(int(role.rsplit("_", 1)[1]) for role in several)
        missing = set(range(1, len(numbers))) - set(numbers)
        if missing or numbers[0] > 1:
            raise ConfigError(f"several robots are numbered from {name}_0 on, got {several}")
        out |= {f"{name}_{k}": part for k in range(max(numbers) + 1)}
    for role in entries:
        check_name(f"role in task {task!r}", role, out)
    return out


def check_entries(task: str, roles: Mapping[str, Role[Any]], entries: Mapping[str, Any]) -> None:
    """Refuse what is neither a role of a task nor an argument of `make`, which it may be meant for.

    Raises:
        UnknownArgumentError: It names both, and what is near.
    """
    for role in entries:
        if part_name(role) not in roles:
            known = (*roles, *ARGUMENTS)
            raise UnknownArgumentError.of(task, role, known, ELSEWHERE.get(role, ""))


def find_policy(task: str, role: str, policy: Any) -> PolicyFactory:
    """Return a policy's factory from its name or file, or the factory itself.

    Raises:
        UnknownNameError: If there is no policy of that name.
        ConfigError: If it is neither a name nor callable, or its file cannot be read.
    """
    if isinstance(policy, str | Path):
        return policy_factory(task, part_name(role), policy)
    if not callable(policy):
        raise ConfigError(
            f"policy of {role!r} must be a name, a file or a function of environment and role, got "
            f"{shown(policy)}"
        )
    with suppress(ValueError):  # what Python knows no signature of
        try:
            inspect.signature(policy).bind(None, role)
        except TypeError as error:
            raise ConfigError(
                f"policy of {role!r}: {shown(policy)} does not take the environment and the role: {error}"
            ) from error
    return policy


def checked_policy(role: str, made: Any) -> Policy:
    """Return what a factory made; ConfigError if it can be no policy."""
    if not isinstance(made, Policy):
        raise ConfigError(
            f"what makes the policy of {role!r} returned {type(made).__name__} {shown(made)}: a policy "
            "has reset(rng) and act()"
        )
    return made


class Anew:
    """A policy of somebody outside of the environment, made anew where the scene is another one."""

    def __init__(self, env: CareEnv, role: str, factory: PolicyFactory) -> None:
        """Make the policy for the present scene."""
        self._env, self._role, self._factory = env, role, factory
        self._task, self._policy = env.task, factory(env, role)

    def reset(self, rng: np.random.Generator) -> None:
        if self._env.task is not self._task:
            self._task, self._policy = self._env.task, self._factory(self._env, self._role)
        self._policy.reset(rng)

    def act(self) -> Array:
        return self._policy.act()

    def memory(self) -> tuple[Sequence[object], Array]:
        """Return what the policy goes by beside what it sees, see `memory_of`."""
        return memory_of(self._policy)

    def recall(self, holds: Sequence[bool]) -> None:
        """Have the policy go on from what holds, see `remind`."""
        remind(self._policy, holds)


def memory_of(script: Policy | None) -> tuple[Sequence[object], Array]:
    """Return what a script keeps in mind: what holds, and values of -1 to 1; nothing if it does not tell."""
    tells = getattr(script, "memory", None)
    return ((), np.zeros(0)) if tells is None else tells()


def remind(script: Policy, holds: Sequence[bool]) -> None:
    """Have a script go on from what somebody who imitates it keeps in mind, if it can."""
    recall = getattr(script, "recall", None)
    if recall is not None:
        recall(holds)


def make_policy(env: CareEnv, task: str, role: str, policy: Any) -> Policy:
    """Return the policy that somebody outside plays for a role of a built environment.

    Raises:
        UnknownNameError: If there is no policy of that name.
        ConfigError: If it is neither a name nor callable, or its file cannot be read.
    """
    factory = find_policy(task, role, policy)
    return factory(env, role) if env.company is None else Anew(env, role, factory)


def _agent(name: str, role: Role[Any], fields: Mapping[str, Any], *, is_scripted: bool) -> Agent:
    if role.kind is Robot:
        robot = load(RobotCast, fields, f"cast of {name!r}")
        config = robot.config(name, role.default)
        has_all = role.moves is not None and set(role.moves) <= set(config.parts)
        agent = Robot(
            name,
            config,
            control=robot.control or role.control,
            moves=role.moves if robot.moves is None and has_all else robot.moves,
            posture=None if robot.urdf is not None else robot.posture,
            posture_noise=robot.posture_noise,
            mount=robot.mount,
            meshes=robot.meshes,
            self_collision=robot.self_collision,
            gripper=role.gripper if robot.moves is None else "held",
            contact_force=role.contact_force,
            contact_torque=role.contact_torque,
            compliance=robot.compliance,
        )
        agent.equip(_suite(name, robot.sensors), robot.markers)
        return agent
    person = load(HumanCast, fields, f"cast of {name!r}")
    model = person.model if person.model is not None else role.default
    avatar = model if isinstance(model, AvatarConfig) else find_avatar(_named(name, model))
    excitation = person.excitation or ("posture" if is_scripted else "unit")
    moves = person.moves if person.moves is not None else tuple(role.moves or ())
    is_excited = person.actuation == "muscle" and excitation != "posture"
    if person.moves is None and role.speaks and is_scripted and not is_excited:
        moves = (*moves, "speak")
    human = Human(
        name,
        avatar,
        posture=load_posture(person.posture or role.posture),
        movable=person.movable if person.movable is not None else role.movable,
        moves=moves,
        tissue=person.tissue,
        physiology_observed=person.physiology_observed,
        actuation=ActuationConfig(
            kind=person.actuation,
            excitation=excitation,
            tendon=person.tendon,
            musculature=None if person.musculature is None else str(person.musculature),
            strength=person.strength,
        ),
    )
    human.equip(_suite(name, person.sensors), person.markers)
    return human


def speaking(entries: Mapping[str, CastEntry], cast: Mapping[str, Agent]) -> dict[str, CastEntry]:
    """Return cast entries that say who speaks, which else depends on who plays the person."""
    out = dict(entries)
    for role, agent in cast.items():
        if isinstance(agent, Human) and "speak" in agent.moves:
            entry = entries.get(role, {})
            fields = entry if isinstance(entry, Mapping) else {"model": entry}
            out[role] = {"moves": list(agent.moves), **fields}
    return out


def _suite(role: str, entries: tuple[Any, ...]) -> SensorSuite | None:
    return SensorSuite(entries, role) if entries else None


def _named(role: str, model: Any) -> str | Path:
    if not isinstance(model, str | Path):
        raise ConfigError(
            f"cast of {role!r}: expected a name or a YAML file, got {type(model).__name__} {shown(model)}"
        )
    return model
