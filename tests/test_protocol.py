"""Evaluations of several policies: the same seeds for each, and records that can be repeated."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import multiprocessing
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image
from typer.testing import CliRunner

import rcare_marl
from rcare_marl.baselines import trained
from rcare_marl.baselines.evaluation import protocol
from rcare_marl.baselines.evaluation.episode_figure import draw_record, labels
from rcare_marl.baselines.evaluation.evaluate import Episode, Evaluation, evaluate
from rcare_marl.baselines.evaluation.protocol import (
    Plan,
    Record,
    assess,
    columns,
    find_policies,
    read_record,
    record_text,
    repeat,
)
from rcare_marl.baselines.evaluation.statistic import hierarchical_interval
from rcare_marl.baselines.policy_file import PolicyFile
from rcare_marl.cli import app
from rcare_marl.console import markdown_table
from rcare_marl.errors import ConfigError, UnknownNameError

ROOT = Path(__file__).resolve().parents[1]
SEED = 3


def save_network(path: Path) -> None:
    """Write a residual that changes the scripted feeding a little."""
    env = rcare_marl.make("feeding")
    observed = [(name, part.stop - part.start) for part, name, _ in env.describe("robot")]
    observed.append(("scripted_action", 6))
    size = sum(count for _, count in observed)
    weights = np.random.default_rng(0).normal(0, 0.05, (6, size)).astype(np.float32)
    PolicyFile(
        "feeding",
        "robots",
        ("robot",),
        tuple(observed),
        6,
        -1.0,
        ((weights, np.zeros(6, np.float32)),),
        np.zeros(size, np.float32),
        np.ones(size, np.float32),
        residual=0.1,
        training={"algorithm": "none", "seed": 0},
    ).save(path)
    env.close()


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "policy.npz"
    save_network(path)
    return path


@pytest.fixture(scope="module", autouse=True)
def short() -> Iterator[None]:
    """Let each episode be a piece of its own, so that there is something to share out."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(protocol, "CHUNK", 1)
        yield


@pytest.fixture(scope="module")
def record(file: Path, short: None) -> Record:
    return assess(Plan("feeding", ("scripted", str(file)), episodes=2, seed=SEED))


@pytest.fixture
def data(record: Record, tmp_path: Path) -> dict[str, Any]:
    (tmp_path / "record.json").write_text(record_text(record.to_dict()))
    return read_record(tmp_path / "record.json")


def made_up(successes: list[list[bool]]) -> Record:
    """Return a record of episodes that nobody played."""
    runs = tuple(
        Evaluation(
            "feeding",
            {"robot": f"seed{k}"},
            {"robot": "kinova_gen3"},
            {},
            0,
            tuple(
                Episode(
                    seed=i,
                    success=good,
                    steps=10 * (k + 1),
                    duration=float(k + 1),
                    returns={"robot": 100.0 * good + k},
                    metrics={"peak_force_n": 1.0 * i, "time_to_mouth_s": 2.0 if good else -1.0},
                    costs={"robot": 0.5},
                )
                for i, good in enumerate(run)
            ),
        )
        for k, run in enumerate(successes)
    )
    names = tuple(f"seed{k}" for k in range(len(runs)))
    return Record(Plan("feeding", names, episodes=len(successes[0])), runs)


def test_success_without_exception_is_no_certainty() -> None:
    low, high = made_up([[True] * 10, [True] * 10]).summary()["success"]["interval_95"]
    assert low == pytest.approx(0.8389, abs=1e-4) and high == 1.0  # Wilson's, 20 of 20
    low, high = made_up([[False] * 10]).summary()["success"]["interval_95"]
    assert low == 0.0 and high == pytest.approx(0.2775, abs=1e-4)


@pytest.mark.slow
def test_every_policy_meets_the_same_seeds(record: Record) -> None:
    for run in record.runs:
        assert [episode.seed for episode in run.episodes] == [SEED, SEED + 1]


def test_a_policy_does_as_when_it_is_evaluated_alone(record: Record, file: Path) -> None:
    alone = evaluate("feeding", {"robot": str(file)}, episodes=1, seed=SEED)
    assert record.runs[1].episodes[0] == alone.episodes[0]
    assert record.runs[0].episodes != alone.episodes
    assert record.runs[1].policies == {"robot": str(file), "recipient": "cooperative"}


@pytest.mark.slow
def test_numbers_are_the_same_however_many_processes_there_are(record: Record) -> None:
    heard: list[int] = []
    again = assess(record.plan, processes=2, on_progress=heard.append)
    assert record_text(again.to_dict()) == record_text(record.to_dict())
    assert heard == [1, 1, 1, 1]
    assert multiprocessing.active_children() == []


