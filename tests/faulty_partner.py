"""Partners that fail while they play, for tests of what runs them in other processes."""

from __future__ import annotations

import os

import numpy as np
import numpy.typing as npt

from rcare_marl.envs import CareEnv

STEPS = 3  # that go well


class FaultyPartner:
    """Stays still at first; then raises or ends its process."""

    def __init__(self, action_size: int, *, dies: bool) -> None:
        self._action, self._dies, self._count = np.zeros(action_size), dies, 0

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to begin."""

    def act(self) -> npt.NDArray[np.float64]:
        self._count += 1
        if self._count > STEPS and self._dies:
            os._exit(7)
        if self._count > STEPS:
            raise ArithmeticError("the partner cannot count to four")
        return self._action


def raising(env: CareEnv, role: str) -> FaultyPartner:
    return FaultyPartner(env.cast[role].action_size, dies=False)


def dying(env: CareEnv, role: str) -> FaultyPartner:
    return FaultyPartner(env.cast[role].action_size, dies=True)
