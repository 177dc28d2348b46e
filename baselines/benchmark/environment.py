"""The command `bench`: how fast an environment is, and how much of that is bare physics.

Method. Two environments go through the same episodes with the same small random actions of all roles (a
tenth of the range, so that food stays on a spoon and every step has the contacts of normal work). An
episode is cut into blocks of five control steps. In each block, in turns first and second,

- the one environment runs `env.step` against the clock, and
- the other one, its twin, runs the same steps without a clock, and a record is made of every command
  that reaches Bullet: targets of motors, torques, forces, poses. Then it goes back to the state before,
  and as many steps of bare physics run against the clock, in two ways.

`overhead_ratio` is the time of `env.step` over that of bare `stepSimulation` calls from the same state, with
the motor targets that are set. It depends on how things go on when nobody acts: an arm that has come to
rest needs fewer iterations of the solver, and food that a hand lets sink needs more.

`overhead_ratio_same_commands` is that over the same physics: the record is played, commands as they came,
and between them `stepSimulation` against the clock. It ends in the state where `env.step` ended. Nothing of
Python is on the clock, nor of what Python leaves behind in the caches.

Ratios are those of two medians.

One thread, garbage collection as usual, numba compiled before. Times are processor time of the thread, as
in `bench homes`: on a quiet core that is the time on the clock, and on a busy one nearly the same.
"""

from __future__ import annotations

import contextlib
import copy
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, TypeVar

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.bullet import bullet
from rcare_marl.console import console, table
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.provenance import versions

ACTION_SCALE = 0.1  # of the action range
STEPS = 300  # control steps, where nothing else is said
BLOCK = 5  # control steps timed in one go
WARM_STEPS = 20  # control steps before the clock starts
RESETS = 20
STARTS = 5  # processes for each import time
clock = time.thread_time
COMMANDS = ("setJointMotorControl", "applyExternal", "resetBase", "resetJoint", "changeConstraint")

# Physics at 1/240 s on one quiet core: of tasks without soft matter, and of those with.
RIGID = {"real_time_factor": 30.0, "overhead_ratio": 1.25, "reset_ms": 20.0}
SPONGE = {"real_time_factor": 10.0, "reset_ms": 20.0}
CLOTH = {"real_time_factor": 3.0, "reset_ms": 200.0}
FLUID = {"real_time_factor": 5.0}
TISSUE = {"real_time_factor": 2.0}  # whoever is cast with flesh that yields
SOFT = {
    "bathing": SPONGE,
    "phyrc_bathing": SPONGE,
    "dressing": CLOTH,
    "phyrc_dressing": CLOTH,
    "drinking": FLUID,
}

T = TypeVar("T")
# A command to Bullet with its arguments, or None for a physics step.
Entry = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]] | None


def bench(task: str, steps: int, seed: int, cast: Mapping[str, Any]) -> dict[str, Any]:
    """Return measured speeds of a task, as plain values for JSON; all times are medians.

    Args:
        task: Name of the task.
        steps: Control steps to time.
        seed: Seed of resets and actions.
        cast: Who plays, by role, and where.
    """
    with contextlib.ExitStack() as stack:
        begin = time.perf_counter()
        env = stack.enter_context(contextlib.closing(make(task, **cast)))
        make_s = time.perf_counter() - begin
        twin = stack.enter_context(contextlib.closing(make(task, **cast)))
        rng = np.random.default_rng(seed)
        for each in (env, twin):
            _warm_up(each, seed)
        resets = [_timed(partial(env.reset, seed=seed + i), clock) for i in range(RESETS)]
        times = _step_times(env, twin, steps, seed, rng)
        substeps, control_dt = substep_count(env), env.task.control_dt
        is_soft = any(isinstance(a, Human) and a.tissue is not None for a in env.cast.values())
    step, same, frozen = (statistics.median(column) for column in zip(*times, strict=True))
    low, high = np.quantile([own / physics for own, _, physics in times], (0.25, 0.75))
    result = {
        "task": task,
        "level": env.task.place.level,
        "steps": steps,
        "seed": seed,
        "physics_steps_per_control_step": substeps,
        "env_steps_per_s": 1 / step,
        "physics_steps_per_s": substeps / step,
        "bare_physics_steps_per_s": substeps / frozen,
        "real_time_factor": control_dt / step,
        "overhead_ratio": step / frozen,
        "overhead_ratio_quartiles": [float(low), float(high)],
        "overhead_ratio_same_commands": step / same,
        "reset_ms": 1e3 * statistics.median(resets),
        "make_s": make_s,
    }
    bounds = TISSUE if is_soft else SOFT.get(task, RIGID)
    return result | {"wanted": bounds, "met": _met(result, bounds)}


def _met(result: Mapping[str, Any], bounds: Mapping[str, float]) -> dict[str, bool]:
    return {
        key: bool(result[key] >= bound if key == "real_time_factor" else result[key] <= bound)
        for key, bound in bounds.items()
    }


