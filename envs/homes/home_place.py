"""A room of a home where a task has room, or what it is about where there is no house around it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import write
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.world import World

from ..place import DoorSite, Fixture, FloorBefore, HardwareSide
from ..rectangle import Rectangle
from .care_home import CareHome
from .door import LEVER_REACH, Door, door_size, hinge_side
from .furnishing import Placed
from .piece import Setting, make_piece
from .plan import HINGED_LOSS, INNER_WALL, SLIDING_LOSS, Opening, Room
from .rule import Rules

if TYPE_CHECKING:
    from rcare_marl.rendering import Camera

    from .built import BuiltHome

# What a helper would push aside to make room; everything else stays where it is. Our own choice.
LIGHT = set(
    "armchair bin chair coffee_table dining_table exercise_mat floor_lamp garden_table "
    "laundry_basket office_chair ottoman plant recliner round_table side_table".split()
)
STEP = 0.1  # [m] between the places that are tried; own choice
EYE_GAP = 0.12  # [m] that a camera stays away from walls; own choice
QUARTERS = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)
TURN = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))  # half round
CLOSE = 0.5  # [m] about what is left of the free floor, where things count as close by; own choice
WALL, HEIGHT, LENGTH = 0.1, 2.2, 1.7  # [m] of walls where there is no house; own choice
WALL_RGBA = (0.84, 0.87, 0.86, 1.0)


@dataclass(eq=False)
class HomePlace:
    """A room of a home as the place of a task; see `envs.place.Place`.

    Attributes:
        home: The home, without what was pushed aside.
        home_room: The room.
        pose: Of the task's origin in the house.
        footprint: The free floor of the task, in the house [m].
        aside: What was pushed aside to make room, by name.
        at_fixture: The piece of furniture or the door at which the origin is, by name; empty if none.
        built: The home, once it stands in a world.
    """

    home: CareHome
    home_room: Room
    pose: Pose
    footprint: Rectangle
    aside: tuple[str, ...]
    at_fixture: str = ""
    built: BuiltHome | None = None

    def __post_init__(self) -> None:
        self.level = self.home.level

    @property
    def name(self) -> str:
        return self.home.name

    @property
    def room(self) -> Rectangle | None:
        return self.home_room.inside.moved(self.pose.inverse())

    @property
    def floor(self) -> Body:
        return self.standing.floor

    @property
    def standing(self) -> BuiltHome:
        """The home in its world; ConfigError before `lay_floor`."""
        if self.built is None:
            raise ConfigError(f"{self.home.name} stands in no world yet: lay_floor comes first")
        return self.built

    @property
    def obstacles(self) -> Sequence[tuple[str, Body]]:
        return self.standing.things()

    def lay_floor(self, world: World) -> None:
        self.built = self.home.spawn(
            world, at=self.pose.inverse(), articulated=(self.home_room.name,), busy=self.footprint
        )

    def fixture(self, kind: str) -> Fixture:
        body = self.standing.part(self.at_fixture)
        (placed,) = (p for p in self.home.placed if p.name == self.at_fixture)
        return Fixture(body, placed.piece.model, placed.piece.frames)

    def door(self, *, hinge: HardwareSide = "low", clear_width: float | None = None) -> Door:
        if clear_width is not None:
            raise ConfigError("clear_width is for a door on a bare floor: a house has its own")
        return self.standing.doors[self.at_fixture]

    def facts(self) -> dict[str, Any]:
        return {"home": self.name, "level": self.level, "room": self.home_room.name}

    def view(self, camera: Camera) -> Camera:
        """Return a camera like the one given, moved along its view until it is in the room.

        What it saw from farther away it sees by a wider angle.
        """
        eye, target = (
            np.array((self.pose @ Pose(tuple(float(v) for v in point))).position)
            for point in (camera.eye, camera.target)
        )
        inside = self.home_room.inside.grown(-EYE_GAP)
        low, high = np.array((inside.x0, inside.y0)), np.array((inside.x1, inside.y1))
        way = eye[:2] - target[:2]
        share = 1.0
        for start, length, a, b in zip(target[:2], way, low, high, strict=True):
            if abs(length) > 1e-9:
                share = min(share, max(((b if length > 0 else a) - start) / length, 0.2))
        if share >= 1.0:
            return camera
        near = target + share * (eye - target)
        back = (self.pose.inverse() @ Pose(tuple(near.tolist()))).position
        half = math.tan(math.radians(0.5 * camera.fov_deg)) / share
        fov = min(math.degrees(2 * math.atan(half)), 100.0)
        return dataclasses.replace(camera, eye=(back[0], back[1], back[2]), fov_deg=fov)


def find_place(
    home: CareHome,
    kinds: Sequence[str],
    footprint: Rectangle | FloorBefore,
    *,
    room: str | None = None,
    site: str = "",
    slack: float | None = None,
) -> HomePlace:
    """Return where a task has room in a home: where least furniture is pushed aside for it.

    Args:
        home: The home.
        kinds: Kinds of rooms that suit the task, the best first.
        footprint: The free floor that it needs, about its origin [m]; `place.FloorBefore` at a door.
        room: The room to take; the first that suits if None.
        site: What the origin is at: `door`, one inside the house, or a kind of furniture, whose frame
            it then is; anywhere if empty. That of a door points into its first room, see `Opening`;
            it is turned half round if no door has room on the other side.
        slack: Take the place with most walls and furniture close by instead, with so much less free floor
            on each side [m] and nothing pushed aside; where there is no site.

    Raises:
        UnknownNameError: If there is no such room.
        ConfigError: If the room does not suit the task, or none has the floor that it needs.
    """
    suitable = [r for kind in kinds for r in home.rooms() if r.kind == kind]
    rooms = suitable if room is None else [home.room(room)]
    if room is not None and rooms[0] not in suitable:
        raise ConfigError(
            f"{room!r} does not suit this task; rooms of {home.name} that do: "
            f"{', '.join(r.name for r in suitable)}"
        )
    for is_turned in (False, True) if site == "door" else (False,):
        for each in rooms:
            found = _in_room(home, each, footprint, site, is_turned, slack)
            if found is not None:
                return found
    tried = ", ".join(r.name for r in rooms) or "none of these kinds: " + ", ".join(kinds)
    large = [r.name for r in suitable if room is not None and _in_room(home, r, footprint, site)]
    size = "enough"
    if isinstance(footprint, Rectangle):
        size = f"{footprint.width:.1f} x {footprint.depth:.1f} m of"
    raise ConfigError(
        f"no room in {home.name} at level {home.level} has {size} free floor "
        f"{f'at a {site} ' if site else ''}for this task; tried {tried}"
        + (f"; large enough: {', '.join(large)}" if large else "")
    )


def _in_room(
    home: CareHome,
    room: Room,
    footprint: Rectangle | FloorBefore,
    site: str,
    is_turned: bool = False,
    slack: float | None = None,
) -> HomePlace | None:
    if not isinstance(footprint, Rectangle):
        return _at_door(home, room, footprint, is_turned)
    if site:
        return _at_fixture(home, room, footprint, site)
    inside = room.inside.grown(-0.02)
    standing, cost = _standing(home, room)
    if slack is not None:
        footprint = footprint.grown(-slack)
        cost = np.full(len(standing), 1e6)
    rows = np.array([p.footprint.row for p in standing]).reshape(-1, 4)
    best: tuple[float, Pose, list[Placed]] | None = None
    for yaw in QUARTERS:
        turn = Pose((0, 0, 0), tuple(quaternion_from_rpy(0, 0, yaw).tolist()))
        area = footprint.moved(turn)
        xs = np.arange(inside.x0 - area.x0, inside.x1 - area.x1 + 1e-9, STEP)
        ys = np.arange(inside.y0 - area.y0, inside.y1 - area.y1 + 1e-9, STEP)
        if not len(xs) or not len(ys):
            continue
        at = np.stack([axis.ravel() for axis in np.meshgrid(xs, ys)], axis=1)
        areas = area.row + np.concatenate((at, at), axis=1)
        low = np.maximum(areas[:, None, :2], rows[None, :, :2])
        high = np.minimum(areas[:, None, 2:], rows[None, :, 2:])
        hit = ((high - low) > 1e-6).all(axis=2)
        middle = np.abs(areas[:, :2] + areas[:, 2:] - np.array(inside.centre) * 2).sum(axis=1)
        total = hit @ cost + 0.01 * middle  # of equal places the one in the middle of the room
        if slack is not None:
            total -= _close_by(areas, rows, inside)
        i = int(total.argmin())
        if total[i] < 1e5 and (best is None or total[i] < best[0]):
            pose = Pose((float(at[i, 0]), float(at[i, 1]), 0.0), turn.quaternion)
            best = (
                float(total[i]),
                pose,
                [p for p, is_hit in zip(standing, hit[i], strict=True) if is_hit],
            )
    if best is None:
        return None
    return _place(home, room, best[1], footprint, best[2])


def _close_by(areas: Array, things: Array, inside: Rectangle) -> Array:
    """Return how much of the floor within `CLOSE` of areas is taken by things or beyond the walls [m²], [n].

    Args:
        areas: Lower and upper corners [m], shape [n, 4].
        things: The same of what stands there, shape [k, 4].
        inside: The room.
    """
    about = areas + np.array((-CLOSE, -CLOSE, CLOSE, CLOSE))
    low = np.maximum(about[:, None, :2], things[None, :, :2])
    high = np.minimum(about[:, None, 2:], things[None, :, 2:])
    taken = np.clip(high - low, 0, None).prod(axis=2).sum(axis=1)
    kept = np.minimum(about[:, 2:], inside.row[2:]) - np.maximum(about[:, :2], inside.row[:2])
    return taken + (about[:, 2:] - about[:, :2]).prod(axis=1) - kept.prod(axis=1)


def _standing(home: CareHome, room: Room) -> tuple[list[Placed], Array]:
    """Return what stands in a room, and what it costs to move each piece."""
    standing = [p for p in home.furniture(room.name) if p.piece.blocks]
    # Heavy things stay; of light ones the fewest and smallest are moved.
    cost = [1.0 + p.footprint.area if p.piece.kind in LIGHT else 1e6 for p in standing]
    return standing, np.array(cost)


def _at_door(home: CareHome, room: Room, before: FloorBefore, is_turned: bool) -> HomePlace | None:
    """Return the place at the door of a room before which least furniture is in the way."""
    places = []
    for opening in home.plan.openings_of(room.name):
        footprint = before(_site(home, opening, is_turned)) if opening.kind == "door" else None
        if footprint is not None:
            pose = opening.pose @ TURN if is_turned else opening.pose
            places.append((opening.name, pose, footprint))
    return _least_in_the_way(home, room, places)


def _site(home: CareHome, opening: Opening, is_turned: bool) -> DoorSite:
    x, height = door_size(opening, home.rules).handle
    if opening.hardware == "lever":
        x += hinge_side(opening) * LEVER_REACH

    def is_free(area: Rectangle) -> bool:
        area = area.moved(opening.pose)
        is_inside = any(room.inside.contains(area) for room in home.rooms())
        return is_inside and not any(
            p.piece.blocks and p.footprint.overlaps(area) for p in home.placed
        )

    handle = (-x if is_turned else x, 0.0, height)
    return DoorSite(opening.hardware, handle, opening.thickness, is_turned, is_free)


def _at_fixture(home: CareHome, room: Room, footprint: Rectangle, site: str) -> HomePlace | None:
    """Return the place at the furniture of a room before which least other furniture is in the way."""
    standing = home.furniture(room.name)
    places = [(p.name, p.pose, footprint) for p in standing if p.piece.kind == site]
    return _least_in_the_way(home, room, places)


def _least_in_the_way(
    home: CareHome, room: Room, places: Sequence[tuple[str, Pose, Rectangle]]
) -> HomePlace | None:
    standing, cost = _standing(home, room)
    best: tuple[float, HomePlace] | None = None
    for name, pose, footprint in places:
        area = footprint.moved(pose)
        if not room.inside.contains(area):
            continue
        hit = [p.name != name and p.footprint.overlaps(area) for p in standing]
        total = float(cost[hit].sum())
        if total < 1e5 and (best is None or total < best[0]):
            moved = [p for p, is_hit in zip(standing, hit, strict=True) if is_hit]
            place = _place(home, room, pose, footprint, moved)
            best = total, dataclasses.replace(place, at_fixture=name)
    return None if best is None else best[1]


def _place(
    home: CareHome, room: Room, pose: Pose, footprint: Rectangle, moved: Sequence[Placed]
) -> HomePlace:
    aside = tuple(p.name for p in moved)
    kept = tuple(p for p in home.placed if p.name not in aside)
    kept_home = dataclasses.replace(home, placed=kept)
    return HomePlace(kept_home, room, pose, footprint.moved(pose), aside)


def build_fixture(
    world: World, kind: str, *, level: int, options: Mapping[str, Any] | None = None
) -> Fixture:
    """Put a piece of furniture at the origin as a house does: its joints have their friction.

    There are walls behind it and to its left, which it does not feel, as in a house.

    Args:
        world: The world.
        kind: Kind of the piece.
        level: Level of accessibility whose rules it keeps.
        options: Of its maker.

    Raises:
        UnknownNameError: If there is no such kind.
        ConfigError: If there is no such level, or an option is impossible.
    """
    piece = make_piece(kind, Setting(Rules(level)), options)
    body = world.load_urdf(write(piece.model, melt_except=()), name=kind)
    for name, joint in body.joints.items():
        body.release_motors([joint.index], piece.model.joints[name].friction)
    world.sleeping.add(body)
    left = piece.measures.get(f"{kind}_centre_to_wall", LENGTH)
    low, high, half = left - LENGTH, left + WALL, 0.5 * HEIGHT
    walls = (
        ((WALL, high - low, HEIGHT), (-0.5 * WALL, 0.5 * (low + high), half)),
        ((LENGTH, WALL, HEIGHT), (0.5 * LENGTH, left + 0.5 * WALL, half)),
    )
    built = [world.add_box(size, Pose(at), name="wall", rgba=WALL_RGBA) for size, at in walls]
    for wall in built:
        world.set_collision(wall, body, False)
    return Fixture(body, piece.model, piece.frames, tuple(built))


def build_door(
    world: World,
    *,
    level: int,
    hinge: Literal["low", "high"] = "low",
    clear_width: float | None = None,
) -> Door:
    """Put a door of a level into a wall across the origin, and return it; its frame is the origin's.

    Args:
        world: The world.
        level: Level of accessibility.
        hinge: The end of the gap along x where its hinges or its pocket are.
        clear_width: Of the door [m]; that of the level if None.
    """
    rules = Rules(level)
    hardware = rules.choice("door_hardware")
    loss = SLIDING_LOSS if hardware == "slider" else HINGED_LOSS
    opening = Opening(
        "door",
        "door",
        ("beyond", "here"),
        "x",
        (0.0, 0.0),
        (clear_width or rules.figure("door_clear_width")) + loss,
        INNER_WALL,
        hardware=hardware,
        hinge=hinge,
    )
    half, head = 0.5 * opening.width, opening.head
    for wide, x, low in (
        (LENGTH, -half - 0.5 * LENGTH, 0.0),
        (LENGTH, half + 0.5 * LENGTH, 0.0),
        (2 * half, 0.0, head),
    ):
        size, at = (wide, INNER_WALL, HEIGHT - low), Pose((x, 0.0, 0.5 * (HEIGHT + low)))
        world.add_box(size, at, name="wall", rgba=WALL_RGBA)
    door = Door(opening, rules)
    door.spawn(world)
    world.sleeping.add(door.body)
    return door
