"""Devices: wheelchair and spoon keep their dimensions and do what they are for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pybullet as bullet
import pytest

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.envs.devices import Spoon, Wheelchair, hang_ventilator, spawn_fitted
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose, multiply, quaternion_from_axis_angle, quaternion_from_rpy, rotate
from rcare_marl.world import World


def test_frames_lie_in_the_bounding_box() -> None:
    for device in (Wheelchair(), Spoon()):
        world = World()
        body = device.spawn(world)
        low, high = np.array(bullet.getAABB(body.uid, -1, physicsClientId=world.client))
        for name in device.frames:
            position = np.array(device.frame(name).position)
            assert np.all(position >= low - 0.01) and np.all(position <= high + 0.01), name


def test_wheelchair_has_the_dimensions_of_its_source() -> None:
    world = World()
    chair = Wheelchair(mounts="none")
    body = chair.spawn(world)
    low, high = np.array(bullet.getAABB(body.uid, -1, physicsClientId=world.client))
    assert low[2] == pytest.approx(0, abs=0.005)
    assert high[1] - low[1] == pytest.approx(0.66, abs=0.01)
    assert 1.0 < high[0] - low[0] < 1.22
    assert chair.frame("seat").position[2] == pytest.approx(0.485)
    assert 0.74 <= chair.frame("armrest_left").position[2] <= 0.76


def test_wheelchair_frames_move_with_it() -> None:
    turn = tuple(quaternion_from_rpy(0, 0, math.pi / 2).tolist())
    chair = Wheelchair()
    chair.spawn(World(), Pose((1.0, 2.0, 0.0), turn))
    x, y, z = chair.frame("mount_left").position
    assert chair.frame_in_world("mount_left").position == pytest.approx((1 - y, 2 + x, z), abs=1e-6)


def test_robot_mounts_are_those_of_the_wheelchair() -> None:
    robot, chair = Robot("robot", load_robot("kinova_gen3")), Wheelchair()
    for side in ("left", "right"):
        assert robot.mount(f"wheelchair_{side}").position == chair.frame(f"mount_{side}").position


def test_nothing_of_the_wheelchair_is_in_the_way_of_the_robot() -> None:
    for side in ("left", "right"):
        world, robot, chair = World(), Robot("robot", load_robot("kinova_gen3")), Wheelchair()
        body = chair.spawn(world)
        robot.spawn(world, robot.mount(f"wheelchair_{side}"))
        bullet.performCollisionDetection(physicsClientId=world.client)
        assert not [c for c in world.contacts(robot.body, body) if c.distance < 0 and c.link_a >= 0]


@pytest.mark.parametrize("side", ["left", "right"])
def test_robot_on_the_wheelchair_reaches_the_mouth_with_a_level_spoon(side: str) -> None:
    world, robot = World(), Robot("robot", load_robot("kinova_gen3"))
    chair, spoon = Wheelchair(), Spoon()
    chair.spawn(world)
    robot.spawn(world, robot.mount(f"wheelchair_{side}"))
    level = tuple(spoon.facing((-1, 0, 0)).tolist())
    up = rotate(robot.tool_pose().quaternion, spoon.up)
    assert up[2] > 0.99
    for x in (-0.05, 0.1, 0.25):
        for height in (1.12, 1.2):
            tool = Pose((x, 0, height), level) @ spoon.frame("bowl").inverse()
            assert robot.solve_ik(tool).is_within(), (x, height)


def test_four_pieces_of_food_stay_in_a_tilted_and_pushed_spoon() -> None:
    # 20 degrees of tilt, and 2 m/s² sideways, which gravity turned further equals.
    tilt = math.radians(20) + math.atan(2 / 9.81)
    for direction in range(4):
        world, spoon = World(), Spoon()
        spoon.model = replace(spoon.model, is_movable=False)
        axis = rotate(quaternion_from_rpy(0, 0, direction * math.pi / 2), (1, 0, 0))
        turned = multiply(quaternion_from_axis_angle(axis, tilt), spoon.facing((1, 0, 0)))
        spoon.spawn(world, Pose((0, 0, 1), tuple(turned.tolist())))
        food = []
        for y, z in ((-0.006, -0.006), (0.006, -0.006), (-0.006, 0.006), (0.006, 0.006)):
            x, _, along = spoon.frame("floor").position
            at = spoon.pose @ Pose((x + 0.0055, y, along + z))
            food.append(world.add_sphere(0.005, Pose(at.position), mass=0.0005))
            food[-1].set_friction([-1], lateral=0.5, rolling=0.0005, spinning=0.0005)
        for _ in range(240):
            world.step()
        bowl = np.array(spoon.frame_in_world("bowl").position)
        for piece in food:
            assert np.linalg.norm(np.subtract(piece.base_pose().position, bowl)) < 0.03


def test_food_stays_in_the_spoon_that_a_robot_moves() -> None:
    world, robot, spoon = World(), Robot("robot", load_robot("kinova_gen3")), Spoon()
    robot.spawn(world, robot.mount("wheelchair_right"))
    robot.reset(np.random.default_rng(0))
    held = spoon.spawn(world)
    robot.grasp(held, spoon.in_tool)
    x, _, along = spoon.frame("floor").position
    food = []
    for y, z in ((-0.006, -0.006), (0.006, -0.006), (-0.006, 0.006), (0.006, 0.006)):
        at = spoon.pose @ Pose((x + 0.006, y, along + z))
        food.append(world.add_sphere(0.005, Pose(at.position), mass=0.0005))
    action = np.zeros(6)
    for k in range(30):
        action[0] = 0.0 if k < 6 or k > 24 else -0.5
        robot.command(action, 0.05)
        for _ in range(12):
            robot.actuate()
            world.step()
    bowl = np.array(spoon.frame_in_world("bowl").position)
    assert all(np.linalg.norm(np.subtract(f.base_pose().position, bowl)) < 0.03 for f in food)
    assert robot.tool_pose().position == pytest.approx(held.base_pose().position, abs=1e-3)


def test_spoon_faces_where_it_is_told() -> None:
    for direction in ((1, 0, 0), (-1, 0, 0), (0.6, -0.8, 0.3)):
        turn = Spoon.facing(direction)
        tip, up = rotate(turn, (0, 0, 1)), rotate(turn, Spoon.up)
        assert up == pytest.approx((0, 0, 1), abs=1e-9)
        assert tip[:2] == pytest.approx(np.array(direction[:2]) / np.hypot(*direction[:2]))
    with pytest.raises(ConfigError, match="cannot point"):
        Spoon.facing((0, 0, 1))


def test_impossible_devices_say_so() -> None:
    with pytest.raises(UnknownNameError, match="frame"):
        Wheelchair().frame("cupholder")
    with pytest.raises(ConfigError, match="mounts"):
        Wheelchair(mounts="front")


def test_a_ventilator_hangs_behind_the_chair_and_its_tube_ends_at_the_throat() -> None:
    world, chair = World(), Wheelchair(mounts="none")
    person = Human("recipient", load_avatar("jose"), posture=load_posture("wheelchair"))
    person.spawn(world, spawn_fitted(chair, person, world))
    device = hang_ventilator(world, chair, person)
    root = device.model.links[device.model.root]
    end = device.pose @ Pose(root.visual[-1].at)
    mouth = person.mouth_position()
    assert 0.04 < mouth[2] - end.position[2] < 0.2  # below the lips
    assert abs(end.position[1] - mouth[1]) < 0.03 and end.position[0] < mouth[0]
    assert len(root.collision) == 1  # the machine is solid, the tube gives way
    assert world.separation(device.body, chair.body, within=0.1) > -0.02
    assert device.pose.position[0] < chair.frame_in_world("backrest").position[0] - 0.1
