"""Ambulating: three kinds of doors are worked by contact, and each of them can be."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest
from episode import play
from variants import few

import rcare_marl
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.devices import PoweredWheelchair
from rcare_marl.envs.homes import (
    HINGE_DAMPING,
    CareHome,
    HomePlace,
    build_door,
    find_place,
    home_names,
)
from rcare_marl.envs.scenes.door_approach import WIDE_ENOUGH
from rcare_marl.envs.scenes.way_through import WayThrough
from rcare_marl.envs.tasks.ambulating import CONTACT_TORQUE, Ambulating
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.world import World

HARDWARE = {1: "knob", 2: "lever", 3: "slider"}
BOTH = {"robot": "scripted", "recipient": "still"}


def task_of(env: CareEnv) -> Ambulating:
    return cast(Ambulating, env.task)


def run(env: CareEnv, seed: int) -> Ambulating:
    play(env, seed)
    return task_of(env)


@pytest.fixture(scope="module", params=few(HARDWARE, 1, 3))
def scripted(request: pytest.FixtureRequest) -> Iterator[CareEnv]:
    env = rcare_marl.make("ambulating", level=request.param, policies=BOTH)
    yield env
    env.close()


def test_each_level_has_its_door_and_the_scripted_robot_works_it(scripted: CareEnv) -> None:
    task = task_of(scripted)
    assert task.hardware == HARDWARE[task.place.level]
    for seed in range(2):
        assert run(scripted, seed).succeeded()
        metrics = task.report()
        assert metrics["peak_door_force_n"] > 1 and metrics["peak_force_n"] == 0
        assert metrics["latched"] == 0 or task.hardware != "slider"


def test_an_episode_starts_shut(scripted: CareEnv) -> None:
    for seed in (3, 4):
        scripted.reset(seed=seed)
        task = task_of(scripted)
        assert task.report()["progress"] < 0.01
        assert task.door.is_latched == (task.hardware != "slider")


@pytest.mark.parametrize(("level", "kind"), [(1, "knob"), (2, "lever")])
def test_what_counts_is_that_the_latch_is_free(level: int, kind: str) -> None:
    env = rcare_marl.make("ambulating", level=level, policies=BOTH)
    env.reset(seed=0)
    task = task_of(env)
    for share, is_free in ((0.95, False), (1.05, True)):
        for _ in range(16):  # a latch looks every 8 physics steps
            task.door.body.set_joints(task._joint, [share * task.door.release_angle])
            env.world.step()
        task.door.body.set_joints(task._joint, [share * task.door.release_angle])
        task.look()
        assert task.succeeded() == is_free and task.door.is_latched != is_free
    env.close()


def test_the_paper_rewards_rotation_of_handles_and_nearness_of_panels(scripted: CareEnv) -> None:
    scripted.reset(seed=0)
    task = task_of(scripted)
    terms = dict(task.rewards("robot", task.state))
    assert terms.pop("opened") == 0.0
    if task.hardware == "slider":
        assert terms == {"distance": pytest.approx(-WIDE_ENOUGH, abs=1e-3)}
    else:
        assert terms == {"rotation_angle": pytest.approx(0.0, abs=1e-3)}


@pytest.mark.slow
def test_a_door_of_a_house_is_worked_where_a_chair_has_room() -> None:
    env = rcare_marl.make("ambulating", home="house_07", level=3, policies=BOTH)
    task = run(env, 0)
    place = env.task.place
    assert isinstance(place, HomePlace)
    assert task.door is place.standing.doors[place.at_fixture]
    assert task.succeeded()
    env.close()


@pytest.fixture(scope="module")
def driven() -> Iterator[CareEnv]:
    env = rcare_marl.make("ambulating", level=2, options={"goal": "through"}, policies=BOTH)
    yield env
    env.close()


def through(env: CareEnv) -> WayThrough:
    way = task_of(env).way
    assert way is not None
    return way


def test_the_robot_frees_the_latch_and_drives_the_chair_through_when_asked(driven: CareEnv) -> None:
    driven.reset(seed=0)
    while not driven.is_over:
        driven.step({})
    task, way = task_of(driven), through(driven)
    assert task.succeeded() and task.report()["peak_force_n"] == 0
    assert task.report()["way_through_m"] >= 0 and task.state.opening > 1.2
    names = driven.cast["robot"].action_names
    assert names[-2:] == ("wheelchair forward [m/s]", "wheelchair turning [rad/s]")
    # Person and robot came along, as they sat and stood.
    driven.reset(seed=0)
    start = [way.chair.pose.inverse() @ a.body.base_pose() for a in driven.cast.values()]
    for _ in range(80):
        driven.step({})
    moved = task_of(driven).state.way
    assert moved is not None and moved.place[1] > -0.9
    for agent, was in zip(driven.cast.values(), start, strict=True):
        now = way.chair.pose.inverse() @ agent.body.base_pose()
        assert np.linalg.norm(np.subtract(now.position, was.position)) < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize(("level", "width"), [(1, 0.83), (2, None), (3, None)])
def test_the_scripted_robot_drives_through_nine_of_ten_doors(
    level: int, width: float | None
) -> None:
    options = {"goal": "through", "clear_width": width}
    env = rcare_marl.make("ambulating", level=level, options=options, policies=BOTH)
    assert sum(run(env, seed).succeeded() for seed in range(20)) >= 18
    env.close()


def test_a_chair_is_stopped_by_a_wall_with_the_force_of_its_wheels() -> None:
    world = World()
    wall = world.add_box((0.1, 2.0, 1.0), Pose((1.2, 0.0, 0.5)), name="wall")
    chair = PoweredWheelchair()
    chair.spawn(world)
    world.mark_start()
    world.rewind()
    forces = []
    for _ in range(960):
        chair.base.drive((chair.drive.speed, 0.0, 0.0))
        world.step()
        forces.append(world.contact_force(chair.body, wall))
    assert np.mean(forces[-240:]) == pytest.approx(chair.drive.force, rel=0.02)
    assert max(forces) < 1000.0  # as it meets the wall at full speed
    assert world.separation(chair.body, wall, within=0.1) > -0.03


def test_a_hinge_resists_the_chair_that_pushes_the_leaf() -> None:
    world = World()
    door = build_door(world, level=2)
    chair = PoweredWheelchair()
    chair.spawn(world, Pose((0.04, -1.15, 0.0), (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))))
    door.open(0.1)
    start, impulse = door.angle, 0.0
    for _ in range(3000):
        chair.base.drive((0.1, 0.0, 0.0))
        world.step()
        impulse += world.contact_force(chair.body, door.body) * world.physics_dt
    # The leaf rests before and after: all of the push went into the hinges. The guard meets it with its
    # left end, 0.23 m from them.
    assert HINGE_DAMPING * (door.angle - start) / impulse == pytest.approx(0.23, abs=0.03)


def test_a_chair_that_is_too_wide_for_a_door_is_told_so() -> None:
    with pytest.raises(ConfigError, match="leaves 0.66 m"):
        rcare_marl.make("ambulating", level=1, options={"goal": "through"})


def test_a_hand_turns_a_knob_with_more_than_a_tenth_of_what_its_wrist_can() -> None:
    env = rcare_marl.make("ambulating", robot="fetch", level=1, policies=BOTH)
    wrist = env.cast["robot"].body.joint("wrist_roll_joint")
    assert 0.1 * wrist.effort < 0.80 < CONTACT_TORQUE
    assert run(env, 0).succeeded()
    env.close()


@pytest.mark.parametrize(("robot", "level"), [("franka_panda", 3), ("kinova_gen2", 1)])
def test_an_arm_on_the_chair_starts_as_it_was_found_to_reach_and_opens_the_door(
    robot: str, level: int
) -> None:
    policies = {**BOTH, "robot": "scripted_anyway"}
    env = rcare_marl.make("ambulating", robot=robot, level=level, policies=policies)
    arm = task_of(env).robot.arm
    found = arm.positions()
    env.reset(seed=0)
    assert np.abs(arm.positions() - found).max() < 1.0
    assert run(env, 0).succeeded()
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("level", [2, 3])
@pytest.mark.parametrize("robot", ["fetch", "hsr", "pr2", "stretch_re1", "stretch_re1_dex"])
def test_robots_that_drive_stand_before_the_door_and_open_it(robot: str, level: int) -> None:
    env = rcare_marl.make("ambulating", robot=robot, level=level, policies=BOTH)
    assert task_of(env).approach.stands
    assert run(env, 0).succeeded()
    env.close()


@pytest.mark.slow
def test_every_house_has_room_before_a_door_at_every_level() -> None:
    env = rcare_marl.make("ambulating", level=1)
    task = task_of(env)
    for name in home_names():
        for level in HARDWARE:
            home = CareHome.load(name, level=level)
            place = find_place(home, task.room_kinds, task.floor_before, site="door")
            kept = [p for p in place.home.furniture(place.home_room.name) if p.piece.blocks]
            assert place.home_room.inside.contains(place.footprint)
            assert not any(p.footprint.overlaps(place.footprint) for p in kept)
    env.close()


@pytest.mark.slow
def test_a_door_of_a_house_is_worked_from_its_other_side_where_only_that_has_room() -> None:
    env = rcare_marl.make("ambulating", home="house_09", level=1, policies=BOTH)
    task = run(env, 0)
    assert task.approach.touched == "handle_inside"
    assert task.succeeded()
    env.close()


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ({"options": {"clear_width": 0.2}}, "clear_width"),
        ({"home": "house_07", "level": 2, "options": {"clear_width": 0.9}}, "bare floor"),
        ({"robot": "fetch", "level": 2, "options": {"goal": "through"}}, "mounted on it"),
        ({"options": {"force_limit": 0}}, "force_limit"),
        ({"robot": "nao"}, "nao"),
        ({"robot": {"moves": ["arm"]}, "policies": BOTH}, "gripper"),
        ({"robot": {"control": "joint_velocity"}, "policies": BOTH}, "tool_delta"),
    ],
)
def test_what_cannot_be_is_refused(what: dict[str, object], message: str) -> None:
    with pytest.raises((ConfigError, ValueError), match=message):
        rcare_marl.make("ambulating", **what)  # type: ignore[arg-type]
