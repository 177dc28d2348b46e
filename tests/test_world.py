"""The physics world keeps its promises: newtons, snapshots, attachments, errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rcare_marl.errors import ConfigError, UnknownNameError, WorldError
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.world import GRAVITY, World


@pytest.fixture
def world() -> World:
    world = World()
    world.add_box((4, 4, 0.2), Pose((0, 0, -0.1)), name="floor")
    return world


def run(world: World, steps: int) -> None:
    for _ in range(steps):
        world.step()


def test_a_resting_box_presses_with_its_weight_in_newtons(world: World) -> None:
    box = world.add_box((0.2, 0.2, 0.2), Pose((0, 0, 0.1)), mass=3.0)
    run(world, 240)
    floor = world.bodies[0]
    assert world.contact_force(box, floor) == pytest.approx(3 * GRAVITY, rel=0.02)
    assert world.contact_force(box) == pytest.approx(3 * GRAVITY, rel=0.02)
    assert world.contact_force(box, floor) == pytest.approx(3 * GRAVITY, rel=0.02)
    assert {contact.link_b for contact in world.contacts(box, floor)} == {-1}


def test_a_lifted_box_touches_nothing(world: World) -> None:
    box = world.add_box((0.2, 0.2, 0.2), Pose((0, 0, 1.0)), mass=3.0)
    run(world, 2)
    assert world.contact_force(box) == 0.0
    assert world.separation(box, world.bodies[0], within=2.0) == pytest.approx(0.9, abs=0.01)
    assert not world.nearest(box, world.bodies[0], within=0.5)
    for near in world.nearest(box, world.bodies[0], within=2.0):
        assert near.distance == pytest.approx(0.9, abs=0.01)
        assert near.normal == pytest.approx((0.0, 0.0, 1.0), abs=0.01)


def test_rewind_brings_back_the_marked_state_to_the_bit(world: World) -> None:
    boxes = [
        world.add_box((0.2, 0.2, 0.2), Pose((0.05 * i, 0, 0.5 + 0.3 * i)), mass=1) for i in range(3)
    ]
    world.mark_start()
    first: list[list[Pose]] = []
    again: list[list[Pose]] = []
    for history in (first, again):
        world.rewind()
        assert world.time == 0.0
        for _ in range(120):
            world.step()
            history.append([*(b.base_pose() for b in boxes)])
    assert first == again


def test_an_attachment_holds_and_is_undone_by_rewind(world: World) -> None:
    hand = world.add_box((0.1, 0.1, 0.1), Pose((0, 0, 1.0)), name="hand")
    cup = world.add_box((0.1, 0.1, 0.1), Pose((0, 0, 0.85)), mass=0.5, name="cup")
    world.mark_start()
    bond = world.attach(hand, "base", cup)
    run(world, 240)
    assert cup.base_pose().position[2] == pytest.approx(0.85, abs=2e-3)
    world.rewind()
    assert not bond.is_active
    run(world, 240)
    assert cup.base_pose().position[2] < 0.1


def test_an_attachment_of_the_start_is_made_again_by_rewind(world: World) -> None:
    hand = world.add_box((0.1, 0.1, 0.1), Pose((0, 0, 1.0)), name="hand")
    cup = world.add_box((0.1, 0.1, 0.1), Pose((0, 0, 0.85)), mass=0.5, name="cup")
    bond = world.attach(hand, "base", cup)
    world.mark_start()
    world.detach(bond)
    world.detach(bond)  # twice does no harm
    run(world, 120)
    assert cup.base_pose().position[2] < 0.5
    world.rewind()
    assert bond.is_active
    run(world, 120)
    assert cup.base_pose().position[2] == pytest.approx(0.85, abs=2e-3)


def test_bodies_cannot_be_added_once_the_start_is_marked(world: World) -> None:
    world.mark_start()
    with pytest.raises(WorldError, match="mark_start"):
        world.add_sphere(0.1)


def test_rewind_without_a_mark_says_what_is_missing(world: World) -> None:
    with pytest.raises(WorldError, match="mark_start"):
        world.rewind()


@pytest.mark.parametrize("physics_dt", [0.0, -0.1, float("nan"), 2.0])
def test_an_impossible_time_step_is_refused(physics_dt: float) -> None:
    with pytest.raises(ConfigError, match="physics_dt"):
        World(physics_dt)


def test_a_missing_or_broken_urdf_is_named(world: World, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nothing.urdf"):
        world.load_urdf(tmp_path / "nothing.urdf")
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot><link")
    with pytest.raises(ConfigError, match="broken.urdf"):
        world.load_urdf(broken)


_ARM = """<robot name="arm"><link name="root"/>
<link name="upper"><inertial><origin xyz="0 0 -0.2"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="swing" type="revolute"><parent link="root"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="1" effort="10" velocity="5"/></joint></robot>"""


def test_names_find_joints_and_links_and_a_typo_gets_the_nearest(
    world: World, tmp_path: Path
) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(_ARM)
    arm = world.load_urdf(file, Pose((0, 0, 1)))
    assert arm.joint("swing").lower == -2 and arm.joint("swing").upper == 1
    assert arm.link_pose(arm.link_index("upper")).position == pytest.approx((0, 0, 1))
    with pytest.raises(UnknownNameError, match="Did you mean 'swing'"):
        arm.indices(["swng"])
    with pytest.raises(UnknownNameError, match="Did you mean 'upper'"):
        arm.link_index("uper")


def test_the_base_frame_is_that_of_the_urdf_wherever_its_mass_lies(
    world: World, tmp_path: Path
) -> None:
    file = tmp_path / "stick.urdf"
    file.write_text(
        '<robot name="stick"><link name="stick"><inertial><origin xyz="0 0 0.3" rpy="0.4 0 1"/>'
        '<mass value="1"/><inertia ixx="0.1" iyy="0.2" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial>'
        "</link></robot>"
    )
    turned = tuple(quaternion_from_rpy(0.1, -0.2, 0.3).tolist())
    body = world.load_urdf(file, Pose((1, 2, 3), turned), fixed=False)
    pose = body.base_pose()
    assert pose.position == pytest.approx((1, 2, 3))
    assert np.abs(np.dot(pose.quaternion, turned)) == pytest.approx(1)


def test_closing_twice_does_no_harm(world: World) -> None:
    world.close()
    world.close()
