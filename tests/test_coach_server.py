"""The coach's page without a browser: messages, sessions, recording, and who may ask what."""

from __future__ import annotations

import asyncio
import csv
import json
import logging
import math
import random
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from variants import every
from webxr_pose import webxr_pose

pytest.importorskip("aiohttp", reason="the coach's page needs the extra 'coach'")

from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType, WSServerHandshakeError, web

from rcare_marl.agents.coaching.exercise import exercise_names, load_exercise, load_exercises
from rcare_marl.agents.coaching.upper_body import MOTION_INDEX
from rcare_marl.assets import ROOT
from rcare_marl.baselines.coaching.page.clinician import OBSERVATIONS, TABLE
from rcare_marl.baselines.coaching.page.message import (
    LARGEST,
    MISTAKES,
    Begin,
    Command,
    Consent,
    Hands,
    MessageError,
    Mistake,
    Place,
    Simulate,
    parse,
)
from rcare_marl.baselines.coaching.page.packages import WEB
from rcare_marl.baselines.coaching.page.recording import Recorder
from rcare_marl.baselines.coaching.page.room import STEP, Room
from rcare_marl.baselines.coaching.page.server import Server, Service
from rcare_marl.cli.coach import LOOPBACK, bound

BEGIN = {"type": "begin", "source": "hands", "height_m": 1.7, "exercises": ["lateral_raise"]}
HEAD = [0, 1.2, 0, 0, 0, 0, 1]
HANDS = {"type": "hands", "time": 1.0, "head": HEAD, "left": None, "right": {"grip": HEAD}}

BAD = {
    "no JSON": "hello",
    "empty": "",
    "a list": "[1, 2]",
    "no type": "{}",
    "unknown type": '{"type": "eval", "code": "1"}',
    "a type that is no text": '{"type": ["begin"]}',
    "a type from Python": '{"type": "__class__"}',
    "NaN": json.dumps({**HANDS, "time": math.nan}),
    "infinity": json.dumps({**HANDS, "time": math.inf}),
    "a float that overflows": json.dumps(HANDS).replace("1.0", "1e999"),
    "a huge whole number": json.dumps(HANDS).replace("1.0", "9" * 4000),
    "a number too long to read": json.dumps(HANDS).replace("1.0", "9" * 9000),
    "far away": json.dumps({**HANDS, "head": [0, 1e6, 0, 0, 0, 0, 1]}),
    "a time before all": json.dumps({**HANDS, "time": -1}),
    "no unit quaternion": json.dumps({**HANDS, "head": [0, 1, 0, 0, 0, 0, 2]}),
    "a quaternion of zero": json.dumps({**HANDS, "head": [0, 1, 0, 0, 0, 0, 0]}),
    "too few numbers": json.dumps({**HANDS, "head": [0, 1, 0]}),
    "true for a number": json.dumps({**HANDS, "time": True}),
    "text for a number": json.dumps({**HANDS, "time": "1"}),
    "an unknown field": json.dumps({**HANDS, "more": 1}),
    "a missing field": json.dumps({"type": "hands", "time": 1}),
    "a field twice": '{"type": "consent", "given": false, "given": true}',
    "consent by a number": '{"type": "consent", "given": 1}',
    "joints in one place": json.dumps({**HANDS, "left": {"joints": [[0, 1, 0]] * 4}}),
    "joints and a grip": json.dumps({**HANDS, "left": {"joints": [], "grip": HEAD}}),
    "an unknown exercise": json.dumps({**BEGIN, "exercises": ["../../etc/passwd"]}),
    "an exercise twice": json.dumps({**BEGIN, "exercises": ["lateral_raise"] * 2}),
    "no exercises": json.dumps({**BEGIN, "exercises": []}),
    "a giant": json.dumps({**BEGIN, "height_m": 12}),
    "no repetitions": json.dumps({**BEGIN, "repetitions": 0}),
    "half a repetition": json.dumps({**BEGIN, "repetitions": 1.5}),
    "an unknown wish": '{"type": "command", "wish": "format"}',
    "deep nesting": "[" * 15000,
    "deep nesting of objects": '{"type":' * 1900,
    "too long": '{"type": "hands", "time": "' + "x" * LARGEST + '"}',
    "too long in bytes": '{"type": "' + "é" * (LARGEST - 100) + '"}',
    "half a character": '{"type": "\ud800"}',
}


