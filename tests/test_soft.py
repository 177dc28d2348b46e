"""Soft matter: what it weighs, how it yields, and that it pushes as hard as it is pushed."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pybullet as bullet
import pytest

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import Link, Model
from rcare_marl.pose import Pose, quaternion_from_axis_angle
from rcare_marl.soft import contact
from rcare_marl.soft.collider import WORLD_FRAME, Colliders, NearShapes
from rcare_marl.soft.constraint import colours
from rcare_marl.soft.material import Material
from rcare_marl.soft.soft_body import SoftBody
from rcare_marl.soft.soft_object import Carrier
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.soft.tetrahedron import (
    SPARE,
    Tetrahedra,
    add_elastic_forces,
    boundary,
    signed_volumes,
)
from rcare_marl.world import GRAVITY, World

Array = npt.NDArray[np.float64]

WIDTH, HEIGHT = 0.12, 0.03  # [m] of the pad
FLESH = Material(30e3, 0.45, 1050.0, damping_per_s=60.0, damping_s=0.0015, friction=0.8)
RADIUS = 0.02  # [m] of the sphere that presses

_EVEN = ((0, 4, 2, 1), (6, 2, 4, 7), (5, 1, 4, 7), (3, 2, 1, 7), (1, 2, 4, 7))
_ODD = ((4, 0, 5, 6), (2, 0, 6, 3), (1, 0, 3, 5), (7, 6, 5, 3), (0, 6, 5, 3))


def pad_mesh(
    cells: tuple[int, int, int] = (10, 10, 3),
) -> tuple[Array, npt.NDArray[np.int32], npt.NDArray[np.intp]]:
    """Return particles, tetrahedra and the particles at the bottom of a pad, its top at z = 0."""
    nx, ny, nz = cells
    grid = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nx + 1, ny + 1, nz + 1)
    axes = (
        np.linspace(-WIDTH / 2, WIDTH / 2, nx + 1),
        np.linspace(-WIDTH / 2, WIDTH / 2, ny + 1),
        np.linspace(-HEIGHT, 0, nz + 1),
    )
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    rows = []
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                corner = [grid[i + a, j + b, k + c] for a in (0, 1) for b in (0, 1) for c in (0, 1)]
                pattern = _EVEN if (i + j + k) % 2 == 0 else _ODD
                rows.extend([[corner[p] for p in tetrahedron] for tetrahedron in pattern])
    tetrahedra = np.array(rows, np.int32)
    flipped = signed_volumes(points, tetrahedra) < 0
    tetrahedra[flipped] = tetrahedra[flipped][:, [0, 2, 1, 3]]
    return points, tetrahedra, grid[:, :, 0].ravel()


def add_pad(
    world: World, *, material: Material = FLESH, pose: Pose = Pose(), substeps: int = 5
) -> SoftBody:
    """Put a pad onto an immovable block."""
    points, tetrahedra, bottom = pad_mesh()
    block = world.add_box((0.01, 0.01, 0.01), pose, collides=False, name="block")
    pad = SoftBody(
        "pad",
        points,
        material=material,
        tetrahedra=tetrahedra,
        held=bottom,
        carrier=Carrier(block, -1),
        mass_factor=8.0,
        substeps=substeps,
    )
    SoftWorld.of(world).add(pad)
    return pad


def lower(
    world: World, body: Body, start: float, stop: float, steps: int, *, rest: int = 60
) -> None:
    """Move a body down from `start` to `stop` [m] and let everything settle."""
    for k in range(steps):
        body.set_base(Pose((0, 0, start + (stop - start) * (k + 1) / steps)))
        world.step()
    for _ in range(rest):
        world.step()


def pressed_pad(
    depth: float, *, material: Material = FLESH, substeps: int = 5
) -> tuple[World, SoftBody, Body]:
    """Return a pad with a sphere pressed into it by `depth` [m]."""
    world = World()
    pad = add_pad(world, material=material, substeps=substeps)
    ball = world.add_sphere(RADIUS, Pose((0, 0, 0.1)))
    lower(world, ball, RADIUS + 0.005, RADIUS - depth, 24)
    return world, pad, ball


def test_constraints_of_one_colour_share_no_particle() -> None:
    points, tetrahedra, _ = pad_mesh((4, 3, 2))
    colour = colours(tetrahedra, len(points))
    for k in range(colour.max() + 1):
        members = tetrahedra[colour == k].ravel()
        assert len(np.unique(members)) == len(members)


def test_the_boundary_of_a_mesh_is_closed_and_looks_outwards() -> None:
    points, tetrahedra, _ = pad_mesh((3, 3, 2))
    faces = boundary(tetrahedra)
    assert len(faces) == 2 * (2 * 9 + 4 * 6)
    a, b, c = (points[faces[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6  # divergence theorem
    assert volume == pytest.approx(WIDTH * WIDTH * HEIGHT)


def test_elastic_forces_are_the_slope_of_the_energy() -> None:
    points, members, _ = pad_mesh((2, 2, 1))
    flesh = Tetrahedra(points, members, FLESH)
    rng = np.random.default_rng(0)
    moved = points + rng.normal(0, 1e-3, points.shape)
    x = np.zeros((len(points) + SPARE, 4), np.float32)
    x[: len(points), :3], x[len(points) + 1 :, :3] = moved, np.eye(3)
    forces = np.zeros((len(x), 3), np.float32)
    run = np.arange(len(flesh.packed.particles))
    add_elastic_forces(x, run, flesh.packed, forces)
    mu, lame = FLESH.shear_modulus, FLESH.bulk_parameter

    def energy(at: Array) -> float:
        edge = [
            np.stack([p[members[:, k]] - p[members[:, 0]] for k in (1, 2, 3)], 2)
            for p in (at, points)
        ]
        gradient = edge[0] @ np.linalg.inv(edge[1])
        ratio = np.linalg.det(gradient)
        density = mu / 2 * ((gradient**2).sum(axis=(1, 2)) - 3)
        density += lame / 2 * (ratio - 1 - mu / lame) ** 2
        return float((density * flesh.volumes).sum())

    place = x[: len(points), :3].astype(np.float64)
    for i, a in ((0, 0), (4, 1), (7, 2), (11, 0)):
        step = np.zeros_like(place)
        step[i, a] = 1e-7
        slope = (energy(place + step) - energy(place - step)) / 2e-7
        assert forces[i, a] == pytest.approx(-slope, abs=2e-3 * float(np.abs(forces).max()))


def test_soft_matter_at_rest_stays_at_rest() -> None:
    world = World()
    pad = add_pad(world)
    pad.is_awake = True
    for _ in range(3):
        world.step()
    assert pad.deviation() < 1e-6
    assert not pad.contacts


def test_it_yields_more_to_more_and_never_turns_inside_out() -> None:
    world, pad, ball = pressed_pad(0.004)
    forces = [pad.force[2]]
    for depth in (0.007, 0.010):
        lower(world, ball, ball.base_pose().position[2], RADIUS - depth, 12)
        forces.append(pad.force[2])
        assert pad.least_volume_ratio() > 0
    assert 0.5 < forces[0] < forces[1] < forces[2]


def test_the_sphere_feels_what_the_pad_is_held_with() -> None:
    """Newton's third law: the block bears the elastic force at the held particles."""
    _, pad, ball = pressed_pad(0.007)
    assert pad.force_on(ball)[2] == pytest.approx(-pad.held_load()[2], rel=0.02)
    shares = (pad.pressure * pad.areas)[:, None] * -pad.normals  # towards the sphere
    assert shares.sum(axis=0)[2] == pytest.approx(pad.force[2], rel=0.02)


