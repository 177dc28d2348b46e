"""URDF files of users: what is read, where meshes are found, and what is put right."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pybullet as bullet
import pybullet_data
import pytest
from urdf_files import BODY, LIMIT, arm, hull_file, joint, link, urdf
from urdf_files import cache as cache
from urdf_files import own_cache as own_cache  # both for pytest, which uses what it finds here
from variants import KINDS_OF_ROBOTS, few

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import Model, joint_pose, write
from rcare_marl.model.urdf_reader import read
from rcare_marl.pose import Pose

ROBOTS = sorted(path.parent.name for path in (assets.ROOT / "robots").glob("*/model.yaml"))
DATA = Path(pybullet_data.getDataPath())
REAL = (
    "franka_panda/panda.urdf",
    "kuka_iiwa/model.urdf",
    "r2d2.urdf",
    "laikago/laikago.urdf",
    "xarm/xarm6_with_gripper.urdf",
    "a1/a1.urdf",
)
TRIANGLE = (
    "solid t\n"
    + 4
    * (
        "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    )
    + "endsolid t\n"
)


@pytest.fixture
def client() -> Iterator[int]:
    uid = bullet.connect(bullet.DIRECT)
    yield uid
    bullet.disconnect(uid)


def forward(model: Model, positions: dict[str, float]) -> dict[str, Pose]:
    poses = {model.root: Pose()}
    for name, item in model.joints.items():
        poses[item.child] = poses[item.parent] @ joint_pose(item, positions.get(name, 0.0))
    return poses


# What is read.


@pytest.mark.parametrize("name", few(ROBOTS, *KINDS_OF_ROBOTS))
def test_our_robots_come_back_as_they_were_written(name: str) -> None:
    model = load(Model, assets.ROOT / "robots" / name / "model.yaml")
    back = read(write(model))
    assert list(back.links) and set(back.links) == set(model.links)
    assert back.root == model.root and set(back.joints) == set(model.joints)
    for key, before in model.joints.items():
        after = back.joints[key]
        assert (after.kind, after.parent, after.child) == (before.kind, before.parent, before.child)
        assert joint_pose(after).matrix() == pytest.approx(joint_pose(before).matrix(), abs=1e-9)
        if before.kind == "fixed":
            continue
        unit = np.asarray(before.axis) / np.linalg.norm(before.axis)
        assert after.axis == pytest.approx(unit, abs=1e-6)  # lengths that are all but 1 stay
        assert after.follows == before.follows
        words = ["effort", "velocity", "damping", "friction"]
        words += [] if before.kind == "continuous" else ["lower", "upper"]
        for word in words:
            assert getattr(after, word) == pytest.approx(getattr(before, word), abs=1e-9), word
    for key, part in model.links.items():
        assert back.links[key].mass == pytest.approx(part.mass, abs=1e-9)
        assert back.links[key].com == pytest.approx(part.com if part.mass else (0, 0, 0), abs=1e-9)
        wanted = part.inertia if part.mass else (0.0,) * 6
        assert back.links[key].inertia == pytest.approx(wanted, abs=1e-9)
        assert len(back.links[key].collision) == len(part.collision)


@pytest.mark.parametrize("name", REAL)
def test_real_files_mean_the_same_to_us_and_to_bullet(name: str, client: int) -> None:
    file = DATA / name
    if not file.is_file():
        pytest.skip(f"this pybullet_data has no {name}")
    model = read(file)
    flags = bullet.URDF_USE_INERTIA_FROM_FILE
    original = bullet.loadURDF(str(file), flags=flags, physicsClientId=client)
    ours = bullet.loadURDF(str(write(model)), flags=flags, physicsClientId=client)
    given = _with_inertial(file)
    rng = np.random.default_rng(0)
    positions = {}
    for name_, item in model.joints.items():
        ends = (-3.0, 3.0) if item.kind == "continuous" else (item.lower, item.upper)
        positions[name_] = 0.0 if item.kind == "fixed" else float(rng.uniform(*ends))
    poses = forward(model, positions)
    for uid in (original, ours):
        base = bullet.getDynamicsInfo(uid, -1, physicsClientId=client)
        masses = {model.root: base[0]}
        infos = [
            bullet.getJointInfo(uid, i, physicsClientId=client)
            for i in range(bullet.getNumJoints(uid, physicsClientId=client))
        ]
        for info in infos:
            item = model.joints[info[1].decode()]
            bullet.resetJointState(
                uid, info[0], positions[info[1].decode()], physicsClientId=client
            )
            masses[item.child] = bullet.getDynamicsInfo(uid, info[0], physicsClientId=client)[0]
            if item.kind != "fixed":
                assert info[10:12] == pytest.approx((item.effort, item.velocity))
            if item.kind in ("revolute", "prismatic"):
                assert info[8:10] == pytest.approx((item.lower, item.upper))
        assert sum(masses[key] for key in given) == pytest.approx(model.mass, abs=1e-4)
        at, turn = bullet.getBasePositionAndOrientation(uid, physicsClientId=client)
        root = Pose(at, turn) @ Pose(base[3], base[4]).inverse()
        for info in infos:
            state = bullet.getLinkState(uid, info[0], 0, 1, physicsClientId=client)
            seen = root.inverse() @ Pose(state[4], state[5])
            assert seen.matrix() == pytest.approx(poses[info[12].decode()].matrix(), abs=1e-6)


def _with_inertial(file: Path) -> list[str]:
    """Return the names of the links that the file gives a mass."""
    links = ElementTree.parse(file).getroot().iter("link")
    return [e.attrib["name"] for e in links if e.find("inertial/mass") is not None]


def test_an_inertia_along_turned_axes_is_the_same_to_bullet(tmp_path: Path, client: int) -> None:
    turned = (
        '<inertial><origin xyz="0.1 0 0" rpy="0.3 -0.5 1.1"/><mass value="2"/>'
        '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial>'
    )
    file = urdf(tmp_path, link("a") + link("b", turned) + joint("j", "a", "b"))
    torques = []
    for path in (file, write(read(file))):
        uid = bullet.loadURDF(
            str(path),
            useFixedBase=1,
            flags=bullet.URDF_USE_INERTIA_FROM_FILE,
            physicsClientId=client,
        )
        torques.append(
            bullet.calculateInverseDynamics(uid, [0.4], [0.0], [3.0], physicsClientId=client)
        )
    assert torques[0] == pytest.approx(torques[1], rel=1e-5)
    # By hand: the moment about the joint's axis x is Ixx of the turned tensor; com lies on the axis.
    assert torques[0][0] == pytest.approx(3.0 * read(file).links["b"].inertia[0], rel=1e-5)


def test_shapes_colours_and_meshes_are_read_and_written(tmp_path: Path, client: int) -> None:
    hull_file(tmp_path)
    shapes = (
        '<visual><origin xyz="1 2 3" rpy="0 0 1"/><geometry><box size="0.1 0.2 0.3"/></geometry>'
        '<material name="red"/></visual>'
        '<visual><geometry><mesh filename="meshes/part.obj" scale="2 1 1"/></geometry></visual>'
        '<visual><geometry><sphere radius="0"/></geometry></visual>'
        '<collision><geometry><cylinder radius="0.05" length="0.4"/></geometry></collision>'
        '<collision><origin xyz="0 0 1"/><geometry><mesh filename="meshes/part.obj" scale="2 1 1"/>'
        "</geometry></collision>"
    )
    red = '<material name="red"><color rgba="1 0 0 1"/></material>\n'
    model = read(urdf(tmp_path, red + link("a", BODY + shapes)))
    part = model.links["a"]
    assert [shape.kind for shape in part.visual] == ["box"]
    assert model.materials[part.visual[0].material] == (1, 0, 0, 1)
    assert part.visual[0].at == (1, 2, 3) and part.visual[0].rpy == (0, 0, 1)
    assert part.meshes[0].scale == (2, 1, 1) and Path(part.meshes[0].file).is_absolute()
    assert [shape.kind for shape in part.collision] == ["cylinder"] and len(part.hulls) == 1
    uid = bullet.loadURDF(str(write(model)), physicsClientId=client)
    assert len(bullet.getVisualShapeData(uid, physicsClientId=client)) == 2
    low, high = bullet.getAABB(uid, physicsClientId=client)
    assert np.subtract(high, low) == pytest.approx((0.25, 0.25, 1.5), abs=0.03)


def test_frames_without_inertial_weigh_next_to_nothing(tmp_path: Path, client: int) -> None:
    tool = link("tool", "") + joint("t", "b", "tool", "", "fixed")
    model = read(urdf(tmp_path, arm() + tool))
    assert model.mass == 2.0 and model.links["tool"].mass == 0.0
    uid = bullet.loadURDF(str(write(model)), physicsClientId=client)
    count = bullet.getNumJoints(uid, physicsClientId=client)
    total = sum(bullet.getDynamicsInfo(uid, i, physicsClientId=client)[0] for i in range(-1, count))
    assert total == pytest.approx(2.0, abs=1e-4)


def test_common_untidiness_is_accepted(tmp_path: Path) -> None:
    file = tmp_path / "untidy.urdf"
    file.write_text(
        '\n\n<?xml version="1.0"?>\n<robot>'
        '<xacro:property name="left" value="over"/>'
        '<link name="a"><visual><geometry><box size="1 1 1"/></geometry>'
        '<material><color rgba="1 0 0"/></material></visual><sensor:ray any="thing"/></link>'
        '<link name="wheel"/>'
        '<joint name="spin" type="continuous"><parent link="a"/><child link="wheel"/></joint>'
        '<transmission name="t"><type>x</type></transmission><gazebo><plugin x="$(find y)"/></gazebo>'
        "</robot>"
    )
    model = read(file)
    assert model.name == "untidy" and list(model.materials.values()) == [(1, 0, 0, 1)]
    spin = model.joints["spin"]
    assert spin.kind == "continuous" and spin.axis == (1, 0, 0) and spin.effort == 0


def test_an_axis_of_any_length_means_a_direction(tmp_path: Path) -> None:
    model = read(urdf(tmp_path, arm('<axis xyz="0 3 4"/>' + LIMIT, "prismatic")))
    assert model.joints["j"].axis == pytest.approx((0, 0.6, 0.8))
    assert joint_pose(model.joints["j"], 0.5).position == pytest.approx((0, 0.3, 0.4))


def test_a_follower_of_a_follower_follows_the_first(tmp_path: Path) -> None:
    chain = link("a") + link("b") + link("c") + link("d") + joint("first", "a", "b")
    chain += joint("second", "b", "c", LIMIT + '<mimic joint="first" multiplier="2" offset="0.1"/>')
    chain += joint(
        "third", "c", "d", LIMIT + '<mimic joint="second" multiplier="-3" offset="0.5"/>'
    )
    rule = read(urdf(tmp_path, chain)).joints["third"].follows
    assert rule is not None and rule.joint == "first"
    assert rule.multiplier == pytest.approx(-6) and rule.offset == pytest.approx(0.2)


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    assert read(urdf(tmp_path, arm())).joints["j"].upper == 1.0
    assert read(urdf(tmp_path, arm(LIMIT.replace('upper="1"', 'upper="0.75"')))).joints[
        "j"
    ].upper == pytest.approx(0.75)


# Where meshes are found.


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("part.stl", "robots/part.stl"),
        ("meshes/part.stl", "meshes/part.stl"),
        ("package://mine/meshes/part.stl", "meshes/part.stl"),
        ("package://other/part.STL", "../other/part.STL"),
        ("package://renamed/meshes/part.stl", "meshes/part.stl"),
        ("model://mine/meshes/part.stl", "meshes/part.stl"),
        ("meshes\\part.stl", "meshes/part.stl"),
    ],
)
def test_meshes_are_found_where_people_put_them(tmp_path: Path, name: str, place: str) -> None:
    mesh = tmp_path / "mine" / place
    mesh.parent.mkdir(parents=True, exist_ok=True)
    mesh.write_text(TRIANGLE)
    shown = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    file = urdf(tmp_path, link("a", BODY + shown), "mine/robots/robot.urdf")
    assert Path(read(file).links["a"].meshes[0].file).samefile(mesh)


@pytest.mark.parametrize("how", ["given", "given parent", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"])
def test_packages_are_found_elsewhere(
    tmp_path: Path, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "far" / ("share" if how == "AMENT_PREFIX_PATH" else "") / "their_meshes"
    mesh = folder / "part.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_text(TRIANGLE)
    shown = (
        '<visual><geometry><mesh filename="package://their_meshes/part.stl"/></geometry></visual>'
    )
    file = urdf(tmp_path, link("a", BODY + shown), "here/robot.urdf")
    packages = {"given": (folder,), "given parent": (tmp_path / "far",)}.get(how, ())
    if how.isupper():
        monkeypatch.setenv(how, f"{tmp_path / 'empty'}:{tmp_path / 'far'}")
    assert Path(read(file, packages=packages).links["a"].meshes[0].file).samefile(mesh)


def test_a_file_url_is_a_path(tmp_path: Path) -> None:
    mesh = hull_file(tmp_path)
    shown = f'<visual><geometry><mesh filename="file://{mesh}"/></geometry></visual>'
    file = urdf(tmp_path, link("a", BODY + shown), "elsewhere/robot.urdf")
    assert read(file).links["a"].meshes[0].file == str(mesh)


# Inertias that no body has.


def test_an_impossible_inertia_becomes_that_of_the_shape_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    box = '<collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision>'
    bad = '<inertial><mass value="12"/><inertia ixx="0" iyy="0" izz="0"/></inertial>' + box
    thin = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="5"/></inertial>'
    body = link("a", bad) + link("b", thin) + joint("j", "a", "b")
    with caplog.at_level(logging.WARNING):
        model = read(urdf(tmp_path, body))
    assert model.links["a"].inertia == pytest.approx((0.13, 0, 0, 0.10, 0, 0.05))
    assert "'a'" in caplog.text and "'b'" in caplog.text and "no rigid body" in caplog.text
    xx, _, _, yy, _, zz = model.links["b"].inertia
    assert zz < xx + yy
    with pytest.raises(ConfigError, match=r"'a'.*not all positive.*'b'.*exceeds the sum"):
        read(urdf(tmp_path, body), repair=False)


def test_rounding_is_no_fault_and_bullet_keeps_the_inertia(
    tmp_path: Path, client: int, caplog: pytest.LogCaptureFixture
) -> None:
    # A thin rod: izz misses the triangle inequality by a hair, which makes Bullet drop all of it.
    rod = '<inertial><mass value="1"/><inertia ixx="0.0001" iyy="0.1" izz="0.10015"/></inertial>'
    file = urdf(tmp_path, link("a") + link("b", rod) + joint("j", "a", "b"))
    with caplog.at_level(logging.WARNING):
        model = read(file)
    assert not caplog.records
    assert model.links["b"].inertia == pytest.approx((0.0001, 0, 0, 0.1, 0, 0.10015), abs=1e-4)
    kept = []
    for path in (file, write(model)):
        uid = bullet.loadURDF(
            str(path), flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
        )
        kept.append(min(bullet.getDynamicsInfo(uid, 0, physicsClientId=client)[2]) > 0)
    assert kept == [False, True]