@pytest.mark.parametrize("text", BAD.values(), ids=BAD.keys())
def test_a_bad_message_is_refused_with_a_reason(text: str) -> None:
    with pytest.raises(MessageError) as caught:
        parse(text)
    assert 0 < len(str(caught.value)) < 200  # and does not give back what was sent


def test_a_good_message_is_what_it_says() -> None:
    message = parse(json.dumps(HANDS))
    place = Place((0.0, 1.2, 0.0), (0.0, 0.0, 0.0, 1.0))
    assert message == Hands(1.0, place, None, place)
    assert parse(json.dumps(BEGIN)) == Begin("hands", 1.7, ("lateral_raise",))
    assert parse('{"type": "consent", "given": true}') == Consent(True)


def run(room: Room, seconds: float, start: float = 0.0) -> list[dict[str, Any]]:
    states = []
    for k in range(1, int(seconds / STEP) + 1):
        states.append(json.loads(json.dumps(room.step(start + k * STEP), allow_nan=False)))
        if not room.is_on:
            break
    return states


def simulated(mistake: Mistake = "none", **more: Any) -> Begin:
    names = more.pop("exercises", ("lateral_raise",))
    return Begin("simulated", 1.7, names, repetitions=1, mistake=mistake, **more)


@pytest.mark.slow
def test_a_simulated_person_is_coached_through_all_exercises() -> None:
    room = Room()
    room.receive(simulated(exercises=exercise_names()), 0.0)
    states = run(room, 120)
    assert states[-1]["phase"] == "over" and states[-1]["over"]["complete"]
    assert {s["exercise"]["name"] for s in states} == set(exercise_names())
    assert any(s["following"] for s in states)
    assert states[-1]["count"] >= len(exercise_names())  # each was explained


@pytest.mark.parametrize("mistake", every(6, [name for name in MISTAKES if name != "none"]))
def test_a_mistake_is_not_counted_keeps_the_window_from_green_and_is_named(
    mistake: Mistake,
) -> None:
    room = Room()
    room.receive(simulated(mistake), 0.0)
    states = run(room, 16)
    assert states[-1]["right"] == 0
    assert states[-1]["wrong"] >= 1
    assert not any(s["following"] for s in states)
    assert states[-1]["last"]["why"]
    room.receive(Simulate("none"), 16.0)  # who mends it is counted
    assert run(room, 20, start=16.0)[-1]["over"]["complete"]


def test_goals_are_no_higher_than_what_the_person_says_they_reach() -> None:
    room = Room()
    room.receive(simulated(lift_left_deg=60.0), 0.0)
    states = run(room, 7)
    body = {side: [s["coach"][f"{side}_elbow"][2] for s in states] for side in ("left", "right")}
    assert max(body["left"]) < max(body["right"]) - 0.05
    with pytest.raises(MessageError, match="can do none"):
        room.receive(
            simulated(exercises=("lateral_raise",), lift_left_deg=10.0, lift_right_deg=10.0), 8.0
        )


@pytest.mark.slow
def test_a_pause_is_no_standing_still_and_the_coach_waits() -> None:
    room = Room()
    room.receive(simulated(), 0.0)
    run(room, 3)
    room.receive(Command("pause"), 3.0)
    paused = run(room, 30, start=3.0)
    assert {s["phase"] for s in paused} == {"paused"}
    assert paused[-1]["coach"] == paused[0]["coach"]
    room.receive(Command("resume"), 33.0)
    after = run(room, 30, start=33.0)
    assert all(s["last"] is None or "no_movement" not in s["last"]["errors"] for s in after)
    assert after[-1]["over"]["complete"]


def test_skip_rest_and_stop_do_what_they_say() -> None:
    room = Room()
    room.receive(simulated(exercises=("front_raise", "upper_lift")), 0.0)
    run(room, 2)
    room.receive(Command("skip"), 2.0)
    assert run(room, 3, start=2.0)[-1]["exercise"]["name"] == "upper_lift"
    room.receive(Command("rest"), 5.0)
    rested = run(room, 1, start=5.0)
    room.receive(Command("stop"), 6.0)
    assert rested[-1]["phase"] == "resting"
    assert run(room, 1, start=6.0)[-1]["over"]["complete"] is False


