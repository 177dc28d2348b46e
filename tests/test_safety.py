"""Forces, angles and speeds that a person goes through are measured as they are."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from urdf_files import BODY, LIMIT, joint, link, urdf

import rcare_marl
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.physiology_model import REGIONS
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.envs.safety import NOBODY, SLOW, WEIGHTS, Safety, SafetyMeter, patch_area
from rcare_marl.pose import Pose
from rcare_marl.world import GRAVITY, World

STEP = 0.1


@pytest.fixture
def world() -> Iterator[World]:
    world = World()
    yield world
    world.close()


LIMIT_N = 40.0  # [N]


def lying(world: World) -> Human:
    person = Human(
        "karan", load_avatar("karan"), posture=load_posture("bed_supine"), movable=("left_elbow",)
    )
    person.spawn(world, Pose((0, 0, 1)))
    person.reset(np.random.default_rng(0))
    return person


def run(world: World, person: Human, meter: SafetyMeter, seconds: float) -> Safety:
    found = Safety()
    for _ in range(round(seconds / STEP)):
        for _ in range(24):
            person.actuate()
            world.step()
            meter.after_substep()
        person.sense()
        found = meter.read(found, STEP)
    return found


def test_a_weight_on_the_belly_presses_by_its_weight(world: World) -> None:
    person = lying(world)
    x, y, z = person.joint_pose("spine2").position
    weight = world.add_box((0.2, 0.2, 0.02), Pose((x, y, z + 0.2)), mass=3.0)
    meter = SafetyMeter(person, world, [weight])
    found = run(world, person, meter, 2.0)
    metrics = found.metrics(LIMIT_N)
    assert found.force == pytest.approx(3.0 * GRAVITY, rel=0.05)
    assert metrics["peak_force_trunk_n"] == metrics["peak_force_n"] >= found.force
    assert 0 < metrics["mean_force_n"] <= metrics["peak_force_n"]
    assert all(metrics[f"peak_force_{r}_n"] == 0 for r in REGIONS if r.endswith(("leg", "neck")))
    assert metrics["peak_pressure_pa"] >= metrics["peak_force_n"] / 0.2**2
    assert found.cost(LIMIT_N) > 0.3  # 29 N of 40 N, and 20 N are comfortable


def test_what_carries_does_not_press(world: World) -> None:
    person = lying(world)
    x, y, z = person.joint_pose("pelvis").position
    world.add_box((0.5, 0.5, 0.4), Pose((x, y, z - 0.25)), name="bed")  # into the back
    meter = SafetyMeter(person, world, [])
    found = run(world, person, meter, 0.3)
    assert found.peak_force == 0.0 and found.cost(LIMIT_N) == pytest.approx(0.0, abs=1e-6)


def test_angles_beyond_the_passive_range_count_by_degree_and_second(world: World) -> None:
    person = lying(world)
    meter = SafetyMeter(person, world, [])
    dof = person.movable.index("left_elbow_flexion")
    highest = person.passive[dof][1]
    joint = person.body.joints[person.movable[dof]].index
    person.body.set_joints([joint], [highest + math.radians(5)])
    person.sense()
    found = meter.read(Safety(), 2.0)
    assert found.prom_deg_s == pytest.approx(10.0, rel=1e-6)
    assert found.cost(LIMIT_N) == pytest.approx(0.5 * WEIGHTS["prom"])


def test_only_a_fast_approach_costs(world: World) -> None:
    person = lying(world)
    ball = world.add_sphere(0.03, mass=0.1)
    meter = SafetyMeter(person, world, [ball])
    x, y, z = person.joint_pose("spine2").position
    for speed in (0.8 * SLOW, 2.0 * SLOW):
        meter.reset()
        found = Safety()
        for time in (0.0, STEP):
            ball.set_base(Pose((x, y, z + 0.3 - speed * time)))
            found = meter.read(found, STEP)
        assert found.top_speed == pytest.approx(speed, rel=0.1)
        assert (found.cost(LIMIT_N) > 0) == (speed > SLOW)


def test_a_hand_that_comes_closer_counts_beside_a_foot_that_is_near(
    world: World, tmp_path: Path
) -> None:
    person = lying(world)
    x, y, z = person.joint_pose("spine2").position
    solid = '<collision><geometry><box size="0.04 0.04 0.04"/></geometry></collision>'
    hand = joint("out", "foot", "hand", f'<axis xyz="0 0 1"/>{LIMIT}', kind="prismatic")
    file = urdf(tmp_path, link("foot", BODY + solid) + link("hand", BODY + solid) + hand)
    robot = world.load_urdf(file, Pose((x, y, z + 0.2)))
    meter = SafetyMeter(person, world, [robot])
    found = Safety()
    for way in (0.1, 0.1 - 2.0 * SLOW * STEP):  # above the foot, downwards
        robot.set_joints(robot.indices(["out"]), [way])
        found = meter.read(found, STEP)
    assert found.top_speed == pytest.approx(2.0 * SLOW, rel=0.1)


def test_an_arm_is_seen_near_a_person_but_for_its_hand(world: World) -> None:
    person = lying(world)
    robot = Robot("robot", load_robot("kinova_gen3"))
    robot.spawn(world, Pose())
    hand, elbow = set(robot.arm.hand), robot.body.link_index("half_arm_2_link")
    x, y, z = np.subtract(
        person.joint_pose("spine2").position, robot.body.link_pose(elbow).position
    )
    robot.body.set_base(Pose((x, y, z + 0.2)))
    meter = SafetyMeter(person, world, [robot.body])
    meter.read(Safety(), STEP)
    everything, arm = meter.near(robot.body, ()), meter.near(robot.body, hand)
    assert {elbow, min(hand)} <= {near.link for near in everything}
    assert arm == [near for near in everything if near.link not in hand]
    assert all(near.gap < 0.06 for near in arm)


def test_a_robot_is_told_where_its_arm_is_near_who_is_cared_for() -> None:
    env = rcare_marl.make("feeding")
    env.reset(seed=0)
    robot, person = env.cast["robot"], env.cast["recipient"]
    assert isinstance(robot, Robot) and isinstance(person, Human)
    assert not robot.control.near
    elbow = robot.body.link_pose(robot.body.link_index("half_arm_2_link")).position
    way = np.subtract(person.joint_pose("spine2").position, elbow) + (0.3, 0.0, 0.0)
    x, y, z = np.add(robot.body.base_pose().position, way)
    robot.body.set_base(Pose((x, y, z)))
    env.task.look()
    assert robot.control.near
    assert not {near.link for near in robot.control.near} & set(robot.arm.hand)
    env.close()


@pytest.mark.parametrize("task", ["feeding", "toileting"])
def test_every_agent_is_told_the_cost_of_every_step(task: str) -> None:
    env = rcare_marl.make(task)
    env.reset(seed=0)
    for _ in range(3):
        *_, infos = env.step({r: 0.1 * env.action_space(r).high for r in env.agents})
        assert all(infos[role]["cost"] >= 0 for role in env.possible_agents)
        assert all(infos[role].keys() >= NOBODY.keys() for role in env.possible_agents)
    env.close()


def test_a_point_is_as_large_as_a_fingertip() -> None:
    assert patch_area([(0.1, 0.2, 0.3)]) == 1e-4
    assert patch_area([(0, 0, 0), (0.2, 0, 0), (0.2, 0.1, 0.01)]) == pytest.approx(0.02)
