"""Long hair: pieces that hang on the head joint, over a scalp that is already hairy."""

from __future__ import annotations

import numpy as np

from ..skeleton import JOINT_INDEX, JOINTS
from .head import Landmarks
from .mesh import Floats, Ints, WeightedMesh, noise, smoothstep
from .recipe import BodyRecipe


def hair_piece(
    scalp: WeightedMesh, marks: Landmarks, recipe: BodyRecipe
) -> tuple[WeightedMesh, Floats] | None:
    """Return the extra hair and its colours [k, 3], or nothing for cropped hair.

    Args:
        scalp: The finished head (hair already stands off it).
        marks: Its landmarks.
        recipe: Style, colour and seed.
    """
    style = recipe.hair.style
    if style == "bob":
        points, faces, strands = _bob(scalp, marks, recipe)
    elif style == "bun":
        centre = _on_scalp(scalp, marks, np.pi, 0.38) + [0.0, 0.004, -0.022]
        points, faces, strands = _ball(centre, np.array([0.043, 0.041, 0.035]), recipe.seed)
    elif style == "ponytail":
        root = _on_scalp(scalp, marks, np.pi, 0.25) + [0.0, 0.0, 0.016]
        points, faces, strands = _tail(root, recipe.seed)
    else:
        return None
    weights = np.zeros((len(points), len(JOINTS)))
    weights[:, JOINT_INDEX["head"]] = 1.0
    colors = np.asarray(recipe.hair.color, dtype=float) * (1 + 0.16 * strands[:, None])
    return WeightedMesh(points, faces, weights), colors


def _on_scalp(scalp: WeightedMesh, marks: Landmarks, azimuth: float, elevation: float) -> Floats:
    """Return the outermost point of the head in a direction from the skull's centre."""
    out = np.array(
        [
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
            np.cos(elevation) * np.cos(azimuth),
        ]
    )
    d = scalp.vertices[scalp.fields["hair"] > -0.04] - marks.skull
    return _outermost(d, marks, out[None])[0]


def _outermost(scalp: Floats, marks: Landmarks, rays: Floats) -> Floats:
    """Return the scalp's outermost points about unit rays [k, 3] from the skull's centre, shape [k, 3].

    Args:
        scalp: Points of the scalp from the skull's centre [m], shape [n, 3].
        marks: Landmarks of the head.
        rays: Directions.
    """
    length: Floats = np.linalg.norm(scalp, axis=1)
    near = (rays @ (scalp / np.maximum(length, 1e-9)[:, None]).T) > np.cos(np.radians(9.0))
    reach = np.where(near, length, 0.0).max(axis=1)
    return marks.skull + rays * np.where(near.any(axis=1), reach, 0.1)[:, None]


def _bob(scalp: WeightedMesh, marks: Landmarks, recipe: BodyRecipe) -> tuple[Floats, Ints, Floats]:
    """A shell from the crown to the chin, open at the face."""
    columns, rows = 56, 22
    edge = np.radians(56.0)
    azimuth = np.linspace(edge, 2 * np.pi - edge, columns)
    hem = marks.chin[1] + 0.012
    outer = np.zeros((rows, columns, 3))
    equator = int(rows * 0.6)
    elevation = np.radians(84.0 - 90.0 * np.arange(equator + 1) / equator)[:, None]
    rays = np.stack(
        [
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation) * np.ones(columns),
            np.cos(elevation) * np.cos(azimuth),
        ],
        axis=2,
    )
    hairy = scalp.vertices[scalp.fields["hair"] > -0.04] - marks.skull
    on_scalp = _outermost(hairy, marks, rays.reshape(-1, 3)).reshape(rays.shape)
    for c, angle in enumerate(azimuth):
        front = float(smoothstep(0.0, 0.5, np.array([min(angle, 2 * np.pi - angle) - edge]))[0])
        for r in range(equator + 1):
            thick = -0.004 + (0.008 + 0.009 * front) * min(1.0, r / (0.5 * equator))
            outer[r, c] = on_scalp[r, c] + thick * _unit(on_scalp[r, c] - marks.skull)
        last = outer[equator, c]
        for r in range(equator + 1, rows):
            t = (r - equator) / (rows - 1 - equator)
            inward = 1.0 + 0.05 * np.sin(np.pi * t) - 0.10 * t * t
            flat = marks.skull + (last - marks.skull) * [inward, 0.0, inward]
            outer[r, c] = [flat[0], last[1] + t * (hem + 0.012 * front - last[1]), flat[2]]
    for _ in range(4):  # even out the scan of the scalp
        outer[:, 1:-1] = 0.5 * outer[:, 1:-1] + 0.25 * (outer[:, :-2] + outer[:, 2:])
        outer[1:-1] = 0.5 * outer[1:-1] + 0.25 * (outer[:-2] + outer[2:])
    along = np.arange(columns)[None, :] * np.ones((rows, 1))
    across = np.stack([along * 0.31, along * 0, along * 0], -1).reshape(-1, 3)
    strand = noise(across, 1.0, recipe.seed)
    fall = np.linspace(0.3, 1.0, rows)[:, None] * np.ones((1, columns))
    away = _unit(outer - (marks.skull - [0.0, 0.03, 0.0]))
    outer += (0.0028 * strand * fall.reshape(-1)).reshape(rows, columns, 1) * away
    inner = outer - 0.007 * away
    points = np.concatenate([outer.reshape(-1, 3), inner.reshape(-1, 3)])
    grid = np.arange(rows * columns).reshape(rows, columns)
    behind = grid + rows * columns
    faces = [_sheet(grid), _sheet(behind)[:, ::-1]]
    for a, b in (
        (grid[0][::-1], behind[0][::-1]),
        (grid[-1], behind[-1]),
        (grid[:, 0], behind[:, 0]),
        (grid[:, -1][::-1], behind[:, -1][::-1]),
    ):
        faces.append(_sheet(np.stack([a, b])))
    return points, np.concatenate(faces), np.tile(strand, 2)


