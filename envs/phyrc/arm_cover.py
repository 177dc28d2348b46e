"""How far a sleeve is on an arm: which slices of the arm cloth goes round."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array

from ..scenes.leg_path import pierced

SLICE = 0.05  # [m]: the challenge's scene
NEAR = 0.05  # [m] from the skin of the arm, where cloth counts as on it: the challenge's scene
LOOSE = 0.16  # [m] from the middle of the arm, where cloth that goes round it hangs; own choice
# Between neighbours round the arm: cloth that only lies on it leaves half a turn open; own choice.
LARGEST_GAP = math.radians(150)


class ArmCover:
    """The slices of one arm from wrist to shoulder, and cloth round them.

    Attributes:
        ends: Wrist, elbow and shoulder in the world [m], shape [3, 3].
        count: How many slices there are.
        shoulder_radius: Of the arm at the shoulder [m].
    """

    def __init__(self, person: Human, side: str) -> None:
        """Take the arm of a spawned person; `left` or `right`."""
        self._person, self._joints = person, [f"{side}_{j}" for j in ("wrist", "elbow", "shoulder")]
        segments = [person.segments[f"{side}_{joint}"].shapes[0] for joint in ("elbow", "shoulder")]
        self._radii = [shape.size[1] for shape in segments]
        self.shoulder_radius = self._radii[1]
        self.follow()
        lengths = np.linalg.norm(np.diff(self.ends, axis=0), axis=1)
        self._counts = [max(round(float(length) / SLICE), 1) for length in lengths]
        self.count = sum(self._counts)

    def follow(self) -> None:
        """See where the arm is now."""
        self.ends = np.array([self._person.joint_pose(j).position for j in self._joints])

    def slices(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which slices cloth goes round, from the wrist upwards, shape [count].

        A slice counts where some cloth in it is as near to the skin as `NEAR`, and seen from the middle of
        the arm no gap between its particles is wider than `LARGEST_GAP`.

        Args:
            points: Particles of the cloth [m], shape [n, 3].
        """
        found = []
        for start, end, radius, count in zip(
            self.ends[:-1], self.ends[1:], self._radii, self._counts, strict=True
        ):
            along, out, distance = _seen(points, start, end)
            place = np.floor(along * count).astype(np.int64)
            angle = np.arctan2(out[:, 1], out[:, 0])
            loose = distance < LOOSE
            for k in range(count):
                # Threads are as long as a slice: half of each neighbour is looked at too.
                here = loose & (np.abs(along * count - k - 0.5) < 1.0)
                near = (place == k) & (distance < radius + NEAR)
                found.append(bool(near.any()) and widest_gap(angle[here]) < LARGEST_GAP)
        return np.array(found)

    def near(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which points are within `NEAR` of the skin of the arm, shape [n]."""
        out = np.zeros(len(points), np.bool_)
        for start, end, radius in zip(self.ends[:-1], self.ends[1:], self._radii, strict=True):
            along, _, distance = _seen(points, start, end)
            out |= (along >= 0) & (along <= 1) & (distance < radius + NEAR)
        return out

    def is_round(self, ring: Array) -> bool:
        """Return whether a ring of cloth goes round the arm somewhere between wrist and shoulder.

        Args:
            ring: Its particles in order [m], shape [n, 3].
        """
        middle, after = ring.mean(axis=0), np.roll(ring, -1, axis=0)
        parts = zip(self.ends[:-1], self.ends[1:], strict=True)
        return sum(pierced(*part, middle, ring, after)[0].sum() for part in parts) != 0


def widest_gap(angles: Array) -> float:
    """Return the widest angle between neighbours on a circle [rad]; a full turn for less than two."""
    if len(angles) < 2:
        return 2 * math.pi
    order = np.sort(angles)
    return float(np.diff(np.append(order, order[0] + 2 * math.pi)).max())


def _seen(points: Array, start: Array, end: Array) -> tuple[Array, Array, Array]:
    """Return how far points are along a segment as a share, and about it: across [m], distance [m]."""
    way = end - start
    length = float(np.linalg.norm(way))
    axis = way / length
    side = np.cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    local = points - start
    out = np.column_stack((local @ side, local @ np.cross(axis, side)))
    return local @ way / length**2, out, np.linalg.norm(out, axis=1)
