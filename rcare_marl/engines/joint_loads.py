"""What the joints of a body transmit in MuJoCo, as Bullet's joint feedback tells it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rcare_marl.joint_feedback import JointFeedback
from rcare_marl.pose import Array

if TYPE_CHECKING:
    from .mujoco_body import MujocoBody


class JointLoads(JointFeedback):
    """The wrenches in the joints of one body.

    MuJoCo works them out after each physics step by recursive Newton-Euler from the accelerations, contacts
    and bonds of that step. So what a stop at the end of a range bears is felt too, which Bullet leaves out.
    """

    def __init__(self, body: MujocoBody, client: int) -> None:
        """Read the tree of a body."""
        super().__init__(body, client)
        self._owner = body

    def enable(self, links: Iterable[int]) -> None:
        super().enable(links)
        self._owner.feel()

    def wrenches(self, links: Sequence[int]) -> Array:
        sim = self._owner.sim
        if sim is None:
            return super().wrenches(links)
        torques, forces, arms, turns = sim.loads(self._owner.numbers(links))
        torques = torques + np.cross(arms, forces)
        # What the child puts on its parent, in the frame of the child.
        pair = [-np.einsum("nba,nb->na", turns, wrench) for wrench in (forces, torques)]
        return np.concatenate(pair, axis=1)