def _ball(centre: Floats, radii: Floats, seed: int) -> tuple[Floats, Ints, Floats]:
    rows, columns = 14, 24
    polar = np.linspace(0.0, np.pi, rows)[:, None]
    around = np.linspace(0.0, 2 * np.pi, columns, endpoint=False)[None, :]
    unit = np.stack(
        [
            np.sin(polar) * np.cos(around),
            np.sin(polar) * np.sin(around),
            np.cos(polar) * np.ones_like(around),
        ],
        axis=-1,
    ).reshape(-1, 3)
    swirl = np.sin(3 * np.arctan2(unit[:, 1], unit[:, 0]) + 7 * unit[:, 2])
    strands = 0.5 * swirl + 0.5 * noise(unit, 0.35, seed)
    points = centre + unit * radii * (1 + 0.035 * swirl[:, None])
    return points, _tube_faces(rows, columns), strands


def _tail(root: Floats, seed: int) -> tuple[Floats, Ints, Floats]:
    rows, columns = 18, 18
    t = np.linspace(0.0, 1.0, rows)
    path = root + np.stack(
        [
            0 * t,
            0.012 * np.sin(np.pi * np.minimum(t * 2, 1)) - 0.20 * t**1.6,
            -0.055 * np.sin(np.pi / 2 * np.minimum(t * 2.2, 1)) - 0.005 * t,
        ],
        axis=1,
    )
    along = _unit(np.gradient(path, axis=0))
    radius = np.interp(t, (0, 0.06, 0.12, 0.35, 0.8, 1), (0.004, 0.017, 0.015, 0.026, 0.018, 0.001))
    side = np.array([1.0, 0.0, 0.0])
    up = np.cross(along, side)
    around = np.linspace(0, 2 * np.pi, columns, endpoint=False)
    ring = np.cos(around)[None, :, None] * side + np.sin(around)[None, :, None] * up[:, None, :]
    strand = np.tile(noise(np.stack([around * 2, 0 * around, 0 * around], 1), 1.0, seed), rows)
    wave = 1 + 0.09 * strand.reshape(rows, columns, 1)
    points = path[:, None, :] + radius[:, None, None] * ring * wave
    return points.reshape(-1, 3), _tube_faces(rows, columns)[:, ::-1], strand


def _tube_faces(rows: int, columns: int) -> Ints:
    grid = np.arange(rows * columns).reshape(rows, columns)
    return _sheet(np.concatenate([grid, grid[:, :1]], axis=1))


def _sheet(grid: Ints) -> Ints:
    """Return two triangles for each cell of a grid of vertex indices."""
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    return np.concatenate(
        [np.stack([a, d, c], -1).reshape(-1, 3), np.stack([a, c, b], -1).reshape(-1, 3)]
    )


def _unit(vectors: Floats) -> Floats:
    length: Floats = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.maximum(length, 1e-12)
