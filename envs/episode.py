"""Episodes as files: the seed and the actions of all roles, played again with no policy in the loop.

Example:
    >>> env = rcare_marl.make("feeding", policies={"robot": "scripted", "recipient": "cooperative"})
    >>> recorder = EpisodeRecorder(env)
    >>> env.reset(seed=0)
    >>> while not env.is_over:
    ...     env.step({})
    >>> recorder.episode().save("feeding.npz")
    >>> replay(RecordedEpisode.read("feeding.npz")).difference
    ''
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.agent import Array
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.sampling.population import avatar_fields, person_hash
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.atomic_file import read_arrays, write_arrays
from rcare_marl.config import load, plain
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.observable import VECTOR
from rcare_marl.provenance import changes, versions
from rcare_marl.reading import refusing

from . import make
from .care_env import CareEnv

VERSION = 1  # of the format
KIND = "episode"
WHAT = "a recorded episode"
SHOWN = 3  # parts, and numbers, that differ, in a message
SEEN = "observation."  # begins the names of arrays of what was observed

Digests = npt.NDArray[np.uint64]


@dataclass(frozen=True)
class Header:
    """All of a recorded episode but its arrays.

    Attributes:
        setup: What `rcare_marl.make` was given, but policies: task, options, physics_dt, cast with place.
        seed: Of the reset.
        roles: Everybody who acted, learned or not.
        parts: What the digests are of: each body, and what each role observes.
        measures: What the numbers are: whether the episode is over, success, metrics, rewards.
        eased: The settings of the task where a curriculum had changed them; None elsewhere.
        policies: Names of the policies that played, as far as they were told; a replay needs none.
        versions: Versions of what the numbers depend on.
        facts: Who played and what the numbers mean, see `facts_of`; none where nothing was to be seen.
    """

    setup: dict[str, Any]
    seed: int
    roles: tuple[str, ...]
    parts: tuple[str, ...]
    measures: tuple[str, ...]
    eased: dict[str, Any] | None = None
    policies: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RecordedEpisode:
    """An episode as it was played.

    Attributes:
        header: How it came about.
        actions: Of each role, as they were obeyed, shape [steps, actions].
        digests: Of the exact state of each part, shape [steps + 1, parts]; the first is that of the reset.
        numbers: The measures, shape [steps + 1, measures].
        observations: Where they were kept: of each role, and of each of its arrays as `role.array`,
            what was observed, shape [steps + 1, ...].

    Raises:
        ConfigError: If the shapes do not fit each other, or a number of an action is not finite.
    """

    header: Header
    actions: Mapping[str, Array]
    digests: Digests
    numbers: Array
    observations: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if tuple(self.actions) != self.header.roles:
            raise ConfigError(f"actions of {list(self.actions)} for {list(self.header.roles)}")
        for role, rows in self.actions.items():
            if rows.ndim != 2 or len(rows) != self.steps or not np.isfinite(rows).all():
                raise ConfigError(
                    f"actions of {role!r} must be {self.steps} rows of finite numbers, got {rows.shape}"
                )
        for name, found, columns in (
            ("digests", self.digests, self.header.parts),
            ("numbers", self.numbers, self.header.measures),
        ):
            if found.shape != (self.steps + 1, len(columns)):
                raise ConfigError(
                    f"{name} must have shape {(self.steps + 1, len(columns))}, got {found.shape}"
                )
        for name, seen in self.observations.items():
            if name.split(".")[0] not in self.header.roles or len(seen) != self.steps + 1:
                raise ConfigError(
                    f"observations of {name!r} must be {self.steps + 1} rows of one of "
                    f"{list(self.header.roles)}, got shape {seen.shape}"
                )

    @property
    def steps(self) -> int:
        """Control steps."""
        return len(self.digests) - 1

    def measure(self, name: str) -> Array:
        """Return one of the measures after the reset and each step, shape [steps + 1].

        Raises:
            UnknownNameError: If there is none of that name.
        """
        check_name("measure of the episode", name, self.header.measures)
        return np.asarray(self.numbers[:, self.header.measures.index(name)])

    def rewards(self, role: str) -> Array:
        """Return the reward of a role in each step, shape [steps]."""
        return self.measure(f"reward of {role}")[1:]

    @property
    def is_success(self) -> bool:
        """Whether it ended in success, or an operator said so."""
        return bool(self.measure("success")[-1]) or bool(self.header.facts.get("marked"))

    @property
    def ending(self) -> tuple[bool, bool]:
        """Whether it ended by success or failure, and whether it was cut short, by its time or a person."""
        is_late = bool(self.header.facts.get("late", True))
        return not is_late, is_late

    def save(self, path: str | Path) -> None:
        """Write the file, whole or not at all; the same episode gives the same bytes.

        Raises:
            ConfigError: If it cannot be written, or the set-up holds objects such as a `RobotConfig`.
        """
        about = {**plain(dataclasses.asdict(self.header), "episode"), "kind": KIND}
        arrays: dict[str, npt.NDArray[Any]] = {"digests": self.digests, "numbers": self.numbers}
        arrays |= {f"{SEEN}{name}": seen for name, seen in self.observations.items()}
        for number, rows in enumerate(self.actions.values()):
            brief = rows.astype(np.float32)  # those of a network are no longer than that
            arrays[f"actions_{number}"] = brief if np.array_equal(brief, rows) else rows
        write_arrays(Path(path), {**about, "version": VERSION}, arrays)

    @classmethod
    def read(cls, path: str | Path) -> RecordedEpisode:
        """Return the episode in a file.

        Raises:
            ConfigError: If there is no such file, or it is damaged, of another kind or another version.
        """
        file = Path(path)
        if not os.path.isfile(file):
            near = sorted(each.name for each in file.parent.glob("*.npz"))
            beside = f"; {file.parent} has {', '.join(near[:SHOWN])}" if near else ""
            raise ConfigError(f"there is no file {file}{beside}")
        about, arrays = read_arrays(file, WHAT, VERSION)
        if about.pop("kind", None) != KIND:
            raise ConfigError(f"{file} holds no recorded episode: is it the file of a policy?")
        with refusing(file, WHAT):
            header = load(Header, about, "header")
            digests = np.asarray(arrays["digests"])
            if digests.dtype != np.uint64:
                raise ConfigError(f"digests must be whole numbers of 64 bits, got {digests.dtype}")
            actions = {
                role: arrays[f"actions_{k}"].astype(np.float64, casting="same_kind")
                for k, role in enumerate(header.roles)
            }
            numbers = arrays["numbers"].astype(np.float64, casting="same_kind")
            seen = {n.removeprefix(SEEN): a for n, a in arrays.items() if n.startswith(SEEN)}
            return cls(header, actions, digests, numbers, seen)

    def make(self, render_mode: str | None = None) -> CareEnv:
        """Return the environment in which it was played, with every role left to be commanded.

        Raises:
            ConfigError: If it cannot be made here, or a role acts otherwise than it did.
        """
        setup = load(_Setup, self.header.setup, "set-up of the episode")
        env = make(
            setup.task,
            options=setup.options,
            physics_dt=setup.physics_dt,
            render_mode=render_mode,
            engine=setup.engine,
            randomise=setup.randomise,
            **setup.cast,
        )
        try:
            self._check(env)
            if self.header.eased is not None:
                env.task.change_options(load(type(env.task).Options, self.header.eased, "eased"))
        except BaseException:
            env.close()
            raise
        return env

    def _check(self, env: CareEnv) -> None:
        if set(env.cast) != set(self.actions):
            raise ConfigError(
                f"the episode was played by {sorted(self.actions)}, the cast is {sorted(env.cast)}"
            )
        for role, rows in self.actions.items():
            if rows.shape[1] != env.cast[role].action_size:
                raise ConfigError(
                    f"an action of {role!r} had {rows.shape[1]} values and has "
                    f"{env.cast[role].action_size} here: it was another model, or another version of it"
                )


@dataclass(frozen=True)
class _Setup:
    """What `make` takes, so that a file can ask for nothing else."""

    task: str
    options: dict[str, Any]
    physics_dt: float
    cast: dict[str, Any]
    engine: str = "bullet"
    randomise: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in (*vars(self), "policies", "render_mode"):
            if name in self.cast:
                raise ConfigError(f"{name!r} is no role of a cast")


class EpisodeRecorder:
    """Notes every episode that an environment plays from now on, however it is driven."""

    def __init__(self, env: CareEnv, *, sees: bool = False) -> None:
        """Begin to watch; `sees` keeps what everybody observes too, and who they are."""
        self._env, self._sees = env, sees
        self._actions: list[dict[str, Array]] = []
        self._digests: list[list[int]] = []
        self._numbers: list[list[float]] = []
        self._seen: dict[str, list[npt.NDArray[Any]]] = {}
        env.watchers.append(self._note)

    def _note(self, env: CareEnv) -> None:
        if env.world.step_count == 0:
            self._actions, self._digests, self._numbers, self._seen = [], [], [], {}
        else:
            self._actions.append(env.commands)
        self._digests.append(list(_digests(env).values()))
        self._numbers.append(list(_numbers(env).values()))
        for name, seen in _observed(env).items() if self._sees else ():
            self._seen.setdefault(name, []).append(seen)

    def close(self) -> None:
        """Watch no longer."""
        self._env.watchers.remove(self._note)

    def __len__(self) -> int:
        """Return the control steps of the running or last episode."""
        return len(self._actions)

    def episode(self, policies: Mapping[str, str] | None = None) -> RecordedEpisode:
        """Return the running or last episode, as far as it was played.

        Args:
            policies: Who decided for each role, for the reader; those of the environment if None.

        Raises:
            ConfigError: If no episode has begun since, or `rcare_marl.make` did not make the environment.
        """
        env = self._env
        if not self._digests or not env.setup:
            raise ConfigError(
                "nothing to record: reset an environment of rcare_marl.make() after its recorder was "
                "made"
            )
        setup = {**env.setup, "cast": {r: _played(entry) for r, entry in env.setup["cast"].items()}}
        is_late = not bool(env.task.is_success(env.task.state) | env.task.failed())
        given = load(type(env.task).Options, env.setup["options"], "options")
        header = Header(
            setup=setup,
            seed=env.seed,
            roles=tuple(env.cast),
            parts=tuple(_digests(env)),
            measures=tuple(_numbers(env)),
            eased=None if env.task.options == given else dataclasses.asdict(env.task.options),
            policies=dict(policies or {}),
            versions=versions(),
            facts={**facts_of(env), "late": is_late} if self._sees else {},
        )
        actions = {
            role: np.array([step[role] for step in self._actions]).reshape(-1, agent.action_size)
            for role, agent in env.cast.items()
        }
        digests, numbers = np.array(self._digests, np.uint64), np.array(self._numbers, np.float64)
        seen = {name: np.stack(rows) for name, rows in self._seen.items()}
        return RecordedEpisode(header, actions, digests, numbers, seen)


def facts_of(env: CareEnv) -> dict[str, Any]:
    """Return what a reader of an episode wants to know beside its numbers, as data for JSON.

    `control_dt` [s]; `lead`, who is to learn; for each role `observes` as [name, size, unit], `arrays` as
    [name, shape, unit], `acts` as names, and `lows`, the least value of an action; `agents` as they describe
    themselves; `people` with the clinical profile and all else that they are, and a hash of it. The facts of
    an episode also say whether it ended `late`, by its time, and so neither by success nor failure.
    """
    task, cast = env.task, env.cast
    people = {role: agent.avatar for role, agent in cast.items() if isinstance(agent, Human)}
    return {
        "control_dt": task.control_dt,
        "lead": next(
            (r for r, agent in cast.items() if isinstance(agent, Robot)), next(iter(cast))
        ),
        "observes": {r: [[n, at.stop - at.start, u] for at, n, u in env.describe(r)] for r in cast},
        "arrays": {
            r: [[n, list(shape), u] for shape, n, u in env.describe_arrays(r)] for r in cast
        },
        "acts": {role: list(agent.action_names) for role, agent in cast.items()},
        "lows": {role: agent.action_low for role, agent in cast.items()},
        "agents": {role: agent.describe() for role, agent in cast.items()},
        "people": {r: {"hash": person_hash(p), **avatar_fields(p)} for r, p in people.items()},
    }


def _observed(env: CareEnv) -> dict[str, npt.NDArray[Any]]:
    """Return what each role observes now, its arrays as `role.array`."""
    out: dict[str, npt.NDArray[Any]] = {}
    for role in env.cast:
        seen = env.observe(role)
        parts = seen if isinstance(seen, Mapping) else {VECTOR: seen}
        out |= {role if n == VECTOR else f"{role}.{n}": part for n, part in parts.items()}
    return out


@dataclass(frozen=True)
class Replay:
    """What came of playing an episode again.

    Attributes:
        steps: Control steps that were played and are equal bit for bit.
        recorded: Control steps of the recorded episode.
        difference: What differs first, and in which step; empty if nothing does.
        elsewhere: Versions that differ, as texts: what may explain it.
    """

    steps: int
    recorded: int
    difference: str
    elsewhere: tuple[str, ...]


def replay(
    episode: RecordedEpisode,
    *,
    env: CareEnv | None = None,
    on_step: Callable[[CareEnv], None] | None = None,
) -> Replay:
    """Play an episode again by its actions alone, and compare every step.

    Args:
        episode: The episode.
        env: An environment of `RecordedEpisode.make`, left open; a new one if None.
        on_step: Called after the reset and after each step, for pictures. With it the episode is played
            to its end; without it the first difference ends it.

    Raises:
        ConfigError: If its environment cannot be made here.
    """
    own = env or episode.make()
    difference, equal = "", 0
    try:
        own.reset(seed=episode.header.seed)
        for step in range(episode.steps + 1):
            if step:
                own.step({role: rows[step - 1] for role, rows in episode.actions.items()})
            if on_step is not None:
                on_step(own)
            if not difference:
                difference = compare(episode, step, own)
                equal = step if not difference else equal
            if own.is_over or (difference and on_step is None):
                break
    finally:
        if env is None:
            own.close()
    elsewhere = changes(episode.header.versions, versions())
    return Replay(equal, episode.steps, difference, elsewhere)


def compare(episode: RecordedEpisode, step: int, env: CareEnv) -> str:
    """Return what is otherwise after a step than it was, empty if nothing is."""
    digests, numbers = _digests(env), _numbers(env)
    header = episode.header
    then = dict(zip(header.parts, episode.digests[step].tolist(), strict=True))
    parts = [name for name in {**then, **digests} if then.get(name) != digests.get(name)]
    texts = []
    was = dict(zip(header.measures, episode.numbers[step].tolist(), strict=True))
    for name in {**was, **numbers}:
        old, new = was.get(name), numbers.get(name)
        if old != new and not (old != old and new != new):  # a number that is none equals another
            texts.append(f"{name} is {new}, was {old}")
    found = "; ".join(_brief(each) for each in (parts, texts) if each)
    return f"step {step}: {found}" if found else ""


def _brief(texts: Sequence[str]) -> str:
    more = f" and {len(texts) - SHOWN} more" if len(texts) > SHOWN else ""
    return ", ".join(texts[:SHOWN]) + more


def _digests(env: CareEnv) -> dict[str, int]:
    """Return digests of all that moves and of what each role observes, by name."""
    states: dict[str, npt.NDArray[Any]]
    states = {f"body {body.name}": body.state() for body in env.world.bodies}
    ends = np.cumsum([env.describe(role)[-1][0].stop for role in env.cast])
    seen = np.split(env.state(), ends[:-1])
    states |= {f"what {role} observes": part for role, part in zip(env.cast, seen, strict=True)}
    return {
        name: int.from_bytes(hashlib.blake2b(state.tobytes(), digest_size=8).digest(), "little")
        for name, state in states.items()
    }


def _numbers(env: CareEnv) -> dict[str, float]:
    """Return the outcome so far by name: over, success, metrics, and the reward of each role."""
    task = env.task
    return {
        "over": float(env.is_over),
        "success": float(task.succeeded()),
        **env.told(),
        **{name: float(value) for name, value in task.report().items()},
        **{
            f"reward of {role}": float(sum(task.paid(role, task.state).values()))
            for role in env.cast
        },
    }


def _played(entry: Any) -> Any:
    """Return a cast's entry without its policy."""
    if not isinstance(entry, Mapping):
        return entry
    return {name: value for name, value in entry.items() if name != "policy"}
