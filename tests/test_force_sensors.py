"""Sensors of force: what joints, wrists, links and taxels feel, against what mechanics says."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from sensor_scene import POSTURES, STEPS, Array, Scene, arm_link, own_robot, person, urdf
from variants import KINDS_OF_ROBOTS, every, few

from rcare_marl import assets
from rcare_marl.agents.people.human import FRICTION
from rcare_marl.agents.robots.robot import GripperUse, Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.agents.sensing.suite import Entry, SensorSuite
from rcare_marl.agents.sensing.taxel_map import TaxelMap
from rcare_marl.body import Body
from rcare_marl.cache import cached
from rcare_marl.pose import Pose, conjugate, quaternion_from_axis_angle, rotate
from rcare_marl.world import GRAVITY, World

# Joints.


@pytest.mark.parametrize("posture", [(0.0, 0.0), (0.25, 0.7), (0.1, -0.4)])
def test_joint_wrench_is_the_weight_that_a_joint_carries(
    tmp_path: Path, posture: tuple[float, float]
) -> None:
    lift = arm_link(
        "a", "root", at="0 0 1", axis="1 0 1", com="0.3 0.02 0", mass=2.0, kind="prismatic"
    )
    arm = arm_link("b", "a", at="0.5 0 0", axis="0 1 0", com="0.2 0.1 0.05", mass=0.5)
    file = urdf(tmp_path / "own.urdf", lift + arm)
    scene = own_robot(file, ("a_joint", "b_joint"), "b", "joint_wrench", "joint_torque")
    scene.begin(posture)
    at_rest = scene.read("joint_wrench", "force"), scene.read("joint_wrench", "torque")
    scene.run(10)
    down = np.array((0.0, 0.0, -GRAVITY))
    turn = quaternion_from_axis_angle((0, 1, 0), posture[1])
    centre = rotate(turn, (0.2, 0.1, 0.05))  # of the second link, from its joint
    on_a = np.cross((0.3, 0.02, 0), 2.0 * down) + np.cross(centre + (0.5, 0, 0), 0.5 * down)
    back = conjugate(turn)
    on_b = rotate(back, np.cross(centre, 0.5 * down))
    force, moment = scene.read("joint_wrench", "force"), scene.read("joint_wrench", "torque")
    assert force == pytest.approx(np.array((2.5 * down, 0.5 * rotate(back, down))), abs=0.02)
    assert moment == pytest.approx(np.array((on_a, on_b)), abs=0.01)
    effort = scene.read("joint_torque", "effort")  # it holds the weight
    assert effort == pytest.approx((2.5 * GRAVITY / math.sqrt(2), -on_b[1]), abs=0.02)
    assert at_rest[0] == pytest.approx(force, abs=0.02)
    assert at_rest[1] == pytest.approx(moment, abs=0.02)


@pytest.mark.parametrize("control", ["joint_velocity", "tool_delta", "joint_torque"])
def test_joint_torque_holds_the_arm_in_every_mode(control: str) -> None:
    scene = Scene("joint_torque", control=control)
    scene.begin()
    first = scene.read("joint_torque", "effort")
    scene.run(20)
    held = scene.robot.arm.chain.gravity_torques(scene.robot.arm.positions())
    assert scene.read("joint_torque", "effort") == pytest.approx(held, abs=0.1)
    assert np.abs(held).max() > 5
    assert first == pytest.approx(held, abs=0.1)


# The wrist.


def wrist(scene: Scene) -> tuple[Array, Array]:
    """Return the force in the world and the torque in the tool's axes."""
    force = rotate(scene.robot.tool_pose().quaternion, scene.read("wrist_wrench", "force"))
    return force, scene.read("wrist_wrench", "torque")


TARED: Entry = {"kind": "wrist_wrench", "tare": True, "about": "tool"}


