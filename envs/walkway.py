"""Ways over the floor of a world as all stands on it now: of people who walk, and of bases that drive."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence

import numpy as np

from rcare_marl.agents.agent import Agent
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import BASE_JOINTS
from rcare_marl.body import Body
from rcare_marl.body_part import VisualShape
from rcare_marl.errors import ConfigError, PlanningError
from rcare_marl.pose import Array
from rcare_marl.world import World

from .homes.occupancy import Obstacle, Occupancy
from .homes.route import Way
from .rectangle import Rectangle

Point = tuple[float, float]

# All our own choices.
WALKER = 0.5  # [m] that somebody who walks is wide, arms hanging
LOW, HIGH = 0.03, 1.9  # [m] over the floor between which things are in the way
CELL = 0.05  # [m] of the map
ROUND = 1.5  # [m] about everything that the map covers as well
MOVED = 0.05  # [m] that something has moved if it counts
NEAR = 0.6  # [m] from a goal, such as a place beside a bed, to where a way may end that goes straight from there
LINED_UP, ARRIVED = 0.1, 0.03  # [rad] off its way that a base drives on; [m], and half of it in [rad], from its goal
APPROACH = 2.0  # [1/s] with which a base comes to its goal


def standing(world: World, besides: Collection[Body]) -> list[Obstacle]:
    """Return what stands on the floor of a world now, but for some bodies: a rectangle round each solid shape."""
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


def _box(
    body: Body, place: int, shape: VisualShape, turn: Array, at: Array
) -> tuple[Array, Array]:
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
    obstacles: Sequence[Obstacle], start: Point, goal: Point, *, width: float = WALKER
) -> list[Point]:
    """Return the corners of a way for somebody of a width, the goal last; straight where that is free.

    Who starts or ends nearer to something than half the width may be as near as that about there, and else goes
    straight from there to where there is room.

    Args:
        obstacles: What stands there.
        start: Where it begins [m].
        goal: Where it ends [m].
        width: Of who goes there [m].

    Raises:
        PlanningError: If there is no way.
        ConfigError: If the width is not positive.
    """
    ends = [Rectangle(*point, *point) for point in (start, goal)]
    bounds = Rectangle.around([*ends, *(o.area for o in obstacles)]).grown(ROUND)
    way = Way(Occupancy(bounds, obstacles, cell=CELL), width)
    if way.is_free(start, goal, near=NEAR):
        return [goal]
    found = way.between(start, goal, within=NEAR)
    if found is None:
        x, y = goal
        raise PlanningError(f"there is no way for {width:g} m to ({x:.2f}, {y:.2f}) on the floor")
    return [(x, y) for x, y in found.tolist()] + [goal]


class Walkway:
    """A way of somebody to a place, found when it is asked for, and anew once something has moved."""

    def __init__(
        self,
        world: World,
        agent: Agent,
        here: Callable[[], Point],
        goal: Point,
        *,
        width: float = WALKER,
        besides: Collection[Body] = (),
    ) -> None:
        """Say who goes where.

        Args:
            world: The world.
            agent: Who goes; what it holds goes along.
            here: Returns where it is [m].
            goal: Where it goes [m].
            width: Of who goes [m].
            besides: What is not in the way.
        """
        self._world, self._agent, self._here, self._goal = world, agent, here, goal
        self._width, self._besides = width, besides
        self._seen = np.zeros((0, 4))
        self._way: list[Point] | None = None

    def __call__(self) -> list[Point]:
        """Return the corners of the way, the goal last: the same list while nothing has moved.

        Raises:
            PlanningError: If there is no way.
        """
        body = self._agent.body
        seen = standing(self._world, {body, *self._world.held_by(body), *self._besides})
        rows = np.array([obstacle.area.row for obstacle in seen]).reshape(-1, 4)
        if (
            self._way is None
            or rows.shape != self._seen.shape
            or (np.abs(rows - self._seen) > MOVED).any()
        ):
            self._seen = rows
            self._way = way_round(seen, self._here(), self._goal, width=self._width)
        return self._way