@pytest.mark.slow
def test_an_error_in_a_process_is_told_as_it_is_and_leaves_none_behind() -> None:
    plan = Plan("feeding", ("scripted", "random"), cast={"robot": {"control": "joint_delta"}})
    with pytest.raises(ConfigError, match="tool_delta"):
        assess(plan, processes=2)
    assert multiprocessing.active_children() == []


def test_the_record_says_what_it_takes_to_repeat_it(
    record: Record, data: dict[str, Any], file: Path
) -> None:
    assert data["plan"] == {
        "task": "feeding",
        "policies": ["scripted", str(file)],
        "others": {},
        "episodes": 2,
        "seed": SEED,
        "options": {},
        "cast": {},
    }
    script, network = data["policies"]
    assert script["file"] is None
    assert network["file"]["sha256"] == protocol.digest(file)
    assert network["file"]["training"] == {"algorithm": "none", "seed": 0}
    assert network["file"]["residual"] == 0.1
    assert network["models"] == {"robot": "kinova_gen3", "recipient": "Karan"}
    assert {"rcare_marl", "pybullet", "numpy", "python"} <= data["versions"].keys()
    assert {"processor", "cores", "system"} <= data["machine"].keys()
    assert network["episodes"]["seed"] == [SEED, SEED + 1]
    assert network["episodes"]["returns"]["robot"] == [
        episode.returns["robot"] for episode in record.runs[1].episodes
    ]


def test_the_summary_is_over_runs() -> None:
    numbers = made_up([[True] * 8 + [False] * 2, [True] * 10, [False] * 10]).summary()
    success = numbers["success"]
    assert success["runs"] == [0.8, 1.0, 0.0]
    assert success["mean"] == pytest.approx(0.6)
    wanted = hierarchical_interval([[1] * 8 + [0] * 2, [1] * 10, [0] * 10])
    assert success["interval_95"] == pytest.approx(list(wanted))
    assert numbers["return_robot"]["mean"] == pytest.approx((80 + 101 + 2) / 3)
    assert numbers["steps"]["max"] == 30
    assert numbers["peak_force_n"]["max"] == 9


def test_the_interquartile_mean_leaves_out_the_best_and_the_worst_of_five_runs() -> None:
    shares = [0, 6, 7, 8, 10]
    success = made_up([[k < n for k in range(10)] for n in shares]).summary()["success"]
    assert success["iqm"] == pytest.approx(0.7)
    assert success["mean"] == pytest.approx(0.62)
    low, high = success["iqm_interval_95"]
    assert 0 < low < 0.7 < high <= 1


def test_an_event_that_never_came_has_no_mean() -> None:
    numbers = made_up([[False, False], [True, False]]).summary()
    assert numbers["time_to_mouth_s"]["runs"] == [2.0]
    assert "time_to_mouth_s" not in made_up([[False, False]]).summary()


def test_one_policy_has_no_interval_over_runs(data: dict[str, Any]) -> None:
    success = made_up([[True, False, True]]).summary()["success"]
    assert success["iqm_interval_95"] is None
    low, high = success["interval_95"]
    assert low < success["mean"] < high


def test_only_seeds_of_one_training_are_pooled() -> None:
    bare = made_up([[True], [False]])
    assert not bare.is_one_training and made_up([[True]]).is_one_training
    facts = {"algorithm": "sac", "reward": "shaped", "residual": False, "demonstrations": 3}
    files = {name: {"training": facts | {"seed": k}} for k, name in enumerate(bare.plan.policies)}
    assert dataclasses.replace(bare, files=files).is_one_training
    files["seed1"] = {"training": facts | {"algorithm": "tqc"}}
    mixed = dataclasses.replace(bare, files=files)
    assert not mixed.is_one_training and mixed.other_rewards() == dict.fromkeys(
        ("seed0", "seed1"), "shaped"
    )
    plan = dataclasses.replace(bare.plan, options={"reward": "shaped"})
    assert dataclasses.replace(mixed, plan=plan).other_rewards() == {}


def test_the_text_of_a_record_is_short_and_true(record: Record) -> None:
    text = record_text(record.to_dict())
    assert json.loads(text) == record.to_dict()
    long = json.dumps(record.to_dict(), indent=1)
    assert text.count("\n") < 0.6 * long.count("\n")
    assert f'"seed": [{SEED}, {SEED + 1}]' in text


def test_a_record_that_is_repeated_gives_the_same_numbers(data: dict[str, Any]) -> None:
    result = repeat(data)
    assert result.episodes == 4 and not result.differences and not result.missing
    assert result.elsewhere == ()