def test_force_is_linear_in_youngs_modulus() -> None:
    stiff = Material(60e3, 0.45, 1050.0, damping_per_s=60.0, damping_s=0.0015, friction=0.8)
    soft, hard = (pressed_pad(0.007, material=m)[1].force[2] for m in (FLESH, stiff))
    assert hard == pytest.approx(2 * soft, rel=0.03)


def test_force_hardly_depends_on_the_number_of_substeps() -> None:
    few, many = (pressed_pad(0.006, substeps=n)[1].force[2] for n in (5, 20))
    assert few == pytest.approx(many, rel=0.05)


def static_force(
    points: Array, tetrahedra: npt.NDArray[np.int32], held: npt.NDArray[np.intp], depth: float
) -> float:
    """Return the force of the sphere on a pad by Newton's method on the energy: no XPBD, no steps [N].

    Contact is a stiff penalty on particles inside the sphere, without friction.
    """
    mu, lame, penalty = FLESH.shear_modulus, FLESH.bulk_parameter, 1e5
    edge = np.stack([points[tetrahedra[:, k]] - points[tetrahedra[:, 0]] for k in (1, 2, 3)], 2)
    volume, inverse = np.linalg.det(edge) / 6, np.linalg.inv(edge)
    slopes = np.concatenate((-inverse.sum(axis=1)[:, None], inverse), axis=1)
    swap = np.zeros((3, 3, 3))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        swap[a, b, c], swap[a, c, b] = 1, -1
    at, middle = points.copy(), np.array((0, 0, RADIUS - depth))
    places = (3 * tetrahedra[:, :, None] + np.arange(3)).reshape(-1, 12)
    free = np.setdiff1d(np.arange(3 * len(points)), 3 * np.asarray(held)[:, None] + np.arange(3))
    for _ in range(40):
        gradient = np.einsum("tka,tkb->tab", at[tetrahedra], slopes)
        cofactor = 0.5 * np.einsum("acd,bef,tce,tdf->tab", swap, swap, gradient, gradient)
        beyond = lame * (np.linalg.det(gradient) - 1 - mu / lame)
        stress = mu * gradient + beyond[:, None, None] * cofactor
        force = np.zeros_like(at)
        np.add.at(force, tetrahedra, -np.einsum("t,tab,tkb->tka", volume, stress, slopes))
        arm = at - middle
        length = np.linalg.norm(arm, axis=1)
        depths, out = np.maximum(RADIUS - length, 0), arm / length[:, None]
        push = penalty * depths[:, None] * out
        stiff = np.einsum("acd,bef,tdf,t->tabce", swap, swap, gradient, beyond)
        stiff += lame * np.einsum("tab,tce->tabce", cofactor, cofactor)
        stiff += mu * np.einsum("ac,be->abce", np.eye(3), np.eye(3))
        blocks = np.einsum("t,tabce,tkb,tle->tkalc", volume, stiff, slopes, slopes, optimize=True)
        matrix = np.zeros((3 * len(points), 3 * len(points)))
        np.add.at(matrix, (places[:, :, None], places[:, None]), blocks.reshape(-1, 12, 12))
        for i in np.flatnonzero(depths):
            rows = slice(3 * i, 3 * i + 3)
            matrix[rows, rows] += penalty * np.outer(out[i], out[i])
        residual = (force + push).ravel()[free]
        step = np.linalg.solve(matrix[np.ix_(free, free)], residual)
        at.reshape(-1)[free] += 0.5 * step
        if np.abs(residual).max() < 1e-4:
            return float(-push.sum(axis=0)[2])
    raise AssertionError("Newton's method did not converge")


