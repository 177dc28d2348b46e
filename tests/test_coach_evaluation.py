"""`rcare-marl coach evaluate`, and the network that judges repetitions."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import torch
from typer.testing import CliRunner

from rcare_marl.agents.coaching.exercise import Exercise, load_exercise
from rcare_marl.agents.coaching.recognition.recogniser import Frame, Repetition
from rcare_marl.agents.coaching.recognition.segmenter import Segment
from rcare_marl.agents.coaching.recognition.template import Template, features
from rcare_marl.agents.coaching.sources.hands_source import HandsReading, HandsSource
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX, MOTIONS
from rcare_marl.baselines.coaching.camera_sensor import CameraSensor
from rcare_marl.baselines.coaching.evaluation import evaluate_coach, noise_levels
from rcare_marl.baselines.coaching.learned_recogniser import (
    CLASSES,
    SHIPPED,
    Floats,
    LearnedRecogniser,
    RepetitionNetwork,
    encode,
    load_network,
    mirrored,
    save_network,
)
from rcare_marl.baselines.coaching.noise import TROUBLES, HandsSensor, NoiseModel
from rcare_marl.baselines.coaching.performance import perform
from rcare_marl.baselines.coaching.synthetic_user import draw_person
from rcare_marl.baselines.coaching.train_recogniser import (
    WRONG_SOMEHOW,
    Examples,
    examples_of,
    loss_of,
    train,
)
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
        (("--recogniser", "rule"), "rules"),
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


# --- The network. ---


def segment_of(exercise: Exercise, path: Array) -> Segment:
    rows = features(path)
    times = np.arange(len(rows)) / 30.0
    return Segment(times, rows, features(path[:1])[0], 0.0, float(times[-1]), returned=True)


def encoded(exercise: Exercise, path: Array) -> tuple[Floats, Floats]:
    template, segment = Template(exercise), segment_of(exercise, path)
    return encode(segment, template)


def mirror_image(
    path: Array,
) -> Array:
    out = path.copy()
    out[:, ARM["left"]], out[:, ARM["right"]] = path[:, ARM["right"]], path[:, ARM["left"]]
    for i, motion in enumerate(MOTIONS):
        if motion.endswith("_left"):
            out[:, i] = -path[:, i]
    return out


def test_a_mirrored_repetition_is_that_of_the_other_side() -> None:
    exercise = load_exercise("front_raise").one_sided("left")
    path = exercise.path()
    path[:, MOTION_INDEX["trunk_rotation_left"]] = np.linspace(0, 0.3, len(path))
    sequence, facts = encoded(exercise, path)
    turned = mirrored(sequence[None], facts[None])
    other = encoded(load_exercise("front_raise").one_sided("right"), mirror_image(path))
    assert np.allclose(turned[0][0], other[0], atol=1e-5) and np.allclose(turned[1][0], other[1])
    back = mirrored(*turned)
    assert np.array_equal(back[0][0], sequence) and np.array_equal(back[1][0], facts)


def judged(exercise: Exercise, done: Exercise) -> list[Repetition]:
    recogniser = LearnedRecogniser()
    recogniser.begin(exercise)
    rest = np.tile(done.path()[:1], (30, 1))
    frames = np.concatenate((rest, done.path(), rest))
    found = [recogniser.update(Frame(k / 30, angles)).finished for k, angles in enumerate(frames)]
    return [repetition for repetition in found if repetition is not None]


@pytest.mark.parametrize("name", ["lateral_raise", "upper_lift", "front_raise", "chest_expansion"])
def test_the_shipped_network_knows_the_exercise_from_half_of_it_and_from_another(name: str) -> None:
    exercise = load_exercise(name)
    (right,) = judged(exercise, exercise)
    assert right.right and right.measures["right"] > 0.9
    (one,) = judged(exercise, exercise.one_sided("left"))
    assert not one.right and one.errors == ("one_side",)
    other = load_exercise("head_rotation")
    assert not any(repetition.right for repetition in judged(exercise, other))


def test_the_shipped_network_says_what_it_was_trained_on_and_is_small() -> None:
    about = load_network(SHIPPED)[1]
    assert about["classes"] == list(CLASSES) and about["people"]["hands"] >= 100
    assert about["measured"]["right_recognised"] > 0.9
    assert SHIPPED.stat().st_size < 2_000_000


def made_up(seed: int) -> Examples:
    """Right repetitions, and some that go half the way, each with a range and noise of its own."""
    rng = np.random.default_rng(seed)
    exercise = load_exercise("front_raise")
    sequences, facts, labels = [], [], []
    for k in range(60):
        share = rng.uniform(0.9, 1.05) if k % 2 == 0 else rng.uniform(0.4, 0.55)
        path = exercise.path()
        path = path[0] + share * (path - path[0]) + np.radians(rng.normal(0, 1, path.shape))
        sequence, fact = encoded(exercise, path)
        sequences.append(sequence)
        facts.append(fact)
        labels.append(CLASSES.index("right" if k % 2 == 0 else "range"))
    return Examples(np.stack(sequences), np.stack(facts), np.array(labels), np.arange(60) // 6)


@pytest.fixture
def one_thread() -> Iterator[None]:
    """As other tests run beside this one, more threads would only wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("one_thread")
