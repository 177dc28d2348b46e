"""The coach's page in a browser, with an emulated headset; `make test-browser` installs what it needs."""

from __future__ import annotations

import os
import ssl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

pytest.importorskip("aiohttp", reason="the coach's page needs the extra 'coach'")

from browser import need, serving, watched
from self_signed import OPENSSL, self_signed
from webxr_pose import grip_place, head_place

from rcare_marl.agents.coaching.exercise import Exercise, load_exercise
from rcare_marl.agents.coaching.sources.body_fit import BodyFit
from rcare_marl.agents.coaching.upper_body import MOTION_INDEX, UpperBody
from rcare_marl.baselines.coaching.page.message import Hands, Landmarks, Message, parse
from rcare_marl.baselines.coaching.page.packages import WEB
from rcare_marl.baselines.coaching.page.server import Server, Service, secured
from rcare_marl.baselines.coaching.page.sight import FROM_WEBXR
from rcare_marl.pose import matrix_from_quaternion, quaternion_from_matrix

Array = npt.NDArray[np.float64]

CLIP = Path(__file__).parent / "data" / "lateral_raise.mp4"
HEIGHT = 1.7  # [m]
SEAT = np.array((0.0, 0.0, 0.5))  # of the hips above the floor [m]
RATE = 12.0  # of the poses that are played [1/s]
BEFORE, AFTER = 0.5, 1.5  # rest before and after a repetition [s]
LATE = 7.5  # how much slower than ours the clock of a filmed person runs
HURRY = 3.0  # how much faster than ours the clock of simulated people runs


@pytest.fixture(scope="module", autouse=True)
def _browser() -> None:
    need("@mediapipe/pose", "axe-core", "iwer", "playwright-core", "three")


class Clock:
    """A clock that is put on by what a headset reports, and else stands still."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def parse(self, text: str) -> Message:
        message = parse(text)
        if isinstance(message, Hands):
            self.now = message.time
        return message


def hurried() -> float:
    return HURRY * time.monotonic()


@contextmanager
def served(context: ssl.SSLContext | None = None, **service: Any) -> Iterator[str]:
    """Serve the page on a free port of this computer; yield its address, with a token that opens it."""
    server = Server(Service(WEB / "node_modules", is_secure=context is not None, **service))
    with serving(server.app, context) as url:
        yield f"{url}/?token={server.ticket()}"


def drive(folder: Path, url: str, kind: str, **job: Any) -> dict[str, Any]:
    """Run the driver; return what it saw. Pictures go where COACH_PICTURES says, or into `folder`."""
    kept = os.environ.get("COACH_PICTURES")
    job = {
        "url": url,
        "kind": kind,
        "name": kind,
        "flags": [],
        "touch": False,
        "expected": [],
        "pictures": kept or str(folder),
        "keeps": bool(kept),
        "viewport": {"width": 900, "height": 600},
        "exercise": "lateral_raise",
        "height_cm": round(100 * HEIGHT),
        **job,
    }
    return watched("coach_page.mjs", folder, job)


def performance(exercise: Exercise, share: float) -> list[dict[str, Any]]:
    """Return poses of head and hands in WebXR's frame through one repetition, `share` of the way."""
    times = np.arange(int((BEFORE + exercise.duration + AFTER) * RATE)) / RATE
    rest = exercise.angles(0.0)
    angles = rest + share * (exercise.angles(times - BEFORE) - rest)
    angles[:, MOTION_INDEX["neck_flexion"]] += 0.05  # nobody looks quite ahead
    body = UpperBody.of_height(HEIGHT)
    poses = body.poses(angles)
    out = []
    for i in range(len(times)):
        position, quaternion = (each[i] for each in poses["head"])
        frame: dict[str, Any] = {"head": head_place(position + SEAT, quaternion)}
        for side in ("left", "right"):
            position, quaternion = (each[i] for each in poses[f"{side}_hand"])
            turn = matrix_from_quaternion(quaternion)
            wrist = FROM_WEBXR.T @ (position + SEAT - body.palm * turn[:, 0])
            palm = (*wrist.tolist(), *quaternion_from_matrix(FROM_WEBXR.T @ turn).tolist())
            frame[side] = {"palm": palm, "grip": grip_place(side, position + SEAT, quaternion)}
        out.append(frame)
    return out