@pytest.mark.slow
def test_force_is_that_of_a_static_solution() -> None:
    points, tetrahedra, bottom = pad_mesh()
    for depth in (0.004, 0.007):
        wanted = static_force(points, tetrahedra, bottom, depth)
        smooth = dataclasses.replace(FLESH, friction=0.0)
        force = pressed_pad(depth, material=smooth)[1].force[2]
        assert force == pytest.approx(wanted, rel=0.03)


def test_it_comes_back_to_rest_and_falls_asleep() -> None:
    world, pad, ball = pressed_pad(0.007)
    assert pad.is_awake
    lower(world, ball, ball.base_pose().position[2], 0.2, 24, rest=120)
    assert not pad.is_awake
    assert pad.deviation() == 0
    assert not pad.pressure.any()


def test_it_sleeps_until_something_comes_near() -> None:
    world = World()
    pad = add_pad(world)
    ball = world.add_sphere(RADIUS, Pose((0, 0, 0.15)), mass=0.2)
    awake_at = None
    for _ in range(120):
        world.step()
        gap = ball.base_pose().position[2] - RADIUS
        if pad.is_awake and awake_at is None:
            awake_at = gap
    assert awake_at is not None
    assert -0.005 < awake_at < 0.05


def test_a_body_set_into_it_wakes_it_at_once() -> None:
    world = World()
    pad = add_pad(world)
    ball = world.add_sphere(RADIUS, Pose((0, 0, 3.0)))
    for _ in range(3):
        world.step()
    assert not pad.is_awake
    ball.set_base(Pose((0, 0, RADIUS - 0.002)))
    world.step()
    assert pad.force[2] > 0


