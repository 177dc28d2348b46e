"""The partner zoo: who a policy may meet, by name, and people of several temperaments.

A partner is a body, with its limits and disorders, and a policy that moves it: a cast entry and the name
of a policy, or a policy file.

Example:
    >>> zoo = partner_zoo("feeding", "recipient", avatars=("karan", "kim"))
    >>> [partner.name for partner in zoo][:2]
    ['karan_cooperative', 'karan_passive']
    >>> env = rcare_marl.make("feeding", **zoo[0].cast(), policies=zoo[0].policies())
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from rcare_marl import assets
from rcare_marl.agents.people.avatar import expand_movable
from rcare_marl.agents.people.behaviour.avatar_tree import (
    AvatarBehaviour,
    Surroundings,
    behaviour_of,
)
from rcare_marl.agents.people.behaviour.behaviour_tree import GoAlong
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS, SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.profile import clinical_norms
from rcare_marl.agents.people.sampling.population import avatar_fields, find_avatar
from rcare_marl.agents.policy import Policy
from rcare_marl.cache import cached
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import Offers, policy_names, register_policy, task_class, task_names
from rcare_marl.envs.scenes.meal import OPEN_MOUTH
from rcare_marl.envs.task import Role
from rcare_marl.envs.tasks.feeding import Feeding
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

Mood = Literal["passive", "resisting"]
MOODS: tuple[Mood, ...] = ("passive", "resisting")
INDIVIDUALS = 3  # of each mood, with habits that stay
RECIPIENT = "recipient"

# All our own choices. A spoon that waits 9 cm in front of the mouth is near for everybody.
OPENS_WITHIN = (0.11, 0.16)  # [m] of a passive person; the cooperative one opens at 0.20
OPENING = (0.45, 0.65)  # share of the active range that a passive mouth opens; else 0.8
LEAST_OPENING = OPEN_MOUTH + math.radians(2)  # what anybody opens who opens at all [rad]
FIRST_SPELL = (1.0, 3.0)  # [s] of resistance from the start on
SPELL = (1.0, 2.5)  # [s] of each further one
LULL = (2.0, 4.0)  # [s] between two


@dataclass(frozen=True)
class Habits:
    """What differs between two people of one temperament.

    Attributes:
        opens_within: Distance of the spoon at which a passive mouth opens [m].
        opening: Share of the active range that it opens.
        first: Length of the first spell of resistance, from the start of an episode [s].
        spell: Length of each further one [s].
        lull: Time between two [s].
    """

    opens_within: float
    opening: float
    first: float
    spell: float
    lull: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Habits:
        """Return habits drawn uniformly."""
        ranges = (OPENS_WITHIN, OPENING, FIRST_SPELL, SPELL, LULL)
        return cls(*(float(rng.uniform(*each)) for each in ranges))

    def resists_at(self, time: float) -> bool:
        """Return whether a resisting person resists at a time of the episode [s]."""
        if time < self.first:
            return True
        return (time - self.first) % (self.lull + self.spell) >= self.lull


class Temperament:
    """A person of one mood: a policy for the recipient of any task.

        passive    at a meal: opens the mouth late and little, and does not turn to the spoon; elsewhere
                   lets the limbs go where they are taken, and holds trunk and head if only those move
        resisting  by spells: at a meal turns away and presses the lips; elsewhere pulls back to where the
                   limbs were; between two spells does what is asked

    It draws its habits anew in each episode, from the seed of the episode. An individual, such as
    `resisting_1`, has habits of its own that stay.

    Attributes:
        habits: Those of the running episode.
    """

    def __init__(self, env: CareEnv, role: str, mood: Mood, *, seed: int | None = None) -> None:
        """Prepare a spawned person.

        Args:
            env: The environment.
            role: Whom to play.
            mood: Of which temperament.
            seed: Draws the habits, once; each episode draws its own if None.

        Raises:
            ConfigError: If a robot plays the role.
        """
        person = env.cast[role]
        if not isinstance(person, Human):
            raise ConfigError(
                f"policy {mood!r} is for people, and {role!r} is played by {type(person).__name__}"
            )
        self._env, self._person, self._mood, self._seed = env, person, mood, seed
        self._slack = GoAlong(person, env.task.control_dt)
        self._has_limbs = any(dof.startswith(SIDES) for dof in person.movable)
        self._offer = env.task.offered_position if isinstance(env.task, Offers) else None
        self._eater: AvatarBehaviour | None = None
        self._start: Mapping[str, float] = {}
        self.habits = Habits.drawn(np.random.default_rng(seed or 0))

    def reset(self, rng: np.random.Generator) -> None:
        own = rng if self._seed is None else np.random.default_rng(self._seed)
        self.habits = Habits.drawn(own)
        self._start = dict(
            zip(self._person.movable, map(float, self._person.positions), strict=True)
        )
        if self._offer is not None:
            self._eater = self._make_eater(self._offer)
            self._eater.reset(rng)

    def _make_eater(self, offer: Callable[[], Array]) -> AvatarBehaviour:
        config, person = behaviour_of(self._person), self._person
        if self._mood == "passive":
            jaw = person.movable.index("jaw_opening") if "jaw_opening" in person.movable else None
            widest = float(person.active[jaw, 1]) if jaw is not None else LEAST_OPENING
            opening = max(self.habits.opening, LEAST_OPENING / max(widest, LEAST_OPENING))
            config = dataclasses.replace(
                config,
                activities=("mouth",),
                opens_within=self.habits.opens_within,
                opening=opening,
            )
        around, task = Surroundings(clock=lambda: self._env.world.time, spoon=offer), self._env.task
        if isinstance(task, Feeding):
            full, chokes = (
                partial(task.mouth_is_full, person.name),
                partial(task.chokes, person.name),
            )
            around = dataclasses.replace(around, is_full=full, chokes=chokes)
        return AvatarBehaviour(person, around, self._env.task.control_dt, config=config)

    def act(self) -> Array:
        resists = self._mood == "resisting" and self.habits.resists_at(self._env.world.time)
        if self._eater is not None:
            self._eater.cues.refuses = resists
            return self._eater.act()
        if resists or not self._has_limbs:  # the head is held
            return self._person.action_towards(self._start, self._env.task.control_dt)
        return self._slack.act()


@dataclass(frozen=True)
class TemperamentFactory:
    """Makes the policy of a mood, perhaps of one individual; it can be pickled.

    Attributes:
        mood: Which.
        seed: Of the habits of an individual; None draws them anew in each episode.
    """

    mood: Mood
    seed: int | None = None

    def __call__(self, env: CareEnv, role: str) -> Policy:
        """Return the policy for a role of a built environment."""
        return Temperament(env, role, self.mood, seed=self.seed)


def mood_names() -> tuple[str, ...]:
    """Return the names of the policies here: each mood and its individuals."""
    return tuple(_factories())


def _factories() -> dict[str, TemperamentFactory]:
    out: dict[str, TemperamentFactory] = {}
    for mood in MOODS:
        out[mood] = TemperamentFactory(mood)
        out |= {f"{mood}_{k}": TemperamentFactory(mood, k) for k in range(1, INDIVIDUALS + 1)}
    return out


def _register() -> None:
    for task in task_names():
        role = task_class(task).roles().get(RECIPIENT)
        if role is not None and role.kind is Human:
            for name, factory in _factories().items():
                register_policy(task, RECIPIENT, name)(factory)


_register()


FOLDER = Path(__file__).resolve().parent
HELPER = "caregiver"  # the avatar who helps; the others are helped
TEMPERAMENTS = ("cooperative", *MOODS, "tremor")
TREMOR = 0.15  # share of the strength of each muscle group that shakes; our own choice
EVERYBODY_ELSE = ("random", "still", "behaviour")  # policies of a robot that are no partners


@dataclass(frozen=True)
class Partner:
    """Somebody to meet.

    Attributes:
        name: Unique among the partners of a role.
        task: Of which task.
        role: Which role it plays.
        model: Name of the avatar or robot.
        temperament: One of `TEMPERAMENTS`, `learned`, or the name of a robot's policy.
        policy: Name of the policy, or path of the policy file.
        entry: Cast entry of the role.
    """

    name: str
    task: str
    role: str
    model: str
    temperament: str
    policy: str
    entry: Mapping[str, Any] = field(default_factory=dict)

    def cast(self) -> dict[str, Any]:
        """Return the cast for `rcare_marl.make` or `EnvRecipe`."""
        return {self.role: dict(self.entry)}

    def policies(self) -> dict[str, str]:
        """Return the policies for `rcare_marl.make`, or the partners of an `EnvRecipe`."""
        return {self.role: self.policy}

    def to_dict(self) -> dict[str, str]:
        """Return plain values for JSON, without paths: those of a machine mean nothing elsewhere."""
        return {
            "name": self.name,
            "role": self.role,
            "model": self.model,
            "temperament": self.temperament,
            "policy": Path(self.policy).name,
        }


def partner_zoo(
    task: str,
    role: str,
    *,
    avatars: Sequence[str] | None = None,
    temperaments: Sequence[str] | None = None,
    individuals: int = 0,
    learned: Sequence[str | Path] | None = None,
    entry: Mapping[str, Any] | None = None,
) -> tuple[Partner, ...]:
    """Return the partners for a role of a task: those of each avatar in turn, then the learned ones.

    Args:
        task: Name of the task.
        role: Whom the partners play.
        avatars: Whose bodies; for a recipient all but the caregiver if None.
        temperaments: Some of `TEMPERAMENTS`; all that the role knows if None.
        individuals: How many individuals of each mood there are beside the mood itself, 0 to 3.
        learned: Policy files for this role; those that ship if None.
        entry: Further fields of every cast entry, such as `{"actuation": "muscle"}`.

    Raises:
        UnknownNameError: If a task, role, avatar or temperament does not exist.
        ConfigError: If `individuals` is impossible, or a policy file is not for this role.
    """
    roles = task_class(task).roles()
    check_name(f"role in task {task!r}", role, roles)
    if not 0 <= individuals <= INDIVIDUALS:
        raise ConfigError(f"individuals must lie in 0..{INDIVIDUALS}, got {individuals}")
    part, extra = roles[role], dict(entry or {})
    if part.kind is not Human:
        own = _robots(task, role, part, extra)
        wanted = _chosen("temperament", temperaments, [p.temperament for p in own])
        own = [partner for partner in own if partner.temperament in wanted]
    else:
        known = TEMPERAMENTS if role == RECIPIENT else ("cooperative", "tremor")
        moods = _chosen("temperament", temperaments, known)
        own = [
            partner
            for avatar in _avatars(part, role, avatars)
            for mood in moods
            for partner in _people(task, role, part, avatar, mood, individuals, extra)
        ]
    return (*own, *(learned_partner(task, role, file) for file in _files(task, role, learned)))


def _chosen(kind: str, wanted: Sequence[str] | None, known: Sequence[str]) -> tuple[str, ...]:
    for name in wanted or ():
        check_name(kind, name, known)
    return tuple(known if wanted is None else wanted)


def _avatars(part: Role[Any], role: str, wanted: Sequence[str] | None) -> tuple[str, ...]:
    known = assets.names("avatars")
    if wanted is not None:
        return _chosen("avatar", wanted, known)
    if role == RECIPIENT:
        return tuple(name for name in known if name != HELPER)
    return (part.default or HELPER,)


def _people(
    task: str,
    role: str,
    part: Role[Any],
    avatar: str,
    mood: str,
    individuals: int,
    extra: Mapping[str, Any],
) -> list[Partner]:
    """Return the partners of one avatar and temperament."""
    if mood in MOODS:
        names = [mood, *(f"{mood}_{k}" for k in range(1, individuals + 1))]
        entry = {"model": avatar, **extra}
        return [Partner(f"{avatar}_{n}", task, role, avatar, mood, n, entry) for n in names]
    if part.partner is None:
        raise ConfigError(f"role {role!r} of task {task!r} has no default partner: give `learned`")
    model = str(trembling(avatar, expand_movable(part.movable))) if mood == "tremor" else avatar
    entry = {"model": model, **extra}
    return [Partner(f"{avatar}_{mood}", task, role, avatar, mood, part.partner, entry)]


def _robots(task: str, role: str, part: Role[Any], extra: Mapping[str, Any]) -> list[Partner]:
    names = [name for name in policy_names(task, role) if name not in EVERYBODY_ELSE]
    model, entry = str(part.default), dict(extra)
    return [Partner(f"{model}_{name}", task, role, model, name, name, entry) for name in names]


@lru_cache(maxsize=64)
def trembling(avatar: str, dofs: tuple[str, ...], amplitude: float = TREMOR) -> Path:
    """Return the YAML file of an avatar whose muscles of some DoFs shake, written into the cache.

    Args:
        avatar: Name of the avatar, or of a person of a population.
        dofs: What shakes: the muscle groups of either motion of each.
        amplitude: Share of their strength.

    Raises:
        ConfigError: If the amplitude is no share.
    """
    config, norms = find_avatar(avatar), clinical_norms()
    groups: dict[str, set[str]] = {}
    for name in dofs:
        dof = DOFS[DOF_INDEX[name]]
        motions = (norms.motions[dof.positive], norms.motions[dof.negative])
        groups.setdefault(dof.side, set()).update(motion.group for motion in motions)
    profile = config.profile
    for side, shaking in groups.items():
        before = profile.side(side)
        tremor = {**before.tremor, **dict.fromkeys(sorted(shaking), amplitude)}
        changed: dict[str, Any] = {side: dataclasses.replace(before, tremor=tremor)}
        profile = dataclasses.replace(profile, **changed)
    fields = avatar_fields(dataclasses.replace(config, profile=profile))
    return cached(f"{avatar}_tremor", ".yaml", yaml.safe_dump(fields, sort_keys=False))


def learned_partner(task: str, role: str, file: str | Path, *, name: str = "") -> Partner:
    """Return the partner in a policy file, in the body that it was trained in.

    Args:
        task: Name of the task.
        role: Whom it plays.
        file: The policy file.
        name: What to call it; as the file if empty.

    Raises:
        ConfigError: If the file is not for that role of that task.
    """
    from rcare_marl.baselines.policy_file import (
        PolicyFile,
    )  # a zoo without learned partners needs none

    found = PolicyFile.read(file)
    if found.task != task or role not in found.roles:
        raise ConfigError(
            f"{file} plays {', '.join(found.roles)} in {found.task!r}, not {role!r} in {task!r}"
        )
    entry = dict(found.recipe.get("cast", {})).get(role, {})
    entry = dict(entry) if isinstance(entry, Mapping) else {"model": entry}
    model = str(entry.get("model") or task_class(task).roles()[role].default)
    return Partner(
        name or Path(file).stem, task, role, Path(model).stem, "learned", str(file), entry
    )


def _files(task: str, role: str, wanted: Sequence[str | Path] | None) -> list[str | Path]:
    if wanted is not None:
        return list(wanted)
    return sorted(FOLDER.glob(f"{task}_{role}_*.npz"))
