"""From the description of a house to its floor plan: rooms as large as a level wants, and windows."""

from __future__ import annotations

import dataclasses
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name

from ..rectangle import Rectangle
from .layout_door import DoorConfig, DoorKind, Joiner, Place, Request
from .layout_tree import Cell, Split, Tiling
from .layout_wall import Masonry, Panel
from .palette import Palette
from .plan import OUTSIDE, ROOM_KINDS, Opening, Plan, Room, Wall
from .rule import Rules

# What a room is for beside the kinds that are counted; own choice.
OTHER_USES = tuple(
    "closet entry gym hall laundry library office pantry playroom study sunroom workshop".split()
)
# How readily rooms take floor that is left over; own choice: halls never grow wider.
_GIVE = {"bathroom": 0.2, "closet": 0.2, "pantry": 0.2, "laundry": 0.25, "entry": 0.2}

# Furniture that sizes a room [m]; common sizes, from memory.
_BED = (1.6, 2.1)
_UNITS = 0.62  # depth of kitchen units
_KITCHEN_RUN = 3.0
_TUB_DEPTH = 0.78
_BASIN_WIDTH = 0.6
_SOFA_GROUP = (2.9, 3.1)
_TABLE = (0.9, 1.5)
_CHAIR = 0.5  # depth that a pulled-in chair adds
_HALF_TOILET = 0.2
_BATH_SPARE = 0.25  # more than the parts, since doors take corners; own choice
_ENDINGS = (".yaml", ".yml")
_FLOORS = ("wood", "tile", "carpet")
# What floors are made of where a house does not say; own choice.
_USUAL_FLOORS = {
    **dict.fromkeys(("kitchen", "bathroom", "laundry", "entry", "pantry", "sunroom"), "tile"),
    **dict.fromkeys(("bedroom", "library"), "carpet"),
}
_SIDES = ("north", "east", "south", "west")

Wish = tuple[str, str] | DoorConfig
LIVED_IN = ("bedroom", "living", "lounge", "kitchen", "dining")
_MARGIN = 300  # [mm] of wall beside a window
_APART = 900  # [mm] of wall between two windows


def room_kind_give(use: str) -> float:
    """Return how readily a room takes floor that is left over."""
    return _GIVE.get(use, 1.0)


def least_size(use: str, rules: Rules) -> tuple[float, float]:
    """Return the least inner extent of a room [m], the shorter side first.

    Halls have no least length. Furniture and ways between are own choice; all else is by the rules.
    """
    turn = rules.figure("turning_diameter", 0.0)
    way = rules.figure("passage_width")
    room = max(way, turn)
    if use == "hall":
        return rules.figure("hallway_width"), rules.figure("hallway_width")
    if use == "bathroom":
        return _bathroom(rules, max(turn, 0.8))
    if use == "bedroom":
        return _BED[0] + 2 * rules.figure("bed_side_space"), _BED[1] + room + 0.3
    if use == "kitchen":
        knee = rules.figure("counter_knee_width", 0.0)
        return 2 * _UNITS + max(rules.figure("kitchen_aisle"), turn), _KITCHEN_RUN + knee
    if use == "living":
        return _SOFA_GROUP[0] + way, _SOFA_GROUP[1] + room
    if use == "lounge":
        return _SOFA_GROUP[0] + 0.2 * room, _SOFA_GROUP[0] + room
    if use == "dining":
        return _TABLE[0] + 2 * (_CHAIR + way) - 0.2, _TABLE[1] + 2 * _CHAIR + room
    if use in ("study", "office", "gym", "workshop", "library", "playroom", "sunroom"):
        return 1.4 + max(way, 0.8 * turn), 2.0 + way
    return {"closet": 0.8, "pantry": 0.9, "laundry": 0.9, "entry": 0.8}[use] + way, 1.2 + way


def _bathroom(rules: Rules, room: float) -> tuple[float, float]:
    """Toilet and basin along one wall, bath or shower along the next, room to turn between."""
    depth = rules.figure("shower_depth", _TUB_DEPTH)
    beside = rules.figure("toilet_side_space", 0.2)
    latch = rules.figure("latch_side_space")
    wall = rules.figure("toilet_centre_to_wall") + _HALF_TOILET + beside + _BASIN_WIDTH + latch
    spare = _BATH_SPARE if rules.has("turning_diameter") else 0.0
    across, wall = depth + room + spare, wall + spare
    return min(wall, across), max(wall, across)


