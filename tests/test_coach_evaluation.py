"""`rcare-marl coach evaluate`, and the sensors of synthetic people."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from typer.testing import CliRunner

from rcare_marl.agents.coaching.exercise import load_exercise
from rcare_marl.agents.coaching.sources.hands_source import HandsReading, HandsSource
from rcare_marl.agents.coaching.upper_body import ARM
from rcare_marl.baselines.coaching.camera_sensor import CameraSensor
from rcare_marl.baselines.coaching.evaluation import evaluate_coach, noise_levels
from rcare_marl.baselines.coaching.noise import TROUBLES, HandsSensor, NoiseModel
from rcare_marl.baselines.coaching.performance import perform
from rcare_marl.baselines.coaching.synthetic_user import draw_person
from rcare_marl.cli.app import app
from rcare_marl.errors import ConfigError

Array = npt.NDArray[np.float64]
SHORT = ("coach", "evaluate", "--source", "joints", "--users", "1", "--exercise", "front_raise")


def told(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == 0, result.output
    return result.stdout


def test_one_json_object_says_how_much_was_recognised_and_detected() -> None:
    out = json.loads(told(*SHORT, "--seed", "3", "--processes", "1", "--json"))
    assert 0 <= out["right_recognised"] <= 1 and 0 <= out["wrong_detected"] <= 1
    assert out["source"] == "joints" and out["seed"] == 3 and out["users"] == 1
    assert set(out["exercises"]["front_raise"]) == {"right_recognised", "wrong_detected"}
    assert {"confusion", "latency", "false_alarms", "frame_ms", "kinds"} <= set(out)


@pytest.mark.slow  # starts two processes, as a test of evaluations in test_protocol.py does
def test_the_trials_do_not_depend_on_how_many_processes_there_are() -> None:
    exercises = [load_exercise("head_rotation")]
    one, two = (
        evaluate_coach(source="joints", users=2, seed=4, exercises=exercises, processes=count)
        for count in (1, 2)
    )
    assert one == two and {trial.user for trial in one.trials} == {0, 1}


@pytest.mark.slow
def test_tables_say_it_to_people_and_levels_of_noise_are_drawn(tmp_path: Path) -> None:
    plot, numbers = tmp_path / "noise.png", tmp_path / "out" / "coach.json"
    out = told(
        *SHORT,
        "--processes",
        "1",
        "--level",
        "1",
        "--level",
        "4",
        "--plot",
        str(plot),
        "--output",
        str(numbers),
    )
    for words in ("right recognised", "wrong detected", "half range", "as noise grows", "x 4"):
        assert words in out
    assert plot.read_bytes()[:4] == b"\x89PNG"
    written = json.loads(numbers.read_text())
    assert set(written["levels"]) == {"1", "4"}
    assert written["levels"]["4"]["noise"]["position"] == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (("--source", "hand"), "hands"),
        (("--exercise", "lateral_rise"), "lateral_raise"),
        (("--split", "training"), "development"),
        (("--level", "-1"), "positive"),
        (("--trouble", "hand_los"), "hand_lost"),
        (("--trouble", "swapped", "--source", "joints"), "--source hands"),
    ],
)
def test_a_slip_is_named_with_what_is_allowed(wrong: tuple[str, str], words: str) -> None:
    result = CliRunner().invoke(app, ["coach", "evaluate", "--users", "1", *wrong])
    assert result.exit_code == 2 and not result.stdout
    assert "error:" in result.stderr and words in result.stderr
    assert "Traceback" not in result.output


def test_levels_of_noise_are_multiples_of_the_usual() -> None:
    usual, twice = NoiseModel(), noise_levels("hands", [2.0])[2.0]
    assert twice.pixel == 2 * usual.pixel and twice.dropout == 2 * usual.dropout
    with pytest.raises(ConfigError, match="positive"):
        noise_levels("hands", [0.0])


def seen_of_hands(trouble: str) -> tuple[HandsSource, list[HandsReading]]:
    """Return a source that a person sat down before, and what headset and hands report then."""
    user, rng = draw_person(0, seed=5), np.random.default_rng(0)
    done = perform(user, load_exercise("lateral_raise"), "right", rng, repetitions=3)
    assert done is not None
    sensor = HandsSensor(TROUBLES[trouble])
    source = sensor.source(user, rng)
    return source, [raw for _, _, raw in sensor.readings(user, done, rng)]


def test_troubles_of_a_headset_are_what_they_say() -> None:
    usual, _ = seen_of_hands("drift")
    source, readings = seen_of_hands("swapped")
    assert source.is_swapped and not usual.is_swapped
    source, _ = seen_of_hands("stature")
    assert source.fit.height == pytest.approx(usual.fit.height + 0.06, abs=0.011)
    _, readings = seen_of_hands("hand_lost")
    missing = [np.mean([getattr(r, side) is None for r in readings]) for side in ("left", "right")]
    assert min(missing) < 0.12 and 0.12 < max(missing) < 0.35  # one hand, a sixth of the time
    source, readings = seen_of_hands("slumped")
    frames = [source.update(raw, k / 30) for k, raw in enumerate(readings)]
    leans = [frame.angles[0] for frame in frames if frame is not None]
    assert np.degrees(np.median(leans[-30:]) - np.median(leans[:30])) == pytest.approx(12, abs=5)


# --- The camera's sensor. ---


def test_a_camera_misses_cards_that_are_turned_away_or_behind_the_body() -> None:
    user, rng = draw_person(0, seed=3, split="development"), np.random.default_rng(0)
    sensor = CameraSensor(NoiseModel(dropout=0.0))
    source = sensor.source(user, rng)
    assert source.source.tracker is not None  # the calibration sufficed
    done = perform(user, load_exercise("front_raise"), "right", rng)
    assert done is not None
    seen = [set(sight.seen) for _, _, sight in sensor.readings(user, done, rng)]
    counts = [len(each) for each in seen]
    assert 5 <= np.median(counts) <= 16  # of 24: half of each cuff looks away
    assert not any(
        {8, 9} & each for each in seen
    )  # the headband's cards at the back of the temples


def test_a_camera_tells_the_arms_of_a_synthetic_person() -> None:
    user, rng = draw_person(1, seed=3, split="development"), np.random.default_rng(1)
    sensor = CameraSensor(NoiseModel())
    source = sensor.source(user, rng)
    done = perform(user, load_exercise("lateral_raise"), "right", rng)
    assert done is not None
    off = []
    for taken, clock, sight in sensor.readings(user, done, rng):
        frame = source.update(sight, clock)
        k = int(np.argmin(np.abs(done.times - taken)))
        if frame is not None:
            off.append(frame.angles[ARM["left"].start] - done.angles[k, ARM["left"].start])
    assert np.nanmedian(np.abs(np.degrees(off))) < 8


@pytest.mark.slow
def test_headset_and_hands_of_people_never_seen_are_recognised() -> None:
    found = evaluate_coach(source="hands", users=6, seed=77, processes=2)
    assert found.right_recognised > 0.97 and found.wrong_detected > 0.98
    assert found.latency()["p95_s"] < 0.5


@pytest.mark.slow
def test_the_bands_of_people_never_seen_are_recognised_by_camera() -> None:
    found = evaluate_coach(source="camera", users=2, seed=77, processes=2)
    assert found.right_recognised > 0.9 and found.wrong_detected > 0.95
