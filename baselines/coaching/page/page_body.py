"""The figure on the page as the body of a coach."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.coaching.upper_body import MOTIONS

Array = npt.NDArray[np.float64]


class PageBody:
    """Keeps what the page has to show and to say.

    Attributes:
        angles: What is shown [rad], shape [16].
        rest: How it stands still [rad], shape [16].
        said: What was said last; empty before.
        count: How often something was said.
    """

    def __init__(self, rest: Array | None = None) -> None:
        """Stand at rest [rad], shape [16]; with hanging arms if None."""
        self.rest = np.zeros(len(MOTIONS)) if rest is None else rest
        self.angles = self.rest
        self.said, self.count = "", 0

    def show(self, angles: Array) -> None:
        self.angles = angles

    def say(self, text: str) -> None:
        self.said, self.count = text, self.count + 1

    def stand_still(self) -> None:
        self.angles = self.rest
