"""Pictures show what is there, and taking them changes nothing."""

import logging
import os
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pybullet as bullet
import pytest

from rcare_marl import rendering
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, RenderingError, WorldError
from rcare_marl.pose import Pose
from rcare_marl.rendering import Camera, GLRenderer, Renderer, SoftwareRenderer, Viewer
from rcare_marl.rendering.collada import read_collada
from rcare_marl.rendering.mesh import SmoothNormals, detail_levels, smoothed
from rcare_marl.rendering.piece import split_by_color
from rcare_marl.world import World

CAMERA = Camera((0.0, -2.0, 1.0), (0.0, 0.0, 0.5), width=320, height=240)
RED = (0.9, 0.05, 0.05, 1.0)
Image = npt.NDArray[np.uint8]


BACKENDS = [pytest.param("gl", marks=pytest.mark.needs_gl), "software"]


class Sheet:
    """A green square that faces the camera, as a skin."""

    faces = np.array(((0, 1, 2), (0, 2, 3)), np.int32)
    colors = np.tile(np.array((20, 200, 40), np.uint8), (4, 1))
    corners = np.array(((-0.2, 0, -0.2), (0.2, 0, -0.2), (0.2, 0, 0.2), (-0.2, 0, 0.2)), np.float32)

    def __init__(self, body: Body) -> None:
        self.body = body

    def vertices(self) -> npt.NDArray[np.float32]:
        return self.corners + np.array(self.body.base_pose().position, np.float32)

    def rest_pieces(self) -> list[tuple[int, npt.NDArray[np.float32], npt.NDArray[np.int32]]]:
        return [(-1, self.corners, np.arange(2, dtype=np.int32))]


@pytest.fixture
def world() -> Iterator[World]:
    world = World()
    yield world
    world.close()


def make(world: World, backend: Any) -> Renderer:
    return rendering.make_renderer(world, backend)


def hits(image: Image, channel: int) -> npt.NDArray[np.bool_]:
    """Return where one channel stands out from the others."""
    others = np.delete(image.astype(int), channel, axis=2).max(axis=2)
    out: npt.NDArray[np.bool_] = image[:, :, channel].astype(int) - others > 60
    return out


def middle(mask: npt.NDArray[np.bool_]) -> tuple[float, float]:
    rows, columns = np.nonzero(mask)
    return float(rows.mean()), float(columns.mean())


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_box_is_where_it_should_be(world: World, backend: str) -> None:
    box = world.add_box((0.2, 0.2, 0.2), Pose((0, 0, 0.5)), rgba=RED)
    renderer = make(world, backend)
    image = renderer.render(CAMERA)
    assert image.shape == (240, 320, 3) and image.dtype == np.uint8
    row, column = middle(hits(image, 0))
    assert abs(row - 119.5) < 6 and abs(column - 159.5) < 3
    assert 400 < hits(image, 0).sum() < 2000  # about 25 x 30 pixels
    box.set_base(Pose((-0.5, 0, 0.5)))
    moved = middle(hits(renderer.render(CAMERA), 0))
    assert moved[1] < column - 40 and abs(moved[0] - row) < 6
    renderer.close()
    renderer.close()
    with pytest.raises(WorldError, match="closed"):
        renderer.render(CAMERA)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_body_that_is_added_later_appears(world: World, backend: str) -> None:
    renderer = make(world, backend)
    assert not hits(renderer.render(CAMERA), 0).any()
    world.add_sphere(0.1, Pose((0, 0, 0.5)), rgba=RED)
    assert hits(renderer.render(CAMERA), 0).any()
    renderer.close()


@pytest.mark.parametrize("backend", BACKENDS)
def test_depth_is_in_metres(world: World, backend: str) -> None:
    world.add_box((0.2, 0.2, 0.2), Pose((0, 0, 0.5)))
    camera = Camera((0, -2, 0.5), (0, 0, 0.5), width=80, height=60)
    renderer = make(world, backend)
    depth = renderer.depth(camera)
    assert depth[30, 40] == pytest.approx(1.9, abs=0.005)
    assert np.isinf(depth[0, 0])
    renderer.close()


@pytest.mark.needs_gl
def test_shadow_darkens_the_floor(world: World) -> None:
    camera = Camera((0, -0.01, 4), (0, 0, 0), width=320, height=240)
    box = world.add_box((0.4, 0.4, 0.1), Pose((9, 9, 0.5)))
    renderer = GLRenderer(world, ambient_occlusion=False)
    before = renderer.render(camera).astype(int)
    box.set_base(Pose((0, 0, 0.6)))
    after = renderer.render(camera).astype(int)
    # The light comes from the right and from near: the shadow falls to the left and away.
    assert (before - after)[70:118, 100:150].max() > 25
    assert abs(before - after)[200:, 250:].max() <= 3
    renderer.close()


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_skin_is_drawn_in_place_of_its_body(world: World, backend: str) -> None:
    body = world.add_sphere(0.1, Pose((0, 0, 0.5)), rgba=RED)
    world.skins.append(Sheet(body))
    renderer = make(world, backend)
    image = renderer.render(CAMERA)
    assert not hits(image, 0).any()
    assert hits(image, 1).sum() > 1000
    body.set_base(Pose((0.4, 0, 0.5)))
    assert middle(hits(renderer.render(CAMERA), 1))[1] > middle(hits(image, 1))[1] + 30
    renderer.close()