def test_what_is_ignored_passes_through() -> None:
    world = World()
    pad = add_pad(world)
    ball = world.add_sphere(RADIUS, Pose((0, 0, RADIUS - 0.005)))
    SoftWorld.of(world).ignore([ball], by=SoftBody)
    for _ in range(5):
        world.step()
    assert not pad.is_awake


@pytest.mark.parametrize(("mass", "size"), [(0.2, 0.04), (1.0, 0.05)])
def test_a_light_box_rests_on_it_with_its_weight(mass: float, size: float) -> None:
    world = World()
    pad = add_pad(world)
    box = world.add_box((size, size, 0.02), Pose((0, 0, 0.012)), mass=mass)
    for _ in range(480):
        world.step()
    forces = []
    for _ in range(60):
        world.step()
        forces.append(pad.force[2])
    assert np.mean(forces) == pytest.approx(mass * GRAVITY, rel=0.02)
    assert np.ptp(forces) < 0.05 * mass * GRAVITY
    assert abs(box.base_pose().position[0]) < 0.005
    assert 0 < box.base_pose().position[2] < 0.0101


def test_a_bonded_sphere_presses_alike_whatever_it_weighs() -> None:
    forces = []
    for mass in (0.05, 0.5):
        world = World()
        pad = add_pad(world)
        post = world.add_box((0.01, 0.01, 0.01), Pose((0, 0, 0.2)), collides=False, mass=0.0)
        ball = world.add_sphere(RADIUS, Pose((0, 0, RADIUS - 0.006)), mass=mass)
        world.attach(post, "base", ball)
        for _ in range(120):
            world.step()
        forces.append(pad.force_on(ball)[2])
    assert forces[0] > 2
    assert forces[0] == pytest.approx(forces[1], rel=0.03)


def rig(folder: Path, name: str, height: float) -> Path:
    """Write the URDF of a post with a slide and a tool on it, tied by a joint that can be gauged."""
    ball = f'<collision><geometry><sphere radius="{RADIUS}"/></geometry></collision>'
    inertial = (
        '<inertial><mass value="{}"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0"'
        ' iyz="0"/></inertial>'
    )
    file = folder / f"{name}.urdf"
    file.write_text(
        f"""<robot name="{name}"><link name="post">{inertial.format(1)}</link>
        <link name="slide">{inertial.format(0.5)}</link>
        <link name="tool">{inertial.format(0.5)}{ball if name == "robot" else ""}</link>
        <joint name="lift" type="prismatic"><parent link="post"/><child link="slide"/>
        <origin xyz="0 0 {height}"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="500" velocity="5"/></joint>
        <joint name="gauge" type="fixed"><parent link="slide"/><child link="tool"/></joint></robot>"""
    )
    return file


