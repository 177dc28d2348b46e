"""Datasets of LeRobot, version 3.0: a folder of Parquet, JSON, and a film for each camera.

https://huggingface.co/docs/lerobot/lerobot-dataset-v3. Written without its package, which wants another
PyTorch. `observation.state`, `action` and `next.reward` are of who is to learn, `observation.<role>` and so
on of the others. What frames cannot hold (what came after the last one, digests, headers) is in
`meta/rcare_marl.npz`. Films are lossy; all else is exact.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.atomic_file import read_arrays, write_arrays
from rcare_marl.errors import ConfigError
from rcare_marl.reading import read_columns, read_json

from ..episode import Header, RecordedEpisode
from .common import WHAT, assembled, check_rewards, header_of, is_picture, read_header

VERSION = 1  # of our own file
INFO, OWN = "meta/info.json", "meta/rcare_marl.npz"
FILE = "chunk-000/file-000"  # all is in one file: limits of size are its writer's habit, no rule
DATA, EPISODES, TASKS = (
    f"data/{FILE}.parquet",
    f"meta/episodes/{FILE}.parquet",
    "meta/tasks.parquet",
)
INDEX = "__index_level_0__"  # what pandas calls the column that is its index
PATTERN = "chunk-{chunk_index:03d}/file-{file_index:03d}"
INDICES = ("frame_index", "episode_index", "index", "task_index")
STATE, ACTION, REWARD, IMAGES = "observation.state", "action", "next.reward", "observation.images"
SUMS: dict[str, Any] = {"min": np.min, "max": np.max, "mean": np.mean, "std": np.std}

Array = npt.NDArray[Any]


def _names(header: Header) -> dict[str, dict[str, str]]:
    """Return for each role what its observation, action and reward are called."""
    out = {}
    for role in header.roles:
        is_lead = role == header.facts["lead"]
        names = {
            "state": f"observation.{role}",
            "action": f"action.{role}",
            "reward": f"reward.{role}",
        }
        out[role] = {"state": STATE, "action": ACTION, "reward": REWARD} if is_lead else names
    return out


class LerobotWriter:
    """Writes a folder."""

    def __init__(self, path: Path) -> None:
        """Begin a folder that is there and empty."""
        self._path, self._frames = path, 0
        self._headers: list[dict[str, Any]] = []
        self._rest: dict[str, Array] = {}
        self._rows: list[dict[str, Any]] = []
        self._columns: dict[str, list[Array]] = {}
        self._features: dict[str, Any] = {}
        self._films: dict[str, Any] = {}

    def add(self, episode: RecordedEpisode) -> None:
        number, steps, header = len(self._headers), episode.steps, episode.header
        self._fps = round(1 / header.facts["control_dt"])
        ended = np.zeros(steps, bool)
        ended[-1] = True
        at = np.arange(steps)
        columns: dict[str, Array] = {}
        arrays = {name: seen for name, seen in episode.observations.items() if "." in name}
        for role, called in _names(header).items():
            columns[called["state"]] = episode.observations[role][:-1]
            columns[called["action"]] = episode.actions[role]
            columns[called["reward"]] = episode.rewards(role)
        columns |= {f"observation.{n}": v[:-1] for n, v in arrays.items() if not is_picture(v)}
        columns |= {"next.done": ended, "next.success": ended & episode.is_success}
        indices = (at, np.full(steps, number), at + self._frames, np.zeros(steps, int))
        columns["timestamp"] = (at / self._fps).astype(np.float32)
        columns |= dict(zip(INDICES, indices, strict=True))
        films = {f"{IMAGES}.{n}": v[:-1] for n, v in arrays.items() if is_picture(v)}
        if not self._features:
            self._features = self._described(header, columns, films)
        for name, values in columns.items():
            self._columns.setdefault(name, []).append(values)
        for name, pictures in films.items():
            self._film(name, pictures)
        self._rows.append(self._row(number, steps, header, {**columns, **films}, films))
        self._rest |= {f"digests_{number}": episode.digests, f"numbers_{number}": episode.numbers}
        last = {name: seen[-1:] for name, seen in episode.observations.items() if "." not in name}
        self._rest |= {f"last_{number}.{role}": seen for role, seen in last.items()}
        self._headers.append(header_of(episode))
        self._frames += steps

    def _described(
        self, header: Header, columns: Mapping[str, Array], films: Mapping[str, Array]
    ) -> dict[str, Any]:
        """Return the features as `info.json` has them."""
        names: dict[str, Any] = {}
        for role, called in _names(header).items():
            parts = header.facts["observes"][role]
            names[called["state"]] = [
                f"{n}_{i}" if k > 1 else n for n, k, _ in parts for i in range(k)
            ]
            names[called["action"]] = header.facts["acts"][role]
        out: dict[str, Any] = {}
        for name, values in columns.items():
            kind, shape = values.dtype.name, list(values.shape[1:]) or [1]
            out[name] = {"dtype": kind, "shape": shape, "names": names.get(name)}
        for name, values in films.items():
            _, height, width, _ = values.shape
            film = {"height": height, "width": width, "codec": "h264", "pix_fmt": "yuv420p"}
            film |= {"is_depth_map": False, "fps": self._fps, "channels": 3}
            out[name] = {
                "dtype": "video",
                "shape": [height, width, 3],
                "names": ["height", "width", "channels"],
                "info": {**{f"video.{n}": v for n, v in film.items()}, "has_audio": False},
            }
        return out

    def _film(self, name: str, pictures: Array) -> None:
        """Add pictures to the film of a camera."""
        import imageio_ffmpeg

        if name not in self._films:
            file = self._path / "videos" / name / f"{FILE}.mp4"
            file.parent.mkdir(parents=True)
            size = pictures.shape[2], pictures.shape[1]
            self._films[name] = imageio_ffmpeg.write_frames(
                str(file), size, fps=self._fps, codec="libx264", quality=8, macro_block_size=1
            )
            self._films[name].send(None)
        for pixels in pictures:
            self._films[name].send(np.ascontiguousarray(pixels))

    def _row(
        self, number: int, steps: int, header: Header, columns: Mapping[str, Array], films: Any
    ) -> dict[str, Any]:
        """Return what the table of episodes says of one."""
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [_instruction(header)],
            "length": steps,
            "data/chunk_index": 0,
            "data/file_index": 0,
            "dataset_from_index": self._frames,
            "dataset_to_index": self._frames + steps,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        for name in films:
            row |= {f"videos/{name}/chunk_index": 0, f"videos/{name}/file_index": 0}
            row[f"videos/{name}/from_timestamp"] = self._frames / self._fps
            row[f"videos/{name}/to_timestamp"] = (self._frames + steps) / self._fps
        for name, values in columns.items():
            row |= {f"stats/{name}/{n}": v for n, v in _statistic(values).items()}
        return row

    def close(self) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        for film in self._films.values():
            film.close()
        if not self._headers:
            return
        for name in (DATA, EPISODES):
            (self._path / name).parent.mkdir(parents=True)
        whole = {name: np.concatenate(parts) for name, parts in self._columns.items()}
        pq.write_table(pa.table({n: _arrow(v) for n, v in whole.items()}), self._path / DATA)
        pq.write_table(pa.Table.from_pylist(self._rows), self._path / EPISODES)
        text = self._rows[0]["tasks"][0]
        about = {  # so that pandas takes the text for the index
            "index_columns": [INDEX],
            "column_indexes": [],
            "columns": [
                {"name": field or None, "field_name": field or INDEX, "metadata": None}
                | {"pandas_type": kind, "numpy_type": numpy}
                for field, kind, numpy in (
                    ("task_index", "int64", "int64"),
                    ("", "unicode", "object"),
                )
            ],
            "creator": {"library": "pyarrow", "version": pa.__version__},
            "pandas_version": "2.0.0",
        }
        tasks = pa.table({"task_index": [0], INDEX: [text]})
        tasks = tasks.replace_schema_metadata({"pandas": json.dumps(about)})
        pq.write_table(tasks, self._path / TASKS)
        statistics = {name: _statistic(values) for name, values in whole.items()}
        for name in self._films:
            statistics[name] = _pooled([row for row in self._rows], name)
        self._dump("meta/stats.json", statistics)
        robot = self._headers[0]["facts"]["agents"][self._headers[0]["facts"]["lead"]]
        self._dump(
            INFO,
            {
                "codebase_version": "v3.0",
                "robot_type": robot.get("model") or robot.get("avatar"),
                "total_episodes": len(self._rows),
                "total_frames": self._frames,
                "total_tasks": 1,
                "chunks_size": 1000,
                "data_files_size_in_mb": 100,
                "video_files_size_in_mb": 200,
                "fps": self._fps,
                "splits": {"train": f"0:{len(self._rows)}"},
                "data_path": f"data/{PATTERN}.parquet",
                "video_path": f"videos/{{video_key}}/{PATTERN}.mp4" if self._films else None,
                "features": self._features,
            },
        )
        write_arrays(self._path / OWN, {"version": VERSION, "episodes": self._headers}, self._rest)

    def _dump(self, name: str, data: Any) -> None:
        (self._path / name).write_text(json.dumps(data, allow_nan=False, indent=1), "utf-8")


def _instruction(header: Header) -> str:
    return str(header.setup["task"]).replace("_", " ")


def _statistic(values: Array) -> dict[str, Any]:
    """Return least, greatest, mean, deviation and number of rows; of pictures by channel, from 0 to 1."""
    over: tuple[int, ...] = (0,)
    rows = values
    if is_picture(values):
        over, rows = (0, 2, 3), values.transpose(0, 3, 1, 2) / 255.0
    out: dict[str, Any] = {}
    for name, of in SUMS.items():
        found = np.atleast_1d(of(rows.astype(float), axis=over, keepdims=len(over) > 1))
        out[name] = (found[0] if len(over) > 1 else found).tolist()
    return {**out, "count": [len(values)]}


def _pooled(rows: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Return the statistics of pictures of all episodes from those of each."""
    each = {n: np.array([row[f"stats/{name}/{n}"] for row in rows]) for n in (*SUMS, "count")}
    share = (each["count"] / each["count"].sum()).reshape(-1, 1, 1, 1)
    mean = (share * each["mean"]).sum(0)
    square = (share * (each["std"] ** 2 + each["mean"] ** 2)).sum(0)
    found = {"min": each["min"].min(0), "max": each["max"].max(0), "mean": mean}
    found["std"] = np.sqrt(np.maximum(square - mean**2, 0.0))
    return {**{n: v.tolist() for n, v in found.items()}, "count": [int(each["count"].sum())]}


