"""Several partners, of whom one plays in each episode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.policy import Policy


class Population:
    """A policy that is another one of its members in each episode.

    Attributes:
        chosen: Number of the member that plays now.
    """

    def __init__(self, members: Sequence[Policy]) -> None:
        """Take the members, at least one."""
        self._members = tuple(members)
        self.chosen = 0

    def reset(self, rng: np.random.Generator) -> None:
        """Draw who plays, each member alike, and begin their episode."""
        self.chosen = int(rng.integers(len(self._members)))
        self._members[self.chosen].reset(rng)

    def act(self) -> npt.NDArray[np.float64]:
        """Return the action of whoever plays."""
        return self._members[self.chosen].act()
