"""What `rcare-marl ros` does that needs no ROS: a served robot, and a policy's twin of the scene."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from rcare_marl.baselines.evaluation import evaluate as baseline
from rcare_marl.baselines.ros.pace import Pace
from rcare_marl.baselines.ros.served import FRESH, ServedRobot
from rcare_marl.baselines.ros.twin import Twin, account, numbers, told
from rcare_marl.envs import make
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose


@pytest.fixture(scope="module")
def served() -> Iterator[ServedRobot]:
    robot = ServedRobot("feeding")
    yield robot
    robot.close()


@pytest.fixture(scope="module")
def twin() -> Iterator[Twin]:
    env = make("feeding", **baseline.played_cast("feeding", {}, {"robot": "learned"}))
    yield Twin(env)
    env.close()


@pytest.fixture(autouse=True)
def _begin(served: ServedRobot) -> None:
    served.stop(False)
    served.reset(7)


def go(served: ServedRobot, seconds: float) -> None:
    for _ in range(round(10 * seconds)):
        if served.advance():
            return


def test_a_policy_observes_over_messages_what_it_observes_in_the_environment(
    served: ServedRobot, twin: Twin
) -> None:
    served.tell_twist(np.array([0.1, 0.05, 0.0, 0.2, 0.0, 0.1]))
    go(served, 0.3)
    arm = served.robot.arm
    twin.see(arm.positions(), arm.velocities(), account(served.env.task.state))
    np.testing.assert_array_equal(twin.env.observe("robot"), served.env.observe("robot"))


def test_the_trained_policy_feeds_the_person_through_its_twin(
    served: ServedRobot, twin: Twin
) -> None:
    _, players = baseline.make_players(
        twin.env, "feeding", baseline.lead_policies("feeding", "learned")
    )
    players["robot"].reset(np.random.default_rng([7, 0]))
    arm = served.robot.arm
    while not served.env.is_over:
        twin.see(arm.positions(), arm.velocities(), account(served.env.task.state))
        served.tell_twist(twin.twist(players["robot"]))
        served.advance()
    assert served.outcomes[7]


def test_a_scene_survives_its_way_and_others_are_refused(served: ServedRobot) -> None:
    state = served.env.task.state
    text = account(state)
    assert account(told(text, state)) == text
    assert len(numbers(state)) > 20
    for wrong in ("", "{}", "[1]", text.replace('"bowl"', '"bowls"'), text.replace("[", "[[", 1)):
        with pytest.raises(ConfigError, match="scene"):
            told(wrong, state)


def test_joints_follow_a_trajectory(served: ServedRobot) -> None:
    arm = served.robot.arm
    goal = arm.positions() + np.array([0.2, -0.2, 0.1, 0.2, 0.0, -0.1, 0.3])
    names = list(reversed(arm.names))
    served.tell_trajectory(names, np.array([2.0]), goal[None, ::-1])
    go(served, 1.0)
    halfway = np.abs(arm.positions() - goal)
    go(served, 1.5)
    assert served.is_there
    assert np.abs(arm.positions() - goal).max() < 0.02 < halfway.max()


def test_trajectories_that_cannot_be_are_refused(served: ServedRobot) -> None:
    arm = served.robot.arm
    names, here = list(arm.names), arm.positions()
    with pytest.raises(UnknownNameError):
        served.tell_trajectory(["nose", *names[1:]], np.ones(1), here[None])
    with pytest.raises(ConfigError, match="all joints"):
        served.tell_trajectory(names[1:], np.ones(1), here[None, 1:])
    with pytest.raises(ConfigError, match="rise"):
        served.tell_trajectory(names, np.ones(2), np.stack((here, here)))
    with pytest.raises(ConfigError, match="faster"):
        served.tell_trajectory(names, np.array([0.05]), here[None] + 0.5)
    with pytest.raises(ConfigError, match="finite"):
        served.tell_trajectory(names, np.ones(1), here[None] * np.nan)


def test_the_pose_servo_brings_the_tool_there(served: ServedRobot) -> None:
    start = served.robot.tool_pose()
    goal = Pose((start.position[0], start.position[1], start.position[2] + 0.1), start.quaternion)
    for _ in range(30):
        served.tell_pose(goal)
        served.advance()
    assert np.abs(np.subtract(served.robot.tool_pose().position, goal.position)).max() < 0.01


def test_a_twist_that_is_not_fresh_moves_nothing(served: ServedRobot) -> None:
    served.tell_twist(np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0]))
    go(served, FRESH + 0.3)
    start = np.array(served.robot.tool_pose().position)
    go(served, 0.5)
    assert np.abs(served.robot.tool_pose().position - start).max() < 1e-3


def test_an_emergency_stop_holds_until_it_is_released(served: ServedRobot) -> None:
    served.stop(True)
    start = served.robot.arm.positions()
    served.tell_twist(np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0]))
    go(served, 0.3)
    assert np.abs(served.robot.arm.positions() - start).max() < 1e-3


def test_frames_and_description_name_the_same_links(served: ServedRobot) -> None:
    frames, urdf = served.frames(), served.urdf()
    assert all(f'<link name="{name}"' in urdf for name in frames if name in served.robot.body.links)
    assert {"tool", "recipient/head"} <= frames.keys()
    assert served.separation() > 0.05 and (served.wrench() == 0).all()


def test_what_is_told_between_two_physics_steps_counts_in_the_next(served: ServedRobot) -> None:
    count = 0

    def tell() -> None:
        nonlocal count
        count += 1
        if count == 12:  # in the middle of a control step
            served.tell_twist(np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0]))

    served.on_step = tell
    start = np.array(served.robot.tool_pose().position)
    served.advance()
    served.on_step = lambda: None
    assert count == 24
    assert 0.002 < served.robot.tool_pose().position[2] - start[2] < 0.2 * 13 / 240


def test_steps_begin_when_they_are_due_and_are_counted_where_they_are_late() -> None:
    lock, told = threading.Lock(), list[int]()
    pace = Pace(0.01, lock, told.append)
    with lock:
        began = time.monotonic()
        for _ in range(10):
            pace()
        assert time.monotonic() - began >= 0.1
        assert told == list(range(10)) and pace.slips == 0
        time.sleep(0.13)
        pace()
    assert pace.slips == 1 and max(pace.late) > 0.1
    assert "11 steps of 10.0 ms" in pace.told()
