"""A person who lets their limbs go where they are taken."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..actuation.skeletal import MAX_SPEED, SkeletalDrive

if TYPE_CHECKING:
    from ..human import Human

Array = npt.NDArray[np.float64]

# [N·m/rad] by which a target is moved so that its muscle slackens: more than the stiffness of most joints,
# so that it does not overshoot; our own choice.
SLACKENING = 200.0


class GoAlong:
    """Relaxes: whoever moves the person meets the weight of the limb, and no will."""

    def __init__(self, person: Human, control_dt: float) -> None:
        """Take the person, and the length of a control step [s]."""
        self._person, self._step = person, MAX_SPEED * control_dt

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to begin."""

    def act(self) -> Array:
        """Return the action that slackens the muscles: targets that give way, or no excitation."""
        drive = self._person.drive
        if not isinstance(drive, SkeletalDrive):
            return np.zeros(self._person.action_size)
        return np.clip(-drive.muscle_torques() / (SLACKENING * self._step), -1.0, 1.0)


__all__ = ["GoAlong"]