def test_half_a_repetition_is_not_judged_once_the_person_has_centred() -> None:
    room = Room()
    exercise = load_exercise("lateral_raise")
    room.receive(Begin("hands", 1.7, (exercise.name,)), 0.0)
    raised = exercise.angles(0.4 * exercise.duration)

    def sit(angles: Any, start: float, seconds: float) -> list[dict[str, Any]]:
        hands = {side: webxr_pose(side, angles)[1:3] for side in ("left", "right")}
        states = []
        for k in range(1, int(seconds / STEP) + 1):
            now = start + k * STEP
            room.receive(Hands(now, hands["left"][1], hands["left"][0], hands["right"][0]), now)
            states.append(room.step(now))
        return states

    rest = exercise.angles(0.0)
    assert sit(rest, 0.0, 4.0)[-1]["phase"] == "exercising"
    assert sit(raised, 4.0, 0.8)[-1]["progress"] > 0.9
    room.receive(Command("recentre"), 4.8)
    states = sit(rest, 4.8, 4.0)
    assert [states[k]["phase"] for k in (0, -1)] == ["settling", "exercising"]
    assert states[-1]["right"] == states[-1]["wrong"] == 0 and states[-1]["hint"] == ""


def test_who_is_not_seen_is_told_so() -> None:
    room = Room()
    room.receive(Begin("hands", 1.7, ("lateral_raise",)), 0.0)
    head = Place((0.0, 1.2, 0.0), (0.0, 0.0, 0.0, 1.0))
    for k in range(60):
        room.receive(Hands(k / 30, head, None, None), k / 30)
        room.step(k / 30)
    state = run(room, 2, start=2.0)[-1]
    assert not state["seen"] and not state["following"]
    assert "cannot see you" in state["hint"]


def test_poses_that_no_body_has_do_not_end_a_session() -> None:
    rng = random.Random(5)
    room = Room()
    room.receive(Begin("hands", 0.8, ("head_rotation",)), 0.0)

    def place() -> Place:
        turn = [rng.gauss(0, 1) for _ in range(4)]
        length = math.hypot(*turn)
        point = tuple(rng.choice((0.0, rng.uniform(-50, 50))) for _ in range(3))
        return Place(point, tuple(t / length for t in turn))  # type: ignore[arg-type]

    for k in range(400):
        time = k * STEP
        room.receive(Hands(time, place(), place(), rng.choice((None, place()))), time)
        json.dumps(room.step(time), allow_nan=False)
    assert room.is_on


def test_nothing_is_recorded_without_consent_and_all_of_it_goes_when_it_is_withdrawn(
    tmp_path: Path,
) -> None:
    recorder = Recorder(tmp_path / "kept")
    room = Room(recorder=recorder)
    room.receive(simulated(), 0.0)
    run(room, 30)
    assert recorder.take() is None
    room.receive(simulated(), 100.0)
    room.receive(Consent(True), 100.0)
    run(room, 3, start=100.0)
    room.receive(Consent(False), 103.0)
    run(room, 30, start=103.0)
    assert recorder.take() is None
    assert not (tmp_path / "kept").exists()


def test_a_recording_holds_times_angles_and_judgements_and_a_report_and_can_be_deleted(
    tmp_path: Path,
) -> None:
    h5py = pytest.importorskip("h5py", reason="recordings need the extra 'coach'")
    recorder = Recorder(tmp_path)
    room = Room(recorder=recorder)
    room.receive(simulated("half_range"), 0.0)
    room.receive(Consent(True), 0.0)
    run(room, 9)
    room.receive(Simulate("none"), 9.0)
    run(room, 30, start=9.0)
    recording = recorder.take()
    assert recording is not None
    report = recording.write(tmp_path)
    recorder.written(report)
    text = report.read_text()
    assert "Lateral raise" in text and "Please go a little further." in text
    assert "src='data:image/png;base64," in text and len(text) > 7000  # its plots are in it
    assert report.parent.stat().st_mode & 0o077 == 0  # for this user alone
    with h5py.File(report.parent / "session.h5") as data:
        raised = data["angles"][:, MOTION_INDEX["left_shoulder_elevation"]]
        assert np.degrees(np.nanmax(raised)) == pytest.approx(90, abs=20)
        assert (np.diff(data["time"]) > 0).all()
        assert data["repetition/right"][-1] and not data["repetition/right"][0]
        assert "range" in json.loads(data["repetition/errors"].asstr()[0])
    with (report.parent / TABLE).open() as table:
        rows = list(csv.DictReader(table))
    assert rows[0]["verdict"] != "right" and rows[-1]["verdict"] == "right"
    assert float(rows[-1]["left_arm_deg"]) == pytest.approx(78, abs=20)
    bundle = json.loads((report.parent / OBSERVATIONS).read_text())
    found = {e["resource"]["code"]["text"]: e["resource"] for e in bundle["entry"]}
    done = found["Lateral raise: repetitions"]["valueQuantity"]
    assert (done["value"], done["code"]) == (len(rows), "{count}")
    assert {resource["resourceType"] for resource in found.values()} == {"Observation"}
    assert "All sessions in this folder" not in text  # one is no trend
    assert "All sessions in this folder" in recording.write(tmp_path).read_text()
    room.receive(Consent(False), 60.0)
    assert not report.parent.exists()


