"""Assistive devices: one interface, names, errors, the world's solver, and the page about them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pybullet as bullet
import pytest
from device_scene import seated

from rcare_marl.envs.devices import Device, ManualWheelchair, device_kinds, make_device
from rcare_marl.errors import ActionError, ConfigError, UnknownNameError, WorldError
from rcare_marl.pose import Pose
from rcare_marl.world import SOLVER_ITERATIONS, World

DOCS = Path(__file__).resolve().parents[1] / "docs"
ASSETS = DOCS.parent / "assets"


def test_the_eight_kinds_can_be_made_by_name_and_have_data_files() -> None:
    kinds = device_kinds()
    assert len(kinds) == len(set(kinds)) == 8
    for kind in kinds:
        device = make_device(kind)
        assert device.model.name == kind and device.model.source
        assert device.postures or kind == "platform_lift"
    with pytest.raises(UnknownNameError, match="Did you mean 'hospital_bed'"):
        make_device("hospitalbed")


@pytest.mark.parametrize("kind", device_kinds())
def test_devices_tell_newcomers_what_is_wrong(kind: str) -> None:
    device = make_device(kind)
    uses: list[Callable[[], object]] = [lambda: device.body, lambda: device.pose]
    uses += [partial(device.frame_in_world, name) for name in device.frames]
    for name in device.controls:
        uses += [partial(use, name) for use in (device.position, device.stop, device.limits)]
        uses.append(partial(device.command, name, 0.0))
    for use in uses:
        with pytest.raises(WorldError, match="spawn it first"):
            use()
    world = World()
    device.spawn(world)
    with pytest.raises(WorldError, match="spawned already"):
        device.spawn(world)
    with pytest.raises(UnknownNameError, match="no control named 'hight'"):
        device.command("hight", 0.1)
    for name in device.controls:
        low, high = device.limits(name)
        assert low < high
        for beyond in (low - 0.01, high + 0.01):
            for put in (device.command, device.set_position):
                with pytest.raises(ActionError, match=f"{name!r} of .* goes from"):
                    put(name, beyond)
        for wrong in (math.nan, math.inf, "up"):
            with pytest.raises(ActionError, match="finite number"):
                device.command(name, wrong)  # type: ignore[arg-type]
        device.set_position(name, high)
        device.stop(name)
        assert device.position(name) == pytest.approx(high, abs=1e-6)


def test_the_number_of_solver_iterations_is_the_worlds_own() -> None:
    def of_bullet(world: World) -> int:
        found = bullet.getPhysicsEngineParameters(physicsClientId=world.client)
        count: int = found["numSolverIterations"]
        return count

    world, chair = World(), ManualWheelchair()
    seated(world, chair)
    make_device("slide_board").spawn(world)
    assert (
        of_bullet(world) == world.solver_iterations == SOLVER_ITERATIONS
    )  # devices leave it alone
    world.set_solver_iterations(80)
    world.mark_start()
    world.set_solver_iterations(50)
    assert of_bullet(world) == world.solver_iterations == 50
    world.rewind()
    assert of_bullet(world) == world.solver_iterations == 80
    assert of_bullet(World(solver_iterations=150)) == 150
    for wrong in (0, -3, 1001, 2.5, True):
        with pytest.raises(ConfigError, match="whole number, 1 to 1000"):
            World(solver_iterations=wrong)  # type: ignore[arg-type]


TABLE = """
name: table
source: own choice
materials: {wood: [0.7, 0.5, 0.4, 1.0]}
links:
  foot: {mass: 8.0, collision: [{kind: box, at: [0.0, 0.0, 0.1], size: [0.4, 0.4, 0.2]}]}
  top:
    mass: 4.0
    visual: [{kind: box, material: wood, size: [0.6, 0.4, 0.02]}]
    collision: [{kind: box, size: [0.6, 0.4, 0.02]}]
  knob: {}
joints:
  height: {kind: prismatic, parent: foot, child: top, lower: 0.4, upper: 0.9, effort: 300.0}
  knob: {kind: fixed, parent: top, child: knob, at: [0.3, 0.0, 0.0]}
controls:
  height: {joint: height, speed: 0.1, force: 300.0}
contact:
  foot: {friction: 0.3, stiffness: 5000.0, damping: 40.0}
frames:
  knob: {position: [0.3, 0.0, 0.0], link: knob}
  floor: {position: [0.0, 0.0, 0.0]}
