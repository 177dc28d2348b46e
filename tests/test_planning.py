"""Paths round people and things: clear, within limits, level where asked, and new when somebody moves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.planning import same_but_for_turns
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.baselines.benchmark.planning import _stands_clear
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, PlanningError, UnknownNameError
from rcare_marl.pose import Array, Pose
from rcare_marl.world import World

for extra in ("ompl", "pinocchio", "toppra"):
    pytest.importorskip(extra, reason="the extra `plan` is not installed")


class Scene:
    """A Gen3 on the floor, a wall that can be moved, and a cup in its hand."""

    def __init__(self, control: str = "joint_position") -> None:
        self.world = World()
        self.robot = Robot("robot", load_robot("kinova_gen3"), control=control)
        self.robot.spawn(self.world, self.robot.mount("floor"))
        self.wall = self.world.add_box((0.3, 0.04, 0.8), Pose((9.0, 0.0, 0.4)), name="wall")
        self.cup = self.world.add_box(
            (0.04, 0.04, 0.06), Pose((9.0, 9.0, 9.0)), mass=0.2, name="cup"
        )
        self.robot.grasp(self.cup, Pose((0.0, 0.0, 0.03)))
        self.start = self.robot.arm.positions()
        self.goal = self.start.copy()
        self.goal[0] += 1.6

    def put_wall(self, share: float = 0.5) -> None:
        """Put the wall where the tool is after a share of the straight way, across it."""
        tip = self.robot.arm.chain.tip_frame(self.start + share * (self.goal - self.start))
        x, y = tip[:2, 3].tolist()
        turn = math.atan2(y, x)
        self.wall.set_base(Pose((x, y, 0.4), (0.0, 0.0, math.sin(turn / 2), math.cos(turn / 2))))

    def gaps(self, positions: Array, other: Body) -> list[float]:
        """Return how far robot and cup are from a body along a path, as Bullet finds it [m]."""
        out = []
        for posture in positions:
            self.robot.set_posture(posture)
            self.cup.set_base(self.robot.tool_pose() @ Pose((0.0, 0.0, 0.03)))
            own = (self.robot.body, self.cup)
            out.append(min(self.world.separation(body, other, within=0.1) for body in own))
        self.robot.set_posture(self.start)
        return out


@pytest.fixture
def scene() -> Iterator[Scene]:
    made = Scene()
    yield made
    made.world.close()


def test_a_free_way_is_straight_and_within_limits(scene: Scene) -> None:
    path = scene.robot.plan(scene.goal)
    arm = scene.robot.arm
    assert path.is_straight and path.planning_s < 2.0
    np.testing.assert_allclose(path.at(0.0), scene.start, atol=1e-9)
    np.testing.assert_allclose(path.at(path.duration), scene.goal, atol=1e-6)
    speeds = np.diff(path.positions, axis=0) / np.diff(path.times)[:, None]
    assert (np.abs(speeds) <= 1.001 * arm.velocity).all()
    changes = np.diff(speeds, axis=0) / np.diff(path.times)[1:, None]
    assert (np.abs(changes) <= 1.001 * arm.velocity / 0.2).all()
    slow = scene.robot.plan(scene.goal, speed=0.25)
    assert slow.duration > 2.0 * path.duration


def test_what_is_in_the_straight_way_is_gone_round_at_a_distance(scene: Scene) -> None:
    scene.put_wall()
    ways = np.linspace(scene.start, scene.goal, 60)
    assert min(scene.gaps(ways, scene.wall)) < 0
    path = scene.robot.plan(scene.goal, avoid={scene.wall: 0.03}, within_s=5.0)
    assert not path.is_straight
    assert min(scene.gaps(path.positions, scene.wall)) > 0.028
    through = scene.robot.plan(scene.goal, avoid={scene.wall: None})
    assert through.is_straight


def test_the_same_seed_gives_the_same_path(scene: Scene) -> None:
    scene.put_wall()
    first, second = (scene.robot.plan(scene.goal, seed=4, within_s=20.0) for _ in range(2))
    np.testing.assert_array_equal(first.positions, second.positions)


def test_planning_moves_nothing(scene: Scene) -> None:
    scene.put_wall()
    before = [body.state() for body in scene.world.bodies]
    moved = scene.world.teleports
    scene.robot.plan(scene.goal, within_s=5.0)
    assert scene.world.teleports == moved
    for body, state in zip(scene.world.bodies, before, strict=True):
        np.testing.assert_array_equal(body.state(), state)


def test_the_tool_comes_to_the_pose_that_was_asked_for(scene: Scene) -> None:
    scene.robot.set_posture(scene.goal)
    wish = scene.robot.tool_pose()
    scene.robot.set_posture(scene.start)
    path = scene.robot.plan([Pose((5.0, 0.0, 0.5)), wish])  # the first is out of reach
    found = scene.robot.arm.chain.tip_pose(path.positions[-1])
    assert math.dist(found.position, wish.position) < 0.003


def test_a_cup_stays_level(scene: Scene) -> None:
    scene.put_wall()
    tilt = math.radians(12)
    path = scene.robot.plan(scene.goal, tilt=tilt, within_s=20.0)
    chain = scene.robot.arm.chain
    up = chain.tip_frame(scene.start)[:, :3].T @ (0.0, 0.0, 1.0)
    leans = [(chain.tip_frame(row)[:, :3] @ up)[2] for row in path.positions]
    assert min(leans) >= math.cos(tilt) - 1e-9
    assert min(scene.gaps(path.positions, scene.wall)) > 0


def test_a_path_is_renewed_when_something_comes_into_it(scene: Scene) -> None:
    path = scene.robot.plan(scene.goal)
    assert path.is_clear() and path.renewed() is path
    scene.put_wall()
    assert not path.is_clear()
    assert path.is_clear(after=path.duration)  # what is past does not count
    new = path.renewed()
    assert min(scene.gaps(new.positions, scene.wall)) > 0


@pytest.mark.parametrize("control", ["joint_position", "joint_delta", "joint_velocity"])
def test_actions_lead_along_a_path(control: str) -> None:
    scene = Scene(control)
    robot = scene.robot
    path = robot.plan(scene.goal, speed=0.4)
    for action in robot.follow(path, 0.1):
        robot.command(action, 0.1)
        for _ in range(24):
            robot.actuate()
            scene.world.step()
    assert np.abs(robot.arm.positions() - scene.goal).max() < 0.05
    scene.world.close()


def test_errors_say_what_is_in_the_way(scene: Scene) -> None:
    scene.put_wall(1.0)
    with pytest.raises(PlanningError, match="wall"):
        scene.robot.plan(scene.goal)
    with pytest.raises(PlanningError, match="cannot reach"):
        scene.robot.plan(Pose((5.0, 0.0, 0.5)))
    with pytest.raises(ConfigError, match="7 numbers"):
        scene.robot.plan([0.0, 1.0])
    with pytest.raises(UnknownNameError, match="rrt_connect"):
        scene.robot.plan(scene.goal, planner="rrt_conect")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="tilt"):
        scene.robot.plan(scene.goal, tilt=2.0)


def test_a_person_plans_within_the_active_range_and_is_led_within_the_passive_one() -> None:
    world = World()
    person = Human(
        "person",
        load_avatar("jose"),
        posture=load_posture("wheelchair_arm_forward"),
        movable=["head", "right_elbow"],
    )
    person.spawn(world, Pose((0.0, 0.0, 0.5)))
    path = person.plan({"head_rotation_left": 0.3})
    assert path.joints == ("head_rotation_left",)
    assert path.positions[-1, 0] == pytest.approx(0.3)
    bent = {"right_elbow_flexion": person.angle("right_elbow_flexion") + 0.3}
    with pytest.raises(PlanningError, match="limits"):
        person.plan(bent)  # paralysed
    led = person.plan(bent, kind="passive")
    assert led.positions[-1, 0] == pytest.approx(bent["right_elbow_flexion"])
    world.close()


def test_what_is_too_heavy_for_the_motors_is_no_goal(scene: Scene) -> None:
    robot, arm = scene.robot, scene.robot.arm
    stretched = np.array([0.0, math.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0])
    weight = float(np.abs(arm.chain.gravity_torques(stretched))[1])
    lever = math.dist(arm.chain.tip_frame(stretched)[:, 3], (0.0, 0.0, 0.3))
    arm.effort[1] = weight + 0.5 * 0.2 * 9.81 * lever  # half of the cup is too much
    with pytest.raises(PlanningError, match="too heavy"):
        robot.plan(stretched)
    arm.effort[1] = weight + 2.0 * 0.2 * 9.81 * lever
    robot.plan(stretched)


def test_a_weak_motor_takes_longer(scene: Scene) -> None:
    robot, arm = scene.robot, scene.robot.arm
    usual = robot.plan(scene.goal)
    arm.effort[0] = 3.0
    path = robot.plan(scene.goal)
    assert path.duration > 1.2 * usual.duration
    dt = np.diff(path.times)[:, None]
    speeds = np.diff(path.positions, axis=0) / dt
    torques = [
        arm.inertial_torques(row, change)
        for row, change in zip(path.positions[1:-1], np.diff(speeds, axis=0) / dt[1:], strict=True)
    ]
    assert np.abs(torques)[:, 0].max() < 1.05 * 3.0


def test_of_several_goals_and_full_turns_the_nearest_that_works_is_taken(scene: Scene) -> None:
    near, far = scene.start.copy(), scene.start.copy()
    near[0] += 0.4
    far[0] -= 1.5
    path = scene.robot.plan([far, near])
    np.testing.assert_allclose(path.positions[-1], near, atol=1e-6)
    scene.wall.set_base(Pose((*scene.robot.arm.chain.tip_frame(near)[:2, 3].tolist(), 0.4)))
    path = scene.robot.plan([far, near], within_s=10.0)
    np.testing.assert_allclose(path.positions[-1], far, atol=1e-6)
    scene.wall.set_base(Pose((9.0, 0.0, 0.4)))
    turned = same_but_for_turns(near + 2 * np.pi, near - 3.5, near + 9.5)
    assert len(turned) == 2 ** len(near)  # as it is, and a turn on, of each joint
    path = scene.robot.plan(np.array(turned))
    np.testing.assert_allclose(path.positions[-1], near, atol=1e-6)


@pytest.mark.parametrize("is_inside", [False, True])
def test_a_benchmark_takes_no_robot_that_starts_inside_furniture(is_inside: bool) -> None:
    world = World()
    robot = Robot("robot", load_robot("ur5"))
    robot.spawn(world, robot.mount("floor"))
    far = Pose((0.0, 0.0, 0.1) if is_inside else (5.0, 0.0, 0.1))
    wardrobe = world.add_box((0.3, 0.3, 0.4), far, name="wardrobe")
    place = SimpleNamespace(obstacles=[("wardrobe", wardrobe)])
    env = SimpleNamespace(
        world=world,
        cast={"robot": robot},
        task=SimpleNamespace(place=place),
        reset=lambda seed: None,
    )
    assert _stands_clear(env) is not is_inside  # type: ignore[arg-type]
    world.close()
