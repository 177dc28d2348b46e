"""The partner zoo: who a policy may meet, by name.

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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from rcare_marl import assets
from rcare_marl.agents.people.avatar import expand_movable, load_avatar
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.profile import clinical_norms
from rcare_marl.cache import cached
from rcare_marl.envs.registry import policy_names, task_class
from rcare_marl.envs.task import Role
from rcare_marl.errors import ConfigError, check_name

from .temperament import INDIVIDUALS, MOODS, RECIPIENT

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
        avatar: Name of the avatar.
        dofs: What shakes: the muscle groups of either motion of each.
        amplitude: Share of their strength.

    Raises:
        ConfigError: If the amplitude is no share.
    """
    config, norms = load_avatar(avatar), clinical_norms()
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
    fields = dataclasses.asdict(dataclasses.replace(config, profile=profile))
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
