"""The command `rcare-marl`: what it prints, what it leaves, and how it fails."""

from __future__ import annotations

import gc
import itertools
import json
from functools import partial
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import pybullet as bullet
import pytest
from typer.testing import CliRunner

import rcare_marl
from rcare_marl.atomic_file import draft, write_whole
from rcare_marl.baselines.benchmark import choice, task_suite
from rcare_marl.baselines.benchmark import environment as benchmark
from rcare_marl.baselines.evaluation.episode_figure import Recorder
from rcare_marl.cli import app, demonstration
from rcare_marl.envs import task_names
from rcare_marl.rendering.film import Film

COMMANDS = ("list", "describe", "evaluate", "replay", "demo", "play", "teleoperate", "bench")
FILES = {"feeding.json", "feeding.mp4", "feeding.png"}


def call(*arguments: str, code: int = 0) -> Any:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == code, result.output
    return result


def answer(*arguments: str) -> Any:
    return json.loads(call(*arguments, "--json").stdout)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_each_command_shows_an_example(command: str) -> None:
    assert f"Example: rcare-marl {command}" in call(command, "--help").stdout


def test_help_names_every_command() -> None:
    text = call("--help").stdout
    assert all(command in text for command in COMMANDS)


def test_version_is_printed() -> None:
    assert call("--version").stdout.strip() == rcare_marl.__version__


def test_list_shows_all_kinds() -> None:
    text = call("list").stdout
    for name in ("feeding", "kinova_gen3", "karan", "wheelchair", "cooperative"):
        assert name in text


def test_list_knows_random_for_every_role() -> None:
    rows = answer("list", "policies")
    roles = {row["role"] for row in rows}
    assert {row["role"] for row in rows if row["name"] == "random"} == roles
    assert {"robot", "recipient", "caregiver"} <= roles


def test_describe_tells_parts_pictures_and_what_was_loaded() -> None:
    cast = "{model: pr2, moves: [right_arm, base], sensors: [{kind: camera, outputs: [depth]}]}"
    robot = answer("describe", "feeding", "--robot", cast)["roles"]["robot"]
    assert robot["facts"]["moves"] == "right_arm, base"
    assert "pr2" in robot["facts"]["physics"]
    assert robot["facts"]["visuals"]
    assert robot["arrays"] == [{"name": "camera_depth", "shape": [48, 64], "unit": "m"}]
    assert any(action["name"].startswith("base left") for action in robot["actions"])


def test_describe_tells_actions_observations_and_constants() -> None:
    facts = answer("describe", "feeding", "--recipient", "jose")
    robot, recipient = facts["roles"]["robot"], facts["roles"]["recipient"]
    assert recipient["facts"]["avatar"] == "Jose"
    env = rcare_marl.make("feeding", recipient="jose")
    for role, part in (("robot", robot), ("recipient", recipient)):
        assert len(part["actions"]) == env.action_space(role).shape[0]
        stops = [row["slice"][1] for row in part["observations"]]
        starts = [row["slice"][0] for row in part["observations"]]
        assert [0, *stops] == [*starts, *(env.observation_space(role).shape or ())]
    env.close()
    assert all(option["about"] for option in facts["options"])
    radius = next(row for row in facts["constants"] if row["name"] == "LOST_DISTANCE")
    assert radius["about"].startswith("[m]")
    assert facts["unplayed_roles"] == ["caregiver"]


def test_describe_prints_tables() -> None:
    text = call("describe", "feeding").stdout
    for word in ("tool_position", "jaw_opening", "LOST_DISTANCE", "force_limit", "eaten"):
        assert word in text


def test_evaluate_prints_one_json_object_with_all_keys() -> None:
    result = answer("evaluate", "feeding", "--policy", "random", "--episodes", "1", "--seed", "4")
    assert result["episodes"] == 1 and result["seed"] == 4 and result["success_rate"] == 0.0
    assert result.keys() >= {
        "peak_force_n",
        "peak_force_n_mean",
        "peak_force_n_max",
        "spilled",
        "time_to_mouth_s_mean",
        "mean_return",
        "steps",
        "policy",
        "policies",
        "versions",
        "success_interval_95",
    }


def test_evaluate_takes_role_policies_and_options_and_writes_a_file(tmp_path: Path) -> None:
    file = tmp_path / "new" / "result.json"
    result = answer(
        "evaluate",
        "feeding",
        "--policy",
        "still",
        "--role-policy",
        "recipient=still",
        "--option",
        "reward=shaped",
        "--option",
        "force_limit=15",
        "--recipient",
        "jose",
        "--episodes",
        "1",
        "--output",
        str(file),
    )
    written = json.loads(file.read_text())
    (policy,) = written["policies"]
    assert policy["policy"] == "still" and policy["roles"] == result["policies"]
    assert policy["episodes"]["steps"] == [result["steps"]]
    assert result["policies"] == {"robot": "still", "recipient": "still"}
    assert result["options"] == {"reward": "shaped", "force_limit": 15}
    assert result["cast"]["recipient"] == "Jose"
    assert [path.name for path in file.parent.iterdir()] == ["result.json"]


