"""The one search for where a robot starts: clear of people, first what a task names, else a place near by."""

from __future__ import annotations

import numpy as np
import pytest

import rcare_marl
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.cli.description import describe
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.reach import APART, ReachSearch, Trial, manipulability
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose


def gap(env: CareEnv) -> float:
    """Return the least distance of the robot from anybody [m]."""
    people = [agent.body for agent in env.cast.values() if isinstance(agent, Human)]
    return min(env.world.separation(env.cast["robot"].body, p, within=0.05) for p in people)


@pytest.mark.parametrize(
    ("task", "robot", "recipient"),
    [
        pytest.param("bathing", "pr2", "morgan", marks=pytest.mark.slow),
        ("bathing", "pepper", "natalia"),
        pytest.param("bathing", "pepper", "daniel", marks=pytest.mark.slow),
        pytest.param("dressing", "fetch", "daniel", marks=pytest.mark.slow),
    ],
)
def test_a_robot_that_would_stand_in_somebody_starts_elsewhere(
    task: str, robot: str, recipient: str
) -> None:
    env = rcare_marl.make(task, robot=robot, recipient=recipient)
    for seed in range(3):
        env.reset(seed=seed)
        assert gap(env) > 0
        env.step({r: np.zeros(env.action_space(r).shape, np.float32) for r in env.agents})
        assert env.task.report()["peak_force_n"] < 1.0  # thousands of newtons, where they overlap
    env.close()


@pytest.mark.slow
def test_a_robot_that_misses_an_end_of_the_arm_from_wherever_it_may_stand_is_refused() -> None:
    with pytest.raises(ConfigError, match="pepper has no arm that reaches .* it misses it by"):
        rcare_marl.make("bathing", robot="pepper", recipient="morgan")


def test_the_first_trial_that_will_do_is_taken_and_the_robot_keeps_its_posture() -> None:
    env = rcare_marl.make("feeding", policies={"recipient": "still"})
    robot = env.cast["robot"]
    assert isinstance(robot, Robot)
    before, here = robot.arm.positions(), robot.tool_pose()
    far = Pose((5.0, 0.0, 1.0))
    found = env.task.search(env.world).find(
        [Trial([far], hold=0), Trial([here], hold=1), Trial([here], hold=2)], "it"
    )
    assert found.trial.hold == 1
    assert found.manipulability == pytest.approx(manipulability(robot, found.posture))
    np.testing.assert_array_equal(robot.arm.positions(), before)
    with pytest.raises(ConfigError, match="has no arm that reaches the moon: it misses it by"):
        env.task.search(env.world).find([Trial([far])], "the moon")
    env.close()


def test_a_start_that_leaves_joints_room_comes_before_one_at_their_limits() -> None:
    env = rcare_marl.make("feeding", policies={"recipient": "still"})
    robot = env.cast["robot"]
    assert isinstance(robot, Robot)
    free, stuck = robot.arm.positions(), robot.arm.positions()
    stuck[5] = robot.arm.lower[5]
    here = robot.tool_pose()
    robot.set_posture(stuck)
    there = robot.tool_pose()
    robot.set_posture(free)
    at_limit, roomy = Trial([there], seed=stuck, hold=0), Trial([here], seed=free, hold=1)
    for room, trials, hold in (
        (0.0, [at_limit, roomy], 0),
        (0.1, [at_limit, roomy], 1),
        (0.1, [at_limit], 0),
    ):
        found = env.task.search(env.world, room=room).find(trials, "it")
        assert found.trial.hold == hold
        assert (found.room > 0.1) == bool(hold)
    env.close()


def test_a_place_inside_a_person_is_refused_as_such() -> None:
    env = rcare_marl.make("feeding", policies={"recipient": "still"})
    recipient = env.cast["recipient"]
    robot = env.cast["robot"]
    assert isinstance(recipient, Human) and isinstance(robot, Robot)
    mouth = Pose(tuple(np.array(recipient.mouth_position()).tolist()), robot.tool_pose().quaternion)
    search: ReachSearch = env.task.search(env.world)
    with pytest.raises(ConfigError, match="it would touch somebody"):
        search.find([Trial([mouth])], "the mouth")
    env.close()


@pytest.mark.slow
def test_of_places_near_by_the_most_manipulable_is_taken() -> None:
    env = rcare_marl.make("bathing", robot="pr2", recipient="morgan")
    robot = env.cast["robot"]
    assert isinstance(robot, Robot)
    nominal = robot.mount("bed_side")
    assert robot.body.base_pose().position != nominal.position and gap(env) >= APART
    env.close()


def test_describe_says_from_where_a_robot_reaches() -> None:
    facts = describe("feeding", {"robot": "franka_panda"}, {})["roles"]["robot"]["reach"]
    assert facts["manipulability"] > 0 and facts["from_people_m"] > 0
    assert len(facts["base_m"]) == len(facts["tool_m"]) == 3
