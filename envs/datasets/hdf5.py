"""Datasets in HDF5: those of robomimic (one file), and those of Minari (a folder, written by its library).

robomimic: https://robomimic.github.io/docs/datasets/overview.html; Minari: https://minari.farama.org.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from rcare_marl.errors import ConfigError
from rcare_marl.observable import VECTOR
from rcare_marl.reading import TreeFile, parse_json, read_json

from ..episode import RecordedEpisode
from .common import WHAT, assembled, check_rewards, header_of, lead_first, read_header

MAIN = "main_data.hdf5"  # Minari's names
META = "metadata.json"
HEADERS = "rcare_marl"  # key of our headers in its metadata


class RobomimicWriter:
    """Writes `data/demo_<n>`; `actions`, `rewards` and `dones` are of who is to learn."""

    def __init__(self, path: Path) -> None:
        """Begin a file."""
        import h5py

        self._file = h5py.File(path, "w")
        self._data = self._file.create_group("data")
        self._data.attrs["total"] = 0

    def add(self, episode: RecordedEpisode) -> None:
        header, roles = episode.header, lead_first(episode.header)
        place = self._data.create_group(f"demo_{len(self._data)}")
        if "env_args" not in self._data.attrs:
            args = {"env_name": header.setup["task"], "type": "rcare_marl", "env_kwargs": {}}
            self._data.attrs["env_args"] = json.dumps(args)
        place.attrs["num_samples"] = episode.steps
        self._data.attrs["total"] += episode.steps
        # A dataset, for an attribute has at most 64 kB.
        text = json.dumps(header_of(episode), allow_nan=False).encode()
        place["rcare_marl/header"] = np.frombuffer(text, np.uint8)
        place["rcare_marl/digests"], place["rcare_marl/numbers"] = episode.digests, episode.numbers
        for role in roles:
            end = "" if role == roles[0] else f"_{role}"
            place[f"actions{end}"] = episode.actions[role]
            place[f"rewards{end}"] = episode.rewards(role)
        place["dones"] = (episode.measure("over")[1:]).astype(np.int64)
        for name, seen in episode.observations.items():
            for group, rows in (("obs", seen[:-1]), ("next_obs", seen[1:])):
                place.create_dataset(
                    f"{group}/{name}", data=rows, compression="gzip" if seen.ndim > 2 else None
                )

    def close(self) -> None:
        self._file.close()


def read_robomimic(path: Path, only: int | None) -> Iterator[RecordedEpisode]:
    """Yield the episodes of a file, or one of them."""
    file = TreeFile(path, WHAT)
    count = len(file.names("data"))
    for number in range(count) if only is None else {only} & {*range(count)}:
        here = f"data/demo_{number}"
        text, digests, numbers = file.take(
            *(f"{here}/rcare_marl/{part}" for part in ("header", "digests", "numbers"))
        )
        header = read_header(parse_json(text.tobytes().decode()), path)
        actions, rewards, seen = {}, {}, {}
        for role in header.roles:
            end = "" if role == header.facts["lead"] else f"_{role}"
            actions[role], rewards[role] = file.take(f"{here}/actions{end}", f"{here}/rewards{end}")
        for name in file.names(f"{here}/obs"):
            before, after = file.take(f"{here}/obs/{name}", f"{here}/next_obs/{name}")
            seen[name] = np.concatenate([before, after[-1:]])
        yield check_rewards(assembled(header, actions, digests, numbers, seen), rewards)


def keeps_pictures() -> bool:
    """Return whether the Minari that is installed can keep pictures as they are: from 0.5.4 on."""
    from minari.dataset.minari_storage import MinariStorage

    return "jpeg_encoding" in inspect.signature(MinariStorage.new).parameters


class MinariWriter:
    """Writes by Minari's library; spaces are dictionaries by role, rewards of who is to learn."""

    def __init__(self, path: Path) -> None:
        """Begin a folder whose name is the dataset's, such as `feeding-v0`."""
        self._path = path
        self._storage: Any = None
        self._headers: list[dict[str, Any]] = []
        self.name = path.name

    def add(self, episode: RecordedEpisode) -> None:
        from minari.data_collector import EpisodeBuffer
        from minari.dataset.minari_storage import MinariStorage

        roles = lead_first(episode.header)
        nested = {role: _nested(episode, role) for role in roles}
        if self._storage is None:
            pictures = [n for n, seen in episode.observations.items() if seen.dtype == np.uint8]
            if pictures and not keeps_pictures():
                raise ConfigError(
                    f"Minari before 0.5.4 (which needs Python 3.11) keeps {pictures[0]} as JPEG alone: "
                    "record without pictures, or to FILE.hdf5, FILE.mcap or a folder for LeRobot"
                )
            exact: Any = {"jpeg_encoding": False} if keeps_pictures() else {}
            self._storage = MinariStorage.new(
                self._path / "data",
                spaces.Dict({role: _space(nested[role]) for role in roles}),
                spaces.Dict({role: _space(episode.actions[role], -1.0, 1.0) for role in roles}),
                **exact,
            )
        ended = np.zeros(episode.steps, bool)
        late = ended.copy()
        ended[-1], late[-1] = episode.ending
        rewards = {f"reward_{role}": episode.measure(f"reward of {role}") for role in roles}
        buffer = EpisodeBuffer(
            seed=episode.header.seed if episode.header.seed < 2**63 else None,
            observations=nested,
            actions=dict(episode.actions),
            rewards=episode.rewards(roles[0]),  # type: ignore[arg-type, unused-ignore]
            terminations=ended,  # type: ignore[arg-type, unused-ignore]
            truncations=late,  # type: ignore[arg-type, unused-ignore]
            infos={"digests": episode.digests, "numbers": episode.numbers, **rewards},
        )
        self._storage.update_episodes([buffer])
        self._headers.append(header_of(episode))

    def close(self) -> None:
        if self._storage is None:
            return
        import minari

        self._storage.update_metadata(
            {
                "dataset_id": self.name,
                "minari_version": minari.__version__,
                "description": f"rcare-marl: {self._headers[0]['setup']['task']}",
                HEADERS: self._headers,
            }
        )


