"""What soft matter is made of: flesh and foam, cloth, fluids."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import ConfigError, check_not_negative, check_positive


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
        check_positive(self, "youngs_modulus_pa", "density_kg_m3")
        if not 0 <= self.poissons_ratio < 0.5:
            raise ConfigError(
                f"poissons_ratio must lie in 0..0.5, 0.5 excluded, got {self.poissons_ratio}"
            )
        check_not_negative(self, "damping_per_s", "damping_s", "friction")

    @property
    def shear_modulus(self) -> float:
        """Lamé's second parameter mu [Pa]."""
        return self.youngs_modulus_pa / (2 * (1 + self.poissons_ratio))

    @property
    def bulk_parameter(self) -> float:
        """Lamé's first parameter lambda [Pa]."""
        ratio = self.poissons_ratio
        return self.youngs_modulus_pa * ratio / ((1 + ratio) * (1 - 2 * ratio))


@dataclass(frozen=True)
class Fabric:
    """A textile. Stiffnesses are those of the sheet, per metre of width.

    Attributes:
        area_density_kg_m2: Mass of a square metre [kg/m²].
        stretch_warp_n_m: Tension per strain along the grain [N/m].
        stretch_weft_n_m: Across the grain [N/m].
        shear_n_m: Shear force per shear angle, per metre [N/m].
        bending_nm: Moment per curvature, per metre of width [N·m].
        lock_strain: From here on it is `lock_factor` times as stiff: yarns are straight.
        lock_factor: How much stiffer, at least 1.
        tear_strain: It tears where it is stretched by more; never if None.
        damping_per_s: Rate at which motion dies out by itself [1/s].
        friction: Coefficient, to be multiplied with that of what touches it, as Bullet does.
        own_friction: Of cloth on cloth.
        thickness_m: How far its middle stays away from what it lies on [m]: real cloth is thinner,
            but its surface between particles must not sink into what is round.
        source: Where the figures come from.
    """

    area_density_kg_m2: float
    stretch_warp_n_m: float
    stretch_weft_n_m: float
    shear_n_m: float
    bending_nm: float
    lock_strain: float = 0.3
    lock_factor: float = 5.0
    tear_strain: float | None = None
    damping_per_s: float = 1.0
    friction: float = 0.8
    own_friction: float = 0.4
    thickness_m: float = 0.004
    source: str = "our own choice"

    def __post_init__(self) -> None:
        sheet = ("stretch_warp_n_m", "stretch_weft_n_m", "shear_n_m", "bending_nm")
        check_positive(self, "area_density_kg_m2", *sheet, "lock_strain", "thickness_m")
        check_not_negative(self, "damping_per_s", "friction", "own_friction")
        if not self.lock_factor >= 1:
            raise ConfigError(f"lock_factor must be at least 1, got {self.lock_factor}")
        if self.tear_strain is not None and not self.tear_strain > 0:
            raise ConfigError(f"tear_strain must be above 0, or None, got {self.tear_strain}")


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
        check_positive(self, "density_kg_m3")
        check_not_negative(self, "viscosity_per_s", "wall_drag_per_s", "friction")
        if not 0 <= self.cohesion <= 1:
            raise ConfigError(f"cohesion must lie between 0 and 1, got {self.cohesion}")


# Particles of 5 mm cannot be as thin as water: 24/s is the least that lets a cup of it come to rest.
WATER = Liquid(source="density: water at room temperature; all else our own choice")
