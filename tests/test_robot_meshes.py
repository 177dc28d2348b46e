"""Real meshes of robots: found in packages or where the user says, drawn, and no more than drawn."""

from __future__ import annotations

import importlib.metadata as metadata
import logging
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image
from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from rcare_marl import assets
from rcare_marl.agents.robots import robot_model as loader
from rcare_marl.agents.robots.robot_model import MESH_FOLDERS, MeshPackage, robot_files
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, MissingPackageError, UnknownNameError
from rcare_marl.model.mesh_file import MOST_CORNERS, hulls
from rcare_marl.model.shape import MeshFile
from rcare_marl.model.urdf import Model
from rcare_marl.pose import Pose
from rcare_marl.rendering import Camera
from rcare_marl.rendering.collada import read_collada
from rcare_marl.rendering.mesh import shape_mesh
from rcare_marl.world import World

MODEL = "kinova_gen3/model.yaml"
ROBOTS = sorted(path.stem for path in (assets.ROOT / "robots").glob("*.yaml"))
DISTRIBUTION = "rcare-test-meshes"
TABLE = {"base_link": (MeshFile("meshes/cube.stl", scale=(2.0, 2.0, 2.0), rgba=(1.0, 0, 0, 1)),)}
DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 0.1 0 0 0 0.2 0 0 0 0.3</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""
PAINT = """<library_effects><effect id="e"><profile_COMMON><technique sid="t"><phong><diffuse>
<color>1 0 0 1</color></diffuse></phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="red"><instance_effect url="#e"/></material></library_materials>
"""
INSTANCE = """<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="m" target="#red"/></technique_common></bind_material>
</instance_geometry>"""


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def fresh(cache: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("RCARE_MARL_CACHE", str(cache))
    monkeypatch.delenv(MESH_FOLDERS, raising=False)
    for kept in (loader._files, loader._cached_meshes, loader._say_once):
        kept.cache_clear()
    yield
    loader._files.cache_clear()


def cube(folder: Path, name: str = "cube.stl") -> Path:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    if file.suffix.lower() == ".dae":
        file.write_text(DAE)
    else:
        trimesh.creation.box((0.1, 0.1, 0.1)).export(file, file_type=file.suffix[1:].lower())
    return file


def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, version: str = "1.0") -> Path:
    """Lay out an installed package: files, and the record of them that pip keeps."""
    site = tmp_path / "site"
    cube(site / "their_robots" / "meshes")
    (site / "their_robots" / "gen3.urdf").write_text(
        their_urdf("package://their_robots/meshes/cube.stl")
    )
    record = site / f"{DISTRIBUTION.replace('-', '_')}-{version}.dist-info"
    record.mkdir(parents=True)
    (record / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {DISTRIBUTION}\nVersion: {version}\n"
    )
    names = ("their_robots/gen3.urdf", "their_robots/meshes/cube.stl")
    (record / "RECORD").write_text("".join(f"{name},,\n" for name in names))
    monkeypatch.setattr(sys, "path", [str(site), *sys.path])
    return site


def their_urdf(mesh: str) -> str:
    """Return a URDF with one link of our name, one of another, and one fixed to the first."""
    shown = (
        f'<visual><origin xyz="0 0 0.5"/><geometry><mesh filename="{mesh}"/></geometry></visual>'
    )
    return (
        '<robot name="theirs">'
        f'<link name="base_link">{shown}</link><link name="half_arm_1">{shown}</link>'
        f'<link name="cover">{shown}</link>'
        '<joint name="weld" type="fixed"><parent link="base_link"/><child link="cover"/>'
        '<origin xyz="1 0 0" rpy="0 0 1.5707963"/></joint>'
        '<joint name="move" type="planar"><parent link="base_link"/><child link="half_arm_1"/></joint>'
        "</robot>"
    )


def package(**fields: object) -> MeshPackage:
    given = {"version": "1.0", "extra": "robots", "licence": "none"} | fields
    return MeshPackage(DISTRIBUTION, **given)  # type: ignore[arg-type]


def drawn_files(urdf: Path, link: str) -> list[tuple[str, tuple[float, ...]]]:
    """Return file and place of each mesh that is drawn with a link."""
    world = World()
    body = world.load_urdf(urdf)
    index = body.link_index(link)
    shapes = [shape for shape in body.visual_shapes() if shape.link == index]
    world.close()
    return [(Path(shape.mesh).name, shape.pose.position) for shape in shapes]