def test_a_number_that_differs_is_named(
    data: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(protocol, "run", lambda *_, **__: made_up([[True, True]] * 2).runs)
    runs = made_up([[True, True]] * 2).runs
    for entry, run in zip(data["policies"], runs, strict=True):
        entry["episodes"] = columns(run.episodes)
    assert repeat(data).differences == ()
    data["policies"][1]["episodes"]["returns"]["robot"][1] += 1e-9
    data["policies"][0]["episodes"]["success"][0] = False
    del data["policies"][0]["episodes"]["metrics"]["peak_force_n"]
    data["versions"]["numpy"] = "1.0"
    result = repeat(data)
    assert len(result.differences) == 3
    assert result.differences[0] == (
        "scripted: success of episode 0 is True, was False; 1 of 2 differ"
    )
    assert any("peak_force_n is in one of them only" in text for text in result.differences)
    assert any("robot of episode 1" in text for text in result.differences)
    assert any(text.startswith("numpy is ") and "was 1.0" in text for text in result.elsewhere)


def test_a_file_that_moved_is_found_among_those_that_ship(
    data: dict[str, Any], file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shipped").mkdir()
    (tmp_path / "shipped" / "feeding.npz").write_bytes(file.read_bytes())
    monkeypatch.setattr(trained, "FOLDER", tmp_path / "shipped")
    data["policies"][1]["policy"] = data["plan"]["policies"][1] = "runs/gone/policy.npz"
    result = repeat(data)
    assert result.repeated == ("scripted", "runs/gone/policy.npz") and not result.differences


def test_files_that_are_gone_or_changed_are_told(
    data: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(protocol, "run", lambda *_, **__: ())
    (tmp_path / "other.npz").write_bytes(b"other")
    network = data["policies"][1]
    for name, why in (("gone.npz", "is not here"), ("other.npz", "is another file than it was")):
        data["policies"] = [{**network, "policy": str(tmp_path / name)}]
        with pytest.raises(ConfigError, match=why):
            repeat(data)


def test_patterns_stand_for_files_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (10, 2, 1):
        (tmp_path / f"seed{number}").mkdir()
        (tmp_path / f"seed{number}" / "policy.npz").write_bytes(b"")
    found = find_policies(["scripted", str(tmp_path / "seed*" / "policy.npz")])
    assert found[0] == "scripted"
    assert [Path(name).parent.name for name in found[1:]] == ["seed1", "seed2", "seed10"]
    with pytest.raises(ConfigError, match="no file of a policy matches"):
        find_policies([str(tmp_path / "sed*.npz")])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"policies": ()}, "needs a policy"),
        ({"policies": ("scripted", "still", "scripted")}, "twice: scripted"),
        ({"episodes": 0}, "at least 1"),
        ({"seed": -1}, "at least 0"),
        ({"task": "feedng"}, "Did you mean 'feeding'"),
    ],
)
def test_plans_that_make_no_sense_are_refused(changes: dict[str, Any], message: str) -> None:
    fields: dict[str, Any] = {"task": "feeding", "policies": ("scripted",), **changes}
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        Plan(**fields)


def test_what_is_no_record_is_refused(tmp_path: Path, data: dict[str, Any]) -> None:
    path = tmp_path / "a.json"
    for text, message in (
        ("{", "no file of a record"),
        ("[1]", "holds no file of a record"),
        (json.dumps({**data, "format": 9}), "format 9"),
    ):
        path.write_text(text)
        with pytest.raises(ConfigError, match=message):
            read_record(path)
    with pytest.raises(ConfigError, match="cannot read"):
        read_record(tmp_path / "nowhere.json")


def test_names_in_the_figure_leave_out_what_paths_share() -> None:
    paths = [f"runs/feeding/seed{k}/policy.npz" for k in range(3)]
    assert labels(paths) == ["seed0", "seed1", "seed2"]
    assert labels(["runs/a.npz", "runs/b.npz"]) == ["a", "b"]
    assert labels(["scripted", "runs/b.npz"]) == ["scripted", "runs/b"]
    assert len(labels(["x" * 200])[0]) == 34


def test_the_figure_is_a_picture_that_grows_with_the_policies(tmp_path: Path) -> None:
    heights = []
    for count in (1, 5):
        (tmp_path / "a.png").write_bytes(draw_record(made_up([[True, False, True]] * count)))
        picture = Image.open(tmp_path / "a.png")
        assert picture.width > 1000 and np.asarray(picture.convert("L")).std() > 5
        heights.append(picture.height)
    assert heights[1] > heights[0]