def test_two_robots_feel_the_same_force_through_it(tmp_path: Path) -> None:
    """One carries the pad, one presses: gauges in their joints read what the pad reads."""
    world = World()
    under = world.load_urdf(rig(tmp_path, "carrier", 0.0), name="carrier")
    over = world.load_urdf(rig(tmp_path, "robot", RADIUS + 0.02), name="robot")
    points, tetrahedra, bottom = pad_mesh()
    pad = SoftBody(
        "pad",
        points,
        material=FLESH,
        tetrahedra=tetrahedra,
        held=bottom,
        carrier=Carrier(under, under.link_index("tool")),
        mass_factor=8.0,
    )
    SoftWorld.of(world).add(pad)
    for body in (under, over):
        bullet.enableJointForceTorqueSensor(
            body.uid, body.link_index("tool"), True, physicsClientId=world.client
        )

    def gauge(body: Body) -> float:
        row = bullet.getJointState(body.uid, body.link_index("tool"), physicsClientId=world.client)
        return float(row[2][2])

    readings = []
    for goal in (0.0, -0.028):
        for k in range(360):
            target = goal * min(1.0, k / 120)
            for body, at in ((under, 0.0), (over, target)):
                body.drive_positions(body.indices(["lift"]), [at], [400.0], position_gain=0.4)
            world.step()
        readings.append((gauge(under), gauge(over)))
    load = pad.force_on(over)[2]
    assert load > 3
    carried, pressed = (readings[1][k] - readings[0][k] for k in range(2))
    assert pressed == pytest.approx(-load, rel=0.02)
    assert carried == pytest.approx(load, rel=0.02)


def test_a_sliding_plate_drags_with_the_friction_coefficient() -> None:
    world = World()
    pad = add_pad(world)
    plate = world.add_box((0.3, 0.3, 0.02), Pose((0, 0, 0.1)))  # no edge that ploughs
    plate.set_friction([-1], lateral=0.5)
    lower(world, plate, 0.015, 0.007, 24, rest=30)
    for k in range(240):
        plate.set_base(Pose((0.0003 * k, 0, 0.007)))
        world.step()
    force = pad.force_on(plate)
    assert force[0] == pytest.approx(-0.5 * FLESH.friction * force[2], rel=0.15)
    assert abs(force[1]) < 0.1 * force[2]