def test_a_urdf_of_a_package_is_drawn_with_what_is_fixed_to_its_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, monkeypatch)
    files = robot_files(MODEL, package(urdf="their_robots/gen3.urdf"), meshes="required")
    assert files.visuals == f"meshes of {DISTRIBUTION} 1.0 (none)"
    found = drawn_files(files.urdf, "base_link")
    assert [name for name, _ in found] == ["cube.stl", "cube.stl"]
    assert found[0][1] == pytest.approx((0, 0, 0.5))
    assert found[1][1] == pytest.approx((1, 0, 0.5))
    assert all(name.endswith(".obj") for name, _ in drawn_files(files.urdf, "shoulder_link"))


def test_links_of_other_names_are_drawn_if_renamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, monkeypatch)
    given = package(urdf="gen3.urdf", rename={"half_arm_1": "half_arm_1_link"})
    files = robot_files(MODEL, given, meshes="required")
    assert [name for name, _ in drawn_files(files.urdf, "half_arm_1_link")] == ["cube.stl"]
    wrong = package(urdf="gen3.urdf", rename={"half_arm_l": "half_arm_1_link"})
    with pytest.raises(ConfigError, match="half_arm_l.*Did you mean 'half_arm_1'"):
        robot_files(MODEL, wrong, meshes="required")


def test_a_table_of_files_needs_no_urdf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch)
    files = robot_files(MODEL, package(meshes=TABLE), meshes="required")
    world = World()
    body = world.load_urdf(files.urdf)
    shape = next(s for s in body.visual_shapes() if s.link == -1)
    assert Path(shape.mesh).name == "cube.stl" and shape.rgba == (1, 0, 0, 1)
    mesh = shape_mesh(shape)
    assert mesh is not None and np.ptp(mesh.vertices, axis=0) == pytest.approx((0.2, 0.2, 0.2))
    world.close()
    with pytest.raises(UnknownNameError, match="base_link"):
        robot_files(MODEL, package(meshes={"base": TABLE["base_link"]}), meshes="required")


def test_a_table_can_be_written_in_yaml() -> None:
    text = """
    distribution: a
    version: "1"
    licence: MIT
    meshes: {base_link: [{file: a/b.stl, at: [0, 0, 1], rpy: [0, 0, 0], scale: [1, 1, 1]}]}
    """
    given = load(MeshPackage, yaml.safe_load(text))
    assert given.meshes["base_link"][0] == MeshFile("a/b.stl", at=(0.0, 0.0, 1.0))
    with pytest.raises(ConfigError, match="needs a `urdf` or `meshes`"):
        load(MeshPackage, {"distribution": "a", "version": "1"})


def test_the_users_own_path_is_drawn(tmp_path: Path) -> None:
    own = tmp_path / "gen3_description" / "robots" / "mine.urdf"
    cube(tmp_path / "gen3_description" / "meshes", "cube.dae")
    own.parent.mkdir()
    own.write_text(their_urdf("package://gen3_description/meshes/cube.dae"))
    files = robot_files(MODEL, meshes=own)
    assert files.visuals == f"meshes of the user's {own}, 1 links"
    assert len(drawn_files(files.urdf, "base_link")) == 2
    plain = robot_files(MODEL)
    assert files.model == plain.model and files.physics == plain.physics


def test_a_path_of_which_nothing_can_be_used_is_an_error(tmp_path: Path) -> None:
    own = tmp_path / "mine.urdf"
    with pytest.raises(ConfigError, match="no URDF at"):
        robot_files(MODEL, meshes=own)
    own.write_text('<robot name="x"><link name="body"/></robot>')
    with pytest.raises(ConfigError, match="has meshes for none of the links .*its links are body"):
        robot_files(MODEL, meshes=str(own))
    own.write_text(their_urdf("package://nowhere/cube.stl"))
    with pytest.raises(ConfigError, match="cube.stl .looked in package folder 'nowhere'"):
        robot_files(MODEL, meshes=own)
    with pytest.raises(ConfigError, match="one of auto, never, required, or the path of a URDF"):
        robot_files(MODEL, meshes="allways")


