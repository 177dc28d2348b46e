"""The baked skins that ship with the package: format, pose, size and closedness."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml

FOLDER = Path(__file__).parents[1] / "assets" / "avatars" / "bodies"
RECIPES: dict[str, Any] = yaml.safe_load((FOLDER / "recipes.yaml").read_text())["bodies"]
BODY = [
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "jaw",
    "left_eye_smplhf",
    "right_eye_smplhf",
]
FINGERS = [f"{f}{k}" for f in ("index", "middle", "pinky", "ring", "thumb") for k in (1, 2, 3)]
NAMES = BODY + [f"{side}_{finger}" for side in ("left", "right") for finger in FINGERS]
PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15]
for wrist, first in ((20, 25), (21, 40)):
    for start in range(first, first + 15, 3):
        PARENTS += [wrist, start, start + 1]

Arrays = dict[str, npt.NDArray[Any]]


@pytest.fixture(params=sorted(RECIPES))
def body(request: pytest.FixtureRequest) -> tuple[str, Arrays]:
    """Return the name and the arrays of each body in turn."""
    with np.load(FOLDER / f"{request.param}.npz", allow_pickle=False) as data:
        return request.param, {key: data[key] for key in data.files}


def joint(arrays: Arrays, name: str) -> npt.NDArray[np.float64]:
    return np.asarray(arrays["joints"][NAMES.index(name)], dtype=np.float64)


def meta(arrays: Arrays) -> dict[str, Any]:
    out: dict[str, Any] = json.loads(str(arrays["meta_json"]))
    return out


def volume(vertices: npt.NDArray[np.float64], faces: npt.NDArray[np.int32]) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", np.cross(a, b), c) / 6)


def largest_part(faces: npt.NDArray[np.int32], count: int) -> npt.NDArray[np.bool_]:
    """Return which faces belong to the largest connected piece."""
    label = np.arange(count)
    while True:
        low = label[faces].min(axis=1)
        spread = label.copy()
        for k in range(3):
            np.minimum.at(spread, faces[:, k], low)
        spread = spread[spread]
        if (spread == label).all():
            break
        label = spread
    of_face = label[faces[:, 0]]
    names, sizes = np.unique(of_face, return_counts=True)
    out: npt.NDArray[np.bool_] = of_face == names[sizes.argmax()]
    return out


def test_there_are_seven_small_bodies() -> None:
    sizes = {file.stem: file.stat().st_size for file in FOLDER.glob("*.npz")}
    assert set(sizes) == set(RECIPES)
    assert len(sizes) == 7
    assert max(sizes.values()) < 500_000
    assert sum(sizes.values()) < 3_500_000


def test_shapes_and_types(body: tuple[str, Arrays]) -> None:
    a = body[1]
    n, m = len(a["vertices"]), len(a["faces"])
    wanted = {
        "vertices": ((n, 3), "float32"),
        "faces": ((m, 3), "int32"),
        "joints": ((55, 3), "float32"),
        "weight_joints": ((n, 4), "uint8"),
        "weights": ((n, 4), "float32"),
        "colors": ((n, 3), "uint8"),
        "parents": ((55,), "int8"),
        "mouth": ((3,), "float32"),
    }
    for key, (shape, dtype) in wanted.items():
        assert a[key].shape == shape, key
        assert a[key].dtype == dtype, key
        assert np.isfinite(a[key]).all(), key
    assert a["names"].tolist() == NAMES
    assert a["parents"].tolist() == PARENTS
    assert n < 30_000


def test_weights_sum_to_one(body: tuple[str, Arrays]) -> None:
    a = body[1]
    assert (a["weights"] >= 0).all()
    np.testing.assert_allclose(a["weights"].sum(axis=1), 1, atol=1e-6)
    assert a["weight_joints"].max() < 55
    moved = np.bincount(a["weight_joints"].ravel(), a["weights"].ravel(), minlength=55)
    assert (moved > 0).all(), "every joint moves some vertex"


def test_rest_pose_is_the_t_pose(body: tuple[str, Arrays]) -> None:
    a = body[1]
    for side, sign in (("left", 1), ("right", -1)):
        arm = np.array([joint(a, f"{side}_{j}") for j in ("shoulder", "elbow", "wrist", "middle1")])
        assert np.ptp(arm[:, 1:], axis=0).max() < 0.02
        assert (np.diff(arm[:, 0] * sign) > 0.05).all()
        leg = np.array([joint(a, f"{side}_{j}") for j in ("hip", "knee", "ankle")])
        assert np.ptp(leg[:, [0, 2]], axis=0).max() < 0.05
        assert (np.diff(leg[:, 1]) < -0.25).all()
        # Palm down and thumb forward, toes forward.
        assert joint(a, f"{side}_index1")[2] > joint(a, f"{side}_pinky1")[2] + 0.03
        assert joint(a, f"{side}_foot")[2] > joint(a, f"{side}_ankle")[2] + 0.08
    assert joint(a, "left_eye_smplhf")[2] > joint(a, "head")[2]


def test_joints_mirror(body: tuple[str, Arrays]) -> None:
    a = body[1]
    for name in NAMES:
        other = name.replace("left", "*").replace("right", "left").replace("*", "right")
        np.testing.assert_allclose(joint(a, name), joint(a, other) * [-1, 1, 1], atol=0.005)


def test_limb_joints_lie_inside_the_limb(body: tuple[str, Arrays]) -> None:
    a = body[1]
    for name, along in (("left_elbow", 0), ("left_wrist", 0), ("left_knee", 1), ("right_knee", 1)):
        centre = joint(a, name)
        others = [k for k in range(3) if k != along]
        near = abs(a["vertices"][:, along] - centre[along]) < 0.015
        near &= np.linalg.norm(a["vertices"] - centre, axis=1) < 0.12
        d = a["vertices"][near][:, others] - centre[others]
        angles = np.sort(np.arctan2(d[:, 1], d[:, 0]))
        gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
        assert gaps.max() < np.pi * 0.75, f"{name} is not surrounded by skin"


def test_faces_are_closed_and_look_outward(body: tuple[str, Arrays]) -> None:
    a = body[1]
    vertices, faces = a["vertices"].astype(np.float64), a["faces"]
    assert faces.min() == 0 and faces.max() == len(vertices) - 1
    assert (faces[:, 0] != faces[:, 1]).all() and (faces[:, 1] != faces[:, 2]).all()
    skin = faces[largest_part(faces, len(vertices))]
    directed = skin[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    forth = directed[:, 0] * len(vertices) + directed[:, 1]
    back = directed[:, 1] * len(vertices) + directed[:, 0]
    assert len(np.unique(forth)) == len(forth), "an edge is used twice in one direction"
    assert np.isin(forth, back).all(), "the body has a hole"
    # Clothes, hair and shoes add volume to that of the naked body.
    naked = meta(a)["mass_kg"] / 980
    assert naked < volume(vertices, skin) < 1.3 * naked


def test_stature_and_mass(body: tuple[str, Arrays]) -> None:
    name, a = body
    recipe, facts = RECIPES[name], meta(a)
    assert facts["height_m"] == pytest.approx(recipe["height"], rel=0.01)
    assert facts["mass_kg"] == pytest.approx(recipe["mass"], rel=0.01)
    assert facts["licence"] == "CC0-1.0"
    y = a["vertices"][:, 1]
    assert y.min() == pytest.approx(0, abs=1e-3)
    assert recipe["height"] < y.max() < recipe["height"] + 0.06  # sole and hair


def test_mouth_is_between_the_lips(body: tuple[str, Arrays]) -> None:
    a = body[1]
    upper, lower = a["vertices"][a["lips_upper"]], a["vertices"][a["lips_lower"]]
    assert len(upper) >= 3 and len(lower) >= 3
    mouth = a["mouth"]
    assert abs(mouth[0]) < 1e-3
    assert abs(upper[:, 1].mean() - mouth[1]) < 0.006
    assert abs(lower[:, 1].mean() - mouth[1]) < 0.006
    assert mouth[2] > joint(a, "jaw")[2] + 0.05
    jaw = (a["weight_joints"] == NAMES.index("jaw")) * a["weights"]
    assert (jaw[a["lips_lower"]].sum(axis=1) > 0.5).all(), "the lower lip follows the jaw"
    assert (jaw[a["lips_upper"]].sum(axis=1) < 0.5).all()