"""


def test_a_device_is_one_file(tmp_path: Path) -> None:
    file = tmp_path / "table.yaml"
    file.write_text(TABLE, encoding="utf-8")
    world, table = World(), make_device(file)
    body = table.spawn(world, Pose((1.0, 0.0, 0.0)))
    dynamics = bullet.getDynamicsInfo(body.uid, -1, physicsClientId=world.client)
    assert dynamics[1] == 0.3 and dynamics[8:10] == (40.0, 5000.0)
    assert table.model.links["foot"].inertia[5] == pytest.approx(8.0 * 2 * 0.4**2 / 12)
    table.set_position("height", 0.7)
    assert table.frame_in_world("knob").position == pytest.approx((1.3, 0.0, 0.7))
    assert table.frame_in_world("floor").position == pytest.approx((1.0, 0.0, 0.0))


def test_a_joint_of_a_device_can_be_fixed(tmp_path: Path) -> None:
    file = tmp_path / "table.yaml"
    file.write_text(TABLE.replace("controls:\n  height", "postures: {}\n#"), encoding="utf-8")
    table = Device(file, fixed={"height": 0.6})
    assert table.frame("knob").position == pytest.approx((0.3, 0.0, 0.6))
    body = table.spawn(World(), Pose((0.0, 1.0, 0.0)))
    assert not body.joints and body.link_count == 0
    assert table.frame_in_world("knob").position == pytest.approx((0.3, 1.0, 0.6))
    with pytest.raises(ConfigError, match="goes from 0.4 to 0.9, not to 1.2"):
        Device(file, fixed={"height": 1.2})
    with pytest.raises(UnknownNameError, match="Did you mean 'height'"):
        Device(file, fixed={"hight": 0.5})


@pytest.mark.parametrize(
    ("good", "bad", "message"),
    [
        (
            "position: [0.3",
            "positon: [0.3",
            r"Frame .*frames.knob.*'positon'. Did you mean 'position'",
        ),
        ("link: knob}", "link: knop}", r"link \(frame knob\) named 'knop'. Did you mean 'knob'"),
        (
            "joint: height",
            "joint: heigth",
            r"joint \(height\) named 'heigth'. Did you mean 'height'",
        ),
        (
            "contact:\n  foot",
            "contact:\n  fot",
            r"link \(contact\) named 'fot'. Did you mean 'foot'",
        ),
        ("friction: 0.3, stiffness: 5000.0,", "", "a stiffness and a damping, or neither"),
        ("material: wood", "material: wod", r"named 'wod'. Did you mean 'wood'"),
        (
            "    collision: [{kind: box, size: [0.6, 0.4, 0.02]}]\n",
            "",
            "'top' has a mass, but neither",
        ),
        (
            "    mass: 4.0\n",
            "    mass: 4.0\n    com: [0.1, 0.0, 0.0]\n",
            "'top' has a `com` but no",
        ),
        ("kind: prismatic", "kind: prismatc", r"'prismatc'. Did you mean 'prismatic'"),
    ],
)
def test_a_bad_file_says_what_is_wrong_in_it(
    tmp_path: Path, good: str, bad: str, message: str
) -> None:
    file = tmp_path / "table.yaml"
    assert good in TABLE
    file.write_text(TABLE.replace(good, bad), encoding="utf-8")
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        make_device(file)


def test_every_device_that_ships_can_be_made_and_says_where_its_figures_are_from() -> None:
    kinds = {path.stem for path in (ASSETS / "devices").glob("*.yaml")}
    for kind in kinds - {"sling_transfer", "sling_universal", "sponge_block"}:
        device = Device("overbed_table", fixed={"height": 0.9}) if "table" in kind else None
        device = device or make_device(kind)
        assert device.model.name == kind and device.model.source
        device.spawn(World())


def test_the_page_about_devices_runs_and_names_every_control(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (DOCS / "devices.md").read_text(encoding="utf-8")
    assert "(devices.md)" in (DOCS / "index.md").read_text(encoding="utf-8")
    for kind in device_kinds():
        device = make_device(kind)
        for name in (kind, type(device).__name__, *device.controls):
            assert f"`{name}`" in page, name
    for image in re.findall(r"!\[.*?\]\((.*?)\)", page):
        assert (DOCS / image).stat().st_size < 500_000
    for name, text in re.findall(r"```yaml\n# (\w+\.yaml)(.*?)```", page, re.DOTALL):
        (tmp_path / name).write_text(f"#{text}", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "devices.md", "exec"), names)
