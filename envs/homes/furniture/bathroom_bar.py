"""What hangs on the walls of bathrooms: grab bars, rails for towels, paper."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape, Triple

from ...rectangle import Rectangle
from ..rule import Rules
from .bathroom import fold_down
from .joinery import Joinery, furniture
from .plumbing import grab_bar
from .stock import about, solid_rods


def bar_figures(rules: Rules) -> tuple[float, float, float]:
    """Return height of the top, diameter and gap to the wall of grab bars [m].

    Where the rules of a level want none they are as at the other levels.
    """
    usual = {"grab_bar_height": 0.86, "grab_bar_diameter": 0.035, "grab_bar_gap": 0.038}
    height, diameter, gap = (rules.figure(name, size) for name, size in usual.items())
    return height, diameter, gap


@furniture("grab_bar")
def wall_bar(
    made: Joinery,
    *,
    length: float = 0.61,
    height: float | None = None,
    diameter: float | None = None,
    gap: float | None = None,
    tilt_deg: float = 0.0,
) -> None:
    """Make a grab bar on the wall.

    Args:
        made: What it becomes.
        length: Between its ends [m].
        height: Of its top, or of its middle where it is tilted [m]; that of the rules if None.
        diameter: Of the bar [m]; that of the rules if None.
        gap: Between the bar and the wall [m]; that of the rules if None.
        tilt_deg: 0 for a level bar, 90 for an upright one [degrees].

    Raises:
        ConfigError: If the bar would reach the floor.
    """
    high, thick, free = (
        usual if own is None else own
        for usual, own in zip(bar_figures(made.rules), (height, diameter, gap), strict=True)
    )
    tilt = math.radians(tilt_deg)
    y, z = 0.5 * length * math.cos(tilt), 0.5 * length * math.sin(tilt)
    middle = high - 0.5 * thick if tilt_deg == 0 else high
    if middle - abs(z) < 0.05:
        raise ConfigError(f"a bar {length} m long at {high} m, tilted {tilt_deg}°, meets the floor")
    ends = ((0.0, -y, middle - z), (0.0, y, middle + z))
    grab_bar(made, *ends, (1.0, 0.0, 0.0), diameter=thick, gap=free)
    made.measures |= {"grab_bar_diameter": thick, "grab_bar_gap": free}
    if tilt_deg == 0:
        made.measures["grab_bar_height"] = high
    made.frame("grab_bar", (free + 0.5 * thick, 0.0, middle), "middle of the bar")
    made.outline(free + thick, abs(y) + 1.2 * thick, middle + abs(z) + 1.2 * thick)
    made.blocks = False


@furniture("fold_down_bar")
def fold_down_bar(made: Joinery, *, length: float = 0.75) -> None:
    """Make a bar `length` [m] long that stands up against the wall and folds down, joint `fold_down`."""
    height, diameter, _ = bar_figures(made.rules)
    fold_down(made, 0.0, top=height, length=length, diameter=diameter)
    made.measures["grab_bar_diameter"] = diameter
    made.outline(0.31, 0.06, height + length)
    made.blocks = False


@furniture("towel_rail")
def towel_rail(made: Joinery, *, length: float = 0.6) -> None:
    """Make a rail `length` [m] long with a towel over it, which is only to see."""
    z = (1.3, 1.15, 1.1)[made.rules.level - 1]  # ADA 308: 48 in at most; level 1, 3: own choice
    half, x = 0.5 * length, 0.07
    rail = ((0.0, -half, z), (x, -half, z), (x, half, z), (0.0, half, z))
    made.rod(rail, 0.008, "metal", bend=0.02, solid=True)
    for y in (-half, half):
        made.disc((0.004, y, z), 0.022, 0.008, "metal", along="x")
    low, high = 0.2 - half, 0.2 - half + 0.34
    made.show((x + 0.008, low, z - 0.55), (x + 0.018, high, z), "towel")
    made.show((x - 0.018, low, z - 0.4), (x - 0.008, high, z), "towel")
    made.rod(((x, low, z), (x, high, z)), 0.018, "towel")
    made.show((x + 0.007, low, z - 0.5), (x + 0.0195, high, z - 0.47), "linen")
    made.frame("towel", (x + 0.02, low + 0.5 * 0.34, z - 0.3), "middle of the towel")
    made.outline(0.095, half + 0.025, z + 0.025)
    made.blocks = False


@furniture("toilet_paper")
def toilet_paper(made: Joinery) -> None:
    """Make a roll of paper on its holder; the roll turns, joint `roll`."""
    z, x = 0.65, 0.08  # ADA 604.7: 15 to 48 in high; own choice
    foot, arm = (0.0, 0.08, z + 0.02), ((x, 0.08, z), (x, -0.07, z))
    made.rod((foot, (0.008, 0.08, z + 0.02)), 0.02, "metal")
    made.rod((foot, (x, 0.08, z + 0.02), *arm), 0.006, "metal")
    made.solid(*solid_rods(0.006, (0.0, 0.08, z), *arm))
    at: Triple = (x, 0.0, z)
    fills = about(at, 0.05, 0.05, 0.05)
    roll = made.joint("roll", at, "y", 2 * math.pi, mass=0.15, fills=fills, slowing=0.1)
    ring = ((0.02, -0.05), (0.055, -0.05), (0.055, 0.05), (0.02, 0.05), (0.02, -0.05))
    turn: Triple = (-math.pi / 2, 0.0, 0.0)
    roll.lathe(at, ring, "white", rpy=turn)
    made.show((x + 0.054, -0.05, z - 0.11), (x + 0.056, 0.05, z), "white")
    roll.solid(Shape("cylinder", at=at, rpy=turn, radius=0.055, length=0.1))
    roll.frame("handle_roll", (x + 0.055, 0.0, z), "front of the roll; pull it down")
    made.footprint, made.height = Rectangle(0.0, -0.08, 0.14, 0.1), z + 0.06
    made.blocks = False
