"""A piece of furniture or a door that a task is about, where there is no house around it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rcare_marl.body import Body
from rcare_marl.pose import Pose
from rcare_marl.urdf import write
from rcare_marl.world import World

from .built import BuiltHome
from .door import Door
from .piece import Piece, Setting, make_piece
from .plan import HINGED_LOSS, INNER_WALL, SLIDING_LOSS, Opening
from .rule import Rules

WALL, HEIGHT, LENGTH = 0.1, 2.2, 1.7  # [m] of walls where there is no house; own choice
WALL_RGBA = (0.84, 0.87, 0.86, 1.0)


@dataclass(frozen=True)
class Fixture:
    """A piece of furniture in a world.

    Attributes:
        piece: What it is.
        body: Its body.
    """

    piece: Piece
    body: Body

    @staticmethod
    def of(built: BuiltHome, name: str) -> Fixture:
        """Return a piece of a house that moves; UnknownNameError lists those there are."""
        body = built.part(name)
        (placed,) = (p for p in built.home.placed if p.name == name)
        return Fixture(placed.piece, body)


def set_up(
    world: World,
    kind: str,
    *,
    level: int,
    pose: Pose = Pose(),
    options: Mapping[str, Any] | None = None,
) -> Fixture:
    """Put a piece of furniture into a world as a house does: its joints have their friction.

    Args:
        world: The world.
        kind: Kind of the piece.
        level: Level of accessibility whose rules it keeps.
        pose: Of its frame.
        options: Of its maker.

    Raises:
        UnknownNameError: If there is no such kind.
        ConfigError: If there is no such level, or an option is impossible.
    """
    piece = make_piece(kind, Setting(Rules(level)), options)
    body = world.load_urdf(write(piece.model, melt_except=()), pose, name=kind)
    for name, joint in body.joints.items():
        body.release_motors([joint.index], piece.model.joints[name].friction)
    world.slumber.add(body)
    return Fixture(piece, body)


def add_corner(world: World, fixture: Fixture, *, left: float) -> None:
    """Add the walls at a piece that stands at the origin: behind it, and to its left.

    Args:
        world: The world.
        fixture: The piece; it does not feel them, as in a house.
        left: From its middle to the wall on its left [m].
    """
    low, high, half = left - LENGTH, left + WALL, 0.5 * HEIGHT
    walls = (
        ((WALL, high - low, HEIGHT), (-0.5 * WALL, 0.5 * (low + high), half)),
        ((LENGTH, WALL, HEIGHT), (0.5 * LENGTH, left + 0.5 * WALL, half)),
    )
    for size, at in walls:
        wall = world.add_box(size, Pose(at), name="wall", rgba=WALL_RGBA)
        world.set_collision(wall, fixture.body, False)


def set_up_door(
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
        "door", "door", ("beyond", "here"), "x", (0.0, 0.0),
        (clear_width or rules.figure("door_clear_width")) + loss, INNER_WALL, hardware=hardware, hinge=hinge,
    )  # fmt: skip
    half = 0.5 * opening.width
    pieces = (
        ((LENGTH, INNER_WALL, HEIGHT), (-half - 0.5 * LENGTH, 0.0, 0.5 * HEIGHT)),
        ((LENGTH, INNER_WALL, HEIGHT), (half + 0.5 * LENGTH, 0.0, 0.5 * HEIGHT)),
        (
            (2 * half, INNER_WALL, HEIGHT - opening.head),
            (0.0, 0.0, 0.5 * (HEIGHT + opening.head)),
        ),
    )
    for size, at in pieces:
        world.add_box(size, Pose(at), name="wall", rgba=WALL_RGBA)
    door = Door(opening, rules)
    door.spawn(world)
    world.slumber.add(door.body)
    return door


__all__ = ["Fixture", "add_corner", "set_up", "set_up_door"]
