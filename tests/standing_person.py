"""A standing person to move, for several files of tests."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.policy import Policy
from rcare_marl.pose import (
    Pose,
)
from rcare_marl.world import World

Array = npt.NDArray[np.float64]
CONTROL_STEPS = 24
CONTROL_DT = CONTROL_STEPS / 240


def person_in(
    world: World,
    pose: Pose,
    movable: tuple[str, ...],
    *,
    avatar: str = "caregiver",
    name: str = "caregiver",
    moves: tuple[str, ...] = (),
) -> Human:
    posture = load_posture("standing")
    person = Human(name, load_avatar(avatar), posture=posture, movable=movable, moves=moves)
    person.spawn(world, pose)
    person.reset(np.random.default_rng(0))
    return person


def run_policy(world: World, person: Human, policy: Policy, seconds: float) -> None:
    for _ in range(round(seconds / CONTROL_DT)):
        person.command(policy.act(), CONTROL_DT)
        for _ in range(CONTROL_STEPS):
            person.actuate()
            world.step()
        person.sense()
