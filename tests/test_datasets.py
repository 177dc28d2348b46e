"""Datasets of others: what is recorded comes back to the bit from each format, and damage is refused."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("h5py", reason="datasets need the extra 'data'")
pytest.importorskip("mcap", reason="datasets need the extra 'data'")
pytest.importorskip("minari", reason="datasets need the extra 'data'")
pytest.importorskip("pyarrow", reason="datasets need the extra 'data'")

import rcare_marl
from rcare_marl.cli import app
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.datasets import format_of, hdf5, read, record, write
from rcare_marl.envs.episode import EpisodeRecorder, RecordedEpisode, replay
from rcare_marl.errors import ConfigError

NAMES = {
    "lerobot": "lerobot",
    "minari": "feeding-v0",
    "robomimic": "feeding.hdf5",
    "mcap": "a.mcap",
}
FEW = 5  # damaged files of each format
STEPS = (4, 3)
CAMERA = {"kind": "camera", "outputs": ["rgb", "depth"], "width": 16, "height": 12}
POLICIES = {"robot": "random", "recipient": "cooperative"}


@pytest.fixture(scope="module")
def env() -> Iterator[CareEnv]:
    made = rcare_marl.make("feeding", policies=POLICIES, robot={"sensors": [CAMERA]})
    yield made
    made.close()


@pytest.fixture(scope="module")
def episodes(env: CareEnv) -> list[RecordedEpisode]:
    recorder, out = EpisodeRecorder(env, sees=True), []
    for seed, steps in enumerate(STEPS):
        env.reset(seed=seed)
        for _ in range(steps):
            env.step({})
        out.append(recorder.episode(POLICIES))
    recorder.close()
    return out


@pytest.fixture(scope="module")
def folder(episodes: list[RecordedEpisode], tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("datasets")
    for kind, name in NAMES.items():
        if kind != "minari" or hdf5.keeps_pictures():
            assert write(place / name, episodes) == len(STEPS)
    return place


def test_pictures_that_an_old_minari_would_change_are_refused(
    episodes: list[RecordedEpisode], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hdf5, "keeps_pictures", lambda: False)
    with pytest.raises(ConfigError, match=r"robot\.camera_rgb as JPEG alone: record without"):
        write(tmp_path / NAMES["minari"], episodes)


OLD_MINARI = pytest.mark.skipif(
    not hdf5.keeps_pictures(), reason="this Minari keeps no picture as it was"
)
KINDS = [pytest.param(k, marks=[OLD_MINARI] if k == "minari" else []) for k in NAMES]


@pytest.mark.parametrize("kind", KINDS)
def test_an_episode_of_each_format_is_replayed_to_the_bit(
    kind: str, folder: Path, env: CareEnv, episodes: list[RecordedEpisode]
) -> None:
    path = folder / NAMES[kind]
    assert format_of(path) == kind
    found = read(path)
    assert [each.steps for each in found] == list(STEPS)
    for was, now in zip(episodes, found, strict=True):
        assert now.header == was.header
        for role in was.header.roles:
            np.testing.assert_array_equal(now.observations[role], was.observations[role])
            np.testing.assert_array_equal(now.actions[role], was.actions[role])
            np.testing.assert_array_equal(now.rewards(role), was.rewards(role))
    (second,) = read(path, only=1)
    assert replay(second).difference == ""
    with pytest.raises(ConfigError, match="no episode 2 in it"):
        read(path, only=2)


def test_the_header_says_who_played(episodes: list[RecordedEpisode]) -> None:
    facts = episodes[0].header.facts
    assert facts["lead"] == "robot" and facts["control_dt"] == 0.1
    person = facts["people"]["recipient"]
    assert len(person["hash"]) == 12 and person["profile"]
    assert {"rcare_marl", "pybullet"} <= set(episodes[0].header.versions)


@OLD_MINARI
def test_minari_opens_it_as_its_docs_do(
    folder: Path, monkeypatch: pytest.MonkeyPatch, episodes: list[RecordedEpisode]
) -> None:
    import minari

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    data = minari.load_dataset("feeding-v0")
    assert (data.total_episodes, data.total_steps) == (2, sum(STEPS))
    first = data[0]
    start = {
        role: {k: v[0] for k, v in seen.items()} if isinstance(seen, dict) else seen[0]
        for role, seen in first.observations.items()
    }
    assert data.observation_space.contains(start)
    np.testing.assert_array_equal(first.actions["robot"], episodes[0].actions["robot"])
    pictures = episodes[0].observations["robot.camera_rgb"]
    np.testing.assert_array_equal(first.observations["robot"]["camera_rgb"], pictures)
    assert bool(first.truncations[-1]) and not first.terminations.any()


def test_lerobot_has_frames_tasks_and_films(folder: Path) -> None:
    import imageio_ffmpeg
    import pyarrow.parquet as pq

    place = folder / NAMES["lerobot"]
    info = json.loads((place / "meta/info.json").read_text())
    frames = pq.read_table(place / info["data_path"].format(chunk_index=0, file_index=0))
    assert frames.num_rows == info["total_frames"] == sum(STEPS)
    assert frames.column("episode_index").to_pylist() == [0] * STEPS[0] + [1] * STEPS[1]
    films = [name for name, about in info["features"].items() if about["dtype"] == "video"]
    assert films == ["observation.images.robot.camera_rgb"]
    assert set(info["features"]) - set(films) == set(frames.column_names)
    film = info["video_path"].format(video_key=films[0], chunk_index=0, file_index=0)
    assert imageio_ffmpeg.count_frames_and_secs(str(place / film))[0] == sum(STEPS)


def test_mcap_holds_messages_of_json_with_schemas(folder: Path) -> None:
    from mcap.reader import make_reader

    with (folder / NAMES["mcap"]).open("rb") as stream:
        found = list(make_reader(stream).iter_messages())
    topics = {channel.topic for _, channel, _ in found}
    assert {"/episode", "/robot/observation", "/recipient/action", "/robot/camera_rgb"} <= topics
    assert all(schema is not None and json.loads(schema.data) for schema, _, _ in found)
    assert sum(c.topic == "/robot/action" for _, c, _ in found) == sum(STEPS)


def test_robomimic_has_demonstrations(folder: Path) -> None:
    import h5py  # type: ignore[import-untyped, unused-ignore]

    with h5py.File(folder / NAMES["robomimic"]) as file:
        assert file["data"].attrs["total"] == sum(STEPS) and "env_args" in file["data"].attrs
        demo = file["data/demo_0"]
        assert demo.attrs["num_samples"] == STEPS[0]
        assert {"actions", "rewards", "dones", "obs", "next_obs"} <= set(demo)
        assert demo["obs/robot.camera_rgb"].shape == (STEPS[0], 12, 16, 3)


def main_file(path: Path) -> Path:
    inner = ("data/main_data.hdf5", "data/chunk-000/file-000.parquet")
    return next((path / name for name in inner if (path / name).is_file()), path)


@pytest.mark.parametrize("kind", KINDS)
def test_damage_is_a_named_error(kind: str, folder: Path, tmp_path: Path) -> None:
    import shutil

    path = tmp_path / NAMES[kind]
    copy: Callable[..., Any] = shutil.copytree if (folder / NAMES[kind]).is_dir() else shutil.copy
    copy(folder / NAMES[kind], path)
    victim = main_file(path)
    good, chance = victim.read_bytes(), random.Random(26)
    refused = 0
    for number in range(FEW):
        data = bytearray(good)
        if number % 3 == 0:
            data = data[: chance.randrange(len(good))]
        for _ in range(chance.choice((1, 8, 200))):
            if data:
                data[chance.randrange(len(data))] = chance.randrange(256)
        victim.write_bytes(data)
        try:
            read(path)
        except ConfigError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > FEW // 3


def test_rewards_that_were_changed_are_refused(folder: Path, tmp_path: Path) -> None:
    import shutil

    import h5py

    path = Path(shutil.copy(folder / NAMES["robomimic"], tmp_path))
    with h5py.File(path, "a") as file:
        file["data/demo_1/rewards"][0] += 1.0
    with pytest.raises(ConfigError, match="rewards of 'robot' are not those"):
        read(path)


def test_links_that_lead_out_of_a_file_are_refused(folder: Path, tmp_path: Path) -> None:
    import shutil

    import h5py

    path = Path(shutil.copy(folder / NAMES["robomimic"], tmp_path))
    with h5py.File(path, "a") as file:
        del file["data/demo_0/actions"]
        file["data/demo_0/actions"] = h5py.ExternalLink("/etc/passwd", "/x")
    with pytest.raises(ConfigError, match="leads elsewhere"):
        read(path)


def test_what_is_there_is_not_overwritten(folder: Path, env: CareEnv) -> None:
    with pytest.raises(ConfigError, match="is there already"), record(env, folder / "a.mcap"):
        pass
    with pytest.raises(ConfigError, match="names no format"), record(env, folder / "a.txt"):
        pass


def test_without_a_finished_episode_nothing_is_left(env: CareEnv, tmp_path: Path) -> None:
    with record(env, tmp_path / "a.mcap"):
        env.reset(seed=0)
        env.step({})
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_evaluations_are_recorded_and_replayed(tmp_path: Path) -> None:
    def call(*words: str) -> Any:
        return CliRunner().invoke(app, words)

    path = str(tmp_path / "fed.hdf5")
    done = call("evaluate", "feeding", "--episodes", "2", "--record", path)
    assert done.exit_code == 0, done.output
    again = call("replay", path)
    assert again.exit_code == 0 and "episode 1: feeding, seed 1: equal" in again.output
    one = json.loads(call("replay", path, "--episode", "1", "--json").output)
    assert [each["episode"] for each in one] == [1] and one[0]["equal"]
