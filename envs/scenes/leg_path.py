"""The way of a garment along a leg: where on it a ring of cloth is, and whether it goes round it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array, rotate

TOES = 0.09  # [m] that toes reach beyond the ball of the foot; our own choice
KNEE = (
    0.06  # [m] before and behind the knee where the front turns from shank to thigh; our own choice
)


class LegPath:
    """The middle line of a leg, from the toes over ankle and knee to the hip, as it is now.

    Attributes:
        side: `left` or `right`.
        points: Toes, ankle, knee and hip in the world [m], shape [4, 3].
        shank: From ankle to knee [m].
        thigh: From knee to hip [m].
    """

    def __init__(self, person: Human, side: str) -> None:
        """Take a spawned person and a side, `left` or `right`."""
        self._person, self.side = person, side
        self.points = np.zeros((4, 3))
        self.look()
        self.shank = float(np.linalg.norm(self.points[2] - self.points[1]))
        self.thigh = float(np.linalg.norm(self.points[3] - self.points[2]))

    def look(self) -> None:
        """See where the leg is now."""
        ankle = self._person.joint_pose(f"{self.side}_ankle")
        ball = self._person.joint_pose(f"{self.side}_foot")
        forward = rotate(ball.quaternion, (0.0, 0.0, 1.0))
        self.points[0] = np.add(ball.position, TOES * forward)
        self.points[1] = ankle.position
        for row, joint in ((2, "knee"), (3, "hip")):
            self.points[row] = self._person.joint_pose(f"{self.side}_{joint}").position

    def at(self, along: float) -> Array:
        """Return the point of the line so far from the ankle towards the hip [m], shape [3]."""
        _, ankle, knee, hip = self.points
        if along <= self.shank:
            return np.asarray(ankle + along / self.shank * (knee - ankle))
        return np.asarray(knee + (along - self.shank) / self.thigh * (hip - knee))

    def direction(self, along: float) -> Array:
        """Return where the line goes there, towards the hip, a unit vector, shape [3]."""
        _, ankle, knee, hip = self.points
        way = knee - ankle if along <= self.shank else hip - knee
        return np.asarray(way / np.linalg.norm(way))

    def front(self, along: float) -> Array:
        """Return where the front of the leg looks there, a unit vector, shape [3]."""
        share = min(max((along - self.shank) / (2 * KNEE) + 0.5, 0.0), 1.0)
        shank, thigh = self.direction(0.0), self.direction(self.shank + self.thigh)
        front = np.cross((0.0, 1.0, 0.0), (1 - share) * shank + share * thigh)
        return np.asarray(front / np.linalg.norm(front))

    def place(self, point: Array) -> float:
        """Return how far from the ankle the line is nearest to a point in the world [m]."""
        found: list[tuple[float, float]] = []
        for start, end, before in zip(
            self.points[:-1], self.points[1:], self._starts(), strict=True
        ):
            way = end - start
            length = float(np.linalg.norm(way))
            share = min(max(float((point - start) @ way) / length**2, 0.0), 1.0)
            gap = float(np.linalg.norm(start + share * way - point))
            found.append((gap, before + share * length))
        return min(found)[1]

    def _starts(self) -> tuple[float, float, float]:
        foot = float(np.linalg.norm(self.points[1] - self.points[0]))
        return -foot, 0.0, self.shank

    def crossings(self, ring: Array) -> tuple[int, float]:
        """Return how often the line goes through a ring of cloth, and where first.

        The ring is closed by a fan of triangles about its middle, and crossings count with their sign, so
        the number is how often the ring winds round the leg.

        Args:
            ring: Its particles in order [m], shape [n, 3].

        Returns:
            The winding number, and how far from the ankle the line goes through [m]; where the middle is
            nearest to the line if it does not.
        """
        middle, after = ring.mean(axis=0), np.roll(ring, -1, axis=0)
        count, places = 0, []
        for start, end, before in zip(
            self.points[:-1], self.points[1:], self._starts(), strict=True
        ):
            signs, shares = _pierced(start, end, middle, ring, after)
            count += int(signs.sum())
            places += (before + shares * np.linalg.norm(end - start)).tolist()
        return count, min(places, default=self.place(middle))


def _pierced(
    start: Array, end: Array, apex: Array, first: Array, second: Array
) -> tuple[npt.NDArray[np.int64], Array]:
    """Return the signs and places, 0 to 1, of the crossings of a segment and a fan of triangles."""
    a, b = first - apex, second - apex
    normals = np.cross(a, b)
    fall = normals @ (end - start)
    steep = np.where(np.abs(fall) < 1e-15, 1e-15, fall)
    share = normals @ (apex - start) / steep
    hit = start + share[:, None] * (end - start) - apex
    area = np.einsum("na,na->n", normals, normals)
    u = np.einsum("na,na->n", np.cross(hit, b), normals) / np.maximum(area, 1e-18)
    v = np.einsum("na,na->n", np.cross(a, hit), normals) / np.maximum(area, 1e-18)
    # Half-open, so that what goes through an edge counts once.
    met = (share >= 0) & (share < 1) & (u >= 0) & (v > 0) & (u + v <= 1)
    return np.sign(fall[met]).astype(np.int64), share[met]