def test_package_comes_before_the_users_folder_and_that_before_generated_shapes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = package(urdf="gen3.urdf")
    assert robot_files(MODEL, given, meshes="auto").visuals == "generated shapes"
    folder = tmp_path / "own"
    cube(folder)
    (folder / "kinova_gen3.urdf").write_text(their_urdf("cube.stl"))
    monkeypatch.setenv(MESH_FOLDERS, str(folder))
    assert "user's" in robot_files(MODEL, given, meshes="auto").visuals
    assert "user's" in robot_files(MODEL, None, meshes="required").visuals
    install(tmp_path, monkeypatch)
    assert DISTRIBUTION in robot_files(MODEL, given, meshes="auto").visuals
    assert robot_files(MODEL, given).visuals == "generated shapes"


def test_required_meshes_that_are_not_there_say_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(MissingPackageError, match=r"pip install 'rcare-marl\[robots\]'"):
        robot_files(MODEL, package(urdf="gen3.urdf"), meshes="required")
    with pytest.raises(MissingPackageError, match=f"pip install {DISTRIBUTION}"):
        robot_files(MODEL, package(urdf="gen3.urdf", extra=""), meshes="required")
    with pytest.raises(ConfigError, match=f"give meshes the path of a URDF.*{MESH_FOLDERS}"):
        robot_files(MODEL, meshes="required")


def test_another_version_without_the_files_is_named_and_does_no_harm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    install(tmp_path, monkeypatch, version="2.0")
    given = package(urdf="dropped/gen3.urdf")
    with pytest.raises(
        ConfigError, match=f"2.0 is installed and has no file dropped.*{DISTRIBUTION}==1.0"
    ):
        robot_files(MODEL, given, meshes="required")
    with caplog.at_level(logging.WARNING):
        assert robot_files(MODEL, given, meshes="auto").visuals == "generated shapes"
    assert "2.0 is installed" in caplog.text


def test_the_record_of_a_package_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, monkeypatch)
    asked: list[str] = []
    original = metadata.distribution

    def counted(name: str) -> metadata.Distribution:
        asked.append(name)
        return original(name)

    monkeypatch.setattr(metadata, "distribution", counted)
    for _ in range(3):
        robot_files(MODEL, package(meshes=TABLE), meshes="required")
    assert asked == [DISTRIBUTION]


def test_what_was_used_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger=loader.__name__):
        for _ in range(2):
            robot_files(MODEL)
    said = [r.getMessage() for r in caplog.records if "drawn from" in r.getMessage()]
    assert len(said) == 1 and "kinova_gen3" in said[0] and "generated shapes" in said[0]


@pytest.mark.parametrize("name", ["a.stl", "b.STL", "c.obj", "d.dae"])
def test_every_format_that_is_accepted_draws_and_collides(tmp_path: Path, name: str) -> None:
    cube(tmp_path, name)
    shape = f'<geometry><mesh filename="{name}"/></geometry>'
    own = tmp_path / f"robot_{name[0]}.urdf"
    own.write_text(
        f'<robot name="r"><link name="a"><visual>{shape}</visual><collision>{shape}</collision>'
        "</link></robot>"
    )
    world = World()
    body = world.load_urdf(robot_files("", urdf=own).urdf)
    (shown,) = body.visual_shapes()
    mesh = shape_mesh(shown)
    size = (0.1, 0.2, 0.3) if name.endswith("dae") else (0.1, 0.1, 0.1)
    assert mesh is not None and np.ptp(mesh.vertices, axis=0) == pytest.approx(size)
    ball = world.add_sphere(0.01, Pose((0.02, 0.02, 0.02)), mass=0.1)
    world.step()
    assert world.contacts(body, ball)
    picture = world_picture(world)
    assert np.ptp(picture.astype(int), axis=(0, 1)).max() > 20  # something stands before the rest
    world.close()


def test_the_up_axis_of_a_file_is_ignored_and_its_colours_win_as_in_rviz(tmp_path: Path) -> None:
    file = cube(tmp_path, "part.dae")
    own = tmp_path / "robot.urdf"
    own.write_text(
        '<robot name="r"><link name="a"><visual><geometry><mesh filename="part.dae"/></geometry>'
        '<material name="m"><color rgba="0 1 0 1"/></material></visual></link></robot>'
    )
    painted = (
        DAE.replace("Z_UP", "Y_UP")
        .replace("<triangles ", '<triangles material="m" ')
        .replace("<library_geometries>", PAINT + "<library_geometries>")
        .replace('<instance_geometry url="#g"/>', INSTANCE)
    )
    for text, color in ((DAE, (0, 1, 0)), (painted, (1, 0, 0))):
        file.write_text(text)
        world = World()
        (shown,) = world.load_urdf(robot_files("", urdf=own).urdf).visual_shapes()
        mesh = shape_mesh(replace(shown, mesh=str(copy(file, tmp_path))))
        assert mesh is not None
        assert np.ptp(mesh.vertices, axis=0) == pytest.approx((0.1, 0.2, 0.3))
        if color == (1, 0, 0):
            assert shown.rgba == (1, 1, 1, 1) and mesh.colors is not None
            assert np.all(mesh.colors == (255, 0, 0))
        else:
            assert shown.rgba == (0, 1, 0, 1) and mesh.colors is None
        world.close()