@pytest.mark.parametrize("gripper", ["held", "free"])
@pytest.mark.parametrize("posture", every(2, POSTURES))
def test_wrist_feels_a_hanging_kilogram_in_any_posture(
    posture: tuple[float, ...], gripper: GripperUse
) -> None:
    scene = Scene(TARED, gripper=gripper)
    ball = scene.world.add_sphere(0.02, Pose((3, 0, 0)), mass=1.0)
    scene.begin(posture)
    scene.run(10)
    force, torque = wrist(scene)
    assert np.abs(force).max() < 0.01 and np.abs(torque).max() < 0.002  # the hand itself is tared
    in_tool = np.array((0.03, 0.0, 0.06))
    bond = scene.robot.grasp(ball, Pose(tuple(in_tool.tolist())))
    scene.run(15)
    force, torque = wrist(scene)
    assert force == pytest.approx((0, 0, -GRAVITY), abs=0.01 * GRAVITY)
    down = rotate(conjugate(scene.robot.tool_pose().quaternion), (0.0, 0.0, -GRAVITY))
    assert torque == pytest.approx(np.cross(in_tool, down), abs=0.01)
    scene.world.detach(bond)
    scene.run(5)
    assert np.abs(wrist(scene)[0]).max() < 0.01


def test_wrist_without_tare_feels_the_hand_and_about_says_where() -> None:
    scene = Scene("wrist_wrench", {"kind": "wrist_wrench", "name": "at_tool", "about": "tool"})
    scene.begin()
    first = scene.read("wrist_wrench", "force")
    scene.run(10)
    body = scene.robot.body
    wrist_link = str(scene.robot.config.arms["arm"].wrist_link)
    beyond = body.carried_by(body.link_index(wrist_link))
    mass = sum(body.mass(link) for link in beyond)
    force, torque = wrist(scene)
    assert force == pytest.approx((0, 0, -GRAVITY * mass), abs=0.02)
    assert first == pytest.approx(scene.read("wrist_wrench", "force"), abs=0.05)
    tool = scene.robot.tool_pose()
    arm = np.subtract(scene.link(wrist_link).position, tool.position)
    moved = torque + np.cross(
        rotate(conjugate(tool.quaternion), arm), scene.read("wrist_wrench", "force")
    )
    assert scene.read("at_tool", "torque") == pytest.approx(moved, abs=1e-5)


def test_wrist_feels_what_lies_on_the_hand_by_friction(tmp_path: Path) -> None:
    scene = tray(tmp_path, TARED, slope=0.15, turn=0.6)
    load = scene.world.add_box((0.08, 0.08, 0.05), Pose((0.4, 0, 1.036)), mass=1.0)
    load.set_friction([-1], lateral=1.0)
    load.set_base(scene.robot.tool_pose() @ Pose((0.05, 0.02, 0.0352)))
    scene.run(12)
    force, torque = wrist(scene)
    assert force == pytest.approx((0, 0, -GRAVITY), abs=0.01 * GRAVITY)
    local = np.array((scene.robot.tool_pose().inverse() @ load.base_pose()).position)
    assert local[:2] == pytest.approx((0.05, 0.02), abs=0.01)  # it did not slide
    down = rotate(conjugate(scene.robot.tool_pose().quaternion), (0.0, 0.0, -GRAVITY))
    assert torque == pytest.approx(np.cross(local, down), abs=0.02)  # a lever of 2 mm


def test_wrist_feels_what_the_fingers_hold() -> None:
    scene = Scene(TARED, gripper="free")
    box = scene.world.add_box((0.03, 0.05, 0.06), mass=0.5)
    box.set_friction([-1], lateral=1.2)
    scene.begin()
    scene.robot.set_gripper(0.0)
    scene.run(2)
    scene.robot.set_gripper(1.0)
    for _ in range(6):
        box.set_base(scene.robot.tool_pose())
        scene.run(1)
    scene.run(5)
    force, _ = wrist(scene)
    assert force == pytest.approx((0, 0, -0.5 * GRAVITY), abs=0.02 * GRAVITY)


@pytest.mark.parametrize("name", few(assets.names("robots"), *KINDS_OF_ROBOTS))
def test_the_wrist_of_every_robot_feels_a_kilogram(name: str) -> None:
    config, world = load_robot(name), World()
    for arm, about in config.arms.items():
        robot = Robot(name, config, control="joint_velocity", moves=[arm])
        suite = SensorSuite([{"kind": "wrist_wrench", "arm": arm, "tare": True}], name)
        robot.equip(suite)
        robot.spawn(world, Pose((0, 0, 1.0)))
        robot.reset(np.random.default_rng(0))
        suite.bind(world, robot)
        suite.reset(np.random.default_rng(0))
        for load in (0.0, 1.0):
            if load:
                ball = world.add_sphere(0.02, robot.tool_pose(arm), mass=load)
                world.set_collision(robot.body, ball, False)
                world.attach(robot.body, about.tool_link, ball)
            for _ in range(10):
                robot.command(np.zeros(robot.action_size), STEPS / 240)
                for _ in range(STEPS):
                    robot.actuate()
                    world.step()
            suite.sense()
            force = rotate(robot.tool_pose(arm).quaternion, suite.reading("wrist_wrench", "force"))
            assert force == pytest.approx((0, 0, -GRAVITY * load), abs=0.01 * GRAVITY)
        world = World()