def _arrow(values: Array) -> Any:
    """Return rows as a column: numbers, or lists of them as deep as the rows."""
    import pyarrow as pa

    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    out = pa.array(np.ascontiguousarray(values).reshape(-1))
    for size in reversed(values.shape[1:]):
        ends = np.arange(0, len(out) + 1, size, dtype=np.int32)
        out = pa.ListArray.from_arrays(ends, out)
    return out


def read_lerobot(path: Path, only: int | None) -> Iterator[RecordedEpisode]:
    """Yield the episodes of a folder, or one of them; films and other arrays are left in it."""
    if read_json(path / INFO, WHAT).get("codebase_version") != "v3.0":
        raise ConfigError(f"{path / INFO}: only version v3.0 of LeRobot's datasets can be read")
    about, rest = read_arrays(path / OWN, WHAT, VERSION)
    headers = [read_header(each, path / OWN) for each in about["episodes"]]
    if not headers:
        return
    names = _names(headers[0])
    columns = read_columns(
        path / DATA, WHAT, ["episode_index", *(n for of in names.values() for n in of.values())]
    )
    for number in range(len(headers)) if only is None else {only} & {*range(len(headers))}:
        header, at = headers[number], columns["episode_index"] == number
        steps, of = int(at.sum()), {role: names[role] for role in header.roles}
        actions = {r: columns[n["action"]][at].reshape(steps, -1) for r, n in of.items()}
        seen = {}
        for role, name in of.items():
            rows = columns[name["state"]][at].reshape(steps, -1)
            seen[role] = np.concatenate([rows, rest[f"last_{number}.{role}"]])
        episode = assembled(
            header, actions, rest[f"digests_{number}"], rest[f"numbers_{number}"], seen
        )
        yield check_rewards(episode, {role: columns[n["reward"]][at] for role, n in of.items()})
