"""Files that appear whole or not at all, and arrays in one: NumPy's `.npz` without pickle."""

from __future__ import annotations

import io
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.reading import ArrayFile, parse_json, refusing

HEADER = "about"  # the array that holds the JSON

Arrays = dict[str, npt.NDArray[Any]]


def write_whole(path: Path, data: bytes) -> None:
    """Write a file at once; whoever looks sees the old one or the new one, never a part.

    Raises:
        ConfigError: If it cannot be written.
    """
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
        temporary = Path(name)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        temporary.chmod(0o644)
        os.replace(temporary, path)
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


class Draft:
    """A folder in the making.

    Attributes:
        path: Where to write the files.
        target: Where they will be, once `publish` was called.
    """

    def __init__(self, path: Path, target: Path, *, numbered: bool) -> None:
        self.path, self.target = path, target
        self._numbered = numbered

    def publish(self) -> Path:
        """Move the files to where they belong and return that folder."""
        if self._numbered:
            self.target = _claim(self.path, self.target)
        elif self.target.exists():
            for file in sorted(self.path.iterdir()):
                try:
                    os.replace(file, self.target / file.name)
                except OSError as error:
                    place = self.target / file.name
                    raise ConfigError(f"cannot write {place}: {error.strerror}") from error
        else:
            os.rename(self.path, self.target)
        return self.target


@contextmanager
def draft(target: Path, *, numbered: bool = False) -> Iterator[Draft]:
    """Give a scratch folder beside `target`; without `publish` nothing is left of it.

    Args:
        target: The folder to be; its files of the same names are replaced, if it is there already.
        numbered: Whether to take the first free of `target`-1, `target`-2, and so on.

    Raises:
        ConfigError: If the folder cannot be written, or a file is in its place.
    """
    if not numbered and target.exists() and not target.is_dir():
        raise ConfigError(f"cannot write to {target}: there is a file of that name")
    made = [folder for folder in (target.parent, *target.parent.parents) if not folder.exists()]
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise ConfigError(f"cannot write to {target}: {error.strerror}") from error
    scratch.chmod(0o755)
    try:
        yield Draft(scratch, target, numbered=numbered)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        for folder in made:  # those that we made and that stayed empty, innermost first
            try:
                folder.rmdir()
            except OSError:
                break


def _claim(scratch: Path, stem: Path) -> Path:
    """Rename `scratch` to the first free number of `stem`; another process may race for it."""
    number = 1
    while True:
        target = stem.with_name(f"{stem.name}-{number}")
        if not target.exists():
            try:
                os.rename(scratch, target)
                return target
            except OSError:
                if not target.exists():
                    raise
        number += 1


def write_arrays(
    path: Path, about: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]
) -> None:
    """Write a file; the same contents give the same bytes. ConfigError if it cannot be written."""
    text = json.dumps(about, allow_nan=False, sort_keys=True).encode()
    plain: Any = {HEADER: np.frombuffer(text, np.uint8)}
    plain |= {name: np.ascontiguousarray(part) for name, part in arrays.items()}
    stream = io.BytesIO()
    np.savez_compressed(stream, **plain)
    write_whole(path, stream.getvalue())


def read_arrays(path: Path, what: str, version: int) -> tuple[dict[str, Any], Arrays]:
    """Return the header of a file without its `version`, and its arrays.

    Args:
        path: The file.
        what: What it should be, such as "a policy", for messages.
        version: The version of its format that can be read.

    Raises:
        ConfigError: If it is missing, damaged, of another kind or of another version.
    """
    file = ArrayFile(path, what)
    arrays = dict(zip(file.names, file.take(*file.names), strict=True))
    with refusing(path, what):
        about = dict(parse_json(arrays.pop(HEADER).tobytes().decode()))
        found = about.pop("version")
    if found != version:
        raise ConfigError(
            f"{path} has version {found!r} of the format; this package reads {version}"
        )
    return about, arrays
