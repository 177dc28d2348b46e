"""Habits of the ecosystem: what users of PettingZoo, Gymnasium and TorchRL try first."""

from __future__ import annotations

import copy
import importlib
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rcare_marl
from rcare_marl.agents.people.behaviour.behaviour_tree import StayStill
from rcare_marl.cli import listing
from rcare_marl.cli.gallery import make as draw
from rcare_marl.envs import CareEnv
from rcare_marl.envs.registry import policy_factory, policy_names, task_class
from rcare_marl.errors import ConfigError, EpisodeError, UnknownNameError

TASK = "feeding"
ROLES = {"recipient": "cooperative"}


def played(env: CareEnv, steps: int) -> list[Any]:
    """Return observations, rewards and ends of some steps in which the robot moves."""
    action = np.full(env.action_space("robot").shape, 0.3, np.float32)
    return [env.step({"robot": action})[:4] for _ in range(steps)]


def same(one: list[Any], other: list[Any]) -> bool:
    return all(
        np.array_equal(a[0]["robot"], b[0]["robot"]) and a[1:] == b[1:]
        for a, b in zip(one, other, strict=True)
    )


@pytest.fixture(scope="module")
def env() -> Iterator[CareEnv]:
    with rcare_marl.make(TASK, policies=ROLES) as made:
        yield made


def test_with_closes_an_environment() -> None:
    with rcare_marl.make(TASK) as env:
        env.reset(seed=0)
    with pytest.raises(EpisodeError, match="closed"):
        env.reset()


def test_an_environment_says_what_makes_it_again(env: CareEnv) -> None:
    with rcare_marl.make(TASK) as plain:
        assert repr(plain) == f"<rcare_marl.make({TASK!r})>"
    assert repr(env) == f"<rcare_marl.make({TASK!r}, policies={ROLES!r})>"


@pytest.mark.parametrize(
    "twin", [copy.deepcopy, copy.copy, lambda e: pickle.loads(pickle.dumps(e))]
)
def test_a_copy_goes_on_bit_for_bit_and_shares_nothing(env: CareEnv, twin: Any) -> None:
    env.reset(seed=3)
    played(env, 4)
    with twin(env) as other:
        ahead = played(other, 3)  # moves nothing of the first
        assert other.world is not env.world
        assert same(played(env, 3), ahead)
        assert env.reset()[0]["robot"].tobytes() == other.reset()[0]["robot"].tobytes()


def test_what_cannot_be_copied_says_why(env: CareEnv) -> None:
    env.reset(seed=0)
    env.world.step()
    env.step({"robot": np.zeros(env.action_space("robot").shape, np.float32)})
    with pytest.raises(EpisodeError, match="beside reset"):
        copy.deepcopy(env)
    still = {"robot": lambda e, role: StayStill(e.cast[role].action_size)}
    with rcare_marl.make(TASK, policies=still) as other:
        with pytest.raises(ConfigError, match="cannot be pickled.*EnvRecipe"):
            pickle.dumps(other)
        copy.deepcopy(other).close()
    with pytest.raises(EpisodeError, match="closed"):
        copy.deepcopy(other)


def test_every_task_has_an_env_of_turns() -> None:
    module = importlib.import_module(f"rcare_marl.envs.{TASK}_v0")
    turns = module.env(policies=ROLES)
    turns.reset(seed=1)
    for _ in turns.agent_iter(3):
        turns.step(turns.action_space("robot").sample() if turns.agents else None)
    turns.close()
    for task in rcare_marl.task_names():
        assert callable(importlib.import_module(f"rcare_marl.envs.{task}_v0").env)


@pytest.mark.parametrize(
    "wrong, meant",
    [
        ("policy", "Did you mean 'policies'"),
        ("option", "Did you mean 'options'"),
        ("robots", "Did you mean 'robot'"),
        ("seed", "env.reset"),
        ("num_envs", "make_vector"),
        ("max_episode_steps", "TimeLimit"),
    ],
)
def test_a_wrong_argument_is_answered_by_the_right_one(wrong: str, meant: str) -> None:
    for error in (UnknownNameError, TypeError):
        with pytest.raises(error, match=meant):
            rcare_marl.make(TASK, **{wrong: 1})  # type: ignore[arg-type]


def test_torchrl_makes_one_by_its_id() -> None:
    from torchrl.envs import GymEnv

    env = GymEnv(f"rcare_marl/{TASK.capitalize()}-v0")  # type: ignore[no-untyped-call, unused-ignore]
    assert env.rollout(2)["next", "reward"].shape == (2, 1)
    env.close()


def test_no_policy_is_offered_that_is_refused() -> None:
    assert "behaviour" not in policy_names(TASK, "robot")
    assert "behaviour" in policy_names(TASK, "recipient")
    for task in rcare_marl.task_names():
        for role in task_class(task).roles():
            for name in policy_names(task, role):
                assert callable(policy_factory(task, role, name))


@pytest.mark.parametrize(
    "kind, known",
    [
        ("devices", "ceiling_lift"),
        ("homes", "house_07"),
        ("sensors", "wrist_wrench"),
        ("exercises", "chest_expansion"),
        ("populations", "population:test"),
    ],
)
def test_list_knows(kind: str, known: str) -> None:
    rows = listing.rows(kind)
    assert known in [row["name"] for row in rows]
    assert len({tuple(row) for row in rows}) == 1
    assert all("about" not in row or row["about"] for row in rows)


def test_a_gallery_takes_a_file(tmp_path: Path) -> None:
    from rcare_marl import assets

    mine = tmp_path / "mine.yaml"
    mine.write_text(assets.find("avatars", "kim").read_text())
    files = draw(tmp_path / "out", ("avatars",), [str(mine)])
    assert [file.name for file in files] == ["mine.png"]


def test_pybullet_says_nothing_of_its_build() -> None:
    code = "import rcare_marl.world, sys; print('still there', file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "still there\n" and not done.stdout
