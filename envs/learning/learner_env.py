"""One environment as its learners see it: arrays by group."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from rcare_marl.agents.people.behaviour.behaviour_tree import StayStill
from rcare_marl.agents.policy import Policy
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.errors import ConfigError, check_name

from ..cast import make_policy, memory_of, remind
from ..registry import group_map, unguarded
from .recipe import EnvRecipe, Scale
from .view import View

Floats = npt.NDArray[np.float32]
STAGE = ("spread", "tolerance", "force")  # what a curriculum sets; 1 is the task as it is
MEMORY = "memory"  # name of what a learner wrote a control step before
BASE = "scripted_action"  # name of what a residual, or a teacher, adds to the observation


@dataclass(frozen=True)
class Layout:
    """What the arrays of an environment hold.

    Attributes:
        groups: The learned roles by group.
        observed: For each group (name, size) of what is observed, in order.
        action_sizes: For each group the length of one role's action.
        action_lows: For each group the least value of an action, -1 or 0.
        state_size: Length of the state.
        flags: For each group how many of the values that a role keeps in mind, the first, hold or do not.
    """

    groups: dict[str, tuple[str, ...]]
    observed: dict[str, tuple[tuple[str, int], ...]]
    action_sizes: dict[str, int]
    action_lows: dict[str, float]
    state_size: int
    flags: dict[str, int]

    @property
    def observation_sizes(self) -> dict[str, int]:
        """For each group the length of one role's observation."""
        return {group: sum(size for _, size in parts) for group, parts in self.observed.items()}


