"""A sponge reads what it is pressed with, gives it back, yields and recovers."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rcare_marl.body import Body
from rcare_marl.envs.devices import Sponge
from rcare_marl.errors import ConfigError, WorldError
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.soft.tetrahedron import boundary, make_block, signed_volumes
from rcare_marl.world import GRAVITY, World

DOWN = tuple(quaternion_from_rpy(math.pi, 0, 0).tolist())
FACE = Sponge().frame("face").position[2]


def over_table(gap: float = 0.0) -> tuple[World, Body, Sponge]:
    """Return a sponge whose face is so far above a table that nothing moves."""
    world = World()
    table = world.add_box((1, 1, 0.1), Pose((0, 0, -0.05)), name="table")
    sponge = Sponge()
    sponge.spawn(world, Pose((0, 0, FACE + gap), DOWN))
    return world, table, sponge


def press(world: World, sponge: Sponge, force: float, steps: int) -> None:
    for _ in range(steps):
        sponge.body.apply_force(-1, (0, 0, -force), sponge.body.centre_pose()[0])
        world.step()


@pytest.mark.parametrize("force", [1.0, 5.0, 12.0])
def test_a_sponge_reads_the_force_that_it_is_pressed_with(force: float) -> None:
    world, table, sponge = over_table()
    press(world, sponge, force, 360)
    expected = force + sponge.body.mass() * GRAVITY
    assert -sponge.force_on(table)[2] == pytest.approx(expected, rel=0.02)
    assert world.contact_force(table) == pytest.approx(expected, rel=0.02)
    assert np.abs(sponge.force_on(table)[:2]).max() < 0.01 * expected


def test_the_harder_it_is_pressed_the_more_it_yields() -> None:
    heights = []
    for force in (0.0, 5.0, 10.0):
        world, _, sponge = over_table()
        press(world, sponge, force, 300)
        heights.append(sponge.pose.position[2])
    assert heights[0] > heights[1] + 0.001 > heights[2] + 0.002
    assert FACE - heights[2] < 0.5 * sponge.block.size[2]


def test_flesh_beneath_yields_as_its_stiffness_says_and_changes_no_force() -> None:
    stiffness = 1e6
    world, table, sponge = over_table()
    SoftWorld.of(world).set_foundation(table, -1, stiffness)
    press(world, sponge, 7.0, 400)
    load = -sponge.force_on(table)[2]
    assert load == pytest.approx(7.0 + sponge.body.mass() * GRAVITY, rel=0.02)
    depths = -sponge.face_points()[:, 2]
    assert depths.min() > 0
    assert float(sponge.soft.areas[-54:] @ depths) * stiffness == pytest.approx(load, rel=0.1)


def test_flesh_has_no_negative_stiffness() -> None:
    world, table, _ = over_table()
    with pytest.raises(ConfigError, match="stiffness of flesh"):
        SoftWorld.of(world).set_foundation(table, -1, -1.0)


def test_a_sponge_carries_what_lies_on_it_and_feels_its_weight() -> None:
    world = World()
    sponge = Sponge()
    sponge.spawn(world, Pose((0, 0, 0.5)))
    frame = world.add_box((0.1, 0.1, 0.1), Pose((0, 0, 0.2)), name="frame")
    world.attach(frame, "base", sponge.body)
    weight = world.add_box((0.1, 0.06, 0.05), Pose((0, 0, 0.5 + FACE + 0.026)), mass=1.0)
    for _ in range(480):
        world.step()
    assert sponge.force_on(weight)[2] == pytest.approx(GRAVITY, rel=0.05)
    assert weight.base_pose().position[2] > 0.5 + FACE - 0.01


def test_a_sponge_drags_what_it_wipes_no_harder_than_friction_lets_it() -> None:
    world, table, sponge = over_table(gap=0.001)
    frame = world.add_box((0.1, 0.1, 0.1), Pose((0, 0, 0.4)), name="frame")
    world.attach(frame, "base", sponge.body)
    pressed = []
    for step in range(240):  # the table rises by 4 mm, then slides at 0.1 m/s
        along = max(step - 60, 0) * 0.1 * world.physics_dt
        table.set_base(Pose((along, 0.0, -0.05 + 0.004 * min(step / 40, 1.0))))
        world.step()
        pressed.append(-sponge.force_on(table))
    x, z = np.mean(pressed[120:], axis=0)[[0, 2]]
    coefficient = sponge.block.material.friction * 0.5  # Bullet's friction of a box
    assert 0.5 * coefficient < x / z < 1.1 * coefficient


def test_a_crushed_sponge_comes_back_to_its_shape() -> None:
    world, _, sponge = over_table()
    press(world, sponge, 150.0, 60)
    assert sponge.soft.least_volume_ratio() < 0.5
    sponge.body.set_base(Pose((0, 0, 0.5), DOWN))
    for _ in range(60):
        sponge.body.set_base(Pose((0, 0, 0.5), DOWN))
        world.step()
    assert sponge.soft.deviation() < 5e-4
    assert sponge.soft.least_volume_ratio() > 0.9


def test_a_sponge_far_from_everything_is_not_simulated() -> None:
    world, table, sponge = over_table(gap=0.5)
    world.step()
    assert not sponge.soft.is_awake
    assert not sponge.force_on(table).any()


def test_a_sponge_passes_through_the_hand_that_holds_it() -> None:
    world, table, sponge = over_table()
    sponge.spare(table)
    press(world, sponge, 0.0, 24)
    assert not sponge.force_on(table).any()
    assert sponge.pose.position[2] < FACE - 0.02


def test_the_same_presses_after_a_rewind_give_the_same_forces() -> None:
    world, table, sponge = over_table()
    world.mark_start()
    runs = []
    for _ in range(2):
        world.rewind()
        press(world, sponge, 6.0, 100)
        runs.append((sponge.force_on(table).tobytes(), sponge.face_points().tobytes()))
    assert runs[0] == runs[1]


def test_face_points_lie_on_the_face() -> None:
    _, _, sponge = over_table(gap=0.3)
    points = sponge.face_points()
    assert points.shape == (54, 3)
    assert points[:, 2] == pytest.approx(0.3, abs=1e-5)
    assert np.ptp(points, axis=0)[:2] == pytest.approx(sponge.block.size[:2], abs=1e-5)


def test_renderers_see_sponge_and_plate() -> None:
    world, _, sponge = over_table(gap=0.3)
    skin = world.skins[-1]
    assert np.ptp(skin.vertices(), axis=0) == pytest.approx(sponge.block.size, abs=1e-4)
    assert len(skin.colors) == len(skin.vertices())
    assert skin.body is not sponge.body  # whose own shapes would be hidden


def test_a_sponge_in_no_world_says_so() -> None:
    with pytest.raises(WorldError, match="spawn it first"):
        _ = Sponge().soft


def test_a_sponge_weighs_more_than_its_foam() -> None:
    with pytest.raises(ConfigError, match="weighs more"):
        Sponge(block=dataclasses.replace(Sponge().block, size=(0.2, 0.2, 0.04)))
    with pytest.raises(ConfigError, match="has a size"):
        dataclasses.replace(Sponge().block, size=(0.1, 0.0, 0.04))


def test_a_block_is_filled_by_its_tetrahedra() -> None:
    size, cells = (0.3, 0.2, 0.1), (3, 4, 2)
    positions, tetrahedra = make_block(size, cells)
    assert len(tetrahedra) == 5 * 3 * 4 * 2
    volumes = signed_volumes(positions, tetrahedra)
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(0.3 * 0.2 * 0.1)
    assert len(boundary(tetrahedra)) == 2 * 2 * (3 * 4 + 3 * 2 + 4 * 2)  # no cracks inside
    assert (positions[: 4 * 5, 2] == 0).all()
    assert positions[-4 * 5 :, 2] == pytest.approx(0.1)


@pytest.mark.parametrize("size, cells", [((0.1, 0.1, 0.0), (1, 1, 1)), ((0.1,) * 3, (1, 0, 1))])
def test_a_block_without_extent_is_refused(size: tuple[float, ...], cells: tuple[int, ...]) -> None:
    with pytest.raises(ConfigError, match="three edges"):
        make_block(size, cells)
