"""Cloth: what it weighs, how it stretches and bends, and that it stays on the side where it is."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
import pybullet as bullet
import pytest

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, WorldError
from rcare_marl.model.urdf import Link, Model
from rcare_marl.pose import Pose, quaternion_from_axis_angle
from rcare_marl.soft.cloth import Cloth
from rcare_marl.soft.constraint import FOLD_SOFTNESS, make_constraints
from rcare_marl.soft.material import Fabric
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.world import GRAVITY, World

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]
Grid = npt.NDArray[np.intp]

JERSEY = Fabric(0.17, 200.0, 120.0, 30.0, 5e-6)
SIDEWAYS = (0.0, 0.5**0.5, 0.0, 0.5**0.5)  # a capsule along x


def sheet(nx: int, ny: int, size: float) -> tuple[Array, Indices, Grid]:
    """Return particles, faces and their grid of a sheet in the plane, its middle at the origin."""
    grid = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
    x, y = np.meshgrid(
        (np.arange(nx + 1) - nx / 2) * size, (np.arange(ny + 1) - ny / 2) * size, indexing="ij"
    )
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    faces = []
    for i in range(nx):
        for j in range(ny):
            a, b, c, d = grid[i, j], grid[i + 1, j], grid[i + 1, j + 1], grid[i, j + 1]
            even = [[a, b, c], [a, c, d]]
            faces += even if (i + j) % 2 == 0 else [[a, b, d], [b, c, d]]
    return points, np.array(faces, np.int32), grid


def lay(
    world: World,
    nx: int,
    ny: int,
    size: float,
    *,
    at: Array,
    fabric: Fabric = JERSEY,
    upright: bool = False,
    turn: float = 0.0,
) -> tuple[Cloth, Grid]:
    """Put a sheet into a world, its middle at a point; `upright` with its second axis downwards."""
    points, faces, grid = sheet(nx, ny, size)
    placed = points.copy()
    if upright:
        placed = np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)
    if turn:
        c, s = np.cos(turn), np.sin(turn)
        placed = placed @ np.array(((c, 0, -s), (0, 1, 0), (s, 0, c)))
    cloth = Cloth(
        "sheet", points, faces, fabric=fabric, grain=(0.0, 1.0, 0.0), positions=placed + at
    )
    SoftWorld.of(world).add(cloth)
    return cloth, grid


BARE = Model("bare", "", {"base": Link()})


def add_capsule(world: World, radius: float, length: float, at: tuple[float, ...]) -> Body:
    """Put an immovable capsule along x into a world."""
    shape = bullet.createCollisionShape(
        bullet.GEOM_CAPSULE, radius=radius, height=length, physicsClientId=world.client
    )
    uid = bullet.createMultiBody(0, shape, -1, at, SIDEWAYS, physicsClientId=world.client)
    return world._register(uid, "capsule", BARE)


def hung(world: World, fabric: Fabric, nx: int, ny: int, size: float) -> tuple[Cloth, Grid]:
    """Return a sheet that hangs on a post by its first row."""
    cloth, grid = lay(world, nx, ny, size, at=np.array((0, 0, 1.0)), fabric=fabric, upright=True)
    post = world.add_box((0.01,) * 3, Pose((0, 0, 1.5)), collides=False)
    cloth.hold(grid[:, 0], post, -1, force=1e3, stiffness=1e5)
    return cloth, grid


def energy(cloth: Cloth) -> float:
    """Return kinetic, gravitational and elastic energy [J]."""
    masses, constraints = 1 / cloth.points[:, 3], cloth.constraints
    total = float((masses * (0.5 * (cloth.velocities**2).sum(axis=1))).sum())
    total += float((masses * GRAVITY * cloth.positions[:, 2]).sum())
    longer = cloth.strain * constraints.thread_table[:, 0]
    total += float((0.5 * longer**2 / constraints.thread_table[:, 1]).sum())
    bent = np.einsum(
        "fk,fka->fa", constraints.fold_table[:, :4], cloth.positions[constraints.folds]
    )
    return total + float(
        (0.5 * (bent**2).sum(axis=1) / constraints.fold_table[:, FOLD_SOFTNESS]).sum()
    )


def test_cloth_hung_on_a_link_reads_its_weight() -> None:
    world = World()
    cloth, _ = hung(world, JERSEY, 10, 12, 0.03)
    for _ in range(480):
        world.step()
    weight = 0.17 * 0.30 * 0.36 * GRAVITY
    assert cloth.mass * GRAVITY == pytest.approx(weight)
    assert cloth.grips[0].pull == pytest.approx([0, 0, -weight], abs=0.05 * weight)


def test_cloth_that_lies_on_a_body_presses_with_its_weight() -> None:
    world = World()
    table = world.add_box((0.6, 0.6, 0.1))
    cloth, _ = lay(world, 12, 12, 0.03, at=np.array((0, 0, 0.06)))
    for _ in range(360):
        world.step()
    weight = cloth.mass * GRAVITY
    assert cloth.force_on(table) == pytest.approx([0, 0, -weight], abs=0.02 * weight)
    assert world.contact_force(table) == pytest.approx(weight, rel=0.02)
    assert cloth.contacts[0].load == pytest.approx(weight, rel=0.02)
    assert cloth.contacts[0].point == pytest.approx([0, 0, 0.054], abs=5e-3)


@pytest.mark.parametrize("stiffness", [30.0, 100.0, 200.0])
def test_a_hanging_strip_stretches_as_its_figures_say(stiffness: float) -> None:
    world = World()
    fabric = dataclasses.replace(
        JERSEY, stretch_warp_n_m=stiffness, shear_n_m=1e-3, damping_per_s=3.0
    )
    cloth, grid = hung(world, fabric, 4, 20, 0.02)
    for _ in range(720):
        world.step()
    z = cloth.positions[:, 2]
    longer = z[grid[:, 0]].mean() - z[grid[:, -1]].mean() - 0.4
    assert longer == pytest.approx(0.17 * GRAVITY * 0.4**2 / (2 * stiffness), rel=0.1)


def test_bending_costs_what_a_plate_of_its_stiffness_takes() -> None:
    points, faces, _ = sheet(20, 20, 0.01)
    constraints = make_constraints(
        points, faces, np.tile((0.0, 1.0, 0.0), (len(points), 1)), JERSEY
    )
    angle = points[:, 0] / 0.05  # rolled onto a cylinder of 5 cm radius
    rolled = np.stack([0.05 * np.sin(angle), points[:, 1], 0.05 * np.cos(angle)], axis=1)
    bent = np.einsum("fk,fka->fa", constraints.fold_table[:, :4], rolled[constraints.folds])
    got = float((0.5 * (bent**2).sum(axis=1) / constraints.fold_table[:, FOLD_SOFTNESS]).sum())
    assert got == pytest.approx(0.5 * JERSEY.bending_nm / 0.05**2 * 0.2 * 0.2, rel=0.1)
    flat = np.einsum("fk,fka->fa", constraints.fold_table[:, :4], points[constraints.folds])
    assert np.abs(flat).max() < 1e-12


def test_shear_costs_what_the_figure_says() -> None:
    points, faces, _ = sheet(20, 20, 0.01)
    constraints = make_constraints(
        points, faces, np.tile((0.0, 1.0, 0.0), (len(points), 1)), JERSEY
    )
    sheared = points + np.outer(0.02 * points[:, 1], (1, 0, 0))
    ends = sheared[constraints.threads]
    longer = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) - constraints.thread_table[:, 0]
    got = float((0.5 * longer**2 / constraints.thread_table[:, 1]).sum())
    assert got == pytest.approx(0.5 * JERSEY.shear_n_m * 0.02**2 * 0.2 * 0.2, rel=0.05)


def test_cloth_rests_on_a_leg_and_nothing_of_it_is_inside() -> None:
    world = World()
    world.add_box((4, 4, 0.1), Pose((0, 0, -0.05)))
    add_capsule(world, 0.07, 0.4, (0, 0, 0.3))
    cloth, _ = lay(world, 20, 20, 0.03, at=np.array((0, 0, 0.4)))
    for step in range(720):
        world.step()
        if step % 24 == 0 or step > 600:
            p = cloth.positions
            across = np.hypot(p[:, 1], p[:, 2] - 0.3)
            gap = np.hypot(across, np.maximum(np.abs(p[:, 0]) - 0.2, 0)) - 0.07
            assert gap.min() > 0
            assert p[:, 2].min() > 0
    assert np.abs(cloth.velocities).mean() < 0.05
    assert cloth.positions[:, 2].max() > 0.36  # it has not slid off


def pierced(cloth: Cloth, start: Array, end: Array) -> bool:
    """Whether a segment goes through any face."""
    a, b, c = (cloth.positions[cloth.faces[:, k]] for k in range(3))
    way = end - start

    def volume(p: Array, q: Array, r: Array, s: Array) -> Array:
        return np.einsum("ij,ij->i", np.cross(q - p, r - p), s - p)

    first, last = np.broadcast_to(start, a.shape), np.broadcast_to(start + way, a.shape)
    crosses = volume(a, b, c, first) * volume(a, b, c, last) < 0
    signs = [volume(first, last, *pair) > 0 for pair in ((a, b), (b, c), (c, a))]
    return bool((crosses & (signs[0] == signs[1]) & (signs[1] == signs[2])).any())


@pytest.mark.parametrize("is_set", [True, False], ids=["set from pose to pose", "driven"])
def test_a_leg_at_a_metre_per_second_does_not_tunnel(is_set: bool) -> None:
    world = World()
    cloth, grid = hung(world, JERSEY, 24, 16, 0.025)
    foot = world.add_box((0.01,) * 3, Pose((0, 0, 0.5)), collides=False)
    cloth.hold(grid[:, -1], foot, -1, force=1e3, stiffness=1e5)  # stretched between two bars
    if is_set:
        leg = add_capsule(world, 0.05, 0.3, (0, -0.2, 1.0))
    else:
        shape = bullet.createCollisionShape(
            bullet.GEOM_CAPSULE, radius=0.05, height=0.3, physicsClientId=world.client
        )
        uid = bullet.createMultiBody(
            20.0, shape, -1, (0, -0.2, 1.0), SIDEWAYS, physicsClientId=world.client
        )
        leg = world._register(uid, "leg", BARE)
    for step in range(84):
        if is_set:
            leg.set_base(Pose((0, -0.2 + (step + 1) / 240, 1.0), SIDEWAYS))
        else:
            bullet.resetBaseVelocity(uid, (0, 1, 0), (0, 0, 0), physicsClientId=world.client)
        world.step()
        at = np.array(leg.centre_pose()[0])
        assert not pierced(cloth, at - (0.15, 0, 0), at + (0.15, 0, 0))
    assert cloth.force_on(leg)[1] < -1.0
    assert cloth.positions[:, 1].max() > 0.15  # it went along


def slid(tilt: float) -> float:
    """Return how far a patch slides in a second on a slope [m]."""
    world = World()
    turn = quaternion_from_axis_angle((0.0, 1.0, 0.0), tilt)
    slope = world.add_box((3.0, 1.0, 0.1), Pose((0, 0, 0), tuple(turn.tolist())))
    slope.set_friction([-1], lateral=0.5)
    normal = np.array((np.sin(tilt), 0, np.cos(tilt)))
    fabric = dataclasses.replace(JERSEY, friction=1.0)
    cloth, _ = lay(world, 6, 6, 0.03, at=0.0541 * normal, fabric=fabric, turn=tilt)
    start = cloth.positions.mean(axis=0)
    for _ in range(240):
        world.step()
    return float(np.linalg.norm(cloth.positions.mean(axis=0) - start))


def test_friction_holds_below_its_angle_and_not_above() -> None:
    steepest = np.arctan(0.5)
    assert slid(steepest - 0.06) < 0.002
    assert slid(steepest + 0.06) > 0.1


def test_a_hold_lifts_cloth_and_lets_it_go() -> None:
    world = World()
    world.add_box((2, 2, 0.1), Pose((0, 0, -0.05)))
    hand = world.add_sphere(0.01, Pose((0, 0, 0.01)), collides=False)
    cloth, _ = lay(world, 12, 12, 0.03, at=np.array((0, 0, 0.005)))
    grip = cloth.grasp(hand, -1, 0.05)
    assert 5 <= len(grip.particles) <= 13
    for step in range(480):
        hand.set_base(Pose((0, 0, 0.01 + 0.5 * min(step / 240, 1))))
        world.step()
    assert cloth.positions[:, 2].min() > 0.15
    assert grip.load == pytest.approx(cloth.mass * GRAVITY, rel=0.05)
    cloth.release(grip)
    assert not grip.is_active
    assert not cloth.grips
    for _ in range(360):
        world.step()
    assert cloth.positions[:, 2].mean() < 0.05


def test_a_hold_gives_way_beyond_its_force() -> None:
    world = World()
    cloth, grid = hung(world, JERSEY, 8, 8, 0.03)
    hand = world.add_sphere(0.01, Pose((0, 0, 0.88)), collides=False)
    grip = cloth.hold(grid[3:6, -1], hand, -1, force=2.0)
    most = 0.0
    for step in range(240):
        hand.set_base(Pose((0, 0, 0.88 - 0.3 * step / 240)))
        world.step()
        most = max(most, grip.load)
    assert 1.5 < most < 2.2
    assert not grip.is_active


@pytest.mark.parametrize("limit", [None, 0.25])
def test_cloth_tears_only_where_that_is_asked_for(limit: float | None) -> None:
    world = World()
    fabric = dataclasses.replace(JERSEY, tear_strain=limit)
    cloth, grid = hung(world, fabric, 8, 12, 0.03)
    hand = world.add_sphere(0.01, Pose((0, 0, 0.82)), collides=False)
    cloth.hold(grid[:, -1], hand, -1, force=500.0, stiffness=1e5)
    count, mass = len(cloth.rest), cloth.mass
    world.mark_start()
    for step in range(360):
        hand.set_base(Pose((0, 0, 0.82 - 0.4 * step / 240)))
        world.step()
    assert np.isfinite(cloth.positions).all()
    assert cloth.mass == pytest.approx(mass)
    assert (cloth.tears > 0) == (limit is not None)
    assert len(cloth.rest) == count + cloth.tears
    if limit is not None:
        assert np.linalg.norm(cloth.grips[1].pull) < 0.5  # torn apart, nothing pulls back
    assert len(world.skins[0].vertices()) == len(world.skins[0].colors)
    world.rewind()
    assert len(cloth.rest) == count
    assert cloth.tears == 0


def test_the_same_happens_after_a_rewind() -> None:
    world = World()
    world.add_box((4, 4, 0.1), Pose((0, 0, -0.05)))
    ball = world.add_sphere(0.05, Pose((0.02, 0, 0.5)), mass=0.3)
    cloth, grid = hung(world, JERSEY, 12, 12, 0.03)
    other, _ = lay(world, 8, 8, 0.03, at=np.array((0.05, 0.01, 0.6)))
    for _ in range(30):
        world.step()
    world.mark_start()
    runs = []
    for _ in range(2):
        cloth.grasp(ball, -1, 0.3)
        for step in range(60):
            world.step()
            if step == 30:
                cloth.release(cloth.grips[0])
        runs.append((cloth.positions.copy(), other.positions.copy(), ball.base_pose()))
        world.rewind()
    assert (runs[0][0] == runs[1][0]).all()
    assert (runs[0][1] == runs[1][1]).all()
    assert runs[0][2] == runs[1][2]
    assert len(cloth.grips) == 1  # the one that was marked holds again


def test_violent_pulls_break_nothing() -> None:
    world = World()
    world.add_box((4, 4, 0.1), Pose((0, 0, -0.05)))
    add_capsule(world, 0.07, 0.4, (0, 0, 0.3))
    cloth, grid = lay(world, 16, 16, 0.03, at=np.array((0, 0, 0.4)))
    hands = [world.add_sphere(0.01, collides=False) for _ in range(3)]
    rng = np.random.default_rng(1)
    corners = (grid[0, 0], grid[0, -1], grid[-1, 0])
    for hand, corner in zip(hands, corners, strict=True):
        hand.set_base(Pose(tuple(cloth.positions[corner].tolist())))
        cloth.grasp(hand, -1, 0.05, force=100.0)
    for step in range(480):
        if step % 10 == 0:
            for hand in hands:
                hand.set_base(Pose(tuple(rng.uniform((-1, -1, 0), (1, 1, 1)).tolist())))
        world.step()
        assert np.isfinite(cloth.positions).all()
        assert np.abs(cloth.velocities).max() < 12.1
    for _ in range(480):  # and it comes to rest unharmed
        world.step()
        cloth.release()
    assert cloth.strain.max() < 0.3
    assert np.abs(cloth.velocities).mean() < 0.1


def test_cloth_left_alone_gains_no_energy() -> None:
    world = World()
    fabric = dataclasses.replace(JERSEY, damping_per_s=0.0)
    cloth, grid = lay(world, 12, 12, 0.03, at=np.array((0, 0, 1.0)), fabric=fabric)
    post = world.add_box((0.01,) * 3, Pose((0, 0, 1.5)), collides=False)
    cloth.hold(grid[0], post, -1, force=1e3, stiffness=1e5)
    world.step()
    before = energy(cloth)
    swing = cloth.mass * GRAVITY * 0.18
    for _ in range(480):
        world.step()
        after = energy(cloth)
        assert after < before + 1e-3 * swing
        before = min(before, after)


def test_cloth_does_not_pass_through_itself() -> None:
    world = World()
    world.add_box((4, 4, 0.1), Pose((0, 0, -0.05)))
    points, faces, _ = sheet(10, 30, 0.03)
    folded = points.copy()  # in a U: the upper half falls onto the lower
    upper = points[:, 1] > 0
    folded[upper, 1] *= -1
    folded[:, 2] = 0.01 + 0.15 * upper
    cloth = SoftWorld.of(world).add(
        Cloth("fold", points, faces, fabric=JERSEY, grain=(0, 1, 0), positions=folded)
    )
    for _ in range(360):
        world.step()
    far = points[:, 1] > 0.2
    near = points[:, 1] < -0.2
    assert cloth.positions[far, 2].mean() > cloth.positions[near, 2].mean() + 0.005


def test_a_light_body_is_pulled_along() -> None:
    world = World()
    cloth, grid = hung(world, JERSEY, 8, 8, 0.03)
    bob = world.add_sphere(0.02, Pose((0, 0, 0.86)), mass=0.1, collides=False)
    grip = cloth.grasp(bob, -1, 0.05)
    for _ in range(720):
        world.step()
    assert 0.6 < bob.base_pose().position[2] < 0.86
    assert grip.pull[2] == pytest.approx(0.1 * GRAVITY, rel=0.05)


@pytest.mark.parametrize("mass", [0.05, 0.3])
def test_a_ball_on_stretched_cloth_is_carried(mass: float) -> None:
    world = World()
    fabric = dataclasses.replace(JERSEY, damping_per_s=20.0)
    cloth, grid = lay(world, 14, 14, 0.03, at=np.array((0, 0, 1.0)), fabric=fabric)
    frame = world.add_box((0.01,) * 3, Pose((0, 0, 1.5)), collides=False)
    edge = np.unique(np.concatenate((grid[0], grid[-1], grid[:, 0], grid[:, -1])))
    cloth.hold(edge, frame, -1, force=1e3, stiffness=1e5)
    ball = world.add_sphere(0.05, Pose((0, 0, 1.054)), mass=mass)
    for _ in range(720):
        world.step()
    forces = []
    for _ in range(240):
        world.step()
        forces.append(cloth.force_on(ball))
    assert np.mean(forces, axis=0) == pytest.approx(
        [0, 0, mass * GRAVITY], abs=0.05 * mass * GRAVITY
    )
    assert 0.85 < ball.base_pose().position[2] < 1.05
    gap = np.linalg.norm(cloth.positions - ball.base_pose().position, axis=1) - 0.05
    assert gap.min() > 0


def test_what_cannot_be_cloth_is_refused() -> None:
    points, faces, _ = sheet(2, 2, 0.05)
    with pytest.raises(ConfigError, match="belongs to no face"):
        Cloth("lone", np.vstack((points, (1, 1, 1))), faces, fabric=JERSEY)
    with pytest.raises(ConfigError, match="no area"):
        Cloth("flat", points * (1, 0, 0), faces, fabric=JERSEY)
    with pytest.raises(ConfigError, match="substeps"):
        Cloth("none", points, faces, fabric=JERSEY, substeps=0)
    with pytest.raises(ConfigError, match="area_density"):
        Fabric(0.0, 1.0, 1.0, 1.0, 1.0)
    world = World()
    box = world.add_box((0.1,) * 3)
    with pytest.raises(WorldError, match="SoftWorld"):
        Cloth("loose", points, faces, fabric=JERSEY).grasp(box, -1, 0.1)
