"""The leaderboard: policies judged by one protocol, and records that may stand there."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from rcare_marl.agents.people.sampling.population import people_named
from rcare_marl.baselines.evaluation.leaderboard import (
    FOLDER,
    Protocol,
    Row,
    board,
    judge,
    read_entry,
)
from rcare_marl.config import load
from rcare_marl.envs.registry import task_names
from rcare_marl.errors import ConfigError, UnknownNameError

Data = dict[str, Any]
Entry = Callable[..., Path]
ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "leaderboard.md"
CONFIGS = ROOT / "baselines" / "configs"
SMALL = Protocol(
    1,
    {
        "met": Row(21000, 1, cast={"recipient": "population:train:0-1"}),
        "robots": Row(21500, 1, over={"robots": ("nao",)}),
        "water": Row(21600, 1, over={"partners": ("caregiver:still",)}),
    },
    "met",
    "small",
)


@pytest.fixture(scope="module")
def record() -> Data:
    return judge(SMALL, "feeding", ("scripted",))


@pytest.fixture
def entry(record: Data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Entry:
    """Write a record, as somebody changed it, and return its file."""
    monkeypatch.setattr(Protocol, "find", lambda name: SMALL)

    def write(change: Callable[[Data], object] = lambda data: None) -> Path:
        data = json.loads(json.dumps(record))
        change(data)
        path = tmp_path / "somebody.json"
        path.write_text(json.dumps(data))
        return path

    return write


@pytest.mark.slow
def test_a_protocol_counts_each_row_and_says_which_a_task_has_not(record: Data) -> None:
    found = record["policies"]["scripted"]
    assert record["complete"]
    assert list(found["rows"]) == ["met", "robots"]
    assert found["rows"]["met"]["feasible_episodes"] == 1
    assert found["rows"]["robots"]["refused"] == 1  # a nao reaches nobody in a chair
    assert "nao" in found["rows"]["robots"]["reasons"][0]
    assert "caregiver" in found["not_in_this_task"]["water"]


def test_a_record_of_the_protocol_as_it_is_may_stand_on_the_board(entry: Entry) -> None:
    path = entry()
    assert read_entry(path)["task"] == "feeding"
    assert "| met | " in board(path.parent)


def _other_people(data: Data) -> None:
    data["sha256"] = "0" * 64


def _not_whole(data: Data) -> None:
    data["complete"] = False


def _without_versions(data: Data) -> None:
    del data["versions"]["pybullet"]


def _row_left_out(data: Data) -> None:
    del data["policies"]["scripted"]["rows"]["robots"]


def _fewer_episodes(data: Data) -> None:
    data["policies"]["scripted"]["rows"]["met"]["episodes"] = 0


def _too_good(data: Data) -> None:
    data["policies"]["scripted"]["rows"]["met"]["successes"] = 2


def _nobodys_file(data: Data) -> None:
    data["policies"]["mine.npz"] = data["policies"].pop("scripted")


def _another_file(data: Data) -> None:
    data["policies"]["scripted"]["file"] = {"sha256": "0" * 64}


def _trained_with_the_test(data: Data) -> None:
    file = {"sha256": "0" * 64, "recipe": {"cast": {"recipient": "population:test:0-9"}}}
    data["policies"]["mine.npz"] = data["policies"].pop("scripted") | {"file": file}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_other_people, "other people, seeds or rows"),
        (_not_whole, "not complete"),
        (_without_versions, "pybullet"),
        (_row_left_out, "has the rows"),
        (_fewer_episodes, "not whole"),
        (_too_good, "more successes"),
        (_nobodys_file, "no SHA-256"),
        (_another_file, "another file now"),
        (_trained_with_the_test, "trained with people of population:test"),
        (lambda data: data.pop("kind"), "no record of a protocol"),
    ],
)
def test_a_record_that_was_made_otherwise_is_refused(
    entry: Entry, change: Callable[[Data], object], said: str
) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        read_entry(entry(change))


def test_every_record_on_the_board_may_stand_there_and_the_page_shows_it() -> None:
    assert board(FOLDER) in PAGE.read_text("utf-8")


def test_every_task_of_care_has_most_rows_of_the_protocol_for_everybody() -> None:
    protocol = Protocol.find("everybody")
    for task in sorted(set(task_names()) - {"social_coaching", "group_coaching"}):
        plans, missing = protocol.plans(task, "scripted")
        assert set(plans) | set(missing) == set(protocol.rows)
        assert {"met", "strangers", "six", "robots", "homes", "delay_1"} <= set(plans), task


def test_a_protocol_that_is_none_is_refused_by_name() -> None:
    with pytest.raises(UnknownNameError, match="everybody"):
        Protocol.find("everyone")
    with pytest.raises(ConfigError, match="row of a protocol"):
        load(Protocol, {"version": 1, "rows": {}, "reference": "met"})


def test_its_digest_changes_with_any_row() -> None:
    rows = {**SMALL.rows, "met": Row(21001, 1, cast={"recipient": "population:train:0-1"})}
    assert Protocol(1, rows, "met", "small").digest() != SMALL.digest()


def test_who_chooses_between_seeds_is_neither_trained_with_nor_judged_with() -> None:
    choosing, judging = Protocol.find("choosing"), Protocol.find("everybody")
    chosen, judged = (
        {one for row in rows.values() for who in row.people for one in people_named(who)}
        for rows in (choosing.rows, judging.rows)
    )
    trained = set[str]()
    for file in (CONFIGS / "everybody").glob("*.yaml"):
        for who in yaml.safe_load(file.read_text())["cast"].values():
            trained.update(people_named(who))
    assert len(trained) >= 300 and len(chosen) > 100
    assert chosen & (trained | judged) == set(people_named("six"))
    assert not {row.seed for row in choosing.rows.values()} & {
        row.seed for row in judging.rows.values()
    }
