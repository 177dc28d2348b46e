"""How fast experience is gathered and learned from.

Method. One environment is stepped by itself, with random actions and with its resets; and several are
stepped through `BatchedEnv` and TorchRL's collector, in this one process, with a fresh policy of two
layers of 256. Actions of both come from one distribution, so that the physics is alike. The two take
turns of half a second, and a figure is the steps of all turns over the processor time of the thread: on
a quiet core that is the time on the clock, and on a busy one nearly the same. Policy, tensors, resets
and putting batches together, as short as the task's config has them, are all on the clock.

With worker processes each has as many environments, so that the work grows with them, and the clock is
that on the wall. They are measured in two ways. Asynchronous ones, `async://N`, have a policy each and
are measured one count after the other, since they go on while nobody asks; the first batches, of the
warm-up, are left out. Of those in step, all wait for the slowest at every step, and then for the policy:
their counts take turns. A figure is the median of its turns of half a second, and the efficiency is that
over as many times the figure of one process of the same kind.

Learning is a short training by soft actor-critic in this process, with the settings of the task's config
but a short warm-up. `updates_per_s` is of the time spent learning, and `learner_share` is that time over
the whole, both processor time again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from tensordict.nn import TensorDictModuleBase

from rcare_marl.baselines.algorithms.network import Actor, ExploringPolicy, group_shapes
from rcare_marl.baselines.algorithms.off_policy import OffPolicyConfig
from rcare_marl.baselines.algorithms.sac import Sac
from rcare_marl.config import load
from rcare_marl.envs.learning import BatchedEnv, EnvRecipe
from rcare_marl.errors import ConfigError
from rcare_marl.provenance import versions

from .cluster import ASYNC
from .collector import make_collector, shut_down
from .config import default_config

TASK, PROCESSES, SECONDS = "feeding", "1,2", 10.0  # what is measured where nothing is said
MEASURED_WITH = ("pybullet", "numpy", "torch", "torchrl", "tensordict")
ENVS = 8  # of each process
HIDDEN = (256, 256)
BLOCK = 16  # steps of the environment by itself between two looks at the clock
TURN = 0.5  # [s]
LEAST_TURNS = 3
WARM_UP = 400  # steps before learning, of the short training
ENDLESS = 10**12  # steps
WARM_BATCHES = 3  # of each asynchronous worker
WANTED = {"collector_ratio": 0.7, "efficiency_at_16": 0.85}

Source = Callable[[], int]  # does some steps and returns how many


def bench(task: str = TASK, processes: str = PROCESSES, seconds: float = SECONDS) -> dict[str, Any]:
    """Return what `rcare-marl bench learning` prints; `processes` is a text such as `1,4,16`."""
    result = measure(task, processes=process_counts(processes), seconds=seconds)
    return result | {"versions": versions(MEASURED_WITH)}


def show(result: Mapping[str, Any]) -> None:
    """Print what `bench` returned as a table."""
    from rcare_marl.console import console, table

    envs = result["envs_per_process"]
    title = f"{result['task']}, {envs} environments a process, load {result['load']:.1f}"
    console().print(table(title, ("what", "figure"), lines(result)))


def measure(
    task: str, *, processes: Sequence[int] = (1,), seconds: float = SECONDS, envs: int = ENVS
) -> dict[str, Any]:
    """Return what was measured, as plain values for JSON.

    Args:
        task: Name of the task.
        processes: Counts of worker processes; 1, which the others are compared with, is added.
        seconds: Time of each measurement [s]: of one core, of each count of processes, of learning.
        envs: Environments of each process.

    Raises:
        ConfigError: If a number is impossible.
        UnknownNameError: If there is no such task.
    """
    if not processes or min(processes) < 1 or envs < 1 or not seconds > 0:
        raise ConfigError(
            "processes, envs and seconds must be positive, "
            f"got {list(processes)}, {envs} and {seconds}"
        )
    recipe, threads = EnvRecipe(task), torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        result = _one_core(recipe, envs, seconds)
        counts = sorted({1, *processes})
        rows = _rows(counts, [_asynchronous(recipe, n, envs, seconds) for n in counts])
        result |= {
            "processes": rows,
            "in_step": _rows(counts, _in_step(recipe, counts, envs, seconds)),
        }
        result |= _learning(recipe, envs, seconds)
    finally:
        torch.set_num_threads(threads)
    found = {f"efficiency_at_{row['processes']}": row["efficiency"] for row in rows}
    found["collector_ratio"] = result["collector_ratio"]
    met = {name: bool(found[name] >= WANTED[name]) for name in WANTED if name in found}
    asked = {"task": task, "envs_per_process": envs, "seconds": seconds}
    return {**asked, **result, "wanted": WANTED, "met": met, **_machine()}


def _one_core(recipe: EnvRecipe, envs: int, seconds: float) -> dict[str, Any]:
    with _single(recipe) as single, _batched(recipe, envs, 0) as batched:
        one, many = _take_turns([single, batched], 2 * seconds, time.thread_time)
    raw, collected = (
        sum(steps for steps, _ in turns) / sum(spent for _, spent in turns) for turns in (one, many)
    )
    return {
        "raw_steps_per_s": raw,
        "collector_steps_per_s": collected,
        "collector_ratio": collected / raw,
    }


def _in_step(recipe: EnvRecipe, counts: Sequence[int], envs: int, seconds: float) -> list[float]:
    """Return steps/s of workers that wait for each other."""
    with contextlib.ExitStack() as stack:
        sources = [stack.enter_context(_batched(recipe, n * envs, n)) for n in counts]
        rounds = _take_turns(sources, len(counts) * seconds, time.perf_counter)
    return [_median_rate(turns) for turns in rounds]


def _asynchronous(recipe: EnvRecipe, count: int, envs: int, seconds: float) -> float:
    """Return steps/s of workers that do not."""
    with contextlib.closing(BatchedEnv(recipe, count=1)) as env:
        policy = _fresh_policy(env)
    collector = make_collector(
        recipe,
        policy,
        envs=count * envs,
        workers=f"{ASYNC}{count}",
        seed=0,
        frames_per_batch=count * envs * _config(recipe.task).rollout,
        total_frames=ENDLESS,
    )
    batches = iter(collector)
    try:
        for _ in range(count * WARM_BATCHES):
            next(batches)
        (turns,) = _take_turns([lambda: next(batches).numel()], seconds, time.perf_counter)
    finally:
        shut_down(collector)
    return _median_rate(turns)


def _median_rate(turns: Sequence[tuple[int, float]]) -> float:
    return statistics.median(steps / spent for steps, spent in turns)


def _rows(counts: Sequence[int], rates: Sequence[float]) -> list[dict[str, Any]]:
    return [
        {"processes": n, "steps_per_s": rate, "efficiency": rate / (n * rates[0])}
        for n, rate in zip(counts, rates, strict=True)
    ]


def _learning(recipe: EnvRecipe, envs: int, seconds: float) -> dict[str, Any]:
    config = dataclasses.replace(_config(recipe.task), warm_up=WARM_UP)
    env = BatchedEnv(recipe, count=envs)
    sac = Sac(config, env)
    updates, learned, steps, begin = 0.0, 0.0, 0, time.thread_time()
    collector = _collector(recipe, env, sac.policy())
    try:
        is_warm = False
        for batch in collector:
            before = time.thread_time()
            due = sac.learn(batch)["updates"]
            now = time.thread_time()
            if is_warm:
                updates, learned, steps = (
                    updates + due,
                    learned + now - before,
                    steps + batch.numel(),
                )
            else:
                begin, is_warm = now, due > 0  # the first updates take longer than others
            if updates and now - begin > seconds:
                break
    finally:
        shut_down(collector)
    return {
        "updates_per_s": updates / learned,
        "batch_size": config.batch_size,
        "update_to_data": config.update_to_data,
        "learner_share": learned / (now - begin),
        "training_steps_per_s": steps / (now - begin),
    }


def _config(task: str) -> OffPolicyConfig:
    """Return the settings that ship for a task, or those of every task."""
    shipped = default_config(task)
    is_sac = shipped.get("algo", "sac") == "sac"
    return load(OffPolicyConfig, shipped.get("algorithm", {}) if is_sac else {})


@contextlib.contextmanager
def _single(recipe: EnvRecipe) -> Iterator[Source]:
    """Step one environment by itself."""
    env = recipe.make()
    rng = np.random.default_rng(0)
    env.reset(seed=0)

    def step() -> int:
        for _ in range(BLOCK):
            if env.is_over:
                env.reset()
            spaces = {role: env.action_space(role) for role in env.agents}
            env.step(
                {
                    role: space.low
                    + (np.tanh(rng.standard_normal(space.shape, np.float32)) + 1)
                    / 2
                    * (space.high - space.low)
                    for role, space in spaces.items()
                }
            )
        return BLOCK

    try:
        yield step
    finally:
        env.close()


@contextlib.contextmanager
def _batched(recipe: EnvRecipe, count: int, workers: int) -> Iterator[Source]:
    """Step environments through the collector, with a fresh policy."""
    env = BatchedEnv(recipe, count=count, workers=workers)
    collector = _collector(recipe, env, _fresh_policy(env))
    batches = iter(collector)
    try:
        yield lambda: next(batches).numel()
    finally:
        shut_down(collector)


def _fresh_policy(env: BatchedEnv) -> ExploringPolicy:
    shapes = group_shapes(env).items()
    actors = {group: Actor(shape, HIDDEN, last_layer_scale=0.01) for group, shape in shapes}
    return ExploringPolicy(actors, warming=False)


def _collector(recipe: EnvRecipe, env: BatchedEnv, policy: TensorDictModuleBase) -> Any:
    return make_collector(
        recipe,
        policy,
        envs=env.count,
        workers=0,
        seed=0,
        frames_per_batch=env.count * _config(recipe.task).rollout,
        total_frames=ENDLESS,
        env=env,
    )


def _take_turns(
    sources: Sequence[Source], seconds: float, clock: Callable[[], float]
) -> list[list[tuple[int, float]]]:
    """Return for each source (steps, time [s]) of its turns; the first ones are not counted."""
    turns: list[list[tuple[int, float]]] = [[] for _ in sources]
    for source in sources:
        source()
    end = time.monotonic() + seconds
    while len(turns[-1]) < LEAST_TURNS or time.monotonic() < end:
        for source, taken in zip(sources, turns, strict=True):
            steps, begin = 0, clock()
            while steps == 0 or clock() - begin < TURN:
                steps += source()
            taken.append((steps, clock() - begin))
    return turns


def _machine() -> dict[str, Any]:
    return {
        "machine": platform.platform(),
        "cores": len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count(),
        "load": os.getloadavg()[0],
        "python": platform.python_version(),
        "torch": torch.__version__,
    }


def lines(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what `measure` returned in words: what, and the figure."""
    out = [
        ("one environment by itself", f"{result['raw_steps_per_s']:.0f} steps/s"),
        ("collector, one core", f"{result['collector_steps_per_s']:.0f} steps/s"),
        ("ratio", f"{result['collector_ratio']:.2f}"),
    ]
    for key, kind in (("processes", "asynchronous"), ("in_step", "in step")):
        for row in result[key]:
            rate, efficiency = row["steps_per_s"], row["efficiency"]
            noun = "process" if row["processes"] == 1 else "processes"
            said = f"{rate:.0f} steps/s, efficiency {efficiency:.2f}"
            out.append((f"{row['processes']} {noun}, {kind}", said))
    size = result["batch_size"]
    return out + [
        ("learning", f"{result['updates_per_s']:.0f} updates/s of {size} transitions"),
        ("its share of a training", f"{result['learner_share']:.2f}"),
        ("steps of a training", f"{result['training_steps_per_s']:.0f} per s"),
    ]


def process_counts(text: str) -> list[int]:
    """Return the numbers in a text such as `1,4,16`.

    Raises:
        ConfigError: If it is none.
    """
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise ConfigError(f"processes is a list such as 1,4,16, got {text!r}") from None