def test_a_network_learns_to_tell_half_the_range_and_the_same_seed_gives_the_same() -> None:
    examples = made_up(0)
    network, measured = train(examples, seed=3, epochs=80)
    assert measured["right_recognised"] == 1.0 and measured["wrong_detected"] == 1.0
    again, _ = train(examples, seed=3, epochs=80)
    for a, b in zip(network.parameters(), again.parameters(), strict=True):
        assert torch.equal(a, b)
    scrambled = replace(examples, labels=np.random.default_rng(1).permutation(examples.labels))
    _, guessed = train(scrambled, seed=3, epochs=40)
    assert min(guessed["right_recognised"], guessed["wrong_detected"]) < 0.95


def test_what_was_wrong_somehow_teaches_only_that_it_was_not_right() -> None:
    labels = torch.tensor([WRONG_SOMEHOW])
    sure_right, sure_wrong = torch.zeros(1, len(CLASSES)), torch.zeros(1, len(CLASSES))
    sure_right[0, 0], sure_wrong[0, 0] = 9.0, -9.0
    assert loss_of(sure_right, labels) > 5 and loss_of(sure_wrong, labels) < 0.01
    elsewhere = sure_wrong.clone()
    elsewhere[0, 5] = 3.0
    assert loss_of(elsewhere, labels) < 0.01


def test_a_file_that_holds_no_such_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=re.escape("nowhere.npz")):
        load_network(tmp_path / "nowhere.npz")
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(ConfigError, match="network that judges repetitions"):
        load_network(broken)
    np.savez(tmp_path / "other.npz", weights=np.zeros(3))
    with pytest.raises(ConfigError, match="network that judges repetitions"):
        load_network(tmp_path / "other.npz")


def test_a_network_comes_back_as_it_was_saved(tmp_path: Path) -> None:
    network = RepetitionNetwork()
    save_network(network, {"seed": 1}, tmp_path / "net.npz")
    found, about = load_network(tmp_path / "net.npz")
    assert about == {"seed": 1} and not found.training
    for name, value in network.state_dict().items():
        assert torch.equal(found.state_dict()[name], value)


@pytest.mark.slow
def test_examples_hold_right_repetitions_and_every_kind_of_error() -> None:
    examples, again = examples_of(0, "joints", 1), examples_of(0, "joints", 1)
    assert np.array_equal(examples.sequences, again.sequences)
    assert set(examples.labels.tolist()) == {WRONG_SOMEHOW, *range(len(CLASSES))}
    assert (examples.labels == CLASSES.index("right")).sum() >= 30
    assert np.isfinite(examples.sequences).all() and np.isfinite(examples.facts).all()


@pytest.mark.slow
@pytest.mark.parametrize("recogniser", ["rules", "learned"])
def test_headset_and_hands_of_people_never_seen_are_recognised(recogniser: str) -> None:
    found = evaluate_coach(source="hands", users=6, seed=77, recogniser=recogniser, processes=2)
    assert found.right_recognised > 0.97 and found.wrong_detected > 0.98
    assert found.latency()["p95_s"] < 0.5


@pytest.mark.slow
def test_the_bands_of_people_never_seen_are_recognised_by_camera() -> None:
    found = evaluate_coach(source="camera", users=2, seed=77, processes=2)
    assert found.right_recognised > 0.9 and found.wrong_detected > 0.95
