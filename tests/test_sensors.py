"""Sensors: the clock they are read by, what a suite promises, inertial units and rays."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sensor_scene import POSTURES, Array, Scene, arm_link, own_robot, person, urdf

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.robot import Robot, load_robot, urdf_robot
from rcare_marl.agents.sensing.proximity import ProximityConfig
from rcare_marl.agents.sensing.sampler import Sampler
from rcare_marl.agents.sensing.sensor import Channel, Sensor, SensorConfig
from rcare_marl.agents.sensing.suite import Entry, SensorSuite
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, UnknownNameError, WorldError
from rcare_marl.pose import Pose, conjugate, quaternion_from_axis_angle, rotate
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
        {"kind": "proximity", "link": "base_link", "at": [0, 0, 0.3], "rpy_deg": [180, -90, 0],
         "pattern": "fan", "rays": 5, "angle_deg": 180, "reach": 4.0}
    )  # fmt: skip
    scene.world.add_box((0.1, 8, 1), Pose((1.55, 0, 0.5)))  # 1.5 m in front
    scene.world.add_box((8, 0.1, 1), Pose((0, 2.05, 0.5)))  # 2 m to the left
    scene.begin((0.0,) * 7)
    diagonal = 1.5 * math.sqrt(2)
    wanted = (4.0, diagonal, 1.5, diagonal, 2.0)
    assert scene.read("proximity", "distance") == pytest.approx(wanted, abs=1e-3)


@pytest.mark.parametrize("name", assets.names("robots"))
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
