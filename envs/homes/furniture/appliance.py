"""Appliances that stand by themselves: fridge, oven tower, microwave oven."""

from __future__ import annotations

from rcare_marl.errors import ConfigError

from ...rectangle import Rectangle
from ..piece import Piece, Setting, maker
from .joinery import Joinery, front_zone, wall_strip
from .kitchen import SWEEP, TALL, add_fruit, add_kettle, add_knives, tall_carcass
from .kitchen_layout import Unit
from .kitchen_unit import CARCASS, DEPTH, FRONT, PLINTH, Run, oven_cavity, oven_controls, oven_front

# Of fridges [m]; common, from memory.
HIGH = 1.8
BODY = 0.60
BACK = 0.02
SHELL = 0.04
DOOR = 0.06
FREEZER = 0.62
FOOT = 0.08


@maker("fridge")
def fridge(setting: Setting, *, width: float = 0.0, hinge: str = "low") -> Piece:
    """Return a fridge with a freezer: below it at levels 1 and 2, beside it at level 3.

    Side by side, both reach from low to high, so that something of each is within reach of a seat.

    Args:
        setting: What it is made for.
        width: 0.55 to 0.95 [m]; 0.6, and 0.75 at level 3, if zero.
        hinge: The side of the hinges along y, `low` or `high`.

    Raises:
        ConfigError: If the width is out of range, or `hinge` is no side.
    """
    by_side = setting.rules.level == 3
    width = width or (0.75 if by_side else 0.6)
    if not 0.55 <= width <= 0.95:
        raise ConfigError(f"a fridge is 0.55 to 0.95 m wide, got {width!r}")
    if hinge not in ("low", "high"):
        raise ConfigError(f"hinge must be 'low' or 'high', got {hinge!r}")
    add = Joinery("fridge", setting)
    half = 0.5 * width
    for y0, y1 in ((-half, -half + SHELL), (half - SHELL, half)):
        add.box((BACK, y0, FOOT), (BODY, y1, HIGH), "plastic")
    add.box((BACK, -half, HIGH - SHELL), (BODY, half, HIGH), "plastic")
    add.box((BACK, -half, FOOT), (BODY, half, FOOT + SHELL), "plastic")
    add.box((BACK, -half, FOOT), (BACK + SHELL, half, HIGH), "white")
    add.box((BACK + 0.03, -half + 0.02, 0.0), (BODY - 0.02, half - 0.02, FOOT), "metal_dark")
    floor, inner = FOOT + SHELL, half - SHELL
    if by_side:
        split = 0.1 * width  # the freezer is the narrower one
        add.box((BACK, split - 0.02, FOOT), (BODY, split + 0.02, HIGH), "white")
        cold, ice = (-inner, split - 0.02), (split + 0.02, inner)
        _chill(add, cold, floor, HIGH - SHELL)
        _freeze(add, ice, (floor, 0.5, 0.86, 1.22, HIGH - SHELL))
        _door(add, "fridge_door", (-half, split), (FOOT, HIGH), "low")
        _door(add, "freezer_door", (split, half), (FOOT, HIGH), "high")
    else:
        add.box((BACK, -half, FREEZER - 0.04), (BODY, half, FREEZER), "white")
        _freeze(add, (-inner, inner), (floor, 0.28, 0.43, FREEZER - 0.04))
        _chill(add, (-inner, inner), FREEZER, HIGH - SHELL)
        _door(add, "freezer_door", (-half, half), (FOOT, FREEZER - 0.02), hinge)
        _door(add, "fridge_door", (-half, half), (FREEZER - 0.02, HIGH), hinge)
    add.frame("shelf", (0.35, -0.5 * half if by_side else 0.0, FREEZER + 0.37), note="middle shelf")
    depth = BODY + DOOR + 0.04
    return add.piece(
        wall_strip(depth, width),
        HIGH,
        zones=(
            front_zone(depth, width, setting.rules.figure("kitchen_aisle")),
            front_zone(depth, width, width - 0.05, "sweep"),
        ),
    )


