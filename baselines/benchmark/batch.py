"""The command `bench batch`: how fast a task goes in MuJoCo, beside Bullet in the same run on one core.

Blocks of control steps with the same small random actions run in turns on either engine; times are
processor time of the thread, and the ratio is that of two medians.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping
from contextlib import ExitStack, closing
from functools import partial
from typing import Any

import numpy as np

from rcare_marl.console import console, table
from rcare_marl.engines import ENGINES
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.errors import check_name

from .environment import ACTION_SCALE, STEPS, in_turns, surroundings

DEVICES = ("cpu",)
BLOCK = 10  # control steps
WANTED = 2.0  # times as fast as Bullet
clock = time.thread_time


def bench(
    task: str = "feeding", device: str = "cpu", steps: int = STEPS, seed: int = 0
) -> dict[str, Any]:
    """Return steps per second on either engine, as plain values for JSON.

    Args:
        task: The task; one that runs on both engines.
        device: Where MuJoCo runs, one of `DEVICES`.
        steps: Control steps to time on each.
        seed: Seed of resets and actions.

    Raises:
        UnknownNameError: If there is no such device.
    """
    check_name("device", device, DEVICES)
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
    result = {
        "task": task,
        "device": device,
        "steps": steps,
        "seed": seed,
        "env_steps_per_s": speed["mujoco"],
        "bullet_env_steps_per_s": speed["bullet"],
        "ratio": ratio,
        "wanted": {"ratio": WANTED},
        "met": {"ratio": ratio >= WANTED},
    }
    return result | surroundings()


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
    console().print(table(f"{result['task']}, {result['device']}", ("what", "median"), rows))
