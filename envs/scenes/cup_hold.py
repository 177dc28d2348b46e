"""How a robot holds a cup that it brings to a mouth."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array, Pose, Vector

from ..devices import Cup
from ..reach import ReachSearch, Trial

# All our own choices. Angles between the way from the handle to the cup and the way to the face that are
# tried, the best first: from the side one turn of the wrist tilts the cup.
HANDLES_DEG = (90.0, 70.0, 100.0, 110.0, 50.0, 130.0, 30.0, 150.0, 180.0, 0.0)
EMPTY = math.radians(85)  # tilt that a robot must reach at the lips
# On the way to the lips where it is tried: share of the way, tilt [rad]. A head that is turned or leans
# back is farther away by a tenth.
WAYPOINTS = ((0.0, 0.0), (0.35, 0.2), (0.7, 0.5), (1.0, 0.5), (1.1, 0.5), (1.1, 1.0), (1.0, EMPTY))
REACH, REACH_TURN = 0.02, 0.2  # [m] that it may miss them by, and of it per radian
CLEAR = 0.025  # [m] that it keeps from the person there


class CupHold:
    """On which side of the cup its handle is, for a robot that has to tilt it at somebody's lips.

    Attributes:
        handle: Angle about z from the way to the face to that from the handle to the cup's axis [rad].
    """

    def __init__(
        self, search: ReachSearch, cup: Cup, person: Human, *, start: Array, lips: Array
    ) -> None:
        """Find a hold with which the robot can bring the cup from `start` to `lips` and empty it there.

        Args:
            search: How the robot's start is searched for.
            cup: The cup.
            person: Who drinks. The robot must not touch them on the way; the cup may.
            start: Where the rim starts [m], shape [3].
            lips: Where it has to come [m], shape [3].

        Raises:
            ConfigError: If there is none.
        """
        self._cup = cup
        level = (lips - start) * (1.0, 1.0, 0.0)
        way = level / np.linalg.norm(level)
        # The arm comes from the side where its base is.
        across = np.cross(way, np.subtract(search.robot.body.base_pose().position, lips))
        side = 1.0 if across[2] > 0 else -1.0
        trials = []
        for angle in HANDLES_DEG:
            self.handle = -side * math.radians(angle)
            cups = [self.pose(start + s * (lips - start), way, tilt) for s, tilt in WAYPOINTS]
            poses = [pose @ cup.in_tool.inverse() for pose in cups]
            trials.append(Trial(poses, hold=self.handle))
        search = dataclasses.replace(
            search,
            clear_of=[(person.body, CLEAR)],
            all_the_way=True,
            within=lambda found: found.distance + REACH_TURN * found.angle < REACH,
        )
        self.handle = search.find(trials, "the lips with the cup in its hand").trial.hold

    def pose(self, rim: Vector, way: Vector, tilt: float) -> Pose:
        """Return where the cup is when it is held like this; see `Cup.pouring`."""
        return self._cup.pouring(rim, way, tilt, self.handle)
