"""How a robot begins a way: in which posture, and with which turn of its tool for a pull along a limb."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from rcare_marl.agents.robots.arm import Arm
from rcare_marl.agents.robots.kinematics import IkResult
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.body import Body
from rcare_marl.pose import Array, Pose, quaternion_from_matrix
from rcare_marl.world import World

from ..reach import ReachSearch, Trial

# All our own choices.
TRIES = 24  # postures among which one to start in is chosen
START_MISS = 30.0  # [rad/m] of a place that is not reached, against the way of the joints
# Of a pull.
LEANS = (-1.6, -0.9, -0.45, 0.0)  # of the tool from straight down: to the back, as tangents
TILTS = (-0.8, -0.4, 0.0, 0.4, 0.8)  # likewise to the left
ROLLS = 4  # turns about the tool's own axis, over half of one: fingers are alike
SEEDS = 2  # postures from which inverse kinematics begins
ROOM = 0.06  # [m] between robot and person that is enough
TOUCH = 0.025  # [m] likewise between robot and limb
PULL_MISS = 20.0  # of a metre missed
ROOM_WEIGHT = 10.0  # of a metre of lacking room
BEND_WEIGHT = 0.2  # of a radian that the joints go between two places
TURN_WEIGHT = 0.1  # [m/rad] of a turn that is missed, in both


def start_best(search: ReachSearch, way: Sequence[Pose]) -> None:
    """Let a robot start, and prefer to be, at the first pose of `way` so that it can follow the rest best.

    That is where its joints go least and it misses the poses least; only the first has to be reached.
    """
    arm, cost = search.robot.arm, partial(_cost, START_MISS, 1.0)
    search = dataclasses.replace(search, needed=1, roams=False, cost=cost)
    trials = [Trial(way, seed=seed) for seed in _seeds(arm, TRIES)]
    found = search.find(trials, "where it is to start")
    arm.rest[:] = found.posture
    search.robot.set_posture(found.posture)


def _seeds(arm: Arm, count: int) -> list[Array]:
    """Return postures from which inverse kinematics begins: that of rest, and others at random."""
    rng = np.random.default_rng(0)
    low, high = np.maximum(arm.lower, -math.pi), np.minimum(arm.upper, math.pi)
    return [arm.rest.copy(), *(rng.uniform(low, high) for _ in range(count - 1))]


def _cost(miss: float, bend: float, before: IkResult, after: IkResult) -> float:
    """Return what a pose costs, for weights of a metre missed and of a radian that joints go there."""
    way = bend * float(np.abs(after.posture - before.posture).max())
    return way + miss * (after.distance + TURN_WEIGHT * after.angle)


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
        cost = ROOM_WEIGHT * (ROOM - room_beside(robot, person, world))
        cost += ROOM_WEIGHT * (TOUCH - world.separation(robot, person, within=TOUCH))
        foremost = max(robot.link_pose(i).position[0] for i in range(robot.link_count))
        return cost + ROOM_WEIGHT * max(foremost - ahead, 0.0)

    cost = partial(_cost, PULL_MISS, BEND_WEIGHT)
    return dataclasses.replace(
        search, people=(), needed=1, roams=False, cost=cost, crowding=crowding
    )


def pulling_trials(robot: Robot, places: Sequence[Array]) -> list[Trial]:
    """Return what is tried to follow places [m] with one turn of the tool; `hold` is the turn."""
    points = [tuple(place.tolist()) for place in places]
    return [
        Trial([Pose(at, tuple(turn.tolist())) for at in points], seed=seed, hold=turn)
        for turn, seed in itertools.product(turns(), _seeds(robot.arm, SEEDS))
    ]


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


def room_beside(robot: Body, person: Body, world: World) -> float:
    """Return how far a robot is from what of a person does not move: trunk, head, arms; 6 cm at most [m]."""
    near = world.near(robot, person, within=ROOM, links=(None, -1))
    return min((there.gap for there in near), default=ROOM)
