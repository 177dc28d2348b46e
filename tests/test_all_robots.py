"""What every robot that ships promises: mass, posture, reach, grip, and a place in feeding."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pettingzoo.test.parallel_test import parallel_api_test
from variants import KINDS_OF_ROBOTS, few

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.robots.control import CONTROLS
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_check import (
    CONTROL_DT,
    advance,
    find_overlaps,
    measure_grip,
    measure_posture,
    measure_reach,
    pads,
    spawned,
    still,
)
from rcare_marl.agents.robots.robot_config import RobotConfig, load_robot
from rcare_marl.errors import ConfigError
from rcare_marl.pose import rotate

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
BEYOND = 0.06  # [rad or m] that light joints are thrown beyond a limit, see test_robot_control.py
# Middle of the closed pads from the tool's origin [m]: Pepper's thumb and fingers close in front of
# its palm, whose middle is the tool.
OFF_PADS = {"pepper": 0.035}
# Share of the way from wrist to pads along the tool: Stretch's gripper hangs below its wrist.
HANGING = {"stretch_re1": 0.8}
HANDS = [f"{name} {arm}" for name in ROBOTS for arm in load_robot(name).arms]
FEEDERS = [n for n in ROBOTS if "wheelchair_right" in load_robot(n).mounts]


def one_in_turn(first: int) -> list[Any]:
    """Return every robot with every control mode; every other robot is quick with one of them in turn."""
    return [
        pytest.param(
            robot,
            control,
            marks=() if i % 2 == first and j == (i + first) % len(CONTROLS) else pytest.mark.slow,
        )
        for i, robot in enumerate(ROBOTS)
        for j, control in enumerate(CONTROLS)
    ]


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
    world.close()


def test_the_physics_has_all_mass_but_that_of_a_bolted_root(config: RobotConfig) -> None:
    world, robot = spawned(config, moves=config.parts)
    model = robot.files.model  # a base that drives stands on frames without mass
    expected = model.mass - model.links[model.root].mass
    if config.base is not None:
        assert expected == pytest.approx(model.mass, abs=0.001)
    assert robot.body.mass() == pytest.approx(expected, abs=0.01)
    world.close()


def test_nothing_overlaps_at_home(config: RobotConfig) -> None:
    assert find_overlaps(config) == []


@pytest.mark.parametrize(("name", "control"), one_in_turn(0))
def test_posture_is_held_within_half_a_degree_in_five_seconds(name: str, control: str) -> None:
    turned, slid = measure_posture(load_robot(name), control=control, seconds=5.0)
    assert math.degrees(turned) < 0.5
    assert slid < 0.001


@pytest.mark.parametrize("count", few((6, 20), 6))
@pytest.mark.parametrize("name", few(ROBOTS, *KINDS_OF_ROBOTS))
def test_every_arm_reaches_what_it_can_reach(name: str, count: int) -> None:
    config = load_robot(name)
    for arm in config.arms:
        reach = measure_reach(config, arm, count=count)
        assert reach.distances.max() < 0.005, arm
        assert math.degrees(reach.angles.max()) < 2, arm


@pytest.mark.parametrize(
    "hand",
    few(
        HANDS,
        *{hand.split()[0]: hand for hand in HANDS if hand.split()[0] in KINDS_OF_ROBOTS}.values(),
    ),
)
def test_grippers_open_close_and_hold_half_a_kilogram(hand: str) -> None:
    name, arm = hand.split()
    grip = measure_grip(load_robot(name), arm, mass=0.5)
    assert grip.opened == pytest.approx(grip.widest, rel=0.05)
    assert grip.closed < 0.3 * grip.widest
    assert grip.slip < 0.01


@pytest.mark.parametrize(("name", "control"), one_in_turn(1))
def test_every_part_can_be_commanded(name: str, control: str) -> None:
    config = load_robot(name)
    world, robot = spawned(config, moves=config.parts, control=control)
    assert tuple(robot.parts) == config.parts
    assert len(robot.action_names) == robot.action_size
    rng = np.random.default_rng(0)
    groups = [part.joints for part in robot.parts.values() if part.joints is not None]
    start = [group.positions() for group in groups]
    for _ in range(20):
        advance(world, robot, rng.uniform(-1, 1, robot.action_size), CONTROL_DT)
        for group in groups:
            positions = group.positions()
            assert np.all(positions > group.lower - BEYOND), group.names
            assert np.all(positions < group.upper + BEYOND), group.names
    for group, before in zip(groups, start, strict=True):
        assert np.abs(group.positions() - before).max() > 0.001, group.names
    robot.sense()
    for observable in robot.observables():
        assert np.all(np.isfinite(observable.read())), observable.name
    world.close()


def test_tools_lie_between_the_closed_pads_and_look_along_the_hand(config: RobotConfig) -> None:
    world, robot = spawned(config, moves=tuple(config.arms), gripper="free")
    model = robot.files.model
    for name in config.arms:
        robot.set_gripper(1.0, arm=name)
    advance(world, robot, still(robot), 2.0)
    for name, arm in config.arms.items():
        middle = np.mean(pads(robot, name), axis=0)
        tool = robot.tool_pose(name)
        assert math.dist(middle, tool.position) < OFF_PADS.get(
            Path(config.model).parent.name, 0.015
        ), name
        wrist = robot.body.link_pose(robot.body.link_index(model.joints[arm.joints[-1]].child))
        hand = middle - wrist.position
        along = np.dot(rotate(tool.quaternion, (0.0, 0.0, 1.0)), hand) / np.linalg.norm(hand)
        assert along > HANGING.get(Path(config.model).parent.name, 0.9), name
    world.close()


@pytest.mark.parametrize("name", few(FEEDERS, *KINDS_OF_ROBOTS))
def test_feeding_takes_every_robot_that_reaches(name: str) -> None:
    env = rcare_marl.make("feeding", robot=name)
    parallel_api_test(env, num_cycles=5)
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
    policies = {"robot": "scripted_anyway", "recipient": "cooperative"}
    env = rcare_marl.make("feeding", robot=name, policies=policies)
    fed = 0
    for seed in range(5):
        env.reset(seed=seed)
        while not env.is_over:
            env.step({})
        fed += env.task.succeeded()
    assert fed >= 4
    env.close()
