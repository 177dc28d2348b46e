"""Malformed YAML gets an error that names the field, what was got and what is allowed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from rcare_marl import assets
from rcare_marl.agents.people.avatar import AvatarConfig, load_avatar, load_posture
from rcare_marl.agents.people.profile import SideProfile, Vitals
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.config import load, read_yaml
from rcare_marl.envs.tasks.feeding import FeedingOptions
from rcare_marl.errors import ConfigError, RcareError, UnknownNameError

KARAN = read_yaml(assets.find("avatars", "karan"))


def changed(path: str, value: Any) -> dict[str, Any]:
    """Return Karan's file with one value changed; `path` is dotted."""
    data: dict[str, Any] = yaml.safe_load(yaml.safe_dump(KARAN))
    *parents, last = path.split(".")
    place = data
    for key in parents:
        place = place[key]
    place[last] = value
    return data


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("name", 3, "name: expected str"),
        ("condition", None, "condition: expected str"),
        ("sex", "man", "female"),
        ("height_m", "tall", "height_m: expected float"),
        ("height_m", 17.0, "height_m must lie in"),
        ("mass_kg", -1, "mass_kg must lie in"),
        ("mass_kg", True, "mass_kg: expected float"),
        ("mass_kg", float("nan"), "finite"),
        ("age_years", 200, "age_years must lie in"),
        ("body", 1.0, "body: expected str"),
        ("heigth_m", 1.7, "Did you mean 'height_m'"),
        ("profile", [], "profile: expected a mapping"),
        ("profile.lft", {}, "Did you mean 'left'"),
        ("profile.left.mmt.elbow_flexors", 7, "grade from 0 to 5"),
        ("profile.left.mmt.elbow_flexers", 3, "Did you mean 'elbow_flexors'"),
        ("profile.left.mmt.elbow_flexors", "three", "a number (3+ is 3.33), got 'three'"),
        ("profile.left.mmt.elbow_flexors", "3+", "a number (3+ is 3.33), got '3+'"),
        ("profile.left.mmt.elbow_flexors", True, "grade from 0 to 5, a number"),
        ("profile.left.mmt.elbow_flexors", float("nan"), "grade from 0 to 5"),
        (
            "profile.left.spasticity.elbow_flexors",
            2,
            'in quotes, one of "0", "1", "1+", "2", "3", "4", got 2',
        ),
        ("profile.left.spasticity.elbow_flexors", 1.5, "grade in quotes"),
        ("profile.left.tremor", {"wrist_flexors": 2.0}, "share from 0 to 1"),
        ("profile.left.tremor", {"wrist": 0.2}, "wrist_flexors"),
        ("profile.left.prom_deg.elbow_flexon", 3, "Did you mean 'elbow_flexion'"),
        ("profile.left.prom_deg.elbow_flexion", 400, "-90..190"),
        ("profile.left.arom_deg.shoulder_flexion", 150, "beyond the passive range"),
        ("profile.left.spasticity.elbow_flexors", "5", "Modified Ashworth"),
        ("profile.left.spasticity.elbow", "1", "elbow_flexors"),
        ("profile.left.sensation", "some", "reduced"),
        ("profile.axial.prom_deg.knee_flexion", 10, "belongs to axial"),
        ("profile.left.prom_deg.neck_flexion", 1, "belongs to left"),
        ("profile.axial.mmt.elbow_flexors", 0, "belongs to axial"),
        ("profile.vitals.heart_rate", 500, "heart_rate must lie in"),
        ("profile.vitals.systolic", 40, "blood pressure"),
        ("profile.vitals.temperature", 20, "temperature must lie in"),
    ],
)
def test_each_wrong_field_of_an_avatar_is_named(path: str, value: Any, message: str) -> None:
    with pytest.raises(RcareError) as caught:
        load(AvatarConfig, changed(path, value))
    assert message in str(caught.value)