def test_wrist_can_take_off_what_swinging_the_hand_needs() -> None:
    scene = Scene(
        {"kind": "wrist_wrench", "name": "plain", "tare": True},
        {"kind": "wrist_wrench", "name": "calm", "tare": True, "tare_inertia": True},
        physics_dt=1 / 960,
    )
    scene.begin(POSTURES[1])
    scene.robot.body.set_damping()
    joints = scene.robot.body.indices([f"joint_{k}" for k in range(1, 8)])
    felt: dict[str, list[Array]] = {"plain": [], "calm": []}
    for k in range(960):
        speeds = 1.5 * np.sin(2 * np.pi * k / 960 * np.arange(1, 8) / 2)
        scene.robot.body.drive_velocities(joints, speeds, [1000.0] * 7)
        scene.world.step()
        scene.suite.after_substep()
        scene.suite.sense()
        for name, found in felt.items():
            found.append(np.concatenate([scene.read(name, c) for c in ("force", "torque")]))
    plain, calm = (np.abs(np.array(felt[name])[5:]).max(axis=0) for name in ("plain", "calm"))
    assert plain[:3].max() > 5 and plain[3:].max() > 0.2
    assert calm[:3].max() < 0.02 * plain[:3].max()
    assert calm[3:].max() < 0.02 * plain[3:].max()


# Contact.


TRAY = """<link name="tray"><inertial><mass value="0.7"/><inertia ixx="0.01" iyy="0.01" izz="0.01"
ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><box size="0.4 0.4 0.02"/></geometry>
</collision></link><joint name="wrist" type="fixed"><parent link="a"/><child link="tray"/>
<origin xyz="0.4 0 0" rpy="0 0 {turn}"/></joint>"""


def tray(tmp_path: Path, *sensors: Entry, slope: float, turn: float = 0.0) -> Scene:
    """Return an arm with a flat tray as its hand, tilted by `slope` [rad]."""
    arm = arm_link("a", "root", at="0 0 1", axis="0 1 0", com="0.1 0 0", mass=1.0)
    file = urdf(tmp_path / "own.urdf", arm + TRAY.format(turn=turn))
    scene = own_robot(file, ("a_joint",), "tray", *sensors)
    scene.begin((slope,))
    return scene


def test_contact_force_is_the_weight_of_what_lies_on_a_link(tmp_path: Path) -> None:
    scene = tray(
        tmp_path,
        {"kind": "contact_force", "links": ["a", "tray"], "per_link": True},
        {"kind": "contact_force", "name": "all"},
        {"kind": "contact_force", "name": "size", "output": "magnitude"},
        slope=0.0,
    )
    box = scene.world.add_box((0.1, 0.1, 0.05), mass=1.5)
    box.set_base(scene.robot.tool_pose() @ Pose((0.02, 0.05, 0.0352)))
    scene.run(10)
    weight = 1.5 * GRAVITY
    per_link = scene.read("contact_force", "force")
    assert per_link[0] == pytest.approx(0, abs=1e-6)
    assert per_link[1] == pytest.approx((0, 0, -weight), abs=0.01 * weight)
    assert scene.read("all", "force") == pytest.approx((0, 0, -weight), abs=0.01 * weight)
    assert scene.read("size", "force")[0] == pytest.approx(weight, rel=0.01)


@pytest.mark.parametrize("is_made_anew", [False, True])
def test_contact_force_has_the_friction_that_holds_a_load_on_a_slope(
    tmp_path: Path, is_made_anew: bool
) -> None:
    scene = tray(tmp_path, {"kind": "contact_force", "links": ["tray"]}, slope=0.3)
    box = scene.world.add_box((0.1, 0.1, 0.05), mass=1.0)
    box.set_friction([-1], lateral=1.0)
    box.set_base(scene.robot.tool_pose() @ Pose((0, 0, 0.0352)))
    if is_made_anew:  # the order of bodies in the broad phase decides how Bullet tells friction
        scene.robot.body.exclude_own_links()
    scene.run(12)
    down = (0, 0, -GRAVITY)
    assert scene.read("contact_force", "force") == pytest.approx(down, abs=0.03 * GRAVITY)
    assert scene.world.contact_force(scene.robot.body) < 0.97 * GRAVITY  # normal forces alone


