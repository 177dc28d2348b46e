"""From the description of a house to its floor plan at a level of accessibility."""

from __future__ import annotations

import dataclasses
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name

from ..rectangle import Rectangle
from .layout_door import DoorConfig, DoorKind, Joiner, Request
from .layout_size import OTHER_USES, least_size, room_kind_give
from .layout_tree import Cell, Split, Tiling
from .layout_wall import Masonry
from .layout_window import set_windows
from .palette import Palette
from .plan import OUTSIDE, ROOM_KINDS, Plan, Room, Wall
from .rule import Rules

_ENDINGS = (".yaml", ".yml")
_FLOORS = ("wood", "tile", "carpet")
# What floors are made of where a house does not say; own choice.
_USUAL_FLOORS = {
    **dict.fromkeys(("kitchen", "bathroom", "laundry", "entry"), "tile"),
    **dict.fromkeys(("pantry", "workshop", "sunroom"), "tile"),
    **dict.fromkeys(("bedroom", "closet"), "carpet"),
}
_SIDES = ("north", "east", "south", "west")

Wish = tuple[str, str] | DoorConfig


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

    def floor(self, room: str) -> str:
        """Return the colour of the `Palette` that the floor of a room has."""
        use = use_of(room)
        return "floor_" + self.floors.get(use, _USUAL_FLOORS.get(use, "wood"))


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