@pytest.mark.slow
def test_evaluate_takes_a_place_and_records_it() -> None:
    place = {"home": "house_03", "level": 2, "room": "living_1"}
    given = [text for name, value in place.items() for text in (f"--{name}", str(value))]
    result = answer("evaluate", "feeding", "--policy", "still", "--episodes", "1", *given)
    assert result["place"] == place


def test_evaluate_prints_a_table() -> None:
    text = call("evaluate", "feeding", "--episodes", "1").stdout
    assert "95 % interval" in text and "1 of 1, 100.0 %" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("evaluate", "feedng"), "Did you mean 'feeding'?"),
        (("describe", "feedng"), "Did you mean 'feeding'?"),
        (("bench", "feedng"), "Did you mean 'feeding'?"),
        (("bench", "avatrs"), "Did you mean 'avatars'?"),
        (("bench", "avatars", "--avatar", "karn"), "Did you mean 'karan'?"),
        (("bench", "homes", "--home", "house_77"), "Did you mean 'house_07'?"),
        (("play", "feedng"), "Did you mean 'feeding'?"),
        (("evaluate", "feeding", "--home", "huose_07"), "Did you mean 'house_07'?"),
        (("evaluate", "feeding", "--policy", "scriptd"), "Did you mean 'scripted'?"),
        (("evaluate", "feeding", "--recipient", "karn"), "Did you mean 'karan'?"),
        (("evaluate", "feeding", "--role-policy", "robt=still"), "Did you mean 'robot'?"),
        (("evaluate", "feeding", "--option", "rewrd=paper"), "Did you mean 'reward'?"),
    ],
)
def test_mistake_is_one_line_with_a_suggestion(arguments: tuple[str, ...], message: str) -> None:
    result = call(*arguments, code=2)
    assert result.stdout == ""
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1
    assert message in result.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("list", "robot"),
        ("evaluate", "feeding", "--episodes", "0"),
        ("evaluate", "feeding", "--seed", "-1"),
        ("bench", "avatars", "--steps", "5"),
        ("bench", "planning", "--steps", "5"),
        ("bench", "homes", "--queries", "5"),
        ("bench", "avatars", "--recipient", "jose"),
        ("bench", "avatars", "--home", "house_07"),
        ("bench", "homes", "--room", "kitchen_1"),
        ("evaluate", "feeding", "--home", "house_07", "--level", "4"),
        ("bench", "avatars", "--seconds", "0"),
        ("bench", "feeding", "--avatar", "jose"),
        ("evaluate", "feeding", "--option", "reward"),
    ],
)
def test_impossible_value_is_refused(arguments: tuple[str, ...]) -> None:
    call(*arguments, code=2)


def test_debug_lets_the_error_through() -> None:
    result = CliRunner().invoke(app, ["--debug", "describe", "feedng"])
    assert isinstance(result.exception, rcare_marl.errors.UnknownNameError)


@pytest.mark.slow
def test_demo_leaves_three_whole_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rcare_marl.rendering.film.SIZE", (320, 240))
    monkeypatch.setitem(demonstration.MEAL, "options", {"bites": 1})
    monkeypatch.setattr(demonstration, "PICTURES", 10)
    folder = tmp_path / "runs" / "one"
    text = call("demo", "--episodes", "1", "--seed", "2", "--output", str(folder)).stdout
    assert {file.name for file in folder.iterdir()} == FILES
    assert [path.name for path in folder.parent.iterdir()] == ["one"]
    assert all(name in text for name in FILES)
    record = json.loads((folder / "feeding.json").read_text())
    steps = record["episodes"][0]["steps"]
    series = record["episodes"][0]["series"]
    assert len(series["time_s"]) == len(series["motor_torque_nm"]["robot"]) == steps + 1
    assert record["summary"]["success_rate"] == 1.0 and "versions" in record["summary"]
    film = iio.imread(folder / "feeding.mp4", plugin="FFMPEG")
    assert film.shape[1:] == (240, 320, 3)
    assert 20 + 10 < film.shape[0] < 100 + 10  # of some seconds, and one second of the last
    assert film.std() > 10
    assert iio.imread(folder / "feeding.png").shape[0] > 1000


