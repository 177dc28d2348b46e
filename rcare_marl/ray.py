"""Rays through a world: how far it is to what they meet."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt
import pybullet as bullet

from .body import Body
from .pose import Array, Vector
from .world import World

MOST_HITS = 256  # of one ray that are looked through
BATCH = bullet.MAX_RAY_INTERSECTION_BATCH_SIZE
NEAREST = -1  # Bullet's number of a ray's first hit; the others have no certain order


def ray_distances(
    world: World,
    origin: Vector,
    directions: Array,
    reach: float,
    unseen: Collection[Body] = (),
) -> Array:
    """Return how far it is along each ray to the nearest collision shape [m], shape [n].

    Args:
        world: The world.
        origin: Where all rays begin, in the world [m], shape [3]. A shape around it is not met.
        directions: Unit vectors in the world, shape [n, 3].
        reach: Length of the rays [m], the answer where nothing is met.
        unseen: Bodies that rays go through.
    """
    starts = np.tile(np.asarray(origin, np.float64), (len(directions), 1))
    ends = starts + reach * directions
    hidden = {body.uid for body in unseen}
    out = np.full(len(directions), float(reach))
    rays, number = np.arange(len(directions)), NEAREST
    while len(rays) and number < MOST_HITS:
        through = []
        for ray, (body, share) in zip(rays, _hits(world, starts, ends, rays, number), strict=True):
            if body >= 0 and body not in hidden:
                out[ray] = min(out[ray], share * reach)
            # What lies behind a hidden body is found by looking at all hits of the ray.
            if body in hidden or (number != NEAREST and body >= 0):
                through.append(ray)
        rays, number = np.array(through, np.int64), number + 1
    return out


def _hits(
    world: World, starts: Array, ends: Array, rays: npt.NDArray[np.int64], number: int
) -> list[tuple[int, float]]:
    """Return body, -1 for none, and share of the way of a hit of each of `rays`."""
    found: list[tuple[int, float]] = []
    for at in range(0, len(rays), BATCH):
        part = rays[at : at + BATCH]
        rows = bullet.rayTestBatch(
            starts[part].tolist(),
            ends[part].tolist(),
            reportHitNumber=number,
            physicsClientId=world.client,
        )
        found.extend((row[0], row[2]) for row in rows)
    return found
