"""The command `bench homes`: what a whole house costs, to load and at each step.

Loading. A fresh process imports everything and opens a world, then the clock starts: `CareHome.load` and
`spawn`. `load_first_s` is with an empty cache, so that all geometry is made and written;
`load_again_s` with what that left.

Steps. The task runs with zero actions on a bare floor and in rooms of the house, the furniture of the
room articulated, each in a world of its own. In each block of five control steps all of them run one
after the other, and each block begins with another one, so that whatever slows the machine down meets
all of them. The first step of a block is not timed: it brings that world's memory back into the cache.
Times are processor time of the one thread; a ratio is that of two medians.
"""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from rcare_marl.console import console, table
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.homes import CareHome, find_place
from rcare_marl.envs.registry import task_class
from rcare_marl.errors import ConfigError
from rcare_marl.provenance import versions

from .environment import STEPS, in_turns

TASK = "feeding"
BLOCK = 5  # control steps that run in one go
STARTS = 3  # processes for each time of loading
WANTED = {"load_first_s": 3.0, "step_ratios": 1.2}
_LOAD = """
import sys, time
from rcare_marl.envs.homes import CareHome
from rcare_marl.world import World
world = World()
begin = time.perf_counter()
CareHome.load(sys.argv[1], level=int(sys.argv[2])).spawn(world)
print(time.perf_counter() - begin)
"""


def bench(home: str = "house_07", level: int = 1, steps: int = STEPS) -> dict[str, Any]:
    """Return measured costs of a house, as plain values for JSON.

    Args:
        home: Name of the house.
        level: Its level of accessibility.
        steps: Control steps to time in each room.

    Raises:
        UnknownNameError: If there is no such house.
    """
    CareHome.load(home, level=level)  # refuses a wrong name before anything takes time
    first, again = load_times(_LOAD, home, str(level))
    times = _step_times(_scenes(home, level), steps)
    bare = times.pop("bare floor")
    ratios = {name: step / bare for name, step in times.items()}
    return {
        "home": home,
        "level": level,
        "task": TASK,
        "steps": steps,
        "load_first_s": first,
        "load_again_s": again,
        "bare_step_ms": 1e3 * bare,
        "step_ratios": ratios,
        "wanted": WANTED,
        "met": {
            "load_first_s": first <= WANTED["load_first_s"],
            "step_ratios": max(ratios.values()) <= WANTED["step_ratios"],
        },
        "machine": platform.platform(),
        "versions": versions(),
    }


def load_times(code: str, *arguments: str, starts: int = STARTS) -> tuple[float, float]:
    """Return the median times of loading with an empty and with a full cache [s].

    Args:
        code: A program that prints how long it took, last [s].
        arguments: Of its command line.
        starts: How often it is started in either way, each time in a process of its own.
    """
    command = [sys.executable, "-c", code, *arguments]

    def load(cache: str) -> float:
        env = {**os.environ, "RCARE_MARL_CACHE": cache}
        done = subprocess.run(command, check=True, capture_output=True, text=True, env=env)
        return float(done.stdout.split()[-1])

    pairs = []
    for _ in range(starts):
        with tempfile.TemporaryDirectory() as cache:
            pairs.append((load(cache), load(cache)))
    first, again = (statistics.median(column) for column in zip(*pairs, strict=True))
    return first, again


def _scenes(home: str, level: int) -> dict[str, dict[str, Any]]:
    """Return arguments of `make`: without a house, and in a room of each kind."""
    scenes: dict[str, dict[str, Any]] = {"bare floor": {}}
    task, house = task_class(TASK), CareHome.load(home, level=level)
    for kind in task.room_kinds:
        try:
            room = find_place(house, (kind,), task.footprint).home_room.name
        except ConfigError:
            continue  # no such room is large enough
        scenes[room] = {"home": home, "level": level, "room": room}
    return scenes


def _step_times(scenes: Mapping[str, Mapping[str, Any]], steps: int) -> dict[str, float]:
    """Return the median time of a control step in each scene [s]."""
    policies = {"recipient": "cooperative"}
    envs = {name: make(TASK, policies=policies, **place) for name, place in scenes.items()}
    try:
        for env in envs.values():
            env.reset(seed=0)
        blocks = {name: partial(_block, env) for name, env in envs.items()}
        times = in_turns(blocks, -(-steps // (BLOCK - 1)))
    finally:
        for env in envs.values():
            env.close()
    return {name: statistics.median(chain(*found)) for name, found in times.items()}


def _block(env: CareEnv) -> list[float]:
    if env.is_over or env.world.time > env.task.time_limit - (BLOCK + 1) * env.task.control_dt:
        env.reset(seed=0)
    still = {role: np.zeros(env.action_space(role).shape, np.float32) for role in env.agents}
    times = []
    for _ in range(BLOCK):
        begin = time.thread_time()
        env.step(still)
        times.append(time.thread_time() - begin)
    return times[1:]


def show(result: Mapping[str, Any]) -> None:
    """Print what `bench` returned as a table."""
    most = 100 * (result["wanted"]["step_ratios"] - 1)
    rows = [
        (
            "load, the first time",
            f"{result['load_first_s']:.2f} s (at most {result['wanted']['load_first_s']:.0f})",
        ),
        ("load, again", f"{result['load_again_s']:.2f} s"),
        ("a step on a bare floor", f"{result['bare_step_ms']:.2f} ms"),
        *(
            (f"a step in {name}", f"{100 * (ratio - 1):+.0f} % (at most {most:+.0f})")
            for name, ratio in result["step_ratios"].items()
        ),
    ]
    console().print(
        table(
            f"{result['task']} in {result['home']}, level {result['level']}",
            ("what", "median"),
            rows,
        )
    )
