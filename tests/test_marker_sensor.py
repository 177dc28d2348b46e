"""Robots look for markers with their own camera and say where they are, in any frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from variants import few

import rcare_marl
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.sensing.marker import Plate
from rcare_marl.agents.sensing.marker_sensor import MarkerSensor, MarkerSensorConfig
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose, quaternion_from_axis_angle, rotation_vector
from rcare_marl.rendering import Camera

MARKERS = [{"id": 7, "on": "right_shoulder"}, {"id": 8, "on": "right_elbow"}]


@pytest.fixture(scope="module")
def looking() -> Iterator[tuple[Any, Robot, MarkerSensor, dict[int, Plate]]]:
    """Return a feeding scene in which the robot looks at two markers on Natalia's right arm."""
    env = rcare_marl.make(
        "feeding",
        recipient={"model": "natalia", "markers": MARKERS},
        robot={"sensors": [{"kind": "markers", "camera": "wrist", "ids": [7, 8, 11]}]},
    )
    env.reset(seed=0)
    robot = env.cast["robot"]
    assert isinstance(robot, Robot) and robot.sensors is not None
    sensor = robot.sensors.sensors["markers"]
    assert isinstance(sensor, MarkerSensor)
    plates = {int(b.name[7:]): b for b in env.world.bodies if isinstance(b, Plate)}
    yield env, robot, sensor, plates
    env.close()


def aim(
    robot: Robot, sensor: MarkerSensor, at: np.ndarray, azimuth: float, distance: float
) -> None:
    """Let the robot look at a point from `azimuth` [deg] and 40 degrees above."""
    a, e = np.radians(azimuth), np.radians(40)
    eye = at + distance * np.array((np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)))
    wish = Camera(tuple(eye.tolist()), tuple(at.tolist())).pose
    camera_in_tool = robot.tool_pose().inverse() @ sensor.view.pose
    found = robot.solve_ik(wish @ camera_in_tool.inverse())
    assert found.is_within()
    robot.set_posture(found.posture)


@pytest.mark.needs_gl
def test_a_robot_finds_markers_on_shoulder_and_elbow_with_its_own_camera(
    looking: tuple[Any, Robot, MarkerSensor, dict[int, Plate]], record_property: Any
) -> None:
    env, robot, sensor, plates = looking
    env.reset(seed=0)
    suite = robot.sensors
    assert suite is not None
    assert set(plates) == {7, 8}
    names = [name for _, name, _ in env.describe("robot")]
    assert {"markers_7_position", "markers_8_rotation", "markers_11_seen"} <= set(names)
    aim(
        robot, sensor, np.mean([p.base_pose().position for p in plates.values()], axis=0), 300, 0.45
    )
    suite.sense()
    for number, plate in plates.items():
        true = robot.body.base_pose().inverse() @ plate.base_pose()
        position = suite.reading("markers", f"{number}_position")
        vector = suite.reading("markers", f"{number}_rotation").astype(np.float64)
        turn = quaternion_from_axis_angle(vector, float(np.linalg.norm(vector)))
        wrong = Pose(true.position, tuple(turn.tolist())).inverse() @ true
        distance = float(np.linalg.norm(position - np.array(true.position)))
        angle = float(np.degrees(np.linalg.norm(rotation_vector(wrong.quaternion))))
        record_property(f"marker {number}", f"{1e3 * distance:.2f} mm, {angle:.2f} degrees")
        assert suite.reading("markers", f"{number}_seen") == 1
        assert distance < 0.005
        assert angle < 2
    assert suite.reading("markers", "11_seen") == 0
    assert not suite.reading("markers", "11_position").any()


