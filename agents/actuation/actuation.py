"""What drives the joints of a person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from rcare_marl.observable import Observable

Array = npt.NDArray[np.float64]


class Actuation(Protocol):
    """Turns the actions of a person into joint torques, and wishes into actions.

    Attributes:
        names: The n moving DoFs.
        target: Angle that each DoF pursues [rad], shape [n].
        action_low: Least value of an action, 0 or -1; the greatest is 1.
        action_names: What each action value moves, with its unit.
    """

    names: tuple[str, ...]
    target: Array
    action_low: float
    action_names: tuple[str, ...]

    @property
    def strength(self) -> Array:
        """Greatest torque against and along each DoF when rested [N·m], shape [n, 2]."""

    def reset(self, rng: np.random.Generator, gravity: Array) -> None:
        """Begin an episode in the start posture, with nothing commanded.

        Args:
            rng: Source of all that is random.
            gravity: Gravity in the frame of the pelvis [m/s²], shape [3].
        """

    def lay(self, index: int, angle: float) -> None:
        """Let a DoF pursue `angle` [rad], and furniture hold it there, until the next `reset`."""

    def command(self, action: Array, duration: float) -> None:
        """Accept an action for the coming control step of `duration` [s]."""

    def action_towards(self, angles: Mapping[str, float], duration: float) -> Array:
        """Return the action that pursues `angles` [rad] of some DoFs, the others staying as they are."""

    def torques(
        self, positions: list[float], velocities: list[float], gravity: Array
    ) -> list[float]:
        """Return joint torques for the coming physics step [N·m], length n.

        Args:
            positions: Joint angles [rad], length n.
            velocities: Joint rates [rad/s], length n.
            gravity: Gravity in the frame of the pelvis [m/s²], shape [3].
        """

    def muscle_torques(self) -> Array:
        """Return what the muscles willed in the last physics step [N·m], shape [n]."""

    def weaken(self, fresh: Array) -> None:
        """Leave each DoF's muscles a share of their strength, in [0, 1], shape [n]; 1 is rested."""

    def observables(self) -> Sequence[Observable]:
        """Return what a person senses of the drive."""