@dataclass(frozen=True)
class HouseConfig:
    """A house, for all levels of accessibility.

    Attributes:
        title: What kind of house it is.
        story: Who lives there.
        plan: How its floor is cut into rooms.
        doors: Pairs of rooms with a door between them.
        entrances: Rooms and the sides of them that lead outside; the first is the main entrance.
        passages: Pairs of rooms that are open to each other.
        windows: Sides of rooms where windows are, for rooms where the usual rule does not do.
        palette: Colours that differ from the usual.
        floors: `wood`, `tile` or `carpet` by use of room where it differs from the usual.
        name: Name of the file.
    """

    title: str
    story: str
    plan: Split
    doors: tuple[Wish, ...]
    entrances: tuple[Wish, ...]
    passages: tuple[Wish, ...] = ()
    windows: dict[str, tuple[str, ...]] = field(default_factory=dict)
    palette: dict[str, tuple[float, float, float, float]] = field(default_factory=dict)
    floors: dict[str, str] = field(default_factory=dict)
    name: str = "house"

    def __post_init__(self) -> None:
        for name, count in Counter(self.rooms).items():
            if count > 1:
                raise ConfigError(f"{count} rooms are named {name!r}")
            use_of(name)
        for wish in (*self.doors, *self.passages):
            for room in _wish(wish).between:
                self._check_room(room)
        if not self.entrances:
            raise ConfigError("a house has at least one entrance")
        sides = [(_wish(wish).between[0], (_wish(wish).between[1],)) for wish in self.entrances]
        for room, wanted in (*sides, *self.windows.items()):
            self._check_room(room)
            for side in wanted:
                check_name("side of a room", side, _SIDES)
        for use, finish in self.floors.items():
            check_name("use of rooms", use, ROOM_KINDS[:-1] + OTHER_USES)
            check_name("floor", finish, _FLOORS)
        self.colours()

    def _check_room(self, room: str) -> None:
        check_name("room of the house", room, self.rooms)

    @property
    def rooms(self) -> tuple[str, ...]:
        """Names of the rooms, west to east and north to south."""
        return tuple(leaf.room for leaf in self.plan.leaves() if leaf.room != OUTSIDE)

    def colours(self) -> Palette:
        """Return the colours of the house; UnknownNameError for what is no field of `Palette`."""
        for colour, value in self.palette.items():
            check_name("colour", colour, Palette.__dataclass_fields__)
            if not all(0 <= part <= 1 for part in value):
                raise ConfigError(f"colour {colour} must be within 0 and 1, got {value}")
        return dataclasses.replace(Palette(), **self.palette)

    def finish(self, room: str, level: int) -> str:
        """Return what the floor of a room is of; carpets are hard to roll on, so only level 1 has them."""
        use = use_of(room)
        finish = self.floors.get(use, _USUAL_FLOORS.get(use, "wood"))
        return "wood" if finish == "carpet" and level > 1 else finish


def use_of(room: str) -> str:
    """Return what a room is for by its name, such as `hall` for `hall_1`.

    Raises:
        ConfigError: If the name does not end in a number.
        UnknownNameError: If there is no such use.
    """
    use, _, number = room.rpartition("_")
    if not number.isdigit():
        raise ConfigError(f"a room is named by its use and a number, such as hall_1, got {room!r}")
    check_name("use of rooms", use, ROOM_KINDS[:-1] + OTHER_USES)
    return use


def load_house(name: str | Path) -> HouseConfig:
    """Load the description of a house.

    Args:
        name: Name of a house that comes with the package, or a YAML file.

    Raises:
        UnknownNameError: If there is no such house, or a name in it is unknown.
        ConfigError: If its description is wrong.
    """
    is_file = isinstance(name, Path) or name.endswith(_ENDINGS)
    path = Path(name) if is_file else assets.find("homes", str(name))
    return dataclasses.replace(load(HouseConfig, path), name=path.stem)


def lay_out(house: HouseConfig, level: int) -> Plan:
    """Draw the floor plan of a house at a level of accessibility.

    Rooms have their usual size or what the rules ask for, if that is more; what is left over in a
    row or column is shared out among the rooms that are no halls.

    Raises:
        ConfigError: If `level` is unknown, rooms with a door between them do not touch, a door does
            not fit, a room to live in has no window, or a room cannot be reached.
    """
    rules = Rules(level)
    uses = {name: use_of(name) for name in house.rooms}

    def least(room: str, usual: tuple[float, float]) -> tuple[float, float]:
        short, long = least_size(uses[room], rules)
        return (short, long) if usual[0] <= usual[1] else (long, short)

    tiling = Tiling(house.plan, least, lambda room: room_kind_give(uses.get(room, room)))
    cells = {leaf.room: cell for leaf, cell in tiling.cells if leaf.room != OUTSIDE}
    options = {leaf.room: leaf.options for leaf, _ in tiling.cells}
    masonry = Masonry({name: cells[name] for name in house.rooms})
    joiner = Joiner(masonry, uses, rules)
    places = joiner.place(_requests(house, joiner))
    windows = set_windows(masonry, uses, places, house.windows)
    openings = [*(joiner.opening(place) for place in places), *windows]
    plan = Plan(
        name=house.name,
        title=house.title,
        level=level,
        rooms={
            name: Room(
                name,
                use if use in ROOM_KINDS else "other",
                use,
                _metres(masonry.insides[name]),
                dict(options[name]),
                house.finish(name, level),
            )
            for name, use in uses.items()
        },
        walls=tuple(Wall(_metres(run.area), run.axis, run.is_outer) for run in masonry.runs),
        openings={opening.name: opening for opening in openings},
        outline=tuple(_metres(area) for area in masonry.outline),
    )
    lost = set(plan.rooms) - reachable(plan)
    if lost:
        raise ConfigError(f"{house.name}: no way from the entrance to {', '.join(sorted(lost))}")
    return plan


