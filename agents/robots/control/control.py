"""What all control modes have in common."""

from __future__ import annotations

import abc

from rcare_marl.pose import Array


class Control(abc.ABC):
    """Turns actions into motor commands.

    Attributes:
        size: Number of action values.
        names: What each value moves, with its unit.
        max: What a value of 1 means in that unit, shape [size].
        needs_actuation: Whether `actuate` must be called before every physics step.
    """

    size: int
    names: tuple[str, ...]
    max: Array
    needs_actuation: bool = False

    @abc.abstractmethod
    def reset(self) -> None:
        """Take the present posture as the one to hold, and hold it."""

    @abc.abstractmethod
    def command(self, action: Array, duration: float) -> None:
        """Accept an action, each value in [-1, 1], for the coming `duration` [s]."""

    def actuate(self) -> None:
        """Act before each physics step, where motors cannot hold the command by themselves."""