class LearnerEnv:
    """A `CareEnv` by group; after `reset` and `step` its attributes tell what came of it.

    Attributes:
        care_env: The environment behind.
        recipe: What it was made of.
        layout: What its arrays hold.
        groups: The learned roles by group.
        observation: For each group, shape [roles, observation size].
        state: What all roles observe, learned or not, shape [state size]; without scripted actions.
        reward: For each group, shape [roles].
        cost: For each group, how much safety was lacking, shape [roles]; see docs/safety.md.
        terminated: Whether the episode ended by success or failure.
        truncated: Whether its time was up.
        success: Whether the goal is reached.
    """

    def __init__(self, recipe: EnvRecipe, variant: int = 0) -> None:
        """Build the scene.

        Args:
            recipe: What it is made of.
            variant: Which of the recipe's variants.

        Raises:
            ConfigError: If a learner observes pictures or other arrays, or a value is impossible.
            UnknownNameError: If a name does not exist.
        """
        self.recipe, self.care_env = recipe, recipe.make(variant)
        env, task, bases = self.care_env, recipe.task, recipe.bases
        try:
            self._refuse_arrays()
            self._views = self._make_views()
            self._bases: dict[str, Policy] = {
                role: make_policy(
                    env, task, role, unguarded(task, role, bases.get(role, "scripted"))
                )
                for role in recipe.residual
            }
            teachers = self.demonstrators() if recipe.taught else {}
            self._bases |= teachers
            self._scales = {
                role: scale_of(scale, env.cast[role].action_size, role)
                for role, scale in recipe.residual.items()
            }
            self._moved = {role: moved_by(scale) for role, scale in recipe.residual.items()}
            self._memories = {role: kept_by(teachers.get(role)) for role in env.cast}
            self._flags = {role: len(memory_of(teachers.get(role))[0]) for role in env.cast}
            self.layout = self._lay_out()
        except BaseException:
            env.close()
            raise
        self.groups, sizes = self.layout.groups, self.layout.observation_sizes
        self._order = list(env.cast)
        self._base_actions: dict[str, npt.NDArray[np.float64]] = {}
        self._is_staged = False
        self.state = np.zeros(self.layout.state_size, np.float32)
        self.observation = {
            group: np.zeros((len(roles), sizes[group]), np.float32)
            for group, roles in self.groups.items()
        }
        self.reward = {g: np.zeros(len(roles), np.float32) for g, roles in self.groups.items()}
        self.cost = {g: np.zeros(len(roles), np.float32) for g, roles in self.groups.items()}
        self.terminated = self.truncated = self.success = False

    def _refuse_arrays(self) -> None:
        for role in self.care_env.possible_agents:
            if isinstance(self.care_env.observation_space(role), spaces.Dict):
                names = ", ".join(name for _, name, _ in self.care_env.describe_arrays(role))
                raise ConfigError(
                    f"{role!r} observes arrays: {names}. Learners here take numbers only; for pictures "
                    "use rcare_marl.envs.torchrl.make_env"
                )

    def _make_views(self) -> dict[str, View]:
        out = {}
        for role in self.care_env.possible_agents:
            config = self.recipe.view_of(role)
            if config is not None:
                table = [(name, at) for at, name, _ in self.care_env.describe(role)]
                out[role] = View(config, table, self.care_env.cast[role].action_names)
        return out

    def _lay_out(self) -> Layout:
        env, residual = self.care_env, self.recipe.residual
        groups = {g: tuple(r) for g, r in group_map(env, extended=residual.keys()).items()}
        first = {group: roles[0] for group, roles in groups.items()}
        observed = {}
        for group, role in first.items():
            parts = [(name, part.stop - part.start) for part, name, _ in env.describe(role)]
            if role in self._views:
                parts = list(self._views[role].parts)
            kept = len(self._memories[role])
            if kept:
                parts.append((MEMORY, kept))
            if role in residual or self.recipe.taught:
                parts.append((BASE, env.cast[role].action_size + kept))
            observed[group] = tuple(parts)
        self._spans = [(role, max(at.stop for at, *_ in env.describe(role))) for role in env.cast]
        # Who imitates needs no critic, and so no state of people who may be driven otherwise in a variant.
        self._stated = set(env.possible_agents if self.recipe.taught else env.cast)
        state_size = sum(
            len(self._views[role].now) if role in self._views else size
            for role, size in self._spans
            if role in self._stated
        )
        return Layout(
            groups,
            observed,
            {
                group: self._own_size(role) + len(self._memories[role])
                for group, role in first.items()
            },
            {group: env.cast[role].action_low for group, role in first.items()},
            state_size,
            {group: self._flags[role] for group, role in first.items()},
        )

    def reset(self, seed: int, stage: Mapping[str, float] | None = None) -> None:
        """Begin an episode, which is a function of its seed, its stage and the actions.

        Args:
            seed: Of the episode.
            stage: What a curriculum sets: `spread`, `tolerance` and `force`; the task as it is where
                nothing is given.

        Raises:
            UnknownNameError: If the stage has another key.
            ConfigError: If one of its values is out of range, or the task has no stages.
        """
        self.prepare(stage or {})
        observations, infos = self.care_env.reset(seed=seed)
        for role, base in self._bases.items():
            base.reset(np.random.default_rng([seed, self._order.index(role)]))
        for view in self._views.values():
            view.reset()
        for memory in self._memories.values():
            memory[:] = 0.0
        for values in (*self.reward.values(), *self.cost.values()):
            values[:] = 0.0
        self.terminated = self.truncated = False
        self._take(observations, infos)

    def prepare(self, stage: Mapping[str, float]) -> None:
        """Set the stage of the next episode, 1 for each key that is left out.

        Raises:
            UnknownNameError: If the stage has an unknown key.
            ConfigError: If a value is out of its range, or the task has no stages.
        """
        for key in stage:
            check_name("key of a stage", key, STAGE)
        if stage or self._is_staged:
            spread, tolerance, force = (float(stage.get(key, 1.0)) for key in STAGE)
            self.care_env.task.set_stage(spread=spread, tolerance=tolerance, force=force)
            self._is_staged = True

    def step(self, actions: Mapping[str, Floats]) -> None:
        """Let everybody act for one decision of the learners: as many control steps as the recipe holds it.

        Args:
            actions: For each group, shape [roles, action size].
        """
        step_together([self], [actions])

    def _command(self, actions: Mapping[str, Floats]) -> None:
        commands: dict[str, npt.NDArray[Any]] = {}
        for group, roles in self.groups.items():
            for role, action in zip(roles, actions[group], strict=True):
                commands[role] = self._applied(role, action, self.layout.action_lows[group])
        self.care_env.command(commands)

    def _see(self) -> None:
        observations, rewards, ended, late, infos = self.care_env.outcome()
        for group, roles in self.groups.items():
            self.reward[group] += [rewards[role] for role in roles]
            self.cost[group] += [infos[role].get("cost", 0.0) for role in roles]
        self.terminated, self.truncated = any(ended.values()), any(late.values())
        self._take(observations, infos)

    def _applied(self, role: str, action: Floats, low: float) -> npt.NDArray[Any]:
        scale = self._scales.get(role)
        if scale is None:
            size = self.care_env.cast[role].action_size
            self._memories[role][:] = kept(action[size:], self._flags[role])
            view = self._views.get(role)
            return action[:size] if view is None else view.turned_back(action[:size])
        whole = np.zeros(self.care_env.cast[role].action_size, np.float32)  # as actions are
        whole[self._moved[role]] = action
        return np.clip(self._base_actions[role] + scale * whole, low, 1.0)

    def _own_size(self, role: str) -> int:
        """Return how many values of its action a role decides about: all but those left to the script."""
        size = self.care_env.cast[role].action_size
        return len(np.arange(size)[self._moved.get(role, slice(None))])

    def _take(
        self, observations: Mapping[str, Floats], infos: Mapping[str, Mapping[str, float]]
    ) -> None:
        read = {role: view.read(observations[role]) for role, view in self._views.items()}
        for role, base in self._bases.items():
            written = self._memories[role][: self._flags[role]]
            if written.any():  # not before anything was
                remind(base, [bool(value > 0) for value in written])
            shown = self.as_seen(role, np.array(base.act()))  # a copy: scripts may reuse theirs
            if self.recipe.taught:
                shown = np.concatenate((shown, kept_by(base)))
            self._base_actions[role] = shown
        for group, roles in self.groups.items():
            for row, role in zip(self.observation[group], roles, strict=True):
                seen = read.get(role, observations[role])
                parts: list[npt.NDArray[Any]] = [seen, self._memories[role]]
                if role in self._bases:
                    parts.append(self._base_actions[role])
                row[:] = np.concatenate(parts)
        self.state[:] = self._whole_state()
        self.success = bool(next(iter(infos.values()))["success"])

    def _whole_state(self) -> Floats:
        """Return what all roles observe, through their views as they see it now, shape [state size].

        Of who is taught, what the learners observe.
        """
        state = self.care_env.state()
        parts, start = [], 0
        for role, size in self._spans:
            view = self._views.get(role)
            if role in self._stated:
                parts.append(state[start : start + size] if view is None else view.now)
            start += size
        return np.concatenate(parts)

    def as_seen(self, role: str, action: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return an action in the world as who sees through the role's view would choose it."""
        view = self._views.get(role)
        return action if view is None else view.turned(action)

    def demonstrators(self) -> dict[str, Policy]:
        """Return who shows each learner what to do: robots their script, people their default partner.

        Of who is taught, what the recipe's `bases` name. A residual's best start is to change nothing: those
        roles are shown zeros.

        Raises:
            ConfigError: If a role has no default partner.
            UnknownNameError: If a robot has no script.
        """
        env, task = self.care_env, self.recipe.task
        shown: dict[str, Policy] = {}
        for role in env.possible_agents:
            if role in self.recipe.residual:
                shown[role] = StayStill(self._own_size(role))
                continue
            is_robot = isinstance(env.cast[role], Robot)
            usual = "scripted" if is_robot else self.recipe.partner_names(role)[0]
            name = unguarded(task, role, self.recipe.bases.get(role, usual))
            shown[role] = make_policy(env, task, role, name)
        return shown

    def close(self) -> None:
        """Free the scene; safe to call twice."""
        self.care_env.close()


def step_together(envs: Sequence[LearnerEnv], actions: Sequence[Mapping[str, Floats]]) -> None:
    """Step environments of one recipe, each as `LearnerEnv.step` does.

    First all are told what to do, then all move, then all look: what Python goes through is still in the
    caches then, which the physics of each empties.

    Args:
        envs: The environments.
        actions: Of each, by group, shape [roles, action size].
    """
    for env in envs:
        for values in (*env.reward.values(), *env.cost.values()):
            values[:] = 0.0
    running = list(zip(envs, actions, strict=True))
    for _ in range(envs[0].recipe.hold if envs else 0):
        for env, told in running:
            env._command(told)
        for env, _ in running:
            env.care_env.advance()
        for env, _ in running:
            env._see()
        running = [pair for pair in running if not (pair[0].terminated or pair[0].truncated)]


def kept_by(script: Policy | None) -> npt.NDArray[np.float64]:
    """Return what a script keeps in mind as values, 1 of what holds and -1 of what does not, shape [k]."""
    flags, values = memory_of(script)
    return np.concatenate([np.where([bool(flag) for flag in flags], 1.0, -1.0), values])


def kept(written: npt.NDArray[Any], flags: int) -> npt.NDArray[Any]:
    """Return what a network keeps of what it wrote: what holds is 1 or -1, and nothing between."""
    return np.append(np.where(written[:flags] > 0, 1.0, -1.0), written[flags:])


def moved_by(scale: Scale) -> Any:
    """Return the index of the values of an action that a residual of this scale changes."""
    return np.flatnonzero(scale) if isinstance(scale, tuple) else slice(None)


def scale_of(scale: Scale, size: int, role: str) -> float | npt.NDArray[np.float64]:
    """Return a residual's scale, of all values of an action or of each, shape [size].

    Raises:
        ConfigError: If an action has another number of values.
    """
    if not isinstance(scale, tuple):
        return scale
    if len(scale) != size:
        raise ConfigError(
            f"residual of {role!r} has {len(scale)} scales, and an action {size} values"
        )
    return np.array(scale, np.float64)
