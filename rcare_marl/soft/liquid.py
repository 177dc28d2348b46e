"""What a fluid is made of."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import ConfigError


@dataclass(frozen=True)
class Liquid:
    """A liquid as its particles know it.

    Attributes:
        density_kg_m3: Density [kg/m³].
        viscosity_per_s: Rate at which neighbouring particles come to move alike [1/s].
        wall_drag_per_s: Rate at which walls hold back what slides along them [1/s].
        cohesion: How much of what presses a fluid apart pulls it together where it is thin, 0 to 1.
        friction: Friction coefficient on all but vessels, to be multiplied with that of what it touches.
        source: Where the figures come from.
    """

    density_kg_m3: float = 1000.0
    viscosity_per_s: float = 24.0
    wall_drag_per_s: float = 1.5
    cohesion: float = 0.02
    friction: float = 0.2
    source: str = "our own choice"

    def __post_init__(self) -> None:
        if not self.density_kg_m3 > 0:
            raise ConfigError(f"density_kg_m3 must be above 0, got {self.density_kg_m3}")
        for name in ("viscosity_per_s", "wall_drag_per_s", "friction"):
            if not getattr(self, name) >= 0:
                raise ConfigError(f"{name} must not be negative, got {getattr(self, name)}")
        if not 0 <= self.cohesion <= 1:
            raise ConfigError(f"cohesion must lie between 0 and 1, got {self.cohesion}")


# Particles of 5 mm cannot be as thin as water: 24/s is the least that lets a cup of it come to rest.
WATER = Liquid(source="density: water at room temperature; all else our own choice")
