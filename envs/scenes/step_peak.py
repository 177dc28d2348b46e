"""What is greatest at some physics step of a control step."""

from __future__ import annotations

from collections.abc import Callable


class StepPeak:
    """Watches a quantity that is too short-lived to be looked at once a control step."""

    def __init__(self, measure: Callable[[], float]) -> None:
        """Take what returns the quantity, 0 or more."""
        self._measure, self._most = measure, 0.0

    def after_substep(self) -> None:
        """Look at it after a physics step."""
        value = self._measure()
        if value > self._most:
            self._most = value

    def take(self) -> float:
        """Return the greatest value since this was called last."""
        most, self._most = self._most, 0.0
        return most