def test_a_hull_has_few_corners_and_keeps_its_size(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    ball.apply_scale((1.0, 1.0, 4.0))
    file = tmp_path / "ball.stl"
    ball.export(file)
    (corners,) = hulls(file)
    assert len(ball.vertices) > 2000 and len(corners) <= MOST_CORNERS
    assert np.ptp(corners, axis=0) == pytest.approx((0.1, 0.1, 0.4), abs=1e-6)
    inside = ConvexHull(corners).volume / ball.volume
    assert 0.85 < inside <= 1.0


def test_each_object_of_an_obj_has_a_hull_of_its_own(tmp_path: Path) -> None:
    square = "f {0} {1} {2}\nf {0} {2} {3}\n"
    rows = [f"v {x} {y} {z}" for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    file = tmp_path / "two.obj"
    file.write_text(
        "\n".join(rows) + "\no low\n" + square.format(1, 2, 3, 4)
        + "o high\n" + square.format(-4, -3, -2, -1)
    )  # fmt: skip
    low, high = hulls(file)
    assert low.shape == high.shape == (4, 3)
    assert np.all(low[:, 2] == 0) and np.all(high[:, 2] == 1)


def test_a_picture_gives_a_mesh_its_colours(tmp_path: Path) -> None:
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[:, 0], pixels[:, 1] = (255, 0, 0), (0, 0, 255)  # left half red, right half blue
    Image.fromarray(pixels).save(tmp_path / "paint.png")
    textured = PAINT.replace(
        "<color>1 0 0 1</color>", '<texture texture="s" texcoord="T"/>'
    ).replace(
        "<profile_COMMON>",
        '<profile_COMMON><newparam sid="f"><surface><init_from>i</init_from></surface></newparam>'
        '<newparam sid="s"><sampler2D><source>f</source></sampler2D></newparam>',
    )
    image = (
        '<library_images><image id="i"><init_from>x/paint.png</init_from></image></library_images>'
    )
    places = (
        '<source id="t"><float_array id="ta" count="4">0.1 0.5 0.9 0.5</float_array>'
        '<technique_common><accessor source="#ta" count="2" stride="2"/></technique_common></source>'
    )
    file = tmp_path / "part.dae"
    file.write_text(
        DAE.replace("<library_geometries>", image + textured + "<library_geometries>")
        .replace("<vertices ", places + "<vertices ")
        .replace('<triangles count="4">', '<triangles material="m" count="2">')
        .replace('offset="0"/>\n<p>0 2 1 0 1 3 0 3 2 1 2 3</p>', 'offset="0"/><input semantic='
                 '"TEXCOORD" source="#t" offset="1"/><p>0 0 2 0 1 0 0 1 1 1 3 1</p>')
        .replace('<instance_geometry url="#g"/>', INSTANCE)
    )  # fmt: skip
    ((vertices, faces, colors),) = read_collada(file)
    assert colors is not None and len(vertices) == 6
    assert np.all(colors[faces[0]] == (255, 0, 0)) and np.all(colors[faces[1]] == (0, 0, 255))
    (tmp_path / "paint.png").unlink()
    assert read_collada(file)[0][2] is None


def test_meshes_without_a_colour_of_their_own_get_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, monkeypatch)
    plain = package(meshes={"base_link": (MeshFile("meshes/cube.stl"),)})
    model = load(Model, assets.ROOT / "robots" / MODEL)
    world = World()
    body = world.load_urdf(robot_files(MODEL, plain, meshes="required").urdf)
    shape = next(s for s in body.visual_shapes() if s.link == -1)
    assert shape.rgba == pytest.approx(model.materials["shell"])
    world.close()


def copy(file: Path, folder: Path) -> Path:
    """Return a copy of another name: the renderers remember what they have read."""
    out = folder / f"copy_{len(list(folder.iterdir()))}{file.suffix}"
    out.write_bytes(file.read_bytes())
    return out


def world_picture(world: World) -> np.ndarray:
    from rcare_marl.rendering import make_renderer

    camera = Camera((0.6, 0.6, 0.5), (0.0, 0.0, 0.05), width=64, height=64)
    return make_renderer(world, "software").render(camera)


# A user's own URDF.


def test_a_users_urdf_is_written_anew_with_frozen_joints(tmp_path: Path) -> None:
    ours = robot_files(MODEL)
    fixed = {"robotiq_85_left_knuckle_joint": 0.4}
    held = robot_files("", urdf=ours.urdf, fixed_joints=fixed, melt_except=("tool",))
    assert held.urdf != ours.urdf and str(ours.urdf) in held.physics
    world = World()
    body = world.load_urdf(held.urdf)
    assert "robotiq_85_left_knuckle_joint" not in body.joints and "joint_1" in body.joints
    assert "tool" in body.links and "bracelet_link" in body.links
    assert body.mass() < ours.model.mass  # the base is held: Bullet gives it no mass
    world.close()
    with pytest.raises(UnknownNameError, match="joint"):
        robot_files("", urdf=ours.urdf, fixed_joints={"knuckle": 0.0})


def test_joints_of_a_users_urdf_that_nothing_freezes_must_be_able_to_move(tmp_path: Path) -> None:
    ours = robot_files(MODEL).urdf
    text = ours.read_text()
    weak = ours.with_name("weak.urdf")
    weak.write_text(text.replace('effort="39.0"', 'effort="0"', 1))
    others = {"robotiq_85_left_knuckle_joint": 0.4}
    with pytest.raises(ConfigError, match="'joint_1' has no effort"):
        robot_files("", urdf=weak, fixed_joints=others)
    assert robot_files("", urdf=weak, fixed_joints=others | {"joint_1": 0.2}).urdf.is_file()


def test_too_many_joints_for_bullet_are_refused_unless_they_melt(tmp_path: Path) -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(130))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="l0"/><child link="l{i}"/></joint>'
        for i in range(1, 130)
    )
    own = tmp_path / "long.urdf"
    own.write_text(f'<robot name="r">{links}{joints}</robot>')
    with pytest.raises(
        ConfigError, match="129 joints, fixed ones included; Bullet handles at most"
    ):
        robot_files("", urdf=own)
    assert robot_files("", urdf=own, melt_except=("l7",)).urdf.is_file()


