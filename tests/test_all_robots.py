"""What every robot that ships promises: mass, posture, reach, grip, and a place in feeding."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pettingzoo.test.parallel_test import parallel_api_test

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.robot import Robot, RobotConfig, load_robot
from rcare_marl.agents.robot_check import (
    find_overlaps,
    measure_grip,
    measure_posture,
    measure_reach,
    spawned,
)
from rcare_marl.errors import ConfigError

ROBOTS = assets.names("robots")
PAPER = {
    "kinova_gen3",
    "kinova_gen2",
    "stretch_re1",
    "franka_panda",
    "ur5",
    "pr2",
    "pepper",
    "hsr",
    "fetch",
    "nao",
}
FEEDERS = [n for n in ROBOTS if "wheelchair_right" in load_robot(n).mounts]


@pytest.fixture(params=ROBOTS)
def config(request: pytest.FixtureRequest) -> RobotConfig:
    return load_robot(request.param)


def test_all_ten_robots_of_the_paper_are_there() -> None:
    assert set(ROBOTS) >= PAPER


def test_mass_is_the_published_one(config: RobotConfig) -> None:
    world, robot = spawned(config)
    published = config.published_mass
    assert published is not None and published.source
    assert robot.files.model.mass == pytest.approx(published.value, rel=0.03)
    held = robot.body.mass()  # what is bolted down weighs nothing to Bullet
    assert held <= robot.files.model.mass + 0.01
    world.close()


def test_nothing_overlaps_at_home(config: RobotConfig) -> None:
    assert find_overlaps(config) == []


def test_posture_is_held_within_half_a_degree(config: RobotConfig) -> None:
    for control in ("joint_delta", "tool_delta"):
        turned, slid = measure_posture(config, control=control)
        assert math.degrees(turned) < 0.5, control
        assert slid < 0.001, control


@pytest.mark.parametrize("name", ROBOTS)
def test_every_arm_reaches_what_it_can_reach(name: str) -> None:
    config = load_robot(name)
    for arm in config.arms:
        reach = measure_reach(config, arm, count=20)
        assert reach.distances.max() < 0.005, arm
        assert math.degrees(reach.angles.max()) < 2, arm


def test_grippers_open_close_and_hold_half_a_kilogram(config: RobotConfig) -> None:
    for name, arm in config.arms.items():
        assert arm.gripper is not None
        grip = measure_grip(config, name, mass=0.5)
        assert grip.opened == pytest.approx(grip.widest, rel=0.05), name
        assert grip.closed < 0.3 * grip.widest, name
        assert grip.slip < 0.01, name


def test_every_part_can_be_commanded(config: RobotConfig) -> None:
    world, robot = spawned(config, moves=config.parts)
    assert len(robot.action_names) == robot.action_size
    rng = np.random.default_rng(0)
    for _ in range(10):
        robot.command(rng.uniform(-1, 1, robot.action_size), 0.05)
        for _ in range(12):
            robot.actuate()
            world.step()
    robot.sense()
    for observable in robot.observables():
        assert np.all(np.isfinite(observable.read())), observable.name
    world.close()


@pytest.mark.parametrize("name", FEEDERS)
def test_feeding_takes_every_robot_that_reaches(name: str) -> None:
    env = rcare_marl.make("feeding", robot=name)
    parallel_api_test(env, num_cycles=12)
    first = [env.reset(seed=3)[0]["robot"], *_random_steps(env, 6)]
    again = [env.reset(seed=3)[0]["robot"], *_random_steps(env, 6)]
    np.testing.assert_array_equal(first, again)
    robot = env.cast["robot"]
    assert isinstance(robot, Robot)
    assert robot.describe()["model"]
    env.close()


def _random_steps(env: rcare_marl.envs.CareEnv, count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(5)
    out = []
    for _ in range(count):
        actions = {
            role: rng.uniform(-1, 1, env.action_space(role).shape).astype(np.float32)
            for role in env.agents
        }
        out.append(env.step(actions)[0]["robot"])
    return out


@pytest.mark.parametrize("name", sorted(set(ROBOTS) - set(FEEDERS)))
def test_a_robot_that_cannot_reach_says_so(name: str) -> None:
    with pytest.raises(ConfigError, match="no arm that reaches"):
        rcare_marl.make("feeding", robot=name)


@pytest.mark.slow
@pytest.mark.parametrize("name", FEEDERS)
def test_the_scripted_feeder_can_use_every_robot_that_reaches(name: str) -> None:
    env = rcare_marl.make(
        "feeding", robot=name, policies={"robot": "scripted", "recipient": "cooperative"}
    )
    fed = 0
    for seed in range(5):
        env.reset(seed=seed)
        while not env.is_over:
            env.step({})
        fed += env.task.is_success()
    assert fed >= 4
    env.close()
