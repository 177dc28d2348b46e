"""What the control modes promise on every robot: effort, speed and limits, and weight when tilted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from rcare_marl import assets
from rcare_marl.agents.robots.arm import Arm
from rcare_marl.agents.robots.control import CONTROLS, WEIGHT_CARRYING
from rcare_marl.agents.robots.joint_group import JointGroup
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_check import CONTROL_DT, advance, spawned, still
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.bullet import bullet
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.world import GRAVITY, World

ROBOTS = assets.names("robots")
SECONDS, HOLD = 2.0, 10  # of random actions, and control steps that each of them lasts
# Greatest speed under random full-range actions of all parts at once, over a joint's own greatest:
# motors of limited effort cannot keep light joints from being thrown by the others. As measured
# over all robots, and a tenth more.
FASTEST = {
    "joint_delta": 2.2,
    "joint_position": 1.45,
    "joint_velocity": 2.3,
    "joint_torque": 2.7,
    "tool_delta": 2.1,
    "tool_servo": 2.1,
    "tool_pose": 2.1,
    "impedance": 2.0,
    "admittance": 1.7,
}
BEYOND = 0.06  # [rad or m] that light wrists and necks are thrown beyond a limit


@dataclass
class Extremes:
    """What was the worst of all joints in all physics steps, each with the joint's name.

    Attributes:
        effort: Motor and carried weight together over the greatest torque [1].
        speed: Over the greatest speed [1].
        beyond: A limit [rad or m].
        is_finite: Whether all was a number.
    """

    effort: tuple[float, str] = (0.0, "")
    speed: tuple[float, str] = (0.0, "")
    beyond: tuple[float, str] = (0.0, "")
    is_finite: bool = True

    def note(self, group: JointGroup, carried: Array) -> None:
        positions, velocities, motors = group.read()
        past = np.maximum(positions - group.upper, group.lower - positions)
        effort = np.abs(motors + carried) / group.effort
        self.effort = max(self.effort, *zip(effort.tolist(), group.names, strict=True))
        speed = np.abs(velocities) / group.velocity
        self.speed = max(self.speed, *zip(speed.tolist(), group.names, strict=True))
        self.beyond = max(self.beyond, *zip(past.tolist(), group.names, strict=True))
        self.is_finite &= bool(np.isfinite(positions).all() and np.isfinite(velocities).all())


# Every robot with every control mode; with one in turn it is quick.
THRASHED = [
    pytest.param(
        (name, control),
        id=f"{name}-{control}",
        marks=() if (j - i) % len(CONTROLS) == 0 else pytest.mark.slow,
    )
    for i, name in enumerate(ROBOTS)
    for j, control in enumerate(CONTROLS)
]


@pytest.fixture(scope="module", params=THRASHED)
def thrashed(request: pytest.FixtureRequest) -> tuple[str, str, Extremes]:
    """A robot whose parts all got random full-range actions, and what that led to."""
    name, control = request.param
    config = load_robot(name)
    world, robot = spawned(config, moves=config.parts, control=control)
    applied = {arm: np.zeros(len(robot.arms[arm])) for arm in robot.arms}
    for arm, joints in robot.arms.items():
        _listen(joints, applied[arm])
    # Springs carry weight, so that it takes nothing of the effort.
    springs = {arm for arm, joints in robot.arms.items() if joints.counterbalanced}
    out, rng = Extremes(), np.random.default_rng(1)
    for step in range(round(SECONDS / CONTROL_DT)):
        if step % HOLD == 0:
            action = rng.uniform(-1.0, 1.0, robot.action_size)
        robot.command(action, CONTROL_DT)
        for _ in range(round(CONTROL_DT / world.physics_dt)):
            robot.actuate()
            world.step()
            for arm, joints in robot.arms.items():
                out.note(joints, 0.0 * applied[arm] if arm in springs else applied[arm])
            for group in robot.groups.values():
                out.note(group, np.zeros(len(group)))
    world.close()
    return name, control, out


def _listen(arm: Arm, applied: Array) -> None:
    """Write the torques that `arm` is given besides its motors into `applied`."""
    drive = arm.drive_torques

    def listening(torques: Sequence[float]) -> None:
        applied[:] = torques
        drive(torques)

    arm.drive_torques = listening  # type: ignore[method-assign]


def test_joints_keep_to_their_effort_speed_and_limits(thrashed: tuple[str, str, Extremes]) -> None:
    _, control, worst = thrashed
    assert worst.is_finite
    assert worst.effort[0] <= 1 + 1e-6, worst.effort
    assert worst.speed[0] <= FASTEST[control], worst.speed
    assert worst.beyond[0] <= BEYOND, worst.beyond


@pytest.mark.parametrize("control", WEIGHT_CARRYING)
def test_an_arm_too_weak_for_its_weight_gives_way(control: str) -> None:
    world, robot = spawned(load_robot("kinova_gen3"), control=control)
    robot.set_posture([0.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0])  # stretched out to the side
    start = robot.arm.positions()
    weight = np.abs(robot.arm.chain.gravity_torques(start))
    robot.arm.effort[1] = 0.7 * weight[1]
    advance(world, robot, still(robot), 0.5)
    assert robot.arm.positions()[1] - start[1] > 0.3
    world.close()


def test_springs_leave_the_motors_all_of_their_effort() -> None:
    world, robot = spawned(load_robot("pr2"), control="joint_torque")
    arm = robot.arm
    weight = arm.chain.gravity_torques(arm.positions())
    assert arm.counterbalanced
    np.testing.assert_array_equal(arm.room(weight), arm.effort)
    np.testing.assert_array_equal(arm.carry(weight, arm.effort), weight)
    arm.counterbalanced = False
    assert np.all(arm.room(weight) + np.abs(arm.carry(weight, arm.room(weight))) <= arm.effort)
    world.close()


@pytest.mark.parametrize("control", ["joint_velocity", "joint_torque"])
def test_a_joint_without_command_comes_to_rest_and_stays(control: str) -> None:
    world, robot = spawned(load_robot("kinova_gen3"), control=control)
    push = np.zeros(robot.action_size)
    push[[0, 5]] = 0.5
    advance(world, robot, push, 0.5)
    advance(world, robot, np.zeros_like(push), 2.0)
    start = robot.arm.positions()
    advance(world, robot, np.zeros_like(push), 3.0)
    assert np.abs(robot.arm.positions() - start).max() < 1e-4
    world.close()


def test_a_joint_told_a_speed_turns_while_the_others_are_held() -> None:
    world, robot = spawned(load_robot("nao"), control="joint_velocity")
    start = robot.arm.positions()
    action = np.zeros(robot.action_size)
    action[-1] = -0.2
    advance(world, robot, action, 0.25)
    way = robot.arm.positions() - start
    assert way[-1] == pytest.approx(0.25 * -0.2 * robot.arm.velocity[-1], rel=0.1)
    assert np.abs(way[:-1]).max() < np.radians(0.5)
    world.close()


@pytest.fixture(scope="module")
def tilted() -> Iterator[tuple[World, Robot]]:
    """A Stretch that leans over, its telescope half out from the start."""
    config = load_robot("stretch_re1")
    home = {**config.postures["home"], "joint_lift": 0.6, "joint_arm_l3": 0.06}
    config = replace(config, postures={"home": home})
    lean = Pose((0.0, 0.0, 1.0), tuple(quaternion_from_rpy(0.5, -0.2, 0.3).tolist()))
    world, robot = spawned(config, pose=lean)
    yield world, robot
    world.close()


@pytest.mark.parametrize("out", [0.0, 0.04, 0.1])
def test_the_weight_of_a_tilted_telescope_is_the_slope_of_its_energy(
    tilted: tuple[World, Robot], out: float
) -> None:
    _, robot = tilted
    arm = robot.arm
    posture = arm.positions()
    posture[arm.names.index("joint_arm_l3")] = out
    links = range(robot.body.link_count)
    masses = np.array([robot.body.mass(link) for link in links])

    def energy(at: Array) -> float:
        arm.teleport(at)
        return GRAVITY * float(masses @ robot.body.link_centres(links)[:, 2])

    slopes = [
        (energy(posture + step) - energy(posture - step)) / 2e-3 for step in 1e-3 * np.eye(len(arm))
    ]
    np.testing.assert_allclose(arm.chain.gravity_torques(posture), slopes, atol=0.02)


def test_a_tilted_telescope_is_held_in_every_mode_that_carries_weight() -> None:
    lean = Pose((0.0, 0.0, 1.0), tuple(quaternion_from_rpy(0.25, 0.0, 0.0).tolist()))
    for control in WEIGHT_CARRYING:
        world, robot = spawned(load_robot("stretch_re1"), control=control, pose=lean)
        start = robot.arm.positions()
        advance(world, robot, still(robot), 3.0)
        assert np.abs(robot.arm.positions() - start).max() < 0.005, control
        world.close()


@pytest.mark.parametrize("heeds", [True, False])
def test_an_arm_does_not_touch_what_it_is_kept_clear_of(heeds: bool) -> None:
    world, robot = spawned(load_robot("kinova_gen3"))
    x, y, z = robot.tool_pose().position
    wall = world.add_box((0.1, 2.0, 2.0), Pose((x + 0.3, y, z)), name="wall")
    gaps = []
    for _ in range(30):
        near = world.near(robot.body, wall, within=0.06)
        robot.control.near = near if heeds else ()
        advance(world, robot, np.array((1.0, 0.0, 0.0, 0.0, 0.0, 0.0)), CONTROL_DT)
        gaps.append(min((there.gap for there in near), default=0.06))
    assert (min(gaps) > 0.003) is heeds
    assert gaps[-1] < 0.02


@pytest.mark.parametrize("heeds", [True, False])
def test_what_a_tool_carries_is_not_carried_against_the_arm(heeds: bool) -> None:
    world, robot = spawned(load_robot("kinova_gen3"))
    ball = world.add_sphere(0.08, Pose((0.0, 0.0, 3.0)), mass=0.3)
    robot.grasp(ball, robot.tool_pose().inverse() @ Pose((0.25, 0.0, 0.2)))
    robot.control.carried = (-1,) if heeds else ()
    gaps = []
    for _ in range(25):
        near = [n for n in world.near(robot.body, ball, within=0.06) if n.link in (0, 1)]
        robot.control.near = near
        advance(world, robot, np.array((-0.5, 0.0, 0.0, 0.0, 0.0, 0.0)), CONTROL_DT)
        gaps.append(min((there.gap for there in near), default=0.06))
    assert (min(gaps) > 0.003) is heeds
    world.close()


def what_comes(world: World, robot: Robot) -> tuple[float, list[float]]:
    """Let a ball come at the tool: the greatest force of it [N], and how near it was [m]."""
    x, y, z = robot.tool_pose().position
    ball = world.add_sphere(0.15, Pose((x + 0.4, y, z)), mass=5.0)
    touched, gaps = 0.0, []
    for step in range(25):
        ball.set_base(Pose((x + 0.4 - 0.02 * step, y, z)))
        bullet.resetBaseVelocity(ball.uid, (-0.2, 0.0, 0.5), physicsClientId=world.client)
        robot.control.near = world.near(robot.body, ball, within=0.06)
        gaps += [there.gap for there in robot.control.near]
        advance(world, robot, np.zeros(6), CONTROL_DT)
        touched = max(touched, world.contact_force(robot.body, ball))
    return touched, gaps


def test_an_arm_goes_out_of_the_way_of_what_comes() -> None:
    world, robot = spawned(load_robot("kinova_gen3"))
    x = robot.tool_pose().position[0]
    touched, _ = what_comes(world, robot)
    assert robot.tool_pose().position[0] < x
    assert touched == 0.0


def test_other_joints_go_out_of_the_way_for_one_at_its_limit() -> None:
    world, robot = spawned(load_robot("kinova_gen3"))
    arm, elbow = robot.arm, 3
    angle = arm.positions()[elbow]
    arm.lower[elbow], arm.upper[elbow] = angle - 0.02, angle + 0.02
    touched, gaps = what_comes(world, robot)
    assert touched == 0.0
    assert 0.0 < min(gaps) < 0.01