def test_an_unseen_marker_keeps_its_last_pose_until_the_episode_ends(
    looking: tuple[Any, Robot, MarkerSensor, dict[int, Plate]],
) -> None:
    env, robot, sensor, plates = looking
    env.reset(seed=0)
    suite = robot.sensors
    assert suite is not None
    home = robot.arm.positions()
    assert suite.reading("markers", "7_seen") == 0  # at the start it looks elsewhere
    assert not suite.reading("markers", "7_position").any()
    aim(
        robot, sensor, np.mean([p.base_pose().position for p in plates.values()], axis=0), 300, 0.45
    )
    suite.sense()
    seen = suite.reading("markers", "7_position").copy()
    assert suite.reading("markers", "7_seen") == 1
    robot.set_posture(home)
    suite.sense()
    assert suite.reading("markers", "7_seen") == 0
    assert (suite.reading("markers", "7_position") == seen).all()
    env.reset(seed=0)
    assert not suite.reading("markers", "7_position").any()


def test_equal_seeds_see_markers_equally(
    looking: tuple[Any, Robot, MarkerSensor, dict[int, Plate]],
) -> None:
    env, robot, sensor, plates = looking
    readings = []
    for _ in range(2):
        env.reset(seed=3)
        aim(
            robot,
            sensor,
            np.mean([p.base_pose().position for p in plates.values()], axis=0),
            300,
            0.45,
        )
        readings.append(np.concatenate(sensor.measure()))
    assert (readings[0] == readings[1]).all()
    assert readings[0].any()


@pytest.mark.parametrize("frame", few(("base", "camera", "world", "tool"), "base", "camera"))
def test_poses_are_given_in_the_frame_that_was_asked_for(
    looking: tuple[Any, Robot, MarkerSensor, dict[int, Plate]], frame: Any
) -> None:
    env, robot, sensor, plates = looking
    env.reset(seed=0)
    aim(
        robot, sensor, np.mean([p.base_pose().position for p in plates.values()], axis=0), 300, 0.45
    )
    other = MarkerSensor(
        MarkerSensorConfig("other", ids=(7,), frame=frame, camera="wrist", exposures=1)
    )
    other.bind(env.world, robot)
    position, _, seen = other.measure()
    origin = {
        "base": robot.body.base_pose(),
        "camera": sensor.view.pose,
        "world": Pose(),
        "tool": robot.tool_pose(),
    }[frame]
    other.close()
    assert seen == 1
    assert position == pytest.approx((origin.inverse() @ plates[7].base_pose()).position, abs=0.005)


def test_noise_is_on_what_is_seen_alone(
    looking: tuple[Any, Robot, MarkerSensor, dict[int, Plate]],
) -> None:
    env, robot, sensor, plates = looking
    env.reset(seed=0)
    aim(
        robot, sensor, np.mean([p.base_pose().position for p in plates.values()], axis=0), 300, 0.45
    )
    noisy = MarkerSensor(
        MarkerSensorConfig("noisy", ids=(7, 11), camera="wrist", exposures=1, noise=0.01)
    )
    noisy.bind(env.world, robot)
    true = [reading.copy() for reading in noisy.measure()]
    got = noisy.disturb(true, np.random.default_rng(0))
    noisy.close()
    assert 0 < np.abs(got[0] - true[0]).max() < 0.05
    assert not np.concatenate(got[3:]).any()


@pytest.mark.parametrize(
    ("options", "message"),
    (
        ({"ids": []}, "ids"),
        ({"ids": [1, 1]}, "once"),
        ({"ids": [1], "sizes": {2: 0.05}}, "marker 2"),
        ({"size": -1.0}, "positive"),
        ({"frame": "wrist"}, "frame"),
        ({"exposures": 0}, "exposures"),
        ({"latency": 0.1}, "rate"),
        ({"width": 0}, "width"),
        ({"dictionary": "5x5"}, "5x5_50"),
        ({"ids": [7, 50]}, "0 to 49"),
        ({"ids": [-1]}, "0 to 49"),
    ),
)
def test_impossible_options_of_the_sensor_are_refused(
    options: dict[str, Any], message: str
) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        load(MarkerSensorConfig, {"name": "markers", **options})
