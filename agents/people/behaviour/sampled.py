"""A policy that knows nothing: the floor of every comparison."""

from __future__ import annotations

import numpy as np

from ...agent import Array


class RandomPolicy:
    """A policy whose every action is drawn uniformly from the whole action box."""

    def __init__(self, action_size: int, low: float = -1.0) -> None:
        """Take the number of action values and the least of each."""
        self._size, self._low = action_size, low
        self._rng = np.random.default_rng(0)

    def reset(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def act(self) -> Array:
        return self._rng.uniform(self._low, 1.0, self._size)
