"""What hangs on the walls of bathrooms: grab bars, rails for towels, paper."""

from __future__ import annotations

import math

from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape, Triple

from ...rectangle import Rectangle
from ..piece import Piece, Setting, maker
from ..rule import Rules
from .bathroom import fold_down
from .joinery import Joinery
from .plumbing import disc, grab_bar
from .stock import box, rod, solid_rods

# What is built where the rules of a level want no bars: as at the other levels.
_HEIGHT, _DIAMETER, _GAP = 0.86, 0.035, 0.038  # [m]


def bar_figures(rules: Rules) -> tuple[float, float, float]:
    """Return height of the top, diameter and gap to the wall of grab bars [m]."""
    if not rules.has("grab_bar_height"):
        return _HEIGHT, _DIAMETER, _GAP
    names = ("grab_bar_height", "grab_bar_diameter", "grab_bar_gap")
    height, diameter, gap = (rules.figure(name) for name in names)
    return height, diameter, gap


@maker("grab_bar")
def wall_bar(
    setting: Setting,
    *,
    length: float = 0.61,
    height: float | None = None,
    diameter: float | None = None,
    gap: float | None = None,
    tilt_deg: float = 0.0,
) -> Piece:
    """Return a grab bar on the wall.

    Args:
        setting: What it is made for.
        length: Between its ends [m].
        height: Of its top, or of its middle where it is tilted [m]; that of the rules if None.
        diameter: Of the bar [m]; that of the rules if None.
        gap: Between the bar and the wall [m]; that of the rules if None.
        tilt_deg: 0 for a level bar, 90 for an upright one [degrees].

    Raises:
        ConfigError: If the bar would reach the floor.
    """
    high, thick, free = bar_figures(setting.rules)
    high = high if height is None else height
    thick = thick if diameter is None else diameter
    free = free if gap is None else gap
    tilt = math.radians(tilt_deg)
    y, z = 0.5 * length * math.cos(tilt), 0.5 * length * math.sin(tilt)
    middle = high - 0.5 * thick if tilt_deg == 0 else high
    if middle - abs(z) < 0.05:
        raise ConfigError(f"a bar {length} m long at {high} m, tilted {tilt_deg}°, meets the floor")
    made = Joinery("grab_bar", setting)
    ends = ((0.0, -y, middle - z), (0.0, y, middle + z))
    grab_bar(made, *ends, (1.0, 0.0, 0.0), diameter=thick, gap=free)
    made.measures |= {"grab_bar_diameter": thick, "grab_bar_gap": free}
    if tilt_deg == 0:
        made.measures["grab_bar_height"] = high
    made.frame("grab_bar", (free + 0.5 * thick, 0.0, middle), "middle of the bar")
    half = abs(y) + 1.2 * thick
    area = Rectangle(0.0, -half, free + thick, half)
    return made.piece(area, middle + abs(z) + 1.2 * thick, blocks=False)


@maker("fold_down_bar")
def fold_down_bar(setting: Setting, *, length: float = 0.75) -> Piece:
    """Return a bar that stands up against the wall and folds down, joint `fold_down`.

    Args:
        setting: What it is made for.
        length: From the wall to its front end [m].
    """
    height, diameter, _ = bar_figures(setting.rules)
    made = Joinery("fold_down_bar", setting)
    fold_down(made, 0.0, top=height, length=length, diameter=diameter)
    made.measures["grab_bar_diameter"] = diameter
    area = Rectangle(0.0, -0.06, 0.31, 0.06)
    return made.piece(area, height + length, blocks=False)


@maker("towel_rail")
def towel_rail(setting: Setting, *, length: float = 0.6) -> Piece:
    """Return a rail with a towel over it, which is only to see.

    Args:
        setting: What it is made for.
        length: Between its ends [m].
    """
    made = Joinery("towel_rail", setting)
    z = (1.3, 1.15, 1.1)[setting.rules.level - 1]  # ADA 308: 48 in at most; level 1, 3: own choice
    half, x = 0.5 * length, 0.07
    rail = ((0.0, -half, z), (x, -half, z), (x, half, z), (0.0, half, z))
    made.draw(rod("metal", 0.008, *rail, bend=0.02))
    made.solid(*solid_rods(0.008, *rail))
    for y in (-half, half):
        made.draw(disc("metal", (0.004, y, z), 0.022, 0.008, along="x"))
    low, wide = 0.2 - half, 0.34
    made.draw(
        box("towel", (x + 0.008, low, z - 0.55), (x + 0.018, low + wide, z)),
        box("towel", (x - 0.018, low, z - 0.4), (x - 0.008, low + wide, z)),
        rod("towel", 0.018, (x, low, z), (x, low + wide, z)),
        box("linen", (x + 0.007, low, z - 0.5), (x + 0.0195, low + wide, z - 0.47)),
    )
    made.frame("towel", (x + 0.02, low + 0.5 * wide, z - 0.3), "middle of the towel")
    return made.piece(Rectangle(0.0, -half - 0.025, 0.095, half + 0.025), z + 0.025, blocks=False)


@maker("toilet_paper")
def toilet_paper(setting: Setting) -> Piece:
    """Return a roll of paper on its holder; the roll turns, joint `roll`."""
    made = Joinery("toilet_paper", setting)
    z, x = 0.65, 0.08  # ADA 604.7: 15 to 48 in high; own choice
    made.draw(
        rod("metal", 0.02, (0.0, 0.08, z + 0.02), (0.008, 0.08, z + 0.02)),
        rod(
            "metal", 0.006, (0.0, 0.08, z + 0.02), (x, 0.08, z + 0.02), (x, 0.08, z), (x, -0.07, z)
        ),
    )
    made.solid(*solid_rods(0.006, (0.0, 0.08, z), (x, 0.08, z), (x, -0.07, z)))
    made.moving(
        "roll",
        "revolute",
        (x, 0.0, z),
        (0.0, 1.0, 0.0),
        2 * math.pi,
        mass=0.15,
        fills=((x - 0.05, -0.05, z - 0.05), (x + 0.05, 0.05, z + 0.05)),
        slowing=0.1,
    )
    ring = ((0.02, -0.05), (0.055, -0.05), (0.055, 0.05), (0.02, 0.05), (0.02, -0.05))
    turn: Triple = (-math.pi / 2, 0.0, 0.0)
    made.draw(
        Shape(kind="lathe", material="white", at=(x, 0.0, z), rpy=turn, profile=ring), link="roll"
    )
    made.draw(box("white", (x + 0.054, -0.05, z - 0.11), (x + 0.056, 0.05, z)))
    made.solid(
        Shape(kind="cylinder", at=(x, 0.0, z), rpy=turn, radius=0.055, length=0.1), link="roll"
    )
    made.frame("handle_roll", (x + 0.055, 0.0, z), "front of the roll; pull it down", link="roll")
    return made.piece(Rectangle(0.0, -0.08, 0.14, 0.1), z + 0.06, blocks=False)
