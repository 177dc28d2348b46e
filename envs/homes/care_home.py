"""A home: loaded by name and level, walked through, with named places, and put into a world."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from rcare_marl import assets
from rcare_marl.agents.agent import Agent
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.world import World

from ..rectangle import Rectangle
from .doorway import narrowing
from .furnishing import Placed, furnish
from .layout import lay_out, load_house
from .occupancy import BORDER, Obstacle, Occupancy
from .palette import Palette
from .piece import Piece, Setting, Zone
from .plan import Plan, Room
from .route import HAND_ROOM, WHEELCHAIR_WIDTH, Route, Way
from .rule import Rules

if TYPE_CHECKING:
    from .built import BuiltHome

_KNOWN_AS = {"hospital_bed": "bed"}  # a task beside a bed takes either


def home_names() -> tuple[str, ...]:
    """Return the names of the houses that come with the package, sorted."""
    return assets.names("homes")


@dataclass(frozen=True)
class Spot:
    """A place.

    Attributes:
        pose: Where, in the house; x points where somebody there looks.
        note: What it is.
    """

    pose: Pose
    note: str


@dataclass(frozen=True, eq=False)
class CareHome:
    """A furnished house at one level of accessibility; x east, y north, floor at z = 0 [m].

    Attributes:
        name: Name of the house.
        level: 1 usual, 2 partially barrier-free, 3 completely barrier-free.
        plan: Rooms, walls and openings.
        rules: The rules of its level.
        palette: Its colours.
        placed: All furniture.
    """

    name: str
    level: int
    plan: Plan
    rules: Rules
    palette: Palette
    placed: tuple[Placed, ...]

    @classmethod
    def load(cls, name: str | Path, *, level: int = 1) -> CareHome:
        """Build a house from its description.

        Args:
            name: One of `home_names()`, or a YAML file with a house of your own.
            level: Level of accessibility.

        Raises:
            UnknownNameError: If there is no such house, or a name in its description is unknown.
            ConfigError: If `level` is not 1, 2 or 3, or the description is wrong.

        Example:
            >>> home = CareHome.load("house_07", level=3)
            >>> [room.name for room in home.rooms("kitchen")]
            ['kitchen_1']
        """
        rules = Rules(level)
        house = load_house(name)
        plan = lay_out(house, level)
        palette = house.colours()
        setting = Setting(rules, palette)
        made: dict[str, Piece] = {}
        placed = [p for room in plan.rooms.values() for p in furnish(plan, room, setting, made)]
        return cls(house.name, level, plan, rules, palette, tuple(placed))

    def rooms(self, kind: str | None = None) -> tuple[Room, ...]:
        """Return the rooms of a kind or use, such as `kitchen` or `hall`; all if None.

        Raises:
            UnknownNameError: If this house has no such room.
        """
        rooms = tuple(self.plan.rooms.values())
        if kind is None:
            return rooms
        known = sorted({room.kind for room in rooms} | {room.use for room in rooms})
        check_name(f"kind of room in {self.name}", kind, known)
        return tuple(room for room in rooms if kind in (room.kind, room.use))

    def room(self, name: str) -> Room:
        """Return a room by name; UnknownNameError if there is none."""
        return self.plan.room(name)

    def furniture(self, room: str) -> tuple[Placed, ...]:
        """Return what stands in a room; UnknownNameError if there is no such room."""
        self.plan.room(room)
        return tuple(placed for placed in self.placed if placed.room == room)

    @cached_property
    def clearance(self) -> Occupancy:
        """The map of free floor, for somebody on foot."""
        return self._map(knees=False)

    @cached_property
    def wheel_clearance(self) -> Occupancy:
        """The map of free floor, where wheelchairs may reach under what has room for knees."""
        return self._map(knees=True)

    def _map(self, *, knees: bool) -> Occupancy:
        bounds = Rectangle.around(self.plan.outline).grown(BORDER)
        things = [Obstacle(area, "wall") for area in self._walls()]
        for placed in self.placed:
            if placed.piece.blocks:
                areas = placed.wheel_footprint if knees else (placed.footprint,)
                things += [Obstacle(area, placed.name, placed.room) for area in areas]
        return Occupancy(bounds, things)

    def _walls(self) -> list[Rectangle]:
        """Return the floor that walls, linings and open leaves take."""
        out: list[Rectangle] = []
        ways = [o for o in self.plan.openings.values() if o.kind != "window"]
        for wall in self.plan.walls:
            parts = [wall.area]
            for opening in ways:
                parts = [p for part in parts for p in part.without(opening.gap)]
            out += parts
        for opening in ways:
            out += narrowing(opening)
        return out

    def way(self, width: float = WHEELCHAIR_WIDTH + HAND_ROOM) -> Way:
        """Return the floor on which somebody `width` [m] wide can move."""
        return Way(self.wheel_clearance, width)

    def route(
        self, start: str, goal: str, *, width: float = WHEELCHAIR_WIDTH + HAND_ROOM
    ) -> Route | None:
        """Return a way from room to room for a wheelchair, or None if there is none.

        Args:
            start: Name of a room.
            goal: Name of a room.
            width: Of what moves, with room for hands [m].

        Raises:
            UnknownNameError: If there is no such room.
        """
        return self.way(width).route(self.room(start).inside, self.room(goal).inside)

    def reached(self, *, width: float = WHEELCHAIR_WIDTH + HAND_ROOM) -> tuple[str, ...]:
        """Return the rooms in which a wheelchair that comes in by the entrance can stand.

        Steps at the entrance keep it out of none: they are another matter, see the audit.
        """
        way = self.way(width)
        entrances = [o for o in self.plan.openings.values() if o.kind == "entrance"]
        regions: set[int] = set()
        for entrance in entrances:
            regions |= way.regions_in(self.room(entrance.rooms[0]).inside)
        return tuple(room.name for room in self.rooms() if way.regions_in(room.inside) & regions)

    def required_rooms(self) -> tuple[str, ...]:
        """Return the rooms that everybody who lives there must be able to reach."""
        return self.plan.required_rooms()

    def spots(self, room: str) -> dict[str, Spot]:
        """Return the places of a room where an agent can be put: `centre`, those at furniture, and on it.

        `before_sofa` and `beside_bed` are on the floor that a piece needs; `on_bed` and the like are
        its frames; `centre` is the middle of the largest free circle. A second of a kind is
        `beside_bed_2`. UnknownNameError if there is no such room.
        """
        _, (x, y) = self.clearance.free_circle(self.room(room).inside)
        out = {"centre": Spot(Pose((x, y, 0.0)), "middle of the largest free circle")}
        for placed in self.furniture(room):
            kind = _KNOWN_AS.get(placed.piece.kind, placed.piece.kind)
            for zone in placed.piece.zones:
                if zone.why == "use":
                    name, spot = _at(placed, zone)
                    out[_free(f"{name}_{kind}", out)] = spot
            for frame, what in placed.piece.frames.items():
                out[_free(f"{kind}_{frame}", out)] = Spot(placed.frame(frame), what.note or frame)
        return out

    def spot(self, room: str, name: str) -> Pose:
        """Return a named place of a room, in the house; x points where one looks.

        Raises:
            UnknownNameError: If there is no such room, or no such place in it.
        """
        spots = self.spots(room)
        check_name(f"place in {room} of {self.name}", name, spots)
        return spots[name].pose

    def place(self, agent: Agent, room: str, spot: str, *, home: Pose = Pose()) -> Pose:
        """Put an agent that is in a world at a named place, and return where that is in the world.

        A robot stands there with its base; a person with the pelvis above the place, at the height
        that it has.

        Args:
            agent: A robot or person, spawned already.
            room: Name of the room.
            spot: Name of the place, see `spots`.
            home: Where the house stands in the world.

        Raises:
            UnknownNameError: If there is no such room or place.
            ConfigError: If the agent is not in a world yet.
        """
        pose = home @ self.spot(room, spot)
        if not isinstance(agent, Robot | Human) or not hasattr(agent, "body"):
            raise ConfigError(f"{agent!r} is in no world yet: spawn it first")
        if isinstance(agent, Robot):
            agent.place(agent.mount("floor", pose, with_posture=False))
        else:
            pelvis = agent.body.base_pose()
            left = pelvis.matrix()[:2, 0]  # the x axis of a pelvis points to the left
            yaw = math.atan2(left[1], left[0]) - 0.5 * math.pi
            upright = Pose((0, 0, 0), tuple(quaternion_from_rpy(0, 0, yaw).tolist())).inverse()
            lean = upright @ Pose((0, 0, 0), pelvis.quaternion)
            x, y, z = pose.position
            turned = Pose((x, y, z + pelvis.position[2]), pose.quaternion) @ lean
            agent.place(turned)
        return pose

    def spawn(
        self,
        world: World,
        *,
        at: Pose = Pose(),
        articulated: Collection[str] = (),
        busy: Rectangle | None = None,
        ceilings: bool = True,
        wall_height: float | None = None,
    ) -> BuiltHome:
        """Put the house into a world.

        Args:
            world: The world.
            at: Where the house's origin goes.
            articulated: Rooms whose furniture and doors move; all else is one with its room, and its
                doors stand open. `("*",)` for all.
            busy: Floor of the house on which agents mostly are [m]; steps are faster when nothing
                else is there. None if they go everywhere.
            ceilings: Whether it has ceilings; they hide the rooms from above.
            wall_height: Where to cut walls for pictures [m]; at the ceiling if None.

        Raises:
            UnknownNameError: If there is no such room.
        """
        from .built import BuiltHome

        rooms = tuple(self.plan.rooms) if tuple(articulated) == ("*",) else tuple(articulated)
        for room in rooms:
            self.plan.room(room)
        return BuiltHome(
            self, world, at, rooms, busy=busy, ceilings=ceilings, wall_height=wall_height
        )


def _at(placed: Placed, zone: Zone) -> tuple[str, Spot]:
    """Return whether a zone is before or beside its piece, and the place in its middle."""
    own = placed.piece.footprint
    x, y = zone.area.centre
    is_before = zone.area.x0 >= own.x1 - 0.05
    ahead = (own.centre[0] - x, 0.0) if is_before else (0.0, own.centre[1] - y)
    yaw = math.atan2(ahead[1], ahead[0])
    pose = placed.pose @ Pose((x, y, 0.0), tuple(quaternion_from_rpy(0, 0, yaw).tolist()))
    word = "before" if is_before else "beside"
    return word, Spot(pose, f"floor {word} {placed.name}, looking at it")


def _free(name: str, taken: dict[str, Spot]) -> str:
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    return free
