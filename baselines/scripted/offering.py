"""When a robot offers something, and when it takes that away: a no is respected."""

from __future__ import annotations

import math

from rcare_marl.envs.scenes.meal import TAKEN_AWAY
from rcare_marl.envs.scenes.refusal import Refusal

# Our own choices: how long it waits out of reach before it offers again [s], or how far off the mouth
# it does [m].
PAUSE, BACK = 1.0, TAKEN_AWAY + 0.015


class Offering:
    """Takes away what was refused, waits, offers again, and stops after the third no.

    It knows only what the task says that a robot hears and sees, see `envs.scenes.refusal`.

    Attributes:
        is_on: Whether it offered when it was asked last.
    """

    def __init__(self) -> None:
        self._from, self.is_on = 0.0, True

    def goes_on(self, refusal: Refusal, time: float) -> bool:
        """Return whether to offer now; else to take it away, or to keep it there.

        Args:
            refusal: What was refused until now.
            time: Since the episode began [s].
        """
        if refusal.is_final:
            self._from = math.inf
        elif refusal.stands:
            self._from = time + PAUSE
        self.is_on = time >= self._from
        return self.is_on

    def once_back(self, refusal: Refusal, is_back: bool) -> bool:
        """Return whether to offer now, by where the offer is in place of the time: that can be seen.

        Args:
            refusal: What was refused until now.
            is_back: Whether what was refused has been taken back far enough to be offered again.
        """
        if refusal.is_final or refusal.stands:
            self.is_on = False
        elif is_back:
            self.is_on = True
        return self.is_on
