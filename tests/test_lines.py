"""Muscles and bones as lines: where they are, what colour they have, and that they are seen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
import numpy.typing as npt
import pytest
from variants import few

from rcare_marl import assets, rendering
from rcare_marl.agents.people.actuation import muscle_kernel as kernel
from rcare_marl.agents.people.actuation.drive import ActuationConfig, fitted_musculature
from rcare_marl.agents.people.actuation.muscle_lines import (
    FULL,
    RELAXED,
    MuscleLines,
    activation_color,
    path_points,
    show_muscles,
)
from rcare_marl.agents.people.actuation.muscle_unit import t_pose_position
from rcare_marl.agents.people.avatar import body_model, load_avatar, load_posture
from rcare_marl.agents.people.body.bone_lines import BoneLines
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.body.skin import PersonSkin
from rcare_marl.agents.people.human import Human
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.rendering import Camera, GLRenderer, Viewer
from rcare_marl.rendering.mesh import SmoothNormals
from rcare_marl.rendering.stroke import TubeMesh, segments
from rcare_marl.world import World

Floats = npt.NDArray[np.float64]
# [m] The muscles are made for one body and scaled to others by their bones alone, not by their flesh.
FARTHEST_OUT = 0.03
ARM = ("right_shoulder", "right_elbow", "right_wrist")


BACKENDS = [pytest.param("gl", marks=pytest.mark.needs_gl), "software"]


@pytest.fixture
def world() -> Iterator[World]:
    world = World()
    yield world
    world.close()


def spawn(
    world: World,
    movable: tuple[str, ...] | None = ARM,
    kind: Literal["muscle", "skeletal"] = "muscle",
) -> Human:
    person = Human(
        "person",
        load_avatar("karan"),
        posture=load_posture("standing"),
        movable=movable,
        actuation=ActuationConfig(kind=kind),
    )
    person.spawn(world, Pose((0.3, -0.2, 0.0)))
    person.reset(np.random.default_rng(0))
    return person


def before(person: Human, joint: str, *, away: float) -> Camera:
    x, y, z = person.joint_pose(joint).position
    return Camera((x + away, y, z), (x, y, z), width=240, height=240)


@pytest.mark.parametrize("movable", [ARM, None])
def test_lines_are_as_long_as_the_muscles(world: World, movable: tuple[str, ...] | None) -> None:
    person = spawn(world, movable)
    model = MuscleLines(person).model
    rng = np.random.default_rng(3)
    for _ in range(5):
        q = rng.uniform(person.passive[:, 0], person.passive[:, 1])
        points = path_points(model, q)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        starts = model.layout.starts[:, 0]
        drawn = np.array([steps[a : b - 1].sum() for a, b in zip(starts, starts[1:], strict=False)])
        is_round = np.array([any(p.surface for p in unit.path) for unit in model.units])
        arcs = model.lengths(q) - drawn  # a line cuts the corner where a path goes round a surface
        np.testing.assert_allclose(arcs[~is_round], 0.0, atol=1e-9)
        assert (arcs > -1e-9).all() and arcs.max() < 0.03


def test_lines_follow_the_person(world: World) -> None:
    person = spawn(world)
    lines = MuscleLines(person)
    unit = lines.model.units[lines.model.index("biclong_r")]
    last = lines.starts[lines.model.index("biclong_r") + 1] - 1
    assert unit.path[-1].joint == "right_elbow" and unit.path[-1].parent is None

    def carried() -> np.ndarray:  # where the forearm carries the insertion, by the physics
        joint = person.joint_pose("right_elbow").matrix()
        rest = person.model.joints
        arm = t_pose_position(unit.path[-1], rest) - rest[JOINT_INDEX["right_elbow"]]
        return np.asarray((joint @ np.append(arm, 1.0))[:3])

    start = lines.points()[last]
    np.testing.assert_allclose(start, carried(), atol=1e-6)
    person.set_angles({"right_elbow_flexion": 1.8})
    after = lines.points()[last]
    np.testing.assert_allclose(after, carried(), atol=1e-6)
    assert np.linalg.norm(after - start) > 0.02
    person.place(Pose((2.0, 1.0, 0.9), (0.0, 0.0, 0.6, 0.8)))
    np.testing.assert_allclose(lines.points()[last], carried(), atol=1e-6)


def test_bones_join_the_joints(world: World) -> None:
    person = spawn(world)
    skin = world.skins[0]
    assert isinstance(skin, PersonSkin)
    bones = BoneLines(skin)
    points, ends = bones.points(), np.append(bones.starts[:-1], bones.starts[1:] - 1)
    for joint in ("left_knee", "right_elbow", "neck", "left_index2"):
        gap = np.linalg.norm(points[ends] - person.joint_pose(joint).position, axis=1)
        assert (gap < 1e-5).sum() >= 2  # one bone ends here and the next begins


def test_colour_follows_activation(world: World) -> None:
    person = spawn(world)
    lines = MuscleLines(person)
    m = lines.model.index("bic_l_r") if "bic_l_r" in lines.model.names else 0
    mine = slice(lines.starts[m], lines.starts[m + 1])
    person.drive.state[kernel.ACTIVATION] = 0.0  # type: ignore[attr-defined]
    assert (lines.colors() == RELAXED).all()
    person.drive.state[kernel.ACTIVATION, m] = 1.0  # type: ignore[attr-defined]
    assert (lines.colors()[mine] == FULL).all()
    assert (np.delete(lines.colors(), np.r_[mine], axis=0) == RELAXED).all()
    reds = activation_color(np.linspace(0, 1, 11))[:, 0].astype(int)
    assert (np.diff(reds) > 0).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_working_muscle_is_red_in_the_picture(world: World, backend: str) -> None:
    person = spawn(world)
    show_muscles(person, world)
    camera = before(person, "right_elbow", away=0.9)

    def red(image: np.ndarray) -> int:
        r, g, b = (image[:, :, k].astype(int) for k in range(3))
        return int(((r - g > 70) & (r - b > 70)).sum())

    renderer = rendering.make_renderer(world, backend)  # type: ignore[arg-type]
    assert red(renderer.render(camera)) == 0
    person.command(np.ones(person.action_size), 0.1)
    for _ in range(24):
        person.actuate()
    assert red(renderer.render(camera)) > 100
    world.lines.clear()
    assert red(renderer.render(camera)) == 0
    renderer.close()


@pytest.mark.needs_gl
def test_skin_can_be_seen_through(world: World) -> None:
    person = spawn(world)
    bare = world.skins[0].colors
    camera = before(person, "spine3", away=1.0)
    renderer = GLRenderer(world)
    pictures, near = [], []
    for opacity in (1.0, 0.4, 0.0):
        world.lines.clear()
        show_muscles(person, world, opacity=opacity)
        pictures.append(renderer.render(camera).astype(int))
        near.append(renderer.depth(camera)[120, 120])
    opaque, veiled, hidden = pictures
    assert near[0] < near[2]  # hidden skin is not measured either
    apart = np.abs(opaque - hidden).sum(axis=2) > 60
    assert apart.mean() > 0.1
    between = np.abs(veiled - hidden).sum(axis=2)[apart].mean()
    assert 0.15 < between / np.abs(opaque - hidden).sum(axis=2)[apart].mean() < 0.7
    assert (world.skins[0].colors[:, :3] == bare[:, :3]).all()
    renderer.close()


def test_only_muscles_can_be_shown(world: World) -> None:
    person = spawn(world, kind="skeletal")
    with pytest.raises(ConfigError, match="no muscles"):
        show_muscles(person, world)
    assert not world.lines
    other = World()
    with pytest.raises(ConfigError, match="opacity"):
        show_muscles(spawn(other), other, opacity=1.5)
    other.close()


def test_tubes_are_round_rods() -> None:
    starts = np.array((0, 2, 5, 8))
    points = np.array(
        ((0, 0, 0), (0, 0, 1), (0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0), (1, 0, 0), (0, 0, 0)),
        np.float32,
    )  # the last turns back on itself
    radii = np.full(8, 0.1, np.float32)
    tubes = TubeMesh(starts)
    vertices, normals = tubes.surface(points, radii)
    assert vertices.shape == normals.shape == (tubes.vertex_count, 3)
    assert np.isfinite(vertices).all()
    # The volume of the straight one, by the divergence theorem: a little less than a round rod.
    straight = tubes.faces[(tubes.faces < 6 * 8).all(axis=1)]
    a, b, c = (vertices[straight[:, k]].astype(float) for k in range(3))
    volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6
    rod = np.pi * 0.1**2 * (1 + 4 / 3 * 0.1)
    assert 0.85 * rod < volume < rod


def test_segments_do_not_join_two_lines() -> None:
    assert segments(np.array((0, 2, 5))).tolist() == [[0, 1], [2, 3], [3, 4]]


def test_the_page_shows_lines_where_they_are(world: World) -> None:
    person = spawn(world)
    lines = show_muscles(person, world)
    camera = before(person, "right_elbow", away=0.9)
    viewer = Viewer(world, camera, follow=False)
    ends = segments(lines.starts)
    handle = next(made for known, _, made in viewer._strokes if known is lines)
    np.testing.assert_allclose(handle.points, lines.points()[ends])
    person.set_angles({"right_elbow_flexion": 1.8})
    person.drive.state[kernel.ACTIVATION] = 1.0  # type: ignore[attr-defined]
    viewer._sent_skins = -np.inf  # as if time had passed
    viewer.update()
    np.testing.assert_allclose(handle.points, lines.points()[ends])
    assert (handle.colors == FULL).all()
    viewer.close()


def turns(point: Floats, triangles: Floats) -> float:
    """Return how often a surface winds round a point: 1 inside, 0 outside (van Oosterom 1983)."""
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    ab, bc, ca = ((x * y).sum(axis=1) for x, y in ((a, b), (b, c), (c, a)))
    volume = (a * np.cross(b, c)).sum(axis=1)
    angle = 2 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return float(angle.sum()) / (4 * np.pi)


@pytest.mark.parametrize("name", few(assets.names("avatars"), "karan", "kim"))
def test_muscles_lie_within_the_body(name: str) -> None:
    avatar = load_avatar(name)
    body = body_model(avatar.body_path(), avatar.height_m)
    muscles = fitted_musculature(avatar, None)
    points = np.array([t_pose_position(p, muscles.joints) for u in muscles.units for p in u.path])
    skin = body.vertices.astype(float)
    normals = SmoothNormals(body.faces, len(skin)).compute(body.vertices)
    square = (points**2).sum(axis=1)[:, None] - 2 * points @ skin.T + (skin**2).sum(axis=1)
    nearest = square.argmin(axis=1)
    away = points - skin[nearest]
    outside = np.linalg.norm(away, axis=1)
    outside[np.einsum("pa,pa->p", away, normals[nearest]) <= 0] = 0.0
    for p in np.flatnonzero(outside > 0.01):  # in a fold the nearest vertex may look away
        outside[p] *= turns(points[p], skin[body.faces]) < 0.5
    assert outside.max() < FARTHEST_OUT
    assert (outside > 0.01).mean() < 0.02
