"""The one door by which files come in.

A file is regular, of a bounded size, and read at once. Whatever its parser raises becomes a `ConfigError`
that names the file, what was expected and what was wrong.
"""

from __future__ import annotations

import io
import json
import math
import os
import stat
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from .errors import (
    ConfigError,
    RcareError,
    UnknownNameError,
    check_package,
    near_files,
    shown,
)

LARGEST = 1 << 30  # [bytes] of any file, and of all arrays that are taken from one
LARGEST_TEXT = 64 << 20  # [bytes]
DEPTH = 200  # of what is nested
MOST_ELEMENTS = 2_000_000  # of an XML file
NUMBERS = "fiu"  # kinds of arrays that hold real numbers
PLAIN = NUMBERS + "bU"  # and of those that are taken at all

Array = npt.NDArray[Any]


@contextmanager
def refusing(path: str | Path, what: str) -> Iterator[None]:
    """Turn whatever damage raises while a file is parsed into a ConfigError that names the file."""
    try:
        yield
    except (ConfigError, UnknownNameError) as error:
        if isinstance(error, ConfigError) and str(error).startswith(str(path)):
            raise
        raise ConfigError(f"{path}: {error}") from error
    except RcareError:
        raise
    except Exception as error:  # parsers raise nearly anything, as the damage lies
        raise ConfigError(f"{path} is damaged, or no file of {what}: {reason(error)}") from error


def reason(error: BaseException) -> str:
    """Return in words what an error of a parser says."""
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, MemoryError):
        return "it wants more memory than there is"
    if isinstance(error, KeyError):
        return f"it lacks {shown(error.args[0]) if error.args else 'a key'}"
    return str(error) or type(error).__name__


def check_regular(path: str | Path, what: str, *, most: int = LARGEST) -> Path:
    """Return the path of a regular file of at most so many bytes; ConfigError if it is none."""
    with _opened(path, what, most):
        return Path(path)


def read_bytes(path: str | Path, what: str, *, most: int = LARGEST) -> bytes:
    """Return what is in a regular file of at most `most` bytes; ConfigError if it cannot be read."""
    with _opened(path, what, most) as stream:
        data = stream.readall()
    return data


@contextmanager
def _opened(path: str | Path, what: str, most: int) -> Iterator[io.FileIO]:
    file = Path(path)
    try:
        # Without waiting, as whoever opens a pipe would.
        handle = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        hint = near_files(file) if isinstance(error, FileNotFoundError) else ""
        raise ConfigError(f"cannot read {what} from {file}: {why}.{hint}") from error
    try:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            kind = "a folder" if stat.S_ISDIR(about.st_mode) else "a pipe or device"
            raise ConfigError(f"cannot read {what} from {file}: it is {kind}, and no regular file")
        if about.st_size > most:
            raise ConfigError(
                f"{file} has {about.st_size:,} bytes; a file of {what} has at most {most:,}"
            )
        with open(handle, "rb", buffering=0, closefd=False) as stream:
            yield stream
    except OSError as error:
        raise ConfigError(f"cannot read {what} from {file}: {error.strerror}") from error
    finally:
        os.close(handle)


def read_text(path: str | Path, what: str, *, most: int = LARGEST_TEXT) -> str:
    """Return the text in a file of UTF-8, without the mark that some programs begin it with."""
    data = read_bytes(path, what, most=most)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(f"cannot read {what} from {path}: {error}") from error


def read_json(path: str | Path, what: str) -> dict[str, Any]:
    """Return the mapping in a JSON file; all its numbers are finite. ConfigError if there is none."""
    text = read_text(path, what)
    with refusing(path, what):
        data = parse_json(text)
    if not isinstance(data, dict):
        raise ConfigError(f"{path} holds no file of {what}, but {type(data).__name__}")
    return data


def parse_json(text: str) -> Any:
    """Return what a JSON text says; ConfigError or another ValueError if it is none."""
    return json.loads(text, parse_constant=_not_finite, parse_float=_finite)


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _not_finite(text)


def _not_finite(text: str) -> float:
    raise ConfigError(f"numbers must be finite, got {shown(text)}")


def read_xml(path: str | Path, what: str) -> ElementTree.Element:
    """Return the outermost element of an XML file; ConfigError if it is none."""
    return parse_xml(read_bytes(path, what, most=4 * LARGEST_TEXT), path)


