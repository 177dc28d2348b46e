"""Toileting: the lid moves by contact alone, at every level, and the task can be done."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest
from episode import play

import rcare_marl
from rcare_marl import assets
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.homes import CareHome, HomePlace, Rules, find_place, home_names
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.envs.safety import NOBODY, Safety
from rcare_marl.envs.tasks.toileting import OPEN_ANGLE_DEG, Toileting
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose

LEVELS = (1, 2, 3)
SCRIPTED = {"robot": "scripted"}


def task_of(env: CareEnv) -> Toileting:
    return cast(Toileting, env.task)


def run(env: CareEnv, seed: int) -> Toileting:
    play(env, seed)
    return task_of(env)


@pytest.fixture(scope="module")
def scripted() -> Iterator[CareEnv]:
    env = rcare_marl.make("toileting", policies=SCRIPTED)
    yield env
    env.close()


def test_the_scripted_robot_lifts_the_lid(scripted: CareEnv) -> None:
    for seed in range(5):
        task = run(scripted, seed)
        assert task.succeeded()
        assert task.report()["lid_angle_deg"] > OPEN_ANGLE_DEG


@pytest.mark.slow
@pytest.mark.parametrize("level", LEVELS)
def test_the_scripted_robot_succeeds_in_ninety_five_of_a_hundred_episodes(level: int) -> None:
    env = rcare_marl.make("toileting", level=level, policies=SCRIPTED)
    assert sum(run(env, seed).succeeded() for seed in range(100)) >= 95
    env.close()


@pytest.mark.parametrize("level", LEVELS)
def test_on_a_bare_floor_the_toilet_is_as_high_as_its_level_says(level: int) -> None:
    env = rcare_marl.make("toileting", level=level, policies=SCRIPTED)
    task = run(env, 0)
    assert task.succeeded()
    seat = Rules(level).figure("toilet_seat_height")
    assert seat < task.lip_at(0.0)[2] < seat + 0.02
    env.close()


def test_the_lid_moves_only_where_the_robot_touches_it(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    task, touched = task_of(scripted), False
    while not scripted.is_over:
        before = task.state.angle
        scripted.step({})
        touched = touched or task.report()["toilet_force_n"] > 0
        assert touched or task.state.angle == pytest.approx(before, abs=2e-4)  # its slack
    assert touched and task.report()["peak_toilet_force_n"] > 5.0  # half the weight of the lid


def test_a_lid_that_is_let_go_falls_shut_again(scripted: CareEnv) -> None:
    task = run(scripted, 0)
    task.robot.set_posture(task.robot.arm.rest)
    for _ in range(480):
        scripted.world.step()
    task.look()
    assert task.state.angle == pytest.approx(0.0, abs=0.01) and not task.succeeded()


def test_the_lid_stays_solid_through_many_short_episodes(scripted: CareEnv) -> None:
    for seed in range(12):  # furniture sleeps at the start of each
        scripted.reset(seed=seed)
        for _ in range(seed % 3):
            scripted.step({})
    assert run(scripted, 0).succeeded()


def test_the_lip_is_where_the_lid_is(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    task = task_of(scripted)
    body = task._body
    link = body.link_index("lid")
    before = body.link_pose(link).inverse() @ Pose(tuple(task.lip_at(0.0).tolist()))
    for angle in (0.3, 1.0):
        body.set_joints(task._lid, [angle])
        now = body.link_pose(link) @ before
        np.testing.assert_allclose(now.position, task.lip_at(angle), atol=1e-6)


def test_the_hand_starts_clear_of_the_toilet_and_elsewhere_each_time(scripted: CareEnv) -> None:
    places = []
    for seed in range(8):
        scripted.reset(seed=seed)
        task = task_of(scripted)
        assert scripted.world.separation(task.robot.body, task._body, within=0.01) > 0
        places.append(task.robot.tool_pose().position)
    assert (np.ptp(places, axis=0) > 0.02).all()


def test_the_paper_reward_is_the_angle_of_the_lid(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    task = task_of(scripted)
    assert task.rewards("robot", task.state) == {
        "open_angle": pytest.approx(0, abs=1e-3),
        "opened": 0.0,
    }
    task._body.set_joints(task._lid, [0.7])
    task.look()
    assert task.rewards("robot", task.state)["open_angle"] == pytest.approx(0.7)


def test_a_good_end_pays_at_least_what_waiting_would(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    best = 0.0
    task = task_of(scripted)
    while not scripted.is_over:
        best = max(best, sum(task.rewards("robot", task.state).values()))
        scripted.step({})
    left = (task.time_limit - scripted.world.time) / task.control_dt
    assert task.rewards("robot", task.state)["opened"] >= best * left > 0


def test_the_shaped_reward_has_its_own_terms_and_grows_on_the_way() -> None:
    env = rcare_marl.make("toileting", options={"reward": "shaped"}, policies=SCRIPTED)
    env.reset(seed=0)
    task = task_of(env)
    start = task.rewards("robot", task.state)
    assert set(start) == {"approach", "open_angle", "gentle", "opened"}
    for _ in range(15):
        env.step({})
    reached = task.rewards("robot", task.state)
    assert reached["approach"] > start["approach"]
    while not env.is_over:
        env.step({})
    assert task.rewards("robot", task.state)["open_angle"] > reached["open_angle"]
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("avatar", assets.names("avatars"))
def test_everybody_can_wait_beside_the_toilet(avatar: str) -> None:
    policies = {"robot": "scripted", "recipient": "still"}
    env = rcare_marl.make("toileting", recipient=avatar, level=3, policies=policies)
    task = run(env, 0)
    assert task.succeeded() and task.report()["peak_force_n"] == 0
    env.close()


def test_force_on_who_waits_ends_the_episode_as_a_failure() -> None:
    policies = {"recipient": "still"}
    env = rcare_marl.make("toileting", recipient="jose", policies=policies)
    env.reset(seed=0)
    task = task_of(env)
    x, y, _ = task.recipient.joint_pose("left_knee").position
    while not env.is_over:
        aim = np.subtract((x, y, 0.55), task.robot.tool_pose().position)
        push = np.zeros(6, np.float32)
        push[:3] = np.clip(8 * aim, -1, 1)
        env.step({"robot": push})
    metrics = task.report()
    assert task.failed() and not task.succeeded()
    assert metrics["peak_force_n"] > task.options.force_limit and metrics["cost"] > 0
    env.close()


def test_fingers_that_reach_farther_ahead_go_under_the_lip_with_their_tips() -> None:
    env = rcare_marl.make("toileting", robot="fetch", policies={"robot": "scripted_anyway"})
    task = run(env, 0)
    assert task.fingers > 0.04 and task.succeeded()
    assert task.state.peak_push < 60.0  # 160 N where they ran into the bowl
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    "robot", ["franka_panda", "kinova_gen2", "kinova_gen3", "pr2", "stretch_re1_dex", "ur5"]
)
def test_other_robots_that_reach_do_it_too(robot: str) -> None:
    env = rcare_marl.make("toileting", robot=robot, policies=SCRIPTED)
    assert run(env, 0).succeeded()
    env.close()


@pytest.mark.parametrize("robot", ["nao", "pepper"])
def test_robots_that_do_not_reach_are_refused_by_name(robot: str) -> None:
    with pytest.raises(ConfigError, match=f"{robot} has no arm that reaches"):
        rcare_marl.make("toileting", robot=robot)


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ({"level": 4}, "level must be 1"),
        ({"home": "house_03", "room": "kitchen_1"}, "does not suit"),
        ({"options": {"open_angle_deg": 0}}, "open_angle_deg"),
        ({"options": {"force_limit": -1}}, "force_limit"),
        ({"robot": {"control": "joint_velocity"}, "policies": SCRIPTED}, "tool_delta"),
    ],
)
def test_what_cannot_be_is_refused(what: dict[str, object], message: str) -> None:
    with pytest.raises((ConfigError, ValueError), match=message):
        rcare_marl.make("toileting", **what)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("home", "level"), [pytest.param("house_03", 1, marks=pytest.mark.slow), ("house_12", 3)]
)
def test_the_lid_of_a_house_is_lifted_in_its_bathroom(home: str, level: int) -> None:
    env = rcare_marl.make("toileting", home=home, level=level, policies=SCRIPTED)
    task = run(env, 0)
    place = env.task.place
    assert isinstance(place, HomePlace)
    assert place.home_room.kind == "bathroom" and place.at_fixture in place.standing.furniture
    body = place.standing.part(place.at_fixture)
    assert task._body is body
    np.testing.assert_allclose(body.base_pose().position, 0.0, atol=1e-6)  # the toilet's
    assert task.succeeded()
    env.close()


@pytest.mark.parametrize(
    ("level", "every"),
    [(1, 9), *(pytest.param(n, 3, marks=pytest.mark.slow) for n in LEVELS)],
)
def test_every_house_has_a_toilet_at_which_there_is_room(level: int, every: int) -> None:
    for name in home_names()[level - 1 :: every]:
        home = CareHome.load(name, level=level)
        place = find_place(home, ("bathroom",), Toileting.footprint, site="toilet")
        standing = place.home.furniture(place.home_room.name)
        others = [p for p in standing if p.name != place.at_fixture]
        blocked = [p.name for p in others if p.piece.blocks]
        free = Toileting.footprint.moved(place.pose)
        assert place.home_room.inside.contains(free)
        assert not [p.name for p in others if p.name in blocked and p.footprint.overlaps(free)]


def test_a_place_at_a_door_has_its_frame_and_the_floor_on_that_side() -> None:
    home = CareHome.load("house_07", level=2)
    before = Rectangle(-0.5, -1.2, 0.5, -0.2)  # of the side that it does not swing to
    place = find_place(
        home, ("bedroom",), lambda site: None if site.is_turned else before, site="door"
    )
    opening = home.plan.openings[place.at_fixture]
    assert place.pose == opening.pose and opening.rooms[1] == place.home_room.name
    assert place.home_room.inside.contains(before.moved(opening.pose))


def test_a_scene_without_people_reports_the_same_safety_keys(scripted: CareEnv) -> None:
    assert set(Safety().metrics(20.0)) == set(NOBODY)
    scripted.reset(seed=0)
    assert set(NOBODY) <= set(task_of(scripted).report())
    assert math.isclose(sum(NOBODY.values()), 0.0)
