"""The scene that people are in: an environment whose roles are moved by hands. No network here.

Not safe for threads: whoever serves it calls it from one thread alone.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from rcare_marl import assets
from rcare_marl.agents.agent import Array
from rcare_marl.agents.people.actuation import muscle_kernel
from rcare_marl.agents.people.actuation.muscular import MuscleDrive
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.physiology import QUANTITIES
from rcare_marl.agents.policy import Policy
from rcare_marl.envs import make
from rcare_marl.envs.datasets import Recording
from rcare_marl.envs.episode import RecordedEpisode, compare
from rcare_marl.envs.homes import home_names
from rcare_marl.envs.registry import lead_roles, task_class, task_names
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.rendering.scenery import Scenery

from ..evaluation.evaluate import lead_policies, make_players, model_names, played_cast
from ..pages.strict import MessageError, field_of, flag, number, one_of, parse_as, whole
from ..trained import best_policy
from .tracked import Embodied, LedTool, Tracked, led

AUDIENCE = "audience"  # whoever watches, and plays no role
MOST_VALUES = 512  # of an action
MOST_MUSCLES = 8  # that are told, the most active of each person; our own choice
QUIET = 0.5  # after which a hand that says nothing moves nothing [s]; our own choice
Wish = Literal["pause", "go", "reset", "success"]
WISHES: tuple[Wish, ...] = get_args(Wish)


def _values(value: Any, name: str) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) > MOST_VALUES:
        raise MessageError(f"{name} is a list of at most {MOST_VALUES} numbers")
    return tuple(number(-1.0, 1.0)(each, name) for each in value)


@dataclass(frozen=True)
class Hand:
    """What a hand does.

    Attributes:
        seen: Number of the last scene that the page showed.
        clutch: Whether the dead-man's switch is held: without it nothing moves.
        values: The action, each of its numbers from -1 to 1.
    """

    seen: int = field_of(whole(0, 2**31))
    clutch: bool = field_of(flag)
    values: tuple[float, ...] = field_of(_values)


@dataclass(frozen=True)
class Command:
    """What the person wants beside moving."""

    wish: Wish = field_of(one_of(WISHES))


@dataclass(frozen=True)
class Pace:
    """How fast it is to go: simulated over real time."""

    speed: float = field_of(number(0.05, 4.0))


def _name(value: Any, name: str) -> str:
    if not isinstance(value, str) or not re.fullmatch(r"[a-z0-9_]{0,60}", value):
        raise MessageError(f"{name} is a name that ships, or empty")
    return value


@dataclass(frozen=True)
class Choice:
    """What who watches wants to see; what is empty is as the task has it."""

    task: str = field_of(_name)
    robot: str = field_of(_name)
    recipient: str = field_of(_name)
    home: str = field_of(_name)
    policy: str = field_of(_name)
    seed: int = field_of(whole(0, 2**31))

    def of(self) -> Scenario:
        """Return what is to be played."""
        cast = {name: getattr(self, name) for name in ("robot", "recipient", "home")}
        policies = dict.fromkeys(lead_roles(self.task), self.policy) if self.policy else {}
        chosen = {name: value for name, value in cast.items() if value}
        return Scenario(self.task, (), chosen, policies=policies, seed=self.seed)


Message = Hand | Command | Tracked | Pace | Choice
KINDS: Mapping[str, type[Message]] = {
    "hand": Hand,
    "command": Command,
    "tracked": Tracked,
    "pace": Pace,
    "choice": Choice,
}


def parse(text: str) -> Message:
    """Return the message that a text is; MessageError if it is none, which says why."""
    return parse_as(text, KINDS)


@dataclass(frozen=True)
class Scenario:
    """What is played.

    Attributes:
        task: Name of the task.
        roles: Those that people play; none where all watch, see `AUDIENCE`.
        cast: Who plays, by role, and where; see `rcare_marl.make`.
        options: Settings of the task.
        policies: Of roles that nobody plays; robots have their script, people their default partner.
        seed: Of the first episode; each further one has the next.
        record: A dataset for all episodes, see `rcare_marl.envs.datasets`.
        replays: Recorded episodes of the task to be shown again, in place of all but the task.
    """

    task: str
    roles: Sequence[str]
    cast: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    policies: Mapping[str, str] = field(default_factory=dict)
    seed: int = 0
    record: Path | None = None
    replays: Sequence[RecordedEpisode] = ()

    def __post_init__(self) -> None:
        known = task_class(self.task).roles()
        for role in (*self.roles, *self.policies):
            check_name(f"role in task {self.task!r}", role, known)
        if len(set(self.roles)) < len(self.roles):
            raise ConfigError(f"name the roles that people play, each once, got {list(self.roles)}")
        if both := sorted(set(self.roles) & set(self.policies)):
            raise ConfigError(f"{', '.join(both)}: either a person plays or a policy")
        if others := {each.header.setup["task"] for each in self.replays} - {self.task}:
            raise ConfigError(
                f"recorded episodes of {self.task!r} are wanted, got {sorted(others)}"
            )


def choices() -> dict[str, list[str]]:
    """Return what ships, by field of `Choice`; policies are of the robots of the task."""
    return {
        "task": list(task_names()),
        "robot": ["", *assets.names("robots")],
        "recipient": ["", *assets.names("avatars")],
        "home": ["", *home_names()],
        "policy": ["", "scripted", "learned", "random", "still"],
    }


def _activations(person: Human) -> list[tuple[str, float]]:
    """Return the most active muscles of a person, 0 to 1; none of who acts by joint torques."""
    if not isinstance(person.drive, MuscleDrive):
        return []
    now = person.drive.state[muscle_kernel.ACTIVATION]
    most = np.argsort(-now, kind="stable")[:MOST_MUSCLES]
    return [(person.drive.model.names[k], round(float(now[k]), 3)) for k in most]


class Stage:
    """The scene.

    Attributes:
        roles: Those that people play.
        control_dt: Time of a control step [s].
        number: Of the present scene: it grows with each step and each reset.
    """

    def __init__(self, scenario: Scenario) -> None:
        """Build it and begin the first episode; errors as of `make` and of `Recording`."""
        self.roles = tuple(scenario.roles)
        self._lead, self._players = lead_roles(scenario.task)[0], dict[str, Policy]()
        self._replays, self._replayed, self._differs = tuple(scenario.replays), -1, ""
        if self._replays:
            self._env, self.played = self._replays[0].make(), self._replays[0].header.policies
            names = self.played
        else:
            names = self._cast(scenario) if self.roles else self._watch(scenario)
        self._scenery: dict[bool, Scenery] = {}
        self._recording: Recording | None = None
        try:
            if scenario.record is not None:
                self._recording = Recording(self._env, scenario.record, names)
            self.control_dt, self._seed = self._env.task.control_dt, scenario.seed - 1
            self.number, self._task = 0, scenario.task
            self.begin()
        except BaseException:
            self.close()
            raise

    def _watch(self, scenario: Scenario) -> dict[str, str]:
        """Build it with policies in all roles, and return their names."""
        task, wanted = scenario.task, scenario.policies
        cast = played_cast(task, scenario.cast, lead_policies(task, "", wanted))
        self._env = make(task, options=scenario.options, **cast)
        try:
            chosen = lead_policies(task, best_policy(self._env, task), wanted)
            names, self._players = make_players(self._env, task, chosen)
        except BaseException:
            self._env.close()
            raise
        self.played = names
        return names

    def _cast(self, scenario: Scenario) -> dict[str, str]:
        """Build it with people in their roles and policies in the others, and return all their names."""
        leads = lead_roles(scenario.task)
        others = {
            name: "scripted" if name in leads else role.partner
            for name, role in task_class(scenario.task).roles().items()
            if name not in scenario.roles and (role.default is not None or name in scenario.cast)
        }
        policies = {name: chosen for name, chosen in others.items() if chosen is not None}
        policies |= scenario.policies
        cast = dict(scenario.cast)
        for role in scenario.roles:  # who helps is there where a person plays them
            if task_class(scenario.task).roles()[role].default is None:
                cast.setdefault(role, {})
        self._env = make(scenario.task, options=scenario.options, policies=policies, **cast)
        self.played = {**policies, **dict.fromkeys(self.roles, "hand")}
        return self.played

    @property
    def is_over(self) -> bool:
        """Whether the episode has ended."""
        return self._env.is_over or (self.is_replay and self._at == self._episode.steps)

    @property
    def is_replay(self) -> bool:
        """Whether recorded episodes are shown again."""
        return bool(self._replays)

    @property
    def _episode(self) -> RecordedEpisode:
        return self._replays[self._replayed % len(self._replays)]

    @property
    def recorded(self) -> int:
        """How many episodes were recorded."""
        return 0 if self._recording is None else self._recording.dataset.count

    def begin(self) -> None:
        """Begin the next episode."""
        self._seed += 1
        if self.is_replay:
            before, self._replayed = self._episode.header, self._replayed + 1
            now = self._episode.header
            if (now.setup, now.eased) != (before.setup, before.eased):
                self._env.close()
                self._env = self._episode.make()
            self._seed = now.seed
        self.again()

    def again(self) -> None:
        """Begin the same episode anew."""
        self.number += 1
        self._at, self._differs = 0, ""
        self._env.reset(seed=self._seed)
        self._check_replay()
        order = list(self._env.task.roles())
        for role, player in self._players.items():  # as in an evaluation
            player.reset(np.random.default_rng([self._seed, order.index(role)]))
        self._led: dict[str, LedTool | Embodied] = {}
        self._unled: dict[str, str] = {}  # why no headset plays them
        for role in self.roles:
            try:
                self._led[role] = led(self._env.cast[role], self.control_dt)
            except ConfigError as error:  # they have other ways to play it
                self._unled[role] = str(error)

    def _check_replay(self) -> None:
        """Note what is otherwise than it was recorded, first of all."""
        if self.is_replay and not self._differs:
            self._differs = compare(self._episode, self._at, self._env)

    def mark(self) -> None:
        """Take the running episode for a success, record it so, and begin the next one."""
        if self._recording is not None and not self.is_over:
            self._recording.keep(marked=True)
        self.begin()

    def outcome(self) -> str:
        """Return what came of the episode, as a line for people."""
        ended = "success" if self._env.task.succeeded() else "no success"
        told = f"episode of seed {self._seed}: {ended} after {self._env.world.time:.1f} s"
        if self.is_replay:
            told += f"; differs at {self._differs}" if self._differs else "; equal to the record"
        return told

    def facts(self, role: str) -> dict[str, Any]:
        """Return what does not change: what a role's action is, and what it observes, as data for JSON."""
        camera = self._env.task.view()
        acts = list(self._env.cast[role].action_names) if role in self.roles else []
        shown = self._shown(role)
        return {
            "task": self._task,
            "role": role,
            "acts": acts,
            "shows": shown,
            "played": self.played,
            "cast": model_names(self._env),
            "units": {name: unit for _, name, unit in self._env.describe(shown)},
            "control_dt": self.control_dt,
            "records": self._recording is not None,
            "camera": {"eye": camera.eye, "target": camera.target, "fov_deg": camera.fov_deg},
            "no_headset": self._unled.get(role, ""),
            "cared": [person.body.name for person in self._cared()],
            "vital_units": {name: quantity.unit for name, quantity in QUANTITIES.items()},
            "replays": len(self._replays),
        }

    def step(self, hands: Mapping[str, Hand | Tracked | None]) -> None:
        """Let everybody act for one control step; a role without a hand, or its clutch, does nothing."""
        if self.is_replay:
            actions = {role: rows[self._at] for role, rows in self._episode.actions.items()}
        else:
            actions = {role: self._action(role, hands.get(role)) for role in self.roles}
            watched = self._env.agents if not self.roles else ()
            actions |= {role: self._players[role].act() for role in watched}
        self._env.step(actions)
        self.number += 1
        self._at += 1
        self._check_replay()

    def check(self, role: str, hand: Hand | Tracked) -> None:
        """Refuse a hand whose action is not as long as that of its role, or that its role cannot follow."""
        if role not in self.roles:
            raise MessageError("who watches moves nothing")
        if isinstance(hand, Tracked):
            if role in self._unled:
                raise MessageError(self._unled[role])
            return
        wanted = self._env.cast[role].action_size
        if len(hand.values) != wanted:
            raise MessageError(f"the action of {role} has {wanted} values")

    def _action(self, role: str, hand: Hand | Tracked | None) -> Array:
        agent = self._env.cast[role]
        if isinstance(hand, Tracked):
            return np.clip(self._led[role].action(hand), agent.action_low, 1.0)
        if hand is None or not hand.clutch:
            return np.zeros(agent.action_size)
        return np.clip(np.array(hand.values), agent.action_low, 1.0)

    def seen(self, role: str) -> dict[str, Any]:
        """Return what a role observes now and how it stands, as data for JSON."""
        env, task = self._env, self._env.task
        shown = self._shown(role)
        found = env.observe(shown)
        vector = found["vector"] if isinstance(found, Mapping) else found
        return {
            "number": self.number,
            "time": round(env.world.time, 6),
            "seed": env.seed,
            "seen": {name: vector[at].tolist() for at, name, _ in env.describe(shown)},
            "rewards": {n: float(v) for n, v in task.paid(shown, task.state).items()},
            "touches": self._touches(),
            "force_n": float(task.report().get("force_n", 0.0)),
            "vitals": {person.name: person.physiology.values() for person in self._cared()},
            "muscles": {person.name: _activations(person) for person in self._cared()},
            "steps": self._episode.steps if self.is_replay else None,
            "differs": self._differs,
            "is_over": self.is_over,
            "success": bool(task.succeeded()),
            "recorded": self.recorded,
            "body": self._led[role].told() if role in self._led else None,
        }

    def _shown(self, role: str) -> str:
        """Return whose observations and rewards somebody is shown: their own, or those of the lead role."""
        return role if role in self.roles else self._lead

    def _cared(self) -> list[Human]:
        task = self._env.task
        return [person for person in task.people if person.name not in task.bystanders]

    def _touches(self) -> list[list[float]]:
        """Return where who is cared for is touched [m], the force, and its normal part [N]: 7 numbers."""
        found = [t for person in self._cared() for t in self._env.world.touches(person.body)]
        rows = [[*t.position, *(np.array(t.normal) * t.force + t.friction), t.force] for t in found]
        return [[round(float(x), 4) for x in row] for row in rows]

    def drawn(
        self, known: tuple[int, ...], *, is_coarse: bool
    ) -> tuple[list[bytes], tuple[int, ...]]:
        """Return what a page draws, and the versions that it knows then: see `Scenery.messages`.

        `is_coarse` says that it has no graphics card.
        """
        world, scenery = self._env.world, self._scenery.get(is_coarse)
        if scenery is None or scenery.world is not world:
            scenery = self._scenery[is_coarse] = Scenery(world, is_coarse)
        return scenery.messages(known, self.number)

    def close(self) -> None:
        """Finish the record and free the scene."""
        if self._recording is not None:
            self._recording.close()
        self._env.close()
