"""Pictures of homes show what is there, from places where one can stand, and files come whole."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner
from variants import few

from rcare_marl.cli import app
from rcare_marl.envs.homes.care_home import CareHome
from rcare_marl.envs.homes.drawing import floor_plan, home_picture
from rcare_marl.envs.homes.drawing.home_picture import cutaway
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose
from rcare_marl.rendering import Camera, GLRenderer, Light, Shot
from rcare_marl.rendering.daylight import disc, dome, exposed
from rcare_marl.rendering.geometry import world_parts
from rcare_marl.rendering.portrait import framed
from rcare_marl.world import World

DOCS = Path(__file__).parents[1] / "docs"
RATIO = 4 / 3


@pytest.fixture(scope="module")
def home() -> CareHome:
    return CareHome.load("house_02", level=3)


def call(*arguments: str, code: int = 0) -> Any:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == code, (result.output, result.exception)
    return result


# --- plans


@pytest.mark.slow
def test_plan_names_every_room_and_stays_within_its_frame(home: CareHome) -> None:
    (axes,) = floor_plan.figure(home).axes
    texts = " ".join(text.get_text() for text in axes.texts)
    assert all(room.name in texts for room in home.rooms())
    bounds = floor_plan.extent(home)
    assert all(bounds.contains(area) for area in home.plan.outline)
    assert axes.get_xlim() == (bounds.x0, bounds.x1) and axes.get_ylim() == (bounds.y0, bounds.y1)


def test_furniture_is_seen_from_above_on_its_footprint(home: CareHome) -> None:
    (axes,) = floor_plan.figure(home).axes
    (parts,) = axes.collections
    seen = [np.asarray(path.vertices) for path in parts.get_paths()]
    boxes = np.array([(*points.min(axis=0), *points.max(axis=0)) for points in seen])
    for placed in home.placed:
        if placed.piece.kind in ("sofa", "wardrobe", "kitchen_run", "dining_table", "bed"):
            area = placed.footprint
            corners = np.array((area.x0, area.y0, area.x1, area.y1))
            inside = ((boxes - corners) * (1, 1, -1, -1) > -0.06).all(axis=1)
            low, high = boxes[inside, :2].min(axis=0), boxes[inside, 2:].max(axis=0)
            assert np.abs(np.append(low, high) - corners).max() < 0.06, placed.name


# --- where to stand


@pytest.mark.parametrize(
    "room", few(["kitchen_1", "bathroom_1", "bedroom_1", "living_1"], "kitchen_1", "bathroom_1")
)
def test_nobody_stands_in_something_tall_to_take_a_picture(home: CareHome, room: str) -> None:
    found = home_picture.best_vantage(home, room, ratio=RATIO)
    x, y, z = found.eye
    assert z == home_picture.EYE
    for placed in home.furniture(room):
        if placed.piece.blocks and placed.piece.height > home_picture.TALL:
            assert not placed.footprint.grown(0.15).has(x, y), placed.name
    inside = home.room(room).inside
    assert found.open_sides or inside.has(x, y)


def test_picture_is_taken_from_the_side_that_was_asked_for(home: CareHome) -> None:
    inside = home.room("bedroom_1").inside
    south = home_picture.best_vantage(home, "bedroom_1", ratio=RATIO, view="s")
    north = home_picture.best_vantage(home, "bedroom_1", ratio=RATIO, view="n")
    assert south.eye[1] < inside.centre[1] < north.eye[1]
    assert math.sin(south.yaw) > 0 > math.sin(north.yaw)


def test_unknown_view_is_named(home: CareHome) -> None:
    with pytest.raises(UnknownNameError, match="view of a room named 'nord'"):
        home_picture.best_vantage(home, "bedroom_1", ratio=RATIO, view="nord")
    with pytest.raises(UnknownNameError, match="kitchen_1"):
        home_picture.room_perspective(home, "kichen_1")


def test_camera_of_a_room_keeps_upright_what_is_upright(home: CareHome) -> None:
    camera = home_picture.best_vantage(home, "bedroom_1", ratio=RATIO).camera(width=640, height=480)
    assert camera.eye[2] == camera.target[2]


def test_cutaway_takes_away_what_stands_in_the_way_and_nothing_else(home: CareHome) -> None:
    room = home.room("bedroom_1").inside
    cut = cutaway(home, "bedroom_1", "s")
    assert all(wall.area.y0 >= room.y0 for wall in cut.plan.walls)
    beyond = [w for w in home.plan.walls if w.area.y0 >= room.y0]
    assert all(wall in cut.plan.walls for wall in beyond)
    assert all(p.footprint.y1 > room.y0 for p in cut.placed)
    assert cutaway(home, "bedroom_1").placed == home.placed
    with pytest.raises(ConfigError, match="swne"):
        cutaway(home, "bedroom_1", "x")


def test_house_is_in_the_middle_of_its_picture_and_fills_it() -> None:
    points = np.array([(x, y, z) for x in (0, 12, 20) for y in (3, 9) for z in (0.0, 1.4)])
    camera = framed(points, (-0.3, -0.8, 1), fov_deg=24, width=800, height=500)
    clip = np.c_[points, np.ones(len(points))] @ (camera.projection() @ camera.view()).T
    seen = clip[:, :2] / clip[:, 3:]
    low, high = seen.min(axis=0), seen.max(axis=0)
    assert np.abs(low + high).max() < 0.02
    assert 0.9 < np.abs(seen).max() < 1.0


# --- light


def test_sky_shines_from_overhead_and_a_sun_from_where_it_stands() -> None:
    sky = np.array([light.direction for light in dome(Light(), 64)])
    assert np.allclose(np.linalg.norm(sky, axis=1), 1) and (sky[:, 2] > 0).all()
    assert np.abs(sky.mean(axis=0)[:2]).max() < 0.03
    towards = np.array((1.0, 1.0, 1.0)) / math.sqrt(3)
    sun = np.array([light.direction for light in disc(Light((1.0, 1.0, 1.0)), 16, radius=0.05)])
    assert np.degrees(np.arccos(sun @ towards / np.linalg.norm(sun, axis=1))).max() < 3.0


@pytest.mark.parametrize(
    "wrong", [{"direction": (0, 0, 0)}, {"key": -1}, {"bounce": 1.5}, {"reach": 0}]
)
def test_impossible_light_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        Light(**wrong)


class Panel:
    """Reads one brightness for each light."""

    def read(self, shots: Sequence[Shot]) -> list[dict[str, Any]]:
        (shot,) = shots
        shape = (shot.camera.height, shot.camera.width, 3)
        return [{"rgb": np.full(shape, round(255 * shot.light.key), np.uint8)}]


def test_picture_under_two_lights_is_the_mean_of_their_light() -> None:
    camera = Camera((0, -1, 1), (0, 0, 0), width=8, height=6)
    lights = [Light(key=0.2), Light(key=0.6)]
    mean = math.sqrt((0.2**2 + 0.6**2) / 2)
    assert np.abs(exposed(Panel(), camera, lights) / 255 - mean).max() < 0.01
    assert np.abs(exposed(Panel(), camera, lights, brightest=0.5) / 255 - 0.5).max() < 0.01


@pytest.mark.needs_gl
def test_only_what_is_under_the_lid_casts_a_shadow() -> None:
    world = World()
    world.add_box((4, 4, 0.1), Pose((0, 0, -0.05)), rgba=(0.7, 0.7, 0.7, 1))
    world.add_box((0.6, 0.6, 0.1), Pose((0, 0, 1.0)), rgba=(0.7, 0.7, 0.7, 1))
    camera = Camera((0, -3, 0.5), (0, 0, 0), width=64, height=48)
    renderer = GLRenderer(world, floor=False)
    light = Light((0, 0, 1), fill=0.2)

    def ground(lid: float | None) -> float:
        shot = Shot(camera, light=dataclasses.replace(light, lid=lid))
        return float(renderer.read([shot])[0]["rgb"][24, 32].mean())

    shaded, free = ground(5.0), ground(0.5)
    renderer.close()
    world.close()
    assert shaded < 0.6 * free


# --- the command


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures without many lights."""
    monkeypatch.setattr(home_picture, "LAMPS", 1)
    monkeypatch.setattr(home_picture, "SUNS", 1)