def test_the_peak_tells_of_an_impact_and_the_mean_of_its_momentum(tmp_path: Path) -> None:
    scene = tray(
        tmp_path,
        "contact_force",
        {"kind": "contact_force", "name": "peak", "statistic": "peak"},
        slope=0.0,
    )
    ball = scene.world.add_sphere(0.03, mass=0.5)
    ball.set_damping()
    ball.set_base(scene.robot.tool_pose() @ Pose((0, 0, 0.24)))
    period = STEPS / 240
    for _ in range(9):
        before = float(ball.link_motion(-1)[1][2])
        scene.run(1)
        change = 0.5 * (float(ball.link_motion(-1)[1][2]) - before)
        # The impulse of the contact bears the weight and turns the momentum.
        impulse = -float(scene.read("contact_force", "force")[2]) * period
        assert impulse == pytest.approx(change + 0.5 * GRAVITY * period, rel=0.02, abs=1e-3)
        if impulse > 0.3:
            assert -float(scene.read("peak", "force")[2]) > 10 * impulse / period
            return
    pytest.fail("the ball never fell on the tray")


# Taxels.


def map_of(scene: Scene) -> TaxelMap:
    sensor = scene.suite.sensors["taxels"]
    assert isinstance(sensor, TaxelMap)
    return sensor


def test_taxels_lie_evenly_on_the_outside() -> None:
    scene = Scene({"kind": "taxels", "links": ["forearm_link", "bracelet_link"], "spacing": 0.012})
    scene.begin()
    taxels = map_of(scene)
    for patch in taxels.patches:
        gaps = np.linalg.norm(patch.positions[:, None] - patch.positions, axis=2)
        np.fill_diagonal(gaps, np.inf)
        nearest = gaps.min(axis=1)
        assert nearest.min() >= 0.012 and nearest.max() < 0.024
        assert np.linalg.norm(patch.normals, axis=1) == pytest.approx(1)
    # The forearm is a capsule: all points are a radius from its line, with normals straight out.
    forearm = taxels.patches[0]
    (shape,) = scene.robot.body.collision_shapes(forearm.place.link)
    length, radius = shape.size[:2]
    back = shape.pose.inverse()
    local = np.array([(back @ Pose(tuple(p))).position for p in forearm.positions])
    local[:, 2] -= np.clip(local[:, 2], -length / 2, length / 2)
    assert np.linalg.norm(local, axis=1) == pytest.approx(radius, rel=0.03)
    out = np.array([rotate(shape.pose.quaternion, p) for p in local / radius])
    assert (out * forearm.normals).sum(axis=1).min() > 0.97
    rng = np.random.default_rng(0)
    angle, along = rng.uniform(0, 2 * np.pi, 500), rng.uniform(-length / 2, length / 2, 500)
    around = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), along))
    points = np.array([(shape.pose @ Pose(tuple(p))).position for p in around.tolist()])
    holes = np.linalg.norm(points[:, None] - forearm.positions, axis=2).min(axis=1)
    assert holes.max() < 0.014


def press(world: World, at: Array, *, shape: str, force: float) -> Body:
    """Return a stamp above a point in the world [m] that comes down with `force` [N]."""
    size = {"box": '<box size="0.06 0.06 0.03"/>', "sphere": '<sphere radius="0.03"/>'}[shape]
    stamp = f"""<robot name="stamp"><link name="root"/><link name="stamp"><inertial><mass value="0.5"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial><collision>
    <geometry>{size}</geometry></collision></link><joint name="down" type="prismatic">
    <parent link="root"/><child link="stamp"/><axis xyz="0 0 -1"/>
    <limit lower="-1" upper="1" effort="100" velocity="1"/></joint></robot>"""
    body = world.load_urdf(cached("stamp", ".urdf", stamp), Pose(tuple(at.tolist())))
    body.drive_velocities(body.indices(["down"]), [0.1], [force])
    return body


STAMP_FRICTION = 0.5  # Bullet's of what says nothing; that of a pair is the product
LEVEL = (0.0, math.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0)  # the arm stretched out level