def _nested(episode: RecordedEpisode, role: str) -> Any:
    """Return what a role observed as an environment gives it: a vector, or a dictionary of arrays."""
    parts = {
        name.partition(".")[2]: v for name, v in episode.observations.items() if _of(name, role)
    }
    if len(parts) == 1:
        return parts[""]
    return {name or VECTOR: values for name, values in parts.items()}


def _of(name: str, role: str) -> bool:
    return name.partition(".")[0] == role


def _space(rows: Any, low: float | None = None, high: float | None = None) -> spaces.Space[Any]:
    if isinstance(rows, dict):
        return spaces.Dict({name: _space(values) for name, values in rows.items()})
    kind: npt.NDArray[Any] = rows
    if kind.dtype.kind == "f":
        ends: tuple[Any, Any] = (-np.inf if low is None else low, np.inf if high is None else high)
    elif kind.dtype.kind == "b":
        ends = (False, True)
    else:
        ends = (np.iinfo(kind.dtype).min, np.iinfo(kind.dtype).max)
    return spaces.Box(*ends, kind.shape[1:], kind.dtype.type)  # type: ignore[arg-type, unused-ignore]


def read_minari(path: Path, only: int | None) -> Iterator[RecordedEpisode]:
    """Yield the episodes of a folder, or one of them."""
    headers = read_json(path / "data" / META, WHAT).get(HEADERS)
    if not isinstance(headers, list):
        raise ConfigError(f"{path} was not recorded by rcare-marl: its metadata lacks {HEADERS!r}")
    file = TreeFile(path / "data" / MAIN, WHAT)
    for number in range(len(headers)) if only is None else {only} & {*range(len(headers))}:
        here = f"episode_{number}"
        header = read_header(headers[number], path)
        digests, numbers, reward = file.take(
            *(f"{here}/{part}" for part in ("infos/digests", "infos/numbers", "rewards"))
        )
        actions, seen = {}, {}
        for role in header.roles:
            actions[role] = file.take(f"{here}/actions/{role}")[0]
            if not header.facts["arrays"][role]:
                seen[role] = file.take(f"{here}/observations/{role}")[0]
                continue
            for name in file.names(f"{here}/observations/{role}"):
                full = role if name == VECTOR else f"{role}.{name}"
                seen[full] = file.take(f"{here}/observations/{role}/{name}")[0]
        episode = assembled(header, actions, digests, numbers, seen)
        yield check_rewards(episode, {header.facts["lead"]: reward})
