"""Mesh files of robot descriptions: found as ROS, Gazebo and Bullet do, and their convex hulls."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from urllib.parse import unquote

import numpy as np
from scipy.spatial import ConvexHull, QhullError  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError, shown
from rcare_marl.pose import Array
from rcare_marl.reading import LARGEST, check_numbers, check_regular, read_bytes, refusing

MOST_CORNERS = 96  # own choice: Bullet goes through all of them to look for contacts
MOST_OBJECTS = 64  # own choice: a file of more objects is a drawing, not a decomposition
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
        return next((path for path in self.candidates(name) if os.path.isfile(path)), None)

    def candidates(self, name: str) -> Iterator[Path]:
        """Yield the files that `name` may mean, most likely first."""
        name = name.strip().replace("\\", "/")
        scheme, _, rest = name.partition("://")
        if not rest:
            yield from self._above(name)
        elif scheme == "file":
            # file:///path is absolute; file://path, though wrong, is used as relative.
            for text in dict.fromkeys((rest, unquote(rest))):
                yield from self._above(text)
        elif scheme in ("package", "model"):
            package, _, inside = rest.partition("/")
            yield from self._in_package(package, inside)

    def _above(self, name: str = "") -> list[Path]:
        """Return a name in the description's folder and all above; an absolute one stays as it is."""
        return [folder / name for folder in (self._folder, *self._folder.parents)]

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
    if not os.path.isfile(path) or kind not in (".dae", ".obj"):
        return False
    data = read_bytes(path, "a mesh")
    if kind == ".dae":
        paint = re.search(rb"<diffuse[^>]*>\s*<(color|texture)", data)
        return paint is not None and b"<instance_material" in data
    library = re.search(rb"^mtllib[ \t]+(.+?)\s*$", data, re.MULTILINE)
    if library is None:
        return False
    return os.path.isfile(path.parent / library[1].decode(errors="replace"))


def _both(folder: Path, package: str, inside: str) -> Iterator[Path]:
    if folder.name == package:
        yield folder / inside
    yield folder / package / inside


def _listed(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def hulls(file: str | Path) -> tuple[Array, ...]:
    """Return the corners of the convex hulls of a mesh file, each of shape [n, 3], unscaled.

    There is one for each object of an OBJ of at most `MOST_OBJECTS`, which is how convex
    decompositions are kept and what Bullet makes of them, and one for any other file. A hull of
    more than `MOST_CORNERS` keeps those that stand out most.

    Raises:
        ConfigError: If the file cannot be read, or has no surface.
    """
    path = Path(file)
    stat = check_regular(path, "a mesh", most=LARGEST).stat()
    return _hulls(path, stat.st_mtime_ns, stat.st_size)


def hull_obj(corners: Array) -> str:
    """Return the hull of `corners`, shape [n, 3], as Wavefront OBJ text."""
    rows = [f"v {x:.8g} {y:.8g} {z:.8g}" for x, y, z in corners]
    # Bullet builds the hull from the corners that faces use: which faces does not matter.
    count = len(corners)
    rows += [f"f {i + 1} {(i + 1) % count + 1} {(i + 2) % count + 1}" for i in range(count)]
    return "\n".join(rows) + "\n"


@lru_cache(maxsize=512)
def _hulls(path: Path, changed: int, size: int) -> tuple[Array, ...]:
    with refusing(path, "a mesh"):
        clouds = _points(path)
        check_numbers({"a corner": np.concatenate([np.zeros((1, 3)), *clouds])}, path, largest=1e9)
    found = tuple(_corners(cloud) for cloud in clouds if len(cloud) >= 3)
    if not found:
        raise ConfigError(f"the mesh {path} has no surface")
    return found


def _points(path: Path) -> list[Array]:
    """Return the points that the surface of a file uses, one cloud for each hull."""
    if path.suffix.lower() == ".obj":
        return _obj_objects(path)
    if path.suffix.lower() == ".dae":
        from rcare_marl.rendering.collada import read_collada

        return [np.concatenate([part[0][np.unique(part[1])] for part in read_collada(path)])]
    import trimesh

    loaded = trimesh.load_mesh(path, process=False)
    return [np.asarray(loaded.vertices, np.float64)]


def _obj_objects(path: Path) -> list[Array]:
    vertices: list[list[float]] = []
    objects: list[set[int]] = [set()]
    for line in read_bytes(path, "a mesh").decode(errors="replace").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(word) for word in words[1:4]])
        elif words[0] in ("o", "g"):
            objects.append(set())
        elif words[0] == "f":
            for word in words[1:]:
                index = int(word.split("/")[0])
                index = index - 1 if index > 0 else len(vertices) + index
                if index < 0:
                    raise ConfigError(f"a face names a corner that is not there: {shown(word)}")
                objects[-1].add(index)
    points = np.array(vertices, np.float64).reshape(-1, 3)
    used = [sorted(indices) for indices in objects if indices]
    if len(used) > MOST_OBJECTS:
        used = [sorted(set().union(*used))]
    return [points[indices] for indices in used]


def _corners(points: Array) -> Array:
    points = np.unique(points, axis=0)
    try:
        corners = points[ConvexHull(points).vertices]
    except QhullError:  # flat: every point is a corner
        corners = points
    if len(corners) <= MOST_CORNERS:
        return corners
    # Those that reach farthest in directions spread evenly by the golden angle.
    count = MOST_CORNERS - 6
    step = np.arange(count) + 0.5
    z = 1 - 2 * step / count
    turn = np.pi * (1 + 5**0.5) * step
    ring = np.sqrt(1 - z**2)
    ways = np.stack((ring * np.cos(turn), ring * np.sin(turn), z), axis=1)
    span = np.maximum(np.ptp(corners, axis=0), 1e-9)
    spread = (corners - corners.mean(axis=0)) / span  # so that long parts keep their ends round
    axes = np.concatenate((ways, np.eye(3), -np.eye(3)))
    return corners[np.unique(np.argmax(spread @ axes.T, axis=0))]
