"""How good policies are at a task: seeded episodes, and numbers over them.

Example:
    >>> from rcare_marl.baselines.evaluation.evaluate import evaluate, lead_policies
    >>> result = evaluate("feeding", lead_policies("feeding", "scripted"), episodes=10, seed=0)
    >>> result.success_rate, result.peak_force
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtrit  # type: ignore[import-untyped]
from scipy.stats import binomtest  # type: ignore[import-untyped]

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.sampling.population import (
    person_hash,
    population_hash,
    populations_among,
)
from rcare_marl.agents.policy import Policy
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.cast import CastEntry, make_policy
from rcare_marl.envs.company import model_of
from rcare_marl.envs.episode import EpisodeRecorder
from rcare_marl.envs.registry import is_policy_file, lead_roles, task_class
from rcare_marl.envs.task import part_name
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.provenance import versions

from ..workers import run_all

RANDOM = "random"  # the one name that stands for everybody, see `lead_policies`
EVENT = "time_to_"  # metrics named so are negative where the event never came

StepHook = Callable[[CareEnv], None]


@dataclass(frozen=True)
class Episode:
    """What came of one episode.

    Attributes:
        seed: Seed of the reset and of the policies.
        success: Whether it ended in success.
        steps: Control steps.
        duration: Simulated time [s].
        returns: Summed reward of each role.
        metrics: What the task reports at the end, see `Task.metrics`, and what was perturbed.
        costs: Summed `cost` of each role, see `envs.safety`; none where the task measures none.
        people: By role, who played it, where that is another person in each episode.
        infeasible: Why it cannot be done for this cast; empty if it can.
    """

    seed: int
    success: bool
    steps: int
    duration: float
    returns: Mapping[str, float]
    metrics: Mapping[str, float]
    costs: Mapping[str, float] = field(default_factory=dict)
    people: Mapping[str, str] = field(default_factory=dict)
    infeasible: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; an event that never came is None."""
        who = {"people": dict(self.people), "infeasible": self.infeasible} if self.people else {}
        return {
            **who,
            "seed": self.seed,
            "success": self.success,
            "steps": self.steps,
            "duration_s": round(self.duration, 6),
            "returns": dict(self.returns),
            "costs": dict(self.costs),
            "metrics": {name: _came(name, value) for name, value in self.metrics.items()},
        }


@dataclass(frozen=True)
class Evaluation:
    """What came of many episodes.

    Attributes:
        task: Name of the task.
        policies: Name of the policy of each role.
        cast: Name of the model that plays each role.
        options: Settings of the task that were given.
        seed: Seed of the first episode; each further one has the next.
        episodes: The episodes, in order.
        place: House, level and room in which it took place; empty on a bare floor.
        people: Of all who played, by name, a hash of everything that they are.
        refused: Of a population, by name, why somebody cannot be cast; the next one played.
        versions: Versions of what the numbers depend on, with a hash of each population.
    """

    task: str
    policies: Mapping[str, str]
    cast: Mapping[str, str]
    options: Mapping[str, Any]
    seed: int
    episodes: tuple[Episode, ...]
    place: Mapping[str, Any] = field(default_factory=dict)
    people: Mapping[str, str] = field(default_factory=dict)
    refused: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=lambda: versions())

    @property
    def success_rate(self) -> float:
        """Share of episodes that ended in success, 0 to 1."""
        return float(np.mean([episode.success for episode in self.episodes]))

    @property
    def success_interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the success rate."""
        return wilson_interval(sum(e.success for e in self.episodes), len(self.episodes))

    @property
    def feasible(self) -> tuple[Episode, ...]:
        """The episodes that could be done for those who played."""
        return tuple(episode for episode in self.episodes if not episode.infeasible)

    @property
    def infeasible(self) -> str:
        """Why it cannot be done for anybody who played, by the first of them; empty if it can."""
        return "" if self.feasible else self.episodes[0].infeasible

    @property
    def peak_force(self) -> float | None:
        """Greatest force on the person in any episode [N]; None where the task reports none."""
        values = self.values("peak_force_n")
        return max(values) if values else None

    def values(self, metric: str) -> list[float]:
        """Return a metric at the end of each episode, without events that never came."""
        found = [_came(metric, e.metrics[metric]) for e in self.episodes if metric in e.metrics]
        return [value for value in found if value is not None]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, the same on every run of the same seeds.

        For each metric of the task there are its `_mean` over episodes, the 95 % interval of that as
        `_interval_95` (None of fewer than two episodes), and its `_max`. `peak_force_n` is the maximum
        over episodes and `spilled` the sum, since these are what harms. `mean_return` and `mean_cost`
        are of each role's sums over an episode.
        """
        first = self.episodes[0]
        out: dict[str, Any] = {
            "task": self.task,
            "policy": self.policies.get(lead_roles(self.task)[0], ""),
            "policies": dict(self.policies),
            "cast": dict(self.cast),
            "options": dict(self.options),
            "place": dict(self.place),
            "seed": self.seed,
            "episodes": len(self.episodes),
            "successes": sum(e.success for e in self.episodes),
            "success_rate": self.success_rate,
            "success_interval_95": list(self.success_interval),
            "feasible": not self.infeasible,
            "infeasible_reason": self.infeasible,
            "feasible_episodes": len(self.feasible),
            "success_rate_of_feasible": (
                float(np.mean([e.success for e in self.feasible])) if self.feasible else None
            ),
            "people": dict(self.people),
            "refused": dict(self.refused),
            "peak_force_n": self.peak_force,
            "spilled": sum(self.values("spilled")) if "spilled" in first.metrics else None,
        }
        for name in first.metrics:
            values = self.values(name)
            out[f"{name}_mean"] = float(np.mean(values)) if values else None
            out[f"{name}_interval_95"] = mean_interval(values)
            out[f"{name}_max"] = max(values) if values else None
        out |= {
            "steps": sum(e.steps for e in self.episodes),
            "steps_mean": float(np.mean([e.steps for e in self.episodes])),
            **_by_role("return", [e.returns for e in self.episodes]),
            **_by_role("cost", [e.costs for e in self.episodes]),
            "versions": dict(self.versions),
        }
        return out


