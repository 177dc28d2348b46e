"""Shipped policies with casts of others: warned of, or refused with the figure; scripts with other robots."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest
from typer.testing import CliRunner

import rcare_marl
from rcare_marl import assets
from rcare_marl.baselines import trained
from rcare_marl.baselines.trained import elsewhere
from rcare_marl.cli import app
from rcare_marl.envs import registry
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.cast import make_policy
from rcare_marl.envs.homes import home_names
from rcare_marl.envs.registry import task_class
from rcare_marl.errors import CastWarning, ConfigError


@pytest.fixture(autouse=True)
def _every_warning() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        yield


def warned(env: CareEnv, task: str, name: str) -> list[str]:
    """Return what is warned of when a shipped policy plays in an environment."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        make_policy(env, task, "robot", name)
    return [str(each.message) for each in told if each.category is CastWarning]


def play(task: str, name: str = "learned", **cast: Any) -> list[str]:
    """Return what is warned of when a shipped policy plays in a cast."""
    with closing(rcare_marl.make(task, **cast)) as env:
        return warned(env, task, name)


def test_who_it_was_trained_with_is_nothing_to_speak_of() -> None:
    assert play("feeding", "specialist") == []
    assert play("feeding", "specialist", robot="kinova_gen3", recipient="karan") == []
    assert play("toileting", level=1) == []


def test_who_was_trained_with_a_population_is_told_of_no_person_but_of_other_robots() -> None:
    for person in ("daniel", "population:test:3", "six"):
        assert play("feeding", recipient=person, robot="pr2") == []
    (text,) = play("feeding", robot="ur5")
    assert "not trained with robot ur5" in text and "24 of 24" in text


def test_another_cast_is_warned_of_once_with_what_was_measured() -> None:
    (text,) = play("feeding", "specialist", recipient="jose")
    assert "not trained with recipient jose" in text and "20 of 20" in text
    (text,) = play("feeding", "specialist", recipient="population:test:3")
    assert "population:test:3" in text or "not measured" in text
    for person in ("population:test:3", "population:train:0-9"):
        (text,) = play("toileting", recipient=person)
        assert (
            f"recipient {person}; measured with recipient population, level 1: 100 of 100" in text
        )
    (text,) = play("feeding", "specialist", recipient="six")
    assert "recipient six" in text and "not measured" in text


@pytest.mark.parametrize(
    ("task", "name", "cast", "figure"),
    [
        ("limb_repositioning", "specialist", {"recipient": "daniel"}, "1 of 20"),
        ("limb_repositioning", "specialist", {"robot": "fetch"}, "1 of 10"),
        ("ambulating", "learned", {"robot": "kinova_gen2"}, "robot kinova_gen2, level 1: 0 of 5"),
        ("ambulating", "learned", {"robot": "stretch_re1"}, "robot stretch_re1, level 1: 0 of 5"),
    ],
)
def test_what_hardly_ever_works_is_refused_with_the_figure(
    task: str, name: str, cast: dict[str, Any], figure: str
) -> None:
    with closing(rcare_marl.make(task, **cast)) as env:
        with pytest.raises(ConfigError, match=f"{figure}.*learned_anyway") as told:
            make_policy(env, task, "robot", name)
        refused = elsewhere.of_script(task, str(cast.get("robot")), 1)
        is_poor = any(elsewhere.is_refused(task, row) for row in refused)
        assert ("take another robot" in str(told.value)) == is_poor
        if name == trained.NAME:
            assert trained.best_policy(env, task) == "scripted"
            (text,) = warned(env, task, elsewhere.ANYWAY)
            assert figure in text


def test_what_fails_at_one_level_is_played_at_another() -> None:
    (text,) = play("ambulating", robot="fetch", level=2)
    assert "robot fetch, level 2: 5 of 5" in text


def test_a_robot_besides_does_not_help() -> None:
    with pytest.raises(ConfigError, match="0 of 20"):
        play("feeding", "specialist", recipient="daniel", robot="kinova_gen2")


def test_what_was_measured_is_of_what_there_is() -> None:
    files = {file.stem for file in trained.FOLDER.glob("*.npz")}
    known: dict[str, set[Any]] = {
        "recipient": {*assets.names("avatars"), "population", "six"},
        "robot": set(assets.names("robots")),
        "home": set(home_names()),
        "level": {1, 2, 3},
    }
    for name, figures in elsewhere.figures().items():
        assert name in files
        task = trained.LEVEL.sub(r"\g<task>", name)
        seen = [figure.cast for figure in figures]
        assert all(seen.count(each) == 1 for each in seen)
        for figure in figures:
            assert figure.cast and 0 <= figure.done <= figure.of and figure.force >= 0
            for key, value in figure.cast.items():
                if key.startswith("options."):
                    task_class(task).Options(**{key.removeprefix("options."): value})
                else:
                    assert value in known[key]


@pytest.mark.slow
def test_a_robot_that_a_script_does_badly_with_is_refused_with_the_figure() -> None:
    task, robot = "limb_repositioning", "kinova_gen2"
    (row,) = elsewhere.of_script(task, robot)
    assert elsewhere.is_refused(task, row)
    said = rf"robot {robot}: {row.done} of {row.of}.*Take one of .*kinova_gen3.*scripted_anyway"
    with pytest.raises(ConfigError, match=said):
        rcare_marl.make(task, robot=robot, policies={"robot": "scripted"})
    with closing(rcare_marl.make(task, robot=robot)) as env:
        for name in ("scripted_anyway", registry.unguarded(task, "robot", "scripted")):
            assert type(make_policy(env, task, "robot", name)).__name__ == "ScriptedRepositioning"
    placed = {"model": robot, "mount": "wheelchair_beside"}
    rcare_marl.make(task, robot=placed, policies={"robot": "scripted"}).close()


def test_what_was_measured_of_scripts_is_of_robots_that_reach() -> None:
    for task, rows in elsewhere.figures(elsewhere.SCRIPTS).items():
        seen = [tuple(sorted(row.cast.items())) for row in rows]
        assert len(set(seen)) == len(seen)
        for row in rows:
            assert set(row.cast) <= {"robot", "level"} and row.cast.get("level", 1) in (1, 2, 3)
            assert row.cast["robot"] in (task_class(task).reachable_by or ())
            assert 0 <= row.done <= row.of and row.of >= 12 and row.force >= 0


def test_the_command_line_says_it_in_a_line() -> None:
    line = "evaluate feeding --episodes 1 --policy learned --recipient".split()
    line[line.index("learned")] = "specialist"
    refused = CliRunner().invoke(app, [*line, "daniel"])
    assert refused.exit_code == 2 and "0 of 20" in refused.stderr
    told = CliRunner().invoke(app, [*line, "jose"])
    assert told.exit_code == 0 and told.stderr.count("warning: ") == 1, told.stderr
