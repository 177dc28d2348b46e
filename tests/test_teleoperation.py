"""People in the scene: hands over a websocket, without a browser; who may ask what, and what is refused."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="the page needs the extra 'coach'")
pytest.importorskip("h5py", reason="records need the extra 'data'")

from aiohttp import ClientSession, WSServerHandshakeError, web
from scipy.spatial import KDTree  # type: ignore[import-untyped]

from rcare_marl.baselines.pages.strict import LARGEST, MessageError
from rcare_marl.baselines.teleoperation.hand import feed, play
from rcare_marl.baselines.teleoperation.server import Server
from rcare_marl.baselines.teleoperation.stage import Hand, Scenario, Stage, parse
from rcare_marl.baselines.teleoperation.tracked import Tracked
from rcare_marl.envs import make
from rcare_marl.envs.datasets import read, record
from rcare_marl.envs.episode import RecordedEpisode, replay
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.rendering.scenery import STEPS

TOKEN = "of-the-test"
Steps: TypeAlias = Callable[[str, Server], Awaitable[None]]
HAND = {"type": "hand", "seen": 0, "clutch": True, "values": [0, 0, 0, 0, 0, 0]}


def track(**hand: Any) -> dict[str, Any]:
    right = {"place": [0, 0, 1, 0, 0, 0, 1], "clutch": True, "grasp": 0, **hand}
    still = {"head": None, "left": None, "walk": [0, 0, 0], "kneel": [0, 0]}
    return {"type": "tracked", "seen": 0, "right": right, **still}


def unpacked(data: bytes) -> dict[str, Any]:
    size = int.from_bytes(data[:4], "little")
    header: dict[str, Any] = json.loads(data[4 : 4 + size])
    for name, (kind, at, count) in header.pop("arrays").items():
        header[name] = np.frombuffer(data, f"<{kind}", count, 4 + size + at)
    return header


BAD = {
    "no JSON": "hello",
    "empty": "",
    "a list": "[1, 2]",
    "no type": "{}",
    "unknown type": '{"type": "eval", "code": "1"}',
    "a type from Python": '{"type": "__class__"}',
    "NaN": json.dumps({**HAND, "values": [float("nan")] * 6}),
    "infinity": json.dumps({**HAND, "values": [float("inf")] * 6}),
    "a float that overflows": json.dumps(HAND).replace("[0,", "[1e999,"),
    "a huge whole number": json.dumps(HAND).replace('"seen": 0', '"seen": ' + "9" * 400),
    "too fast": json.dumps({**HAND, "values": [2] * 6}),
    "true for a number": json.dumps({**HAND, "values": [True] * 6}),
    "text for a number": json.dumps({**HAND, "seen": "1"}),
    "half a scene": json.dumps({**HAND, "seen": 1.5}),
    "a clutch by a number": json.dumps({**HAND, "clutch": 1}),
    "no clutch": json.dumps({"type": "hand", "seen": 0, "values": []}),
    "an unknown field": json.dumps({**HAND, "more": 1}),
    "a field twice": '{"type": "command", "wish": "go", "wish": "pause"}',
    "an unknown wish": '{"type": "command", "wish": "format"}',
    "a view, which pages keep to themselves": '{"type": "view", "turned": 0, "raised": 0, "nearness": 1}',
    "a hand out of the world": json.dumps(track(place=[1e3, 0, 0, 0, 0, 0, 1])),
    "a hand that is turned by no rotation": json.dumps(track(place=[0, 0, 0, 0, 0, 0, 0])),
    "a hand without a turn": json.dumps(track(place=[0, 0, 0])),
    "a hand closed twice over": json.dumps(track(grasp=2)),
    "a hand with more": json.dumps(track(more=1)),
    "a head by name": json.dumps({**track(), "head": "mine"}),
    "running": json.dumps({**track(), "walk": [2, 0, 0]}),
    "too many values": json.dumps({**HAND, "values": [0] * 600}),
    "deep nesting": "[" * 15000,
    "too long": '{"type": "hand", "seen": "' + "x" * LARGEST + '"}',
}


@pytest.mark.parametrize("text", BAD.values(), ids=BAD.keys())
def test_a_bad_message_is_refused_with_a_reason(text: str) -> None:
    with pytest.raises(MessageError) as caught:
        parse(text)
    assert 0 < len(str(caught.value)) < 200


def serve(scenario: Scenario, steps: Steps, **more: Any) -> None:
    async def run() -> None:
        server = Server(scenario, token=TOKEN, waits=True, **more)
        runner = web.AppRunner(server.app)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        port = runner.addresses[0][1]
        try:
            await asyncio.wait_for(steps(f"http://127.0.0.1:{port}", server), 60)
        finally:
            await runner.cleanup()

    asyncio.run(run())


def test_a_hand_feeds_to_success_and_its_record_is_replayed(tmp_path: Path) -> None:
    done: list[bool] = []

    async def steps(address: str, _: Server) -> None:
        done.extend(await play(address, TOKEN, "robot", feed, episodes=2))

    serve(Scenario("feeding", ["robot"], seed=3, record=tmp_path / "hand.hdf5"), steps)
    assert done == [True, True]
    episodes = read(tmp_path / "hand.hdf5")
    assert [each.header.seed for each in episodes] == [3, 4]
    assert all(each.is_success for each in episodes)
    assert episodes[0].header.policies == {"robot": "hand", "recipient": "cooperative"}
    assert replay(episodes[1]).difference == ""


def test_two_people_play_two_roles() -> None:
    def mouth(seen: Any) -> list[float]:
        return opening

    opening: list[float] = []
    done: list[bool] = []

    async def steps(address: str, server: Server) -> None:
        acts = server._stage.facts("recipient")["acts"]
        opening.extend(1.0 if "jaw" in name else 0.0 for name in acts)
        robot = play(address, TOKEN, "robot", feed, episodes=1)
        recipient = play(address, TOKEN, "recipient", mouth, episodes=1)
        first, second = await asyncio.gather(robot, recipient)
        done.extend(first + second)

    serve(Scenario("feeding", ["robot", "recipient"], seed=1), steps)
    assert done == [True, True]


def test_nobody_foreign_gets_in_and_bad_messages_change_nothing() -> None:
    async def steps(address: str, _: Server) -> None:
        host = {"Origin": address}
        async with ClientSession() as session:
            for wrong in (
                {"params": {"role": "robot", "token": TOKEN}, "headers": {"Origin": "http://evil"}},
                {"params": {"role": "robot", "token": TOKEN}},
                {"params": {"role": "robot", "token": "guess"}, "headers": host},
                {"params": {"role": "robot"}, "headers": host},
                {"params": {"role": "robot", "token": TOKEN}, "headers": {**host, "Host": "evil"}},
                {"params": {"role": "doctor", "token": TOKEN}, "headers": host},
            ):
                with pytest.raises(WSServerHandshakeError) as caught:
                    await session.ws_connect(f"{address}/session", **wrong)  # type: ignore[arg-type]
                assert caught.value.status in (403, 409)
            for path in ("/setting", "/setting?token=guess", "/web/../stage.py", "/web/stage.py"):
                assert (await session.get(address + path)).status in (403, 404)
            good = {"role": "robot", "token": TOKEN}
            async with session.ws_connect(
                f"{address}/session", params=good, headers=host
            ) as socket:
                assert (await socket.receive_json())["type"] == "facts"
                first = await socket.receive_json()
                kinds = [unpacked(await socket.receive_bytes())["kind"] for _ in range(3)]
                assert kinds == ["shapes", "surface", "frame"]
                with pytest.raises(WSServerHandshakeError):  # one person a role
                    await session.ws_connect(f"{address}/session", params=good, headers=host)
                refused = 0
                for text in [*list(BAD.values())[:20], json.dumps({**HAND, "values": [0]})]:
                    await socket.send_str(text)
                    told: dict[str, Any] = {}
                    while told.get("type") != "refused":
                        item = await socket.receive()
                        told = json.loads(item.data) if isinstance(item.data, str) else {}
                    refused += 1
                await socket.send_json({"type": "command", "wish": "pause"})
                while told.get("status") != "paused":
                    item = await socket.receive()
                    told = json.loads(item.data) if isinstance(item.data, str) else {}
                assert refused == 21
                assert told["number"] == first["number"] and told["seen"] == first["seen"]

    serve(Scenario("feeding", ["robot"]), steps)


def test_without_the_clutch_nothing_moves() -> None:
    stage = Stage(Scenario("feeding", ["robot"]))
    before = stage.seen("robot")["seen"]["bowl_position"]
    stage.step({"robot": Hand(0, False, (1.0,) * 6)})
    stage.step({})
    assert stage.seen("robot")["seen"]["bowl_position"] == pytest.approx(before, abs=1e-3)
    stage.step({"robot": Hand(0, True, (1.0,) * 6)})
    stage.step({"robot": Hand(0, True, (1.0,) * 6)})
    assert stage.seen("robot")["seen"]["bowl_position"] != pytest.approx(before, abs=1e-3)
    stage.close()


def test_a_tracked_hand_leads_the_tool_from_where_its_clutch_closed() -> None:
    stage = Stage(Scenario("feeding", ["robot"]))
    before = np.array(stage.seen("robot")["body"]["tool"])

    def hold(x: float, *, clutch: bool = True) -> None:
        hand = {"place": [x, 0.4, 1.3, 0, 0, 0, 1], "clutch": clutch}
        message = parse(json.dumps(track(**hand)))
        assert isinstance(message, Tracked)
        stage.step({"robot": message})

    hold(2.0, clutch=False)
    for _ in range(15):
        hold(1.0)
    there = np.array(stage.seen("robot")["body"]["tool"])
    assert there == pytest.approx(before, abs=0.003)  # wherever the hand is
    for _ in range(15):
        hold(1.05)
    moved = np.array(stage.seen("robot")["body"]["tool"]) - before
    assert moved == pytest.approx((0.05, 0, 0), abs=0.006)
    stage.close()


@pytest.mark.slow
def test_an_arm_follows_a_tracked_hand_as_far_as_its_active_range_goes() -> None:
    stage = Stage(Scenario("dressing", ["caregiver"]))
    body = stage.seen("caregiver")["body"]
    assert body["eyes"][2] > body["palms"]["left"][2]

    def reach(point: Any) -> dict[str, Any]:
        hand = {
            "place": [*np.asarray(point, float).tolist(), 0, 0, 0, 1],
            "clutch": True,
            "grasp": 0,
        }
        message = parse(json.dumps({**track(), "left": hand, "right": None}))
        assert isinstance(message, Tracked)
        for _ in range(12):
            stage.step({"caregiver": message})
        return dict(stage.seen("caregiver")["body"])

    near = np.array(body["palms"]["left"]) + (-0.15, 0.0, 0.15)
    there = reach(near)
    assert there["palms"]["left"] == pytest.approx(near, abs=0.05) and not there["behind"]
    beyond = reach(near + (-1.0, 0.0, 1.0))
    assert np.linalg.norm(np.subtract(beyond["palms"]["left"], near + (-1.0, 0.0, 1.0))) > 0.3
    assert "left" in beyond["behind"]
    stage.close()


@pytest.mark.parametrize("is_coarse", [False, True], ids=["fine", "coarse"])
def test_where_things_are_is_told_as_meshes_of_which_frames_tell_what_moved(
    is_coarse: bool,
) -> None:
    if is_coarse:
        pytest.importorskip("fast_simplification")
    stage = Stage(Scenario("feeding", ["robot"]))
    person = stage._env.world.skins[0]
    told, known = stage.drawn((), is_coarse=is_coarse)
    shapes, *surfaces, frame = (unpacked(each) for each in told)
    assert len(shapes["position"]) == len(shapes["normal"]) // 4 * 3
    assert max(first + count for first, count, *_ in shapes["runs"]) <= len(shapes["index"])
    assert shapes["index"].max() == len(shapes["position"]) // 3 - 1  # nothing that is not drawn
    assert shapes["slot"].max() == len(frame["places"]) // 12 - 1
    assert shapes["surfaces"] == len(surfaces) == len(frame["boxes"])
    for k, surface in enumerate(surfaces):
        assert surface["faces"].max() == len(frame[f"position{k}"]) // 3 - 1
    assert (len(surfaces[0]["faces"]) // 3 < 12_000) == is_coarse
    *low, span = frame["boxes"][0]
    at = low + span / STEPS * frame["position0"].reshape(-1, 3)
    off = KDTree(person.vertices()).query(at)[0]
    assert off.max() < 1e-4  # [m]
    stage.step({"robot": Hand(0, True, (1.0,) * 6)})
    told, known = stage.drawn(known, is_coarse=is_coarse)
    (later,) = (unpacked(each) for each in told)
    assert later["number"] == frame["number"] + 1
    moved = np.abs(later["places"] - frame["places"]).reshape(-1, 12).max(axis=1) > 1e-3
    assert 0 < moved.sum() < len(moved)
    person.colors = person.colors.copy()  # it is painted anew: only that is told
    told, _ = stage.drawn(known, is_coarse=is_coarse)
    assert [unpacked(each)["kind"] for each in told] == ["surface", "frame"]
    stage.close()


def test_marked_episodes_are_recorded_as_successes(tmp_path: Path) -> None:
    stage = Stage(Scenario("feeding", ["robot"], record=tmp_path / "marked.hdf5"))
    stage.step({})
    stage.mark()
    stage.step({})
    stage.begin()  # this one was not finished, and is dropped
    stage.close()
    (only,) = read(tmp_path / "marked.hdf5")
    assert only.is_success and only.steps == 1 and only.header.seed == 0


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> RecordedEpisode:
    path = tmp_path_factory.mktemp("recorded") / "two.hdf5"
    policies = {"robot": "scripted", "recipient": "cooperative"}
    with make("feeding", policies=policies) as env, record(env, path):
        env.reset(seed=4)
        while not env.is_over:
            env.step({})
    (episode,) = read(path)
    return episode


def test_a_record_is_shown_from_its_beginning_to_whoever_comes(recorded: RecordedEpisode) -> None:
    async def steps(address: str, server: Server) -> None:
        query = {"role": "audience", "token": TOKEN, "draws": "nothing"}
        for _ in range(2):  # the second comes when all was played
            async with (
                ClientSession() as session,
                session.ws_connect(f"{address}/session", params=query, origin=address) as socket,
            ):
                assert (await socket.receive_json())["replays"] == 1
                told = [await socket.receive_json()]
                while not told[-1]["is_over"]:
                    told.append(await socket.receive_json())
                times = sorted({round(each["time"], 3) for each in told})
                assert times[0] == 0.0 and len(times) == recorded.steps + 1
                assert told[-1]["success"] and not told[-1]["differs"]
                wanted = recorded.observations["robot"][-1]
                found = [value for values in told[-1]["seen"].values() for value in values]
                assert found == pytest.approx(wanted.tolist())

    serve(Scenario("feeding", (), replays=[recorded]), steps)


def test_a_record_that_comes_out_otherwise_says_where(recorded: RecordedEpisode) -> None:
    actions = {role: rows.copy() for role, rows in recorded.actions.items()}
    actions["robot"][2] = 0.0
    stage = Stage(Scenario("feeding", (), replays=[replace(recorded, actions=actions)]))
    for _ in range(3):
        assert not stage.seen("audience")["differs"]
        stage.step({})
    assert stage.seen("audience")["differs"].startswith("step 3:")
    stage.close()


def test_vital_signs_of_everybody_and_muscles_of_who_has_some_are_told() -> None:
    muscular = {"model": "daniel", "actuation": "muscle"}
    stage = Stage(Scenario("feeding", ["robot"], {"recipient": muscular}))
    stage.step({})
    told = stage.seen("robot")
    assert set(told["vitals"]["recipient"]) == set(stage.facts("robot")["vital_units"])
    shares = [share for _, share in told["muscles"]["recipient"]]
    assert len(shares) == 8 and shares == sorted(shares, reverse=True) and 0 <= shares[0] <= 1
    stage.close()


def test_a_scenario_names_what_is_wrong(recorded: RecordedEpisode) -> None:
    with pytest.raises(UnknownNameError, match="doctor"):
        Scenario("feeding", ["doctor"])
    with pytest.raises(ConfigError, match="each once"):
        Scenario("feeding", ["robot", "robot"])
    with pytest.raises(ConfigError, match="recorded episodes of 'bathing' are wanted"):
        Scenario("bathing", (), replays=[recorded])
    with pytest.raises(ConfigError, match="either a person plays or a policy"):
        Scenario("feeding", ["robot"], policies={"robot": "scripted"})
