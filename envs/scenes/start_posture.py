"""The posture in which a robot starts, where it has a way to go."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.agents.robots.kinematics import IkResult
from rcare_marl.pose import Pose

from ..reach import ReachSearch, Trial

# Our own choices.
TRIES = 24  # postures among which one is chosen
MISS_WEIGHT = 30.0  # [rad/m] of a place that is not reached, against the way of the joints
TURN_WEIGHT = 0.1  # [m/rad] of a turn that is missed


def start_best(search: ReachSearch, way: Sequence[Pose]) -> None:
    """Let a robot start, and prefer to be, at the first pose of `way` so that it can follow the rest best.

    That is where its joints go least and it misses the poses least; only the first has to be reached.
    """
    rng, arm = np.random.default_rng(0), search.robot.arm
    low, high = np.maximum(arm.lower, -math.pi), np.minimum(arm.upper, math.pi)
    seeds = [arm.rest.copy(), *(rng.uniform(low, high) for _ in range(TRIES - 1))]
    search = dataclasses.replace(search, needed=1, roams=False, cost=_cost)
    found = search.find([Trial(way, seed=seed) for seed in seeds], "where it is to start")
    arm.rest[:] = found.posture
    search.robot.set_posture(found.posture)


def _cost(before: IkResult, after: IkResult) -> float:
    miss = MISS_WEIGHT * (after.distance + TURN_WEIGHT * after.angle)
    return miss + float(np.abs(after.posture - before.posture).max())
