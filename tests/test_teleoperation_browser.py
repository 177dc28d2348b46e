"""People in the scene by browsers with an emulated headset; `make test-browser` installs what they need."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiohttp", reason="the page needs the extra 'coach'")
pytest.importorskip("h5py", reason="records need the extra 'data'")

from browser import WEB, need, serving, watched
from test_teleoperation import BAD

from rcare_marl.baselines.teleoperation.server import Server
from rcare_marl.baselines.teleoperation.stage import Scenario
from rcare_marl.envs import make
from rcare_marl.envs.datasets import read, record

THREE = WEB / "node_modules" / "three" / "build"
TOKEN = "of-the-test"


@pytest.fixture(scope="module", autouse=True)
def _browser() -> None:
    need("axe-core", "iwer", "playwright-core")


@contextmanager
def served(scenario: Scenario) -> Iterator[str]:
    """Serve the page on a free port of this computer, each step as soon as hands answered."""
    server = Server(scenario, token=TOKEN, waits=True, three=THREE)
    with serving(server.app) as url:
        yield f"{url}/?token={TOKEN}"


def drive(folder: Path, url: str, name: str, **job: Any) -> dict[str, Any]:
    """Run the driver; return what it saw. Pictures go where TELEOPERATION_PICTURES says."""
    job = {
        "url": url,
        "kind": "play",
        "name": name,
        "pictures": os.environ.get("TELEOPERATION_PICTURES"),
        "viewport": {"width": 480, "height": 320},
        **job,
    }
    return watched("teleoperation_page.mjs", folder, job)


def test_a_hand_in_a_headset_leads_the_spoon_to_the_mouth(tmp_path: Path) -> None:
    with served(Scenario("feeding", ["robot"], seed=3)) as url:
        seen = drive(tmp_path, url, "feed", roles=["robot"], players={"robot": {"law": "feed"}})
    robot = seen["players"]["robot"]
    assert robot["last"]["success"], robot["last"]
    assert robot["last"]["force_n"] == 0
    assert not robot["refused"]


def test_who_is_fed_opens_the_mouth_by_the_trigger(tmp_path: Path) -> None:
    with served(Scenario("feeding", ["recipient"], seed=3)) as url:
        seen = drive(
            tmp_path, url, "eat", roles=["recipient"], players={"recipient": {"law": "eat"}}
        )
    person = seen["players"]["recipient"]
    assert person["last"]["success"], person["last"]


@pytest.mark.slow
def test_a_caregiver_in_a_headset_lifts_the_leg_and_the_robot_dresses_it(tmp_path: Path) -> None:
    law = Path(__file__).resolve().parents[1] / "experiments" / "hand_lifts_leg.py"
    helper = {"law": "ask", "program": [sys.executable, str(law), "--answer"]}
    with served(Scenario("dressing", ["caregiver"], seed=0)) as url:
        small = {"width": 320, "height": 200}
        seen = drive(
            tmp_path,
            url,
            "lift",
            roles=["caregiver"],
            players={"caregiver": helper},
            viewport=small,
            patience=400_000,
        )
    caregiver = seen["players"]["caregiver"]
    assert caregiver["last"]["success"], caregiver["last"]
    assert caregiver["last"]["seen"]["left_hand_holds"] == [1.0]
    assert not caregiver["refused"]


def test_two_people_in_two_browsers_feed_and_are_fed(tmp_path: Path) -> None:
    players = {"robot": {"law": "feed"}, "recipient": {"law": "eat"}}
    with served(Scenario("feeding", list(players), seed=1)) as url:
        small = {"width": 320, "height": 200}
        seen = drive(tmp_path, url, "two", roles=list(players), players=players, viewport=small)
    assert [player["last"]["success"] for player in seen["players"].values()] == [True, True]


def test_who_watches_goes_back_in_time_and_chooses_another_scene(tmp_path: Path) -> None:
    with served(Scenario("feeding", (), policies={"robot": "scripted"}, seed=3)) as url:
        seen = drive(tmp_path, url, "watch", kind="watch", viewport={"width": 1280, "height": 800})
    assert seen["back"]["moment"] == "0.0 s" and seen["back"]["differs"]
    assert seen["terms"][-1] == "force [N]" and len(seen["terms"]) > 1
    assert "nobody_9" in seen["refused"]
    assert "recipient is Kim" in seen["chosen"]
    assert seen["overflow"] <= 0
    assert (
        any("heart rate" in name for name in seen["overlays"])
        and "recipient" in seen["overlays"][-1]
    )
    assert seen["violations"] == []


def test_a_record_is_seen_again_at_any_moment_painted_and_saved(tmp_path: Path) -> None:
    path = tmp_path / "scratching.hdf5"
    touched = 0.0
    with make("scratching", policies={"robot": "scripted", "recipient": "still"}) as env:
        with record(env, path):
            env.reset(seed=1)
            while not env.is_over:
                env.step({})
                touched = touched or env.world.time * (env.task.report()["force_n"] > 1)
        dt = env.task.control_dt
    (episode,) = read(path)
    k = round(touched / dt)
    assert 0 < k < episode.steps
    with served(Scenario("scratching", (), replays=[episode])) as url:
        size = {"width": 1280, "height": 800}
        seen = drive(tmp_path, url, "replay", kind="replay", viewport=size, touched=k)
    assert seen["end"]["at"] == [episode.steps, episode.steps]
    assert ("success" in seen["end"]["says"]) and "as recorded" in seen["end"]["says"]
    assert seen["middle"]["at"] == seen["middle"]["stays"] == [k, episode.steps]
    assert seen["middle"]["moment"] == f"{touched:.1f} s"
    assert sum(seen["middle"]["painted"]) == 1 and not any(seen["middle"]["bare"])
    assert (
        seen["picture"]["name"] == "scene.png" and seen["picture"]["begins"] == "89504e470d0a1a0a"
    )
    assert seen["film"]["name"] == "scene.webm" and seen["film"]["begins"].startswith("1a45dfa3")
    assert seen["film"]["size"] > 20_000
    assert seen["violations"] == []


def test_bad_messages_of_a_page_change_nothing_and_pages_of_others_get_nowhere(
    tmp_path: Path,
) -> None:
    bad = [text for text in BAD.values() if len(text) < 1000][:20]
    with served(Scenario("feeding", ["robot"])) as url:
        seen = drive(tmp_path, url, "strangers", kind="strangers", bad=bad)
    assert len(seen["refused"]) == 20 and all(seen["refused"])
    assert seen["numbers"][0] == seen["numbers"][1]
    assert seen["foreign"] == {"socket": "refused", "read": "refused"}
