"""The colours of a home."""

from __future__ import annotations

from dataclasses import dataclass

Rgba = tuple[float, float, float, float]


@dataclass(frozen=True)
class Palette:
    """Colours by what they are for, red, green, blue, alpha, sRGB, each in [0, 1]; our own choice.

    The pieces of furniture take their colours from here, so that a house is of a piece.
    """

    wall: Rgba = (0.93, 0.91, 0.86, 1.0)
    wall_accent: Rgba = (0.72, 0.77, 0.74, 1.0)
    wall_tile: Rgba = (0.80, 0.87, 0.86, 1.0)
    facade: Rgba = (0.82, 0.78, 0.71, 1.0)
    ceiling: Rgba = (0.97, 0.97, 0.96, 1.0)
    trim: Rgba = (0.96, 0.95, 0.93, 1.0)  # frames of doors and windows, skirting
    door: Rgba = (0.90, 0.88, 0.84, 1.0)
    floor_wood: Rgba = (0.70, 0.53, 0.36, 1.0)
    floor_tile: Rgba = (0.67, 0.63, 0.58, 1.0)
    floor_carpet: Rgba = (0.74, 0.70, 0.63, 1.0)
    wood: Rgba = (0.66, 0.47, 0.29, 1.0)
    wood_dark: Rgba = (0.36, 0.24, 0.16, 1.0)
    wood_light: Rgba = (0.82, 0.68, 0.50, 1.0)
    front: Rgba = (0.88, 0.88, 0.84, 1.0)  # of kitchen cupboards and drawers
    worktop: Rgba = (0.34, 0.33, 0.32, 1.0)
    ceramic: Rgba = (0.97, 0.97, 0.96, 1.0)
    glass: Rgba = (0.72, 0.85, 0.90, 0.35)
    mirror: Rgba = (0.80, 0.86, 0.88, 1.0)
    metal: Rgba = (0.72, 0.73, 0.75, 1.0)
    metal_dark: Rgba = (0.22, 0.22, 0.24, 1.0)
    brass: Rgba = (0.72, 0.58, 0.32, 1.0)
    plastic: Rgba = (0.92, 0.92, 0.91, 1.0)
    black: Rgba = (0.08, 0.08, 0.09, 1.0)
    white: Rgba = (0.97, 0.97, 0.97, 1.0)
    fabric: Rgba = (0.42, 0.48, 0.55, 1.0)  # sofas
    fabric_light: Rgba = (0.80, 0.76, 0.69, 1.0)
    linen: Rgba = (0.95, 0.94, 0.91, 1.0)  # sheets, pillows
    blanket: Rgba = (0.45, 0.58, 0.62, 1.0)
    towel: Rgba = (0.62, 0.73, 0.74, 1.0)
    curtain: Rgba = (0.86, 0.82, 0.75, 1.0)
    rug: Rgba = (0.66, 0.38, 0.30, 1.0)
    accent: Rgba = (0.80, 0.48, 0.26, 1.0)
    leaf: Rgba = (0.28, 0.44, 0.24, 1.0)
    clay: Rgba = (0.68, 0.42, 0.30, 1.0)
    paper: Rgba = (0.86, 0.83, 0.76, 1.0)
    lamp: Rgba = (1.0, 0.95, 0.82, 1.0)
    rubber: Rgba = (0.16, 0.16, 0.17, 1.0)
    grass: Rgba = (0.56, 0.61, 0.45, 1.0)
    paving: Rgba = (0.66, 0.64, 0.60, 1.0)

    def materials(self) -> dict[str, tuple[float, ...]]:
        """Return the colours by name, as a `Model` takes them."""
        return {name: tuple(getattr(self, name)) for name in self.__dataclass_fields__}