def _door(
    add: Joinery, name: str, y: tuple[float, float], z: tuple[float, float], hinge: str
) -> None:
    low, high = (BODY, y[0], z[0]), (BODY + DOOR, y[1], z[1])
    mass = 12.0 * (y[1] - y[0]) * (z[1] - z[0])  # [kg], 12 kg/m²: steel, foam, liner; from memory
    grip = min(max(1.05, z[0] + 0.12), z[1] - 0.12)
    if hinge == "low":
        add.door(name, low, high, "plastic", hinge="right", mass=mass, handle_z=grip)
    else:
        add.door(name, low, high, "plastic", hinge="left", mass=mass, handle_z=grip)
    if name.startswith("freezer"):
        return
    # Shelves in the door stay clear of the walls as it swings.
    near, far = y[0] + 0.10, y[1] - 0.10
    for level, material in ((0.05, "ceramic"), (0.45, "accent"), (0.80, "rug")):
        base = z[0] + level
        add.box((BODY - 0.1, near, base), (BODY, far, base + 0.012), "glass", link=name)
        add.box((BODY - 0.1, near, base), (BODY - 0.088, far, base + 0.07), "glass", link=name)
        for k in range(3):
            at = near + (k + 0.5) * (far - near) / 3
            tall = (0.24, 0.2, 0.14)[k] if level < 0.1 else (0.1, 0.14, 0.09)[k]
            paint = material if k != 1 else "leaf"
            add.rod(
                ((BODY - 0.045, at, base + 0.012), (BODY - 0.045, at, base + tall)),
                0.034,
                paint,
                link=name,
            )


def _chill(add: Joinery, y: tuple[float, float], low: float, high: float) -> None:
    """Fill the fridge: shelves, food, a drawer for vegetables."""
    y0, y1 = y
    food = ("accent", "leaf", "paper", "rug", "ceramic", "clay", "blanket")
    count = round((high - low - 0.2) / 0.27)
    for row in range(count):
        z = low + 0.22 + row * (high - low - 0.22) / count
        add.box((BACK + SHELL, y0, z), (BODY - 0.12, y1, z + 0.012), "glass")
        for k in range(max(2, int((y1 - y0) / 0.13))):
            at, paint = y0 + 0.07 + 0.12 * k, food[(2 * row + 3 * k) % 7]
            tall = 0.07 + 0.04 * ((row + k) % 3)
            if (row + k) % 2:
                add.rod(((0.3, at, z + 0.012), (0.3, at, z + tall)), 0.045, paint)
            else:
                add.box(
                    (0.2, at - 0.045, z + 0.012), (0.38, at + 0.045, z + tall), paint, solid=False
                )
    low_box, top = (BODY - 0.125, y0 + 0.01, low + 0.01), (BODY - 0.11, y1 - 0.01, low + 0.19)
    add.box(low_box, top, "glass", solid=False)
    for k in range(3):
        at = y0 + 0.08 + 0.5 * k * (y1 - y0 - 0.16)
        add.rod(((0.3, at, low + 0.01), (0.3, at, low + 0.13)), 0.05, ("leaf", "accent", "leaf")[k])
    add.box((0.2, y0 + 0.1, high - 0.012), (0.4, y1 - 0.1, high), "lamp", solid=False)


def _freeze(add: Joinery, y: tuple[float, float], levels: tuple[float, ...]) -> None:
    """Fill the freezer with baskets that stand still."""
    for low, high in zip(levels, levels[1:], strict=False):
        a, b = (BACK + SHELL, y[0] + 0.005, low), (BODY - 0.05, y[1] - 0.005, low + 0.014)
        add.box(a, b, "plastic")
        a, b = (BODY - 0.064, y[0] + 0.005, low), (BODY - 0.05, y[1] - 0.005, high - 0.03)
        add.box(a, b, "glass", solid=False)
        a, b = (0.2, y[0] + 0.04, low + 0.014), (0.45, y[1] - 0.06, low + 0.09)
        add.box(a, b, "blanket", solid=False)


