"""A trained network as a file: what it was learned in, and its weights, without pickle.

Example:
    >>> env = rcare_marl.make("feeding", policies={"robot": "runs/feeding/policy.npz"})
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.policy import Policy
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.atomic_file import read_arrays, write_arrays
from rcare_marl.config import load
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.learning.learner_env import kept, scale_of
from rcare_marl.envs.learning.recipe import Scale
from rcare_marl.envs.learning.view import View, ViewConfig
from rcare_marl.envs.registry import register_policy_file, task_class, unguarded
from rcare_marl.envs.task import part_name
from rcare_marl.errors import ConfigError, near_files
from rcare_marl.observable import VECTOR
from rcare_marl.reading import check_numbers, refusing

SUFFIX = ".npz"
VERSION = 1  # of the format
CLIP = 10.0  # of a normalised observation
BASE = "scripted"  # the policy that a residual is added to
BASE_ACTION = "scripted_action"  # its action, at the end of what a residual observes
MEMORY = "memory"  # what a network wrote a control step before

Weights = npt.NDArray[np.float32]


@dataclass(frozen=True)
class PolicyFile:
    """A deterministic actor: normalisation, layers of ReLU, and the tanh of the last one's means.

    Attributes:
        task: Name of the task that it was learned in.
        group: Group of learners, such as `robots`; they share these weights.
        roles: The roles of the group.
        observed: Name and number of values of each part that the network reads, in order. That of a
            residual ends with `scripted_action`. An observation may hold more.
        action_size: Number of action values.
        memory: Number of values that the network writes beside them, and reads one control step later as
            the part `memory` of what it observes.
        flags: How many of these, the first, are 1 or -1 once written.
        action_low: Least value of an action: -1, or 0 for what only pulls.
        layers: Weights, shape [out, in], and biases, shape [out], of each layer. The last has a row for
            each action value, and may have as many more for spreads, which are not used.
        mean: Taken from an observation first, shape [observation].
        scale: Divides it then, shape [observation].
        residual: How much of the action is added to that of the scripted policy [1]; None where the
            action is the network's own. Of all values alike, or of each.
        hold: Control steps that an action of the network lasts.
        actions: What each action value moves; not checked if empty.
        recipe: How its environments were made, see `envs.learning.EnvRecipe`.
        view: How the network reads an observation, see `envs.learning.view.ViewConfig`; the parts of
            `observed` as they are if empty.
        training: How it was trained: algorithm, reward, steps, minutes, machine, versions, seed.

    Raises:
        ConfigError: If the numbers do not fit each other.
    """

    task: str
    group: str
    roles: tuple[str, ...]
    observed: tuple[tuple[str, int], ...]
    action_size: int
    action_low: float
    layers: tuple[tuple[Weights, Weights], ...]
    mean: Weights
    scale: Weights
    residual: Scale | None = None
    hold: int = 1
    actions: tuple[str, ...] = ()
    recipe: Mapping[str, Any] = field(default_factory=dict)
    view: Mapping[str, Any] = field(default_factory=dict)
    memory: int = 0
    flags: int = 0
    training: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        size = sum(count for _, count in self.observed)
        if not self.layers:
            raise ConfigError("a policy needs at least one layer")
        for name, values in (("mean", self.mean), ("scale", self.scale)):
            if values.shape != (size,):
                raise ConfigError(f"{name} of shape {values.shape} for {size} observed values")
        for number, (weights, biases) in enumerate(self.layers):
            if weights.ndim != 2 or weights.shape[1] != size or biases.shape != weights.shape[:1]:
                raise ConfigError(
                    f"layer {number}: weights {weights.shape} and biases {biases.shape} after "
                    f"{size} values"
                )
            size = weights.shape[0]
        count = self.action_size + self.memory
        if size not in (count, 2 * count):
            raise ConfigError(f"the last layer gives {size} values for {count} actions")
        numbers = (self.mean, self.scale, *(part for layer in self.layers for part in layer))
        if not all(np.isfinite(part).all() for part in numbers):
            raise ConfigError("a policy's numbers must be finite")
        if not (self.scale > 0).all():
            raise ConfigError("a policy's scales must be positive")
        if self.actions and len(self.actions) != self.action_size:
            raise ConfigError(f"{len(self.actions)} names for {self.action_size} action values")

    def save(self, path: str | Path) -> None:
        """Write the file, whole or not at all; the same policy gives the same bytes.

        Raises:
            ConfigError: If it cannot be written.
        """
        about = {name: getattr(self, name) for name in _ABOUT} | {"version": VERSION}
        arrays = {"mean": self.mean, "scale": self.scale}
        for number, (weights, biases) in enumerate(self.layers):
            arrays |= {f"weights_{number}": weights, f"biases_{number}": biases}
        write_arrays(Path(path), about, arrays)

    @classmethod
    def read(cls, path: str | Path) -> PolicyFile:
        """Return the policy in a file.

        Raises:
            ConfigError: If there is no such file, or it is damaged, of another kind or a later version.
        """
        file = Path(path)
        if not os.path.isfile(file):
            raise ConfigError(f"no policy at {file}.{near_files(file)}")
        about, arrays = read_arrays(file, "a policy", VERSION)
        check_numbers(arrays, file)
        with refusing(file, "a policy"):
            mean, scale = (np.asarray(arrays.pop(name), np.float32) for name in ("mean", "scale"))
            layers = tuple(
                (
                    np.asarray(arrays[f"weights_{k}"], np.float32),
                    np.asarray(arrays[f"biases_{k}"], np.float32),
                )
                for k in range(len(arrays) // 2)
            )
            about["observed"] = tuple((name, size) for name, size in about["observed"])
            about |= {name: tuple(about[name]) for name in ("roles", "actions")}
            if isinstance(about["residual"], list):
                about["residual"] = tuple(about["residual"])
            about = {
                "view": {},
                "memory": 0,
                "flags": 0,
                "hold": 1,
                **about,
            }  # files of before have none
            return cls(**about, layers=layers, mean=mean, scale=scale)

    @property
    def observation_size(self) -> int:
        """Number of values that the network sees."""
        return sum(size for _, size in self.observed)

    def check(self, env: CareEnv, role: str) -> None:
        """Refuse an environment or a role that the policy was not made for.

        Raises:
            ConfigError: If the task, the part, what is observed, or the actions differ; it lists which.
        """
        who = f"the policy of {self.group!r} in {self.task!r}"
        if not isinstance(env.task, task_class(self.task)):
            raise ConfigError(f"{who} cannot play {type(env.task).__name__}: another task")
        if part_name(role) not in {part_name(known) for known in self.roles}:
            raise ConfigError(f"{who} plays {', '.join(self.roles)}, not {role!r}")
        agent = env.cast[role]
        faults = self._differences(env, role)
        if (agent.action_size, agent.action_low) != (self.action_size, self.action_low):
            faults.append(
                f"{agent.action_size} actions from {agent.action_low:g} on, learned were "
                f"{self.action_size} from {self.action_low:g} on"
            )
        elif self.actions and tuple(agent.action_names) != self.actions:
            now, then = next(
                pair
                for pair in zip(agent.action_names, self.actions, strict=True)
                if pair[0] != pair[1]
            )
            faults.append(f"the action {now!r}, learned was {then!r}")
        if faults:
            raise ConfigError(f"{who} does not fit {role!r} here: {'; '.join(faults)}")

    def view_on(self, env: CareEnv, role: str) -> View:
        """Return how the network reads what a role observes in an environment.

        Raises:
            ConfigError: If something that it reads is not observed there.
        """
        own = [name for name, _ in self.observed if name not in (MEMORY, BASE_ACTION)]
        config = load(ViewConfig, self.view or {"parts": own}, "the policy's view")
        table = [(name, at) for at, name, _ in env.describe(role)]
        return View(config, table, env.cast[role].action_names)

    def _differences(self, env: CareEnv, role: str) -> list[str]:
        """Return what is observed otherwise than it was learned, as texts; empty if it fits."""
        seen = {name: part.stop - part.start for part, name, _ in env.describe(role)}
        if self.view:
            try:
                here = self.view_on(env, role).parts
            except ConfigError as error:
                return [str(error)]
            seen = dict(here)
        learned = [pair for pair in self.observed if pair[0] not in (MEMORY, BASE_ACTION)]
        return [f"{name} is not observed" for name, _ in learned if name not in seen] + [
            f"{name} has {seen[name]} values, learned were {size}"
            for name, size in learned
            if seen.get(name, size) != size
        ]


class LearnedPolicy:
    """Plays a role with a trained network, in NumPy; the same observations give the same actions."""

    def __init__(self, env: CareEnv, role: str, file: PolicyFile) -> None:
        """Take the environment, the role and the network.

        Raises:
            ConfigError: If the network was not made for them, see `PolicyFile.check`.
        """
        file.check(env, role)
        self._env, self._role, self._hold = env, role, file.hold
        self._view = file.view_on(env, role)
        self._low, self._mean, self._scale = file.action_low, file.mean, file.scale
        self._hidden = [(np.ascontiguousarray(w), b) for w, b in file.layers[:-1]]
        weights, biases = file.layers[-1]
        self._size, self._flags = file.action_size, file.flags
        self._memory = np.zeros(file.memory, np.float32)
        self._lasts = 0  # for how many control steps more
        count = file.action_size + file.memory  # what comes behind are spreads
        self._last = np.ascontiguousarray(weights[:count]), biases[:count]
        self._base: Policy | None = None
        if file.residual is not None:
            self._residual = scale_of(file.residual, file.action_size, role)
            base = file.recipe.get("bases", {}).get(role, BASE)
            self._base = unguarded(file.task, role, base)(env, role)

    def reset(self, rng: np.random.Generator) -> None:
        self._view.reset()
        self._memory[:] = 0.0
        self._lasts = 0
        if self._base is not None:
            self._base.reset(rng)

    def act(self) -> npt.NDArray[np.float64]:
        if not self._env.task.feasible.holds and isinstance(self._env.cast[self._role], Robot):
            return np.zeros(self._size)  # nobody begins with what cannot be done for this person
        seen = self._env.observe(self._role)
        values: Weights = self._view.read(seen[VECTOR] if isinstance(seen, dict) else seen)
        base = None if self._base is None else np.array(self._base.act())
        if self._lasts == 0:
            self._lasts = self._hold
            more = self._memory if base is None else base.astype(np.float32)
            self._own = self.decide(np.concatenate([values, more]))
        self._lasts -= 1
        if base is None:
            self._memory = kept(self._own[self._size :], self._flags).astype(np.float32)
            return self._view.turned_back(self._own[: self._size]).astype(np.float64)
        # As in `envs.learning.LearnerEnv`, to the last bit.
        return np.clip(base + self._residual * self._own, self._low, 1.0)

    def decide(self, observation: Weights) -> Weights:
        """Return the network's own action and memory, shape [actions + memory], for what it reads."""
        values = (observation - self._mean) / self._scale
        np.minimum(np.maximum(values, -CLIP, out=values), CLIP, out=values)
        # Not BLAS: it spreads such products over threads, and their number changes the last bit.
        for weights, biases in self._hidden:
            values = np.einsum("ij,j->i", weights, values)
            values += biases
            np.maximum(values, 0, out=values)
        weights, biases = self._last
        share = (np.tanh(np.einsum("ij,j->i", weights, values) + biases) + 1) / 2
        return np.asarray(self._low + share * (1 - self._low), np.float32)


@register_policy_file(SUFFIX)
def load_policy(path: Path) -> Callable[[CareEnv, str], Policy]:
    """Return what makes a policy from a file; ConfigError if it is missing or damaged."""
    file = PolicyFile.read(path)

    def make(env: CareEnv, role: str) -> Policy:
        try:
            return LearnedPolicy(env, role, file)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from error

    make.__name__ = str(path)
    make.__doc__ = f"Return a network trained in {file.task}."
    return make


_ABOUT = tuple(
    """
    task group roles observed action_size action_low residual hold actions recipe view memory flags training
    """.split()
)
