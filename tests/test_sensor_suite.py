"""The clock that sensors are read by, and what a suite of them promises."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from sensor_scene import POSTURES, Array, Scene

from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.agents.sensing.sensor import Channel, Sensor, SensorConfig
from rcare_marl.agents.sensing.suite import Entry, Sampler, SensorSuite
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, UnknownNameError, WorldError
from rcare_marl.pose import Pose
from rcare_marl.world import GRAVITY, World

# The clock.


class Clock(Sensor):
    """Measures the time."""

    def __init__(self, config: SensorConfig, *, channel: Channel | None = None) -> None:
        super().__init__(config)
        self.channel = channel or Channel("time", "s", (1,))
        self.value: Callable[[], float] = lambda: self.world.time

    def bind(self, world: World, agent: Any) -> None:
        self.world = world

    def channels(self) -> Sequence[Channel]:
        return (self.channel,)

    def measure(self) -> Sequence[Array]:
        return (np.full(self.channel.shape, self.value()),)


def clock(**options: Any) -> tuple[World, Sampler]:
    world, sensor = World(), Clock(SensorConfig("clock", **options))
    sensor.bind(world, None)
    sampler = Sampler(sensor, world)
    sampler.reset(None)
    sampler.sense()
    return world, sampler


def seen(world: World, sampler: Sampler, steps: int) -> list[float]:
    """Return what is seen after each physics step, where every fifth is the end of a control step."""
    out = []
    for k in range(steps):
        world.step()
        sampler.after_substep()
        if k % 5 == 4:
            sampler.sense()
        out.append(float(sampler.readings[0][0]))
    return out


def test_without_options_a_sample_is_what_is_true_when_the_agent_observes() -> None:
    world, sampler = clock()
    assert not sampler.is_clocked
    times = seen(world, sampler, 20)
    assert times[4::5] == pytest.approx([k * 5 / 240 for k in range(1, 5)])
    assert times[8] == times[4]


def test_a_rate_holds_samples_until_the_next_is_due() -> None:
    world, sampler = clock(rate=50.0)
    times = seen(world, sampler, 240)
    for k, time in enumerate(times):
        now = (k + 1) / 240
        due = math.floor(now * 50 + 1e-9) / 50
        assert (
            due - 1e-6 <= time < due + 1 / 240 - 1e-9
        )  # the first physics step at which it is due
    assert len(set(times)) == 51


def test_latency_shows_samples_when_they_are_that_old() -> None:
    world, sampler = clock(latency=0.05)
    times = seen(world, sampler, 60)
    assert times[:11] == [0.0] * 11
    assert times[12:] == pytest.approx([(k + 1) / 240 - 0.05 for k in range(12, 60)])
    world, sampler = clock(rate=20.0, latency=0.07)
    for k, time in enumerate(seen(world, sampler, 240)):
        newest = max(0.0, math.floor(((k + 1) / 240 - 0.07) * 20 + 1e-6) / 20)
        assert time == pytest.approx(newest, abs=1e-6)


def test_impossible_clocks_are_refused() -> None:
    with pytest.raises(ConfigError, match="above that of the physics, 240 Hz"):
        clock(rate=300.0)
    picture = Clock(SensorConfig("eye", latency=0.1), channel=Channel("rgb", "1", (2, 2, 3), True))
    with pytest.raises(ConfigError, match="need a rate"):
        Sampler(picture, World())
    for option in ("rate", "latency", "noise"):
        with pytest.raises(ConfigError, match=f"{option} must be 0 or more"):
            clock(**{option: -1.0})


def test_whole_numbers_are_rounded_and_clipped_and_labels_have_no_noise() -> None:
    world = World()
    channel = Channel("count", "1", (2000,), dtype="uint8")
    sensor = Clock(SensorConfig("clock", noise=3.0), channel=channel)
    sensor.bind(world, None)
    sampler = Sampler(sensor, world)
    for value, lowest, highest in ((1.6, 0, 9), (254.4, 240, 255)):
        sensor.value = lambda value=value: value  # type: ignore[misc]
        sampler.reset(np.random.default_rng(0))
        sampler.sense()
        got = sampler.readings[0]
        assert got.dtype == np.uint8
        assert lowest <= got.min() and got.max() <= highest + 6 * (highest < 255)
        sampler.reset(None)
        sampler.sense()
        assert set(sampler.readings[0].tolist()) == {round(value)}
    label = Clock(
        SensorConfig("clock", noise=3.0), channel=Channel("label", "1", (9,), is_noisy=False)
    )
    label.bind(world, None)
    sampler = Sampler(label, world)
    sampler.reset(np.random.default_rng(0))
    sampler.sense()
    assert not sampler.readings[0].any()


# The suite.


def test_wrong_entries_say_what_there_is() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'wrist_wrench'"):
        SensorSuite(["wrist_wrenh"], "robot")
    with pytest.raises(UnknownNameError, match="Did you mean 'spacing'"):
        SensorSuite([{"kind": "taxels", "spacin": 0.01}], "robot")
    with pytest.raises(ConfigError, match="missing kind"):
        SensorSuite([{"name": "imu"}], "robot")
    with pytest.raises(ConfigError, match="two sensors are called 'imu'"):
        SensorSuite(["imu", "imu"], "robot")
    with pytest.raises(ConfigError, match="must be a list"):
        SensorSuite("imu", "robot")
    with pytest.raises(ConfigError, match="spacing must be above 0"):
        SensorSuite([{"kind": "taxels", "spacing": 0}], "robot")
    with pytest.raises(ConfigError, match="tare_inertia without tare"):
        SensorSuite([{"kind": "wrist_wrench", "tare_inertia": True}], "robot")


@pytest.mark.parametrize(
    "entry",
    [
        {"kind": "imu", "link": "no_link"},
        {"kind": "proximity", "link": "no_link"},
        {"kind": "contact_force", "links": ["no_link"]},
        {"kind": "taxels", "links": ["no_link"]},
        {"kind": "joint_wrench", "joints": ["no_joint"]},
        {"kind": "wrist_wrench", "arm": "no_arm"},
    ],
)
def test_names_that_an_agent_lacks_are_refused(entry: dict[str, Any]) -> None:
    with pytest.raises(UnknownNameError, match="no_"):
        Scene(entry).begin()


@pytest.mark.parametrize(
    "entry",
    [
        {"kind": "imu", "name": "mine", "link": "no_link"},
        {"kind": "contact_force", "name": "mine", "links": ["no_link"]},
        {"kind": "joint_wrench", "name": "mine", "joints": ["no_joint"]},
        {"kind": "wrist_wrench", "name": "mine", "arm": "no_arm"},
        {"kind": "camera", "name": "mine", "camera": "no_camera"},
        {"kind": "taxels", "name": "mine", "spacing": 1e-5},
        {"kind": "imu", "name": "mine", "rate": 500.0},
    ],
)
def test_messages_name_the_agent_and_the_sensor(entry: dict[str, Any]) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match="robot, sensor 'mine'"):
        Scene(entry).begin()


def test_a_sensor_needs_a_name_and_noise_that_a_number_can_hold() -> None:
    with pytest.raises(ConfigError, match="needs a name"):
        SensorSuite([{"kind": "imu", "name": ""}], "robot")
    with pytest.raises(ConfigError, match=r"noise must be 1e\+06 or less, got 1e\+300"):
        SensorSuite([{"kind": "imu", "noise": 1e300}], "robot")


@pytest.mark.parametrize(
    ("kind", "option", "name"),
    [
        ("contact_force", "links", "tray"),
        ("taxels", "links", "tray"),
        ("joint_wrench", "joints", "joint_1"),
        ("joint_torque", "joints", "joint_1"),
    ],
)
def test_nothing_is_named_twice(kind: str, option: str, name: str) -> None:
    with pytest.raises(ConfigError, match=f"{option} names {name} twice"):
        SensorSuite([{"kind": kind, option: [name, "other", name]}], "robot")


def test_sensors_of_an_arm_that_does_not_move_work_or_say_so() -> None:
    robot = Robot("robot", load_robot("pr2"), moves=["left_arm"])
    scene = Scene("imu", "proximity", {"kind": "taxels", "spacing": 0.03}, robot=robot)
    scene.suite.bind(scene.world, robot)
    scene.suite.reset(np.random.default_rng(0))
    scene.suite.sense()
    assert np.linalg.norm(scene.read("imu", "acceleration")) == pytest.approx(GRAVITY, rel=1e-5)
    robot = Robot("robot", load_robot("pr2"), moves=["left_arm"])
    scene = Scene("joint_torque", robot=robot)
    with pytest.raises(ConfigError, match="'right_arm' does not move"):
        scene.suite.bind(scene.world, robot)


def test_readings_are_named_and_only_there_once_sensed() -> None:
    scene = Scene({"kind": "imu", "name": "hand"}, "joint_torque")
    with pytest.raises(WorldError, match="not bound"):
        scene.read("hand", "acceleration")
    scene.suite.bind(scene.world, scene.robot)
    with pytest.raises(WorldError, match="nothing yet"):
        scene.read("hand", "acceleration")
    scene.suite.reset(np.random.default_rng(0))
    scene.suite.sense()
    table = [(o.name, o.unit, o.size) for o in scene.suite.observables()]
    assert table == [
        ("hand_acceleration", "m/s²", 3),
        ("hand_angular_velocity", "rad/s", 3),
        ("joint_torque_effort", "N·m", 7),
    ]
    for observable in scene.suite.observables():
        assert np.shape(observable.read()) == (observable.size,)
    with pytest.raises(UnknownNameError, match="Did you mean 'acceleration'"):
        scene.read("hand", "aceleration")
    with pytest.raises(UnknownNameError, match="sensor of robot"):
        scene.read("foot", "acceleration")


def test_noise_is_seeded_and_a_sensor_more_does_not_change_it() -> None:
    noisy = {"kind": "joint_torque", "noise": 0.5}

    def readings(*sensors: Entry, seed: int) -> Array:
        scene, out = Scene(*sensors), []
        scene.begin(seed=seed)
        for _ in range(40):
            scene.suite.sense()
            out.append(scene.read("joint_torque", "effort"))
        return np.array(out)

    truth = readings("joint_torque", seed=0)[0]
    first = readings(noisy, seed=3)
    assert (first == readings(noisy, seed=3)).all()
    assert (first == readings({"kind": "imu", "noise": 1.0}, noisy, seed=3)).all()
    assert (first != readings(noisy, seed=4)).all()
    assert (first - truth).std() == pytest.approx(0.5, rel=0.1)


def test_only_noise_draws_from_the_generator() -> None:
    for entry, draws in (("imu", False), ({"kind": "imu", "noise": 0.1}, True)):
        scene, rng = Scene(entry), np.random.default_rng(5)
        scene.suite.bind(scene.world, scene.robot)
        scene.suite.reset(rng)
        assert (rng.integers(2**32) != np.random.default_rng(5).integers(2**32)) == draws


ALL: tuple[Entry, ...] = (
    "joint_wrench",
    "joint_torque",
    {"kind": "wrist_wrench", "tare": True, "tare_inertia": True},
    {"kind": "contact_force", "per_link": True},
    {"kind": "contact_force", "name": "bumps", "output": "magnitude", "statistic": "peak"},
    {"kind": "taxels", "links": ["bracelet_link", "forearm_link"], "spacing": 0.03},
    {"kind": "imu", "rate": 100.0, "noise": 0.1},
    {"kind": "proximity", "rays": 5, "latency": 0.03, "rate": 60.0},
)


def episode(scene: Scene, ball: Body, seed: int) -> tuple[Array, Array]:
    """Return the path of the arm and what was sensed on it, a row a control step."""
    scene.world.rewind()
    scene.robot.reset(np.random.default_rng(seed))
    scene.suite.reset(np.random.default_rng(seed))
    hand = scene.link("bracelet_link").position
    ball.set_base(Pose((hand[0], hand[1] + 0.02, hand[2] + 0.2)))
    scene.suite.sense()
    path, sensed = [], []
    for k in range(6):
        scene.run(1, 0.3 * np.sin(np.arange(7) + k))
        path.append(scene.robot.arm.positions().copy())
        sensed.append(np.concatenate([[0.0], *(o.read() for o in scene.suite.observables())]))
    return np.array(path), np.array(sensed)


def test_sensors_change_nothing_and_rewinding_repeats_them() -> None:
    scene, blind = Scene(*ALL), Scene(*ALL)  # with the same links
    blind.suite = SensorSuite([], "robot")
    balls = [s.world.add_sphere(0.03, Pose((2, 0, 1)), mass=0.4) for s in (scene, blind)]
    for each in (scene, blind):
        each.suite.bind(each.world, each.robot)
        each.world.mark_start()
    path, felt = episode(scene, balls[0], 1)
    assert (path == episode(blind, balls[1], 1)[0]).all()
    assert not (felt == episode(scene, balls[0], 2)[1]).all()
    again, felt_again = episode(scene, balls[0], 1)
    assert (path == again).all() and (felt == felt_again).all()
    assert np.isfinite(felt).all() and (felt.std(axis=0) > 0).sum() > 30


def test_what_a_new_episode_reads_first_is_no_memory_of_the_last() -> None:
    scene = Scene("joint_wrench", "wrist_wrench", {"kind": "contact_force"}, "imu")
    box = scene.world.add_box((0.3, 0.3, 0.02), Pose((3, 0, 0)), mass=2.0)
    scene.begin()
    scene.world.mark_start()
    first = [scene.read("joint_wrench", "torque"), scene.read("wrist_wrench", "force")]
    tool = scene.robot.tool_pose().position
    box.set_base(Pose((tool[0], tool[1], tool[2] + 0.08)))
    scene.run(3)
    assert np.linalg.norm(scene.read("contact_force", "force")) > 1
    scene.world.rewind()
    scene.robot.reset(np.random.default_rng(0))
    scene.robot.set_posture(POSTURES[0])
    scene.suite.reset(np.random.default_rng(0))
    scene.suite.sense()
    assert scene.read("joint_wrench", "torque") == pytest.approx(first[0], abs=1e-5)
    assert scene.read("wrist_wrench", "force") == pytest.approx(first[1], abs=1e-5)
    assert not scene.read("contact_force", "force").any()
    assert np.linalg.norm(scene.read("imu", "acceleration")) == pytest.approx(GRAVITY, rel=1e-6)
