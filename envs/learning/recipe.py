"""What an environment for learners is made of, as data that travels to other processes and files."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.policy import Policy
from rcare_marl.config import load, plain
from rcare_marl.errors import ConfigError, UnknownNameError, check_name

from .. import make
from ..care_env import CareEnv
from ..cast import find_policy
from ..randomise import Randomisation
from ..registry import PolicyFactory, check_engine, lead_roles, task_class
from ..task import part_name
from .view import ViewConfig

PLACE = ("home", "level", "room")  # keys of a cast that are no roles
OPTIONS = "options"  # key of a variant
MAX_SCALE = 2.0  # of a residual: it then reaches every action from every other one

Scale = float | tuple[float, ...]  # of a residual: of all values of an action alike, or of each


class Population:
    """A policy that is another one of its members in each episode.

    Attributes:
        chosen: Number of the member that plays now.
    """

    def __init__(self, members: Sequence[Policy]) -> None:
        """Take the members, at least one."""
        self._members = tuple(members)
        self.chosen = 0

    def reset(self, rng: np.random.Generator) -> None:
        """Draw who plays, each member alike, and begin their episode."""
        self.chosen = int(rng.integers(len(self._members)))
        self._members[self.chosen].reset(rng)

    def act(self) -> npt.NDArray[np.float64]:
        """Return the action of whoever plays."""
        return self._members[self.chosen].act()


@dataclass(frozen=True)
class EnvRecipe:
    """A task, who plays, who learns, and who plays along.

    Attributes:
        task: Name of the task.
        options: Its settings.
        cast: Who plays, by role, and perhaps `home`, `level` and `room`: as for `rcare_marl.make`.
        variants: Further cast entries, and perhaps `options`. Environment i of a batch uses the i-th of
            them, in turn, over `cast` and `options`, so that a policy meets several people.
        learners: Roles that learn; the robots if empty.
        partners: Policy of a role that does not learn: its name or the path of a policy file. Of
            several one is drawn for each episode. The task's default where none is given.
        residual: For roles that learn, the scale of their action on top of the scripted policy's: one number,
            or one for each value of the action, 0 for what is left to the script: a learner's action holds
            the others only.
        bases: For roles that learn a residual, or are taught, the policy that is corrected, or shown, by
            name or file; `scripted` where nothing is given.
        hold: Control steps that a learner's action lasts: a decision. Rewards and costs of these are
            summed. A script that is corrected acts in each of them.
        physics_dt: Physics step [s]; where nobody is touched coarser ones teach as much in less time.
        engine: What computes the motion, see `rcare_marl.make`.
        randomise: What is another in each episode, see `rcare_marl.make`; kept as a mapping.
        views: For roles that learn, what their network reads of what they observe, see `ViewConfig`; all
            of it where nothing is given.
        taught: Whether learners also get what their script would do now, at the end of what they observe,
            and keep in mind what it keeps in mind: so many values more of an action are what they observe
            next as `memory`.

    Raises:
        UnknownNameError: If the task, a role or a policy does not exist.
        ConfigError: If a value is impossible, or a role learns and has a policy too.
    """

    task: str
    options: Mapping[str, Any] = field(default_factory=dict)
    cast: Mapping[str, Any] = field(default_factory=dict)
    variants: tuple[Mapping[str, Any], ...] = ()
    learners: tuple[str, ...] = ()
    partners: Mapping[str, str | tuple[str, ...]] = field(default_factory=dict)
    residual: Mapping[str, Scale] = field(default_factory=dict)
    bases: Mapping[str, str] = field(default_factory=dict)
    hold: int = 1
    physics_dt: float = 1 / 240
    engine: str = "bullet"
    randomise: Any = None
    views: Mapping[str, Any] = field(default_factory=dict)
    taught: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "randomise", Randomisation.of(self.randomise).to_dict())
        check_engine(self.task, self.engine)
        for name in ("options", "cast", "partners", "residual", "bases", "views"):
            _check_mapping(name, getattr(self, name))
        for name in ("variants", "learners"):
            if isinstance(getattr(self, name), str):
                raise ConfigError(f"{name} must be a list, got {getattr(self, name)!r}")
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for variant in self.variants:
            _check_mapping("a variant", variant)
            _check_mapping("options of a variant", variant.get(OPTIONS, {}))
        several = {k: v if isinstance(v, str) else tuple(v) for k, v in self.partners.items()}
        object.__setattr__(self, "partners", several)
        scales = {k: tuple(v) if isinstance(v, list) else v for k, v in self.residual.items()}
        object.__setattr__(self, "residual", scales)
        if type(self.hold) is not int or self.hold < 1:
            raise ConfigError(
                f"hold must be a whole number of control steps from 1 on, got {self.hold!r}"
            )
        if self.taught and self.hold > 1:
            raise ConfigError(
                f"who is taught by a script acts in each control step: hold must be 1, got {self.hold}"
            )
        if self.taught and self.residual:
            raise ConfigError("who corrects the script (residual) cannot be taught by it as well")
        for number in range(max(1, len(self.variants))):
            self._check_roles(number)

    def _check_roles(self, variant: int) -> None:
        roles, learning = self.roles(variant), self.learning_roles(variant)
        for role in (*learning, *self.partners, *self.residual, *self.views):
            check_name(f"role in the cast of {self.task!r}", role, roles)
        for role in (*self.partners, *(r for r in roles if self._own_policy(role=r, at=variant))):
            if role in learning:
                raise ConfigError(f"role {role!r} learns, and has a policy too")
        for role, scale in self.residual.items():
            if role not in learning:
                raise ConfigError(f"residual is for roles that learn, {learning}, got {role!r}")
            each = scale if isinstance(scale, tuple) else (scale,)
            is_known = all(isinstance(s, int | float) and 0 <= s <= MAX_SCALE for s in each)
            if not is_known or not any(each):
                raise ConfigError(
                    f"residual of {role!r} must be above 0 and at most {MAX_SCALE}, or such a number or 0 "
                    f"for each value of the action, got {scale!r}"
                )
            find_policy(self.task, role, self.bases.get(role, "scripted"))
        for role, base in self.bases.items():
            kind = "role that learns a residual or is taught, among bases"
            check_name(kind, role, learning if self.taught else self.residual)
            find_policy(self.task, role, base)
        for role in self.views:
            if role not in learning:
                raise ConfigError(f"views are for roles that learn, {learning}, got {role!r}")
            view = self.view_of(role)
            if role in self.residual and view is not None and view.heading:
                raise ConfigError(
                    f"who corrects a script (residual) sees as it does: {role!r} can have no heading"
                )
        for role in roles:
            if role not in learning:
                for name in self.partner_names(role, variant):
                    if not Path(name).suffix:  # a file is looked for where it is used
                        find_policy(self.task, role, name)

    def entries(self, variant: int = 0) -> dict[str, Any]:
        """Return the cast of a variant, with its place."""
        own = {k: v for k, v in self._variant(variant).items() if k != OPTIONS}
        return {**self.cast, **own}

    def _variant(self, variant: int) -> Mapping[str, Any]:
        return self.variants[variant % len(self.variants)] if self.variants else {}

    def roles(self, variant: int = 0) -> tuple[str, ...]:
        """Return the roles that are played."""
        cast = {k: v for k, v in self.entries(variant).items() if k not in PLACE}
        parts = task_class(self.task).roles()
        for role in cast:
            if part_name(role) not in parts:
                raise UnknownNameError(f"role in task {self.task!r}", role, parts)
        out: list[str] = []
        for name, part in parts.items():
            numbers = [int(r.rsplit("_", 1)[1]) for r in cast if part_name(r) == name != r]
            played = [f"{name}_{k}" for k in range(max(numbers) + 1)] if numbers else [name]
            unnamed = part.default is not None  # then the default plays
            out += [r for r in played if (cast[r] is not None if r in cast else unnamed)]
        return tuple(out)

    def learning_roles(self, variant: int = 0) -> tuple[str, ...]:
        """Return the roles that learn: `learners`, or the robots."""
        leads = lead_roles(self.task)
        return self.learners or tuple(r for r in self.roles(variant) if part_name(r) in leads)

    def make(self, variant: int = 0) -> CareEnv:
        """Return a new environment in which only the learners are left to act.

        Raises:
            ConfigError: If a value is impossible, or a role has no policy.
            UnknownNameError: If a name does not exist.
        """
        learning = self.learning_roles(variant)
        policies = {
            role: self._partner(role, variant)
            for role in self.roles(variant)
            if role not in learning and self._own_policy(role=role, at=variant) is None
        }
        return make(
            self.task,
            options={**self.options, **self._variant(variant).get(OPTIONS, {})},
            policies=policies,
            engine=self.engine,
            physics_dt=self.physics_dt,
            randomise=self.randomise,
            **self.entries(variant),
        )

    def view_of(self, role: str) -> ViewConfig | None:
        """Return what the network of a role reads; None if that is all."""
        given = self.views.get(role)
        return None if given is None else load(ViewConfig, given, f"the view of {role!r}")

    def partner_names(self, role: str, variant: int = 0) -> tuple[str, ...]:
        """Return the policies that may play a role, whether it learns or not."""
        part = task_class(self.task).roles()[part_name(role)]
        own = self._own_policy(role=role, at=variant)
        if own is not None and role in self.partners:
            raise ConfigError(f"two policies for {role!r}: one in the cast, one in partners")
        if callable(own):
            return ()
        chosen = self.partners.get(role, own or part.partner)
        if chosen is None:
            raise ConfigError(
                f"role {role!r} of task {self.task!r} has no default policy: name one in `partners`"
            )
        names = (chosen,) if isinstance(chosen, str) else chosen
        if not names or not all(isinstance(name, str) for name in names):
            raise ConfigError(f"partners of {role!r} must be names of policies, got {chosen!r}")
        return names

    def _own_policy(self, *, role: str, at: int) -> Any:
        """Return the policy that the cast itself gives to a role, None if there is none."""
        entry = self.entries(at).get(role)
        return entry.get("policy") if isinstance(entry, Mapping) else None

    def _partner(self, role: str, variant: int) -> PolicyFactory:
        made = [find_policy(self.task, role, n) for n in self.partner_names(role, variant)]
        if len(made) == 1:
            return made[0]
        return lambda env, name: Population([factory(env, name) for factory in made])

    def to_dict(self) -> dict[str, Any]:
        """Return the recipe as data that JSON and YAML can hold; `config.load` builds it again.

        Raises:
            ConfigError: If it holds objects, such as a `RobotConfig`, that they cannot.
        """
        return {f.name: plain(getattr(self, f.name), f.name) for f in dataclasses.fields(self)}


def _check_mapping(name: str, value: object) -> None:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{name} must be a mapping, got {type(value).__name__} {value!r}")
