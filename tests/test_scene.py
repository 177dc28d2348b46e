"""A scene as data: the same bodies, places, masses and contacts in MuJoCo and in URDF files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import rcare_marl
from rcare_marl.body import Body
from rcare_marl.cli import app
from rcare_marl.envs import task_names
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.pose import Array, Pose
from rcare_marl.scene.mjcf import START, body_name, joint_name, mjcf
from rcare_marl.scene.scene import link_name, link_poses, scene_of
from rcare_marl.world import GRAVITY, World

QUICK = ("feeding", "ambulating")
TASKS = [pytest.param(t, marks=() if t in QUICK else pytest.mark.slow) for t in task_names()]
PLACE = 1e-6  # [m]
SHARE = 1e-3  # of a mass or a torque


@contextmanager
def begun(task: str, **cast: Any) -> Iterator[CareEnv]:
    with closing(rcare_marl.make(task, **cast)) as env:
        env.reset(seed=0)
        yield env


def loaded(files: dict[str, str]) -> tuple[Any, Any]:
    """Return MuJoCo's model and data at the start."""
    assets = {name: text.encode() for name, text in files.items()}
    model = mujoco.MjModel.from_xml_string(files["scene.xml"], assets)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(START).id)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("task", TASKS)
def test_links_masses_and_weights_are_in_mujoco_what_they_are_in_bullet(task: str) -> None:
    with begun(task) as env:
        scene = scene_of(env.world)
        model, data = loaded(mjcf(scene))
        matrix = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, matrix)
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        for body in env.world.bodies:
            known = link_poses(scene.bodies[body.name])
            for index in range(-1, body.link_count):
                name, place = link_name(body, index), body.link_pose(index).position
                assert np.allclose(known[name].position, place, atol=PLACE), (body.name, name)
                theirs = data.body(body_name((body.name, name))).xpos
                assert np.allclose(theirs, place, atol=PLACE), (body.name, name)
            if body.is_movable or not body.joints or env.world.held_by(body):
                continue  # what is held is a part of who holds it there
            dofs = [model.joint(joint_name(body.name, j)).dofadr[0] for j in body.joints]
            angles = list(scene.bodies[body.name].positions.values())
            ours = body.mass_matrix(angles)
            assert np.allclose(matrix[np.ix_(dofs, dofs)], ours, atol=SHARE * np.abs(ours).max())
            weights = weights_of(body, angles)
            most = max(1e-3, SHARE * np.abs(weights).max())
            assert np.allclose(data.qfrc_bias[dofs], weights, atol=most), body.name


def weights_of(body: Body, angles: list[float]) -> Array:
    """Return what gravity asks of each joint in Bullet [N·m or N], by a difference of energy."""
    indices, links = [j.index for j in body.joints.values()], range(body.link_count)
    masses, rise = np.array([body.mass(link) for link in links]), 1e-5

    def energy(place: int, way: float) -> float:
        body.set_joints(indices, [a + way * (i == place) for i, a in enumerate(angles)])
        return float(GRAVITY * masses @ body.link_centres(links)[:, 2])

    both = [(energy(i, rise), energy(i, -rise)) for i in range(len(indices))]
    body.set_joints(indices, angles)
    return np.array([(up - down) / (2 * rise) for up, down in both])


def test_who_touches_whom_is_the_same() -> None:
    with begun("feeding") as env:
        scene = scene_of(env.world)
        model, data = loaded(mjcf(scene))
        links = [model.body(model.geom_bodyid[g]).name.split("/") for g in range(model.ngeom)]
        found = {(links[c.geom1][0], links[c.geom2][0]) for c in data.contact}
        assert found == {(f"food_{i}", "spoon") for i in range(4)}
        assert scene.meeting
        for pair in scene.meeting:
            assert len({name for name, _ in pair}) == 1
        paired = {tuple(sorted((pair.body1, pair.body2))) for pair in _pairs(model)}
        assert paired == {tuple(sorted(body_name(p) for p in pair)) for pair in scene.meeting}


def _pairs(model: Any) -> Iterator[Any]:
    class Pair:
        def __init__(self, i: int) -> None:
            self.body1, self.body2 = (
                model.body(model.geom_bodyid[geom]).name
                for geom in (model.pair_geom1[i], model.pair_geom2[i])
            )

    return (Pair(i) for i in range(model.npair))


def test_a_scene_goes_on_in_mujoco_and_a_ball_falls_as_it_should() -> None:
    world = World()
    world.add_box((4, 4, 0.1), Pose((0, 0, -0.05)), name="floor")
    world.add_sphere(0.1, Pose((0, 0, 1.1)), mass=0.5, name="ball")
    model, data = loaded(mjcf(scene_of(world)))
    world.close()
    for _ in range(round(0.4 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert data.body("ball/base").xpos[2] == pytest.approx(1.1 - 0.5 * 9.81 * 0.16, abs=0.01)
    for _ in range(round(3 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert data.body("ball/base").xpos[2] == pytest.approx(0.1, abs=0.005)


def test_export_leaves_files_that_load_and_says_what_is_wrong(tmp_path: Path) -> None:
    runner, there = CliRunner(), tmp_path / "toilet"
    told = runner.invoke(app, ["export", "toileting", "--output", str(there)])
    assert told.exit_code == 0, told.output
    model = mujoco.MjModel.from_xml_path(str(there / "scene.xml"))
    assert any(model.geom(i).name.startswith("toilet/") for i in range(model.ngeom))
    again = runner.invoke(app, ["export", "toileting", "--output", str(there)])
    assert again.exit_code == 2
    wrong = runner.invoke(app, ["export", "toileting", "--format", "mjfc"])
    assert wrong.exit_code == 2


def test_urdf_files_put_everybody_where_they_are(tmp_path: Path) -> None:
    there = tmp_path / "feeding"
    told = CliRunner().invoke(
        app, ["export", "feeding", "--format", "urdf", "--no-meshes", "--output", str(there)]
    )
    assert told.exit_code == 0, told.output
    about = yaml.safe_load((there / "scene.yaml").read_text(encoding="utf-8"))
    world = World()
    with begun("feeding") as env:
        for body in env.world.bodies:
            entry = about["bodies"][body.name]
            pose = Pose(*(tuple(entry["pose"][key]) for key in ("position", "quaternion")))
            twin = world.load_urdf(there / entry["urdf"], pose, fixed=not entry["is_movable"])
            indices = twin.indices(entry["positions"])
            twin.set_joints(indices, list(entry["positions"].values()))
            ours, theirs = body.link_poses()[0], twin.link_poses()[0]
            assert np.allclose(ours, theirs, atol=PLACE), body.name
            assert twin.mass() == pytest.approx(body.mass(), abs=1e-4)
    assert (there / "recipient" / "recipient_active.urdf").is_file()
    assert (there / "recipient" / "recipient_passive.urdf").is_file()
    world.close()
