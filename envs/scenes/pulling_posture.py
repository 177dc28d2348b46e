"""How a robot begins a pull along a limb: the turn of its tool that serves all the way."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.agents.robots.kinematics import IkResult
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.body import Body
from rcare_marl.pose import Array, Pose, quaternion_from_matrix
from rcare_marl.world import World

from ..reach import ReachSearch, Trial

# Our own choices.
LEANS = (-1.6, -0.9, -0.45, 0.0)  # of the tool from straight down: to the back, as tangents
TILTS = (-0.8, -0.4, 0.0, 0.4, 0.8)  # likewise to the left
ROLLS = 4  # turns about the tool's own axis, over half of one: fingers are alike
SEEDS = 2  # postures from which inverse kinematics begins
ROOM = 0.06  # [m] between robot and person that is enough
TOUCH = 0.025  # [m] likewise between robot and limb
MISS_WEIGHT, TURN_WEIGHT = 20.0, 0.1  # of a metre missed, and of a radian
ROOM_WEIGHT = 10.0  # of a metre of lacking room
BEND_WEIGHT = 0.2  # of a radian that the joints go between two places


def pulling_search(search: ReachSearch, person: Body, *, ahead: float) -> ReachSearch:
    """Return the search for the turn of the tool with which a robot follows places best, clear of a person.

    Nothing is decided about the first place but that it is reached: who is there may still move.

    Args:
        search: How the robot's start is searched for.
        person: Whom it stays clear of on the way.
        ahead: Where the room of somebody else begins, along x [m].
    """
    robot, world = search.robot.body, search.world

    def crowding() -> float:
        cost = ROOM_WEIGHT * (ROOM - _room(robot, person, world))
        cost += ROOM_WEIGHT * (TOUCH - world.separation(robot, person, within=TOUCH))
        foremost = max(robot.link_pose(i).position[0] for i in range(robot.link_count))
        return cost + ROOM_WEIGHT * max(foremost - ahead, 0.0)

    return dataclasses.replace(
        search, people=(), needed=1, roams=False, cost=_cost, crowding=crowding
    )


def pulling_trials(robot: Robot, places: Sequence[Array]) -> list[Trial]:
    """Return what is tried to follow places [m] with one turn of the tool; `hold` is the turn."""
    rng, arm = np.random.default_rng(0), robot.arm
    low, high = np.maximum(arm.lower, -math.pi), np.minimum(arm.upper, math.pi)
    seeds = [arm.rest.copy(), *(rng.uniform(low, high) for _ in range(SEEDS - 1))]
    points = [tuple(place.tolist()) for place in places]
    return [
        Trial([Pose(at, tuple(turn.tolist())) for at in points], seed=seed, hold=turn)
        for turn, seed in itertools.product(turns(), seeds)
    ]


def _cost(before: IkResult, after: IkResult) -> float:
    bend = BEND_WEIGHT * float(np.abs(after.posture - before.posture).max())
    return bend + MISS_WEIGHT * (after.distance + TURN_WEIGHT * after.angle)


def turns() -> list[Array]:
    """Return the turns of a tool that are tried, each of shape [4]."""
    out = []
    for lean, tilt, roll in itertools.product(LEANS, TILTS, range(ROLLS)):
        z = np.array((lean, tilt, -1.0))
        z /= np.linalg.norm(z)
        x = np.cross((0.0, 1.0, 0.0), z)
        x /= np.linalg.norm(x)
        angle = math.pi * roll / ROLLS
        turned = math.cos(angle) * x + math.sin(angle) * np.cross(z, x)
        out.append(quaternion_from_matrix(np.column_stack((turned, np.cross(z, turned), z))))
    return out


def _room(robot: Body, person: Body, world: World) -> float:
    """Return how far a robot is from what of a person does not move: trunk, head, arms [m]."""
    links = range(-1, robot.link_count)
    return min(world.separation(robot, person, within=ROOM, links=(k, -1)) for k in links)
