"""A person who is told to reach for something, and does so as far as the profile lets them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...agent import Array
from ..body.ik import reach
from ..human import Human


class Reach:
    """A policy that brings a hand to a point, with whatever drives the person: angles or muscles.

    Inverse kinematics within the active range finds the posture, and `Human.action_towards` the action:
    with muscles the excitations that pursue it.
    """

    def __init__(
        self, person: Human, side: str, point: Callable[[], Array], *, control_dt: float
    ) -> None:
        """Prepare the policy.

        Args:
            person: Who reaches.
            side: `left` or `right`.
            point: Returns where the middle of the hand should be in the world [m], shape [3].
            control_dt: Length of a control step [s].
        """
        self._person, self._side, self._point = person, side, point
        self._control_dt = control_dt
        self._wish: dict[str, float] = {}
        self._aim = np.full(3, np.nan)

    def reset(self, rng: np.random.Generator) -> None:
        self._aim[:] = np.nan

    def act(self) -> Array:
        aim = np.asarray(self._point(), np.float64)
        if not np.array_equal(aim, self._aim):  # a point that stays is solved for once
            self._aim[:] = aim
            found = reach(self._person, self._side, aim, trunk=False)
            if not found.success:  # who can reach it so does not lean
                found = reach(self._person, self._side, aim)
            self._wish = found.wish
        return self._person.action_towards(self._wish, self._control_dt)
