"""Promises of the settings that every task has."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from variants import few

import rcare_marl
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import task_class
from rcare_marl.envs.task_options import TaskOptions
from rcare_marl.errors import ConfigError

TASKS = rcare_marl.task_names()


@pytest.mark.parametrize("task", TASKS)
def test_every_task_takes_the_common_settings(task: str) -> None:
    options = task_class(task).Options
    assert issubclass(options, TaskOptions)
    assert options().reward == "paper" and options().force_limit > 0
    assert options.SHAPED_WEIGHTS, "a shaped reward has terms"


@contextmanager
def first_step(env: CareEnv, **options: Any) -> Iterator[tuple[dict[str, float], dict[str, Any]]]:
    """Give rewards and infos of a first step in which nobody does anything, with other settings."""
    before = env.task.options
    env.task.change_options(dataclasses.replace(before, **options))
    env.reset(seed=1)
    quiet = {role: np.zeros(env.action_space(role).shape, np.float32) for role in env.agents}
    _, rewards, _, _, infos = env.step(quiet)
    try:
        yield rewards, infos
    finally:
        env.task.change_options(before)
        env.reset(seed=1)


@pytest.mark.parametrize("task", few(TASKS, *(t for t in TASKS if not t.startswith("phyrc"))))
def test_the_terms_of_the_shaped_reward_are_in_info_times_their_weights(
    task: str, usual: Callable[[str], CareEnv]
) -> None:
    names = sorted(task_class(task).Options.SHAPED_WEIGHTS)
    env, terms = usual(task), []
    for factor in (1.0, 3.0):
        weights = {n: factor * w for n, w in task_class(task).Options.SHAPED_WEIGHTS.items()}
        with first_step(env, reward="shaped", weights=weights) as (rewards, infos):
            info = infos["robot"]
            found = env.task.rewards("robot", env.task.state)
            assert set(names) <= set(found) <= set(info)
            assert rewards["robot"] == pytest.approx(sum(found.values()))
            terms.append([info[name] for name in names])
    assert np.allclose(terms[1], 3 * np.array(terms[0])) and np.any(terms[0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"weights": {"comfort": 1.0}}, "use them with reward 'shaped'"),
        ({"reward": "shaped", "weights": {"comfrt": 1.0}}, "Did you mean 'comfort'"),
        ({"force_limit": 0.0}, "force_limit must be positive"),
    ],
)
def test_a_wrong_setting_is_named(options: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        rcare_marl.make("feeding", options=options)


def test_discomfort_begins_at_comfort_and_is_full_at_the_limit() -> None:
    options = TaskOptions(force_limit=30.0)
    assert [options.discomfort(f, 10.0) for f in (0.0, 10.0, 20.0, 30.0, 90.0)] == [0, 0, 0.5, 1, 1]
    assert TaskOptions(force_limit=8.0).discomfort(6.0, 10.0) == 0.5  # half the limit is less


@pytest.mark.parametrize(
    ("task", "names"),
    [
        ("feeding", {"food", "near"}),
        ("bathing", {"distance", "force"}),
        ("dressing", {"distance"}),
        ("limb_repositioning", {"distance"}),
        ("ambulating", {"rotation_angle"}),
        ("toileting", {"open_angle"}),
    ],
)
def test_the_literal_reward_has_the_terms_of_the_papers_table_alone(
    task: str, names: set[str], usual: Callable[[str], CareEnv]
) -> None:
    env = usual(task)
    with first_step(env, reward="paper_literal") as (rewards, _):
        terms = env.task.paid("robot", env.task.state)
    assert set(terms) == names
    assert rewards["robot"] == pytest.approx(sum(terms.values()))