@maker("oven_tower")
def oven_tower(setting: Setting) -> Piece:
    """Return a tall unit with an oven: its door drops down at level 1, and opens to the side else.

    A door to the side can be passed by a seat, and the oven is low enough to reach into from one.
    """
    add = Joinery("oven_tower", setting)
    half, by_side = 0.5 * DEPTH, setting.rules.level > 1
    tall_carcass(add, half)
    unit, run = Unit("oven", -half, half), Run(add, 0.0, setting.rules.figure("counter_height"))
    z0 = 0.76 if by_side else 0.88
    z1 = z0 + 0.48
    face = CARCASS + FRONT
    if by_side:
        oven_cavity(run, unit, z0, z1)
        low, high = (face - 0.03, -half, z0), (face, half, z1)
        # 5 kg: two panes and a frame, from memory; upright hinges carry all of it.
        add.door("oven_door", low, high, "metal_dark", hinge="right", mass=5.0)
        a, b = (face, -half + 0.09, z0 + 0.08), (face + 0.002, half - 0.09, z1 - 0.08)
        add.box(a, b, "black", link="oven_door", solid=False)
    else:
        oven_front(run, unit, z0, z1)
    add.box((0.3, -half + 0.017, z1), (face, half - 0.017, z1 + 0.1), "metal")
    oven_controls(run, unit, z1 + 0.05)
    add.frame("rack", (0.27, 0.0, z0 + 0.172), note="middle of the rack")
    middle = 0.5 * (PLINTH + z0)
    for name, low_z, high_z in (("drawer_1", middle, z0), ("drawer_2", PLINTH, middle)):
        a, b = (CARCASS - 0.47, -half, low_z), (face, half, high_z)
        add.drawer(name, a, b, "front", travel=0.4, inner="trim", framed=True)
    a, b = (CARCASS, -half, z1 + 0.1), (face, half, TALL)
    add.door("door", a, b, "front", hinge="right", handle_z=z1 + 0.22, framed=True)
    add.box((0.01, -half + 0.017, z1 + 0.1), (0.5, half - 0.017, z1 + 0.116), "trim")
    return add.piece(
        wall_strip(DEPTH, DEPTH),
        TALL,
        zones=(
            front_zone(DEPTH, DEPTH, setting.rules.figure("kitchen_aisle")),
            front_zone(DEPTH, DEPTH, SWEEP + 0.1, "sweep"),
        ),
    )


@maker("microwave")
def microwave(setting: Setting) -> Piece:
    """Return a microwave oven to stand on a worktop; its floor is that of the worktop."""
    add = Joinery("microwave", setting)
    half, deep, high, wall = 0.24, 0.34, 0.28, 0.014
    split = half - 0.12
    add.box((0.0, -half, 0.01), (deep, half, 0.01 + wall), "plastic")
    add.box((0.0, -half, high - wall), (deep, half, high), "plastic")
    add.box((0.0, -half, 0.01), (wall, half, high), "plastic")
    add.box((0.0, -half, 0.01), (deep, -half + wall, high), "plastic")
    add.box((0.0, split, 0.01), (deep + 0.02, half, high), "plastic")
    for x in (0.04, deep - 0.04):
        for y in (-half + 0.04, half - 0.04):
            add.rod(((x, y, 0.0), (x, y, 0.01)), 0.014, "rubber")
    add.rod(((0.17, -0.06, 0.024), (0.17, -0.06, 0.032)), 0.13, "glass")
    low, top = (deep, -half, 0.01), (deep + 0.02, split, high)
    add.door("door", low, top, "plastic", hinge="right", mass=1.2)
    a, b = (deep + 0.02, -half + 0.04, 0.05), (deep + 0.022, split - 0.06, high - 0.04)
    add.box(a, b, "black", link="door", solid=False)
    face, middle = deep + 0.02, 0.5 * (split + half)
    add.box((face, split + 0.02, 0.2), (face + 0.002, half - 0.02, 0.24), "black", solid=False)
    for z in (0.08, 0.14):
        add.rod(((face, middle, z), (face + 0.018, middle, z)), 0.02, "metal")
    add.frame("plate", (0.17, -0.06, 0.032), note="middle of the turntable")
    return add.piece(wall_strip(deep + 0.06, 2 * half), high, zones=())


@maker("kettle")
def kettle(setting: Setting) -> Piece:
    """Return a kettle to stand on a worktop; its floor is that of the worktop."""
    add = Joinery("kettle", setting)
    add_kettle(add, (0.09, 0.0, 0.0))
    return add.piece(Rectangle(0.0, -0.14, 0.18, 0.115), 0.21)


@maker("knife_block")
def knife_block(setting: Setting) -> Piece:
    """Return a block of knives to stand on a worktop; its floor is that of the worktop."""
    add = Joinery("knife_block", setting)
    add_knives(add, (0.06, 0.0, 0.0))
    return add.piece(wall_strip(0.12, 0.10), 0.29)


@maker("fruit_bowl")
def fruit_bowl(setting: Setting) -> Piece:
    """Return a bowl of fruit to stand on a table; its floor is that of the table."""
    add = Joinery("fruit_bowl", setting)
    add_fruit(add, (0.14, 0.0, 0.0))
    return add.piece(wall_strip(0.28, 0.28), 0.14)
