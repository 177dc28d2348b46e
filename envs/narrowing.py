"""Chance that stays closer to the middle, for easier stages of a curriculum."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


class NarrowedRng(np.random.Generator):
    """Draws what another generator would, but closer to the middle: for easier stages of a curriculum.

    Only draws from a range or about a middle are narrowed: `uniform`, `random`, `normal` and
    `standard_normal`. Whole numbers and choices have no middle and stay as they are. It goes on in the
    sequence of the other generator, and takes as many numbers from it.
    """

    def __init__(self, rng: np.random.Generator, spread: float) -> None:
        """Take the generator, and the share that is left of each spread, 0 to 1."""
        super().__init__(rng.bit_generator)
        self._spread = spread

    def uniform(self, low: Any = 0.0, high: Any = 1.0, size: Any = None) -> Any:
        middle = 0.5 * (np.asarray(low) + np.asarray(high))
        return self._narrowed(super().uniform(low, high, size), middle)

    def random(self, *args: Any, **settings: Any) -> Any:
        return self._narrowed(super().random(*args, **settings), np.asarray(0.5))

    def normal(self, loc: Any = 0.0, scale: Any = 1.0, size: Any = None) -> Any:
        return self._narrowed(super().normal(loc, scale, size), np.asarray(loc))

    def standard_normal(self, *args: Any, **settings: Any) -> Any:
        return self._narrowed(super().standard_normal(*args, **settings), np.asarray(0.0))

    def _narrowed(self, drawn: Any, middle: npt.NDArray[Any]) -> Any:
        out = middle + self._spread * (drawn - middle)
        return float(out) if np.ndim(drawn) == 0 else out
