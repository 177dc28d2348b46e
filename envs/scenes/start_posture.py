"""The posture in which a robot starts, where it has a way to go."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.agents.robot import Robot
from rcare_marl.agents.robot_config import no_reach
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose
from rcare_marl.world import World

# Our own choices.
TRIES = 24  # postures among which one is chosen
MISS_WEIGHT = 30.0  # [rad/m] of a place that is not reached, against the way of the joints
TURN_WEIGHT = 0.1  # [m/rad] of a turn that is missed


def start_best(
    robot: Robot, way: Sequence[Pose], person: Body, world: World, *, clear: float
) -> None:
    """Let a robot start, and prefer to be, at the first pose of `way` so that it can follow the rest best.

    That is where its joints go least and it misses the poses least.

    Args:
        robot: The robot, of whom the main arm moves.
        way: Poses of its tool in the world.
        person: Whom it must stay clear of at the start.
        world: Where they are.
        clear: How far [m], 0.1 at most.

    Raises:
        ConfigError: If it does not reach the first pose, or not clear of the person.
    """
    rng, arm = np.random.default_rng(0), robot.arm
    low, high = np.maximum(arm.lower, -math.pi), np.minimum(arm.upper, math.pi)
    best = math.inf
    posture: Array | None = None
    for k in range(TRIES):
        found = robot.solve_ik(way[0], seed=arm.rest if k == 0 else rng.uniform(low, high))
        if not found.is_within(0.02, 0.1):
            continue
        first, cost = found.posture, 0.0
        for pose in way[1:]:
            after = robot.solve_ik(pose, seed=found.posture)
            cost += MISS_WEIGHT * (after.distance + TURN_WEIGHT * after.angle)
            cost += float(np.abs(after.posture - found.posture).max())
            found = after
        if cost < best:
            robot.set_posture(first)
            if world.separation(robot.body, person, within=0.1) >= clear:
                best, posture = cost, first
    if posture is None:
        name = robot.files.model.name
        raise ConfigError(f"{no_reach(robot.config, name, robot.moves)} where it is to start")
    arm.rest[:] = posture
    robot.set_posture(posture)


__all__ = ["start_best"]
