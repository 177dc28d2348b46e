"""The command `bench`: how fast an environment is, and how much of that is bare physics.

Method of `overhead_ratio`. The episode is cut into blocks of five control steps. Before each block the
state is saved; from this same state run, in turns first and second,

- five `env.step` with small random actions of all roles (a tenth of the range, so that food stays on a
  spoon and every step has the contacts of normal work), and
- as many bare `stepSimulation` calls of the same client as the block has physics steps, with the
  motor targets that are set: nothing but Bullet.

Each run begins right after a restore of the saved state, and the episode goes on from the state
that `env.step` reached. The ratio is that of the two medians. The one difference left is that the
torques of muscles, and those that carry the arm's weight, which Bullet forgets after each physics
step, are missing from the bare steps. Over half a second that hardly changes the contacts, which are
what costs (bare steps get 2 to 5 % dearer); over a second and more the person would slump, and the
ratio look better than it is. Blocks of one control step would time the first touch of restored memory.
One thread, garbage collection as usual, `time.perf_counter`, numba compiled before.
"""

from __future__ import annotations

import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import pybullet as bullet

from rcare_marl.baselines.evaluate import versions
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv

from .console import console, table

ACTION_SCALE = 0.1  # of the action range
BLOCK = 5  # control steps timed in one go
WARM_STEPS = 20  # control steps before the clock starts
RESETS = 20
STARTS = 5  # processes for each import time


def bench(task: str, steps: int, seed: int, cast: Mapping[str, Any]) -> dict[str, Any]:
    """Return measured speeds of a task, as plain values for JSON; all times are medians.

    Args:
        task: Name of the task.
        steps: Control steps to time.
        seed: Seed of resets and actions.
        cast: Who plays, by role.
    """
    begin = time.perf_counter()
    env = make(task, **cast)
    make_s = time.perf_counter() - begin
    try:
        rng = np.random.default_rng(seed)
        env.reset(seed=seed)
        for _ in range(WARM_STEPS):
            _go_on(env, seed)
            env.step(_actions(env, rng))
        resets = [_timed(partial(env.reset, seed=seed + i)) for i in range(RESETS)]
        pairs = _step_pairs(env, steps, seed, rng)
        substeps, control_dt = substep_count(env), env.task.control_dt
    finally:
        env.close()
    step, bare = (statistics.median(column) for column in zip(*pairs, strict=True))
    low, high = np.quantile([own / physics for own, physics in pairs], (0.25, 0.75))
    return {
        "task": task,
        "steps": steps,
        "seed": seed,
        "physics_steps_per_control_step": substeps,
        "env_steps_per_s": 1 / step,
        "physics_steps_per_s": substeps / step,
        "bare_physics_steps_per_s": substeps / bare,
        "real_time_factor": control_dt / step,
        "overhead_ratio": step / bare,
        "overhead_ratio_quartiles": [float(low), float(high)],
        "reset_ms": 1e3 * statistics.median(resets),
        "make_s": make_s,
        "import_s": import_time(),
        "machine": platform.platform(),
        "versions": versions(),
    }


def substep_count(env: CareEnv) -> int:
    """Return the physics steps in a control step."""
    return round(env.task.control_dt / env.world.physics_dt)


def import_time(starts: int = STARTS) -> float:
    """Return what `import rcare_marl` takes in a fresh process, less a bare interpreter [s]."""

    def start(code: str) -> float:
        command = [sys.executable, "-c", code]
        return _timed(lambda: subprocess.run(command, check=True, capture_output=True))

    pairs = [(start("import rcare_marl"), start("pass")) for _ in range(starts)]
    return statistics.median(full for full, _ in pairs) - statistics.median(b for _, b in pairs)


def _step_pairs(
    env: CareEnv, steps: int, seed: int, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Return the times of a control step and of its bare physics steps [s], block by block."""
    client, substeps = env.world.client, substep_count(env)
    longest = env.task.time_limit - (BLOCK + 1) * env.task.control_dt
    pairs: list[tuple[float, float]] = []
    env.reset(seed=seed)
    while len(pairs) * BLOCK < steps:
        if env.is_over or env.world.time > longest:
            env.reset(seed=seed + len(pairs))
        block = [_actions(env, rng) for _ in range(BLOCK)]
        before = bullet.saveState(physicsClientId=client)
        bare_first = bool(len(pairs) % 2)
        if bare_first:
            bare = _bare(client, before, BLOCK * substeps)
        bullet.restoreState(before, physicsClientId=client)
        begin, done = time.perf_counter(), 0
        for actions in block:
            env.step(actions)
            done += 1
            if env.is_over:
                break
        own = (time.perf_counter() - begin) / done
        if not bare_first:
            after = bullet.saveState(physicsClientId=client)
            bare = _bare(client, before, BLOCK * substeps)
            bullet.restoreState(after, physicsClientId=client)
            bullet.removeState(after, physicsClientId=client)
        bullet.removeState(before, physicsClientId=client)
        pairs.append((own, bare / BLOCK))
    return pairs


def _bare(client: int, state: int, count: int) -> float:
    """Return the time of `count` physics steps from a saved state [s]."""
    bullet.restoreState(state, physicsClientId=client)
    step = bullet.stepSimulation
    begin = time.perf_counter()
    for _ in range(count):
        step(physicsClientId=client)
    return time.perf_counter() - begin


def _go_on(env: CareEnv, seed: int) -> None:
    if env.is_over:
        env.reset(seed=seed)


def _actions(env: CareEnv, rng: np.random.Generator) -> dict[str, Any]:
    spaces = {role: env.action_space(role) for role in env.agents}
    return {
        role: (ACTION_SCALE * rng.uniform(-1, 1, space.shape)).astype(np.float32)
        for role, space in spaces.items()
    }


def _timed(what: Callable[[], object]) -> float:
    begin = time.perf_counter()
    what()
    return time.perf_counter() - begin


def show(result: Mapping[str, Any]) -> None:
    """Print what `bench` returned as a table."""
    low, high = result["overhead_ratio_quartiles"]
    rows = [
        ("control steps", f"{result['env_steps_per_s']:.0f} per s"),
        ("physics steps", f"{result['physics_steps_per_s']:.0f} per s"),
        ("bare physics steps", f"{result['bare_physics_steps_per_s']:.0f} per s"),
        ("real time factor", f"{result['real_time_factor']:.1f}"),
        ("overhead ratio", f"{result['overhead_ratio']:.3f} (quartiles {low:.3f} to {high:.3f})"),
        ("reset", f"{result['reset_ms']:.2f} ms"),
        ("make", f"{result['make_s']:.2f} s"),
        ("import", f"{result['import_s']:.2f} s"),
    ]
    console().print(table(f"{result['task']}, {result['steps']} steps", ("what", "median"), rows))
