"""Generated files, such as URDFs: written once into the user's cache, named by what is in them."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from .atomic_file import draft, write_whole
from .errors import ConfigError


def cache_folder() -> Path:
    """Return the folder of generated files: `RCARE_MARL_CACHE`, or the platform's user cache."""
    chosen = os.environ.get("RCARE_MARL_CACHE")
    if chosen:
        return Path(chosen)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "rcare_marl"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home()))) / "rcare_marl" / "cache"
    return Path(os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))) / "rcare_marl"


def cached(name: str, suffix: str, content: str | bytes) -> Path:
    """Return a file in the cache that holds `content`, written now if it is not there yet.

    The file appears whole or not at all, so that two processes may ask for it at once.

    Args:
        name: Start of the file name, for a person who looks into the folder.
        suffix: End of the file name, such as `.urdf`.
        content: Text (UTF-8) or bytes.

    Raises:
        ConfigError: If the folder cannot be written.
    """
    data = content.encode() if isinstance(content, str) else content
    folder = cache_folder()
    plain = re.sub(r"\W+", "_", name)  # a name is no path
    file = folder / f"{plain}-{hashlib.sha256(data).hexdigest()[:16]}{suffix}"
    if file.is_file():
        return file
    with _writable(folder):
        write_whole(file, data)
    return file


def cached_file(name: str, suffix: str, recipe: bytes, make: Callable[[], bytes]) -> Path:
    """Return a file in the cache that holds what `make` returns, made now if it is not there yet.

    Like `cached`, for what takes long to make.

    Args:
        name: Start of the file name, for a person who looks into the folder.
        suffix: End of the file name, such as `.npz`.
        recipe: Everything that the content depends on; the file is named by its hash.
        make: Returns the content.

    Raises:
        ConfigError: If the folder cannot be written.
    """
    folder = cache_folder()
    file = folder / f"{name}-{hashlib.sha256(recipe).hexdigest()[:16]}{suffix}"
    if not file.is_file():
        content = make()
        with _writable(folder):
            write_whole(file, content)
    return file


def cached_folder(name: str, recipe: bytes, make: Callable[[], Mapping[str, str]]) -> Path:
    """Return a folder in the cache that holds what `make` returns, made now if it is not there yet.

    Like `cached`, for files that belong together and take long to make.

    Args:
        name: Start of the folder's name, for a person who looks into the cache.
        recipe: Everything that the files depend on; the folder is named by its hash.
        make: Returns the files, text by file name.

    Raises:
        ConfigError: If the folder cannot be written.
    """
    folder = cache_folder() / f"{name}-{hashlib.sha256(recipe).hexdigest()[:16]}"
    if folder.is_dir():
        return folder
    files = make()
    with _writable(folder), draft(folder) as made:
        for file, text in files.items():
            (made.path / file).write_text(text, encoding="utf-8")
        try:
            made.publish()
        except OSError:
            if not folder.is_dir():  # else another process was first: its files are the same
                raise
    return folder


@contextmanager
def _writable(folder: Path) -> Iterator[None]:
    """Say in an error what to do where a folder cannot be written."""
    try:
        yield
    except (ConfigError, OSError) as error:
        raise ConfigError(
            f"cannot write generated files to {folder}: {error}. Set RCARE_MARL_CACHE to a folder "
            "that you may write"
        ) from error
