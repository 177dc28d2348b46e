"""Arrays in one file with a header in JSON: NumPy's `.npz` without pickle, whole or not at all."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .atomic_file import write_whole
from .errors import ConfigError

HEADER = "about"  # the array that holds the JSON

Arrays = dict[str, npt.NDArray[Any]]


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
    with refused_if_damaged(path, what):
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
        about = dict(json.loads(arrays.pop(HEADER).tobytes()))
        found = about.pop("version")
    if found != version:
        raise ConfigError(
            f"{path} has version {found!r} of the format; this package reads {version}"
        )
    return about, arrays


@contextmanager
def refused_if_damaged(path: Path, what: str) -> Iterator[None]:
    """Turn whatever damage raises while a file is read into a ConfigError that names the file."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        EOFError,
        zipfile.BadZipFile,
        zlib.error,
        NotImplementedError,
    ) as error:  # of which NumPy raises one or the other, as the damage lies
        raise ConfigError(f"{path} is damaged, or no file of {what}: {error}") from error
