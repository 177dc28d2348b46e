"""People drawn at random: consistent profiles, severities and scales, populations, their command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner
from variants import every

import rcare_marl
from rcare_marl.agents.people.avatar import AvatarConfig, load_avatar
from rcare_marl.agents.people.body.body_spec import BodySpec
from rcare_marl.agents.people.body.skeleton import DOFS
from rcare_marl.agents.people.profile import ASHWORTH, SPINAL_LEVELS, clinical_norms
from rcare_marl.agents.people.sampling.condition import condition_names, load_condition
from rcare_marl.agents.people.sampling.population import (
    avatar_fields,
    find_avatar,
    people_of,
    person_of,
    population_hash,
    population_size,
)
from rcare_marl.agents.people.sampling.sampler import sample_person
from rcare_marl.cli import app
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, UnknownNameError

SEEDS = range(25)


def check_consistent(avatar: AvatarConfig) -> None:
    """Hold what must be true of anybody: ranges within ranges, no motion without a muscle."""
    norms, profile = clinical_norms().motions, avatar.profile
    active, passive = profile.limits("active"), profile.limits("passive")
    for dof in DOFS:
        low, high = passive[dof.name]
        least, most = active[dof.name]
        assert low <= high
        assert low - 1e-9 <= least <= most <= high + 1e-9, (avatar.condition, dof.name)
    for side in ("axial", "left", "right"):
        mine = profile.side(side)
        for motion, angle in mine.arom_deg.items():
            grade = mine.mmt.get(norms[motion].group, 5.0)
            assert angle == 0 or grade >= 2, (avatar.condition, side, motion)
            whole = mine.prom_deg.get(motion, norms[motion].range_deg)
            assert angle <= whole
    vitals = profile.vitals
    assert 15 <= vitals.systolic - vitals.diastolic <= 80, vitals
    assert isinstance(avatar.body, BodySpec)
    assert 10 <= avatar.mass_kg / avatar.height_m**2 <= 50, (avatar.height_m, avatar.mass_kg)


@pytest.mark.parametrize("condition", condition_names())
def test_everybody_drawn_is_consistent(condition: str) -> None:
    found = load_condition(condition)
    for seed in SEEDS:
        for severity in (None, *found.severities):
            check_consistent(sample_person(condition, severity, seed))


def test_the_same_seed_gives_the_same_person_and_another_another() -> None:
    one, same, other = (rcare_marl.sample_person(condition="stroke", seed=s) for s in (3, 3, 4))
    assert one == same
    assert one != other


@pytest.mark.parametrize("band", ["A", "B", "C", "D"])
@pytest.mark.parametrize("level", every(2, load_condition("spinal_cord_injury").levels))
def test_grades_are_those_of_the_level_of_injury(level: str, band: str) -> None:
    """ISNCSCI: all key muscles above have 5, that of the level 3 at least; below by the grade."""
    found, at = load_condition("spinal_cord_injury"), SPINAL_LEVELS.index(level)
    for seed in SEEDS:
        avatar = sample_person("spinal_cord_injury", f"{level}-{band}", seed)
        assert avatar.profile.injury_level == level
        for side in ("left", "right"):
            below = []
            for group in found.key_muscles:
                first = SPINAL_LEVELS.index(found.segments[group][0])
                grade = avatar.profile.side(side).mmt.get(group, 5.0)
                if first < at:
                    assert grade == 5, (group, grade)
                elif first == at:
                    assert grade >= 3
                else:
                    below.append((first - at, grade))
            strong = sum(grade >= 3 for _, grade in below)
            if band in "AB":
                assert all(grade == 0 for apart, grade in below if apart > 1)
                assert all(grade <= 2 for _, grade in below)
            elif band == "C":
                assert 2 * strong < len(below)
            else:
                assert 2 * strong >= len(below)


def test_a_worse_score_is_worse() -> None:
    def strength(score: float) -> float:
        people = [sample_person("stroke", score, seed) for seed in range(30)]
        arms = []
        for avatar in people:
            sides = (avatar.profile.left, avatar.profile.right)
            arms.append(min(side.mmt.get("wrist_extensors", 5.0) for side in sides))
        return float(np.mean(arms))

    scores = [strength(score) for score in (60, 35, 5)]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] - scores[2] > 2


def test_a_stroke_leaves_the_other_side_alone() -> None:
    avatar = sample_person("stroke", "severe", 5)
    sides = {side: avatar.profile.side(side).mmt for side in ("left", "right")}
    weak = "left" if "left side weak" in avatar.condition else "right"
    other = "right" if weak == "left" else "left"
    assert sides[weak]["finger_flexors"] <= 1
    assert sides[other] == {}


def test_arms_of_cerebral_palsy_follow_a_scale_of_their_own() -> None:
    hands = {
        sample_person("cerebral_palsy", "III", seed).profile.left.mmt.get("finger_flexors", 5.0)
        for seed in range(60)
    }
    assert min(hands) < 3 < max(hands)


@pytest.mark.parametrize(
    ("condition", "severity", "words"),
    [
        ("strok", None, "stroke"),
        ("stroke", "sever", "severe"),
        ("stroke", 80, "0 to 66"),
        ("spinal_cord_injury", "C6-E", "severity"),
        ("spinal_cord_injury", 3, "no scale"),
    ],
)
def test_what_is_not_there_is_named(
    condition: str, severity: str | float | None, words: str
) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=words):
        sample_person(condition, severity, 0)


@pytest.mark.parametrize("condition", condition_names())
def test_a_file_gives_the_same_person(condition: str, tmp_path: Path) -> None:
    avatar = sample_person(condition, seed=8)
    file = tmp_path / "person.yaml"
    file.write_text(yaml.safe_dump(avatar_fields(avatar)))
    assert load_avatar(file) == avatar
    assert load(AvatarConfig, json.loads(json.dumps(avatar_fields(avatar)))) == avatar


def test_grades_of_tone_are_ashworths() -> None:
    for avatar in (person_of("test", i) for i in range(30)):
        for side in (avatar.profile.left, avatar.profile.right, avatar.profile.axial):
            assert set(side.spasticity.values()) <= set(ASHWORTH)


def test_populations_are_people_by_number() -> None:
    assert (population_size("train"), population_size("test"), population_size("six")) == (
        1000,
        200,
        6,
    )
    assert find_avatar("population:test:17") == person_of("test", 17)
    assert find_avatar("population:six:3") == load_avatar("daniel")
    assert find_avatar("karan") == load_avatar("karan")
    words = {avatar.condition.split(",")[0].split(" C")[0] for avatar in people_of("test")}
    assert len(words) >= 9
    ages = [avatar.age_years for avatar in people_of("test")]
    assert min(ages) < 14
    assert max(ages) > 85
    train = {json.dumps(avatar_fields(person_of("train", i))) for i in range(200)}
    assert not train & {json.dumps(avatar_fields(p)) for p in people_of("test")}
    assert len(population_hash("test")) == 12


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("population:tests:3", "test"),
        ("population:test:200", "0..199"),
        ("population:test", "takes one of them"),
        ("population:test:-1", "one from 0 to 199"),
    ],
)
def test_who_is_not_in_a_population_is_named(name: str, words: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=words):
        find_avatar(name)


def test_the_command_filters_and_exports(tmp_path: Path) -> None:
    runner, file = CliRunner(), tmp_path / "women.json"
    wanted = ["people", "test", "--sex", "female", "--age", "60:95", "--out", str(file)]
    result = runner.invoke(app, wanted)
    assert result.exit_code == 0, result.output
    people = {
        name: load(AvatarConfig, fields) for name, fields in json.loads(file.read_text()).items()
    }
    assert people
    assert all(p.sex == "female" and p.age_years >= 60 for p in people.values())
    assert all(find_avatar(name) == person for name, person in people.items())
    result = runner.invoke(app, ["people", "stroke", "--severity", "12", "--limit", "2"])
    assert result.exit_code == 0
    assert result.output.count("severe") == 2
    result = runner.invoke(app, ["people", "stroke", "--out", str(tmp_path), "--limit", "2"])
    assert result.exit_code == 0
    assert len(list(tmp_path.glob("stroke_seed_*.yaml"))) == 2
    assert runner.invoke(app, ["people", "test", "--age", "200:300"]).exit_code != 0
