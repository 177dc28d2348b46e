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

from rcare_marl.envs.devices import ManualWheelchair, SlideBoard, device_kinds, make_device
from rcare_marl.errors import ActionError, ConfigError, UnknownNameError, WorldError
from rcare_marl.world import SOLVER_ITERATIONS, World

DOCS = Path(__file__).resolve().parents[1] / "docs"


def test_the_eight_kinds_can_be_made_by_name_and_have_data_files() -> None:
    kinds = device_kinds()
    assert len(kinds) == len(set(kinds)) == 8
    for kind in kinds:
        device = make_device(kind)
        assert device.model().name == kind and device.model().source
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
    SlideBoard().spawn(world)
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


def test_the_page_about_devices_runs_and_names_every_control() -> None:
    page = (DOCS / "devices.md").read_text(encoding="utf-8")
    assert "(devices.md)" in (DOCS / "index.md").read_text(encoding="utf-8")
    for kind in device_kinds():
        device = make_device(kind)
        for name in (kind, type(device).__name__, *device.controls):
            assert f"`{name}`" in page, name
    for image in re.findall(r"!\[.*?\]\((.*?)\)", page):
        assert (DOCS / image).stat().st_size < 500_000
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "devices.md", "exec"), names)
