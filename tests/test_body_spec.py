"""Bodies of anybody out of the shape basis: stature, mass, girths, proportions, the cache and errors."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from rcare_marl.agents.people.avatar import (
    AvatarConfig,
    body_model,
    body_segments,
    load_avatar,
    person_urdf,
)
from rcare_marl.agents.people.body.bake.basis import pack, shape_basis, unpack
from rcare_marl.agents.people.body.bake.fit import fit_body
from rcare_marl.agents.people.body.bake.girth import GIRTHS, girths
from rcare_marl.agents.people.body.body_spec import BodySpec, body_recipe
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.sampling.population import find_avatar
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, UnknownNameError

PEOPLE = [  # sex, age, stature, mass
    ("male", 6, 1.155, 20.7),
    ("female", 9, 1.35, 55.0),
    ("male", 30, 1.756, 85.5),
    ("female", 29, 1.629, 67.8),
    ("male", 45, 1.78, 150.0),
    ("female", 35, 1.68, 42.0),
    ("female", 95, 1.50, 48.0),
]


def person(tmp_path: Path, body: str = "{seed: 3}", **fields: object) -> AvatarConfig:
    given = {"sex": "female", "age_years": 33, "height_m": 1.61, "mass_kg": 58} | fields
    lines = [f"{key}: {value}" for key, value in given.items()]
    file = tmp_path / "someone.yaml"
    file.write_text("\n".join(["name: Someone", "condition: none", f"body: {body}", *lines]))
    return load_avatar(file)


@pytest.mark.parametrize(
    ("sex", "age", "height", "mass"),
    [pytest.param(*who, marks=pytest.mark.slow if k % 2 else ()) for k, who in enumerate(PEOPLE)],
)
def test_anybody_has_their_stature_and_mass(sex: str, age: int, height: float, mass: float) -> None:
    recipe = body_recipe(BodySpec(seed=2), sex, age, height, mass)  # type: ignore[arg-type]
    body = fit_body(shape_basis(), recipe)
    assert abs(body.height - height) < 1e-3
    assert abs(body.mass - mass) < 0.5
    assert np.isfinite(body.mesh.vertices).all()


# 940 is shorter than the shapes go; the trousers of 943 reach across the middle of the body at the ankles.
@pytest.mark.parametrize("number", [940, 943])
def test_who_is_drawn_from_a_population_has_a_body_of_their_stature(number: int) -> None:
    avatar = find_avatar(f"population:train:{number}")
    with np.load(avatar.body_path()) as body:
        assert abs(json.loads(str(body["meta_json"]))["height_m"] - avatar.height_m) < 1e-3
        for side in (1, -1):  # two shoes stand on the floor
            assert abs(body["vertices"][side * body["vertices"][:, 0] > 0, 1].min()) < 0.02


@pytest.mark.parametrize("who", ["daniel", "population:train:807", "population:train:709"])
def test_no_trunk_rises_above_its_own_skin_before_the_chin(who: str) -> None:
    avatar = find_avatar(who)  # two of them weigh 121 and 106 kg
    path = avatar.body_path()
    model = body_model(path, avatar.height_m)
    shape = body_segments(path, avatar.height_m, avatar.mass_kg, avatar.sex)["spine3"].shapes[0]
    top = JOINT_INDEX["spine3"]
    skin = model.vertices[model.owner == top][:, 1]
    assert model.joints[top][1] + shape.centre[1] + shape.size[1] < np.quantile(skin, 0.97) + 0.001


@pytest.mark.slow
def test_girths_and_proportions_are_those_wanted() -> None:
    wanted = {"waist": 0.94, "hips": 1.02, "chest": 1.06, "thigh": 0.625, "upper_arm": 0.34}
    spec = BodySpec(girths=wanted, proportions={"forearm": 1.06})
    body = fit_body(shape_basis(), body_recipe(spec, "male", 30, 1.756, 85.5))
    have = girths(body.mesh, body.joints, len(shape_basis().faces))
    assert {name: have[name] for name in wanted} == pytest.approx(wanted, rel=0.01)
    assert set(have) == set(GIRTHS)
    assert abs(body.height - 1.756) < 1e-3
    assert abs(body.mass - 85.5) < 0.5
    plain = fit_body(shape_basis(), body_recipe(BodySpec(), "male", 30, 1.756, 85.5))

    def forearm(joints: np.ndarray) -> float:
        ends = joints[[JOINT_INDEX["left_elbow"], JOINT_INDEX["left_wrist"]]]
        return float(np.linalg.norm(ends[1] - ends[0]))

    assert forearm(body.joints) == pytest.approx(1.06 * forearm(plain.joints), rel=0.003)


def test_an_avatar_without_a_file_is_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RCARE_MARL_CACHE", str(tmp_path / "cache"))
    avatar = person(tmp_path)
    file = avatar.body_path()
    stamp = file.stat().st_mtime_ns
    assert person(tmp_path).body_path() == file
    assert file.stat().st_mtime_ns == stamp
    assert person(tmp_path, body="{seed: 4}").body_path() != file
    model = body_model(file, avatar.height_m)
    assert model.meta["height_m"] == pytest.approx(1.61, abs=1e-3)
    assert model.meta["mass_kg"] == pytest.approx(58, abs=0.5)
    segments = body_segments(file, avatar.height_m, avatar.mass_kg, avatar.sex)
    assert sum(s.mass for s in segments.values()) == pytest.approx(58)
    assert "left_elbow_flexion" in person_urdf(avatar, "passive").text


def test_the_same_spec_gives_the_same_recipe_and_a_seed_another_look() -> None:
    make = [body_recipe(BodySpec(seed=s), "male", 40, 1.8, 80) for s in (1, 1, 2)]
    assert make[0] == make[1]
    assert make[0] != dataclasses.replace(make[2], seed=1)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"body": "{girths: {wast: 0.9}}"}, "waist"),
        ({"body": "{proportions: {thigh: 1.6}}"}, "0.85..1.15"),
        ({"body": "{changes: {nose-hump: 0.4}}"}, "nose-hump-incr"),
        ({"body": "{ancestry: {martian: 1}}"}, "ancestry"),
        ({"body": "{muscle: 2}"}, "0..1"),
        ({"age_years": 3}, "6..95"),
    ],
)
def test_a_wrong_spec_is_named(tmp_path: Path, fields: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        person(tmp_path, **fields)  # type: ignore[arg-type]


def test_what_no_body_has_is_named() -> None:
    with pytest.raises(ConfigError, match="no body of"):
        fit_body(shape_basis(), body_recipe(BodySpec(), "male", 30, 2.6, 60))
    with pytest.raises(ConfigError, match="girth of waist"):
        spec = BodySpec(girths={"waist": 0.4})
        fit_body(shape_basis(), body_recipe(spec, "male", 30, 1.8, 90))
    with pytest.raises(UnknownNameError):
        load(BodySpec, {"mucsle": 0.4})


def test_packing_keeps_every_step() -> None:
    steps = np.random.default_rng(0).integers(-9000, 9000, (3, 40, 3))
    assert (unpack(pack(steps)) == steps).all()
