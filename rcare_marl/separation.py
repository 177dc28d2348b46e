"""How near bodies are to each other: boxes first, and Bullet's search only where they are near.

Bullet looks at every pair of links that it is asked about, however far apart they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np

from rcare_marl.bullet import bullet

from .pose import Array, Pose, Vector, matrix_from_quaternion

if TYPE_CHECKING:
    from .body import Body
    from .body_part import VisualShape

ALL_LINKS = -2  # where Bullet asks for one
SLACK = (
    1e-3  # [m] by which we think boxes nearer than they are: shapes have margins; our own choice
)
WAY = 0.02  # [m] that things go in a control step, mostly; our own choice
FEW = 8  # links, and half of all, up to which it is faster to ask for each; our own choice
ROUND = ("box", "capsule", "sphere")  # shapes whose boxes we know


class Near(NamedTuple):
    """Where a link of a body is near something else.

    Attributes:
        link: Index of the link.
        other: Index of the link of the other.
        point: Where on the first, in the world [m].
        away: Direction from the other to the link there, of length 1.
        gap: How far that is [m], negative in overlap.
        coming: How fast the other comes that way [m/s].
    """

    link: int
    other: int
    point: tuple[float, float, float]
    away: tuple[float, float, float]
    gap: float
    coming: float


class LinkBoxes:
    """The boxes round the collision shapes of a body, along the axes of the world.

    A link that moves has one box. One that stays has one for each shape: a person's trunk and legs may
    be a single link, and its box is mostly air.

    Attributes:
        links: The links that have a shape.
        owners: Place in `links` for each box.
    """

    def __init__(self, body: Body, client: int) -> None:
        """Take a body of a physics client; it keeps its shapes from now on."""
        self._body, self._uid, self._client = body, body.uid, client
        self.links = body.solid_links()
        moved = set(self.links)
        if not body.is_movable:
            moved = {link for j in body.joints.values() for link in body.carried_by(j.index)}
        self._moving = [link for link in self.links if link in moved]
        self._shapes = {
            link: body.collision_shapes(link) for link in self.links if link not in moved
        }
        owners = [self.links.index(link) for link in self._moving]
        for link, shapes in self._shapes.items():
            count = len(shapes) if _are_round(shapes) else 1
            owners += [self.links.index(link)] * count
        self.owners = np.array(owners, np.int64)
        self._boxes = np.zeros((len(owners), 6))
        self._seen = self._placed = -1
        self._base: object = None  # where it was as the boxes of what stays were found

    def read(self, steps: int, teleports: int) -> Array:
        """Return lower and upper corner of each box [m], shape [boxes, 6]; do not write into it.

        Args:
            steps: Physics steps of the world so far: without one more, nothing has moved by itself.
            teleports: How often a body was put elsewhere: without one more, what no joint carries is
                still in place, and there was no `rewind`.
        """
        is_elsewhere = teleports != self._placed
        if self._moving and (is_elsewhere or steps != self._seen):
            self._boxes[: len(self._moving)] = [self._box(link) for link in self._moving]
        # Most that is put elsewhere is another body: what no joint carries stays on the base.
        base = self._body.centre_pose() if is_elsewhere and self._shapes else self._base
        if base != self._base:
            rows: list[Sequence[float]] = []
            for link, shapes in self._shapes.items():
                if _are_round(shapes):
                    pose = self._body.link_pose(link)
                    rows += [box_of(shape, pose @ shape.pose) for shape in shapes]
                else:
                    rows.append(self._box(link))
            self._boxes[len(self._moving) :] = rows
            self._base = base
        self._seen, self._placed = steps, teleports
        return self._boxes

    def _box(self, link: int) -> tuple[float, ...]:
        low, high = bullet.getAABB(self._uid, link, self._client)
        return (*low, *high)


class SeparationQuery:
    """Distances between the bodies of one physics client."""

    def __init__(self, client: int) -> None:
        self._client = client
        self._bodies: dict[int, LinkBoxes] = {}

    def boxes(self, body: Body) -> LinkBoxes:
        """Return the boxes of a body."""
        if body.uid not in self._bodies:
            self._bodies[body.uid] = LinkBoxes(body, self._client)
        return self._bodies[body.uid]

    def gaps(
        self,
        movers: Sequence[tuple[Body, int]],
        other: Body,
        within: float,
        before: Sequence[float],
        moment: tuple[int, int],
    ) -> list[float]:
        """Return the distance of single links from a body [m], each `within` at most.

        Args:
            movers: The links, each with its body; they have collision shapes.
            other: The body.
            within: How far to look [m].
            before: What the distances were a short while ago [m], as a hint; or nothing.
            moment: Physics steps and teleports so far, see `LinkBoxes.read`.
        """
        out = [within] * len(movers)
        theirs = self.boxes(other)
        if not movers or not theirs.links:
            return out
        box, client = bullet.getAABB, self._client
        own = np.array([box(body.uid, link, client) for body, link in movers])
        seen = theirs.read(*moment)
        for i, k in _near(own, seen, theirs.owners, len(theirs.links), within + SLACK).tolist():
            body, link = movers[i]
            other_link = ALL_LINKS if k < 0 else theirs.links[k]
            # The farther Bullet looks, the longer it takes: look no farther than it can be by now.
            hint = before[i] + WAY if before else within
            found = self.exact(body, other, hint, link, other_link) if hint < within else hint
            if found >= hint:
                found = self.exact(body, other, within, link, other_link)
            out[i] = min(out[i], found)
        return out

    def exact(self, a: Body, b: Body, within: float, link_a: int, link_b: int) -> float:
        """Return the distance between links, or bodies, as Bullet finds it [m], `within` at most."""
        points = bullet.getClosestPoints(
            a.uid, b.uid, within, link_a, link_b, physicsClientId=self._client
        )
        return min([within, *[point[8] for point in points]]) if points else within

    def near(self, a: Body, b: Body, within: float, link_a: int, link_b: int) -> list[Near]:
        """Return where links of `a`, or one, are no farther than `within` [m] from those of `b`, or one."""
        points = bullet.getClosestPoints(
            a.uid, b.uid, within, link_a, link_b, physicsClientId=self._client
        )
        moved = {link: np.array(b.centre_state(link)) for link in {p[4] for p in points or ()}}
        return [
            Near(p[3], p[4], p[5], p[7], p[8], _speed_along(p[7], p[5], moved[p[4]]))
            for p in points or ()
        ]


def _speed_along(way: Vector, point: Vector, state: Array) -> float:
    """Return how fast a point [m] of a link goes along a way [m/s]; see `Body.centre_state`."""
    velocity = state[7:10] + np.cross(state[10:], np.subtract(point, state[:3]))
    return float(velocity @ np.array(way))


def _are_round(shapes: Sequence[VisualShape]) -> bool:
    return all(shape.kind in ROUND for shape in shapes)


def box_of(shape: VisualShape, pose: Pose) -> tuple[float, ...]:
    """Return lower and upper corner of the box round a shape that is at `pose` in the world [m]."""
    turn, size = matrix_from_quaternion(pose.quaternion), shape.size
    if shape.kind == "box":
        half = np.abs(turn) @ np.multiply(0.5, size)
    elif shape.kind == "capsule":
        half = np.abs(turn[:, 2]) * 0.5 * size[0] + size[1]
    else:
        half = np.full(3, size[0])
    return (*(pose.position - half).tolist(), *(pose.position + half).tolist())


@numba.njit(cache=True)
def _near(a, b, owners, count, reach):  # type: ignore[no-untyped-def]
    """Return pairs (place in `a`, link of `b`) that are nearer than `reach`, shape [n, 2].

    Boxes are `a` of shape [n, 2, 3] and `b` of shape [m, 6]. A link of -1 stands for all of them, where
    more than `FEW`, or half of the `count`, are near.
    """
    pairs = np.empty((len(a) * count, 2), np.int64)
    found = 0
    for i in range(len(a)):
        first = found
        for k in range(len(b)):
            total = 0.0
            for axis in range(3):
                gap = max(a[i, 0, axis] - b[k, axis + 3], b[k, axis] - a[i, 1, axis], 0.0)
                total += gap * gap
            if total >= reach * reach:
                continue
            is_known = False
            for pair in range(first, found):
                is_known |= pairs[pair, 1] == owners[k]
            if not is_known:
                pairs[found, 0], pairs[found, 1] = i, owners[k]
                found += 1
        if found - first > min(FEW, max(count // 2, 1)):
            pairs[first, 1], found = -1, first + 1
    return pairs[:found]
