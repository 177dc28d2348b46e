"""The command `bench batch`: how fast a task goes in MuJoCo, beside Bullet in the same run on one core.

Blocks of control steps with the same small random actions run in turns on either engine; times are
processor time of the thread, and the ratio is that of two medians.

With `processes` a batch of MuJoCo's environments is stepped over so many and over one, in turns, as many
environments to each; times are on the clock, `efficiency` is by how much the one is faster than the other,
as a share of the number of processes. `loop_efficiency` is the same of a loop in Python that touches no
memory and waits for nobody: what the machine itself allows.
"""

from __future__ import annotations

import multiprocessing
import statistics
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, closing
from functools import partial
from multiprocessing.synchronize import Barrier
from typing import Any

import numpy as np

from rcare_marl.console import console, table
from rcare_marl.engines import ENGINES
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.learning import CareVectorEnv, make_vector
from rcare_marl.errors import check_name

from ..workers import one_count
from .environment import ACTION_SCALE, STEPS, in_turns, surroundings

DEVICES = ("cpu",)
BLOCK = 10  # control steps
WANTED = {"ratio": 2.0, "efficiency": 0.85}  # times as fast as Bullet; of as many processes
ENVS = 16  # of each process
LOOP = 10_000_000  # rounds of a loop, about half a second
clock = time.thread_time
_barrier: Barrier  # of a process that measures a loop


def bench(
    task: str = "feeding",
    device: str = "cpu",
    steps: int = STEPS,
    seed: int = 0,
    processes: str = "1",
) -> dict[str, Any]:
    """Return steps per second on either engine, as plain values for JSON.

    Args:
        task: The task; one that runs on both engines.
        device: Where MuJoCo runs, one of `DEVICES`.
        steps: Control steps to time on each.
        seed: Seed of resets and actions.
        processes: Over how many a batch is spread, too.

    Raises:
        UnknownNameError: If there is no such device.
        ConfigError: If the count of processes is none.
    """
    check_name("device", device, DEVICES)
    count = one_count("batch", processes)
    with ExitStack() as stack:
        players = {
            name: _Player(stack.enter_context(closing(make(task, engine=name))), seed)
            for name in ENGINES
        }
        for player in players.values():
            player.play(2 * BLOCK)  # compiles, and fills caches
        blocks = {name: partial(player.play, BLOCK) for name, player in players.items()}
        found = in_turns(blocks, max(steps // BLOCK, 1))
    speed = {name: 1.0 / statistics.median(times) for name, times in found.items()}
    ratio = speed["mujoco"] / speed["bullet"]
    result: dict[str, Any] = {
        "task": task,
        "device": device,
        "steps": steps,
        "seed": seed,
        "env_steps_per_s": speed["mujoco"],
        "bullet_env_steps_per_s": speed["bullet"],
        "ratio": ratio,
    }
    if count > 1:
        result |= _spread(task, count, max(steps // BLOCK, 1), seed)
    wanted = {key: value for key, value in WANTED.items() if key in result}
    met = {key: bool(result[key] >= value) for key, value in wanted.items()}
    return result | {"wanted": wanted, "met": met} | surroundings()


def _spread(task: str, processes: int, rounds: int, seed: int) -> dict[str, Any]:
    """Return steps per second of a batch over one process and over several."""
    counts = (1, processes)
    with ExitStack() as stack:
        envs = [
            stack.enter_context(
                closing(make_vector(task, num_envs=n * ENVS, processes=n, seed=seed))
            )
            for n in counts
        ]
        blocks = {str(env.num_envs): partial(_batch_time, env) for env in envs}
        for env in envs:
            env.reset(seed=seed)
            env.action_space.seed(seed)
        for block in blocks.values():
            block()
        times = in_turns(blocks, rounds)
    one, many = (1.0 / statistics.median(taken) for taken in times.values())
    return {
        "processes": processes,
        "envs_per_process": ENVS,
        "one_process_steps_per_s": one,
        "steps_per_s": many,
        "efficiency": many / (processes * one),
        "loop_efficiency": _loop_efficiency(processes),
    }


def _loop_efficiency(processes: int) -> float:
    """Return the speed of a loop in each of several processes at once, as a share of its speed alone."""
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(processes)
    with ProcessPoolExecutor(processes, context, _keep, (barrier,)) as pool:
        together = list(pool.map(_loop_time, [True] * processes))
        alone = [pool.submit(_loop_time, False).result() for _ in range(3)]
    return statistics.median(alone) / statistics.median(together)


def _keep(barrier: Barrier) -> None:
    global _barrier
    _barrier = barrier


def _loop_time(waits: bool) -> float:
    """Return how long a loop takes on the clock [s], begun when all processes are there if it waits."""
    if waits:
        _barrier.wait()
    begin, value = time.perf_counter(), 0.0
    for k in range(LOOP):
        value += 0.5 * k
    return time.perf_counter() - begin


def _batch_time(env: CareVectorEnv) -> float:
    """Return the time on the clock of a step of one environment [s], resets included."""
    begin = time.perf_counter()
    for _ in range(BLOCK):
        env.step(ACTION_SCALE * env.action_space.sample())
    return (time.perf_counter() - begin) / (BLOCK * env.num_envs)


class _Player:
    """Plays episode after episode with random actions."""

    def __init__(self, env: CareEnv, seed: int) -> None:
        self._env, self._seed = env, seed
        self._rng = np.random.default_rng(seed)

    def play(self, steps: int) -> float:
        """Return the time of a control step [s]; resets are not on the clock."""
        env, total = self._env, 0.0
        for _ in range(steps):
            if env.is_over:
                env.reset(seed=self._seed)
                self._seed += 1
            actions = {
                role: (ACTION_SCALE * self._rng.uniform(-1, 1, space.shape)).astype(np.float32)
                for role, space in ((role, env.action_space(role)) for role in env.agents)
            }
            begin = clock()
            env.step(actions)
            total += clock() - begin
        return total / steps


def show(result: Mapping[str, Any]) -> None:
    """Print what `bench` returned as a table."""
    rows = [
        ("MuJoCo", f"{result['env_steps_per_s']:.0f} control steps per s"),
        ("Bullet", f"{result['bullet_env_steps_per_s']:.0f} control steps per s"),
        ("ratio", f"{result['ratio']:.2f}"),
    ]
    if "efficiency" in result:
        of = f"of {result['processes']} processes"
        rows.append(
            (of, f"{result['steps_per_s']:.0f} per s, efficiency {result['efficiency']:.2f}")
        )
        rows.append(("a loop in as many", f"efficiency {result['loop_efficiency']:.2f}"))
    console().print(table(f"{result['task']}, {result['device']}", ("what", "median"), rows))
