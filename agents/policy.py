"""Who decides for an agent that is not learned."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt


@runtime_checkable
class Policy(Protocol):
    """Decides for one role, once a control step: a behaviour tree, a script, a trained network."""

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode; every random choice of the episode comes from `rng`."""

    def act(self) -> npt.NDArray[np.float64]:
        """Return the action for the coming control step, each value in [-1, 1]."""