@pytest.mark.slow
def test_demos_are_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        call("demo", "--episodes", "1", "--no-video")
    assert sorted(path.name for path in Path("runs").iterdir()) == ["demo-1", "demo-2"]
    assert {file.name for file in Path("runs/demo-2").iterdir()} == FILES - {"feeding.mp4"}


@pytest.mark.slow
@pytest.mark.parametrize("video", ["--video", "--no-video"])
def test_interrupted_demo_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, video: str
) -> None:
    monkeypatch.setattr("rcare_marl.rendering.film.SIZE", (320, 240))
    monkeypatch.chdir(tmp_path)
    place: Any = Film if video == "--video" else Recorder
    name, calls = "add" if place is Film else "__call__", itertools.count()
    whole = getattr(place, name)

    def interrupted(*args: Any, **options: Any) -> Any:
        if next(calls) == 3:
            raise KeyboardInterrupt
        return whole(*args, **options)

    monkeypatch.setattr(place, name, interrupted)
    result = call("demo", "--episodes", "2", video, code=130)
    assert ("Feeding: " in result.stdout) is (video == "--video")  # told before it is filmed
    assert result.stderr.endswith("interrupted\n")
    assert list(tmp_path.iterdir()) == []


def test_demo_does_not_overwrite_a_file(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")
    result = call("demo", "--episodes", "1", "--output", str(tmp_path / "taken"), code=2)
    assert "there is a file of that name" in result.stderr
    assert (tmp_path / "taken").read_text() == "mine"


def test_draft_replaces_files_of_the_same_name_only(tmp_path: Path) -> None:
    target = tmp_path / "folder"
    target.mkdir()
    (target / "old").write_text("old")
    (target / "both").write_text("old")
    with draft(target) as folder:
        (folder.path / "both").write_text("new")
        folder.publish()
    assert {file.name: file.read_text() for file in target.iterdir()} == {
        "old": "old",
        "both": "new",
    }
    assert list(tmp_path.iterdir()) == [target]


def test_file_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(rcare_marl.errors.ConfigError, match="cannot write"):
        write_whole(tmp_path / "file" / "below", b"")


def test_bench_prints_one_json_object_with_all_keys() -> None:
    result = answer("bench", "feeding", "--steps", "4")
    keys = (
        "env_steps_per_s",
        "physics_steps_per_s",
        "real_time_factor",
        "reset_ms",
        "import_s",
        "overhead_ratio",
    )
    assert all(result[key] > 0 for key in keys)
    assert result["steps"] == 4 and result["physics_steps_per_control_step"] == 24


def test_bench_tells_what_is_wanted_and_what_is_met(monkeypatch: pytest.MonkeyPatch) -> None:
    start_once(monkeypatch)
    result = answer("bench", "toileting", "--level", "2", "--steps", "4")
    assert result["task"] == "toileting" and result["level"] == 2
    for key, bound in result["wanted"].items():
        more_is_better = key == "real_time_factor"
        assert result["met"][key] is (
            result[key] >= bound if more_is_better else result[key] <= bound
        )


def test_bare_physics_of_a_bench_repeats_what_the_environment_did() -> None:
    env = rcare_marl.make("feeding")
    env.reset(seed=3)
    client, tape = env.world.client, list[benchmark.Entry]()
    moving = [(body, [j.index for j in body.joints.values()]) for body in env.world.bodies]

    def state() -> list[Any]:
        return [(b.base_pose(), b.joint_states(indices)) for b, indices in moving]

    before = bullet.saveState(physicsClientId=client)
    with benchmark.recorded(tape):
        for _ in range(3):
            env.step({r: 0.3 * env.action_space(r).high for r in env.agents})
    after = state()
    bullet.restoreState(before, physicsClientId=client)
    assert state() != after
    assert benchmark.play(tape, client) > 0
    assert state() == after
    assert tape.count(None) == 72
    env.close()


def test_bench_all_measures_each_task_at_each_level_of_its_own() -> None:
    scenes = task_suite.scenes()
    assert {name for name, _ in scenes} == set(task_names())
    assert [level for name, level in scenes if name == "ambulating"] == [1, 2, 3]
    assert [level for name, level in scenes if name == "feeding"] == [None]


def fewer_scenes(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    monkeypatch.setattr(task_suite, "scenes", lambda: [(name, None) for name in names])
    start_once(monkeypatch)


def start_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the time to import be measured in one process."""
    monkeypatch.setattr(benchmark, "import_time", partial(benchmark.import_time, 1))


def test_bench_all_prints_one_json_object_with_all_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    fewer_scenes(monkeypatch, "toileting", "feeding")
    result = answer("bench", "all", "--steps", "2")
    assert [row["task"] for row in result["tasks"]] == ["toileting", "feeding"]
    for row in result["tasks"]:
        assert min(row[k] for k in ("real_time_factor", "overhead_ratio", "reset_ms")) > 0
    assert result["complete"] is True and result["import_s"] > 0


def test_bench_all_prints_a_table(monkeypatch: pytest.MonkeyPatch) -> None:
    fewer_scenes(monkeypatch, "toileting")
    text = call("bench", "all", "--steps", "2").stdout
    assert "toileting" in text and "≥ 30" in text and "≤ 1.25" in text


def test_bench_all_goes_on_after_a_task_that_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    fewer_scenes(monkeypatch, "no_such_task", "toileting")
    result = json.loads(call("bench", "all", "--steps", "2", "--json", code=1).stdout)
    assert "no_such_task" in result["tasks"][0]["error"]
    assert result["tasks"][1]["real_time_factor"] > 0 and result["complete"] is False


def test_bench_all_that_is_interrupted_keeps_what_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    fewer_scenes(monkeypatch, "toileting", "feeding")
    measured = benchmark.bench

    def stop_at_second(task: str, *rest: Any) -> Any:
        if task == "feeding":
            raise KeyboardInterrupt
        return measured(task, *rest)

    monkeypatch.setattr(benchmark, "bench", stop_at_second)
    result = json.loads(call("bench", "all", "--steps", "2", "--json", code=130).stdout)
    assert [row["task"] for row in result["tasks"]] == ["toileting"] and result["interrupted"]


def test_bench_refuses_what_does_not_belong_to_it() -> None:
    assert "--robot" in call("bench", "all", "--robot", "ur5", code=2).stderr
    assert "--seconds" in call("bench", "feeding", "--seconds", "2", code=2).stderr
    assert "Did you mean 'feeding'" in call("bench", "feding", code=2).stderr


@pytest.mark.slow
def test_bench_of_avatars_prints_one_json_object_with_all_keys_or_a_table(
    capsys: pytest.CaptureFixture[str],
) -> None:
    result = answer("bench", "avatars", "--seconds", "0.2")
    keys = (
        "bare_physics_fps",
        "skeletal_fps",
        "muscle_fps",
        "tissue_fps",
        "tissue_idle_fps",
        "muscle_kernel_us",
        "batched_person_steps_per_s",
    )
    assert all(result[key] > 0 for key in keys)
    assert result["avatar"] == "Karan" and result["muscles"] == 324
    assert result["tissue_particles"] >= 1000 and result["tissue_force_n"] > 0
    for ratio, above, below in (
        ("skeletal_ratio", "skeletal_fps", "bare_physics_fps"),
        ("muscle_ratio", "muscle_fps", "bare_physics_fps"),
        ("tissue_idle_ratio", "tissue_idle_fps", "skeletal_fps"),
    ):
        assert result[ratio] == pytest.approx(result[above] / result[below])
    assert result["met"].keys() == result["wanted"].keys()
    for key, bound in result["wanted"].items():
        reached = result[key] <= bound if key.endswith("_us") else result[key] >= bound
        assert result["met"][key] is reached
    choice.show("avatars", result)
    text = capsys.readouterr().out
    for words in ("Karan", "at least 1500", "at most 60 ", "person-steps/s"):
        assert words in text


@pytest.mark.slow
def test_bench_of_homes_measures_loading_and_a_step_in_each_kind_of_room() -> None:
    result = answer("bench", "homes", "--home", "house_03", "--steps", "8")
    assert result["load_first_s"] > 0 and result["load_again_s"] > 0
    assert {room.split("_")[0] for room in result["step_ratios"]} >= {"kitchen", "living"}
    assert all(ratio > 0 for ratio in result["step_ratios"].values())
    for key, bound in result["wanted"].items():
        worst = max(result[key].values()) if isinstance(result[key], dict) else result[key]
        assert result["met"][key] is (worst <= bound)


def test_play_tells_where_to_watch_and_stops_calmly(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("aiohttp")
    served: list[Any] = []

    async def interrupt(server: Any, name: str, *_: Any, **__: Any) -> None:
        served.append((name, server))
        raise KeyboardInterrupt

    monkeypatch.setattr("rcare_marl.cli.teleoperation.serve_page", interrupt)
    monkeypatch.setattr(
        "rcare_marl.baselines.coaching.page.packages.packages_folder", lambda: Path("packages")
    )
    lines = call("play", "feeding", "--port", "0", "--no-open").stderr.splitlines()
    assert lines == ["stopped"] and served[0][0] == "feeding"
    # Its task, whose exception nobody fetches, ends here and not while another test parses: CPython 3.11 does
    # not bear that, see tests/test_structure.py.
    gc.collect()
