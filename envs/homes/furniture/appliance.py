"""Appliances that stand by themselves: fridge, oven tower, microwave oven."""

from __future__ import annotations

from rcare_marl.errors import ConfigError

from .joinery import Joinery, front_zone, furniture
from .kitchen import (
    SWEEP,
    TALL,
    stand_tall,
    tall_carcass,
)
from .kitchen_layout import Unit
from .kitchen_unit import CARCASS, DEPTH, FACE, PLINTH, Run, oven_cavity, oven_controls, oven_front

# Of fridges [m]; common, from memory.
HIGH = 1.8
BODY = 0.60
BACK = 0.02
SHELL = 0.04
DOOR = 0.06
FREEZER = 0.62
FOOT = 0.08

Span = tuple[float, float]


@furniture("fridge")
def fridge(made: Joinery, *, width: float = 0.0, hinge: str = "low") -> None:
    """Make a fridge with a freezer: below it at levels 1 and 2, beside it at level 3.

    Side by side, both reach from low to high, so that something of each is within reach of a seat. It is
    `width` [m] wide, 0.55 to 0.95; 0.6, and 0.75 at level 3, if zero. `hinge` is the side of its hinges
    along y, `low` or `high`. ConfigError if the width is out of range, or `hinge` is no side.
    """
    by_side = made.rules.level == 3
    width = width or (0.75 if by_side else 0.6)
    if not 0.55 <= width <= 0.95:
        raise ConfigError(f"a fridge is 0.55 to 0.95 m wide, got {width!r}")
    if hinge not in ("low", "high"):
        raise ConfigError(f"hinge must be 'low' or 'high', got {hinge!r}")
    half = 0.5 * width
    for y0, y1 in ((-half, -half + SHELL), (half - SHELL, half)):
        made.box((BACK, y0, FOOT), (BODY, y1, HIGH), "plastic")
    made.box((BACK, -half, HIGH - SHELL), (BODY, half, HIGH), "plastic")
    made.box((BACK, -half, FOOT), (BODY, half, FOOT + SHELL), "plastic")
    made.box((BACK, -half, FOOT), (BACK + SHELL, half, HIGH), "white")
    made.box((BACK + 0.03, -half + 0.02, 0.0), (BODY - 0.02, half - 0.02, FOOT), "metal_dark")
    floor, inner = FOOT + SHELL, half - SHELL
    if by_side:
        split = 0.1 * width  # the freezer is the narrower one
        made.box((BACK, split - 0.02, FOOT), (BODY, split + 0.02, HIGH), "white")
        _chill(made, (-inner, split - 0.02), floor, HIGH - SHELL)
        _freeze(made, (split + 0.02, inner), (floor, 0.5, 0.86, 1.22, HIGH - SHELL))
        _door(made, "fridge_door", (-half, split), (FOOT, HIGH), "low")
        _door(made, "freezer_door", (split, half), (FOOT, HIGH), "high")
    else:
        made.box((BACK, -half, FREEZER - 0.04), (BODY, half, FREEZER), "white")
        _freeze(made, (-inner, inner), (floor, 0.28, 0.43, FREEZER - 0.04))
        _chill(made, (-inner, inner), FREEZER, HIGH - SHELL)
        _door(made, "freezer_door", (-half, half), (FOOT, FREEZER - 0.02), hinge)
        _door(made, "fridge_door", (-half, half), (FREEZER - 0.02, HIGH), hinge)
    made.frame("shelf", (0.35, -0.5 * half if by_side else 0.0, FREEZER + 0.37), "middle shelf")
    depth = BODY + DOOR + 0.04
    aisle = front_zone(depth, half, made.rules.figure("kitchen_aisle"))
    made.outline(depth, half, HIGH, aisle, front_zone(depth, half, width - 0.05, "sweep"))


def _door(made: Joinery, name: str, y: Span, z: Span, hinge: str) -> None:
    door = made.door(
        name,
        (BODY, y[0], z[0]),
        (BODY + DOOR, y[1], z[1]),
        "plastic",
        left=hinge == "high",
        mass=12.0 * (y[1] - y[0]) * (z[1] - z[0]),  # 12 kg/m²: steel, foam, liner; from memory
        handle_z=min(max(1.05, z[0] + 0.12), z[1] - 0.12),
    )
    if name.startswith("freezer"):
        return
    # Shelves in the door stay clear of the walls as it swings.
    near, far = y[0] + 0.10, y[1] - 0.10
    for level, material, heights in (
        (0.05, "ceramic", (0.24, 0.2, 0.14)),
        (0.45, "accent", (0.1, 0.14, 0.09)),
        (0.80, "rug", (0.1, 0.14, 0.09)),
    ):
        base = z[0] + level
        door.box((BODY - 0.1, near, base), (BODY, far, base + 0.012), "glass")
        door.box((BODY - 0.1, near, base), (BODY - 0.088, far, base + 0.07), "glass")
        for k, tall in enumerate(heights):
            at = (BODY - 0.045, near + (k + 0.5) * (far - near) / 3, base + 0.012)
            door.post(at, base + tall, 0.034, material if k != 1 else "leaf")


