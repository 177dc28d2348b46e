"""A mouth that something is brought to."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array

RADIUS = 0.03  # [m] what comes within this of the mouth goes in: Assistive Gym, feeding.py
OPEN = math.radians(10)  # of the jaw, before anything goes in; our own choice
IN_FRONT = 0.01  # [m] the place to bring things to lies this far before the lips; our own choice


class Mouth:
    """Where a person's mouth is, which way the face looks, and whether it is open.

    Attributes:
        position: The place to bring things to, in front of the lips, in the world [m], shape [3].
        face: Where the face looks, a unit vector, shape [3].
        ahead: The same, level.
        jaw: How far the jaw is open [rad].
    """

    def __init__(self, person: Human) -> None:
        self._person = person
        self.sense()

    def sense(self) -> None:
        """Look where it is now."""
        lips, self.face = self._person.mouth_and_face()
        self.position = lips + IN_FRONT * self.face
        self.jaw = self._person.angle("jaw_opening")
        x, y = self.face[:2].tolist()
        length = max(math.hypot(x, y), 1e-9)
        self.ahead: Array = np.array((x / length, y / length, 0.0))

    @property
    def is_open(self) -> bool:
        """Whether anything goes in."""
        return self.jaw >= OPEN

    def takes(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which points in the world [m], shape [n, 3], go in, shape [n]; none if it is closed."""
        if not self.is_open:
            return np.zeros(len(points), np.bool_)
        apart = points - self.position
        return np.asarray(np.einsum("na,na->n", apart, apart) < RADIUS**2)
