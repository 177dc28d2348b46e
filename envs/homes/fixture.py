"""A piece of furniture or a door that a task is about, where there is no house around it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from rcare_marl.model.urdf import write
from rcare_marl.pose import Pose
from rcare_marl.world import World

from ..place import Fixture
from .door import Door
from .piece import Setting, make_piece
from .plan import HINGED_LOSS, INNER_WALL, SLIDING_LOSS, Opening
from .rule import Rules

WALL, HEIGHT, LENGTH = 0.1, 2.2, 1.7  # [m] of walls where there is no house; own choice
WALL_RGBA = (0.84, 0.87, 0.86, 1.0)


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
    for size, at in walls:
        wall = world.add_box(size, Pose(at), name="wall", rgba=WALL_RGBA)
        world.set_collision(wall, body, False)
    return Fixture(body, piece.model, piece.frames)


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
