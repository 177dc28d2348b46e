"""Promises of the curriculum: its stages, and what they make easier in the tasks."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rcare_marl
from rcare_marl.baselines.training.config import Curriculum, CurriculumConfig, Stage
from rcare_marl.config import load
from rcare_marl.envs import CareEnv, Role, Task, task_names
from rcare_marl.envs.task import NarrowedRng
from rcare_marl.envs.task_options import TaskOptions
from rcare_marl.errors import ConfigError, UnknownNameError

EASY = Stage(spread=0.0, tolerance=2.0, force=2.0)
HALF = Stage(spread=0.5, tolerance=1.5)


def two_stages() -> Curriculum:
    return Curriculum(CurriculumConfig(stages=(EASY, HALF), episodes=10, success=0.8))


def test_the_next_stage_comes_when_the_running_success_exceeds_what_it_must() -> None:
    curriculum = two_stages()
    assert not curriculum.observe([True] * 9), "too few episodes to tell"
    assert curriculum.stage == {"spread": 0.0, "tolerance": 2.0, "force": 2.0}
    assert curriculum.observe([True])
    assert (curriculum.level, curriculum.stage["spread"]) == (1, 0.5)
    assert not curriculum.observe([True] * 8 + [False] * 2), "80 % do not exceed 80 %"
    assert not curriculum.observe([False]) and curriculum.level == 1
    assert curriculum.observe([True] * 10)
    assert curriculum.is_full and curriculum.stage == {
        "spread": 1.0,
        "tolerance": 1.0,
        "force": 1.0,
    }
    assert not curriculum.observe([True] * 100), "there is nothing after the full stage"


def test_successes_of_an_easier_stage_do_not_count_for_the_next_one() -> None:
    curriculum = two_stages()
    curriculum.observe([True] * 10)
    assert not curriculum.observe([True] * 9)
    assert curriculum.observe([True])


def test_without_stages_there_is_only_the_task_as_it_is() -> None:
    curriculum = Curriculum()
    assert curriculum.stage == {} and curriculum.is_full and not curriculum.observe([True] * 100)


def test_a_full_stage_at_the_end_is_not_added_twice() -> None:
    curriculum = Curriculum(CurriculumConfig(stages=(EASY, Stage()), episodes=1))
    assert curriculum.observe([True]) and curriculum.is_full


def test_a_curriculum_goes_on_where_it_was() -> None:
    curriculum = two_stages()
    curriculum.observe([True] * 10)
    curriculum.observe([True] * 9)
    again = two_stages()
    again.load_state_dict(curriculum.state_dict())
    assert again.stage == curriculum.stage and again.observe([True])
    with pytest.raises(ConfigError, match="at stage 1, the curriculum has 0"):
        Curriculum().load_state_dict(curriculum.state_dict())


def test_a_curriculum_is_read_from_a_config() -> None:
    given = {"stages": [{"spread": 0.3}, {"tolerance": 2, "force": 1.5}], "episodes": 20}
    config = load(CurriculumConfig, given)
    assert config.stages == (Stage(spread=0.3), Stage(tolerance=2.0, force=1.5))
    with pytest.raises(UnknownNameError, match="Did you mean 'tolerance'"):
        load(CurriculumConfig, {"stages": [{"tolerence": 2}]})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Stage(spread=1.2), "spread must lie in"),
        (lambda: Stage(tolerance=0.5), "tolerance must be at least 1"),
        (lambda: Stage(force=math.nan), "force must be at least 1"),
        (lambda: CurriculumConfig(episodes=0), "at least 1 episode"),
        (lambda: CurriculumConfig(success=1.0), "never exceeded"),
        (lambda: TaskOptions(spread=-0.1), "spread must lie in"),
        (lambda: TaskOptions(tolerance=0.9), "tolerance must be at least 1"),
    ],
)
def test_an_impossible_stage_is_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_narrowed_chance_is_the_same_chance_closer_to_the_middle() -> None:
    whole, half = np.random.default_rng(4), NarrowedRng(np.random.default_rng(4), 0.5)
    for _ in range(20):
        assert half.uniform(1.0, 3.0) == pytest.approx(2 + 0.5 * (whole.uniform(1.0, 3.0) - 2))
        drawn = whole.uniform(-1, (1, 2, 3), 3)
        middle = np.array((0, 0.5, 1))
        assert half.uniform(-1, (1, 2, 3), 3) == pytest.approx(middle + 0.5 * (drawn - middle))
        assert half.random() == pytest.approx(0.5 + 0.5 * (whole.random() - 0.5))
        assert half.normal(2.0, 0.3) == pytest.approx(2 + 0.5 * (whole.normal(2.0, 0.3) - 2))
        assert half.standard_normal(2) == pytest.approx(0.5 * whole.standard_normal(2))
        assert half.integers(100) == whole.integers(100) and half.choice(9) == whole.choice(9)


def state(env: CareEnv, seed: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    env.reset(seed=seed)
    return env.state()


@pytest.mark.parametrize(
    "task",
    [
        pytest.param(task, marks=pytest.mark.slow if task.endswith("dressing") else ())
        for task in task_names()
    ],
)
def test_the_spread_is_that_of_what_a_task_randomises(
    task: str, usual: Callable[[str], CareEnv]
) -> None:
    env, seeds = usual(task), range(1, 6)  # two may by chance be far apart
    whole = [state(env, seed) for seed in seeds]
    env.task.set_stage(spread=0.5)
    half = [state(env, seed) for seed in seeds]
    env.task.set_stage(spread=0.0)
    none = [state(env, seed) for seed in seeds]
    env.task.set_stage()
    again = [state(env, seed) for seed in (1, 2)]
    wide, narrow, nothing = (float(np.ptp(states, axis=0).max()) for states in (whole, half, none))
    assert nothing < 1e-3 and nothing < narrow < wide
    assert all(np.array_equal(a, b) for a, b in zip(whole, again, strict=False))


def nearly(env: Any, **changes: Any) -> None:
    env.task.state = dataclasses.replace(env.task.state, **changes)


def fed(env: Any) -> None:
    task = env.task
    env.cast["recipient"].set_angles({"jaw_opening": 0.3})
    for piece in task._food:
        away = rcare_marl.pose.Pose(tuple((task.state.mouth + (0.045, 0.0, 0.0)).tolist()))
        piece.set_base(away)
    task.look()


def drunk(env: Any) -> None:
    size = len(env.task._drunk)
    env.task._drunk[: size // 2] = True
    env.task.look()


def dressed(env: Any) -> None:
    state = env.task.state
    way = (state.target_along - state.begun) / 1.5
    nearly(env, is_around=True, along=state.begun + way)


def opened(env: Any) -> None:
    nearly(env, best=1 / 1.5)


def lifted(env: Any) -> None:
    nearly(env, angle=math.radians(40))


def scored(env: Any) -> None:
    points = np.zeros_like(env.task.state.points)
    points[0] = round(env.task.options.success_score / 1.5)
    nearly(env, points=points, time=env.task.time_limit)


def wiped(env: Any) -> None:
    task = env.task
    nearly(env, stroke_from=0.4)
    task.sponge.force_on = lambda body: np.array((0.0, 0.0, 1.0))
    task.skin.is_wiped[:] = True
    way = task.state.target - task.sponge.face_points().mean(axis=0) + (0.0, 0.0, 0.04)
    pose = task.sponge.body.base_pose()
    place = tuple(np.add(pose.position, way).tolist())
    task.sponge.body.set_base(rcare_marl.pose.Pose(place, pose.quaternion))
    task.look()


def exercised(env: Any) -> None:
    session = env.task.session
    session.right = [2] * len(session.exercises)  # of three
    env.task.look()


def exercised_together(env: Any) -> None:
    for session in env.task.session.members.values():
        session.right = [2] * len(session.exercises)
    env.task.look()


NEARLY: dict[str, Callable[[Any], None]] = {
    "feeding": fed,
    "drinking": drunk,
    "bathing": wiped,
    "dressing": dressed,
    "ambulating": opened,
    "toileting": lifted,
    "social_coaching": exercised,
    "group_coaching": exercised_together,
    "phyrc_bathing": scored,
    "phyrc_dressing": scored,
}


@pytest.mark.parametrize(
    "task",
    [
        pytest.param(
            t, marks=pytest.mark.slow if t.endswith(("dressing", "group_coaching")) else ()
        )
        for t in NEARLY
    ],
)
def test_what_is_nearly_a_success_is_one_within_the_tolerance(task: str) -> None:
    env = rcare_marl.make(task)
    found = []
    for tolerance in (1.0, 2.0):
        env.task.set_stage(tolerance=tolerance)
        env.reset(seed=1)
        assert not env.task.succeeded()
        NEARLY[task](env)
        found.append(env.task.succeeded())
    env.close()
    assert found == [False, True]


def test_a_stage_begins_with_the_next_episode() -> None:
    env = rcare_marl.make("toileting", recipient="karan", options={"force_limit": 10.0})
    task = env.task
    env.reset(seed=1)
    given = task.options
    task.set_stage(tolerance=2.0, force=3.0)
    assert task.options is given and task.force_limit == 10.0
    env.reset(seed=2)
    assert (task.options.tolerance, task.options.force_limit) == (2.0, 30.0)
    assert task.force_limit == 30.0
    hurt = {"recipient": dataclasses.replace(task.state.safety["recipient"], peak_force=20.0)}
    nearly(env, safety=hurt)
    assert not task.failed()
    task.set_stage()
    env.reset(seed=3)
    assert task.options == given and task.force_limit == 10.0
    nearly(env, safety=hurt)
    assert task.failed()
    env.close()


def test_a_stage_comes_on_top_of_the_settings_of_the_task() -> None:
    env = rcare_marl.make("toileting", options={"spread": 0.5, "tolerance": 1.5})
    env.task.set_stage(spread=0.5, tolerance=2.0)
    env.reset(seed=1)
    assert (env.task.options.spread, env.task.options.tolerance) == (0.25, 3.0)
    for stage in ({"spread": 3.0}, {"tolerance": 0.1}, {"force": 0.5}):
        with pytest.raises(ConfigError, match="must"):
            env.task.set_stage(**stage)
    env.close()


def test_a_misspelt_setting_of_the_stage_is_named() -> None:
    with pytest.raises((ConfigError, UnknownNameError), match="Did you mean 'tolerance'"):
        rcare_marl.make("toileting", options={"tolerence": 2.0})


class Plain(Task):
    robot = Role[Any](object, default=None)
    Options = dict
    furnish = build = reset = read = observables = rewards = is_success = camera = None  # type: ignore[assignment]


def test_a_task_with_settings_of_its_own_says_that_it_has_no_stages() -> None:
    with pytest.raises(ConfigError, match="derived from TaskOptions, Plain has dict"):
        Plain({}).set_stage(spread=0.5)