@pytest.mark.needs_gl
def test_a_skin_may_change_its_faces(world: World) -> None:
    skin = Sheet(world.add_sphere(0.1, Pose((0, 0, 0.5))))
    world.skins.append(skin)
    renderer = GLRenderer(world)
    whole = hits(renderer.render(CAMERA), 1).sum()
    skin.faces = skin.faces[:1]  # torn in half
    assert hits(renderer.render(CAMERA), 1).sum() < 0.6 * whole
    world.skins.clear()
    assert not hits(renderer.render(CAMERA), 1).any()
    renderer.close()


@pytest.mark.needs_gl
def test_what_is_transparent_lets_through_what_is_behind(world: World) -> None:
    world.add_box((0.3, 0.3, 0.3), Pose((0, 0.5, 0.5)), rgba=RED)
    world.add_box((0.6, 0.02, 0.6), Pose((0, 0, 0.5)), rgba=(0.2, 0.4, 1.0, 0.3))
    renderer = GLRenderer(world)
    red, _, blue = renderer.render(CAMERA)[120, 160].astype(int)
    assert red > 100 and blue > 40
    renderer.close()


@pytest.mark.parametrize("backend", BACKENDS)
def test_pictures_do_not_change_the_physics(backend: str) -> None:
    ends = []
    for draw in (False, True):
        world = World()
        world.add_box((4, 4, 0.1), Pose((0, 0, -0.05)))
        ball = world.add_sphere(0.1, Pose((0.01, 0.02, 0.4)), mass=1.0, rgba=RED)
        world.add_box((0.3, 0.3, 0.2), Pose((0, 0, 0.1)), mass=2.0)
        renderer = make(world, backend)
        if draw:
            renderer.render(CAMERA)
        world.mark_start()
        for step in range(90):
            world.step()
            if draw and step % 30 == 0:
                renderer.render(CAMERA)
        end = ball.base_pose()
        world.rewind()  # a saved state can be restored after a picture
        ends.append((end, ball.base_pose()))
        assert bullet.getNumBodies(physicsClientId=world.client) == 3
        renderer.close()
        world.close()
    assert ends[0] == ends[1]


@pytest.mark.needs_gl
def test_several_renderers_and_sizes_live_side_by_side(world: World) -> None:
    world.add_box((0.2, 0.2, 0.2), Pose((0, 0, 0.5)), rgba=RED)
    other = World()
    other.add_box((0.2, 0.2, 0.2), Pose((0, 0, 0.5)), rgba=(0.05, 0.05, 0.9, 1))
    first, second = GLRenderer(world), GLRenderer(other, samples=0, shadow_size=0)
    small = Camera((0, -2, 1), (0, 0, 0.5), width=65, height=33)
    before = first.render(CAMERA)
    assert hits(second.render(CAMERA), 2).any()
    assert first.render(small).shape == (33, 65, 3)
    second.close()
    assert np.array_equal(first.render(CAMERA), before)
    first.close()
    other.close()


def no_context(**_settings: Any) -> Any:
    raise Exception("libEGL.so not loaded")  # what glcontext raises


def test_forcing_gl_without_gl_is_a_named_error(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("moderngl.create_context", no_context)
    with pytest.raises(RenderingError, match="apt-get install libegl1 libgl1-mesa-dri"):
        rendering.make_renderer(world, "gl")


def test_auto_falls_back_with_one_warning(
    world: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("moderngl.create_context", no_context)
    monkeypatch.setattr(rendering, "_WARNED", set())
    monkeypatch.delenv("RCARE_MARL_RENDERER", raising=False)
    with caplog.at_level(logging.WARNING, "rcare_marl.rendering"):
        for _ in range(2):
            renderer = rendering.make_renderer(world)
            assert isinstance(renderer, SoftwareRenderer)
            renderer.close()
    assert len(caplog.records) == 1
    assert "libEGL.so not loaded" in caplog.text and "apt-get install" in caplog.text


def test_the_environment_variable_decides(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RCARE_MARL_RENDERER", "software")
    renderer = rendering.make_renderer(world)
    assert isinstance(renderer, SoftwareRenderer)
    renderer.close()
    monkeypatch.setenv("RCARE_MARL_RENDERER", "opengl")
    with pytest.raises(ConfigError, match="RCARE_MARL_RENDERER must be one of auto, gl, software"):
        rendering.make_renderer(world)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"eye": (0, 0, 0.5)}, "points must differ"),
        ({"eye": (0, 0, 3), "target": (0, 0, 0)}, "along up"),
        ({"eye": (0, float("nan"), 3)}, "eye must be 3 finite"),
        ({"fov_deg": 0.0}, "fov_deg"),
        ({"width": 0}, "width"),
        ({"near": 2.0, "far": 1.0}, "near < far"),
    ],
)
def test_a_bad_camera_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Camera(**({"eye": (0, -2, 1), "target": (0, 0, 0.5)} | change))


