"""A person who lets their limbs go where they are taken."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from ..human import Human

Array = npt.NDArray[np.float64]


class GoAlong:
    """Relaxes: whoever moves the person meets the weight of the limb, and no will."""

    def __init__(self, person: Human, control_dt: float) -> None:
        """Take the person, and the length of a control step [s]."""
        self._person, self._control_dt = person, control_dt

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to begin."""

    def act(self) -> Array:
        """Return the action that slackens the muscles: targets that give way, or no excitation."""
        return self._person.slack_action(self._control_dt)