def test_the_page_offers_exercises_of_ones_own(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text((ROOT / "exercises" / "lateral_raise.yaml").read_text())
    room = Room(exercises=load_exercises(["head_rotation", str(mine)]))
    room.receive(simulated(exercises=("mine",)), 0.0)
    assert run(room, 1)[-1]["exercise"]["name"] == "mine"
    with pytest.raises(MessageError, match="head_rotation"):
        room.receive(simulated(exercises=("front_raise",)), 5.0)


@pytest.mark.slow
def test_consent_is_for_one_session_and_the_next_leaves_what_was_kept_alone(tmp_path: Path) -> None:
    pytest.importorskip("h5py", reason="recordings need the extra 'coach'")
    recorder = Recorder(tmp_path)
    room = Room(recorder=recorder)
    with pytest.raises(MessageError, match="no session"):
        room.receive(Consent(True), 0.0)
    room.receive(simulated(), 0.0)
    room.receive(Consent(True), 0.0)
    run(room, 5)
    recording = recorder.take()
    assert recording is not None
    recorder.written(report := recording.write(tmp_path))
    room.receive(simulated(), 10.0)
    run(room, 5, start=10.0)
    assert recorder.take() is None
    room.receive(Consent(False), 15.0)
    assert report.is_file()


def test_what_is_told_says_of_which_session_it_is() -> None:
    room = Room()
    assert room.step(0.0)["session"] == 0
    for number in (1, 2):
        room.receive(simulated(), float(number))
        assert room.step(number + STEP)["session"] == number
    with pytest.raises(MessageError):
        room.receive(simulated(lift_left_deg=10.0, lift_right_deg=10.0), 3.0)
    assert room.step(3.0 + STEP)["session"] == 2


TOKEN = "of-this-start"
SESSION = f"/session?token={TOKEN}"
Socket: TypeAlias = "ClientWebSocketResponse[Any]"
Talk = Callable[[Socket], Awaitable[None]]
Ask = Callable[[ClientSession, str], Awaitable[None]]


def serve(ask: Ask, **service: Any) -> None:
    """Serve the page on a free port of this computer while `ask` asks."""

    service = {"token": TOKEN, **service}

    async def work() -> None:
        runner = web.AppRunner(Server(Service(packages=WEB, **service)).app, handle_signals=False)
        await runner.setup()
        site = web.SockSite(runner, bound(LOOPBACK, 0), shutdown_timeout=0.5)
        await site.start()
        url = f"http://{LOOPBACK}:{runner.addresses[0][1]}"
        try:
            async with ClientSession() as client:
                await ask(client, url)
        finally:
            await runner.cleanup()

    asyncio.run(asyncio.wait_for(work(), 60))


def talk(say: Talk, **service: Any) -> None:
    async def ask(client: ClientSession, url: str) -> None:
        async with client.ws_connect(url + SESSION, origin=url) as session:
            await say(session)

    serve(ask, **service)


async def answer(session: Socket, kind: str) -> dict[str, Any]:
    """Return the next message of a kind."""
    while True:
        message: dict[str, Any] = await session.receive_json()
        if message["type"] == kind:
            return message


def test_bad_messages_are_refused_and_logged_and_the_session_goes_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def say(session: Socket) -> None:
        await session.send_json({**BEGIN, "source": "simulated"})
        for text in (*list(BAD.values())[:8], BAD["deep nesting"], BAD["too long"]):
            await session.send_str(text)
            assert (await answer(session, "refused"))["why"]
        await session.send_bytes(b"\x00" * 100)
        assert "text" in (await answer(session, "refused"))["why"]
        before = await answer(session, "state")
        after = await answer(session, "state")
        assert after["time"] > before["time"]
        assert after["phase"] != "waiting"

    with caplog.at_level(logging.WARNING):
        talk(say)
    assert sum("refused a message" in record.message for record in caplog.records) >= 10


def test_a_flood_is_dropped_and_the_session_goes_on() -> None:
    async def say(session: Socket) -> None:
        await session.send_json({**BEGIN, "source": "simulated"})
        for _ in range(3000):
            await session.send_str('{"type": "command", "wish": "resume"}')
        assert "too many" in (await answer(session, "refused"))["why"]
        await asyncio.sleep(0.2)
        await session.send_json({"type": "command", "wish": "stop"})
        while (await answer(session, "state"))["phase"] != "over":
            pass

    talk(say)


def test_a_message_before_a_session_and_of_another_source_is_refused() -> None:
    async def say(session: Socket) -> None:
        await session.send_json(HANDS)
        assert "no session" in (await answer(session, "refused"))["why"]
        await session.send_json({"type": "consent", "given": True})
        assert "--record" in (await answer(session, "refused"))["why"]
        await session.send_json({**BEGIN, "source": "simulated"})
        await session.send_json(HANDS)
        assert "simulated" in (await answer(session, "refused"))["why"]

    talk(say)


def test_what_is_far_too_long_closes_its_own_session_only() -> None:
    async def ask(client: ClientSession, url: str) -> None:
        async with (
            client.ws_connect(url + SESSION, origin=url) as one,
            client.ws_connect(url + SESSION, origin=url) as other,
        ):
            await one.send_str("x" * 2_000_000)
            while (await one.receive()).type is WSMsgType.TEXT:
                pass
            assert one.closed
            assert (await answer(other, "state"))["phase"] == "waiting"

    serve(ask)


def test_other_origins_and_foreign_names_are_refused() -> None:
    async def ask(client: ClientSession, url: str) -> None:
        port = url.rsplit(":", 1)[1]
        origins = (
            "http://evil.example",
            "null",
            f"http://{LOOPBACK}:1",
            f"https://{LOOPBACK}:{port}",
        )
        for origin in origins:
            with pytest.raises(WSServerHandshakeError) as caught:
                await client.ws_connect(url + SESSION, origin=origin)
            assert caught.value.status == 403
        with pytest.raises(WSServerHandshakeError):
            await client.ws_connect(url + SESSION)
        for host in (f"evil.example:{port}", "127.0.0.1.evil.example", "", "10.0.0.1"):
            async with client.get(url, headers={"Host": host}) as response:
                assert response.status in (400, 403)
        async with client.get(url, headers={"Sec-Fetch-Site": "cross-site"}) as response:
            assert response.status == 403
        async with client.get(f"{url}/", headers={"Host": f"localhost:{port}"}) as response:
            assert response.status == 200

    serve(ask)


def test_the_page_loads_nothing_from_elsewhere_and_serves_its_own_files_only() -> None:
    async def ask(client: ClientSession, url: str) -> None:
        async with client.get(url) as response:
            policy = response.headers["Content-Security-Policy"]
            text = await response.text()
        policy = policy.replace("wasm-unsafe-eval", "")  # MediaPipe
        assert "default-src 'none'" in policy and "unsafe" not in policy and "http" not in policy
        assert "http:" not in text and "https:" not in text and "<style" not in text
        for path in (
            "/web/../server.py",
            "/web/%2e%2e/server.py",
            "/web/package.json",
            "/package/three/x.js",
            "/package/pose/package.json",
            "/package/x/pose.js",
            "/web/..%2fserver.py",
            "/etc/passwd",
        ):
            async with client.get(url + path) as response:
                assert response.status in (400, 403, 404), path
                assert "Content-Security-Policy" in response.headers
        async with client.get(f"{url}/setting?token={TOKEN}") as response:
            setting = await response.json()
        assert [each["name"] for each in setting["exercises"]] == list(exercise_names())
        assert setting["record"] is None
        for file in WEB.glob("*.js"):
            async with client.get(f"{url}/web/{file.name}") as response:
                assert response.status == 200, file.name
            assert "//" not in file.read_text().replace("// ", "").replace("://${", "")

    serve(ask)
