"""Inertial units and rays measure what mechanics and geometry say, on every robot."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sensor_scene import POSTURES, Array, Scene, arm_link, own_robot, person, urdf
from variants import every

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot, urdf_robot
from rcare_marl.agents.sensing.proximity import ProximityConfig
from rcare_marl.agents.sensing.suite import SensorSuite
from rcare_marl.pose import Pose, conjugate, quaternion_from_axis_angle, rotate
from rcare_marl.world import GRAVITY, World

# The inertial unit.


def test_imu_at_rest_reads_gravity_upward_in_its_own_axes() -> None:
    scene = Scene(
        "imu", {"kind": "imu", "name": "turned", "link": "forearm_link", "rpy_deg": [90, 0, 0]}
    )
    scene.begin(POSTURES[2])
    for steps in (0, 5):
        scene.run(steps)
        up = rotate(conjugate(scene.robot.tool_pose().quaternion), (0.0, 0.0, GRAVITY))
        assert scene.read("imu", "acceleration") == pytest.approx(up, abs=0.02)
        body = scene.robot.body
        rate = body.link_motion(scene.robot.tool_index)[2] if steps else np.zeros(3)
        turned = rotate(conjugate(scene.robot.tool_pose().quaternion), rate)
        assert scene.read("imu", "angular_velocity") == pytest.approx(turned, abs=2e-3)
        link = scene.link("forearm_link").quaternion
        up = rotate(
            quaternion_from_axis_angle((1, 0, 0), -math.pi / 2),
            rotate(conjugate(link), (0, 0, GRAVITY)),
        )
        assert scene.read("turned", "acceleration") == pytest.approx(up, abs=0.02)


def test_imu_of_a_person_is_on_the_head_with_its_axes() -> None:
    world, human, suite = person("imu")
    suite.bind(world, human)
    suite.reset(np.random.default_rng(0))
    suite.sense()
    up = rotate(conjugate(human.joint_pose("head").quaternion), (0.0, 0.0, GRAVITY))
    assert suite.reading("imu", "acceleration") == pytest.approx(up, abs=1e-4)
    assert up[1] > 0.8 * GRAVITY  # y is up in the head


def test_imu_feels_the_pull_of_an_even_turn(tmp_path: Path) -> None:
    arm = arm_link("a", "root", at="0 0 1", axis="0 0 1", com="0.3 0 0.1", mass=1.0)
    at = {"kind": "imu", "link": "a", "at": [0.5, 0, 0]}
    scene = own_robot(urdf(tmp_path / "own.urdf", arm), ("a_joint",), "a", at)
    scene.begin((0.0,))
    indices = scene.robot.body.indices(["a_joint"])
    for k in range(240):
        scene.robot.body.drive_velocities(indices, [2.0], [1000.0])
        scene.world.step()
        scene.suite.after_substep()
        if k == 0:  # from rest to full speed in one step
            scene.suite.sense()
            assert scene.read("imu", "acceleration")[1] == pytest.approx(0.5 * 2.0 * 240, rel=0.01)
    scene.suite.sense()
    # Towards the axis, omega squared times radius; up, against gravity.
    assert scene.read("imu", "acceleration") == pytest.approx((-2.0, 0, GRAVITY), abs=0.03)
    assert scene.read("imu", "angular_velocity") == pytest.approx((0, 0, 2.0), abs=0.01)


def test_imu_on_a_pendulum_feels_its_string(tmp_path: Path) -> None:
    arm = arm_link("a", "root", at="0 0 2", axis="0 1 0", com="0 0 -1", mass=1.0)
    imu = {"kind": "imu", "link": "a", "at": [0, 0, -1]}
    scene = own_robot(urdf(tmp_path / "own.urdf", arm), ("a_joint",), "a", imu)
    body = scene.robot.body
    body.set_damping()
    indices = body.indices(["a_joint"])
    scene.begin((1.0,))
    body.release_motors(indices)
    inertia = body.mass_matrix([0.0])[0, 0]
    for k in range(240):
        scene.world.step()
        scene.suite.after_substep()
        scene.suite.sense()
        if k < 3:
            continue
        (angle,), (speed,) = body.joint_states(indices)
        # The link hangs at -z of its frame and turns about y: theta'' = -m g l sin(theta) / I.
        spin = -GRAVITY * math.sin(angle) / inertia
        wanted = (
            -spin - GRAVITY * math.sin(angle),
            0.0,
            speed**2 + GRAVITY * math.cos(angle),
        )
        assert scene.read("imu", "acceleration") == pytest.approx(wanted, abs=0.2)
        assert scene.read("imu", "angular_velocity") == pytest.approx((0, speed, 0), abs=0.05)


# Rays.


def test_proximity_of_flat_walls_is_exact_and_the_own_body_is_not_seen() -> None:
    scene = Scene({"kind": "proximity", "rays": 24, "angle_deg": 50, "reach": 3.0})
    scene.begin()
    tool = scene.robot.tool_pose()
    wall = scene.world.add_box((4.0, 4.0, 0.1), tool @ Pose((0, 0, 1.05)))
    ball = scene.world.add_sphere(0.03, mass=0.2)
    scene.robot.grasp(ball, Pose((0, 0, 0.1)))  # what is held is not in the way
    scene.suite.sense()
    config = scene.suite.sensors["proximity"].config
    assert isinstance(config, ProximityConfig)
    along = config.directions()[:, 2]
    assert math.degrees(math.acos(along.min())) == pytest.approx(25)
    assert scene.read("proximity", "distance") == pytest.approx(1.0 / along, abs=1e-3)
    wall.set_base(tool @ Pose((0, 0, 5.0)))
    scene.suite.sense()
    assert (scene.read("proximity", "distance") == 3.0).all()


def test_a_level_scanner_sees_a_corner_from_right_to_left() -> None:
    scene = Scene(
        {
            "kind": "proximity",
            "link": "base_link",
            "at": [0, 0, 0.3],
            "rpy_deg": [180, -90, 0],
            "pattern": "fan",
            "rays": 5,
            "angle_deg": 180,
            "reach": 4.0,
        }
    )
    scene.world.add_box((0.1, 8, 1), Pose((1.55, 0, 0.5)))  # 1.5 m in front
    scene.world.add_box((8, 0.1, 1), Pose((0, 2.05, 0.5)))  # 2 m to the left
    scene.begin((0.0,) * 7)
    diagonal = 1.5 * math.sqrt(2)
    wanted = (4.0, diagonal, 1.5, diagonal, 2.0)
    assert scene.read("proximity", "distance") == pytest.approx(wanted, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", every(2, assets.names("robots")))
def test_every_robot_can_have_every_sensor(name: str) -> None:
    config, world = load_robot(name), World()
    robot = Robot(name, config)  # its main arm moves, another does not
    small: dict[str, Any] = {"width": 16, "height": 12}
    hand = {"link": config.arms[config.main_arm].tool_link, **small}
    suite = SensorSuite(
        [
            *("joint_wrench", "joint_torque", "contact_force", "imu", "proximity"),
            {"kind": "taxels", "spacing": 0.05},
            *({"kind": "wrist_wrench", "name": f"{arm}_wrist", "arm": arm} for arm in config.arms),
            *({"kind": "camera", "name": f"{c}_eye", "camera": c, **small} for c in config.cameras),
            {"kind": "camera", **hand},
            {"kind": "markers", **hand},
        ],
        name,
    )
    robot.equip(suite)
    robot.spawn(world, Pose((0, 0, 1)))
    robot.reset(np.random.default_rng(0))
    suite.bind(world, robot)
    suite.reset(np.random.default_rng(0))
    for _ in range(2):
        suite.sense()
        for observable in suite.observables():
            assert np.isfinite(np.asarray(observable.read())).all(), observable.name
        robot.command(np.zeros(robot.action_size), 0.1)
        for _ in range(24):
            robot.actuate()
            world.step()
            suite.after_substep()
    suite.sense()
    assert len(suite.reading("taxels", "force")) > 3
    assert np.abs(suite.reading("joint_torque", "effort")).max() > 0.05
    for arm in config.arms:
        beyond = robot.body.carried_by(robot.body.link_index(str(config.arms[arm].wrist_link)))
        weight = GRAVITY * sum(robot.body.mass(link) for link in beyond)
        assert np.linalg.norm(suite.reading(f"{arm}_wrist", "force")) == pytest.approx(
            weight, rel=0.02
        )
    suite.close()
    world.close()


def test_the_wrist_of_an_own_robot_is_its_last_joint_even_if_that_does_not_move(
    tmp_path: Path,
) -> None:
    chain = arm_link("a", "root", at="0 0 1", axis="0 1 0", com="0.1 0 0", mass=1.0)
    chain += arm_link("b", "a", at="0.3 0 0", axis="0 1 0", com="0.1 0 0", mass=0.7)
    config = urdf_robot(urdf(tmp_path / "own.urdf", chain), ("a_joint", "b_joint"), "b")
    for moves in (["arm"], []):
        robot = Robot("robot", config, control="joint_velocity", moves=moves)
        scene = Scene("wrist_wrench", "imu", robot=robot)
        scene.suite.bind(scene.world, robot)
        scene.suite.reset(np.random.default_rng(0))
        scene.run(2)
        felt = np.linalg.norm(scene.read("wrist_wrench", "force"))
        assert felt == pytest.approx(0.7 * GRAVITY, rel=0.01)


# In an environment.


def test_an_environment_observes_what_its_agents_are_given() -> None:
    entry: dict[str, Any] = {"kind": "taxels", "links": ["head"], "spacing": 0.04, "noise": 0.1}

    def run(seed: int) -> tuple[list[tuple[slice, str, str]], Array]:
        env = rcare_marl.make(
            "feeding",
            robot={"sensors": [{"kind": "wrist_wrench", "tare": True}, "imu"]},
            recipient={"sensors": [entry, {"kind": "contact_force", "rate": 20.0}]},
        )
        seen = []
        for _ in range(2):  # the second episode is played in a world that was rewound
            observations, _ = env.reset(seed=seed)
            for _ in range(4):
                action = {
                    a: np.full(env.action_space(a).shape, 0.2, np.float32) for a in env.agents
                }
                observations = env.step(action)[0]
                seen.append(np.concatenate([*observations.values(), env.observe("recipient")]))
        table = [*env.describe("robot"), *env.describe("recipient")]
        env.close()
        return table, np.array(seen)

    table, first = run(3)
    names = {name for _, name, _ in table}
    wanted = {"wrist_wrench_force", "wrist_wrench_torque", "imu_acceleration", "taxels_force"}
    assert wanted | {"contact_force_force"} <= names
    assert (first[:4] == first[4:]).all() and (first == run(3)[1]).all()
    assert (first[:4] != run(4)[1][:4]).any()
    # The wrist feels the spoon with its food, and nothing else, once the arm is under way.
    at = next(part for part, name, _ in table if name == "wrist_wrench_force")
    assert 0.1 < np.linalg.norm(first[3][at]) < 3.0