def test_the_viewer_serves_a_page(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    body = world.add_sphere(0.1, Pose((0, 0, 0.5)), rgba=RED)
    world.skins.append(Sheet(body))
    world.add_box((0.2, 0.2, 0.2), Pose((1, 0, 0.5)), rgba=(0.2, 0.4, 1.0, 0.3))
    viewer = Viewer(world, CAMERA)
    assert viewer.url.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(viewer.url, timeout=10) as answer:
        assert answer.status == 200
    for _ in range(3):
        world.step()
        viewer.update()
    assert viewer.is_open and not viewer.is_paused
    viewer.close()
    viewer.close()
    viewer.update()  # does nothing
    assert not viewer.is_open
    assert capsys.readouterr().out == ""


def test_smooth_normals_of_a_flat_sheet_point_up() -> None:
    vertices = np.array([(x, y, 0) for x in range(3) for y in range(3)], np.float32)
    faces = np.array([(0, 3, 1), (1, 3, 4), (4, 7, 5)], np.int32)
    normals = SmoothNormals(faces, 9).compute(vertices)
    used = np.unique(faces)
    assert np.allclose(normals[used], (0, 0, 1))
    assert not normals[np.setdiff1d(np.arange(9), used)].any()


def test_creases_stay_and_round_things_are_smooth() -> None:
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((1, 1, 1))
    mesh = smoothed(np.asarray(box.vertices), np.asarray(box.faces), None)
    assert len(mesh.vertices) == 24 and mesh.closed
    assert np.allclose(np.abs(mesh.normals).max(axis=1), 1)
    ball = trimesh.creation.icosphere(3)
    mesh = smoothed(np.asarray(ball.vertices), np.asarray(ball.faces), None)
    assert len(mesh.vertices) == len(ball.vertices)
    assert np.einsum("ij,ij->i", mesh.normals, mesh.vertices).min() > 0.99


def test_coarser_levels_have_fewer_faces() -> None:
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(5, radius=0.1)
    vertices, faces = ball.vertices.astype(np.float32), ball.faces.astype(np.int32)
    levels = detail_levels(vertices, vertices / 0.1, faces, None)
    counts = [len(level) for level in levels]
    assert counts == sorted(counts, reverse=True) and counts[-1] < 0.2 * counts[0]
    assert all(level.max() < len(vertices) for level in levels)


def test_a_mesh_is_cut_by_colour() -> None:
    faces = np.arange(12, dtype=np.int32).reshape(4, 3)
    colors = np.repeat(np.array([(200, 0, 0), (0, 0, 200)], np.uint8), 6, axis=0)
    pieces = list(split_by_color(faces, colors))
    assert sorted(piece.rgb for piece in pieces) == [(0, 0, 200), (200, 0, 0)]
    assert sum(len(piece.faces) for piece in pieces) == 4


def test_collada_is_read_with_transforms_and_colours(tmp_path: Any) -> None:
    file = tmp_path / "triangle.dae"
    file.write_text(
        """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.01"/><up_axis>Z_UP</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="c"><lambert><diffuse>
<color>1 0 0.5 1</color></diffuse></lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 100 0 0 100 100 0 0 100 0</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="1" material="s"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>4</vcount><p>0 1 2 3</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><translate>0 0 200</translate>
<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="s" target="#m"/></technique_common></bind_material>
</instance_geometry></node></visual_scene></library_visual_scenes></COLLADA>"""
    )
    ((vertices, faces, colors),) = read_collada(file)
    assert np.allclose(vertices, [(0, 0, 2), (1, 0, 2), (1, 1, 2), (0, 1, 2)])
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert colors is not None and colors[0].tolist() == [255, 0, 128]
    file.write_text("<urdf/>")
    with pytest.raises(ValueError, match="not COLLADA"):
        read_collada(file)


@pytest.mark.slow
@pytest.mark.needs_gl
def test_triton_is_loaded_before_opengl_where_it_is_installed(tmp_path: Path) -> None:
    seen = "from rcare_marl.rendering.gl_target import _OPENED_BY\nopened = list(_OPENED_BY)\n"
    (tmp_path / "triton.py").write_text(seen)
    code = "from rcare_marl.rendering.gl_target import create_context as make; make().release(); "
    code += "import sys; print(sys.modules['triton'].opened)"
    path = os.pathsep.join((str(tmp_path), *filter(None, sys.path)))
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"
