"""Cameras on robots and people look from where they are carried, at what is there."""

from __future__ import annotations

import numpy as np
import pytest
from camera_scene import Room, robot_with

from rcare_marl import rendering
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.agents.sensing.camera import CameraSensor
from rcare_marl.agents.sensing.suite import SensorSuite
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.rendering import OUTPUTS
from rcare_marl.world import World


def test_a_robot_looks_through_its_own_camera() -> None:
    world, robot, suite = robot_with({"kind": "camera", "outputs": ["points", "segmentation"]})
    sensor = suite.sensors["camera"]
    assert isinstance(sensor, CameraSensor)
    mount = robot.config.cameras["wrist"]
    assert sensor.view.fov_deg == mount.fov_deg
    link = robot.body.link_pose(robot.body.link_index(mount.link))
    assert np.allclose(sensor.view.pose.matrix(), (link @ mount.pose).matrix(), atol=1e-6)
    target = sensor.view.pose @ Pose((0.02, 0.01, 0.6))
    ball = world.add_sphere(0.05, target, name="ball")
    suite.sense()
    labels = sensor.labels
    balls = [number for number, (body, _) in labels.items() if body == "ball"]
    seen = np.isin(suite.reading("camera", "segmentation").ravel(), balls)
    points = suite.reading("camera", "points")[seen]
    off = np.linalg.norm(points - ball.base_pose().position, axis=1)  # the base is at the origin
    assert len(points) > 20 and np.allclose(off, 0.05, atol=0.001)
    suite.close()
    world.close()


def test_a_camera_that_is_not_there_is_named() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'wrist'"):
        robot_with({"kind": "camera", "camera": "wrst"})
    with pytest.raises(UnknownNameError, match="link"):
        robot_with({"kind": "camera", "link": "nowhere"})
    room = Room()
    with pytest.raises(ConfigError, match="no camera of its own"):
        room.add({"link": "", "rpy_deg": (0.0, 0.0, 0.0)})
    room.close()


def test_points_follow_a_base_that_drives() -> None:
    world, robot = World(), Robot("robot", load_robot("stretch_re1"), moves=("base",))
    suite = SensorSuite([{"kind": "camera", "outputs": ["points", "segmentation"]}], "robot")
    robot.equip(suite)
    robot.spawn(world, Pose((1.0, 2.0, 0.0)))
    suite.bind(world, robot)
    robot.body.set_joints(robot.body.indices(("base_x", "base_turn")), (0.5, 0.7))
    sensor = suite.sensors["camera"]
    assert isinstance(sensor, CameraSensor)
    ball = world.add_sphere(0.05, sensor.view.pose @ Pose((0, 0, 0.8)), name="ball")
    suite.reset(np.random.default_rng(0))
    suite.sense()
    balls = [number for number, (body, _) in sensor.labels.items() if body == "ball"]
    seen = np.isin(suite.reading("camera", "segmentation").ravel(), balls)
    base = Pose((1.5, 2.0, 0.0), tuple(quaternion_from_rpy(0, 0, 0.7).tolist()))
    middle = (base.inverse() @ ball.base_pose()).position
    off = np.linalg.norm(suite.reading("camera", "points")[seen] - middle, axis=1)
    assert seen.any() and np.allclose(off, 0.05, atol=0.001)
    suite.close()
    world.close()


@pytest.mark.slow
@pytest.mark.parametrize("backend", [pytest.param("gl", marks=pytest.mark.needs_gl), "software"])
def test_pictures_of_people_do_not_depend_on_what_was_seen_before(
    backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(rendering.VARIABLE, backend)
    pictures = []
    for earlier in (0.0, 1.0):
        world = World()
        posture = load_posture("standing")
        person = Human("person", load_avatar("jose"), posture=posture, movable=["left_shoulder"])
        person.spawn(world, Pose())
        room = {"kind": "camera", "eye": [3.2, 0.5, 1.2], "target": [0, 0, 0.9], "outputs": OUTPUTS}
        suite = SensorSuite([room], "person")
        suite.bind(world, person)
        suite.reset(np.random.default_rng(0))
        for flexion in (earlier, 0.5):
            person.set_angles({"left_shoulder_flexion": flexion})
            suite.sense()
        pictures.append([suite.reading("camera", output).copy() for output in OUTPUTS])
        suite.close()
        world.close()
    assert all(np.array_equal(a, b) for a, b in zip(*pictures, strict=True))


def test_people_have_eyes_and_are_seen_limb_by_limb() -> None:
    world = World()
    person = Human("person", load_avatar("jose"), posture=load_posture("standing"))
    suite = SensorSuite(
        [
            # Segments have x left, y up, z forward: half a turn about z makes it a camera's frame.
            {
                "kind": "camera",
                "name": "eyes",
                "link": "head",
                "at": [0, 0.08, 0.12],
                "rpy_deg": [0, 0, 180],
                "outputs": ["depth", "segmentation"],
            },
            {
                "kind": "camera",
                "name": "room",
                "eye": [3.2, 0, 1.2],
                "target": [0, 0, 0.9],
                "outputs": ["segmentation"],
                "width": 96,
                "height": 128,
            },
        ],
        "person",
    )
    person.equip(suite)
    person.spawn(world, Pose())
    world.add_box((0.02, 1.0, 1.0), Pose((1.5, 0, 1.6)), name="screen")
    suite.bind(world, person)
    suite.reset(np.random.default_rng(0))
    suite.sense()
    sensor = suite.sensors["room"]
    assert isinstance(sensor, CameraSensor)
    labels = sensor.labels
    face = suite.reading("eyes", "segmentation")
    assert labels[face[24, 32]][0] == "screen"
    assert 1.2 < suite.reading("eyes", "depth")[24, 32] < 1.6
    seen = suite.reading("room", "segmentation")
    view = sensor.view
    for joint, at in (
        ("head", (0, 0.1, 0)),
        ("left_knee", (0, -0.2, 0)),
        ("right_elbow", (-0.1, 0, 0)),
    ):
        u, v, _ = np.rint(view.project((person.joint_pose(joint) @ Pose(at)).position)).astype(int)
        if labels[seen[v, u]][0] == "person":
            assert labels[seen[v, u]][1] == joint
    assert ("person", "left_knee") in {labels[i] for i in np.unique(seen) if i >= 0}
    suite.close()
    world.close()
