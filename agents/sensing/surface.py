"""Points spread evenly over surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, matrix_from_quaternion
from rcare_marl.rendering.mesh import shape_mesh

CONVEX = ("box", "sphere", "cylinder", "capsule")
DENSITY = 20  # candidates in a square of one spacing
MOST = 4000  # points on one surface
INSIDE = 5e-4  # [m] within another shape, from where a point is not on the outside


def spread(corners: Array, spacing: float, hulls: Sequence[Array] = ()) -> tuple[Array, Array]:
    """Return points on triangles, at least `spacing` [m] apart, that leave no larger hole, and their normals.

    Each point is put where the others are farthest (farthest point sampling, Eldar and others,
    1997), so the same surface always gets the same points.

    Args:
        corners: Of the triangles [m], counter-clockwise from outside, shape [t, 3, 3].
        spacing: Distance between neighbours [m].
        hulls: Planes of convex shapes, see `hull_planes`; what lies inside one is left out.

    Raises:
        ConfigError: If there would be more than `MOST` points, or none.
    """
    places, normals = _candidates(corners, spacing)
    keep = np.ones(len(places), np.bool_)
    for planes in hulls:
        depth = (places @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        keep &= depth > -INSIDE
    places, normals = places[keep], normals[keep]
    if not len(places):
        raise ConfigError("there is no surface to put points on")
    chosen = [int(np.argmax(places[:, 0]))]
    gaps = np.linalg.norm(places - places[chosen[0]], axis=1)
    while gaps.max() > spacing:
        if len(chosen) >= MOST:
            raise ConfigError(
                f"a spacing of {spacing} m needs more than {MOST} points: choose a greater one"
            )
        chosen.append(int(np.argmax(gaps)))
        np.minimum(gaps, np.linalg.norm(places - places[chosen[-1]], axis=1), out=gaps)
    return places[chosen], normals[chosen]


def _candidates(corners: Array, spacing: float) -> tuple[Array, Array]:
    """Return many points, as dense everywhere, and the normals of their triangles."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    cross = np.cross(b - a, c - a)
    doubled = np.linalg.norm(cross, axis=1)
    total = doubled.sum() / 2
    count = max(int(DENSITY * total / spacing**2), 200)
    if count > 4 * DENSITY * MOST:
        raise ConfigError(
            f"a spacing of {spacing} m needs more than {MOST} points: choose a greater one"
        )
    triangle = np.searchsorted(np.cumsum(doubled), (np.arange(count) + 0.5) / count * 2 * total)
    triangle = np.minimum(triangle, len(a) - 1)
    # The R2 sequence (Roberts 2018): even in the square, folded into the triangle.
    u, v = ((0.5 + np.arange(count) * step) % 1 for step in (0.7548776662, 0.5698402910))
    over = u + v > 1
    u, v = np.where(over, 1 - u, u)[:, None], np.where(over, 1 - v, v)[:, None]
    at = triangle
    places = a[at] + u * (b - a)[at] + v * (c - a)[at]
    return places, cross[at] / doubled[at, None]


def hull_planes(hull: ConvexHull) -> Array:
    """Return outward unit normals and offsets of a hull, shape [p, 4]; inside is negative."""
    return np.unique(np.round(hull.equations, 9), axis=0)


def spread_over_link(body: Body, link: int, spacing: float) -> tuple[Array, Array]:
    """Return points and normals on the outside of the collision shapes of a link, in its frame.

    Raises:
        ConfigError: If it has no shapes, or there would be too many points.
    """
    pieces, hulls = [], []
    for place, shape in enumerate(body.collision_shapes(link)):
        mesh = None
        if shape.kind != "mesh":
            mesh = shape_mesh(shape) if shape.kind in CONVEX else None
        elif Path(shape.mesh).is_file():
            mesh = shape_mesh(shape)
        if mesh is not None:
            turn = matrix_from_quaternion(shape.pose.quaternion)
            vertices = mesh.vertices.astype(np.float64) @ turn.T + shape.pose.position
        else:
            vertices = body.hull_points(link, place)
        if len(vertices):
            hull = ConvexHull(vertices)  # Bullet collides with hulls of meshes
            pieces.append(vertices[_outward(vertices, hull)])
            hulls.append(hull_planes(hull))
    if not pieces:
        raise ConfigError("there are no shapes to put points on")
    return spread(np.concatenate(pieces), spacing, hulls)


def _outward(vertices: Array, hull: ConvexHull) -> npt.NDArray[np.int64]:
    faces = np.array(hull.simplices, np.int64)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    wrong = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    faces[wrong] = faces[wrong][:, ::-1]
    return faces
