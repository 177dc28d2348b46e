"""Movement disorders: what shakes a person against the will."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array

# [1/s]; Parkinsonian rest tremor lies at 4 to 6 (Deuschl et al. 1998, from memory).
TREMOR_FREQUENCY = 5.0
TREMOR_SPREAD = 0.15  # of the frequency among muscle groups; our own choice
DYSKINESIA_FREQUENCIES = (0.6, 1.1, 1.9, 2.7)  # [1/s]; irregular movement below 3 (our own choice)


class Shaking:
    """Involuntary drive of several parts: a tremor as one sine each, a dyskinesia as several.

    Parts with one `rhythm` share frequency and phases, so that agonist and antagonist alternate.
    """

    def __init__(
        self, *, tremor: Array, dyskinesia: Array, signs: Array, rhythm: npt.NDArray[np.int64]
    ) -> None:
        """Prepare the parts.

        Args:
            tremor: Amplitude of each part, shape [m].
            dyskinesia: Likewise, shape [m].
            signs: +1 or -1 for agonists and antagonists, shape [m].
            rhythm: Which rhythm moves each part, from 0 on, shape [m].
        """
        self._tremor, self._dyskinesia = tremor * signs, dyskinesia * signs
        self._rhythm = rhythm
        count = int(rhythm.max()) + 1 if len(rhythm) else 0
        self._phases = np.zeros((count, 1 + len(DYSKINESIA_FREQUENCIES)))
        self._rates = np.zeros_like(self._phases)
        self._time = 0.0

    def reset(self, rng: np.random.Generator) -> None:
        """Draw new phases and tremor frequencies, and begin at time 0."""
        self._phases[:] = rng.uniform(0, 2 * np.pi, self._phases.shape)
        spread = rng.uniform(-TREMOR_SPREAD, TREMOR_SPREAD, len(self._phases))
        self._rates[:, 0] = 2 * np.pi * TREMOR_FREQUENCY * (1 + spread)
        self._rates[:, 1:] = 2 * np.pi * np.array(DYSKINESIA_FREQUENCIES)
        self._time = 0.0

    def after(self, dt: float) -> Array:
        """Return the drive of each part `dt` [s] later, in its amplitude's unit, shape [m]."""
        self._time += dt
        waves = np.sin(self._phases + self._rates * self._time)
        slow = waves[:, 1:].mean(axis=1)
        return self._tremor * waves[self._rhythm, 0] + self._dyskinesia * slow[self._rhythm]
