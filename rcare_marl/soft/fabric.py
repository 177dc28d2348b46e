"""What cloth is made of."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import ConfigError


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
        above_zero = (
            "area_density_kg_m2",
            "stretch_warp_n_m",
            "stretch_weft_n_m",
            "shear_n_m",
            "bending_nm",
            "lock_strain",
            "thickness_m",
        )
        for name in above_zero:
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be above 0, got {getattr(self, name)}")
        for name in ("damping_per_s", "friction", "own_friction"):
            if not getattr(self, name) >= 0:
                raise ConfigError(f"{name} must not be negative, got {getattr(self, name)}")
        if not self.lock_factor >= 1:
            raise ConfigError(f"lock_factor must be at least 1, got {self.lock_factor}")
        if self.tear_strain is not None and not self.tear_strain > 0:
            raise ConfigError(f"tear_strain must be above 0, or None, got {self.tear_strain}")