@pytest.mark.slow
def test_a_right_performance_in_a_headset_turns_green_and_a_wrong_one_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exercise, clock = load_exercise("lateral_raise"), Clock()
    monkeypatch.setattr("rcare_marl.baselines.coaching.page.server.parse", clock.parse)
    with served(clock=clock) as url:
        seen = drive(
            tmp_path,
            url,
            "headset",
            exercise=exercise.name,
            step=1 / RATE,
            right=performance(exercise, 1.0),
            wrong=performance(exercise, 0.5),
            viewport={"width": 480, "height": 320},
        )
    assert seen["measures"] and seen["hands"] == ["joints"]
    assert seen["right"]["green"], seen
    assert seen["right"]["counted"] == 1
    assert not seen["wrong"]["green"], seen
    assert seen["wrong"]["counted"] == 0
    assert "Please go a little further." in seen["wrong"]["hints"]
    assert seen["wrong"]["told"] == "Not right: Please go a little further."
    assert seen["controllers"]["green"], seen
    assert seen["controllers"]["counted"] == 1


def test_after_what_cannot_begin_a_simulated_person_is_coached_by_keyboard_alone(
    tmp_path: Path,
) -> None:
    with served(clock=hurried) as url:
        seen = drive(tmp_path, url, "refused")
    assert "can do none" in seen["trouble"]
    assert seen["words"].startswith("That is it")
    assert seen["kind"] == "solid"
    assert seen["title"] == "The session is over."
    assert seen["focus"] == "over"


@pytest.mark.skipif(OPENSSL is None, reason="openssl is not installed: it makes the certificate")
def test_over_https_and_without_webgl_both_figures_are_drawn_as_lines(tmp_path: Path) -> None:
    context = secured(*self_signed(tmp_path))
    with served(context, clock=hurried) as url:
        seen = drive(
            tmp_path,
            url,
            "arrive",
            exercise="front_raise",
            name="lines",
            flags=["--disable-3d-apis"],
            expected=["THREE.WebGLRenderer"],
        )
    assert seen["kind"] == "flat"
    assert seen["address"].endswith("/"), "the token is still to be read on the screen"


def test_who_has_no_token_is_told_which_address_to_open(tmp_path: Path) -> None:
    with served() as url:
        for wrong in (url.split("?")[0], f"{url}x"):
            seen = drive(tmp_path, wrong, "stranger", expected=["403 (Forbidden)"])
            assert "?token=" in seen["trouble"]


def test_a_session_is_recorded_only_when_the_person_consents_on_the_page(tmp_path: Path) -> None:
    pytest.importorskip("h5py", reason="recordings need the extra 'coach'")
    folder = tmp_path / "kept"
    with served(clock=hurried, record=folder) as url:
        seen = drive(tmp_path, url, "recorded")
    assert str(folder) in seen["offered"]
    assert seen["indicated"] == {"no": False, "keep": True, "delete": True}
    assert "Well done" in seen["title"]
    kept, deleted = (Path(report) for report in seen["reports"])
    assert [each.name for each in folder.iterdir()] == [kept.parent.name]
    assert not deleted.exists() and "deleted" in seen["told"]
    names = {"report.html", "session.h5", "repetitions.csv", "observations.json"}
    assert {each.name for each in kept.parent.iterdir()} == names
    assert seen["address"].startswith("blob:") and "token" not in seen["address"]
    assert seen["border"] == "solid"  # its looks are let in
    assert all((kept.parent / name).read_text() == text for name, text in seen["files"].items())
    assert set(seen["files"]) == {"repetitions.csv", "observations.json"}
    assert "Lateral raise" in seen["report"]
    assert [width > 500 and bool(alt) for width, alt in seen["plots"]] == [True]


def test_the_page_leads_through_a_calibration_and_keeps_what_came_out_by_name(
    tmp_path: Path,
) -> None:
    with served(clock=hurried) as url:
        seen = drive(tmp_path, url, "measured", viewport={"width": 1280, "height": 800})
    assert seen["number"].startswith("Part 1 of 4, ")
    assert "arm was not held out to the front. Once more" in seen["trouble"]
    assert "I have measured you: " in seen["words"]
    assert "Ada" in seen["kept"]
    assert seen["chosen"] == [[False, "on"], [False, "170"]]
    assert BodyFit.from_dict(seen["body"]).is_measured
    assert seen["left"] == "{}" and seen["gone"]


