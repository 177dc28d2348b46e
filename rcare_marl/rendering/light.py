"""The light of a picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError

KEY_DIRECTION = (0.42, -0.5, 0.95)  # towards the light, not normalised


@dataclass(frozen=True)
class Light:
    """One far light that casts shadows, and a softer one from everywhere.

    A picture under a sky is the mean of pictures under several lights. The software renderer has a
    light of its own.

    Attributes:
        direction: Towards the far light; need not be of unit length.
        key: Strength of the far light, 1 as usual.
        fill: Strength of the light from everywhere, 1 as usual.
        bounce: How much of that comes from below as in a room with bright walls, in [0, 1].
        reach: How far from what the camera looks at shadows are seen [m].
        lid: Up to where things cast shadows, however large they are [m]: if lower than the ceiling, light
            comes from all of the ceiling. If None, walls and other still things of their size cast no
            shadow, everything else does, and shadows reach no farther than the picture does.

    Raises:
        ConfigError: If `direction` is zero, or strength or `reach` is negative.
    """

    direction: tuple[float, float, float] = KEY_DIRECTION
    key: float = 1.0
    fill: float = 1.0
    bounce: float = 0.0
    reach: float = 4.0
    lid: float | None = None

    def __post_init__(self) -> None:
        if not np.linalg.norm(self.direction) > 0:
            raise ConfigError(f"the direction of a light must not be zero, got {self.direction}")
        if min(self.key, self.fill) < 0 or not 0 <= self.bounce <= 1 or not self.reach > 0:
            raise ConfigError(
                "a light needs key and fill of at least 0, bounce within 0 and 1 and reach above 0, "
                f"got {self}"
            )

    @property
    def height(self) -> float:
        """Height above which nothing casts a shadow [m]."""
        return math.inf if self.lid is None else self.lid
