"""Episodes as datasets of others: LeRobot, Minari, robomimic and MCAP; written, read, replayed.

Example:
    >>> env = rcare_marl.make("feeding", policies={"robot": "scripted", "recipient": "cooperative"})
    >>> with record(env, "runs/feeding.hdf5"):
    ...     for seed in range(10):
    ...         env.reset(seed=seed)
    ...         while not env.is_over:
    ...             env.step({})
    >>> replay(read("runs/feeding.hdf5", only=3)[0]).difference
    ''
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from rcare_marl.errors import ConfigError, check_package, near_files
from rcare_marl.reading import refusing

from ..care_env import CareEnv
from ..episode import EpisodeRecorder, RecordedEpisode
from .common import WHAT, Writer

LEROBOT, MINARI, ROBOMIMIC, MCAP = "lerobot", "minari", "robomimic", "mcap"
PACKAGES = {LEROBOT: "pyarrow", MINARI: "minari", ROBOMIMIC: "h5py", MCAP: "mcap"}
ENDINGS = {".hdf5": ROBOMIMIC, ".h5": ROBOMIMIC, ".mcap": MCAP}
NAMING = "FILE.hdf5 is robomimic's, FILE.mcap is MCAP, a folder NAME-v0 is Minari's, another one LeRobot's"


def format_of(path: str | Path) -> str:
    """Return the format that a path names: `lerobot`, `minari`, `robomimic` or `mcap`.

    Raises:
        ConfigError: If its ending names none.
    """
    name = Path(path).name
    if (suffix := Path(path).suffix.lower()) in ENDINGS:
        return ENDINGS[suffix]
    if re.fullmatch(r"[-\w]+-v\d+", name):
        return MINARI
    if suffix or not name:
        raise ConfigError(f"{path} names no format of a dataset: {NAMING}")
    return LEROBOT


class Dataset:
    """A dataset in the making, which appears whole or not at all; it is there once `close` was called.

    Attributes:
        path: Where it will be.
        count: Episodes so far.
    """

    def __init__(self, path: str | Path) -> None:
        """Begin.

        Raises:
            ConfigError: If there is something of that name, it names no format, or cannot be written.
            MissingPackageError: If what writes the format is not installed.
        """
        self.path, self.count, kind = Path(path), 0, format_of(path)
        if self.path.exists():
            raise ConfigError(f"{path} is there already: name another place for the record")
        check_package(PACKAGES[kind], f"recording for {kind}", "data")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._scratch = Path(
                tempfile.mkdtemp(prefix=f".{self.path.name}-", dir=self.path.parent)
            )
        except OSError as error:
            raise ConfigError(f"cannot record to {path}: {error.strerror}") from error
        self._made = self._scratch / self.path.name
        if kind in (LEROBOT, MINARI):
            self._made.mkdir()
        self._writer = _writer(kind, self._made)

    def add(self, episode: RecordedEpisode) -> None:
        """Write an episode that has steps; ConfigError if its set-up holds objects."""
        if episode.steps:
            self._writer.add(episode)
            self.count += 1

    def close(self) -> None:
        """Finish; without any episode nothing is left."""
        try:
            self._writer.close()
            if self.count:
                self._made.rename(self.path)
        finally:
            shutil.rmtree(self._scratch, ignore_errors=True)


def _writer(kind: str, path: Path) -> Writer:
    if kind == LEROBOT:
        from .lerobot import LerobotWriter

        return LerobotWriter(path)
    if kind == MCAP:
        from .mcap import McapWriter

        return McapWriter(path)
    from .hdf5 import MinariWriter, RobomimicWriter

    return MinariWriter(path) if kind == MINARI else RobomimicWriter(path)


class Recording:
    """Writes the episodes of an environment, each when it is over.

    Attributes:
        dataset: Where they go.
        facts: What is noted of the running episode beside it, such as `marked`; empty at each reset.
    """

    def __init__(
        self, env: CareEnv, path: str | Path, policies: Mapping[str, str] | None = None
    ) -> None:
        """Begin; `policies` are names of who decides, for the reader. Errors as of `Dataset`."""
        self._env, self._policies = env, policies
        self.dataset = Dataset(path)
        self._recorder = EpisodeRecorder(env, sees=True)
        env.watchers.append(self._watch)

    def _watch(self, env: CareEnv) -> None:
        if env.is_over:
            self.keep()

    def keep(self, *, marked: bool = False) -> None:
        """Write the running episode as far as it was played; `marked` says that it is a success."""
        episode = self._recorder.episode(self._policies)
        if marked:
            episode.header.facts["marked"] = True
        self.dataset.add(episode)

    def close(self) -> None:
        """Finish the files and watch no longer."""
        self._env.watchers.remove(self._watch)
        self._recorder.close()
        self.dataset.close()


@contextmanager
def record(
    env: CareEnv, path: str | Path, policies: Mapping[str, str] | None = None
) -> Iterator[Recording]:
    """Write all episodes that an environment ends meanwhile, however it is driven.

    The file or folder appears when the block is left. An episode that was not played to its end is left
    out, unless `Recording.keep` was called.

    Args:
        env: Of `rcare_marl.make`.
        path: Where to, see `format_of`.
        policies: Names of who decides for each role, for the reader; those of the environment if None.

    Raises:
        ConfigError: If there is something of that name already, it names no format, or cannot be written.
        MissingPackageError: If what writes the format is not installed.
    """
    recording = Recording(env, path, policies)
    try:
        yield recording
    finally:
        recording.close()


def write(path: str | Path, episodes: Iterable[RecordedEpisode]) -> int:
    """Write episodes that were recorded with what was seen, and return how many; errors as of `record`."""
    dataset = Dataset(path)
    try:
        for episode in episodes:
            dataset.add(episode)
    finally:
        dataset.close()
    return dataset.count


def read(path: str | Path, *, only: int | None = None) -> list[RecordedEpisode]:
    """Return the episodes of a dataset that rcare-marl recorded, with the vectors that were observed.

    Pictures are left in the files where the format has them as such (LeRobot, MCAP).

    Args:
        path: A file or folder in one of the four formats, or an episode's `.npz`.
        only: Number of the one episode to read, from 0 on; all if None.

    Raises:
        ConfigError: If there is none, it is damaged, of another origin, or has no episode of that number.
        MissingPackageError: If what reads the format is not installed.
    """
    place = Path(path)
    if place.suffix == ".npz":
        return [RecordedEpisode.read(place)]
    if not place.exists():
        raise ConfigError(f"there is no dataset {place}.{near_files(place)}")
    from .hdf5 import META, read_minari, read_robomimic
    from .lerobot import INFO, read_lerobot
    from .mcap import read_mcap

    if place.is_dir():
        known = {INFO: read_lerobot, f"data/{META}": read_minari}
        reader = next((known[name] for name in known if (place / name).is_file()), None)
        if reader is None:
            raise ConfigError(f"{place} is no dataset: it has neither {' nor '.join(known)}")
    else:
        reader = read_mcap if format_of(place) == MCAP else read_robomimic
    if reader is read_mcap:
        check_package("mcap", "reading MCAP", "data")
    with refusing(place, WHAT):
        found = list(reader(place, only))
        if not found:
            which = "" if only is None else f" {only}"
            raise ConfigError(f"there is no episode{which} in it")
    return found
