"""Cameras measure what is there: places, depths, normals and names, alone or many at once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from rcare_marl.errors import ConfigError, UnknownNameError, WorldError
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.rendering import Camera, GLRenderer, Output, Shot, SoftwareRenderer, make_renderer
from rcare_marl.rendering.gl_scene import GLScene
from rcare_marl.rendering.software_renderer import normals_from_depth
from rcare_marl.world import World

RED = (0.9, 0.05, 0.05, 1.0)
SHAPES: tuple[Output, ...] = ("depth", "normals", "segmentation")
# A camera that stands askew, with a lens off the middle and pixels that are not square.
ASKEW = Pose((0.3, -0.2, 1.5), tuple(quaternion_from_rpy(0.4, 1.1, -0.7).tolist()))


BACKENDS: list[Any] = [pytest.param("gl", marks=pytest.mark.needs_gl), "software"]


def askew(width: int = 96, height: int = 72, **lens: float) -> Camera:
    given = {"fx": 0.9 * width, "fy": 0.95 * width, "cx": 0.44 * width, "cy": 0.58 * height}
    return Camera.from_intrinsics(ASKEW, width=width, height=height, **(given | lens))


def turned(roll: float, pitch: float, yaw: float) -> tuple[float, ...]:
    return tuple(quaternion_from_rpy(*np.radians((roll, pitch, yaw))).tolist())


@pytest.fixture
def world() -> Iterator[World]:
    world = World()
    yield world
    world.close()


def plate(
    world: World, camera: Camera, distance: float, tilt: float
) -> tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]:
    """Put a plate before a camera; return true depths, the normal, and which pixels are well inside."""
    size = 0.6 * distance
    at = camera.pose @ Pose((0.02, -0.03, distance), turned(0.7 * tilt, 0.7 * tilt, 20))
    world.add_box((size, size, 0.02), at, name="plate")
    local = (camera.pose.inverse() @ at).matrix()
    normal = local[:3, 2] * -np.sign(local[:3, 2] @ local[:3, 3])
    rays = camera.rays()
    depth = normal @ (local[:3, 3] + 0.01 * normal) / (rays @ normal)
    hit = (rays * depth[:, :, None] - local[:3, 3]) @ local[:3, :3]
    inside = np.abs(hit[:, :, :2]).max(axis=2) < 0.5 * size - 0.005
    return depth, normal, inside


def eroded(mask: npt.NDArray[np.bool_], pixels: int) -> npt.NDArray[np.bool_]:
    for _ in range(pixels):
        around = [np.roll(mask, step, axis) for step in (-1, 1) for axis in (0, 1)]
        mask = mask & np.logical_and.reduce(around)
    return mask


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("tilt", [0, 30, 60])
@pytest.mark.parametrize("distance", [0.3, 1.0, 3.0])
def test_flat_things_are_measured_exactly(
    world: World, backend: Any, distance: float, tilt: float
) -> None:
    camera = askew()
    depth, normal, inside = plate(world, camera, distance, tilt)
    renderer = make_renderer(world, backend)
    picture = renderer.read([Shot(camera, SHAPES)])[0]
    assert inside.sum() > 300
    assert abs(picture["depth"] - depth)[inside].max() < 0.0005  # a quarter of what is promised
    if backend == "software":  # its normals come from depths: pixels at an edge see beyond it
        inside = eroded(inside, 2)
    off = np.degrees(np.arccos(np.clip(picture["normals"][inside] @ normal, -1, 1)))
    assert off.max() < 0.5
    assert np.allclose(renderer.depth(camera)[inside], depth[inside], atol=0.0005)
    renderer.close()


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_projected_is_seen_there(world: World, backend: Any) -> None:
    camera = askew(160, 120)
    renderer = make_renderer(world, backend)
    ball = world.add_sphere(0.02, rgba=RED)
    for at in ((0.0, 0.0, 0.8), (0.25, -0.2, 0.9), (-0.2, 0.3, 1.1)):
        place = (camera.pose @ Pose(at)).position
        ball.set_base(Pose(place))
        u, v, depth = camera.project(place)
        picture = renderer.read([Shot(camera, ("rgb", "segmentation"))])[0]
        rows, columns = np.nonzero(picture["segmentation"] >= 0)
        assert abs(columns.mean() - u) < 0.25 and abs(rows.mean() - v) < 0.25
        assert depth == pytest.approx(at[2])
        red = picture["rgb"].astype(int)
        rows, columns = np.nonzero(red[:, :, 0] - red[:, :, 2] > 60)
        assert abs(columns.mean() - u) < 0.5 and abs(rows.mean() - v) < 0.5
    renderer.close()


def test_intrinsics_and_extrinsics_are_those_given() -> None:
    camera = askew(fx=70.0, fy=80.0, cx=41.0, cy=30.0)
    assert np.allclose(camera.K, ((70, 0, 41), (0, 80, 30), (0, 0, 1)))
    assert np.allclose(camera.pose.matrix(), ASKEW.matrix())
    points = np.array(((0.3, -0.1, 2.0), (0.0, 0.2, 0.5)))
    world = (ASKEW.matrix() @ np.column_stack((points, np.ones(2))).T).T[:, :3]
    homogeneous = points @ camera.K.T
    assert np.allclose(camera.project(world)[:, :2], homogeneous[:, :2] / homogeneous[:, 2:])
    behind = camera.project((camera.pose @ Pose((0, 0, -1))).position)
    assert np.isnan(behind[:2]).all() and behind[2] == pytest.approx(-1)
    middle = Camera.at(ASKEW, fov_deg=60, width=5, height=3)
    assert np.allclose(middle.K[:2, 2], (2, 1))  # pixels are counted by their middles
    assert 2 * np.degrees(np.arctan(1.5 / middle.K[1, 1])) == pytest.approx(60)
    assert np.allclose(middle.project((ASKEW @ Pose((0, 0, 1))).position), (2, 1, 1))


def test_pictures_of_depths_become_points_and_back() -> None:
    camera = askew()
    depth = np.random.default_rng(0).uniform(0.3, 3.0, (camera.height, camera.width))
    depth[3, 4] = np.inf
    points = camera.unproject(depth)
    assert np.isnan(points[3, 4]).all()
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    seen = np.delete(camera.project(points).reshape(-1, 3), 3 * camera.width + 4, axis=0)
    wanted = np.delete(np.dstack((u, v, depth)).reshape(-1, 3), 3 * camera.width + 4, axis=0)
    assert np.allclose(seen, wanted)
    with pytest.raises(ConfigError, match="depth must have shape"):
        camera.unproject(depth[1:])


@pytest.mark.parametrize(
    ("change", "message"),
    [({"fx": 0.0}, "focal"), ({"fy": 1.0}, "fov_deg"), ({"cx": float("nan")}, "center")],
)
def test_impossible_intrinsics_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        askew(**change)  # type: ignore[arg-type]


@pytest.mark.parametrize("backend", BACKENDS)
def test_segmentation_names_what_is_seen(world: World, backend: Any) -> None:
    camera = Camera((0, -1, 0.5), (0, 0, 0.5), width=60, height=40)
    world.add_box((0.2, 0.2, 0.2), Pose((-0.2, 0, 0.5)), name="left")
    world.add_box((0.2, 0.2, 0.2), Pose((0.2, 0, 0.5)), name="right")
    renderer = make_renderer(world, backend)
    picture = renderer.read([Shot(camera, ("segmentation", "normals", "depth"))])[0]
    seen, labels = picture["segmentation"], renderer.labels()
    assert seen.dtype == np.int32 and seen.shape == (40, 60)
    assert labels[seen[20, 18]][0] == "left" and labels[seen[20, 42]][0] == "right"
    assert seen[0, 30] == -1 and not picture["normals"][0, 30].any()
    assert np.isinf(picture["depth"][0, 30])
    assert set(np.unique(seen)) == {-1, *labels}
    renderer.close()


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_transparent_is_seen_by_colours_alone(world: World, backend: Any) -> None:
    camera = Camera((0, -1, 0.5), (0, 0, 0.5), width=40, height=30)
    world.add_box((0.4, 0.1, 0.4), Pose((0, 0.2, 0.5)), name="wall")
    world.add_box((0.4, 0.01, 0.4), Pose((0, -0.2, 0.5)), rgba=(0, 0.2, 1, 0.3), name="glass")
    renderer = make_renderer(world, backend)
    picture = renderer.read([Shot(camera, ("rgb", *SHAPES))])[0]
    assert renderer.labels()[picture["segmentation"][15, 20]][0] == "wall"
    assert picture["depth"][15, 20] == pytest.approx(1.15, abs=0.001)
    red, _, blue = picture["rgb"][15, 20].astype(int)
    assert blue - red > 20
    renderer.close()


@pytest.mark.needs_gl
def test_shapes_are_the_same_with_colours_and_without(world: World) -> None:
    camera = askew()
    plate(world, camera, 1.0, 30)
    renderer = GLRenderer(world)
    alone, plain, full = renderer.read(
        [
            Shot(camera, SHAPES),
            Shot(camera, ("rgb", *SHAPES), look="plain"),
            Shot(camera, ("rgb", *SHAPES), look="full"),
        ]
    )
    for output in SHAPES:
        assert np.array_equal(alone[output], full[output])
        seen = np.isfinite(alone["depth"])
        assert np.allclose(alone[output][seen], plain[output][seen], atol=1e-4)
    assert not np.array_equal(plain["rgb"], full["rgb"])
    assert np.array_equal(full["rgb"], renderer.render(camera))
    renderer.close()


@pytest.mark.parametrize("backend", BACKENDS)
def test_many_cameras_see_what_each_sees_alone(world: World, backend: Any) -> None:
    plate(world, askew(), 0.7, 20)
    cameras = [
        askew(),
        Camera((0, -2, 1), (0, 0, 0.5), width=50, height=40),
        askew(cx=10.0),
        askew(96, 50),
    ]
    shots = [Shot(camera, ("rgb", *SHAPES), look="plain") for camera in cameras]
    renderer = make_renderer(world, backend)
    together = renderer.read(shots)
    for shot, picture in zip(shots, together, strict=True):
        alone = renderer.read([shot])[0]
        assert picture.keys() == alone.keys() == {"rgb", *SHAPES}
        assert all(np.array_equal(picture[key], alone[key]) for key in alone)
    assert renderer.read([]) == []
    renderer.close()


@pytest.mark.needs_gl
def test_the_scene_is_sent_once_for_all_cameras(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    updates, update = [], GLScene.update

    def counted(scene: GLScene) -> bool:
        updates.append(scene)
        return update(scene)

    monkeypatch.setattr(GLScene, "update", counted)
    ball = world.add_sphere(0.1, Pose((0, 0, 0.5)), mass=1.0)
    renderer, camera = GLRenderer(world), Camera((0, -2, 0.5), (0, 0, 0.5), width=40, height=30)
    first = renderer.read([Shot(camera, ("depth",))] * 3)[2]["depth"]
    renderer.read([Shot(camera)])
    assert len(updates) == 1  # nothing has moved
    ball.set_base(Pose((0.4, 0, 0.5)))
    second = renderer.read([Shot(camera, ("depth",))])[0]["depth"]
    assert len(updates) == 2 and not np.array_equal(first, second)
    world.step()
    renderer.read([Shot(camera)])
    world.add_sphere(0.1, Pose((-0.4, 0, 0.5)))
    third = renderer.read([Shot(camera, ("depth",))])[0]["depth"]
    assert (
        len(updates) == 4 and np.isfinite(third[:, :20]).sum() > np.isfinite(second[:, :20]).sum()
    )
    renderer.close()


@pytest.mark.needs_gl
def test_a_floor_is_where_the_world_has_one(world: World) -> None:
    world.add_box((4, 4, 0.1), Pose((0, 0, -0.05)), name="floor")
    renderer = GLRenderer(world)
    camera = Camera((0, 0, 1.5), (0.5, 0, 0), width=40, height=30)
    picture = renderer.read([Shot(camera, SHAPES)])[0]
    heights = camera.unproject(picture["depth"])[:, :, 2]
    assert np.nanmax(abs(heights)) < 1e-4
    assert renderer.labels()[picture["segmentation"][15, 20]][0] == "floor"
    renderer.close()


def test_a_bad_shot_is_refused(world: World) -> None:
    camera = askew()
    with pytest.raises(UnknownNameError, match="Did you mean 'depth'"):
        Shot(camera, ("dept",))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="outputs must be some of rgb, depth"):
        Shot(camera, ())
    with pytest.raises(ConfigError, match="outputs must be some of"):
        Shot(camera, "rgb")  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="look of a picture"):
        Shot(camera, look="fancy")  # type: ignore[arg-type]
    renderer = SoftwareRenderer(world)
    renderer.close()
    with pytest.raises(WorldError, match="closed"):
        renderer.read([Shot(camera)])


def test_normals_of_a_ball_point_out_of_it() -> None:
    camera = Camera.at(Pose(), fov_deg=50, width=120, height=90)
    rays = camera.rays()
    middle, radius = np.array((0.0, 0.0, 1.0)), 0.2
    a, b = (rays**2).sum(axis=2), rays @ middle
    inside = b**2 - a * (middle @ middle - radius**2)
    hit = inside > 0
    depth = np.where(hit, (b - np.sqrt(np.where(hit, inside, 0))) / a, np.inf)
    normals = normals_from_depth(camera, depth, np.where(hit, 1, -1))
    truth = (rays * np.where(hit, depth, 0)[:, :, None] - middle) / radius
    frontal = hit & (truth[:, :, 2] < -0.5)
    off = np.degrees(np.arccos(np.clip((normals * truth).sum(axis=2)[frontal], -1, 1)))
    assert frontal.sum() > 500 and np.median(off) < 0.3
    assert off.max() < 7  # a pixel near the rim spans some degrees of the ball
    assert not normals[~hit].any()
