"""Whatever casts, settings, policies and actions are: taken, or refused soon and in a few words."""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile import REFUSED, try_out
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import rcare_marl
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.cast import HumanCast, RobotCast
from rcare_marl.envs.registry import task_class

FEW, MANY = 15, 2000  # examples of each kind
TASKS = ("feeding", "toileting", "ambulating", "bathing")

numbers = st.sampled_from(
    (0, -1, 1, 2**70, 10**400, 1e308, -1e-308, 1e-9, float("nan"), float("inf"), 1j)
)
words = st.one_of(
    st.text(max_size=20),
    st.sampled_from(
        (
            "",
            "nan",
            "\x00.yaml",
            "/dev/zero",
            "/",
            "é" * 3000,
            "kim",
            "pr2",
            "scripted",
            "house_07",
            "random",
        )
    ),
)
things = st.sampled_from(
    (
        None,
        True,
        False,
        b"x",
        Path("x.yaml"),
        object(),
        print,
        int,
        datetime.date(2020, 1, 1),
        lambda env, role: None,
        np.zeros(3),
        np.array("a"),
    )
)
leaves = st.one_of(numbers, words, things, st.integers(), st.floats())
odd = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.one_of(words, numbers), inner, max_size=3),
        st.tuples(inner),
    ),
    max_leaves=6,
)


def names(cls: Any) -> st.SearchStrategy[str]:
    return st.sampled_from([field.name for field in dataclasses.fields(cls)])


@st.composite
def arguments(draw: st.DrawFn) -> tuple[str, dict[str, Any]]:
    """Return what `make` is given, with something odd somewhere."""
    task = draw(st.sampled_from(TASKS))
    roles = task_class(task).roles()
    role = draw(st.sampled_from(sorted(roles)))
    cast = RobotCast if role == "robot" else HumanCast
    top = ("home", "level", "room", "engine", "randomise", "physics_dt", "render_mode", *roles)
    kinds: list[st.SearchStrategy[dict[str, Any]]] = [
        st.fixed_dictionaries({role: st.dictionaries(names(cast), odd, min_size=1, max_size=2)}),
        st.fixed_dictionaries(
            {
                "options": st.dictionaries(
                    names(task_class(task).Options), odd, min_size=1, max_size=2
                )
            }
        ),
        st.fixed_dictionaries({"policies": st.one_of(odd, st.fixed_dictionaries({role: odd}))}),
        st.dictionaries(st.sampled_from(top), odd, min_size=1, max_size=2),
        st.dictionaries(words, odd, max_size=1).map(
            lambda more: {k: v for k, v in more.items() if k != "task"}
        ),
    ]
    return task, draw(st.one_of(kinds))


def with_budgets(strategy: st.SearchStrategy[Any]) -> Callable[[Any], Any]:
    """Return a decorator: few examples are quick, many are slow; each is the same every time."""

    def decorate(check: Callable[[Any], None]) -> Any:
        @pytest.mark.filterwarnings("ignore")
        @pytest.mark.parametrize(
            "count",
            [pytest.param(FEW, id="few"), pytest.param(MANY, id="many", marks=pytest.mark.slow)],
        )
        def test(count: int) -> None:
            budget = settings(
                max_examples=count,
                deadline=None,
                derandomize=True,
                database=None,
                phases=(Phase.generate,),
                suppress_health_check=list(HealthCheck),
            )
            budget(given(strategy)(check))()

        return test

    return decorate


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """Compile what is compiled once, which is no fault of an argument."""
    for task in TASKS:
        with rcare_marl.make(task) as env:
            env.reset(seed=0)
            env.step({role: np.zeros(env.action_space(role).shape) for role in env.agents})


@with_budgets(arguments())
def test_what_an_environment_is_made_of(example: tuple[str, dict[str, Any]]) -> None:
    task, wrong = example
    env = try_out(lambda: rcare_marl.make(task, **wrong), example)
    if env is not REFUSED:
        with env:
            try_out(lambda: env.reset(seed=0), example)


ENVS: list[CareEnv] = []


def feeding() -> CareEnv:
    """Return one environment for all examples."""
    if not ENVS:
        ENVS.append(rcare_marl.make("feeding", policies={"recipient": "cooperative"}))
    return ENVS[0]


SIZE = 7
rows = arrays.arrays(
    dtype=arrays.scalar_dtypes(),
    shape=st.one_of(
        st.just((SIZE,)), arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=8)
    ),
)
acts = st.one_of(
    odd,
    st.fixed_dictionaries(
        {"robot": st.one_of(rows, odd, st.lists(numbers, min_size=SIZE, max_size=SIZE))}
    ),
    st.dictionaries(words, odd, max_size=2),
)


@with_budgets(acts)
def test_what_is_acted(actions: Any) -> None:
    env = feeding()
    if env.is_over or not env.has_begun:
        env.reset(seed=0)
    done = try_out(lambda: env.step(actions), actions)
    if done is not REFUSED:
        assert np.isfinite(env.state()).all(), actions


calls = st.tuples(
    st.sampled_from(
        ("observe", "describe", "describe_arrays", "action_space", "observation_space", "reset")
    ),
    odd,
)


@with_budgets(calls)
def test_what_an_environment_is_asked(asked: tuple[str, Any]) -> None:
    name, value = asked
    env = feeding()
    env.reset(seed=0)
    if name == "reset":
        try_out(lambda: env.reset(seed=value), asked)
        try_out(lambda: env.reset(options=value), asked)
    else:
        try_out(lambda: getattr(env, name)(value), asked)
