"""A guided calibration of headset and hands: led, refused, asked again, kept."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rcare_marl.agents.coaching.sources.body_fit import BodyFit
from rcare_marl.agents.coaching.sources.calibration import MOST_AGAIN, PARTS, Calibration
from rcare_marl.agents.coaching.sources.hands_source import HandsReading, HandsSource
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX, UpperBody
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose

RATE = 30.0
USUAL = UpperBody.of_height(1.7)
WIDE = replace(
    USUAL,
    shoulder=1.12 * USUAL.shoulder,
    upper_arm=1.06 * USUAL.upper_arm,
    forearm=1.06 * USUAL.forearm,
)
Spoil = Callable[[np.ndarray], None]


def reading(angles: np.ndarray, body: UpperBody = USUAL) -> HandsReading:
    poses = body.poses(angles)
    names = ("head", "left_hand", "right_hand")
    return HandsReading(*(Pose(*(tuple(each.tolist()) for each in poses[n])) for n in names))


def led(
    calibration: Calibration,
    *,
    body: UpperBody = USUAL,
    part: int | None = None,
    spoil: Spoil | None = None,
    lost: str = "",
    seconds: float = 30.0,
) -> list[str]:
    """Follow what is shown, but in one part; return what was said of it until it is over."""
    troubles = [""]
    for k in range(int(seconds * RATE)):
        angles = calibration.angles
        is_off = calibration.index == part
        if is_off and spoil is not None:
            spoil(angles)
        seen = reading(angles, body)
        calibration.update(replace(seen, **{lost: None}) if is_off and lost else seen, k / RATE)
        if calibration.trouble != troubles[-1]:
            troubles.append(calibration.trouble)
        if calibration.is_over:
            break
    return troubles[1:]


def test_who_follows_is_measured_within_twenty_seconds() -> None:
    calibration = Calibration(1.7)
    told = calibration.left
    assert led(calibration, body=WIDE, seconds=20.0) == []
    assert calibration.is_over and calibration.left == 0.0 < told < 20.0
    assert calibration.fit is not None and calibration.fit.is_measured
    assert calibration.fit.body.reach == pytest.approx(WIDE.reach, rel=0.03)
    assert calibration.fit.body.shoulder == pytest.approx(WIDE.shoulder, rel=0.08)
    assert f"{100 * calibration.fit.body.reach:.0f} cm" in calibration.words
    frame = calibration.source.update(reading(np.zeros(16), WIDE), 100.0)  # goes on at once
    assert frame is not None


def put(motion: str, degrees: float) -> Spoil:
    def spoil(angles: np.ndarray) -> None:
        angles[MOTION_INDEX[motion]] = math.radians(degrees)

    return spoil


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "spoil", "lost", "said"),
    [
        (0, put("left_shoulder_elevation", 60.0), "", "left arm did not hang"),
        (0, None, "head", "could not see your head"),
        (1, put("right_shoulder_elevation", 10.0), "", "right arm was not held out to the front"),
        (1, None, "left", "could not see your left hand"),
        (2, put("left_shoulder_plane", 85.0), "", "left arm was not held out to the side"),
        (3, put("right_shoulder_plane", 5.0), "", "right arm did not go round"),
    ],
)
def test_who_does_a_part_wrong_is_told_what_and_asked_again_for_it(
    part: int, spoil: Spoil | None, lost: str, said: str
) -> None:
    calibration = Calibration(1.7)
    seconds = sum(each.seconds + 2.0 for each in PARTS[: part + 1]) + 0.5
    (trouble,) = led(calibration, part=part, spoil=spoil, lost=lost, seconds=seconds)
    assert said in trouble and "Once more" in trouble
    assert calibration.index == part and calibration.say == PARTS[part].say
    assert led_on(calibration, seconds)  # who then does it is measured all the same


def led_on(calibration: Calibration, start: float) -> bool:
    for k in range(int(30 * RATE)):
        calibration.update(reading(calibration.angles), start + k / RATE)
    return calibration.fit is not None


def test_arms_that_are_held_bent_are_not_measured() -> None:
    calibration = Calibration(1.7)

    def bend(angles: np.ndarray) -> None:
        for arm in ARM.values():
            angles[arm.start + 3] = math.radians(100.0)

    for k in range(int(20 * RATE)):
        angles = calibration.angles
        bend(angles)
        calibration.update(reading(angles), k / RATE)
    assert calibration.fit is None and calibration.trouble


@pytest.mark.slow
def test_who_does_not_follow_goes_on_without_measures_in_the_end() -> None:
    calibration = Calibration(1.7)
    for k in range(int((MOST_AGAIN + 2) * 10 * RATE)):
        calibration.update(reading(np.zeros(16)), k / RATE)
    assert calibration.is_over and calibration.fit is None
    assert "more leniently" in calibration.words


def test_an_arm_that_cannot_rise_is_not_asked_to() -> None:
    calibration = Calibration(1.7, lift=(70.0, 20.0))
    highest = np.zeros(2)
    for k in range(int(20 * RATE)):
        angles = calibration.angles
        raised = [math.degrees(angles[arm.start]) for arm in ARM.values()]
        highest = np.maximum(highest, raised)
        calibration.update(reading(angles), k / RATE)
    assert highest[0] <= 71 and highest[1] <= 20
    assert calibration.fit is not None
    with pytest.raises(ConfigError, match="at least 40 degrees, got 30 .left. and 20"):
        Calibration(1.7, lift=(30.0, 20.0))


def test_what_is_known_of_a_body_can_be_kept_and_nonsense_is_refused() -> None:
    calibration = Calibration(1.7)
    led(calibration, body=WIDE)
    assert calibration.fit is not None
    numbers = calibration.fit.to_dict()
    again = BodyFit.from_dict(numbers)
    assert again.to_dict() == numbers
    assert (again.of_reach, again.is_measured) == (calibration.fit.of_reach, True)
    assert HandsSource(1.7, fit=again).body.reach == pytest.approx(WIDE.reach, rel=0.03)
    with pytest.raises(ConfigError, match=r"forearm of 2 m does not fit a stature of 1.7 m"):
        BodyFit.from_dict({**numbers, "forearm": 2.0})
    with pytest.raises(ConfigError, match="has the numbers eyes, forearm"):
        BodyFit.from_dict({"height": 1.7})
    with pytest.raises(ConfigError, match="got 0.01 m and 9$"):
        BodyFit.from_dict({**numbers, "forward": 0.01, "lift": 9.0})


pytest.importorskip("aiohttp", reason="the coach's page needs the extra 'coach'")

from test_coach_server import BEGIN, Socket, answer, run, talk  # noqa: E402

from rcare_marl.baselines.coaching.page.message import Begin, Command, MessageError  # noqa: E402
from rcare_marl.baselines.coaching.page.room import STEP, Room  # noqa: E402


@pytest.mark.slow
def test_a_page_is_led_through_a_calibration_and_begins_the_next_session_with_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rcare_marl.baselines.coaching.page.server.STEP", 0.001)
    ticks = itertools.count()
    whole = {**BEGIN, "source": "simulated", "measure": True, "repetitions": 1}

    async def say(session: Socket) -> None:
        async def until(holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
            while True:
                state = await answer(session, "state")
                if holds(state):
                    return state

        await session.send_json({**whole, "mistake": "still"})
        first = await until(lambda s: s["phase"] == "measuring")
        assert first["said"] == first["calibration"]["say"] == PARTS[0].say
        assert first["calibration"]["left_s"] > 15
        state = await until(lambda s: s["calibration"]["trouble"])
        assert "Your left arm was not held out to the front" in state["said"]
        assert state["hint"] == state["calibration"]["trouble"]
        assert (state["calibration"]["part"], state["calibration"]["of"]) == (2, 4)
        await session.send_json({"type": "simulate", "mistake": "none"})
        state = await until(lambda s: s["phase"] == "exercising")
        assert "I have measured you" in state["note"]
        assert (await until(lambda s: s["phase"] == "over"))["right"] == 1
        body = state["calibration"]["body"]
        await session.send_json({**BEGIN, "body": body})
        assert (await until(lambda s: s["session"] == 2))["note"] == ""
        await session.send_json(BEGIN)
        assert "not measured" in (await until(lambda s: s["session"] == 3))["note"]
        for wrong, why in (
            ({"body": {**body, "palm": 3.0}}, "palm of 3 m does not fit"),
            ({"body": body, "height_m": 1.8}, "of somebody of 1.70 m"),
            ({"measure": True, "source": "landmarks"}, "only hands are calibrated"),
            ({"body": [1.7]}, "is an object"),
        ):
            await session.send_json({**BEGIN, **wrong})
            assert why in (await answer(session, "refused"))["why"]

    talk(say, clock=lambda: 2 * next(ticks) * STEP)


def test_a_calibration_can_be_skipped_waits_while_paused_and_begins_anew_when_centred() -> None:
    room = Room()
    begin = Begin("simulated", 1.7, ("lateral_raise",), measure=True)
    room.receive(begin, 0.0)
    assert run(room, 5)[-1]["calibration"]["part"] == 2
    room.receive(Command("pause"), 5.0)
    paused = run(room, 30, start=5.0)[-1]
    assert (paused["phase"], paused["calibration"]["trouble"]) == ("paused", "")
    room.receive(Command("resume"), 35.0)
    room.receive(Command("recentre"), 35.0)
    assert run(room, 1, start=35.0)[-1]["calibration"]["part"] == 1
    room.receive(Command("skip"), 36.0)
    state = run(room, 4, start=36.0)[-1]
    assert state["phase"] in ("explaining", "exercising")
    assert "not measured" in state["note"] and state["exercise"]["number"] == 1


def test_a_calibration_of_arms_that_hardly_rise_is_refused() -> None:
    begin = Begin(
        "hands", 1.7, ("head_rotation",), measure=True, lift_left_deg=20.0, lift_right_deg=20.0
    )
    with pytest.raises(MessageError, match="must rise by at least 40"):
        Room().receive(begin, 0.0)


@pytest.mark.slow
def test_who_was_measured_stays_so_when_centred_anew() -> None:
    room = Room()
    room.receive(Begin("simulated", 1.7, ("lateral_raise",), measure=True, repetitions=9), 0.0)
    assert run(room, 22)[-1]["phase"] == "exercising"
    room.receive(Command("recentre"), 22.0)
    assert "I have measured you" in run(room, 3, start=22.0)[-1]["note"]