def test_the_page_can_be_read_and_used_without_a_mouse_and_with_poor_sight(tmp_path: Path) -> None:
    with served(clock=hurried, record=tmp_path / "kept") as url:
        seen = drive(tmp_path, url, "access")
    assert {"verdict", "said", "told", "deleted"} <= set(seen["live"])
    assert seen["told"]
    for name, look in seen["looks"].items():
        if "tour" in look:
            places = [stop["place"] for stop in look["tour"]]
            assert len(places) > 2 and places == sorted(places), f"{name}: focus jumps"
            assert all(stop["outline"] >= 3 for stop in look["tour"]), f"{name}: focus is not seen"
            assert not look["nameless"], f"{name}: controls without a name"
        else:
            assert look["text"]["ratio"] >= 4.5, f"{name}: {look['text']}"
            assert look["edge"]["ratio"] >= 3.0, f"{name}: {look['edge']}"
            assert look["smallest"] >= 24, f"{name}: text of {look['smallest']} px"
            assert look["overflow"] <= 0, f"{name}: {look['overflow']} px beyond the edge"


def fake_device(folder: Path, rate: int) -> list[str]:
    """Return flags with which a filmed person sits before Chromium's webcam, at so many pictures a second."""
    file = folder / "webcam.y4m"
    film, pictures = cv2.VideoCapture(str(CLIP)), []
    while (read := film.read())[0]:
        pictures.append(b"FRAME\n" + cv2.cvtColor(read[1], cv2.COLOR_BGR2YUV_I420).tobytes())
    width, height = (int(film.get(each)) for each in (3, 4))
    file.write_bytes(
        f"YUV4MPEG2 W{width} H{height} F{rate}:1 Ip A1:1 C420\n".encode() + b"".join(pictures)
    )
    return [
        "--use-fake-device-for-media-stream",
        "--use-fake-ui-for-media-stream",
        f"--use-file-for-fake-video-capture={file}",
    ]


def test_a_button_turns_the_webcam_on_and_off(tmp_path: Path) -> None:
    with served() as url:
        seen = drive(tmp_path, url, "button", flags=fake_device(tmp_path, 15))
    on, off = seen["states"]
    assert on == {"pressed": "true", "source": "landmarks", "light": "live", "shown": True}
    assert off == {"pressed": "false", "source": "simulated", "light": "ended", "shown": False}


def test_a_webcam_that_may_not_be_used_is_named(tmp_path: Path) -> None:
    with served() as url:
        seen = drive(tmp_path, url, "button")
    assert "webcam" in seen["note"]


def test_an_exercise_is_written_on_the_page_and_its_file_is_one_of_the_command(
    tmp_path: Path,
) -> None:
    with served() as url:
        seen = drive(tmp_path, url, "editor")
    assert "shoulder_elevation must lie in -200..200 deg, got 300" in seen["bad"]
    assert seen["barred"]
    assert "moves left arm, right arm" in seen["good"]
    mine = load_exercise(seen["file"])
    assert (mine.name, mine.title, len(mine.poses)) == ("reach_up", "Reach up", 2)
    assert mine.poses[0].angles_deg["left_shoulder_elevation"] == 120
    assert mine.poses[1].angles_deg["right_elbow_flexion"] == 90


@pytest.mark.parametrize("screen", ("wide", "phone"))
def test_begin_is_in_view_and_coach_and_person_stand_apart(tmp_path: Path, screen: str) -> None:
    with served(clock=hurried) as url:
        seen = drive(tmp_path, url, "layout", screen=screen, touch=screen == "phone")
    assert seen["begin"] and seen["stage"]
    assert seen["keys"] is (screen == "wide")
    coach, user, (width, height) = (seen["shares"][each] for each in ("coach", "user", "size"))
    assert user["x"] >= coach["x"] + coach["w"] or user["y"] >= coach["y"] + coach["h"]
    assert user["x"] + user["w"] <= width and user["y"] + user["h"] <= height


def test_axe_finds_nothing_on_any_part_of_the_pages(tmp_path: Path) -> None:
    with served(clock=hurried) as url:
        seen = drive(tmp_path, url, "axe")
    assert seen["violations"] == []


@pytest.mark.slow  # a second a picture without a graphics card
def test_a_filmed_person_before_the_webcam_does_a_right_repetition(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slowed(text: str) -> Message:
        message = parse(text)
        if isinstance(message, Landmarks):
            message = replace(message, time=message.time / LATE)
        return message

    monkeypatch.setattr("rcare_marl.baselines.coaching.page.server.parse", slowed)
    with served(clock=lambda: time.monotonic() / LATE) as url:
        flags = fake_device(tmp_path, round(15 / LATE))
        seen = drive(tmp_path, url, "webcam", flags=flags, viewport={"width": 480, "height": 320})
    assert seen["told"].startswith("1 of 9 right")
    assert seen["light"] == "ended"