def evaluate(
    task: str,
    policies: Mapping[str, Any] | None = None,
    *,
    episodes: int = 100,
    seed: int = 0,
    options: Mapping[str, Any] | None = None,
    cast: Mapping[str, CastEntry] | None = None,
    randomise: Any = None,
    on_episode: Callable[[Episode], None] | None = None,
    save: str | Path | None = None,
) -> Evaluation:
    """Run seeded episodes and return what came of them.

    Args:
        task: Name of the task.
        policies: For each role the name of a policy or what makes one, see `rcare_marl.make`; the
            role's default partner where none is given.
        episodes: How many.
        seed: Episode i has the seed `seed + i`.
        options: Settings of the task.
        cast: Who plays, by role, and where: `home`, `level`, `room`; see `rcare_marl.make`.
        randomise: What is another in each episode, see `rcare_marl.make`.
        on_episode: Called after each episode.
        save: A folder in which each episode is left as `seed-<seed>.npz`, see `rcare_marl.envs.episode`.

    Raises:
        UnknownNameError: If a task, role, model, option or policy does not exist.
        ConfigError: If a value is impossible, or a role has no policy.
    """
    if episodes < 1:
        raise ConfigError(f"episodes must be at least 1, got {episodes}")
    task_class(task)  # an unknown task is the first thing to say
    entries: dict[str, Any] = dict(cast or {})
    played = played_cast(task, entries, policies or {})
    with closing(make(task, options=options, randomise=randomise, **played)) as env:
        names, players = make_players(env, task, policies or {})
        recorder = EpisodeRecorder(env, sees=True) if save is not None else None
        done, people = list[Episode](), dict[str, str]()
        for number in range(episodes):
            done.append(run_episode(env, players, seed + number))
            people |= person_hashes(env)
            if save is not None and recorder is not None:
                recorder.episode(names).save(Path(save) / f"seed-{seed + number}.npz")
            if on_episode is not None:
                on_episode(done[-1])
        models, chosen, place = model_names(env), dict(options or {}), env.task.place.facts()
        refused = {} if env.company is None else env.company.refused
        called = [*models.values(), *people]
        of = {name: population_hash(name) for name in sorted(populations_among(called))}
        known = versions() | {f"population {name}": found for name, found in of.items()}
        return Evaluation(
            task, names, models, chosen, seed, tuple(done), place, people, refused, known
        )


def joined(parts: Sequence[Evaluation]) -> Evaluation:
    """Return one evaluation of the episodes of several that differ in their seeds alone."""
    episodes = tuple(episode for part in parts for episode in part.episodes)
    people = {who: found for part in parts for who, found in part.people.items()}
    refused = {who: why for part in parts for who, why in part.refused.items()}
    return replace(parts[0], episodes=episodes, people=people, refused=refused)


