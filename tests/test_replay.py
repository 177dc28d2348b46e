"""Recorded episodes: files that give the same episode again, and what is wrong with those that do not."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import rcare_marl
from rcare_marl.atomic_file import read_arrays, write_arrays
from rcare_marl.cli import app
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.episode import EpisodeRecorder, RecordedEpisode, replay
from rcare_marl.errors import ConfigError

STEPS = 5
POLICIES = {"robot": "random", "recipient": "cooperative"}
OPTIONS = {"reward": "shaped"}


def play(env: CareEnv, steps: int = STEPS, seed: int | None = 7) -> None:
    env.reset(seed=seed)
    for _ in range(steps):
        env.step({})


@pytest.fixture(scope="module")
def env() -> Iterator[CareEnv]:
    made = rcare_marl.make("feeding", options=OPTIONS, policies=POLICIES)
    yield made
    made.close()


@pytest.fixture(scope="module")
def episode(env: CareEnv) -> RecordedEpisode:
    recorder = EpisodeRecorder(env)
    play(env)
    return recorder.episode(POLICIES)


@pytest.fixture
def file(episode: RecordedEpisode, tmp_path: Path) -> Path:
    episode.save(tmp_path / "episode.npz")
    return tmp_path / "episode.npz"


def call(*words: str | Path) -> Any:
    return CliRunner().invoke(app, ["replay", *map(str, words)])


def test_a_file_gives_the_same_episode_to_the_bit(episode: RecordedEpisode, file: Path) -> None:
    read = RecordedEpisode.read(file)
    assert read.header == episode.header
    for role, rows in episode.actions.items():
        np.testing.assert_array_equal(read.actions[role], rows)
    found = replay(read)
    assert (found.steps, found.recorded, found.difference) == (STEPS, STEPS, "")
    assert found.elsewhere == ()


def test_the_same_episode_gives_the_same_bytes(episode: RecordedEpisode, file: Path) -> None:
    before = file.read_bytes()
    RecordedEpisode.read(file).save(file)
    assert file.read_bytes() == before


def test_another_action_is_found_in_its_step(episode: RecordedEpisode) -> None:
    rows = episode.actions["robot"].copy()
    rows[2] = np.nextafter(rows[2], 0.0)  # in the last bit
    other = dataclasses.replace(episode, actions={**episode.actions, "robot": rows})
    found = replay(other)
    assert found.steps == 2
    assert found.difference.startswith("step 3: body robot")


def test_another_seed_differs_from_the_reset_on(episode: RecordedEpisode) -> None:
    header = dataclasses.replace(episode.header, seed=8)
    found = replay(dataclasses.replace(episode, header=header))
    assert found.steps == 0 and found.difference.startswith("step 0: body")


def test_a_number_that_differs_is_told_with_both_values(episode: RecordedEpisode) -> None:
    numbers = episode.numbers.copy()
    place = episode.header.measures.index("distance_m")
    was = numbers[4, place]
    numbers[4, place] = 9.0
    found = replay(dataclasses.replace(episode, numbers=numbers))
    assert found.difference == f"step 4: distance_m is {was}, was 9.0"


def test_an_episode_without_seed_is_replayed_by_the_seed_that_it_drew(env: CareEnv) -> None:
    recorder = EpisodeRecorder(env)
    play(env, seed=11)
    play(env, seed=None)
    drawn = recorder.episode()
    assert drawn.header.seed not in (7, 11)
    assert replay(drawn).difference == ""
    play(env, seed=11)
    play(env, seed=None)
    assert recorder.episode().header.seed == drawn.header.seed


def test_a_stage_of_a_curriculum_is_kept(env: CareEnv) -> None:
    recorder = EpisodeRecorder(env)
    env.task.set_stage(spread=0.5, force=1.5)
    play(env, steps=2)
    eased = recorder.episode()
    env.task.set_stage()
    assert eased.header.eased is not None and eased.header.eased["spread"] == 0.5
    assert replay(eased).difference == ""


def test_policies_that_draw_leave_the_scene_as_it_is(env: CareEnv) -> None:
    """A random robot draws 12 times as much as one that holds still; the next start is the same."""
    other = rcare_marl.make("feeding", options=OPTIONS, policies={**POLICIES, "robot": "still"})
    states = []
    for each in (env, other):
        play(each)
        each.reset()
        states.append(each.state())
    other.close()
    np.testing.assert_array_equal(states[0], states[1])


def drawn_later(robot: str, monkeypatch: pytest.MonkeyPatch) -> float:
    """Return what a task draws that keeps its generator and uses it in the episode."""
    env = rcare_marl.make("feeding", policies={"robot": robot, "recipient": "still"})
    kept: list[np.random.Generator] = []
    begin = env.task.reset

    def watched(rng: np.random.Generator) -> None:
        kept.append(rng)
        begin(rng)

    monkeypatch.setattr(env.task, "reset", watched)
    play(env)
    env.close()
    return kept[0].random()


def test_a_task_that_draws_in_an_episode_meets_the_same_whoever_decides(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert drawn_later("random", monkeypatch) == drawn_later("still", monkeypatch)


def test_nothing_is_recorded_before_a_reset_or_of_a_hand_made_environment(env: CareEnv) -> None:
    with pytest.raises(ConfigError, match="nothing to record"):
        EpisodeRecorder(env).episode()


def test_a_cast_of_objects_is_refused_by_its_place(
    episode: RecordedEpisode, tmp_path: Path
) -> None:
    setup = {**episode.header.setup, "cast": {"robot": {"model": object()}}}
    header = dataclasses.replace(episode.header, setup=setup)
    with pytest.raises(
        ConfigError, match=r"cast\.robot\.model cannot be written to a file: object"
    ):
        dataclasses.replace(episode, header=header).save(tmp_path / "x.npz")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.95])
def test_a_truncated_file_is_refused(file: Path, share: float) -> None:
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ConfigError, match="is damaged, or no file of a recorded episode"):
        RecordedEpisode.read(file)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 99}, "version 99 of the format; this package reads 1"),
        ({"kind": "policy"}, "holds no recorded episode"),
        ({"seed": "seven"}, "expected int"),
        ({"sed": 7}, "Did you mean 'seed'"),
        ({"roles": ["a", "b", "c"]}, "is damaged, or no file of a recorded episode"),
        ({"parts": ["body robot"]}, "digests must have shape"),
    ],
)
def test_a_foreign_header_is_refused(file: Path, changes: dict[str, Any], message: str) -> None:
    about, arrays = read_arrays(file, "it", 1)
    write_arrays(file, {**about, "version": 1, **changes}, arrays)
    with pytest.raises(ConfigError, match=message):
        RecordedEpisode.read(file)


def test_arrays_of_other_shapes_or_numbers_are_refused(file: Path) -> None:
    about, arrays = read_arrays(file, "it", 1)
    for name, value, message in (
        ("actions_0", arrays["actions_0"][1:], "must be 5 rows of finite numbers"),
        ("actions_0", np.full_like(arrays["actions_0"], np.nan), "must be 5 rows of finite"),
        ("digests", arrays["digests"].astype(float), "whole numbers of 64 bits"),
    ):
        write_arrays(file, {**about, "version": 1}, {**arrays, name: value})
        with pytest.raises(ConfigError, match=message):
            RecordedEpisode.read(file)


@pytest.mark.parametrize(
    ("setup", "message"),
    [
        ({"task": "feedng"}, "Did you mean 'feeding'"),
        ({"cast": {"recipient": "karn"}}, "Did you mean 'karan'"),
        ({"cast": {"policies": {}}}, "'policies' is no role"),
        ({"cast": {"robot": "nao", "recipient": "karan"}}, "nao|robot"),
        ({"physics": 1}, "physics"),
    ],
)
def test_an_episode_that_cannot_be_played_here_says_why(
    episode: RecordedEpisode, setup: dict[str, Any], message: str
) -> None:
    changed = dataclasses.replace(episode.header, setup={**episode.header.setup, **setup})
    with pytest.raises(rcare_marl.errors.RcareError, match=message):
        replay(dataclasses.replace(episode, header=changed))


def test_another_control_mode_is_refused_by_the_size_of_its_actions(
    episode: RecordedEpisode,
) -> None:
    setup = {**episode.header.setup, "cast": {"robot": {"control": "joint_delta"}}}
    header = dataclasses.replace(episode.header, setup=setup)
    with pytest.raises(ConfigError, match="an action of 'robot' had 6 values and has 7 here"):
        replay(dataclasses.replace(episode, header=header))


def test_the_command_says_for_how_many_steps_it_is_equal(file: Path) -> None:
    result = call(file)
    assert result.exit_code == 0
    assert f"feeding, seed 7: equal for {STEPS} steps" in result.output


def test_the_command_names_the_first_step_that_differs(
    episode: RecordedEpisode, file: Path
) -> None:
    rows = np.clip(episode.actions["robot"] * 0.9, -1, 1)
    versions = {**episode.header.versions, "numpy": "0.1"}
    other = dataclasses.replace(
        episode,
        header=dataclasses.replace(episode.header, versions=versions),
        actions={**episode.actions, "robot": rows},
    )
    other.save(file)
    result = call(file)
    assert result.exit_code == 1
    assert "differs at step 1: body robot" in result.output and "was 0.1" in result.output
    told = json.loads(call(file, "--json").stdout)
    assert told[0]["equal"] is False and told[0]["steps"] == 0


@pytest.mark.needs_gl
def test_the_command_draws_the_end(file: Path, tmp_path: Path) -> None:
    picture = tmp_path / "new" / "a.png"
    result = call(file, "--picture", picture)
    assert result.exit_code == 0, result.output
    assert np.asarray(Image.open(picture).convert("L")).std() > 5


@pytest.mark.slow
@pytest.mark.needs_gl
def test_the_command_films(file: Path, tmp_path: Path) -> None:
    film = tmp_path / "a.mp4"
    assert call(file, "--film", film).exit_code == 0
    assert b"ftyp" in film.read_bytes()[:12]


def test_the_command_logs_for_rerun(file: Path, episode: RecordedEpisode, tmp_path: Path) -> None:
    chunk = pytest.importorskip("rerun.chunk", reason="the log needs the extra 'rerun'")
    log = tmp_path / "a.rrd"
    assert call(file, "--rerun", log).exit_code == 0
    rows: dict[str, dict[float, Any]] = {}  # of each entity, by time [s]
    for each in chunk.RrdReader(log).stream():
        if "time" in each.timeline_names:
            batch = each.to_record_batch()
            times = [round(t / 1e9, 3) for t in batch.column("time").cast("int64").to_pylist()]
            values = batch.select([name for name in batch.schema.names if ":" in name])
            for time, row in zip(times, values.to_pylist(), strict=True):
                rows.setdefault(each.entity_path, {}).setdefault(time, {}).update(row)
    every = [round(0.1 * step, 3) for step in range(episode.steps + 1)]
    told = [rows["/metrics/force_n"][time]["Scalars:scalars"] for time in every]
    assert told == [[value] for value in episode.measure("force_n")]
    skin = rows["/scene/skin/recipient"]
    assert all(len(skin[time]["Mesh3D:vertex_positions"]) > 10_000 for time in every)
    assert [time for time in skin if skin[time].get("Mesh3D:triangle_indices")] == [0.0]
    assert len(rows["/scene/robot/20"]) == len(every)


def test_wrong_uses_of_the_command_are_told(file: Path, tmp_path: Path) -> None:
    result = call(file.with_name("episod.npz"))
    assert result.exit_code == 2 and "has episode.npz" in " ".join(result.output.split())
    result = call(file, file, "--film", tmp_path / "a.mp4")
    assert result.exit_code == 2 and "one recorded episode" in " ".join(result.output.split())


@pytest.mark.slow
def test_evaluate_leaves_episodes_that_can_be_replayed(tmp_path: Path) -> None:
    given = ["evaluate", "feeding", "--policy", "still", "--episodes", "1", "--seed", "4"]
    given += ["--role-policy", "recipient=still", "--option", "force_limit=15"]
    result = CliRunner().invoke(app, [*given, "--save-episodes", str(tmp_path / "all")])
    assert result.exit_code == 0, result.output
    assert [each.name for each in (tmp_path / "all").iterdir()] == ["seed-4.npz"]
    episode = RecordedEpisode.read(tmp_path / "all" / "seed-4.npz")
    assert episode.header.policies == {"robot": "still", "recipient": "still"}
    assert episode.header.setup["options"] == {"force_limit": 15}
    assert replay(episode).difference == ""
