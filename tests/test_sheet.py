"""Sheets: the same core with distance and bending constraints alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from rcare_marl.body import Body
from rcare_marl.pose import Pose
from rcare_marl.soft.hinge import Hinges, fold, hinges
from rcare_marl.soft.material import Material
from rcare_marl.soft.soft_body import SoftBody
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.soft.spring import Springs, edges
from rcare_marl.world import GRAVITY, World

Array = npt.NDArray[np.float64]


def sheet_mesh(columns: int, rows: int, size: float) -> tuple[Array, npt.NDArray[np.int32]]:
    """Return particles and faces of a sheet in the plane z = 0, its first row at y = 0."""
    x, y = np.meshgrid(size * np.arange(columns), -size * np.arange(rows))
    points = np.stack((x.ravel(), y.ravel(), np.zeros(x.size)), axis=1)
    at = np.arange(x.size).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel()
    faces = np.concatenate((np.stack((a, c, b), 1), np.stack((b, c, d), 1)))
    return points, faces.astype(np.int32)


def add_sheet(
    world: World, *, bending: float, columns: int = 9, rows: int = 13
) -> tuple[SoftBody, Body]:
    """Hang a sheet of 0.1 kg by its first row onto a body."""
    points, faces = sheet_mesh(columns, rows, 0.02)
    points[:, 2] = 1.0
    masses = np.full(len(points), 0.1 / len(points))
    sheet = SoftBody(
        "sheet", points, faces=faces, masses=masses, falls=True, substeps=20,
        material=Material(1e5, 0.3, damping_per_s=4.0),
        springs=Springs(points, edges(faces), stiffness=500.0),
        hinges=Hinges(points, hinges(faces), stiffness=bending),
    )  # fmt: skip
    rail = world.add_box((0.3, 0.01, 0.01), Pose((0.08, 0, 1.0)), collides=False)
    sheet.pin(range(columns), rail, -1, world.client)
    SoftWorld.of(world).add(sheet)
    return sheet, rail


def test_a_sheet_hangs_by_its_weight_and_hardly_stretches() -> None:
    world = World()
    sheet, _ = add_sheet(world, bending=1e-5)
    for _ in range(720):
        world.step()
    ((_, _, force, _),) = sheet.pin_loads()
    free = 12 / 13 * 0.1  # the pinned row is the rail's to carry
    assert force[2] == pytest.approx(-free * GRAVITY, rel=0.03)
    assert sheet.positions[:, 2].min() == pytest.approx(1.0 - 0.24, abs=0.02)
    pairs = edges(sheet.faces)
    lengths = np.linalg.norm(np.diff(sheet.positions[pairs], axis=1)[:, 0], axis=1)
    rest = np.linalg.norm(np.diff(sheet.rest[pairs], axis=1)[:, 0], axis=1)
    assert (lengths / rest).max() < 1.05


def test_a_stiffer_sheet_bends_less() -> None:
    tips = []
    for bending in (1e-4, 0.3):
        world = World()
        sheet, _ = add_sheet(world, bending=bending, columns=4, rows=6)
        # Two pinned rows clamp it: it sticks out sideways like a board.
        rail = world.add_box((0.3, 0.01, 0.01), Pose((0.08, 0, 1.0)), collides=False)
        sheet.pin(range(4, 8), rail, -1, world.client)
        for _ in range(360):
            world.step()
        tips.append(1.0 - sheet.positions[-1, 2])
    assert tips[0] > 0.05
    assert tips[1] < 0.2 * tips[0]


def test_a_sheet_lies_on_a_ball() -> None:
    world = World()
    points, faces = sheet_mesh(9, 9, 0.02)
    points += (-0.08, 0.08, 0.12)
    sheet = SoftBody(
        "sheet", points, faces=faces, masses=np.full(81, 0.001), falls=True, substeps=10,
        material=Material(1e5, 0.3, damping_per_s=4.0, friction=1.0),
        springs=Springs(points, edges(faces), stiffness=300.0),
    )  # fmt: skip
    SoftWorld.of(world).add(sheet)
    ball = world.add_sphere(0.1, Pose((0, 0, 0)))
    for _ in range(240):
        world.step()
    distance = np.linalg.norm(sheet.positions, axis=1)
    assert distance.min() > 0.0995
    assert np.linalg.norm(sheet.positions[:, :2].mean(axis=0)) < 0.02
    assert sheet.force_on(ball)[2] == pytest.approx(-0.081 * GRAVITY, rel=0.1)


def test_a_pinned_sheet_follows_its_link() -> None:
    world = World()
    sheet, rail = add_sheet(world, bending=1e-5, columns=4, rows=4)
    for k in range(60):
        rail.set_base(Pose((0.08, 0, 1.0 + 0.002 * (k + 1))))
        world.step()
    assert sheet.positions[:4, 2] == pytest.approx(np.full(4, 1.12), abs=1e-4)


def test_the_slope_of_a_fold_is_exact() -> None:
    rng = np.random.default_rng(0)
    member, scratch, slope = np.arange(4, dtype=np.int32), np.empty((4, 3)), np.empty((4, 3))
    for _ in range(5):
        x = rng.normal(size=(4, 3))
        fold(x, member, slope)
        for i in range(4):
            for a in range(3):
                step = np.zeros((4, 3))
                step[i, a] = 1e-6
                rise = fold(x + step, member, scratch) - fold(x - step, member, scratch)
                assert slope[i, a] == pytest.approx(rise / 2e-6, abs=1e-6)