@dataclass(frozen=True)
class Job:
    """Some episodes in a scene of their own, for any process; attributes as for `evaluate`."""

    task: str
    policies: Mapping[str, Any]
    episodes: int
    seed: int
    options: Mapping[str, Any]
    cast: Mapping[str, Any]
    randomise: Mapping[str, Any] = field(default_factory=dict)
    save: Path | None = None

    def run(self, on_episode: Callable[[Episode], None] | None = None) -> Evaluation:
        """Return what came of them."""
        return evaluate(**vars(self), on_episode=on_episode)


def run_jobs(
    jobs: Sequence[Job], processes: int, on_progress: Callable[[int], None] | None = None
) -> list[Evaluation]:
    """Return what came of each job, the same however many `processes` work side by side.

    Args:
        jobs: The jobs.
        processes: How many at once, see `workers.run_all`.
        on_progress: Called with the number of episodes that were done since.

    Raises:
        ConfigError: If `processes` is below 1; further errors as of `evaluate`.
    """
    tell = on_progress or (lambda _: None)
    if processes == 1:  # then each episode is told
        return [job.run(lambda _: tell(1)) for job in jobs]
    return run_all([job.run for job in jobs], processes, lambda i: tell(jobs[i].episodes))


def run_episode(
    env: CareEnv,
    policies: Mapping[str, Policy],
    seed: int,
    *,
    on_step: StepHook | None = None,
) -> Episode:
    """Run one episode to its end and return what came of it.

    The policy of each role is seeded from the episode's seed and the role's place in the task, so
    that a role acts alike whoever else is in the scene.

    Args:
        env: The environment.
        policies: A policy for each role that the environment leaves to be learned.
        seed: Seed of the episode, not negative.
        on_step: Called once after the reset and then after each control step.

    Raises:
        ConfigError: If a role has no policy, or the seed is negative.
    """
    missing = sorted(set(env.possible_agents) - set(policies))
    if missing:
        raise ConfigError(f"no policy for {missing}; there are policies for {sorted(policies)}")
    if seed < 0:
        raise ConfigError(f"seed must not be negative, got {seed}")
    env.reset(seed=seed)
    order = list(env.task.roles())
    for role in env.possible_agents:
        policies[role].reset(np.random.default_rng([seed, order.index(role)]))
    returns = dict.fromkeys(env.possible_agents, 0.0)
    costs: dict[str, float] = {}
    steps = 0
    if on_step is not None:
        on_step(env)
    while not env.is_over:
        actions = {role: policies[role].act() for role in env.agents}
        _, rewards, *_, infos = env.step(actions)  # type: ignore[arg-type]  # float64 will do
        steps += 1
        for role, reward in rewards.items():
            returns[role] += reward
            if "cost" in infos[role]:
                costs[role] = costs.get(role, 0.0) + infos[role]["cost"]
        if on_step is not None:
            on_step(env)
    task = env.task
    people = {} if env.company is None else dict(env.company.playing)
    return Episode(
        seed,
        bool(task.succeeded()),
        steps,
        env.world.time,
        returns,
        numbers(task.report()) | env.told(),
        costs,
        people,
        task.feasible.reason,
    )


def numbers(report: Mapping[str, Any]) -> dict[str, float]:
    """Return what a task reports as plain numbers."""
    return {name: float(value) for name, value in report.items()}


