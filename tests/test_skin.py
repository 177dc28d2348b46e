"""Body models: the shipped ones and a user's own SMPL-X file give the same thing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rcare_marl import assets
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.body.skeleton import JOINTS, PARENTS, forward_kinematics
from rcare_marl.agents.people.body.skin import SMPLX_VERTEX_COUNT, load_body_model
from rcare_marl.agents.people.human import Human
from rcare_marl.config import load, read_yaml
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.world import World


def synthetic_smplx() -> dict[str, Any]:
    """Return arrays of the shape of a licensed SMPL-X file, sampled from one of our own bodies."""
    ours = load_body_model(assets.ROOT / "avatars" / "bodies" / "karan.npz")
    rng = np.random.default_rng(0)
    chosen = np.sort(rng.choice(len(ours.vertices), SMPLX_VERTEX_COUNT, replace=False))
    vertices = ours.vertices[chosen].astype(np.float64)
    weights = np.zeros((SMPLX_VERTEX_COUNT, 55))
    rows = np.arange(SMPLX_VERTEX_COUNT)[:, None]
    np.add.at(weights, (rows, ours.weight_joints[chosen].astype(int)), ours.weights[chosen])
    # The weights of least norm that give each joint exactly.
    corners = np.vstack((vertices.T, np.ones(SMPLX_VERTEX_COUNT)))
    regressor = (np.linalg.pinv(corners) @ np.vstack((ours.joints.T, np.ones(55)))).T
    parents = np.array([2**32 - 1, *PARENTS[1:]], np.int64)
    faces = rng.integers(0, SMPLX_VERTEX_COUNT, (20908, 3))
    return {
        "v_template": vertices - (0, 1.2, 0),  # SMPL-X has its origin near the chest
        "f": faces.astype(np.uint32),
        "weights": weights,
        "J_regressor": regressor,
        "kintree_table": np.stack((parents, np.arange(55))),
        "shapedirs": np.zeros((4, 3, 20)),
        "joint2num": np.array({"pelvis": 0}, dtype=object),  # licensed files hold pickles too
    }


@pytest.fixture(scope="module")
def smplx_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("smplx") / "SMPLX_NEUTRAL.npz"
    np.savez(file, **synthetic_smplx())
    return file


def test_a_users_own_smplx_file_is_read(smplx_file: Path) -> None:
    model = load_body_model(smplx_file)
    assert model.vertices.shape == (10475, 3)
    assert model.joints.shape == (55, 3)
    np.testing.assert_allclose(model.weights.sum(axis=1), 1, atol=1e-5)
    assert model.vertices[:, 1].min() == pytest.approx(0, abs=1e-6)


def test_a_person_with_a_users_own_smplx_body_stands_in_the_world(smplx_file: Path) -> None:
    data = {**read_yaml(assets.find("avatars", "karan")), "body": str(smplx_file)}
    avatar = load(type(load_avatar("karan")), data)
    world = World()
    human = Human("recipient", avatar, posture=load_posture("standing"), movable=("head",))
    human.spawn(world, Pose())
    surface = world.skins[0].vertices()
    assert np.ptp(surface[:, 2]) == pytest.approx(avatar.height_m, rel=0.02)
    assert surface[:, 2].min() == pytest.approx(0, abs=0.02)
    for _ in range(120):
        human.actuate()
        world.step()
    human.sense()
    assert np.abs(np.array(human.positions) - human._start).max() < 0.02


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("v_template", np.zeros((100, 3)), "10475"),
        ("weights", np.zeros((10475, 24)), "weights must be"),
        ("J_regressor", np.zeros((24, 10475)), "J_regressor must be"),
        ("kintree_table", np.zeros((2, 24)), "kintree_table"),
        ("f", np.full((5, 3), 99999), "faces name vertices"),
    ],
)
def test_a_misshapen_smplx_file_is_named(
    tmp_path: Path, key: str, value: Any, message: str
) -> None:
    file = tmp_path / "SMPLX_WRONG.npz"
    np.savez(file, **{**synthetic_smplx(), key: value})
    with pytest.raises(ConfigError, match=message):
        load_body_model(file)


def test_a_file_that_lacks_arrays_or_is_none_is_named(tmp_path: Path) -> None:
    file = tmp_path / "body.npz"
    np.savez(file, vertices=np.zeros((3, 3)))
    with pytest.raises(ConfigError, match="lacks faces"):
        load_body_model(file)
    file.write_text("not a zip")
    with pytest.raises(ConfigError, match="body.npz"):
        load_body_model(file)
    with pytest.raises(ConfigError, match="nobody.npz"):
        load_body_model(tmp_path / "nobody.npz")


def test_skinning_at_rest_gives_the_rest_shape_back() -> None:
    model = load_body_model(assets.ROOT / "avatars" / "bodies" / "kim.npz")
    rotations, positions = forward_kinematics(model.joints, np.zeros(112))
    np.testing.assert_allclose(
        model.posed(rotations, positions), model.vertices - model.joints[0], atol=1e-5
    )


def test_skinning_in_numba_equals_the_formula() -> None:
    model = load_body_model(assets.ROOT / "avatars" / "bodies" / "daniel.npz")
    rng = np.random.default_rng(1)
    rotations, positions = forward_kinematics(model.joints, rng.uniform(-0.5, 0.5, 112))
    moved = np.einsum("jab,njb->nja", rotations, model.vertices[:, None] - model.joints) + positions
    full = np.zeros((len(model.vertices), len(JOINTS)))
    rows = np.arange(len(full))[:, None]
    np.add.at(full, (rows, model.weight_joints.astype(int)), model.weights)
    expected = np.einsum("nj,nja->na", full, moved)
    np.testing.assert_allclose(model.posed(rotations, positions), expected, atol=2e-5)
