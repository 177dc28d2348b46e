"""What soft matter is made of."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import ConfigError


@dataclass(frozen=True)
class Material:
    """An isotropic elastic material.

    Attributes:
        youngs_modulus_pa: Young's modulus [Pa].
        poissons_ratio: Poisson's ratio; 0.5 would be incompressible.
        density_kg_m3: Density [kg/m³].
        damping_per_s: Rate at which motion relative to the carrier dies out [1/s]: the part of Rayleigh
            damping that is proportional to mass.
        damping_s: The part that is proportional to stiffness [s]: elastic forces count as if the motion
            went on for that long.
        friction: Friction coefficient, to be multiplied with that of what touches it, as Bullet does.
        source: Where the figures come from.
    """

    youngs_modulus_pa: float
    poissons_ratio: float
    density_kg_m3: float = 1000.0
    damping_per_s: float = 0.0
    damping_s: float = 0.0
    friction: float = 0.5
    source: str = "our own choice"

    def __post_init__(self) -> None:
        if not self.youngs_modulus_pa > 0:
            raise ConfigError(f"youngs_modulus_pa must be above 0, got {self.youngs_modulus_pa}")
        if not 0 <= self.poissons_ratio < 0.5:
            raise ConfigError(
                f"poissons_ratio must lie in 0..0.5, 0.5 excluded, got {self.poissons_ratio}"
            )
        if not self.density_kg_m3 > 0:
            raise ConfigError(f"density_kg_m3 must be above 0, got {self.density_kg_m3}")
        for name in ("damping_per_s", "damping_s", "friction"):
            if not getattr(self, name) >= 0:
                raise ConfigError(f"{name} must not be negative, got {getattr(self, name)}")

    @property
    def shear_modulus(self) -> float:
        """Lamé's second parameter mu [Pa]."""
        return self.youngs_modulus_pa / (2 * (1 + self.poissons_ratio))

    @property
    def bulk_parameter(self) -> float:
        """Lamé's first parameter lambda [Pa]."""
        ratio = self.poissons_ratio
        return self.youngs_modulus_pa * ratio / ((1 + ratio) * (1 - 2 * ratio))