def in_turns(blocks: Mapping[str, Callable[[], T]], rounds: int) -> dict[str, list[T]]:
    """Run blocks one after the other, each round beginning with another one; return what each gave."""
    names, found = list(blocks), {name: list[T]() for name in blocks}
    for k in range(rounds):
        turn = k % len(names)
        for name in (*names[turn:], *names[:turn]):
            found[name].append(blocks[name]())
    return found


def surroundings() -> dict[str, Any]:
    """Return what holds for every task: time to import, machine and versions."""
    return {"import_s": import_time(), "machine": platform.platform(), "versions": versions()}


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


def _warm_up(env: CareEnv, seed: int) -> None:
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    for _ in range(WARM_STEPS):
        if env.is_over:
            env.reset(seed=seed)
        env.step(_actions(env, rng))


def _step_times(
    env: CareEnv, twin: CareEnv, steps: int, seed: int, rng: np.random.Generator
) -> list[tuple[float, float, float]]:
    """Return the times of a control step, and of its physics: the same, and frozen [s], by block."""
    longest = env.task.time_limit - (BLOCK + 1) * env.task.control_dt
    times: list[tuple[float, float, float]] = []
    for each in (env, twin):
        each.reset(seed=seed)
    while len(times) * BLOCK < steps:
        if env.is_over or env.world.time > longest:
            for each in (env, twin):
                each.reset(seed=seed + len(times))
        block = [_actions(env, rng) for _ in range(BLOCK)]
        if len(times) % 2:
            bare, frozen = _physics_times(twin, block)
            own = _own_time(env, block)
        else:
            own = _own_time(env, block)
            bare, frozen = _physics_times(twin, block)
        times.append((own, bare, frozen))
    return times


def _own_time(env: CareEnv, block: list[dict[str, Any]]) -> float:
    """Return the time of one control step of a block [s]."""
    begin, done = clock(), 0
    for actions in block:
        env.step(actions)
        done += 1
        if env.is_over:
            break
    return (clock() - begin) / done


def _physics_times(env: CareEnv, block: list[dict[str, Any]]) -> tuple[float, float]:
    """Return the times of the physics of one control step [s]: the same, and frozen.

    The environment ends where the block leads.
    """
    client, tape, done = env.world.client, list[Entry](), 0
    before = bullet.saveState(physicsClientId=client)
    with recorded(tape):
        for actions in block:
            env.step(actions)
            done += 1
            if env.is_over:
                break
    count = tape.count(None)
    bullet.restoreState(before, physicsClientId=client)
    frozen = play([None] * count, client)
    bullet.restoreState(before, physicsClientId=client)
    bullet.removeState(before, physicsClientId=client)
    bare = play(tape, client)
    return bare / done, frozen / done


@contextlib.contextmanager
def recorded(tape: list[Entry]) -> Iterator[None]:
    """Write down all commands that reach Bullet, and its steps, while this lasts."""
    names = [name for name in dir(bullet) if name.startswith(COMMANDS)]
    real = {name: getattr(bullet, name) for name in (*names, "stepSimulation")}

    def spy(name: str, *args: Any, **kwargs: Any) -> Any:
        is_step = name == "stepSimulation"
        tape.append(None if is_step else (real[name], *copy.deepcopy((args, kwargs))))
        return real[name](*args, **kwargs)

    for name in real:
        setattr(bullet, name, partial(spy, name))
    try:
        yield
    finally:
        for name, function in real.items():
            setattr(bullet, name, function)


def play(tape: list[Entry], client: int) -> float:
    """Repeat what was recorded, and return the time that the physics steps took [s]."""
    step, total = bullet.stepSimulation, 0.0
    for entry in tape:
        if entry is None:
            begin = clock()
            step(client)
            total += clock() - begin
        else:
            command, args, kwargs = entry
            command(*args, **kwargs)
    return total


def _actions(env: CareEnv, rng: np.random.Generator) -> dict[str, Any]:
    spaces = {role: env.action_space(role) for role in env.agents}
    return {
        role: (ACTION_SCALE * rng.uniform(-1, 1, space.shape)).astype(np.float32)
        for role, space in spaces.items()
    }


def _timed(what: Callable[[], object], timer: Callable[[], float] = time.perf_counter) -> float:
    begin = timer()
    what()
    return timer() - begin


def show(result: Mapping[str, Any]) -> None:
    """Print what `bench` and `surroundings` returned as a table."""
    low, high = result["overhead_ratio_quartiles"]
    rows = [
        ("control steps", f"{result['env_steps_per_s']:.0f} per s"),
        ("physics steps", f"{result['physics_steps_per_s']:.0f} per s"),
        ("bare physics steps", f"{result['bare_physics_steps_per_s']:.0f} per s"),
        ("real time factor", f"{result['real_time_factor']:.1f}"),
        ("overhead ratio", f"{result['overhead_ratio']:.3f} (quartiles {low:.3f} to {high:.3f})"),
        ("same commands", f"{result['overhead_ratio_same_commands']:.3f}"),
        ("reset", f"{result['reset_ms']:.2f} ms"),
        ("make", f"{result['make_s']:.2f} s"),
        ("import", f"{result['import_s']:.2f} s"),
    ]
    console().print(table(f"{result['task']}, {result['steps']} steps", ("what", "median"), rows))