def lead_policies(
    task: str, policy: str, others: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Return the name of a policy for each role of a task.

    Args:
        task: Name of the task.
        policy: Policy of the robots. `random` stands for everybody: all roles act at random.
        others: Policies of single roles, before all else.

    The other roles are played by their default partner.

    Raises:
        UnknownNameError: If there is no such task or role.
    """
    roles = task_class(task).roles()
    for role in others or {}:
        check_name(f"role in task {task!r}", role, roles)
    leads = lead_roles(task)
    out = {
        name: policy if name in leads or policy == RANDOM else role.partner
        for name, role in roles.items()
    }
    return {name: found for name, found in {**out, **(others or {})}.items() if found is not None}


def played_cast(task: str, cast: Mapping[str, Any], policies: Mapping[str, Any]) -> dict[str, Any]:
    """Return a cast in which scripts speak, and act through `posture` where nothing is said of their muscles.

    Policies are played here beside an environment in which all roles are left to be learned, and whose
    people have excitations then; see `HumanCast.excitation`.

    Args:
        task: The name of the task.
        cast: As for `evaluate`.
        policies: As for `evaluate`.
    """
    roles, out = task_class(task).roles(), dict(cast)
    for name, role in roles.items():
        player = policies.get(name, role.partner)
        entry = cast.get(name, {} if role.default is not None else None)
        if not isinstance(player, str) or player.startswith("learned") or is_policy_file(player):
            continue  # a network has the actions that it was trained with
        fields = {"model": entry} if isinstance(entry, str | Path) else entry
        if not isinstance(fields, Mapping):
            continue
        if fields.get("actuation") == "muscle":
            out[name] = fields = {"excitation": "posture", **fields}
        if role.speaks and player != "random" and fields.get("excitation", "posture") == "posture":
            out[name] = {"moves": [*(role.moves or ()), "speak"], **fields}
    return out


def make_players(
    env: CareEnv, task: str, policies: Mapping[str, Any]
) -> tuple[dict[str, str], dict[str, Policy]]:
    """Return the names of the policies and the policies themselves, for each role to be learned.

    Args:
        env: The environment.
        task: The name of its task.
        policies: As for `evaluate`; those of optional roles that nobody plays are left out.

    Raises:
        UnknownNameError: If a role or a policy does not exist.
        ConfigError: If a role has no policy.
    """
    roles = env.task.roles()
    for role in policies:
        check_name(f"role in task {task!r}", role, roles)
    names: dict[str, str] = {}
    players: dict[str, Policy] = {}
    for role in env.possible_agents:
        chosen = policies.get(role, roles[role].partner)
        if chosen is None:
            raise ConfigError(f"role {role!r} of task {task!r} has no default policy: name one")
        made_by = chosen if isinstance(chosen, str | Path) else type(chosen).__name__
        names[role] = str(getattr(chosen, "__name__", made_by))
        players[role] = make_policy(env, task, role, chosen)
    return names, players


def model_names(env: CareEnv) -> dict[str, str]:
    """Return the name of the robot or avatar that plays each role."""
    out = {}
    for role, agent in env.cast.items():
        facts = agent.describe()
        out[role] = facts.get("avatar") or facts.get("model") or type(agent).__name__
    return out if env.company is None else {**out, **env.company.called}


def person_hashes(env: CareEnv) -> dict[str, str]:
    """Return a hash of everything that each person is who plays now, by the name in the cast."""
    out = {}
    for role, agent in env.cast.items():
        if isinstance(agent, Human):
            model = (
                model_of(env.setup["cast"].get(role)) or env.task.roles()[part_name(role)].default
            )
            name = model if isinstance(model, str | Path) else agent.avatar.name
            out[Path(name).stem if Path(name).suffix else str(name)] = person_hash(agent.avatar)
    return out


def _by_role(what: str, sums: Sequence[Mapping[str, float]]) -> dict[str, dict[str, Any]]:
    """Return the mean over episodes of what each role summed up, and its 95 % interval."""
    values = {role: [each[role] for each in sums] for role in sums[0]}
    return {
        f"mean_{what}": {role: float(np.mean(of)) for role, of in values.items()},
        f"mean_{what}_interval_95": {role: mean_interval(of) for role, of in values.items()},
    }


def mean_interval(values: Sequence[float]) -> list[float] | None:
    """Return Student's 95 % interval of a mean, [low, high]; None of fewer than two values.

    Source: Student (1908), Biometrika 6, 1-25. Of measures that are never negative, and zero in most
    episodes, it may begin below zero.
    """
    count = len(values)
    if count < 2:
        return None
    mean, spread = float(np.mean(values)), float(np.std(values, ddof=1))
    half = float(stdtrit(count - 1, 0.975)) * spread / math.sqrt(count)
    return [mean - half, mean + half]


def wilson_interval(successes: int, count: int) -> tuple[float, float]:
    """Return Wilson's score interval of a success rate, 95 %.

    Source: Wilson (1927), J. Am. Stat. Assoc. 22, 209-212. Unlike the usual interval it is right
    for rates near 0 and 1.
    """
    found = binomtest(successes, count).proportion_ci(0.95, method="wilson")
    return float(found.low), float(found.high)


def _came(metric: str, value: float) -> float | None:
    return None if metric.startswith(EVENT) and value < 0 else float(value)