@pytest.mark.parametrize("shape", ["box", "sphere"])
def test_taxels_sum_to_the_normal_force_on_links_of_a_robot(shape: str) -> None:
    links = ["forearm_link", "half_arm_2_link"]
    scene = Scene({"kind": "taxels", "links": links, "statistic": "last"})
    scene.begin(LEVEL)
    forearm, upper = (np.array(scene.link(name).position) for name in links)
    press(scene.world, forearm + (0.09, 0, 0.08), shape=shape, force=20.0)
    press(scene.world, upper + (0.09, 0.005, 0.08), shape=shape, force=5.0)
    body, pressed = scene.robot.body, 0
    for _ in range(20):
        scene.run(1)
        touched = [body.link_index(name) for name in links]
        found = scene.world.contacts(body)
        forces = np.array([sum(c.force for c in found if c.link_a == k) for k in touched])
        felt = scene.read("taxels", "force")
        assert felt.min() >= 0
        sums = [felt[patch.taxels].sum() for patch in map_of(scene).patches]
        assert sums == pytest.approx(forces, rel=1e-3, abs=1e-6)
        pressed += bool(forces.min() > 1)
    assert pressed > 5


def test_taxels_feel_where_they_are_touched() -> None:
    scene = Scene({"kind": "taxels", "links": ["forearm_link"], "spacing": 0.015})
    scene.begin(LEVEL)
    at = np.array(scene.link("forearm_link").position) + (0.09, 0, 0.08)
    press(scene.world, at, shape="sphere", force=20.0)
    scene.run(20)
    places, normals = map_of(scene).placed()
    felt = scene.read("taxels", "force")
    assert felt.sum() == pytest.approx(20 + 0.5 * GRAVITY, rel=0.3)
    centre = felt @ places / felt.sum()
    contacts = scene.world.contacts(scene.robot.body)
    touched = np.mean([contact.position for contact in contacts if contact.force > 0], axis=0)
    assert np.linalg.norm(centre - touched) < 0.01
    assert normals[felt > 0.01 * felt.max()][:, 2].min() > 0  # those on top
    assert (felt > 0.01 * felt.max()).sum() > 4


ARM: tuple[Entry, ...] = (
    {"kind": "taxels", "links": ["right_elbow"], "spacing": 0.015, "statistic": "last"},
    {"kind": "contact_force", "links": ["right_elbow"], "statistic": "last"},
)  # Karan's right forearm is level; the left one lies across the lap, as he holds it


@pytest.mark.parametrize("shape", ["box", "sphere"])
@pytest.mark.parametrize("tissue", [(), ("right_elbow",)])
def test_taxels_sum_to_the_force_on_a_forearm_of_bone_or_flesh(
    tissue: tuple[str, ...], shape: str
) -> None:
    world, human, suite = person(*ARM, tissue=tissue)
    elbow, hand = (np.array(human.joint_pose(f"right_{j}").position) for j in ("elbow", "wrist"))
    middle = 0.5 * (elbow + hand)
    press(world, middle + (0, 0, 0.12), shape=shape, force=10.0)
    suite.bind(world, human)
    suite.reset(np.random.default_rng(0))
    suite.sense()
    taxels, pressed = suite.sensors["taxels"], 0
    assert isinstance(taxels, TaxelMap)
    for _ in range(240):
        world.step()
        suite.after_substep()
        suite.sense()
        felt, true = suite.reading("taxels", "force"), world.contact_force(human.body)
        assert felt.sum() == pytest.approx(true, rel=0.01, abs=1e-6)
        pressed += true > 5
    assert pressed > 20
    force = suite.reading("contact_force", "force")
    assert force[2] == pytest.approx(-(10 + 0.5 * GRAVITY), abs=1.5)
    # The forearm is not quite level and the stamp is guided: friction pushes aside within its cone.
    pushes = [np.array(c.normal) * c.force for c in world.contacts(human.body)]
    cosine = force @ np.sum(pushes, axis=0)
    cosine /= np.linalg.norm(force) * np.linalg.norm(np.sum(pushes, axis=0))
    assert cosine > math.cos(math.atan(FRICTION * STAMP_FRICTION)) - 0.005
    places, _ = taxels.placed()
    centre = felt @ places / felt.sum()
    # A box touches with an edge.
    assert np.abs(centre[:2] - middle[:2]).max() < (0.05 if shape == "box" else 0.02)
    assert places[:, 2].max() - 0.03 < centre[2]
