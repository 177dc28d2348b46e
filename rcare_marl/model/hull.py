"""Convex hulls of mesh files: what a mesh collides with."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

MOST_CORNERS = 96  # own choice: Bullet goes through all of them to look for contacts
MOST_OBJECTS = 64  # own choice: a file of more objects is a drawing, not a decomposition


def hulls(file: str | Path) -> tuple[Array, ...]:
    """Return the corners of the convex hulls of a mesh file, each of shape [n, 3], unscaled.

    There is one for each object of an OBJ of at most `MOST_OBJECTS`, which is how convex
    decompositions are kept and what Bullet makes of them, and one for any other file. A hull of
    more than `MOST_CORNERS` keeps those that stand out most.

    Raises:
        ConfigError: If the file cannot be read, or has no surface.
    """
    path = Path(file)
    stat = path.stat()
    return _hulls(path, stat.st_mtime_ns, stat.st_size)


def obj(corners: Array) -> str:
    """Return the hull of `corners`, shape [n, 3], as Wavefront OBJ text."""
    rows = [f"v {x:.8g} {y:.8g} {z:.8g}" for x, y, z in corners]
    # Bullet builds the hull from the corners that faces use: which faces does not matter.
    count = len(corners)
    rows += [f"f {i + 1} {(i + 1) % count + 1} {(i + 2) % count + 1}" for i in range(count)]
    return "\n".join(rows) + "\n"


@lru_cache(maxsize=512)
def _hulls(path: Path, changed: int, size: int) -> tuple[Array, ...]:
    try:
        clouds = _points(path)
    except (ValueError, KeyError, IndexError, OSError, NotImplementedError) as error:
        raise ConfigError(f"cannot read the mesh {path}: {error}") from error
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
    with path.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
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
                    objects[-1].add(index - 1 if index > 0 else len(vertices) + index)
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