# The real packages, where they are installed.


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_real_meshes_fit_the_generated_robot(name: str) -> None:
    text = yaml.safe_load((assets.ROOT / "robots" / f"{name}.yaml").read_text())
    if "package" not in text:
        pytest.skip(f"no package has meshes for {name}")
    given = load(MeshPackage, text["package"])
    try:
        metadata.version(given.distribution)
    except metadata.PackageNotFoundError:
        pytest.skip(f"{given.distribution} is not installed (extra `{given.extra}`)")
    plain, real = (robot_files(text["model"], given, meshes=m) for m in ("never", "required"))
    assert given.distribution in real.visuals
    boxes = [drawn_bounds(files.urdf) for files in (plain, real)]
    # The same robot in the same place: no side lies farther than 3 cm from that of our own shapes.
    assert np.abs(np.subtract(*boxes)).max() < 0.03


def drawn_bounds(urdf: Path) -> np.ndarray:
    """Return the lower and upper corner of all that is drawn of a robot at zero, shape [2, 3]."""
    world = World()
    body = world.load_urdf(urdf)
    corners = []
    for shape in body.visual_shapes():
        mesh = shape_mesh(shape)
        assert mesh is not None, f"{shape.mesh} cannot be drawn"
        pose = (body.link_pose(shape.link) @ shape.pose).matrix()
        points = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        corners.append((points.min(axis=0), points.max(axis=0)))
    world.close()
    lows, highs = zip(*corners, strict=True)
    return np.array((np.min(lows, axis=0), np.max(highs, axis=0)))


def test_the_model_of_every_robot_loads() -> None:
    for name in ROBOTS:
        text = yaml.safe_load((assets.ROOT / "robots" / f"{name}.yaml").read_text())
        assert load(Model, assets.ROOT / "robots" / text["model"]).links
