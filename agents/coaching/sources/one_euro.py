"""A filter that is smooth in rest and quick in motion."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.pose import Array

SPEED_CUTOFF = 1.0  # of the speed itself, as in the paper [Hz]


class OneEuro:
    """The 1 euro filter of Casiez, Roussel & Vogel 2012 (CHI), for several values at once.

    What is NaN is not known, and leaves what was known before as it is.
    """

    def __init__(self, *, cutoff: float, beta: float | Array) -> None:
        """Prepare a filter.

        Args:
            cutoff: Cut-off frequency at rest [Hz].
            beta: By how much it grows with the speed of a value [Hz per unit/s]; one, or one for each.
        """
        self._cutoff, self._beta = cutoff, beta
        self._time: float | None = None

    def update(self, values: Array, time: float) -> Array:
        """Return the smoothed values at a time [s], shape [n]; NaN where the given ones are."""
        if self._time is None or time <= self._time:
            self._value, self._speed, self._time = values.copy(), np.zeros(len(values)), time
            return values
        dt, self._time = time - self._time, time
        known = np.isfinite(values)
        value, speed = self._value, self._speed
        fresh = known & ~np.isfinite(value)
        step = np.where(known & ~fresh, values - value, 0.0)
        speed += _share(SPEED_CUTOFF, dt) * np.where(known, step / dt - speed, 0.0)
        value += _share(self._cutoff + self._beta * np.abs(speed), dt) * step
        value[fresh] = values[fresh]
        return np.where(known, value, np.nan)


def _share(cutoff: Array | float, dt: float) -> Array | float:
    """Return the share of the new in a first-order filter."""
    turned = 2 * math.pi * cutoff * dt
    return turned / (1.0 + turned)