def parse_xml(data: bytes, path: str | Path) -> ElementTree.Element:
    """Return the outermost element of an XML text of a file; ConfigError if it is none."""
    depth = count = 0
    try:
        steps = ElementTree.iterparse(io.BytesIO(data), events=("start", "end"))
        for event, _ in steps:
            depth += 1 if event == "start" else -1
            count += 1
            if depth > DEPTH or count > 2 * MOST_ELEMENTS:
                raise ConfigError(f"{path} has too many elements, or some {DEPTH} deep")
    except ElementTree.ParseError as error:
        raise ConfigError(f"{path} is not valid XML: {error}") from error
    except (ValueError, LookupError) as error:  # of encodings
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"{path} is not valid XML: {reason(error)}") from error
    root: ElementTree.Element = steps.root  # type: ignore[attr-defined, unused-ignore]
    return root


class ArrayFile:
    """An archive of arrays, NumPy's `.npz`, of which nothing is taken but what is asked for.

    Attributes:
        path: The file.
        names: Of its arrays.
    """

    def __init__(self, path: str | Path, what: str) -> None:
        """Look what is in a file; ConfigError if it is no such archive."""
        self.path, self._what = Path(path), what
        data = read_bytes(path, what)
        with refusing(path, what):
            if not zipfile.is_zipfile(io.BytesIO(data)):
                raise ValueError("it is no archive of arrays (.npz)")
            self._archive = zipfile.ZipFile(io.BytesIO(data))
            entries = self._archive.infolist()
            if len({each.filename for each in entries}) < len(entries):
                raise ValueError("an array stands twice")
            if sum(each.file_size for each in entries) > LARGEST:
                raise ValueError(f"its arrays would have more than {LARGEST:,} bytes")
            self._entries = {each.filename.removesuffix(".npy"): each for each in entries}
        self.names = tuple(self._entries)

    def take(self, *names: str) -> list[Array]:
        """Return arrays of numbers, texts or truth values by name.

        Raises:
            ConfigError: If one is missing, damaged or of another kind.
        """
        missing = [name for name in names if name not in self._entries]
        if missing:
            raise ConfigError(f"{self.path} lacks {', '.join(missing)}; it has {shown(self.names)}")
        with refusing(self.path, self._what):
            return [self._array(name) for name in names]

    def _array(self, name: str) -> Array:
        entry = self._entries[name]
        with self._archive.open(entry) as stream:
            version = np.lib.format.read_magic(stream)
            read = np.lib.format.read_array_header_1_0
            if version != (1, 0):
                read = np.lib.format.read_array_header_2_0
            shape, _, dtype = read(stream)
            # Before memory is asked for: a header can claim anything.
            rest = entry.file_size - stream.tell()
        if dtype.kind not in PLAIN:
            raise ValueError(f"{name} holds {shown(str(dtype))}: neither numbers nor texts")
        if min(shape, default=1) < 0 or math.prod(shape) * dtype.itemsize != rest:
            raise ValueError(f"{name} says that it has the shape {shown(shape)}, and has not")
        with self._archive.open(entry) as stream:
            array: Array = np.lib.format.read_array(stream, allow_pickle=False)
            stream.read(1)  # what checks the sum of all
        return array


# HDF5's library can crash on what is damaged, so a process of its own reads all of it first.
PROBE = """
import io, sys, h5py
left, kinds = int(sys.argv[1]), sys.argv[2]
def look(name, found):
    global left
    dict(found.attrs)
    if isinstance(found, h5py.Dataset) and found.dtype.kind in kinds and not found.external:
        left -= found.size * found.dtype.itemsize
        if left < 0:
            raise ValueError("its arrays are too large")
        found[()]
h5py.File(io.BytesIO(sys.stdin.buffer.read()), "r").visititems(look)
"""
PROBED = 120.0  # [s] that it may take