def test_the_command_leaves_a_record_that_it_can_repeat(tmp_path: Path, file: Path) -> None:
    out, plot = tmp_path / "new" / "record.json", tmp_path / "new" / "record.png"
    shown = CliRunner().invoke(
        app,
        [
            "evaluate",
            "feeding",
            "--policies",
            str(file.parent / "*.npz"),
            "--policies",
            "scripted",
            "--episodes",
            "1",
            "--json",
            "--out",
            str(out),
            "--plot",
            str(plot),
        ],
    )
    assert shown.exit_code == 0, shown.output
    printed, written = json.loads(shown.stdout), read_record(out)
    assert printed["summary"] == written["summary"]
    assert len(printed["policies"]) == 2 and "episodes" not in printed["policies"][0]
    assert {each.name for each in out.parent.iterdir()} == {"record.json", "record.png"}
    again = CliRunner().invoke(app, ["replay", str(out)])
    assert again.exit_code == 0 and "the same numbers in 2 episodes" in again.stdout
    written["policies"][0]["episodes"]["steps"][0] += 1
    out.write_text(json.dumps(written))
    again = CliRunner().invoke(app, ["replay", str(out)])
    assert again.exit_code == 1 and "1 columns of numbers" in again.stdout


def test_the_command_prints_tables_of_the_policies() -> None:
    shown = CliRunner().invoke(
        app, ["evaluate", "feeding", "--policies", "scripted", "--episodes", "1"]
    )
    for text in ("scripted", "100.0 %", "IQM", "peak_force_n", "return of robot", "of one policy"):
        assert text in shown.stdout


def experiment(name: str) -> ModuleType:
    """Return a script of experiments/ as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "experiments" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where dataclasses look for it
    spec.loader.exec_module(module)
    return module


def learned(data: dict[str, Any], *, script: bool = False) -> dict[str, Any]:
    """Return a record of the network alone, or of the script."""
    entry = data["policies"][0 if script else 1]
    numbers = {"mean": 1.0 if script else 0.5, "interval_95": [0.4, 0.6], "iqm": 0.5}
    summary = {**data["summary"], "success": numbers}
    return {**data, "policies": [entry], "summary": summary}


def test_the_paper_s_table_reads_records_and_says_where_there_is_none(
    data: dict[str, Any], tmp_path: Path
) -> None:
    paper = experiment("paper_table")
    row = paper.PAPER[0]
    assert paper.cells(row, tmp_path)[-1] == "no record yet"
    (tmp_path / "feeding.json").write_text(json.dumps(learned(data)))
    (tmp_path / "feeding_scripted.json").write_text(json.dumps(learned(data, script=True)))
    cells = dict(zip(paper.HEADS, paper.cells(row, tmp_path), strict=True))
    assert cells["paper"] == "SAC, 92 %" and cells["ours"] == "NONE"
    assert cells["learned"] == "residual of scale 0.1"
    assert cells["success (95 % interval)"] == "50.0 % (40.0 to 60.0)"
    assert cells["scripted"] == "100.0 %"
    for remark in ("below the paper", "the scripted policy is better", "1 policies x 2 episodes"):
        assert remark in cells["remark"]
    assert markdown_table(paper.HEADS, [list(cells.values())]).count("\n") == 2
    assert paper.ROWS[-1].paper == "no such task"


def test_the_paper_s_table_refuses_a_script_that_played_other_episodes(
    data: dict[str, Any], tmp_path: Path
) -> None:
    paper = experiment("paper_table")
    (tmp_path / "feeding.json").write_text(json.dumps(learned(data)))
    other = learned(data, script=True)
    other["plan"] = {**other["plan"], "seed": 50}
    (tmp_path / "feeding_scripted.json").write_text(json.dumps(other))
    with pytest.raises(ConfigError, match="other episodes: seed is 50"):
        paper.cells(paper.PAPER[0], tmp_path)


def test_a_card_tells_training_numbers_and_limits(
    data: dict[str, Any], file: Path, tmp_path: Path
) -> None:
    (tmp_path / "feeding.npz").write_bytes(file.read_bytes())
    (tmp_path / "feeding.json").write_text(json.dumps(data))
    cards = experiment("model_cards")
    (card,) = cards.cards(tmp_path)
    facts = yaml.safe_load(card.to_yaml())
    assert facts["sha256"] == protocol.digest(file)
    assert facts["network"]["learned"] == "residual of scale 0.1"
    assert facts["training"] == {"algorithm": "none", "seed": 0}
    assert facts["trained_on"]["default_cast"] == {"robot": "kinova_gen3", "recipient": "karan"}
    assert facts["evaluation"]["success"] == data["policies"][1]["success_rate"]
    assert any("must not move a robot near a person" in limit for limit in facts["limits"])
    text = cards.page(f"before\n{cards.BEGIN}\nold\n{cards.END}\nafter\n", [card])
    assert text.startswith("before\n") and text.endswith("after\n") and "old" not in text
    assert "## feeding" in text and "must not move a robot near a person" in text
    assert cards.NONE in cards.page(text, [])


def test_the_page_of_models_has_a_place_for_cards() -> None:
    cards = experiment("model_cards")
    assert "# Trained policies" in cards.page(cards.PAGE.read_text("utf-8"), [])
