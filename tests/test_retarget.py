"""Promises of retargeting: to robots that show a pose, and to people who imitate it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from variants import every

from rcare_marl.agents.coaching.exercise import Exercise, exercise_names, load_exercise
from rcare_marl.agents.coaching.imitation import Imitation, raised_sides, reach_of
from rcare_marl.agents.coaching.retarget import (
    Retarget,
    angle_between,
    arm_turns,
    robot_joints,
)
from rcare_marl.agents.coaching.sources.joints_source import JointsSource
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX, MOTIONS, SIDES, directions
from rcare_marl.agents.people.avatar import body_model, load_avatar
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose, matrix_from_quaternion
from rcare_marl.world import World

PEOPLE = ("daniel", "jose", "karan", "kim", "morgan", "natalia")
ROBOTS = ("nao", "pepper")
LIMBS = ("left_arm", "right_arm", "head")


class Stand:
    """A robot in the air that takes the joints that it is told."""

    def __init__(self, name: str) -> None:
        self.world = World(1 / 240)
        self.robot = Robot(name, load_robot(name), control="joint_position", moves=LIMBS)
        self.robot.spawn(self.world, Pose((0, 0, 1)))

    def take(self, joints: dict[str, float]) -> None:
        for part in self.robot.parts.values():
            assert part.joints is not None
            there = part.joints.positions()
            for i, name in enumerate(part.joints.names):
                there[i] = joints.get(name, there[i])
            part.joints.teleport(there)

    def turn(self, link: str) -> np.ndarray:
        pose = self.robot.body.link_pose(self.robot.body.link_index(link))
        return matrix_from_quaternion(pose.quaternion)


@pytest.fixture(scope="module", params=ROBOTS)
def stand(request: pytest.FixtureRequest) -> Stand:
    return Stand(request.param)


def poses(seed: int, count: int, *, wild: bool = False) -> np.ndarray:
    """Return poses that NAO and Pepper can take, or any at all."""
    rng = np.random.default_rng(seed)
    out = np.zeros((count, len(MOTIONS)))
    for side in SIDES:
        arm = ARM[side].start
        out[:, arm] = rng.uniform(0.3, math.pi if wild else 1.9, count)
        out[:, arm + 1] = rng.uniform(-1.0 if wild else 0.6, 2.0 if wild else 1.4, count)
        out[:, arm + 2] = rng.uniform(-1, 1, count) if wild else 0.0
        out[:, arm + 3] = rng.uniform(0.3, 2.4 if wild else 1.3, count)
    return out


def test_what_is_told_to_be_left_is_what_the_robot_leaves(stand: Stand) -> None:
    for angles in poses(0, 25, wild=True):
        shown = robot_joints(stand.robot.name, angles)
        stand.take(dict(shown.joints))
        for side in SIDES:
            letter = side[0].upper()
            upper, fore, hand = arm_turns(side, angles[ARM[side]])
            found = {
                "upper_arm": angle_between(stand.turn(f"{letter}Bicep")[:, 0], -upper[:, 2]),
                "forearm": angle_between(stand.turn(f"{letter}ForeArm")[:, 0], -fore[:, 2]),
            }
            for part, left in found.items():
                assert left == pytest.approx(shown.short[f"{side}_{part}"], abs=1e-4)
            if shown.short[f"{side}_forearm"] < 1e-3:
                back = angle_between(stand.turn(f"{side[0]}_wrist")[:, 2], hand[:, 2])
                assert back == pytest.approx(shown.short[f"{side}_hand"], abs=2e-3)


@pytest.mark.parametrize("robot", ROBOTS)
def test_arms_are_matched_exactly_where_the_limits_allow(robot: str) -> None:
    for angles in poses(1, 50):
        short = robot_joints(robot, angles).short
        assert max(short[f"{side}_upper_arm"] for side in SIDES) < 1e-6
        assert max(short[f"{side}_forearm"] for side in SIDES) < 1e-6


@pytest.mark.parametrize("robot", ROBOTS)
def test_joints_never_leave_their_limits(robot: str) -> None:
    retarget = Retarget(load_robot(robot))
    for angles in poses(2, 200, wild=True):
        for name, value in retarget(angles).joints.items():
            low, high = retarget._limits[name]
            assert low <= value <= high


def test_no_other_shoulder_within_the_limits_points_nearer() -> None:
    stand, rng = Stand("nao"), np.random.default_rng(3)
    retarget = Retarget(stand.robot.config)
    pitches, rolls = (
        np.linspace(*retarget._limits[name], 60) for name in ("LShoulderPitch", "LShoulderRoll")
    )
    pitch, roll = np.meshgrid(pitches, rolls)
    ways = np.stack(
        (np.cos(roll) * np.cos(pitch), np.sin(roll), -np.cos(roll) * np.sin(pitch)), axis=-1
    )
    for _ in range(40):
        angles = np.zeros(len(MOTIONS))
        angles[ARM["left"].start :][:2] = rng.uniform((0.2, -0.9), (3.0, 2.0))
        wanted = directions(angles)["left_arm"]
        least = float(np.arccos(np.clip(ways @ wanted, -1, 1)).min())
        assert retarget(angles).short["left_upper_arm"] < least + 0.01


def test_a_nao_that_cannot_spread_its_arms_says_so() -> None:
    exercise = load_exercise("lateral_raise")
    short = robot_joints("nao", exercise.keys[1]).short
    assert math.radians(5) < short["left_upper_arm"] < math.radians(14)
    assert short["left_upper_arm"] == pytest.approx(short["right_upper_arm"])
    assert robot_joints("pepper", exercise.keys[1]).short["left_upper_arm"] < math.radians(1)


def test_the_head_turns_and_what_it_cannot_do_is_told() -> None:
    angles = np.zeros(len(MOTIONS))
    angles[MOTION_INDEX["neck_rotation_left"]] = 0.9
    angles[MOTION_INDEX["neck_lateral_flexion_left"]] = 0.2
    angles[MOTION_INDEX["trunk_flexion"]] = 0.3
    shown = robot_joints("nao", angles)
    assert shown.joints["HeadYaw"] == pytest.approx(0.9)
    assert shown.short["head"] == pytest.approx(0.2) and shown.short["trunk"] == pytest.approx(0.3)
    assert shown.worst == pytest.approx(max(shown.short.values()))


def test_both_arms_are_mirror_images() -> None:
    for angles in poses(4, 20, wild=True):
        angles[ARM["right"]] = angles[ARM["left"]]
        joints = robot_joints("nao", angles).joints
        assert joints["LShoulderPitch"] == pytest.approx(joints["RShoulderPitch"])
        for name in ("ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw"):
            assert joints[f"L{name}"] == pytest.approx(-joints[f"R{name}"])


def test_other_robots_and_other_shapes_are_refused() -> None:
    with pytest.raises(ConfigError, match="Cast nao or pepper"):
        robot_joints("ur5", np.zeros(len(MOTIONS)))
    with pytest.raises(UnknownNameError, match="Did you mean 'nao'"):
        robot_joints("noa", np.zeros(len(MOTIONS)))
    with pytest.raises(ConfigError, match="shape"):
        robot_joints("nao", np.zeros(3))


def adapted(name: str, exercise: str) -> Exercise:
    return load_exercise(exercise).adapted(reach_of(load_avatar(name).profile))


@pytest.mark.parametrize("name", every(2, PEOPLE))
def test_who_imitates_does_what_is_shown_within_their_range(name: str) -> None:
    avatar = load_avatar(name)
    limits = avatar.profile.limits("active")
    source = JointsSource(body_model(avatar.body_path(), avatar.height_m).joints)
    for exercise in exercise_names():
        asked = adapted(name, exercise)
        if not asked.can_do:
            continue
        imitation = Imitation(limits)
        for angles in asked.path(rate=8):
            dofs = imitation(angles)
            assert all(limits[d][0] - 1e-9 <= a <= limits[d][1] + 1e-9 for d, a in dofs.items())
            whole = np.zeros(len(DOFS))
            whole[[DOF_INDEX[dof] for dof in dofs]] = list(dofs.values())
            frame = source.update(whole, 0.0)
            assert frame is not None
            wanted, done = directions(angles), directions(frame.angles)
            for part in asked.parts:
                assert angle_between(wanted[part], done[part]) < math.radians(16)


def test_only_an_arm_that_can_be_raised_exercises() -> None:
    sides = {name: raised_sides(load_avatar(name).profile) for name in PEOPLE}
    assert sides["daniel"] == sides["kim"] == sides["natalia"] == SIDES
    assert sides["karan"] == ("right",) and sides["jose"] == sides["morgan"] == ()
    assert adapted("karan", "front_raise").parts == ("right_arm",)
    for name in ("jose", "morgan"):
        assert [e for e in exercise_names() if adapted(name, e).can_do] == ["head_rotation"]


def test_no_goal_lies_beyond_the_active_range() -> None:
    profile = load_avatar("kim").profile
    most = profile.limits("active")["right_shoulder_flexion"][1]
    assert most < math.radians(150) < math.radians(160)  # of what everybody is asked
    lifted = adapted("kim", "upper_lift").keys[:, ARM["right"].start].max()
    assert math.radians(90) < lifted <= most + 1e-9
    turned = adapted("kim", "head_rotation").keys[:, MOTION_INDEX["neck_rotation_left"]].max()
    limits = [profile.limits("active")[f"{j}_rotation_left"][1] for j in ("neck", "head")]
    assert turned == pytest.approx(sum(limits))


def test_an_arm_that_is_lost_in_one_key_pose_takes_no_part_and_weak_elbows_are_not_judged() -> None:
    reach = reach_of(load_avatar("daniel").profile)
    front = (reach.front[0], 0.0) if reach.front else None
    weak = dataclasses.replace(reach, front=front, straightens=False)
    asked = load_exercise("chest_expansion").adapted(weak)  # forward first, and only then aside
    assert "left_arm" in asked.parts and "right_arm" not in asked.parts
    assert "right_arm" in load_exercise("lateral_raise").adapted(weak).parts
    assert asked.judged.elbow_deg == 180


def test_what_cannot_be_raised_stays_where_it_rests() -> None:
    seated = np.full(len(MOTIONS), 0.4)
    reach = reach_of(load_avatar("karan").profile, seated)
    keys = load_exercise("front_raise").adapted(reach).keys
    assert np.allclose(keys[:, ARM["left"]], 0.4) and np.ptp(keys[:, ARM["right"].start]) > 1
