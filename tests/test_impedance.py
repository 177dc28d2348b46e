"""The tool as a spring: steady presses, no energy from nowhere, and absolute poses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from variants import few

from rcare_marl import assets
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.control import Compliance, ToolAdmittance, ToolImpedance, ToolPose
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_check import spawned
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, about_z
from rcare_marl.world import World

DT = 0.1
OTHERS = [name for name in assets.names("robots") if name != "kinova_gen2"]


# Which arm is tried under which mode; motors of a UR5 are stiff.
ARMS = {"impedance": "kinova_gen3", "admittance": "ur5"}
both = pytest.mark.parametrize("mode", ARMS)


def arm(world: World, control: str, compliance: Compliance = Compliance()) -> Robot:
    model = load_robot(ARMS.get(control, "kinova_gen3"))
    robot = Robot("robot", model, control=control, compliance=compliance)
    robot.spawn(world, robot.mount("floor"))
    return robot


def act(world: World, robot: Robot, action: Array, seconds: float) -> Iterator[None]:
    """Hold an action, and stop after each physics step."""
    for _ in range(round(seconds / DT)):
        robot.command(action, DT)
        for _ in range(24):
            robot.actuate()
            world.step()
            yield


def press(world: World, robot: Robot, body: Body, seconds: float) -> Array:
    """Go down onto something; return the force on it in the last second, each physics step [N]."""
    down = robot.tool_action(np.array((0.0, 0.0, -0.06)), np.zeros(3))
    forces = [world.contact_force(body, robot.body) for _ in act(world, robot, down, seconds)]
    return np.array(forces[-240:])


@both
@pytest.mark.parametrize("stiffness", few([30000.0, 1000.0], 30000.0))
def test_five_newtons_are_pressed_on_what_is_stiff_and_what_is_soft(
    mode: str, stiffness: float
) -> None:
    world = World()
    robot = arm(world, mode, Compliance(wrench_limit=(20, 20, 5, 4, 4, 4)))
    x, y, z = robot.tool_pose().position
    pad = world.add_box((0.4, 0.4, 0.05), Pose((x, y, z - 0.1)), name="pad")
    pad.set_softness(stiffness=stiffness, damping=50.0)
    forces = press(world, robot, pad, 4.0)
    assert np.abs(forces - 5.0).max() < 0.5
    world.close()


@both
@pytest.mark.slow
def test_five_newtons_are_pressed_on_flesh_that_yields(mode: str) -> None:
    world = World()
    person = Human(
        "person",
        load_avatar("karan"),
        posture=load_posture("bed_supine"),
        movable=(),
        tissue=["right_hip"],
    )
    person.spawn(world, Pose((0.0, 0.0, 0.0)))
    robot = arm(world, mode, Compliance(wrench_limit=(20, 20, 5, 4, 4, 4)))
    thigh = person.joint_pose("right_hip").position
    knee = person.joint_pose("right_knee").position
    middle = 0.5 * (np.array(thigh) + knee)
    x, y, z = robot.tool_pose().position  # from the side, and from above
    at = (middle[0] + y, middle[1] - x, middle[2] - z + 0.16)
    robot.place(Pose(tuple(np.array(at).tolist()), about_z(math.pi / 2)))
    assert world.separation(robot.body, person.body, within=0.05) > 0.02
    forces = press(world, robot, person.body, 4.0)
    assert abs(forces.mean() - 5.0) < 0.5
    world.close()


def energy(robot: Robot, control: ToolImpedance) -> float:
    """Return the energy of the motion, of the arm or of the mass that it plays, and of the spring [J]."""
    arm = robot.arm
    positions, velocities = arm.states()
    error, _ = control.stretch(positions)
    mass = arm.mass_matrix(positions)
    if isinstance(control, ToolAdmittance):
        here = arm.chain.jacobian(positions)
        mass = here.T @ np.diag(control.compliance.inertia) @ here
    return float(0.5 * velocities @ mass @ velocities + 0.5 * np.sum(control.stiffness * error**2))


@both
@pytest.mark.parametrize("axes", few(["world", "tool"], "tool"))
def test_a_spring_that_is_let_go_only_loses_energy(mode: str, axes: str) -> None:
    world = World()
    limit = (200.0, 200.0, 200.0, 20.0, 20.0, 20.0)
    robot = arm(world, mode, Compliance(wrench_limit=limit, axes=axes))  # type: ignore[arg-type]
    control = robot.control
    assert isinstance(control, ToolImpedance)
    posture = robot.arm.positions()
    control.reset()
    robot.arm.teleport(posture + 0.1)  # the rest stays where it was
    still = np.zeros(robot.action_size)
    seen = [energy(robot, control)]
    seen += [energy(robot, control) for _ in act(world, robot, still, 2.0)]
    assert seen[0] > 1.0 and seen[-1] < 0.02 * seen[0]
    assert np.diff(seen).max() < 2e-3 * seen[0]
    world.close()


@both
def test_a_spring_gives_a_thing_that_it_pushes_no_more_energy_than_it_had(mode: str) -> None:
    world = World()
    robot = arm(world, mode, Compliance(damping=(5.0, 5.0, 5.0, 0.5, 0.5, 0.5)))
    control = robot.control
    assert isinstance(control, ToolImpedance)
    x, y, z = robot.tool_pose().position
    world.add_box((0.6, 2.0, 0.02), Pose((x, y, z - 0.11)), name="table")
    puck = world.add_box((0.2, 0.1, 0.2), Pose((x, y + 0.3, z)), mass=0.5, name="puck")
    puck.set_friction([-1], lateral=0.0)
    puck.set_softness(stiffness=10000.0, damping=0.0)
    puck.set_base(Pose((x, y + 0.34 - world.separation(robot.body, puck, within=1.0), z)))
    wind = robot.tool_action(np.array((0.0, 0.25, 0.0)), np.zeros(3))
    assert not any(world.contact_force(puck, robot.body) for _ in act(world, robot, wind, 0.2))
    given, seen = [], []
    for _ in act(world, robot, np.zeros(robot.action_size), 2.0):
        given.append(0.5 * 0.5 * float(np.sum(puck.state()[7:10] ** 2)))
        seen.append(energy(robot, control) + given[-1])
    assert max(given) > 0.01 * seen[0]  # it was hit
    assert max(seen) <= 1.02 * seen[0]
    world.close()


def test_a_spring_that_an_action_makes_stiffer_gets_no_energy_by_it() -> None:
    world = World()
    limit = (200.0, 200.0, 200.0, 20.0, 20.0, 20.0)
    robot = arm(world, "impedance", Compliance(wrench_limit=limit, varies=True))
    control = robot.control
    assert isinstance(control, ToolImpedance) and robot.action_size == 18
    posture = robot.arm.positions()
    control.reset()
    robot.arm.teleport(posture + 0.1)
    seen, rng = [energy(robot, control)], np.random.default_rng(0)
    for _ in range(20):
        action = np.concatenate((np.zeros(6), rng.uniform(-1, 1, 12)))
        before = energy(robot, control)
        robot.command(action, DT)
        assert energy(robot, control) <= before * (1 + 1e-6)
        seen += [energy(robot, control) for _ in act(world, robot, action, DT)]
    assert max(seen) <= seen[0] * (1 + 2e-3)
    world.close()


def test_an_admittance_feels_what_is_done_to_its_hand_and_not_what_that_weighs() -> None:
    world = World()
    robot = arm(world, "admittance")
    control = robot.control
    assert isinstance(control, ToolAdmittance)
    cup = world.add_box((0.06, 0.06, 0.1), Pose((9.0, 9.0, 9.0)), mass=0.5, name="cup")
    robot.grasp(cup, Pose((0.05, 0.0, 0.1)))
    start = np.array(robot.tool_pose().position)
    for _ in act(world, robot, np.zeros(6), 2.0):
        pass
    np.testing.assert_allclose(robot.tool_pose().position, start, atol=5e-4)
    np.testing.assert_allclose(control.outside[:3], 0.0, atol=0.05)
    push = np.array((3.0, -2.0, 4.0))
    for _ in act(world, robot, np.zeros(6), 3.0):
        robot.body.apply_force(robot.tool_index, push, robot.tool_pose().position)
    np.testing.assert_allclose(control.outside[:3], push, atol=0.1)
    world.close()


# Gen2 has the lightest wrist against its arm: commands threw it to four times its speed.
@both
@pytest.mark.parametrize(
    "model", ["kinova_gen2", *(pytest.param(name, marks=pytest.mark.slow) for name in OTHERS)]
)
def test_commands_that_jump_throw_no_joint_of_an_arm(mode: str, model: str) -> None:
    world, robot = spawned(load_robot(model), control=mode)
    rng, fastest = np.random.default_rng(3), 0.0
    for _ in range(6):
        for _ in act(world, robot, rng.choice((-1.0, 1.0), robot.action_size), 0.5):
            fastest = max(
                fastest, float((np.abs(robot.arm.velocities()) / robot.arm.velocity).max())
            )
    assert fastest < (1.1 if mode == "impedance" else 1.15)
    world.close()


def test_a_push_moves_the_tool_by_what_its_stiffness_allows() -> None:
    world = World()
    robot = arm(world, "impedance", Compliance(stiffness=(400.0, 1600.0, 400.0, 30.0, 30.0, 30.0)))
    start = np.array(robot.tool_pose().position)
    for axis, stiffness in ((0, 400.0), (1, 1600.0)):
        push = np.zeros(3)
        push[axis] = 8.0
        robot.set_start()
        for _ in act(world, robot, np.zeros(6), 3.0):
            robot.body.apply_force(robot.tool_index, push, robot.tool_pose().position)
        moved = np.array(robot.tool_pose().position) - start
        assert moved[axis] == pytest.approx(8.0 / stiffness, rel=0.1)
    world.close()


def test_the_tool_goes_to_an_absolute_pose_and_stays_there() -> None:
    world = World()
    robot = arm(world, "tool_pose")
    control = robot.control
    assert isinstance(control, ToolPose)
    place = robot.tool_pose()
    wish = Pose(tuple(np.add(place.position, (-0.05, 0.1, 0.08)).tolist()), place.quaternion)
    speeds, before = [], np.array(place.position)
    for _ in act(world, robot, control.action_for(wish), 2.5):
        now = np.array(robot.tool_pose().position)
        speeds.append(np.linalg.norm(now - before) * 240)
        before = now
    assert math.dist(robot.tool_pose().position, wish.position) < 0.003
    assert max(speeds[24:]) < 1.2 * math.sqrt(3) * ToolPose.SPEED
    world.close()


def test_impossible_compliance_is_refused() -> None:
    with pytest.raises(ConfigError, match="wrench_limit"):
        Compliance(wrench_limit=(0.0, 1.0, 1.0, 1.0, 1.0, 1.0))
    with pytest.raises(ConfigError, match="stiffness"):
        Compliance(stiffness=(-1.0, 1.0, 1.0, 1.0, 1.0, 1.0))
    with pytest.raises(ConfigError, match="inertia"):
        Compliance(inertia=(0.0, 1.0, 1.0, 1.0, 1.0, 1.0))