def make_tool(world: World, kind: str) -> Body:
    """Return an immovable tool that is 4 cm high, its middle at its origin."""
    corners = [(0.02 * x, 0.02 * y, 0.02 * z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    shapes: dict[str, tuple[int, dict[str, Any]]] = {
        "sphere": (bullet.GEOM_SPHERE, {"radius": 0.02}),
        "box": (bullet.GEOM_BOX, {"halfExtents": [0.02, 0.015, 0.02]}),
        "capsule": (bullet.GEOM_CAPSULE, {"radius": 0.015, "height": 0.01}),
        "cylinder": (bullet.GEOM_CYLINDER, {"radius": 0.015, "height": 0.04}),
        "hull": (bullet.GEOM_MESH, {"vertices": corners}),
    }
    shape = shapes[kind]
    made = bullet.createCollisionShape(shape[0], physicsClientId=world.client, **shape[1])
    uid = bullet.createMultiBody(0, made, -1, (0, 0, 1), physicsClientId=world.client)
    return world._register(uid, kind, Model(kind, "", {"base": Link()}))


@pytest.mark.parametrize("kind", ["sphere", "box", "capsule", "cylinder", "hull"])
def test_every_kind_of_shape_presses(kind: str) -> None:
    world = World()
    pad = add_pad(world)
    tool = make_tool(world, kind)
    lower(world, tool, 0.03, 0.016, 20)
    assert 0.5 < pad.force_on(tool)[2] < 30
    assert pad.force_on(tool)[2] == pytest.approx(-pad.held_load()[2], rel=0.02)


@pytest.mark.parametrize("kind", ["sphere", "box", "capsule", "cylinder", "hull"])
def test_distances_are_those_of_bullet(kind: str) -> None:
    world = World()
    tool = make_tool(world, kind)
    probe = world.add_sphere(0.001, Pose((0, 0, 3)), mass=1.0)
    turn = quaternion_from_axis_angle((1.0, 2.0, 0.5), 0.7)
    tool.set_base(Pose((0.1, -0.2, 0.3), tuple(turn.tolist())))
    colliders = Colliders([tool], world.client)
    colliders.fetch(colliders.by_body([0]))
    shapes = NearShapes(colliders, np.array([0])).seen_from(WORLD_FRAME)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(40, 3))
    for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
        point = np.array((0.1, -0.2, 0.3)) + 0.032 * direction
        probe.set_base(Pose(tuple(point.tolist())))
        wanted = world.separation(probe, tool, within=1.0) + 0.001
        got, *_ = contact.distance(shapes, 0, *point.astype(np.float32))
        if kind == "hull":  # outside it is a lower bound, see there; Bullet rounds hulls by 1 mm
            assert got <= wanted + 2.5e-3
        else:
            assert got == pytest.approx(wanted, abs=1.5e-3)


def test_an_episode_repeats_bit_for_bit_after_rewind() -> None:
    world = World()
    pad = add_pad(world)
    ball = world.add_sphere(RADIUS, Pose((0.003, 0.001, RADIUS + 0.03)), mass=0.2)
    world.mark_start()
    runs = []
    for _ in range(2):
        world.rewind()
        for _ in range(150):
            world.step()
        runs.append((pad.positions.copy(), pad.force, ball.base_pose(), pad.pressure.copy()))
    (x, f, p, q), (x2, f2, p2, q2) = runs
    assert f[2] > 0
    assert np.array_equal(x, x2) and np.array_equal(f, f2) and np.array_equal(q, q2)
    assert p == p2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"poissons_ratio": 0.5}, "poissons_ratio must lie in 0..0.5"),
        ({"poissons_ratio": -0.1}, "poissons_ratio must lie in 0..0.5"),
        ({"youngs_modulus_pa": 0.0}, "youngs_modulus_pa must be above 0"),
        ({"density_kg_m3": -1.0}, "density_kg_m3 must be above 0"),
        ({"friction": -0.1}, "friction must not be negative"),
    ],
)
def test_an_impossible_material_is_refused(change: dict[str, float], message: str) -> None:
    figures = {"youngs_modulus_pa": 3e4, "poissons_ratio": 0.45, **change}
    with pytest.raises(ConfigError, match=message):
        Material(**figures)  # type: ignore[arg-type]


def test_an_impossible_body_is_refused() -> None:
    points, tetrahedra, _ = pad_mesh((2, 2, 1))
    carrier = Carrier(World().add_box((0.01, 0.01, 0.01)), -1)
    with pytest.raises(ConfigError, match="substeps must be at least 1"):
        SoftBody("pad", points, material=FLESH, tetrahedra=tetrahedra, carrier=carrier, substeps=0)
    inverted = tetrahedra[:, [0, 2, 1, 3]]
    with pytest.raises(ConfigError, match="has the volume"):
        SoftBody("pad", points, material=FLESH, tetrahedra=inverted, carrier=carrier)
    with pytest.raises(ConfigError, match="has no mass"):
        SoftBody("pad", points, material=FLESH, tetrahedra=tetrahedra[:5], carrier=carrier)
    with pytest.raises(ConfigError, match="mass_factor must be above 0"):
        SoftBody(
            "pad", points, material=FLESH, tetrahedra=tetrahedra, carrier=carrier, mass_factor=0.0
        )
