"""Parts of a robot beside one arm: bases that drive, telescopes, heads, second arms, second robots."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import rcare_marl
from rcare_marl.agents.robots.control import JointPosition
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_check import advance, spawned, still
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.agents.robots.robot_model import robot_files
from rcare_marl.agents.robots.self_collision import overlapping, touching_links
from rcare_marl.envs.gym import SingleAgentEnv
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose
from rcare_marl.world import World

Array = npt.NDArray[np.float64]


def place_of(robot: Robot) -> Array:
    assert robot.base is not None
    return robot.base.place()


def test_a_differential_base_drives_forward_and_turns_and_never_slides_sideways() -> None:
    world, robot = spawned(load_robot("fetch"), moves=("base",))
    assert [name.split()[1] for name in robot.action_names] == ["forward", "turning"]
    speed, turn = robot.parts["base"].control.max
    advance(world, robot, np.array([0.5, 0.0]), 2.0)
    x, y, heading = place_of(robot)
    assert x == pytest.approx(speed, rel=0.05)  # half of the speed for two seconds
    assert (y, heading) == pytest.approx((0.0, 0.0), abs=1e-3)
    robot.reset(np.random.default_rng(0))
    advance(world, robot, np.array([0.5, 0.5]), 1.0)  # it weighs 113 kg and needs time to speed up
    for _ in range(20):  # along a circle: the base always looks where it goes
        advance(world, robot, np.array([0.5, 0.5]), 0.1)
        assert robot.base is not None
        forward, left, turning = robot.base.velocity()
        assert left == pytest.approx(0.0, abs=0.02 * speed)
        assert turning == pytest.approx(0.5 * turn, rel=0.05)
        assert forward == pytest.approx(0.5 * speed, rel=0.05)
    world.close()


def test_an_omnidirectional_base_also_goes_sideways_and_no_faster_aslant() -> None:
    world, robot = spawned(load_robot("pr2"), moves=("base",))
    assert robot.action_size == 3
    speed = robot.parts["base"].control.max[0]
    advance(world, robot, np.array([1.0, 1.0, 0.0]), 1.0)
    start = place_of(robot)
    advance(world, robot, np.array([1.0, 1.0, 0.0]), 1.0)
    x, y, _ = place_of(robot) - start
    assert x == pytest.approx(y, abs=0.01)
    assert math.hypot(x, y) == pytest.approx(speed, rel=0.02)
    world.close()


def test_a_base_stops_at_a_wall_and_pushes_no_harder_than_its_wheels() -> None:
    config = load_robot("fetch")
    world, robot = spawned(config, moves=("base",))
    wall = world.add_box((0.1, 4.0, 2.0), Pose((1.2, 0.0, 1.0)), name="wall")
    advance(world, robot, np.array([0.5, 0.0]), 4.0)
    assert place_of(robot)[0] < 1.0
    assert config.base is not None
    force = world.contact_force(robot.body, wall)
    assert 0.5 * config.base.force < force < 1.2 * config.base.force
    world.close()


def test_an_arm_keeps_its_kinematics_on_a_base_and_a_torso_that_move() -> None:
    world, robot = spawned(
        load_robot("fetch"), moves=("arm", "base", "torso"), control="joint_delta"
    )
    action = np.zeros(robot.action_size)
    action[robot.arm.names.index("elbow_flex_joint")] = 0.2
    action[-3:] = (0.3, 0.4, 0.5)
    advance(world, robot, action, 1.0)
    advance(world, robot, still(robot), 0.5)
    real = robot.body.link_pose(robot.tool_index)
    assert robot.tool_pose().position == pytest.approx(real.position, abs=1e-4)
    goal = Pose(tuple(np.add(real.position, (0.03, -0.02, 0.04)).tolist()), real.quaternion)
    found = robot.solve_ik(goal)
    robot.set_posture(found.posture)
    there = robot.body.link_pose(robot.tool_index)
    assert there.position == pytest.approx(goal.position, abs=2e-3)
    world.close()


def test_a_telescope_moves_all_its_segments_alike_in_every_mode() -> None:
    for control in ("joint_delta", "joint_velocity", "joint_torque", "tool_delta"):
        world, robot = spawned(load_robot("stretch_re1"), moves=("arm",), control=control)
        action = np.zeros(robot.action_size)
        before = np.array(robot.tool_pose().position)
        names = [f"joint_arm_l{k}" for k in (3, 2, 1, 0)]
        indices = robot.body.indices(names)
        start = np.array(robot.body.joint_states(indices)[0])
        if control == "tool_delta":
            out = robot.arm.chain.jacobian(robot.arm.positions())[:3, -2]  # along the telescope
            action[:3] = 0.3 * out / np.linalg.norm(out)
        else:
            share = 0.1 if control == "joint_torque" else 0.03
            action[robot.arm.names.index("joint_arm_l3")] = share
        advance(world, robot, action, 1.0)
        segments = np.array(robot.body.joint_states(indices)[0]) - start
        assert segments[0] > 0.005, control
        assert segments == pytest.approx(np.full(4, segments[0]), abs=2e-3), control
        way = float(np.linalg.norm(np.array(robot.tool_pose().position) - before))
        assert way == pytest.approx(4 * segments[0], rel=0.15, abs=5e-3), control
        real = robot.body.link_pose(robot.tool_index)
        assert robot.tool_pose().position == pytest.approx(real.position, abs=5e-3), control
        world.close()


@pytest.mark.parametrize("name", ["hsr", "nao", "pepper", "stretch_re1"])
def test_a_tool_goes_where_it_is_sent_with_fewer_than_six_joints(name: str) -> None:
    config = load_robot(name)
    world, robot = spawned(config, moves=(config.main_arm,))
    for axis in range(3):
        robot.set_start()
        before = np.array(robot.tool_pose().position)
        action = np.zeros(robot.action_size)
        action[axis] = 0.2
        advance(world, robot, action, 0.5)
        way = np.array(robot.tool_pose().position) - before
        expected = np.zeros(3)
        expected[axis] = 0.2 * robot.control.max[0] * 0.5
        assert way == pytest.approx(expected, abs=0.003), axis
    world.close()


def test_links_of_a_robot_meet_only_where_that_is_asked_for() -> None:
    deepest = {}
    for collides in (False, True):
        robot = Robot("robot", load_robot("ur5"), control="joint_position", self_collision=collides)
        world = World()
        robot.spawn(world, Pose())
        apart = touching_links(robot.files.model, robot.body, robot.hands)
        control = robot.control
        assert isinstance(control, JointPosition)
        folded = robot.arm.positions()
        folded[1:3] = -2.0, 2.9  # the forearm onto the upper arm, the hand into the base
        advance(world, robot, control.action_for(folded), 4.0)
        pairs = overlapping(robot.body, apart)
        links = [(robot.body.links[a], robot.body.links[b]) for a, b in pairs]
        deepest[collides] = min((robot.body.own_gap(a, b) for a, b in links), default=0.0)
        world.close()
    assert deepest[False] < -0.02
    assert deepest[True] > -0.01


def test_two_arms_and_a_head_act_at_once() -> None:
    config = load_robot("pr2")
    world, robot = spawned(config, moves=("right_arm", "left_arm", "head"))
    names = [o.name for o in robot.observables()]
    assert {"tool_position", "left_arm_tool_position", "head_position"} <= set(names)
    before = robot.tool_pose(), robot.tool_pose("left_arm")
    action = np.zeros(robot.action_size)
    action[2], action[6 + 2], action[12] = 0.4, -0.4, 0.3
    advance(world, robot, action, 0.5)
    after = robot.tool_pose(), robot.tool_pose("left_arm")
    assert after[0].position[2] > before[0].position[2] + 0.02
    assert after[1].position[2] < before[1].position[2] - 0.02
    assert abs(robot.groups["head"].positions()[0]) > 0.02
    with pytest.raises(UnknownNameError, match="left_arm"):
        robot.tool_pose("left_army")
    world.close()


def test_a_base_helps_one_arm_only_and_none_across_a_torso_that_moves() -> None:
    config = load_robot("pepper")
    expected = {
        ("right_arm",): {"right_arm"},
        ("right_arm", "left_arm"): {"right_arm"},
        ("right_arm", "torso"): set(),
        ("right_arm", "base"): set(),
    }
    for moves, helped in expected.items():
        world, robot = spawned(config, moves=moves)
        with_base = {name for name, arm in robot.arms.items() if "base_x" in arm.names}
        assert with_base == helped, moves
        for name, arm in robot.arms.items():
            arm.teleport(arm.rest + 0.1)
            real = robot.body.link_pose(robot.body.link_index(robot.assembly.tools[name]))
            assert robot.tool_pose(name).position == pytest.approx(real.position, abs=1e-4)
        world.close()


def test_several_robots_are_agents_of_their_own() -> None:
    env = rcare_marl.make(
        "feeding",
        robot_0="kinova_gen3",
        robot_1={"model": "nao", "moves": ["right_arm", "head"], "control": "joint_position"},
        policies={"robot_0": "scripted", "recipient": "cooperative"},
    )
    assert env.possible_agents == ["robot_1"]
    assert list(env.cast) == ["robot_0", "robot_1", "recipient"]
    env.reset(seed=0)
    first, second = env.cast["robot_0"], env.cast["robot_1"]
    assert isinstance(first, Robot) and isinstance(second, Robot)
    assert env.task.cast["robot_0"] is first
    apart = np.subtract(first.body.base_pose().position, second.body.base_pose().position)
    assert float(np.linalg.norm(apart[:2])) > 0.5
    while not env.is_over:
        env.step({"robot_1": np.full(env.action_space("robot_1").shape, 0.2, np.float32)})
    assert env.task.succeeded()  # the second robot is not in the way
    env.close()


@pytest.mark.slow
def test_a_driving_robot_is_stopped_by_the_wheelchair() -> None:
    env = rcare_marl.make(
        "feeding",
        robot={"model": "fetch", "moves": ["arm", "base"]},
        policies={"recipient": "still"},
        options={"force_limit": 1e6},
    )
    env.reset(seed=0)
    action = np.zeros(env.action_space("robot").shape, np.float32)
    action[-2] = 0.15  # towards the person
    deepest = 0.0
    chair = next(body for body in env.world.bodies if body.name == "wheelchair")
    robot = env.cast["robot"]
    while not env.is_over:
        env.step({"robot": action})
        deepest = min(deepest, env.world.separation(robot.body, chair, within=0.05))
    assert deepest < 0.05  # it came there
    assert deepest > -0.015
    env.close()


def test_a_commanded_gripper_that_opens_lets_go_of_the_spoon() -> None:
    env = rcare_marl.make(
        "feeding", robot={"moves": ["arm", "gripper"]}, policies={"recipient": "still"}
    )
    for _ in range(2):  # the next episode begins with the spoon in the hand
        env.reset(seed=0)
        robot = env.cast["robot"]
        assert isinstance(robot, Robot)
        spoon = next(body for body in env.world.bodies if body.name == "spoon")
        for closing in (1.0, -1.0):
            action = np.zeros(env.action_space("robot").shape, np.float32)
            action[-1] = closing
            before = (robot.tool_pose().inverse() @ spoon.base_pose()).position
            for _ in range(8):
                if not env.is_over:
                    env.step({"robot": action})
            after = (robot.tool_pose().inverse() @ spoon.base_pose()).position
            moved = float(np.linalg.norm(np.subtract(after, before)))
            assert moved < 0.005 if closing > 0 else moved > 0.05
    env.close()


def test_the_gripper_of_the_arm_that_moves_is_the_one_in_use() -> None:
    robot = Robot("robot", load_robot("pr2"), moves=("left_arm",), gripper="commanded")
    assert robot.moves == ("left_arm", "left_gripper")
    held = Robot("robot", load_robot("pr2"), moves=("left_arm",), grip_width=0.03)
    left, right = (held.assembly.grippers[f"{side}_arm"] for side in ("left", "right"))
    assert left.width(left.start) == pytest.approx(0.03, abs=1e-3)
    assert right.width(right.start) == pytest.approx(right.width(right.config.opened))


def test_a_policy_of_one_arm_finds_the_gripper_of_a_robot_with_two() -> None:
    """What is sensed and commanded of the main arm and its gripper has the names of a robot with one arm."""
    names = []
    for model in ("kinova_gen3", "pr2"):
        env = rcare_marl.make("ambulating", robot=model)
        names.append(
            (env.cast["robot"].action_names, [name for _, name, _ in env.describe("robot")])
        )
        env.close()
    assert names[0] == names[1]


def test_two_robots_with_a_place_each_work_side_by_side() -> None:
    env = rcare_marl.make(
        "feeding",
        robot_0="kinova_gen3",
        robot_1={"model": "kinova_gen3", "mount": "wheelchair_left"},
        policies={"robot_0": "scripted", "recipient": "cooperative", "robot_1": "still"},
    )
    env.reset(seed=0)
    while not env.is_over:
        env.step({})
    assert env.task.succeeded()
    env.close()
    with pytest.raises(ConfigError, match="stand in each other"):
        rcare_marl.make(
            "feeding",
            robot_0="kinova_gen3",
            robot_1={"model": "kinova_gen3", "mount": "wheelchair_right"},
        )


def test_noise_of_the_posture_changes_the_posture_and_nothing_else() -> None:
    starts, seen = [], []
    for noise in (0.0, 0.3):
        env = rcare_marl.make("feeding", robot={"posture_noise": noise})
        observations, _ = env.reset(seed=4)
        where = {name: part for part, name, _ in env.describe("robot")}
        starts.append(observations["robot"][where["joint_position"]])
        seen.append(observations["robot"][where["bowl_position"]])
        env.close()
    assert np.abs(starts[0] - starts[1]).max() > 0.02
    np.testing.assert_allclose(seen[0], seen[1], atol=2e-3)  # the spoon is where it was


def test_the_gymnasium_form_takes_several_robots() -> None:
    robots: dict[str, Any] = {
        "robot_0": "kinova_gen3",
        "robot_1": {"model": "nao", "policy": "still"},
    }
    env = SingleAgentEnv("feeding", role="robot_0", **robots)
    assert env.care_env.possible_agents == ["robot_0"]
    env.close()
    other = SingleAgentEnv("feeding", role="recipient", **robots)
    assert other.care_env.possible_agents == ["recipient"]
    other.close()
    with pytest.raises(UnknownNameError, match="Did you mean 'robot'"):
        SingleAgentEnv("feeding", role="robt")


def test_several_robots_must_be_numbered_without_gaps() -> None:
    with pytest.raises(ConfigError, match="not both"):
        rcare_marl.make("feeding", robot="kinova_gen3", robot_1="nao")
    with pytest.raises(ConfigError, match="numbered"):
        rcare_marl.make("feeding", robot_0="kinova_gen3", robot_2="nao")
    with pytest.raises(ConfigError, match="plays the first robot"):
        rcare_marl.make("feeding", robot_1="kinova_gen3", policies={"robot_1": "scripted"})
    with pytest.raises(UnknownNameError, match="caregiver_1"):
        rcare_marl.make("feeding", caregiver_1="karan")


def test_a_urdf_of_the_users_own_can_feed() -> None:
    urdf = robot_files("kinova_gen3/model.yaml").urdf
    env = rcare_marl.make(
        "feeding",
        robot={
            "urdf": str(urdf),
            "joints": [f"joint_{k}" for k in range(1, 8)],
            "tool_link": "tool",
            "posture": load_robot("kinova_gen3").postures["wheelchair_right"],
        },
        policies={"robot": "scripted", "recipient": "cooperative"},
    )
    env.reset(seed=0)
    while not env.is_over:
        env.step({})
    assert env.task.succeeded()
    env.close()


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"urdf": "robot.urdf"}, "needs `joints`"),
        ({"urdf": "robot.urdf", "model": "ur5"}, "not both"),
        ({"model": "ur5", "joints": ["a"]}, "goes with a urdf"),
        ({"model": "kinova_gen3", "moves": ["head"]}, "part of the robot"),
        ({"model": "kinova_gen3", "mount": "sofa"}, "mount"),
        ({"model": "kinova_gen3", "mount": {"position": [9.0, 9.0, 0.0]}}, "no arm that reaches"),
        ({"model": "kinova_gen3", "posture": {"joint_9": 0.0}}, "joint_9"),
        ({"model": "kinova_gen3", "posture": {"joint_2": 99.0}}, "goes from -2.24 to 2.24 rad"),
        ({"model": "kinova_gen3", "posture_noise": -1.0}, "posture_noise"),
        ({"model": "kinova_gen3", "gripper": "commanded"}, "among `moves`"),
        ({"model": "kinova_gen3", "moves": ["gripper"]}, "add arm"),
        ({"model": "pr2", "moves": ["left_arm"]}, "left_arm .the first of `moves`"),
        (
            {"urdf": "a.urdf", "joints": ["a"], "tool_link": "b", "posture": "hom"},
            "posture of a urdf",
        ),
        ({"model": "kinova_gen3", "movs": ["arm"]}, "Did you mean 'moves'"),
    ],
)
def test_what_cannot_be_cast_says_why(entry: dict[str, object], message: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        rcare_marl.make("feeding", robot=entry)


def test_a_robots_yaml_file_finds_its_model_beside_it(tmp_path: Path) -> None:
    from rcare_marl import assets

    folder = assets.ROOT / "robots"
    (tmp_path / "mine.yaml").write_text((folder / "kinova_gen3.yaml").read_text())
    (tmp_path / "kinova_gen3").mkdir()
    model = (folder / "kinova_gen3" / "model.yaml").read_text()
    (tmp_path / "kinova_gen3" / "model.yaml").write_text(
        model.replace("name: kinova_gen3", "name: mine")
    )
    robot = Robot("robot", load_robot(tmp_path / "mine.yaml"))
    assert robot.files.model.name == "mine"
