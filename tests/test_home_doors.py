"""Doors of homes: latched, opened by the force that the rules allow, and left where they are."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal, cast

import numpy as np
import pybullet as bullet
import pytest
from small_home import small_home

from rcare_marl.envs.homes.door import KNOB_RADIUS, Door, door_model, hinge_side, widest_swing
from rcare_marl.envs.homes.palette import Palette
from rcare_marl.envs.homes.plan import Opening
from rcare_marl.envs.homes.rule import Rules
from rcare_marl.envs.homes.shell import floor_model, shell_model
from rcare_marl.errors import ActionError, ConfigError
from rcare_marl.model.urdf import write
from rcare_marl.pose import Pose, rotate
from rcare_marl.world import World

LEVELS = (1, 2, 3)


def inner_door(level: int) -> Opening:
    return small_home(level).openings["door_1"]


def spawned(opening: Opening, level: int, world: World | None = None) -> tuple[World, Door]:
    world = world or World()
    door = Door(opening, Rules(level))
    door.spawn(world)
    return world, door


def turn_handle(door: Door, side: str, force: float) -> None:
    """Push a lever down at its end, or turn a knob at its rim, for one physics step."""
    link = door.body.link_index("handle")
    if door.opening.hardware == "lever":
        end = door.frame_in_world(f"lever_{side}").position
        door.body.apply_force(link, (0.0, 0.0, -force), end)
        return
    knob = door.frame_in_world(f"handle_{side}")
    along, up = rotate(knob.quaternion, (0, 1, 0)), rotate(knob.quaternion, (0, 0, 1))
    for sign in (-1, 1):
        rim = np.add(knob.position, sign * KNOB_RADIUS * along)
        door.body.apply_force(link, sign * 0.5 * force * up, rim)


def pull(door: Door, side: str, force: float) -> None:
    """Pull a leaf open by its handle, or push it from the other side; slide a panel."""
    handle = door.frame_in_world(f"handle_{side}")
    if door.opening.hardware == "slider":
        way = rotate(door.opening.pose.quaternion, (hinge_side(door.opening), 0, 0))
        door.body.apply_force(door.body.link_index("panel"), force * way, handle.position)
        return
    leaf = door.body.link_index("leaf")
    face = rotate(door.body.link_pose(leaf).quaternion, (0, 1, 0))
    door.body.apply_force(leaf, force * face, handle.position)


def open_by_hand(world: World, door: Door, side: str, force: float) -> float:
    """Turn the handle, then pull for 4 s; return how much of its way the door went."""
    for k in range(960):
        if door.opening.hardware != "slider" and door.angle < 0.05:
            turn_handle(door, side, force)
        if k > 60:
            pull(door, side, force)
        world.step()
    return door.angle / door.swing


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("side", ["inside", "outside"])
def test_the_force_of_the_rules_opens_each_door_all_the_way(level: int, side: str) -> None:
    force = Rules(level).figure("hardware_force")
    world, door = spawned(inner_door(level), level)
    assert open_by_hand(world, door, side, force) > 0.98


@pytest.mark.parametrize("normal", [(0, 1), (0, -1), (1, 0), (-1, 0)])
@pytest.mark.parametrize("hinge", ["low", "high"])
def test_doors_open_into_their_first_room_from_the_end_with_the_hinges(
    normal: tuple[int, int], hinge: str
) -> None:
    axis: Literal["x", "y"] = "y" if normal[0] else "x"
    end = cast(Literal["low", "high"], hinge)
    opening = replace(inner_door(2), axis=axis, normal=normal, hinge=end, centre=(1.0, 2.0))
    _, door = spawned(opening, 2)
    shut = np.array(door.frame_in_world("handle_inside").position[:2])
    along = np.array((1, 0) if axis == "x" else (0, 1))
    towards_latch = -1 if hinge == "high" else 1
    assert (shut - opening.centre) @ along * towards_latch > 0.2
    door.open(1.0)
    moved = np.array(door.frame_in_world("handle_outside").position[:2])
    assert (moved - opening.centre) @ np.array(normal) > 0.6
    slider = replace(opening, hardware="slider")
    _, panel = spawned(slider, 3)
    panel.open(1.0)
    gone = np.array(panel.frame_in_world("handle_inside").position[:2])
    assert (gone - opening.centre) @ along * towards_latch < -0.4


@pytest.mark.parametrize("level", (1, 2))
def test_a_latched_door_holds_until_its_handle_is_turned(level: int) -> None:
    world, door = spawned(inner_door(level), level)
    for _ in range(240):
        pull(door, "inside", 150.0)
        world.step()
    assert door.is_latched and door.angle < 0.004
    weak = 0.7 * Rules(level).figure("hardware_force")
    for _ in range(240):
        turn_handle(door, "inside", weak)
        pull(door, "inside", 20.0)
        world.step()
    assert door.is_latched and door.angle < 0.004, "the spring yields to too little"


def test_a_door_that_is_pushed_shut_latches_and_its_handle_springs_back() -> None:
    world, door = spawned(inner_door(2), 2)
    door.open(0.4)
    handle = door.body.joint("lever").index
    door.body.set_joints([handle], [0.7])
    assert not door.is_latched
    for _ in range(720):
        pull(door, "inside", -12.0)
        world.step()
    assert door.is_latched
    for _ in range(240):
        pull(door, "inside", 50.0)
        world.step()
    assert door.angle < 0.004
    assert abs(door.body.joint_states([handle])[0][0]) < 0.02


def test_doors_stay_where_they_are_left_among_walls() -> None:
    for level in LEVELS:
        plan, world = small_home(level), World()
        world.load_urdf(write(shell_model(plan, Palette()), melt_except=()))
        world.load_urdf(write(floor_model(plan, Rules(level), Palette()), melt_except=()))
        doors = [spawned(o, level, world)[1] for o in plan.openings.values() if o.hardware]
        doors[0].open(0.6)
        start = [np.array(d.frame_in_world("handle_inside").position) for d in doors]
        for _ in range(2400):
            world.step()
        for door, before in zip(doors, start, strict=True):
            drift = np.linalg.norm(np.array(door.frame_in_world("handle_inside").position) - before)
            assert drift < 0.001, (level, door.opening.name)
        assert doors[1].is_latched


@pytest.mark.parametrize("level", LEVELS)
def test_doors_move_clear_of_the_walls(level: int) -> None:
    plan, world = small_home(level), World()
    walls = world.load_urdf(write(shell_model(plan, Palette()), melt_except=()))
    for opening in plan.openings.values():
        if opening.hardware:
            swing = widest_swing(opening, plan) if opening.hardware != "slider" else 1.0
            door = Door(opening, Rules(level), swing=swing)
            door.spawn(world)
            for fraction in np.linspace(0, 1, 25):
                door.open(float(fraction))
                assert world.separation(door.body, walls, within=0.05) > 0.001, fraction


@pytest.mark.parametrize("level", LEVELS)
def test_an_open_door_leaves_the_clear_width_of_the_rule(level: int) -> None:
    plan, world = small_home(level), World()
    world.load_urdf(write(shell_model(plan, Palette()), melt_except=()))
    opening = plan.openings["door_1"]
    _, door = spawned(opening, level, world)
    door.open(min(1.0, 0.5 * math.pi / door.swing) if level < 3 else 1.0)
    bullet.performCollisionDetection(physicsClientId=world.client)  # or rays miss what has moved
    reach = {-1: 0.6, 1: 0.6}
    for y in (0.0, 0.03, 0.2, 0.5):  # within the wall, and beside the leaf that stands open
        start = opening.pose @ Pose((0.0, y, 1.5))
        for side in reach:
            end = opening.pose @ Pose((0.6 * side, y, 1.5))
            hit = bullet.rayTest(start.position, end.position, physicsClientId=world.client)[0]
            reach[side] = min(reach[side], 0.6 * hit[2])
    clear = sum(reach.values())
    assert clear == pytest.approx(opening.clear_width, abs=0.004)
    assert clear > Rules(level).figure("door_clear_width") - 1e-3


@pytest.mark.parametrize("level", LEVELS)
def test_handles_are_where_the_rules_want_them(level: int) -> None:
    rules = Rules(level)
    world, door = spawned(inner_door(level), level)
    for side, sign in (("inside", 1), ("outside", -1)):
        handle = door.frame(f"handle_{side}")
        assert handle.position[2] == pytest.approx(rules.figure("hardware_height"))
        assert rotate(handle.quaternion, (1, 0, 0))[1] == pytest.approx(sign)
        grasp = door.frame_in_world(f"handle_{side}").position
        near = distance_from(door, grasp, world.client)
        assert near < 0.001, "no handle there"


def distance_from(door: Door, point: tuple[float, ...], client: int) -> float:
    """Return the distance of a point from the handles and panels of a door [m]."""
    probe = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=0.001, physicsClientId=client)
    uid = bullet.createMultiBody(0, probe, -1, point, physicsClientId=client)
    found = bullet.getClosestPoints(door.body.uid, uid, 0.1, physicsClientId=client)
    bullet.removeBody(uid, physicsClientId=client)
    return min((p[8] for p in found), default=1.0)


def test_rewinding_restores_doors_and_latches_exactly() -> None:
    world, door = spawned(inner_door(2), 2)
    _, panel = spawned(replace(inner_door(3), name="panel", centre=(9.0, 0.0)), 3, world)
    for _ in range(5):  # a mark between two looks at the latch
        world.step()
    world.mark_start()

    def episode() -> list[float]:
        trace = []
        for k in range(300):
            if k < 60:
                turn_handle(door, "inside", 20.0)
            pull(door, "inside", 15.0)
            pull(panel, "inside", 5.0)
            world.step()
            trace += [door.angle, panel.angle, float(door.is_latched)]
        return trace

    first = episode()
    assert not door.is_latched and door.angle > 0.2
    world.rewind()
    assert door.is_latched and door.angle == pytest.approx(0.0, abs=1e-6)
    assert episode() == first


def test_opening_at_once_frees_the_latch_and_shutting_sets_it() -> None:
    world, door = spawned(inner_door(2), 2)
    door.open(0.5)
    assert door.angle == pytest.approx(0.5 * door.swing) and not door.is_latched
    door.open(0.0)
    assert door.is_latched and door.angle == 0
    for _ in range(20):
        world.step()
    assert door.is_latched


def test_a_wall_beside_the_hinges_limits_the_swing() -> None:
    plan = small_home(2)
    free = plan.openings["door_1"]
    near = replace(free, centre=(free.centre[0], 4.0 - 0.5 * free.width), hinge="high")
    assert widest_swing(near, plan) < 0.5 * math.pi < widest_swing(free, plan) <= 1.7


def test_impossible_doors_say_so() -> None:
    passage = small_home(2).openings["passage_1"]
    with pytest.raises(ConfigError, match="knob, lever or slider"):
        door_model(passage, Rules(2), Palette())
    _, door = spawned(inner_door(2), 2)
    with pytest.raises(ActionError, match="fraction"):
        door.open(1.5)
