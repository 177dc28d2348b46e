"""Flesh around a bone as tetrahedra, made from the skin.

A segment is sampled in cylindrical coordinates: rays from the axis of the bone, at stations along it and
in sectors around it, meet the skin; layers of particles lie between a core and where they do. Each cell
of that grid is cut into five tetrahedra, in a chequered pattern so that neighbours share their diagonals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array
from rcare_marl.soft.tetrahedron import boundary, signed_volumes

from .segment import frame_along

Indices = npt.NDArray[np.int32]

CORE_LIMIT = 0.85  # of the skin's radius: no core is thicker, or the flesh would have no thickness
LEAST_RADIUS = 0.25  # of the median: rays that hit nearer have met a fold, not the skin
MOST_RADIUS = 1.9  # of the median

# Corners of a cell are numbered 4 layer + 2 sector + station.
_EVEN = ((0, 4, 2, 1), (6, 2, 4, 7), (5, 1, 4, 7), (3, 2, 1, 7), (1, 2, 4, 7))
_ODD = ((4, 0, 5, 6), (2, 0, 6, 3), (1, 0, 3, 5), (7, 6, 5, 3), (0, 6, 5, 3))


@dataclass(frozen=True, eq=False)
class Flesh:
    """Tetrahedra between a core and the skin, in the frame of a joint.

    Attributes:
        positions: Particles [m], shape [n, 3].
        tetrahedra: Particles of each tetrahedron, shape [t, 4].
        held: Particles on the core and at both ends, shape [h].
        outer: Particles on the skin by station and sector, shape [stations + 1, sectors].
        faces: Faces of the skin, counter-clockwise from outside, shape [m, 3].
        axis: Direction of the axis, shape [3].
        origin: Where stations are measured from [m], shape [3].
        across: Directions of the sectors 0 and a quarter turn on, shape [2, 3].
        stations: Place of each station along the axis [m], shape [stations + 1].
        core_radius: Mean radius of the core [m].
    """

    positions: Array
    tetrahedra: Indices
    held: Indices
    outer: Indices
    faces: Indices
    axis: Array
    origin: Array
    across: Array
    stations: Array
    core_radius: float


def make_flesh(
    skin: Array,
    faces: Indices,
    *,
    start: Array,
    end: Array,
    core: float,
    round_core: bool,
    sectors: int,
    stations: int,
    layers: int,
) -> Flesh:
    """Return the flesh of a segment.

    Args:
        skin: Vertices of the skin in the frame of the joint [m], shape [v, 3].
        faces: The faces that belong to the segment, shape [f, 3].
        start: Where the flesh begins on the axis [m], shape [3].
        end: Where it ends, shape [3].
        core: Radius of the core as a share of the skin's.
        round_core: Whether the core is a cylinder, as a bone is; else it has the skin's outline.
        sectors: Around the axis; even.
        stations: Cells along the axis.
        layers: Cells between core and skin.

    Raises:
        ConfigError: If a number is too small, or the skin is not there or folds over the core.
    """
    if sectors < 6 or sectors % 2 or stations < 2 or layers < 1:
        raise ConfigError(
            "flesh needs at least 6 sectors, an even number, 2 stations and 1 layer, got "
            f"{sectors}, {stations}, {layers}"
        )
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    across, directions = _around(axis, sectors)
    along = np.linspace(0.0, length, stations + 1)
    origins = start + along[:, None] * axis
    radii = _filled(_cast(skin, faces, origins, directions, axis))
    inner = np.full_like(radii, core * float(np.median(radii))) if round_core else core * radii
    inner = np.minimum(inner, CORE_LIMIT * radii)
    share = np.linspace(0.0, 1.0, layers + 1)[:, None, None]
    distance = inner + share * (radii - inner)  # layers + 1, stations + 1, sectors
    positions = origins[None, :, None] + distance[..., None] * directions
    grid = np.arange(distance.size).reshape(distance.shape)
    tetrahedra = _cut(grid)
    points = np.ascontiguousarray(positions.reshape(-1, 3))
    volumes = signed_volumes(points, tetrahedra)
    tetrahedra[volumes < 0] = tetrahedra[volumes < 0][:, [0, 2, 1, 3]]
    if np.abs(volumes).min() <= 0 or len(np.unique(np.sign(volumes.reshape(-1, 5)), axis=0)) > 2:
        raise ConfigError("the skin folds over the core: flesh cannot be made of this segment")
    held = np.unique(np.concatenate((grid[0].ravel(), grid[:, [0, -1]].ravel())))
    outer, skin_faces = grid[-1].astype(np.int32), boundary(tetrahedra)
    return Flesh(
        points,
        tetrahedra,
        held.astype(np.int32),
        outer,
        np.ascontiguousarray(skin_faces[(skin_faces >= outer.min()).all(axis=1)]),
        axis,
        start,
        across,
        along,
        float(inner.mean()),
    )


def centre_line(skin: Array, faces: Indices, start: Array, end: Array) -> tuple[Array, Array]:
    """Return start and end of the straight line through the middles of a segment's sections [m].

    Args:
        skin: Vertices of the skin [m], shape [v, 3].
        faces: The faces that belong to the segment, shape [f, 3].
        start: A point on the first section [m], shape [3].
        end: A point on the last section, shape [3].
    """
    axis = (end - start) / np.linalg.norm(end - start)
    directions = _around(axis, 24)[1]
    share = np.linspace(0.0, 1.0, 12)
    origins = start + share[:, None] * (end - start)
    radii = _filled(_cast(skin, faces, origins, directions, axis))
    # Centroid of a section cut into slices: each at two thirds of its radius, weighed by its area.
    middles = 2 / 3 * (radii**3 @ directions) / (radii**2).sum(axis=1, keepdims=True)
    slope, level = np.polyfit(share, middles, 1)
    return start + level, end + level + slope


def _around(axis: Array, sectors: int) -> tuple[Array, Array]:
    """Return two directions across an axis [2, 3], and `sectors` directions around it [sectors, 3]."""
    across = np.ascontiguousarray(frame_along(axis).T[:2])
    angles = 2 * np.pi * np.arange(sectors) / sectors
    return across, np.column_stack((np.cos(angles), np.sin(angles))) @ across


def _cut(grid: npt.NDArray[np.integer]) -> Indices:
    """Return the tetrahedra of all cells of a grid [layer, station, sector] that closes around."""
    layers, stations, sectors = (n - 1 for n in grid.shape)
    i, k, j = np.meshgrid(
        np.arange(layers), np.arange(stations), np.arange(sectors + 1), indexing="ij"
    )
    corners = [
        grid[i + p, k + s, (j + q) % (sectors + 1)] for p in (0, 1) for q in (0, 1) for s in (0, 1)
    ]
    cells = np.stack(corners, axis=-1).reshape(-1, 8)
    even = ((i + j + k) % 2 == 0).reshape(-1)
    out = np.where(even[:, None, None], cells[:, np.array(_EVEN)], cells[:, np.array(_ODD)])
    return np.ascontiguousarray(out.reshape(-1, 4), np.int32)


def _cast(skin: Array, faces: Indices, origins: Array, directions: Array, axis: Array) -> Array:
    """Return how far away the outermost skin is [m], shape [stations, sectors]; nan where none is.

    The crossing of ray and triangle is that of T. Möller and B. Trumbore, "Fast, Minimum Storage
    Ray/Triangle Intersection" (1997).
    """
    out = np.full((len(origins), len(directions)), np.nan)
    corners = skin[faces]
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    heights = corners @ axis
    for s, origin in enumerate(origins):
        level = float(origin @ axis)
        near = np.flatnonzero((heights.min(axis=1) <= level) & (heights.max(axis=1) >= level))
        if not len(near):
            continue
        to = origin - a[near]
        turned = np.cross(to, u[near])
        for k, direction in enumerate(directions):
            p = np.cross(direction, v[near])
            with np.errstate(divide="ignore", invalid="ignore"):
                scale = 1 / np.einsum("ij,ij->i", u[near], p)
                x = np.einsum("ij,ij->i", to, p) * scale
                y = turned @ direction * scale
                t = np.einsum("ij,ij->i", v[near], turned) * scale
                hit = (x >= -1e-9) & (y >= -1e-9) & (x + y <= 1 + 1e-9) & (t > 0)
            if hit.any():
                out[s, k] = float(t[hit].max())
    return out


def _filled(radii: Array) -> Array:
    """Return radii without holes and spikes: those are bridged along the axis, then around it."""
    if np.isfinite(radii).mean() < 0.5:
        raise ConfigError("less than half of the segment is covered by skin")
    typical = float(np.nanmedian(radii))
    with np.errstate(invalid="ignore"):
        wrong = ~((radii > LEAST_RADIUS * typical) & (radii < MOST_RADIUS * typical))
    out = np.where(wrong, np.nan, radii)
    rows = np.arange(len(out))
    for k in range(out.shape[1]):
        good = np.isfinite(out[:, k])
        if good.sum() >= 2:
            out[:, k] = np.interp(rows, rows[good], out[good, k])
    for s in range(len(out)):
        good = np.flatnonzero(np.isfinite(out[s]))
        if not len(good):
            raise ConfigError("a station of the segment has no skin at all")
        out[s] = np.interp(np.arange(out.shape[1]), good, out[s, good], period=out.shape[1])
    return out
