"""Where a task takes place: a bare floor, or a room of a home, behind one protocol."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

from rcare_marl.body import Body
from rcare_marl.model.urdf import Model
from rcare_marl.pose import Pose

from .rectangle import Rectangle

if TYPE_CHECKING:
    from rcare_marl.rendering import Camera
    from rcare_marl.world import World

    from .devices import Frame
    from .homes import Door as Door  # the one thing of homes that tasks see, and by this name

FLOOR_FRICTION = 0.8  # [1]; our own choice
HardwareSide = Literal["low", "high"]


@dataclass(frozen=True)
class Fixture:
    """A piece of furniture that a task is about, in a world.

    Attributes:
        body: Its body.
        model: Its links and joints.
        frames: Named places on it.
        walls: Walls that were built about it.
    """

    body: Body
    model: Model
    frames: Mapping[str, Frame]
    walls: Sequence[Body] = ()


@dataclass(frozen=True)
class DoorSize:
    """Measures of a door in the frame of its opening [m].

    Attributes:
        side: Where its hinges or pocket are: 1 where x grows, or -1.
        width: Of the leaf or panel.
        bottom: Height of its lower edge.
        top: Height of its upper edge.
        pivot: Axis of the hinges (x, y); where the panel's frame is, of panels.
        face: y of the face that looks into the first room.
        handle: Where handles are along x, and their height.
    """

    side: int
    width: float
    bottom: float
    top: float
    pivot: tuple[float, float]
    face: float
    handle: tuple[float, float]


@dataclass(frozen=True)
class DoorSite:
    """A door as a plan shows it, seen from y < 0 of its frame, or of that turned half round.

    Attributes:
        hardware: What opens it: `knob`, `lever` or `slider`.
        handle: Where it is touched while it is shut, in the frame of the site [m].
        thickness: Of the wall [m].
        is_turned: Whether the frame is that of the door turned half round.
        is_free: Whether a floor beyond the door [m], in the frame of the door, is free.
    """

    hardware: str
    handle: tuple[float, float, float]
    thickness: float
    is_turned: bool
    is_free: Callable[[Rectangle], bool]


# The free floor before a door [m] in the frame of the site; None if it cannot be worked from there.
FloorBefore = Callable[[DoorSite], Rectangle | None]


class Place(Protocol):
    """Where a task takes place; its origin is that of the world.

    Attributes:
        level: Level of accessibility of what stands there, 1 to 3.
        at_fixture: The piece of furniture or the door of a house at which the origin is, by name; else empty.
    """

    level: int
    at_fixture: str

    @property
    def name(self) -> str:
        """What it is, for messages."""

    @property
    def room(self) -> Rectangle | None:
        """The floor between the walls of the room [m]; None where there is no room."""

    @property
    def floor(self) -> Body:
        """The floor."""

    @property
    def obstacles(self) -> Sequence[tuple[str, Body]]:
        """What one can run into that the task did not put there, with what it is; not the floor."""

    def lay_floor(self, world: World) -> None:
        """Put the floor into a world, once, with all that stands on it."""

    def fixture(self, kind: str) -> Fixture:
        """Return the piece of furniture at the origin, of a kind such as `toilet`."""

    def door(self, *, hinge: HardwareSide = "low", clear_width: float | None = None) -> Door:
        """Return the door at the origin.

        Args:
            hinge: The end of the gap along x where hinges or pocket are, of a door that is built here.
            clear_width: Of a door that is built here [m]; that of the level if None.

        Raises:
            ConfigError: If `clear_width` is given and the door is that of a house.
        """

    def view(self, camera: Camera) -> Camera:
        """Return a camera like the one given that sees from within the room, where there is one."""

    def facts(self) -> dict[str, Any]:
        """Return what a record says of it, as plain values; nothing of a bare floor."""


class BareFloor:
    """A floor of 6 m by 6 m without walls; see `Place`."""

    name = "a bare floor"
    room = None
    at_fixture = ""
    floor: Body

    def __init__(self, level: int = 1) -> None:
        """Choose the level of accessibility of what is built on it."""
        self.level = level
        self.obstacles: Sequence[tuple[str, Body]] = ()

    def lay_floor(self, world: World) -> None:
        self._world = world
        self.floor = world.add_box((6, 6, 0.1), Pose((0, 0, -0.05)), name="floor")
        self.floor.set_friction([-1], lateral=FLOOR_FRICTION)

    def fixture(self, kind: str) -> Fixture:
        from .homes import build_fixture  # houses take long to import

        built = build_fixture(self._world, kind, level=self.level)
        self.obstacles = [("a wall", wall) for wall in built.walls]
        return built

    def door(self, *, hinge: HardwareSide = "low", clear_width: float | None = None) -> Door:
        from .homes import build_door

        return build_door(self._world, level=self.level, hinge=hinge, clear_width=clear_width)

    def view(self, camera: Camera) -> Camera:
        return camera

    def facts(self) -> dict[str, Any]:
        return {}