@pytest.mark.slow
def test_command_leaves_whole_pictures_in_a_new_folder(tmp_path: Path, quick: None) -> None:
    folder = tmp_path / "new" / "pictures"
    result = call(
        "home",
        "house_02",
        "--level",
        "3",
        "--room",
        "kitchen_1",
        "--way",
        "bedroom_1",
        "kitchen_1",
        "--output",
        str(folder),
    )
    stem = "house_02_level_3"
    names = {f"{stem}.png", f"{stem}_plan.png", f"{stem}_kitchen_1.png"}
    assert {file.name for file in folder.iterdir()} == names
    assert [path.name for path in folder.parent.iterdir()] == ["pictures"]
    for word in ("kitchen_1", "comes in", "[m²]", "m wide where it is narrowest", *names):
        assert word in result.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("hous_02",), "Did you mean 'house_02'?"),
        (("house_02", "--room", "kichen_1"), "Did you mean 'kitchen_1'?"),
        (("house_02", "--way", "bedroom_1", "kichen_1"), "Did you mean 'kitchen_1'?"),
        (("house_02", "--level", "4"), "--level"),
    ],
)
def test_mistake_is_named_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = call("home", *arguments, code=2)
    assert message in result.stderr and result.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_interrupted_drawing_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*args: Any, **options: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(home_picture, "perspective", interrupted)
    call("home", "house_02", code=130)
    assert list(tmp_path.iterdir()) == []


# --- the page


@pytest.mark.slow
def test_every_block_of_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick: None
) -> None:
    page = (DOCS / "homes.md").read_text(encoding="utf-8")
    assert "(homes.md)" in (DOCS / "index.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    (yaml,) = (part.split("```")[0] for part in page.split("```yaml\n")[1:])
    Path("my_house.yaml").write_text(yaml, encoding="utf-8")
    blocks = [part.split("```")[0] for part in page.split("```python\n")[1:]]
    assert len(blocks) > 3
    names: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, "homes.md", "exec"), names)


def test_page_shows_pictures_that_are_there() -> None:
    page = (DOCS / "homes.md").read_text(encoding="utf-8")
    pictures = [part.split(")")[0] for part in page.split("](images/")[1:]]
    assert len(pictures) > 3
    for name in pictures:
        file = DOCS / "images" / name
        assert file.is_file() and file.stat().st_size < 500_000, name


@pytest.mark.slow
@pytest.mark.parametrize("name", ["house_01", "house_07"])
def test_nothing_but_a_floor_is_drawn_as_one(name: str) -> None:
    world = World()
    CareHome.load(name, level=1).spawn(world)
    floors = [part for part in world_parts(world) if part.is_floor]
    assert all(abs(part.top) < 0.05 for part in floors), [part.top for part in floors]
