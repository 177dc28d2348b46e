"""Garments cut to measure: tubes and panels of cloth, sewn where real ones are.

A garment lies in the frame of the body that it is cut for: x to the wearer's left, y up, z forward, as it
would be worn in the T-pose. That shape is cloth at rest; where it lies in the world is another matter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from ..errors import ConfigError, check_name
from .material import Fabric
from .pattern import Frame, Pattern, sheet, shirt, trousers

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

Cut = Literal["trousers", "shirt", "sheet"]
DIMENSIONS: dict[Cut, tuple[str, ...]] = {
    "trousers": ("waist", "hip", "rise", "thigh", "hem", "leg"),
    "shirt": ("chest", "hem", "length", "shoulders", "neck", "armhole", "cuff", "sleeve"),
    "sheet": ("width", "length"),
}


@dataclass(frozen=True)
class Dimension:
    """A length of a garment: a share of a measure of the body, and ease.

    Attributes:
        measure: Name of the measure; none if empty.
        share: How much of it.
        ease_m: What is added [m], or all of it where there is no measure.
    """

    measure: str = ""
    share: float = 1.0
    ease_m: float = 0.0

    def of(self, measures: Mapping[str, float]) -> float:
        """Return it for the measures of a body [m]."""
        if not self.measure:
            return self.ease_m
        check_name("measure of a body", self.measure, measures)
        return self.share * measures[self.measure] + self.ease_m


@dataclass(frozen=True)
class GarmentConfig:
    """A garment (`assets/garments/<name>.yaml`).

    Attributes:
        description: One line for a person to read.
        cut: What it is sewn like.
        fabric: What it is made of.
        spacing_m: Distance of its particles [m].
        dimensions: Its lengths, by name; which ones depends on the cut.
        rgb: Its colour.
        open_back: Whether a shirt is open at the back but for a tie at the neck.
    """

    description: str
    cut: Cut
    fabric: Fabric
    spacing_m: float
    dimensions: dict[str, Dimension]
    rgb: tuple[int, int, int] = (120, 150, 180)
    open_back: bool = False

    def __post_init__(self) -> None:
        if not 0.005 <= self.spacing_m <= 0.2:
            raise ConfigError(f"spacing_m must lie in 0.005..0.2, got {self.spacing_m}")
        known = DIMENSIONS[self.cut]
        for name in self.dimensions:
            check_name(f"dimension of a garment cut as {self.cut}", name, known)
        missing = [name for name in known if name not in self.dimensions]
        if missing:
            raise ConfigError(f"a garment cut as {self.cut} also needs {', '.join(missing)}")


@dataclass(frozen=True, eq=False)
class Garment:
    """Cloth cut to measure.

    Attributes:
        config: What it was cut from.
        rest: Positions at rest in the frame of the body [m], shape [n, 3].
        faces: Shape [m, 3], counter-clockwise from outside.
        grain: Direction of the warp, shape [n, 3].
        rings: Particles along its openings by name, such as `waist`, `left_hem`; each in order.
    """

    config: GarmentConfig
    rest: Array
    faces: Indices
    grain: Array
    rings: dict[str, Indices] = field(default_factory=dict)


def cut_garment(
    config: GarmentConfig, measures: Mapping[str, float], frame: Frame = Frame()
) -> Garment:
    """Cut and sew a garment.

    Args:
        config: The garment.
        measures: Of the body, by name [m].
        frame: Where on the body it goes.

    Raises:
        UnknownNameError: If a dimension names a measure that there is not.
        ConfigError: If a dimension is not above 0.
    """
    sizes = {name: dimension.of(measures) for name, dimension in config.dimensions.items()}
    for name, size in sizes.items():
        if not size > 0:
            raise ConfigError(f"dimension {name!r} of a garment must be above 0, got {size:.3f} m")
    pattern: Pattern
    if config.cut == "trousers":
        pattern = trousers(sizes, config.spacing_m, frame)
    elif config.cut == "shirt":
        pattern = shirt(sizes, config.spacing_m, frame, open_back=config.open_back)
    else:
        pattern = sheet(sizes["width"], sizes["length"], config.spacing_m)
    rest, faces, grain = pattern.sewn()
    return Garment(config, rest, faces, grain, pattern.rings)
