"""Finds the mesh files that a robot description names, as ROS, Gazebo and Bullet do."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from urllib.parse import unquote

from rcare_marl.errors import ConfigError

DRAWN = (".obj", ".stl", ".dae")  # what Bullet and our renderers read


class MeshPath:
    """Turns names of meshes into files.

    `package://NAME/REST` is looked for in the folders that the user gave, then in a package folder
    `NAME` above or beside the description, then below ROS_PACKAGE_PATH and AMENT_PREFIX_PATH, and
    last as `REST` in a folder above, for a package that was unpacked under another name.
    """

    def __init__(self, description: str | Path, packages: Iterable[str | Path] = ()) -> None:
        """Look from the file `description`, and in `packages`: package folders or their parents."""
        self._folder = Path(description).resolve().parent
        self._given = [Path(package).resolve() for package in packages]

    def find(self, name: str) -> Path | None:
        """Return the file that is meant by `name`, or None."""
        return next((path for path in self.candidates(name) if path.is_file()), None)

    def candidates(self, name: str) -> Iterator[Path]:
        """Yield the files that `name` may mean, most likely first."""
        name = name.strip().replace("\\", "/")
        scheme, _, rest = name.partition("://")
        if not rest:
            yield from self._relative(name)
        elif scheme == "file":
            # file:///path is absolute; file://path, though wrong, is used as relative.
            for text in dict.fromkeys((rest, unquote(rest))):
                yield from self._relative(text)
        elif scheme in ("package", "model"):
            package, _, inside = rest.partition("/")
            yield from self._in_package(package, inside)

    def _above(self) -> list[Path]:
        return [self._folder, *self._folder.parents]

    def _relative(self, name: str) -> Iterator[Path]:
        for folder in self._above():  # an absolute name replaces the folder
            yield folder / name

    def _in_package(self, package: str, inside: str) -> Iterator[Path]:
        for given in self._given:
            yield from _both(given, package, inside)
        for folder in self._above():
            yield from _both(folder, package, inside)
        for entry in _listed("ROS_PACKAGE_PATH"):
            yield from _both(entry, package, inside)
        for entry in _listed("AMENT_PREFIX_PATH"):
            yield entry / "share" / package / inside
        for folder in (*self._given, *self._above()):
            yield folder / inside

    def looked_in(self, name: str) -> str:
        """Return where the file was looked for, for people."""
        scheme, _, rest = name.partition("://")
        if scheme in ("package", "model"):
            package = rest.partition("/")[0]
            given = "".join(f"{folder}, " for folder in self._given)
            return (
                f"{given}package folder {package!r} above {self._folder}, ROS_PACKAGE_PATH and "
                "AMENT_PREFIX_PATH"
            )
        if rest and scheme != "file":
            return f"nowhere: {scheme}:// is not fetched, only package://, model:// and file://"
        return f"{self._folder} and the folders above"


def stamp(files: Iterable[str]) -> bytes:
    """Return what changes when one of the files does.

    Raises:
        ConfigError: If one is not there.
    """
    out = []
    for file in sorted(set(files)):
        try:
            stat = os.stat(file)
        except OSError as error:
            raise ConfigError(f"no mesh at {file}: {error.strerror}") from error
        out.append(f"{file} {stat.st_mtime_ns} {stat.st_size}")
    return "\n".join(out).encode()


def has_colors(file: str | Path) -> bool:
    """Return whether a mesh file says what colour it is."""
    path = Path(file)
    kind = path.suffix.lower()
    if not path.is_file() or kind not in (".dae", ".obj"):
        return False
    data = path.read_bytes()
    if kind == ".dae":
        paint = re.search(rb"<diffuse[^>]*>\s*<(color|texture)", data)
        return paint is not None and b"<instance_material" in data
    library = re.search(rb"^mtllib[ \t]+(.+?)\s*$", data, re.MULTILINE)
    if library is None:
        return False
    return (path.parent / library[1].decode(errors="replace")).is_file()


def _both(folder: Path, package: str, inside: str) -> Iterator[Path]:
    if folder.name == package:
        yield folder / inside
    yield folder / package / inside


def _listed(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
