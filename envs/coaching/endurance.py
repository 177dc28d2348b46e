"""How far people raise their arms again and again: within what their muscles hold with something to spare."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rcare_marl.agents.coaching.exercise import Reach
from rcare_marl.agents.coaching.imitation import SHOULDER, Imitation
from rcare_marl.agents.coaching.upper_body import ARM, MOTIONS, SIDES
from rcare_marl.agents.people.body.person_tree import person_tree
from rcare_marl.agents.people.body.skeleton import DOF_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array, matrix_from_quaternion
from rcare_marl.tree.dynamics import holding_torques
from rcare_marl.world import GRAVITY

# Share of the strength of a rested shoulder that an arm's weight may take for many repetitions: muscles of
# grade 3 lift it through its range once. Our own choice.
SHARE = 0.75
# An arm that rises by less than this beyond where it hangs beside the chair does no exercise; our own choice.
LEAST_RISE = math.radians(20.0)
# An elbow that extends with less [N·m] stays as bent as it is beside the chair; our own choice.
EXTENDS = 2.0
RISE = math.radians(3.0)  # steps by which that is searched for


def reach_within_strength(reach: Reach, person: Human, seated: Array) -> Reach:
    """Return what is left of a spawned person's reach where an arm rises no higher than it can often.

    Args:
        reach: What their range and grades allow.
        person: Who it is, driven by joint torques.
        seated: Angles of the upper body as they sit [rad], shape [16].
    """
    raised, straightens = _Raised(person), reach.straightens
    low, high, front = reach.low.copy(), reach.high.copy(), list(reach.front or [])
    for i, side in enumerate(SIDES):
        at = ARM[side].start
        ahead = front[i] if front else float(high[at])
        lowest = float(reach.low[at])
        if not raised.can_move(side) or max(high[at], ahead) <= lowest:
            continue
        most = [raised.most(side, p, lowest, m) for p, m in ((0.0, high[at]), (math.pi / 2, ahead))]
        most = [m if m > seated[at] + LEAST_RISE else lowest for m in most]
        elbow = at + 3
        if raised.extends(side) < EXTENDS:
            low[elbow] = min(max(low[elbow], seated[elbow]), high[elbow])
            straightens = False
        high[at] = most[0]
        if front:
            front[i] = most[1]
        else:
            high[at] = min(most)
    most_ahead = (front[0], front[1]) if front else None
    return replace(reach, low=low, high=high, front=most_ahead, straightens=straightens)


class _Raised:
    """What it takes to hold an arm up."""

    def __init__(self, person: Human) -> None:
        self._person = person
        self._index = {dof: i for i, dof in enumerate(person.movable)}
        self._start = person.angles[[DOF_INDEX[dof] for dof in person.movable]]
        self._limits = dict(zip(person.movable, map(tuple, person.active.tolist()), strict=True))
        chain = person_tree(person.segments, person.model.joints, person.angles, person.movable)
        self._tree = chain.arrays
        turn = matrix_from_quaternion(person.pelvis.quaternion)
        self._gravity: Array = turn.T @ np.array((0.0, 0.0, -GRAVITY))

    def _raising(self, side: str) -> list[int]:
        names = [f"{side}_{dof}" for dof in SHOULDER[:2]]
        return [self._index[name] for name in names if name in self._index]

    def can_move(self, side: str) -> bool:
        return len(self._raising(side)) == len(SHOULDER[:2])

    def extends(self, side: str) -> float:
        """Return the torque with which an elbow extends [N·m]; infinite where it does not move."""
        at = self._index.get(f"{side}_elbow_flexion")
        return math.inf if at is None else float(self._person.drive.strength[at, 0])

    def most(self, side: str, plane: float, low: float, high: float) -> float:
        """Return the greatest elevation [rad] from `low` to `high` up to which the shoulder has to spare."""
        imitation, angles, arm = Imitation(self._limits), np.zeros(len(MOTIONS)), ARM[side]
        joints, best = self._raising(side), low
        strength = SHARE * self._person.drive.strength[joints]
        angles[arm.start + 1] = plane
        for elevation in [*np.arange(low, high, RISE).tolist(), high]:
            angles[arm.start] = elevation
            q = self._start.copy()
            for dof, angle in imitation(angles).items():
                if dof.startswith(side):
                    q[self._index[dof]] = angle
            needed = holding_torques(self._tree, q, self._gravity)[joints]
            if (needed < -strength[:, 0]).any() or (needed > strength[:, 1]).any():
                break
            best = float(elevation)
        return best
