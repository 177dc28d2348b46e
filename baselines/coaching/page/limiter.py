"""How many messages a page may send."""

from __future__ import annotations

RATE = 120.0  # messages a second in the long run: a headset of 90 Hz, and then some
BURST = 120.0  # at once


class Limiter:
    """Lets so many messages through a second, and drops the rest.

    Attributes:
        dropped: How many were dropped so far.
    """

    def __init__(self, *, rate: float = RATE, burst: float = BURST) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._at = burst, 0.0
        self.dropped = 0

    def lets(self, now: float) -> bool:
        """Return whether a message at a time [s] may pass; it counts as one."""
        self._left = min(self._burst, self._left + self._rate * (now - self._at))
        self._at = now
        if self._left < 1:
            self.dropped += 1
            return False
        self._left -= 1
        return True
