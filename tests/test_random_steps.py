"""A million random steps: numbers stay finite and in their spaces, nothing falls through the floor.

On many cores: `pytest -m slow -n 8 --dist load --maxschedchunk 1 tests/test_random_steps.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import psutil
import pytest

import rcare_marl
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import task_class
from rcare_marl.soft.fluid import Fluid
from rcare_marl.soft.soft_object import ParticleObject
from rcare_marl.soft.soft_world import SoftWorld

STEPS = 1_000_000
PEOPLE = ("daniel", "jose", "karan", "kim", "morgan", "natalia")
COACHING = ("group_coaching", "social_coaching")
# Of all steps, by what a step costs: with particles a hundredth each, most for the two cheapest,
# which come first, so that no process is left with the longest at the end.
COSTLY = ("dressing", "drinking", "phyrc_bathing", "phyrc_dressing")
SHARES = {
    "scratching": 0.4,
    "toileting": 0.3,
    **dict.fromkeys((*COSTLY, *COACHING, "bathing"), 0.01),
}
SLACK = ("limb_repositioning", "recipient")  # a slack arm slips off the armrest: refused by name
HELD = (1, 15)  # control steps that an action is held, in turn: the longer, the farther all gets
LOOK = 20  # steps between two looks at every body and particle
SUNK = 0.03  # [m] that something thrown may sink before the floor has stopped it
# [m] more for who walks and kneels: the legs are posed and meet no floor, and toes of people of other
# sizes than the usual caregiver's are up to 0.034 m below it.
KNELT = 0.02
# [m] more for what a robot holds: a strong arm presses a light thing into the floor faster than the
# solver's iterations push it out (a toothbrush of 40 g, 0.033 m, for half a second).
PRESSED = 0.02
GROWTH = 64e6  # [bytes] of the process in the last two thirds of its steps, compiling included


def casts(task: str) -> list[dict[str, Any]]:
    """Return arguments of `make`: the usual cast, every robot that reaches, every person, muscles."""
    found: list[dict[str, Any]] = [{}]
    for role, part in task_class(task).roles().items():
        others: Any = PEOPLE if part.kind is Human else ()
        if part.kind is Robot:
            others = task_class(task).reachable_by or ()
        found += [{role: name} for name in sorted(others) if part.default not in (None, name)]
        if part.kind is Human and part.default is not None and (task, role) != SLACK:
            # Who also grasps or walks takes actions that no muscle has.
            action = {"excitation": "posture"} if part.moves else {}
            found.append({role: {"actuation": "muscle", **action}})
    return found


def cases() -> Iterator[tuple[str, dict[str, Any], int]]:
    """Return every task with every cast, and how many steps it takes."""
    tasks = sorted(rcare_marl.task_names(), key=lambda task: -SHARES.get(task, 0))
    rest = (1 - sum(SHARES.values())) / (len(tasks) - len(SHARES))
    for task in tasks:
        chosen = casts(task)
        for cast in chosen:
            yield task, cast, -int(-STEPS * SHARES.get(task, rest) // len(chosen))


def name(case: Any) -> str:
    task, cast, _ = case
    return "-".join(
        [task, *(f"{role}-{who}" if isinstance(who, str) else role for role, who in cast.items())]
    )


def lowest(env: CareEnv) -> tuple[float, str]:
    """Return how high above the floor the lowest thing is that can move [m], and what."""
    floor, *others = env.world.bodies
    assert floor.name == "floor"
    walk = [
        each.body for each in env.cast.values() if isinstance(each, Human) and "kneel" in each.moves
    ]
    held = [
        body
        for each in env.cast.values()
        if isinstance(each, Robot)
        for body in env.world.held_by(each.body)
    ]
    allowed = {**dict.fromkeys(walk, KNELT), **dict.fromkeys(held, PRESSED)}
    moving = [each for each in others if each.mass() > 0 and each.solid_links()]
    found = [
        (env.world.separation(each, floor, within=1.0) + allowed.get(each, 0.0), each.name)
        for each in moving
    ]
    for each in SoftWorld.of(env.world).objects if env.world.matter else []:
        if isinstance(each, ParticleObject):
            there = each.is_active if isinstance(each, Fluid) else slice(None)  # not yet drunk
            found.append((float(each.positions[there, 2].min(initial=np.inf)), each.name))
    return min(found)


def check(env: CareEnv, outcome: tuple[Any, ...]) -> None:
    observations, rewards, _, _, infos = outcome
    for role, seen in observations.items():
        assert env.observation_space(role).contains(seen), f"{role} observes what is in no space"
    assert np.isfinite(env.state()).all()
    numbers = [*rewards.values(), *(v for info in infos.values() for v in info.values())]
    assert np.isfinite(numbers).all(), infos


@pytest.mark.slow
@pytest.mark.parametrize("case", cases(), ids=name)
def test_random_steps_stay_finite_in_their_spaces_and_above_the_floor(case: Any) -> None:
    task, cast, steps = case
    rng, process, used = np.random.default_rng(len(name(case))), psutil.Process(), 0
    actions: dict[str, Any] = {}
    with rcare_marl.make(task, **cast) as env:
        episode, begun = 0, 0
        env.reset(seed=0)
        for step in range(steps):
            if env.is_over:
                episode, begun = episode + 1, step
                env.reset(seed=episode)
            if (step - begun) % HELD[episode % 2] == 0:
                spaces = {role: env.action_space(role) for role in env.agents}
                actions = {
                    role: rng.uniform(space.low, space.high).astype(np.float32)
                    for role, space in spaces.items()
                }
            check(env, env.step(actions))
            if step % LOOK == 0 or env.is_over:
                low, what = lowest(env)
                assert low > -SUNK, f"{what} is {-low:.3f} m below the floor in episode {episode}"
            if step == steps // 3:
                used = process.memory_info().rss
        grown = process.memory_info().rss - used
        assert grown < GROWTH, f"{grown:,} bytes more after {steps:,} steps"


def test_every_task_has_its_share_of_a_million_steps() -> None:
    found = list(cases())
    assert {task for task, _, _ in found} == set(rcare_marl.task_names())
    assert len({name(each) for each in found}) == len(found)
    assert sum(steps for _, _, steps in found) >= STEPS