def reachable(plan: Plan, *, clear_width: float = 0.0) -> set[str]:
    """Return the rooms that can be reached from the entrances through doors of a clear width [m]."""
    ways = [
        o for o in plan.openings.values() if o.kind != "window" and o.clear_width >= clear_width
    ]
    found = {opening.rooms[0] for opening in ways if opening.kind == "entrance"}
    inner = [opening for opening in ways if opening.kind != "entrance"]
    while True:
        more = {r for o in inner if found & set(o.rooms) for r in o.rooms} - found
        if not more:
            return found
        found |= more


def _wish(wish: Wish) -> DoorConfig:
    return wish if isinstance(wish, DoorConfig) else DoorConfig(wish)


def _requests(house: HouseConfig, joiner: Joiner) -> list[Request]:
    wanted: tuple[tuple[DoorKind, tuple[Wish, ...]], ...] = (
        ("entrance", house.entrances),
        ("passage", house.passages),
        ("door", house.doors),
    )
    return [
        joiner.request(f"{kind}_{k}", kind, _wish(wish))
        for kind, wishes in wanted
        for k, wish in enumerate(wishes, 1)
    ]


def _metres(area: Cell) -> Rectangle:
    return Rectangle(area.x0 / 1000, area.y0 / 1000, area.x1 / 1000, area.y1 / 1000)


@dataclass(frozen=True)
class Sash:
    """Windows of a kind of room: widest and narrowest [mm], sill and head [m]; own choice."""

    widest: int
    narrowest: int
    sill: float
    head: float = 2.1


_SASHES = {
    "bedroom": Sash(1500, 700, 0.85),
    "living": Sash(2200, 900, 0.55),
    "lounge": Sash(1900, 800, 0.65),
    "dining": Sash(1800, 800, 0.75),
    "kitchen": Sash(1300, 700, 1.15),
    "bathroom": Sash(600, 450, 1.55),
    "sunroom": Sash(2400, 700, 0.45, 2.2),
    "hall": Sash(700, 450, 1.1),
    "entry": Sash(600, 400, 1.1),
    "laundry": Sash(700, 450, 1.35),
    "closet": Sash(500, 450, 1.6),
    "pantry": Sash(500, 450, 1.6),
}
_ELSE = Sash(1300, 600, 0.95)


def set_windows(
    masonry: Masonry, uses: dict[str, str], doors: list[Place], only: dict[str, tuple[str, ...]]
) -> list[Opening]:
    """Return windows for all rooms with outer walls.

    Args:
        masonry: Walls.
        uses: What rooms are for, by name.
        doors: Doors in their places.
        only: The sides of some rooms on which their windows are.

    Raises:
        ConfigError: If a room to live in gets no window.
    """
    out: list[Opening] = []
    for room, use in uses.items():
        sash, before = _SASHES.get(use, _ELSE), len(out)
        panels = [p for p in masonry.panels if p.rooms == (room, OUTSIDE)]
        if room in only:
            panels = [p for p in panels if p.side in only[room]]
        elif use in ("bathroom", "closet", "pantry", "laundry"):
            panels = sorted(panels, key=lambda p: p.span[0] - p.span[1])[:1]
        elif use == "hall":  # lit from its ends
            panels = [p for p in panels if p.span[1] - p.span[0] <= 2000]
        for panel in panels:
            for low, high in _free(panel, doors):
                for start, width in _fit(low, high, sash):
                    ends, name = (start, start + width), f"window_{len(out) + 1}"
                    out.append(panel.opening(name, "window", *ends, sill=sash.sill, head=sash.head))
        if use in LIVED_IN and len(out) == before:
            raise ConfigError(f"{room} has no outer wall for a window")
    return out


def _free(panel: Panel, doors: list[Place]) -> list[tuple[int, int]]:
    """Return stretches [mm] of an outer wall where no door and no open leaf is."""
    low, high = panel.span
    taken = []
    for door in doors:
        if door.run.area.overlaps(panel.area):
            taken.append((door.low - _MARGIN, door.high + _MARGIN))
        leaf = door.leaf
        if leaf is not None and leaf.overlaps(panel.area.grown(250)):
            taken.append(leaf.span(panel.axis))
    out, start = [], low
    for a, b in sorted(taken):
        if b <= low or a >= high:
            continue
        if a > start:
            out.append((start, a))
        start = max(start, b)
    if start < high:
        out.append((start, high))
    return out


def _fit(low: int, high: int, sash: Sash) -> list[tuple[int, int]]:
    """Return starts and widths of windows in a stretch of wall [mm]: one, or two in a long one."""
    length = high - low
    if length >= 2 * sash.widest + 2 * _MARGIN + _APART and sash.widest >= 1800:
        step = length // 2
        return [(low + k * step + (step - sash.widest) // 2, sash.widest) for k in range(2)]
    width = min(sash.widest, (length - 2 * _MARGIN) // 50 * 50)
    return [(low + (length - width) // 2, width)] if width >= sash.narrowest else []