class TreeFile:
    """An HDF5 file, of which nothing is taken but what is asked for.

    Attributes:
        path: The file.
    """

    def __init__(self, path: str | Path, what: str) -> None:
        """Look what is in a file.

        Raises:
            ConfigError: If it is no such file.
            MissingPackageError: If h5py is not installed.
        """
        check_package("h5py", "reading HDF5", "data")
        import h5py  # type: ignore[import-untyped, unused-ignore]

        self.path, self._what, self._h5py, self._left = Path(path), what, h5py, LARGEST
        data = read_bytes(path, what)
        with refusing(path, what):
            words = (sys.executable, "-I", "-c", PROBE, str(LARGEST), PLAIN)
            done = subprocess.run(words, input=data, capture_output=True, timeout=PROBED)
            if done.returncode != 0:
                last = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
                raise ValueError(last[0] if last else "HDF5 cannot read it")
            self._file = h5py.File(io.BytesIO(data), "r")

    def names(self, group: str) -> tuple[str, ...]:
        """Return what is in a group; ConfigError if there is none."""
        with refusing(self.path, self._what):
            return tuple(self._found(group, self._h5py.Group))

    def take(self, *names: str) -> list[Array]:
        """Return arrays of numbers, texts or truth values by their full names; ConfigError if it cannot."""
        with refusing(self.path, self._what):
            return [self._array(name) for name in names]

    def attribute(self, group: str, name: str) -> str:
        """Return a text that is an attribute of a group; ConfigError if there is none."""
        with refusing(self.path, self._what):
            text = self._found(group, self._h5py.Group).attrs[name]
            if not isinstance(text, str):
                raise ValueError(f"{name} of {group} is no text")
            return text

    def _found(self, name: str, kind: Any) -> Any:
        place = self._file
        for part in filter(None, name.split("/")):
            if not isinstance(place, self._h5py.Group) or part not in place:
                raise ValueError(f"it lacks {shown(name)}")
            if not isinstance(place.get(part, getlink=True), self._h5py.HardLink):
                raise ValueError(f"{shown(name)} leads elsewhere")
            place = place[part]
        if not isinstance(place, kind):
            raise ValueError(f"{shown(name)} is {type(place).__name__}")
        return place

    def _array(self, name: str) -> Array:
        found = self._found(name, self._h5py.Dataset)
        if found.dtype.kind not in PLAIN or found.external or found.is_virtual:
            raise ValueError(f"{name} holds neither numbers nor texts of its own")
        self._left -= found.size * found.dtype.itemsize  # before memory is asked for
        if self._left < 0:
            raise ValueError(f"its arrays would have more than {LARGEST:,} bytes")
        return np.asarray(found[()])


def read_columns(path: str | Path, what: str, names: Sequence[str]) -> dict[str, Array]:
    """Return columns of numbers of a Parquet file by name, of lists as rows.

    Raises:
        ConfigError: If one is missing, damaged, or its lists differ in length.
        MissingPackageError: If pyarrow is not installed.
    """
    check_package("pyarrow", "reading Parquet", "data")
    import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]
    import pyarrow.parquet as pq  # type: ignore[import-untyped, unused-ignore]

    data = read_bytes(path, what)
    with refusing(path, what):
        file = pq.ParquetFile(pa.BufferReader(data))
        missing = [name for name in names if name not in file.schema_arrow.names]
        if missing:
            raise ValueError(f"it lacks {shown(', '.join(missing))}")
        parts = [file.metadata.row_group(i) for i in range(file.metadata.num_row_groups)]
        values = sum(p.column(i).num_values for p in parts for i in range(p.num_columns))
        if 8 * values > LARGEST or sum(p.total_byte_size for p in parts) > LARGEST:
            raise ValueError(f"its columns would have more than {LARGEST:,} bytes")
        table = file.read(columns=list(names), use_threads=False)
        table.validate(full=True)
        return {name: _column(table.column(name).combine_chunks(), name) for name in names}


def _column(found: Any, name: str) -> Array:
    rows = len(found)
    if found.null_count:
        raise ValueError(f"{name} has rows without a value")
    while hasattr(found.type, "value_type"):
        found = found.flatten()
    values = np.asarray(found.to_numpy(zero_copy_only=False))
    if values.dtype.kind not in NUMBERS + "b" or (rows and len(values) % rows):
        raise ValueError(f"{name} does not hold as many numbers in each row")
    return values.reshape(rows, -1) if rows and len(values) != rows else values


def check_numbers(arrays: Mapping[str, Array], where: str | Path, *, largest: float = 1e30) -> None:
    """Refuse arrays that do not hold finite real numbers of at most a size; ConfigError names one."""
    for name, array in arrays.items():
        if array.dtype.kind not in NUMBERS:
            raise ConfigError(f"{where}: {name} must hold numbers, got {array.dtype}")
        if array.size and not np.abs(array).max() <= largest:
            raise ConfigError(
                f"{where}: {name} must hold finite numbers of at most {largest:g}, got "
                f"{np.abs(array).max()}"
            )
