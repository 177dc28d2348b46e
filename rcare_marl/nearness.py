"""How near bodies are to each other: boxes first, and Bullet's search only where they are near.

Bullet searches every pair of links that it is asked about, however far apart. A robot of twelve links and
a person of fifty are 600 pairs, of which a handful are near, if any.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numba
import numpy as np
import pybullet as bullet

from .pose import Array

if TYPE_CHECKING:
    from .body import Body

ALL_LINKS = -2  # where Bullet asks for one
SLACK = 1e-3  # [m] by which we think boxes nearer than they are: shapes have margins; our own choice
WAY = 0.02  # [m] that something comes nearer or goes in a control step, mostly
FEW = 8  # pairs of links up to which it is faster to ask for each of them; measured


class LinkBoxes:
    """The boxes round the collision shapes of a body's links, along the axes of the world.

    Attributes:
        links: The links that have a shape.
        places: Where each of them is in that list.
    """

    def __init__(self, body: Body, client: int) -> None:
        """Take a body of a physics client."""
        self.links = body.solid_links()
        self.places = {link: i for i, link in enumerate(self.links)}
        self._uid, self._client = body.uid, client
        moved = set(self.links)
        if not body.is_movable:
            moved = {link for j in body.joints.values() for link in body.carried_by(j.index)}
        self._moving = [i for i, link in enumerate(self.links) if link in moved]
        self._boxes = np.zeros((len(self.links), 6))
        self._seen = self._placed = -1

    def read(self, steps: int, teleports: int) -> Array:
        """Return lower and upper corner of each box [m], shape [links, 6]; do not write into it.

        Args:
            steps: Physics steps of the world so far: without one more, nothing has moved by itself.
            teleports: How often a body was put elsewhere: without one more, what no joint carries is
                still in place, and there was no `rewind`.
        """
        if teleports != self._placed:
            self._take(range(len(self.links)))
        elif steps != self._seen:
            self._take(self._moving)
        self._seen, self._placed = steps, teleports
        return self._boxes

    def _take(self, places: Sequence[int]) -> None:
        if places:
            box, uid, client = bullet.getAABB, self._uid, self._client
            found = [box(uid, self.links[i], client) for i in places]
            self._boxes[places] = [(*low, *high) for low, high in found]


class Nearness:
    """Distances between the bodies of one physics client."""

    def __init__(self, client: int) -> None:
        self._client = client
        self._bodies: dict[int, LinkBoxes] = {}

    def boxes(self, body: Body) -> LinkBoxes:
        """Return the boxes of a body; it keeps its shapes as long as the client lasts."""
        if body.uid not in self._bodies:
            self._bodies[body.uid] = LinkBoxes(body, self._client)
        return self._bodies[body.uid]

    def gaps(
        self,
        movers: Sequence[tuple[Body, int]],
        other: Body,
        *,
        within: float,
        before: Sequence[float],
        steps: int,
        teleports: int,
    ) -> list[float]:
        """Return the distance of single links from a body [m], each `within` at most.

        Args:
            movers: The links, each with its body.
            other: The body.
            within: How far to look [m].
            before: What the distances were a short while ago [m], as a hint; or nothing.
            steps: See `LinkBoxes.read`; likewise `teleports`.
        """
        out = [within] * len(movers)
        if not movers:
            return out
        theirs = self.boxes(other)
        seen = theirs.read(steps, teleports)
        own = np.empty((len(movers), 6))
        for i, (body, link) in enumerate(movers):
            boxes = self.boxes(body)
            own[i] = boxes.read(steps, teleports)[boxes.places[link]]
        between = _box_gaps(own, seen)
        for i in np.flatnonzero(between.min(axis=1, initial=np.inf) < within + SLACK).tolist():
            body, link = movers[i]
            near = np.flatnonzero(between[i] < within + SLACK).tolist()
            links = [theirs.links[k] for k in near] if len(near) <= FEW else [ALL_LINKS]
            found = hint = before[i] + WAY if i < len(before) else within
            if hint < within:  # the farther Bullet looks, the longer it takes
                found = min([self.exact(body, other, hint, link, each) for each in links])
            if found >= hint:
                found = min([self.exact(body, other, within, link, each) for each in links])
            out[i] = found
        return out

    def exact(self, a: Body, b: Body, within: float, link_a: int, link_b: int) -> float:
        """Return the distance between links, or bodies, as Bullet finds it [m], `within` at most."""
        points = bullet.getClosestPoints(
            a.uid, b.uid, within, link_a, link_b, physicsClientId=self._client
        )
        return min([within, *[point[8] for point in points]]) if points else within


@numba.njit(cache=True)
def _box_gaps(a, b):  # type: ignore[no-untyped-def]
    """Return the distance of each box of `a` [n, 6] from each of `b` [m, 6], shape [n, m]."""
    out = np.empty((len(a), len(b)))
    for i in range(len(a)):
        for k in range(len(b)):
            total = 0.0
            for axis in range(3):
                gap = max(a[i, axis] - b[k, axis + 3], b[k, axis] - a[i, axis + 3], 0.0)
                total += gap * gap
            out[i, k] = np.sqrt(total)
    return out


__all__ = ["LinkBoxes", "Nearness"]
