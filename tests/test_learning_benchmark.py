"""`bench learning`: its figures are there and hang together."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

pytest.importorskip("torchrl")

from rcare_marl.baselines.training import throughput
from rcare_marl.cli import app
from rcare_marl.errors import ConfigError, UnknownNameError


@pytest.mark.parametrize("text", ["", "1,,2", "two", "1.5"])
def test_counts_of_processes_are_whole_numbers(text: str) -> None:
    with pytest.raises(ConfigError, match="processes is a list such as 1,4,16"):
        throughput.process_counts(text)


def test_impossible_numbers_are_refused() -> None:
    for processes, seconds, envs in (([], 1.0, 1), ([0], 1.0, 1), ([1], 0.0, 1), ([1], 1.0, 0)):
        with pytest.raises(ConfigError, match="must be positive"):
            throughput.measure("toileting", processes=processes, seconds=seconds, envs=envs)


def test_a_misspelt_task_is_told() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'feeding'"):
        throughput.bench("feedng")


def test_turns_are_taken_in_turn_and_without_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    order = []

    def source(name: str, steps: int) -> throughput.Source:
        def step() -> int:
            order.append(name)
            return steps

        return step

    monkeypatch.setattr(throughput, "TURN", 0.0)
    time = iter(range(1000))
    one, two = throughput._take_turns(
        [source("a", 3), source("b", 5)], 0.0, clock=lambda: float(next(time))
    )
    assert order == ["a", "b"] * (1 + throughput.LEAST_TURNS)
    assert [steps for steps, _ in one] == [3] * throughput.LEAST_TURNS
    assert [steps for steps, _ in two] == [5] * throughput.LEAST_TURNS
    assert {spent for _, spent in one + two} == {2.0}  # begin, the check, the end


def test_the_command_passes_on_what_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(throughput, "measure", lambda task, **options: {"task": task, **options})
    asked = ("--task", "toileting", "--processes", "1,4", "--seconds", "2", "--json")
    done = CliRunner().invoke(app, ["bench", "learning", *asked])
    told = json.loads(done.stdout)
    assert told.pop("versions")["torchrl"]
    assert told == {"task": "toileting", "processes": [1, 4], "seconds": 2.0}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("learnng",), "Did you mean 'learning'?"),
        (("learning", "--steps", "5"), "bench learning does not take it"),
        (("feeding", "--processes", "2"), "bench feeding does not take it"),
        (("learning", "--processes", "two"), "processes is a list such as 1,4,16"),
    ],
)
def test_the_command_says_what_it_does_not_take(arguments: tuple[str, ...], said: str) -> None:
    done = CliRunner().invoke(app, ["bench", *arguments])
    assert done.exit_code == 2
    assert said in " ".join(done.output.split())


@pytest.mark.slow
def test_one_object_holds_all_figures() -> None:
    result = throughput.measure("toileting", processes=[2], seconds=0.5, envs=2)
    rates = ("raw_steps_per_s", "collector_steps_per_s", "updates_per_s", "training_steps_per_s")
    assert all(result[name] > 0 for name in rates)
    ratio = result["collector_steps_per_s"] / result["raw_steps_per_s"]
    assert result["collector_ratio"] == pytest.approx(ratio)
    for kind in ("processes", "in_step"):
        one, two = result[kind]
        assert (one["processes"], two["processes"]) == (1, 2)
        assert one["efficiency"] == 1
        assert two["efficiency"] == pytest.approx(two["steps_per_s"] / one["steps_per_s"] / 2)
    assert 0 < result["learner_share"] < 1
    # What is learned in a second, and what is needed for a step, must fit the steps of a training.
    needed = result["training_steps_per_s"] * result["update_to_data"]
    assert result["updates_per_s"] * result["learner_share"] == pytest.approx(needed, rel=0.1)
    assert result["met"] == {"collector_ratio": ratio >= result["wanted"]["collector_ratio"]}
    assert len(throughput.lines(result)) == 10
