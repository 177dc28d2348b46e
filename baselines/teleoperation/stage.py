"""The scene that people are in: an environment whose roles are moved by hands. No network here.

Not safe for threads: whoever serves it calls it from one thread alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from rcare_marl.agents.agent import Array
from rcare_marl.envs import make
from rcare_marl.envs.datasets import Recording
from rcare_marl.envs.registry import lead_roles, task_class
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.rendering.scenery import Scenery

from ..pages.strict import MessageError, field_of, flag, number, one_of, parse_as, whole
from .tracked import Embodied, LedTool, Tracked, led

MOST_VALUES = 512  # of an action
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


Message = Hand | Command | Tracked
KINDS: Mapping[str, type[Message]] = {"hand": Hand, "command": Command, "tracked": Tracked}


def parse(text: str) -> Message:
    """Return the message that a text is; MessageError if it is none, which says why."""
    return parse_as(text, KINDS)


@dataclass(frozen=True)
class Scenario:
    """What is played.

    Attributes:
        task: Name of the task.
        roles: Those that people play.
        cast: Who plays, by role, and where; see `rcare_marl.make`.
        options: Settings of the task.
        policies: Of roles that nobody plays; robots have their script, people their default partner.
        seed: Of the first episode; each further one has the next.
        record: A dataset for all episodes, see `rcare_marl.envs.datasets`.
    """

    task: str
    roles: Sequence[str]
    cast: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    policies: Mapping[str, str] = field(default_factory=dict)
    seed: int = 0
    record: Path | None = None

    def __post_init__(self) -> None:
        known = task_class(self.task).roles()
        for role in (*self.roles, *self.policies):
            check_name(f"role in task {self.task!r}", role, known)
        if not self.roles or len(set(self.roles)) < len(self.roles):
            raise ConfigError(f"name the roles that people play, each once, got {list(self.roles)}")
        if both := sorted(set(self.roles) & set(self.policies)):
            raise ConfigError(f"{', '.join(both)}: either a person plays or a policy")


class Stage:
    """The scene.

    Attributes:
        roles: Those that people play.
        control_dt: Time of a control step [s].
        number: Of the present scene: it grows with each step and each reset.
        scenes: How many times the shapes that a page draws were made: pages that know fewer know old ones.
    """

    def __init__(self, scenario: Scenario) -> None:
        """Build it and begin the first episode; errors as of `make` and of `Recording`."""
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
        self._scenery: Scenery | None = None
        self.scenes = 0
        self._recording: Recording | None = None
        try:
            self.roles = tuple(scenario.roles)
            names = {**policies, **dict.fromkeys(self.roles, "hand")}
            if scenario.record is not None:
                self._recording = Recording(self._env, scenario.record, names)
            self.control_dt, self._seed = self._env.task.control_dt, scenario.seed - 1
            self.number, self._task = 0, scenario.task
            self.begin()
        except BaseException:
            self.close()
            raise

    @property
    def is_over(self) -> bool:
        """Whether the episode has ended."""
        return self._env.is_over

    @property
    def recorded(self) -> int:
        """How many episodes were recorded."""
        return 0 if self._recording is None else self._recording.dataset.count

    def begin(self) -> None:
        """Begin the next episode."""
        self._seed += 1
        self.number += 1
        self._env.reset(seed=self._seed)
        self._led: dict[str, LedTool | Embodied] = {}
        self._unled: dict[str, str] = {}  # why no headset plays them
        for role in self.roles:
            try:
                self._led[role] = led(self._env.cast[role], self.control_dt)
            except ConfigError as error:  # they have other ways to play it
                self._unled[role] = str(error)

    def mark(self) -> None:
        """Take the running episode for a success, record it so, and begin the next one."""
        if self._recording is not None and not self.is_over:
            self._recording.keep(marked=True)
        self.begin()

    def facts(self, role: str) -> dict[str, Any]:
        """Return what does not change: what a role's action is, and what it observes, as data for JSON."""
        camera = self._env.task.view()
        return {
            "task": self._task,
            "role": role,
            "acts": list(self._env.cast[role].action_names),
            "units": {name: unit for _, name, unit in self._env.describe(role)},
            "control_dt": self.control_dt,
            "records": self._recording is not None,
            "camera": {"eye": camera.eye, "target": camera.target, "fov_deg": camera.fov_deg},
            "no_headset": self._unled.get(role, ""),
        }

    def step(self, hands: Mapping[str, Hand | Tracked | None]) -> None:
        """Let everybody act for one control step; a role without a hand, or its clutch, does nothing."""
        actions = {role: self._action(role, hands.get(role)) for role in self.roles}
        self._env.step(actions)  # type: ignore[arg-type]  # float64 will do
        self.number += 1

    def check(self, role: str, hand: Hand | Tracked) -> None:
        """Refuse a hand whose action is not as long as that of its role, or that its role cannot follow."""
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
        found = env.observe(role)
        vector = found["vector"] if isinstance(found, Mapping) else found
        return {
            "number": self.number,
            "time": round(env.world.time, 6),
            "seed": env.seed,
            "seen": {name: vector[at].tolist() for at, name, _ in env.describe(role)},
            "rewards": {n: float(v) for n, v in task.paid(role, task.state).items()},
            "force_n": float(task.report().get("force_n", 0.0)),
            "is_over": env.is_over,
            "success": bool(task.succeeded()),
            "recorded": self.recorded,
            "body": self._led[role].told() if role in self._led else None,
        }

    def drawn(self, known: int) -> list[bytes]:
        """Return what a page draws: the shapes, where it knows only those of fewer `scenes`; where they are now.

        What the bytes are, `rcare_marl.rendering.scenery` says.
        """
        if self._scenery is None or self._scenery.is_stale:
            self._scenery = Scenery(self._env.world)
            self.scenes += 1
        frame = self._scenery.frame(self.number)
        return [frame] if known == self.scenes else [self._scenery.shapes(), frame]

    def close(self) -> None:
        """Finish the record and free the scene."""
        if self._recording is not None:
            self._recording.close()
        self._env.close()
