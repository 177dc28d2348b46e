"""Ways over the floor of a world as all stands on it now: of people who walk, and of bases that drive."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from rcare_marl.agents.agent import Agent
from rcare_marl.agents.people.motion.skill import LOOKING
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import BASE_JOINTS
from rcare_marl.body import Body
from rcare_marl.body_part import VisualShape
from rcare_marl.errors import ConfigError, PlanningError
from rcare_marl.pose import Array
from rcare_marl.world import World

from .homes import Obstacle, Occupancy, Way
from .rectangle import Rectangle

Point = tuple[float, float]

# All our own choices.
WALKER = 0.8  # [m] that our caregiver is wide, arms hanging
SHOULDERS = 0.55  # [m] of who goes through where there is no other way, such as a door
LOW, HIGH = 0.03, 1.9  # [m] over the floor between which things are in the way
CELL = 0.05  # [m] of the map
ROUND = 1.5  # [m] about everything that the map covers as well
NEAR = 0.6  # [m] from a narrow place, such as beside a bed, to where there is room for a way
ROOM = 0.1  # [m] that a base needs beside its width, both sides together
LINED_UP = 0.1  # [rad] off its way that a base drives on
PASSED = 0.05  # [m] from a corner that it has passed
ARRIVED = 0.02  # [m], [rad] from its goal
APPROACH = 2.0  # [1/s] with which a base comes to it


def standing(world: World, besides: Collection[Body]) -> list[Obstacle]:
    """Return what stands on the floor of a world now, but for some bodies: rectangles round shapes."""
    out = []
    for body in world.bodies:
        if body in besides:
            continue
        for link in body.solid_links():
            frame = body.link_pose(link) if link >= 0 else body.base_pose()
            turn, at = frame.matrix()[:3, :3], np.array(frame.position)
            for place, shape in enumerate(body.collision_shapes(link)):
                low, high = _box(body, place, shape, turn, at)
                if high[2] > LOW and low[2] < HIGH:
                    area = Rectangle(*low[:2].tolist(), *high[:2].tolist())
                    out.append(Obstacle(area, body.name))
    return out


def _box(body: Body, place: int, shape: VisualShape, turn: Array, at: Array) -> tuple[Array, Array]:
    """Return the corners of the box round a shape in the world [m], each of shape [3]."""
    size = np.array(shape.size)
    if shape.kind == "mesh":
        points = body.hull_points(shape.link, place)
        if not len(points):
            return body.bounds([shape.link])
        points = points @ turn.T + at
        return points.min(axis=0), points.max(axis=0)
    matrix = shape.pose.matrix()
    middle, axes = turn @ matrix[:3, 3] + at, turn @ matrix[:3, :3]
    if shape.kind == "box":
        half = np.abs(axes) @ (0.5 * size[:3])
    elif shape.kind == "sphere":
        half = np.full(3, size[0])
    else:  # a capsule, or a cylinder, in a box about it
        half = np.abs(axes[:, 2]) * 0.5 * size[0] + size[1]
    return middle - half, middle + half


def way_round(
    obstacles: Sequence[Obstacle],
    start: Point,
    goal: Point,
    *,
    width: float = WALKER,
    least: float = SHOULDERS,
) -> list[Point]:
    """Return the corners of a way for somebody of a width, the goal last; straight where that is free.

    Who starts or ends nearer to something than half the width may be as near as that about there, and else
    goes straight from there to where there is room.

    Args:
        obstacles: What stands there.
        start: Where it begins [m].
        goal: Where it ends [m].
        width: Of who goes there [m].
        least: What does where there is no room for that [m].

    Raises:
        PlanningError: If there is no way.
        ConfigError: If the width is not positive.
    """
    ends = [Rectangle(*point, *point) for point in (start, goal)]
    bounds = Rectangle.around([*ends, *(o.area for o in obstacles)]).grown(ROUND)
    way = Way(Occupancy(bounds, obstacles, cell=CELL), min(least, width))
    if way.is_free(start, goal, near=NEAR, wide=width):
        return [goal]
    found = way.between(start, goal, within=NEAR, wide=width)
    if found is None:
        x, y = goal
        raise PlanningError(
            f"there is no way {way.width:g} m wide to ({x:.2f}, {y:.2f}) on the floor"
        )
    corners = [(x, y) for x, y in found.tolist()]
    return [c for c in corners if math.dist(c, start) > CELL < math.dist(c, goal)] + [goal]


def way_of(
    agent: Agent,
    goal: Point,
    here: Point | None = None,
    *,
    width: float = WALKER,
    least: float = SHOULDERS,
) -> list[Point]:
    """Return the corners of a way of somebody round all that stands on the floor now; see `way_round`.

    Args:
        agent: Who goes; what it holds goes along.
        goal: Where it goes [m].
        here: Where it is [m]; where its base is if None.
        width: Of who goes [m].
        least: What does where there is no room for that [m].

    Raises:
        PlanningError: If there is no way.
    """
    x, y, _ = agent.body.base_pose().position
    besides = {agent.body, *agent.world.held_by(agent.body)}
    return way_round(standing(agent.world, besides), here or (x, y), goal, width=width, least=least)


def driving(
    robot: Robot, goal: tuple[float, float, float], *, width: float | None = None
) -> Iterator[Array]:
    """Yield actions that drive a robot round what stands on the floor; it looks once a second.

    It goes from corner to corner forwards, turns on the spot, and moves nothing else.

    Args:
        robot: A robot whose `moves` name its base.
        goal: Where it goes: x, y [m] and heading [rad].
        width: Of the floor that it needs [m]; to turn with all that it is now, and `ROOM`, if None.

    Raises:
        ConfigError: If its base does not move.
        PlanningError: If there is no way, whenever it looks.
    """
    if robot.base is None:
        raise ConfigError(f"{robot.name!r} does not drive: name the base in its moves")
    turning, first = robot.body.joint(BASE_JOINTS[-1]).index, 0
    for part in robot.parts.values():
        own = slice(first, first + part.control.size)
        first = own.stop
        if part.base is robot.base:
            break

    def station() -> tuple[float, float, float]:
        frame = robot.body.link_pose(turning).matrix()
        return float(frame[0, 3]), float(frame[1, 3]), math.atan2(frame[1, 0], frame[0, 0])

    if width is None:
        middle, areas = station()[:2], standing(robot.world, set(robot.world.bodies) - {robot.body})
        width = ROOM + 2 * max(math.dist(middle, c) for o in areas for c in _corners(o.area))
    corners, asked = list[Point](), -math.inf
    while True:
        x, y, heading = station()
        if robot.world.time > asked + LOOKING and math.dist((x, y), goal[:2]) > ARRIVED:
            asked = robot.world.time
            corners = way_of(robot, goal[:2], (x, y), width=width, least=width)
        far = math.dist((x, y), corners[0]) if corners else 0.0
        if corners and far < (PASSED if corners[1:] else ARRIVED):
            del corners[0]
            continue
        bearing = math.atan2(corners[0][1] - y, corners[0][0] - x) if corners else goal[2]
        turn = math.remainder(bearing - heading, 2 * math.pi)
        if not corners and abs(turn) < ARRIVED:
            return
        forward = APPROACH * far if abs(turn) < LINED_UP else 0.0
        action = np.zeros(robot.action_size)
        speeds = np.zeros(own.stop - own.start)
        speeds[0], speeds[-1] = forward, APPROACH * turn
        action[own] = np.clip(speeds / part.control.max, -1.0, 1.0)
        yield action


def _corners(area: Rectangle) -> Sequence[Point]:
    return [(x, y) for x in (area.x0, area.x1) for y in (area.y0, area.y1)]
