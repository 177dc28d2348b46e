"""How a robot begins a pull along a limb: the turn of its tool that serves all the way."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.agents.robot import Robot
from rcare_marl.agents.robot_config import no_reach
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, quaternion_from_matrix
from rcare_marl.world import World

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


def pulling_posture(
    robot: Robot, places: Sequence[Array], person: Body, world: World, *, ahead: float
) -> tuple[Array, Array]:
    """Return the turn of the tool with which a robot follows places best and clear of a person.

    Nothing is decided about the first place but that it is reached: who is there may still move.

    Args:
        robot: The robot, of whom the main arm moves; it is left in some posture.
        places: Where its tool goes, the first where it starts [m].
        person: Whom it stays clear of.
        world: Where they are.
        ahead: Where the room of somebody else begins, along x [m].

    Returns:
        The turn, shape [4], and the posture at the first place, shape [n].

    Raises:
        ConfigError: If it does not reach the first place in any way.
    """
    rng, arm = np.random.default_rng(0), robot.arm
    low, high = np.maximum(arm.lower, -math.pi), np.minimum(arm.upper, math.pi)
    seeds = [arm.rest.copy(), *(rng.uniform(low, high) for _ in range(SEEDS - 1))]
    best: tuple[float, Array, Array] | None = None
    for turn, seed in itertools.product(turns(), seeds):
        most = math.inf if best is None else best[0]
        found = _cost(robot, places, turn, seed, person, world, most, ahead)
        if found is not None and (best is None or found[0] < best[0]):
            best = (found[0], turn, found[1])
    if best is None:
        name = robot.files.model.name
        raise ConfigError(f"{no_reach(robot.config, name, robot.moves)} where it is to start")
    return best[1:]


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


def _cost(
    robot: Robot, places: Sequence[Array], turn: Array, seed: Array, person: Body, world: World,
    most: float, ahead: float,
) -> tuple[float, Array] | None:  # fmt: skip
    """Return what a turn of the tool costs and the first posture; None if that is not reached."""
    cost, first = 0.0, seed
    for k, place in enumerate(places):
        pose = Pose(tuple(place.tolist()), tuple(turn.tolist()))
        found = robot.solve_ik(pose, seed=seed)
        if k == 0:
            if not found.is_within(0.02, 0.1):
                return None
            first = found.posture
        else:
            cost += BEND_WEIGHT * float(np.abs(found.posture - seed).max())
            cost += MISS_WEIGHT * (found.distance + TURN_WEIGHT * found.angle)
            if cost < most:
                robot.set_posture(found.posture)
                cost += ROOM_WEIGHT * (ROOM - _room(robot.body, person, world))
                touch = world.separation(robot.body, person, within=TOUCH)
                cost += ROOM_WEIGHT * (TOUCH - touch)
                foremost = max(
                    robot.body.link_pose(i).position[0] for i in range(robot.body.link_count)
                )
                cost += ROOM_WEIGHT * max(foremost - ahead, 0.0)
        if cost >= most:
            return None
        seed = found.posture
    return cost, first


def _room(robot: Body, person: Body, world: World) -> float:
    """Return how far a robot is from what of a person does not move: trunk, head, arms [m]."""
    links = range(-1, robot.link_count)
    return min(world.separation(robot, person, within=ROOM, links=(k, -1)) for k in links)


__all__ = ["pulling_posture", "turns"]
