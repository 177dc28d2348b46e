"""Promises that every task keeps with other robots and people, and at every level of accessibility."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import pytest
from episode import assert_same, rollout
from pettingzoo.test.parallel_test import parallel_api_test
from variants import few

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.envs.homes import LEVELS
from rcare_marl.envs.registry import task_class
from rcare_marl.envs.task import Role
from rcare_marl.errors import ConfigError

HOME = "house_08"  # its doors have room for a wheelchair even at level 1
ROOMY = {"group_coaching": "house_03"}  # house_08 has no floor for a class at level 1
TASKS = rcare_marl.task_names()
ROBOTS = assets.names("robots")
PEOPLE = ("daniel", "jose", "karan", "kim", "morgan", "natalia")


def reaching(task: str) -> Collection[str]:
    """Return the robots that reach; only the default one where the task does not say."""
    said = task_class(task).reachable_by
    return said if said is not None else {str(task_class(task).roles()["robot"].default)}


# Each takes 2 s and more; test_reach.py dresses somebody else with another robot.
SLOW = {*(("dressing", role) for role in ("robot", "recipient", "caregiver"))}
SLOW |= {("phyrc_dressing", "robot"), ("phyrc_dressing", "recipient"), ("phyrc_bathing", "robot")}
SLOW |= {("drinking", "robot"), ("drinking", "recipient"), ("limb_repositioning", "robot")}
SLOW |= {("scratching", "robot"), ("scratching", "recipient"), ("tooth_brushing", "robot")}
SLOW |= {("group_coaching", role) for role in ("robot", "recipient", "second_recipient")}
SLOW |= {("tooth_brushing", "recipient"), ("ambulating", "recipient"), ("social_coaching", "robot")}
SLOW |= {("social_coaching", "recipient")}
SEARCHED = {("drinking", "stretch_re1_dex")}  # the search for its start takes 5 s


def casts() -> list[Any]:
    """Return every task with every robot and every person; beyond one of each, in turn, they are slow."""
    cases = []
    for task in TASKS:
        for role, part in task_class(task).roles().items():
            others = [o for o in (ROBOTS if part.kind is Robot else PEOPLE) if o != part.default]
            if part.kind is Robot and task_class(task).reachable_by is None:
                continue  # nothing is promised of others
            if part.default is None:
                continue
            able = [o for o in others if role != "robot" or o in reaching(task)]
            able = [o for o in able if (task, o) not in SEARCHED]
            quick = able[TASKS.index(task) % len(able)] if able and (task, role) not in SLOW else ""
            cases += [
                pytest.param(
                    task,
                    role,
                    other,
                    id=f"{task}-{role}-{other}",
                    marks=() if other == quick else pytest.mark.slow,
                )
                for other in others
            ]
    return cases


def check(task: str, **chosen: Any) -> None:
    """Hold an environment to PettingZoo's interface, and to repeating an episode bit by bit."""
    env, other = rcare_marl.make(task, **chosen), rcare_marl.make(task, **chosen)
    parallel_api_test(env, num_cycles=5)
    first = list(rollout(env, 3, steps=8))
    assert_same(first, list(rollout(env, 3, steps=8)))
    assert_same(first, list(rollout(other, 3, steps=8)))
    env.close()
    other.close()


def is_refused(task: str, role: Role[Any], name: str) -> bool:
    return role.kind is Robot and name not in reaching(task)


@pytest.mark.parametrize(("task", "role", "other"), casts())
def test_another_cast_keeps_the_promises_or_is_told_that_it_does_not_reach(
    task: str, role: str, other: str
) -> None:
    part = task_class(task).roles()[role]
    assert part.kind in (Robot, Human)
    chosen: dict[str, Any] = {role: other}
    if is_refused(task, part, other):
        with pytest.raises(ConfigError, match="has no arm that reaches"):
            rcare_marl.make(task, **chosen)
    else:
        check(task, **chosen)


@pytest.mark.parametrize("level", few(LEVELS, 1, 3))
@pytest.mark.parametrize("task", [t for t in TASKS if task_class(t).site])
def test_a_task_at_a_fixture_keeps_the_promises_at_every_level(task: str, level: int) -> None:
    check(task, level=level)


@pytest.mark.slow
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("task", TASKS)
def test_a_task_in_a_home_keeps_the_promises_at_every_level(task: str, level: int) -> None:
    check(task, home=ROOMY.get(task, HOME), level=level)


def test_tasks_name_robots_that_there_are() -> None:
    assert {name for task in TASKS for name in reaching(task)} <= set(ROBOTS)