def _chill(made: Joinery, y: Span, low: float, high: float) -> None:
    """Fill the fridge: shelves, food, a drawer for vegetables."""
    y0, y1 = y
    food = ("accent", "leaf", "paper", "rug", "ceramic", "clay", "blanket")
    count = round((high - low - 0.2) / 0.27)
    for row in range(count):
        z = low + 0.22 + row * (high - low - 0.22) / count
        made.box((BACK + SHELL, y0, z), (BODY - 0.12, y1, z + 0.012), "glass")
        for k in range(max(2, int((y1 - y0) / 0.13))):
            at, paint = y0 + 0.07 + 0.12 * k, food[(2 * row + 3 * k) % 7]
            top = z + (0.07 + 0.04 * ((row + k) % 3))
            if (row + k) % 2:
                made.post((0.3, at, z + 0.012), top, 0.045, paint)
            else:
                made.show((0.2, at - 0.045, z + 0.012), (0.38, at + 0.045, top), paint)
    made.show((BODY - 0.125, y0 + 0.01, low + 0.01), (BODY - 0.11, y1 - 0.01, low + 0.19), "glass")
    for k, paint in enumerate(("leaf", "accent", "leaf")):
        at = y0 + 0.08 + 0.5 * k * (y1 - y0 - 0.16)
        made.post((0.3, at, low + 0.01), low + 0.13, 0.05, paint)
    made.show((0.2, y0 + 0.1, high - 0.012), (0.4, y1 - 0.1, high), "lamp")


def _freeze(made: Joinery, y: Span, levels: tuple[float, ...]) -> None:
    """Fill the freezer with baskets that stand still."""
    front, y0, y1 = BODY - 0.05, y[0] + 0.005, y[1] - 0.005
    for low, high in zip(levels, levels[1:], strict=False):
        made.box((BACK + SHELL, y0, low), (front, y1, low + 0.014), "plastic")
        made.show((BODY - 0.064, y0, low), (front, y1, high - 0.03), "glass")
        made.show((0.2, y[0] + 0.04, low + 0.014), (0.45, y[1] - 0.06, low + 0.09), "blanket")


@furniture("oven_tower")
def oven_tower(made: Joinery) -> None:
    """Make a tall unit with an oven: its door drops down at level 1, and opens to the side else.

    A door to the side can be passed by a seat, and the oven is low enough to reach into from one.
    """
    half, by_side = 0.5 * DEPTH, made.rules.level > 1
    tall_carcass(made, half)
    unit, run = Unit("oven", -half, half), Run(made, 0.0, made.rules.figure("counter_height"))
    z0 = 0.76 if by_side else 0.88
    z1 = z0 + 0.48
    if by_side:
        oven_cavity(run, unit, z0, z1)
        low, high = (FACE - 0.03, -half, z0), (FACE, half, z1)
        # 5 kg: two panes and a frame, from memory; upright hinges carry all of it.
        door = made.door("oven_door", low, high, "metal_dark", left=False, mass=5.0)
        door.show((FACE, -half + 0.09, z0 + 0.08), (FACE + 0.002, half - 0.09, z1 - 0.08), "black")
    else:
        oven_front(run, unit, z0, z1)
    over = z1 + 0.1
    made.box((0.3, -half + 0.017, z1), (FACE, half - 0.017, over), "metal")
    oven_controls(run, unit, z1 + 0.05)
    made.frame("rack", (0.27, 0.0, z0 + 0.172), "middle of the rack")
    middle = 0.5 * (PLINTH + z0)
    for name, low_z, high_z in (("drawer_1", middle, z0), ("drawer_2", PLINTH, middle)):
        a, b = (CARCASS - 0.47, -half, low_z), (FACE, half, high_z)
        made.drawer(name, a, b, "front", travel=0.4, inner="trim", framed=True)
    a, b = (CARCASS, -half, over), (FACE, half, TALL)
    made.door("door", a, b, "front", left=False, handle_z=z1 + 0.22, framed=True)
    made.box((0.01, -half + 0.017, over), (0.5, half - 0.017, z1 + 0.116), "trim")
    stand_tall(made, half, SWEEP + 0.1)