def test_a_refused_grade_in_a_file_is_named_with_file_and_side(tmp_path: Path) -> None:
    file = tmp_path / "me.yaml"
    file.write_text(yaml.safe_dump(changed("profile.left.spasticity.elbow_flexors", 2)))
    with pytest.raises(ConfigError, match=r"me\.yaml\.profile\.left: spasticity\.elbow_flexors"):
        load_avatar(file)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"arom_deg": {"elbow_flexion": 150}, "prom_deg": {"elbow_flexion": 90}}, "beyond"),
        ({"prom_deg": {"elbow_flexion": "90"}}, "must lie in -90..190 deg, got '90'"),
        ({"mmt": {"elbow_flexors": "3+"}}, "a number (3+ is 3.33), got '3+'"),
        ({"mmt": {"elbow_flexors": True}}, "got True"),
        ({"mmt": {"elbow_flexors": math.nan}}, "got nan"),
        ({"spasticity": {"elbow_flexors": 2}}, 'in quotes, one of "0", "1", "1+"'),
        ({"tremor": {"wrist_flexors": True}}, "share from 0 to 1, got True"),
    ],
)
def test_a_profile_built_in_python_gets_the_same_errors(
    values: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        SideProfile(**values)
    assert message in str(caught.value)


def test_vital_signs_built_in_python_get_the_same_errors() -> None:
    with pytest.raises(ConfigError, match="blood pressure"):
        Vitals(systolic=70.0, diastolic=90.0)


@pytest.mark.parametrize("missing", ["name", "condition", "sex", "height_m", "mass_kg"])
def test_each_missing_field_of_an_avatar_is_named(missing: str) -> None:
    with pytest.raises(ConfigError, match=f"missing {missing}"):
        load(AvatarConfig, {key: value for key, value in KARAN.items() if key != missing})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: [", "not valid YAML"),
        ("- a\n- b", "expected a mapping"),
        ("name: a\nname: b", "stands twice"),
        ("", "expected a mapping"),
    ],
)
def test_a_file_that_is_no_mapping_is_named(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "me.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        load_avatar(file)
    assert "me.yaml" in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nobody.yaml"):
        load_avatar(tmp_path / "nobody.yaml")


def test_a_file_that_is_not_text_is_named(tmp_path: Path) -> None:
    file = tmp_path / "me.yaml"
    file.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ConfigError, match="me.yaml"):
        load_avatar(file)


def test_a_misspelt_name_gets_the_nearest_one() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'karan'"):
        load_avatar("karen")
    with pytest.raises(UnknownNameError, match="Did you mean 'wheelchair'"):
        load_posture("wheelchiar")
    with pytest.raises(UnknownNameError, match="Did you mean 'kinova_gen3'"):
        load_robot("kinova_gen33")


def test_what_belongs_to_the_class_alone_is_no_field() -> None:
    with pytest.raises(UnknownNameError, match="SHAPED_WEIGHTS") as caught:
        load(FeedingOptions, {"SHAPED_WEIGHTS": {}})
    assert "SHAPED_WEIGHTS" not in str(caught.value).split("Known:")[1]


def test_a_posture_with_an_unknown_angle_or_joint_is_refused(tmp_path: Path) -> None:
    good = read_yaml(assets.find("postures", "standing"))
    for change, message in (
        ({"angles_deg": {"knee_flexon": 3}}, "knee_flexion"),
        ({"rests_on": ["left_anckle"]}, "left_ankle"),
        ({"rests_on": []}, "at least one"),
        ({"sink": 1.0}, "sink"),
        ({"arms": "up"}, "armrests"),
    ):
        file = tmp_path / "posture.yaml"
        file.write_text(yaml.safe_dump({**good, **change}))
        with pytest.raises(RcareError, match=message):
            load_posture(file)


@pytest.mark.parametrize("kind", ["avatars", "postures", "robots"])
def test_every_shipped_file_loads(kind: str) -> None:
    loader = {"avatars": load_avatar, "postures": load_posture, "robots": load_robot}[kind]
    for name in assets.names(kind):
        loader(name)


def test_synthetic_profiles_say_so_and_name_their_sources() -> None:
    for name in assets.names("avatars"):
        text = assets.find("avatars", name).read_text()
        assert "SYNTHETIC" in text and "AAOS" in text
