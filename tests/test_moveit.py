from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rcare_marl import assets
from rcare_marl.agents.robots.moveit import (
    Planned,
    colliding,
    ignored_pairs,
    moveit_package,
    pair,
    planned,
    set_posture,
    spawn,
)
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.cli.app import app
from rcare_marl.world import World

QUICK = ("kinova_gen3",)
ROBOTS = [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
    for name in assets.names("robots")
]
SEED = 4711  # of judging: no posture is one that pairs were chosen by
POSTURES = 1000


@pytest.fixture(scope="module", params=ROBOTS)
def package(
    request: Any, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Planned, dict[str, Any], Path]:
    robot = planned(load_robot(request.param))
    ignored = ignored_pairs(robot)
    folder = tmp_path_factory.mktemp("moveit")
    for name, text in moveit_package(robot, ignored).items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return robot, ignored, folder


def files(robot: Planned, folder: Path) -> tuple[str, str]:
    config = folder / "config" / robot.model.name
    return f"{config}.urdf", f"{config}.srdf"


@pytest.mark.slow
def test_pinocchio_has_every_link_where_we_have_it(package: Any) -> None:
    pin = pytest.importorskip("pinocchio")
    robot, _, folder = package
    urdf, _ = files(robot, folder)
    model = pin.buildModelFromUrdf(urdf)
    data = model.createData()
    world = World()
    body = spawn(robot, world)
    worst = 0.0
    for posture in robot.postures(np.random.default_rng(SEED), POSTURES):
        set_posture(body, posture)
        q = pin.neutral(model)
        for name, value in posture.items():
            joint = model.joints[model.getJointId(name)]
            turn = (np.cos(value), np.sin(value))
            q[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else turn
        pin.framesForwardKinematics(model, data, q)
        for name, index in body.links.items():
            if index < 0:
                continue
            there = data.oMf[model.getFrameId(name, pin.FrameType.BODY)].translation
            worst = max(worst, float(np.abs(there - body.link_pose(index).position).max()))
    world.close()
    assert worst < 1e-6


def test_srdf_loads_and_takes_its_pairs_away(package: Any) -> None:
    pin = pytest.importorskip("pinocchio")
    robot, ignored, folder = package
    urdf, srdf = files(robot, folder)
    model = pin.buildModelFromUrdf(urdf)
    solids = pin.buildGeomFromUrdf(model, urdf, pin.GeometryType.COLLISION)
    solids.addAllCollisionPairs()
    pin.removeCollisionPairs(model, solids, srdf)
    pin.loadReferenceConfigurations(model, srdf)

    def link(index: int) -> str:
        return str(model.frames[solids.geometryObjects[index].parentFrame].name)

    left = {pair(link(each.first), link(each.second)) for each in solids.collisionPairs}
    told = {each for pairs in ignored.values() for each in pairs}
    assert told and not left & told
    assert "home" in model.referenceConfigurations


def test_no_ignored_pair_collides_in_other_postures(package: Any) -> None:
    robot, ignored, _ = package
    world = World()
    body = spawn(robot, world)
    met = set()
    for posture in robot.postures(np.random.default_rng(SEED), POSTURES):
        set_posture(body, posture)
        met |= colliding(body, world.client)
    world.close()
    assert not met & set(ignored["Never"])


def test_links_that_can_meet_are_not_ignored() -> None:
    robot = planned(load_robot("kinova_gen3"))
    told = ignored_pairs(robot, samples=500)
    everything = {each for pairs in told.values() for each in pairs}
    assert pair("base_link", "end_effector_link") not in everything


@pytest.mark.slow
def test_a_task_comes_with_its_person_as_a_planning_scene(tmp_path: Path) -> None:
    out = tmp_path / "package"
    result = CliRunner().invoke(app, ["export", "feeding", "--format", "moveit", "--out", str(out)])
    assert result.exit_code == 0, result.output
    text = (out / "scene" / "feeding.scene").read_text()
    assert "* recipient" in text and "* wheelchair" in text
    assert "* robot" not in text and "* spoon" not in text  # planned for, and held
    assert text.endswith(".\n")
