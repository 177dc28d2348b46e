"""How a robot holds a cup that it brings to a mouth."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.agents.human import Human
from rcare_marl.agents.robot import Robot
from rcare_marl.agents.robot_config import no_reach
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, Vector
from rcare_marl.world import World

from ..devices.cup import Cup

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
        self, world: World, robot: Robot, cup: Cup, person: Human, *, start: Array, lips: Array
    ) -> None:
        """Find a hold with which the robot can bring the cup from `start` to `lips` and empty it there.

        Args:
            world: Where all stand; nothing has moved afterwards.
            robot: Who holds the cup.
            cup: The cup.
            person: Who drinks. The robot must not touch them on the way; the cup may.
            start: Where the rim starts [m], shape [3].
            lips: Where it has to come [m], shape [3].

        Raises:
            ConfigError: If there is none.
        """
        self._world, self._robot, self._cup, self._person = world, robot, cup, person
        self._start, self._lips = start, lips
        way = (lips - start) * (1.0, 1.0, 0.0)
        self._way = way / np.linalg.norm(way)
        # The arm comes from the side where its base is.
        across = np.cross(self._way, np.subtract(robot.body.base_pose().position, lips))
        side = 1.0 if across[2] > 0 else -1.0
        misses = []
        for angle in HANDLES_DEG:
            self.handle = -side * math.radians(angle)
            misses.append(self._miss())
            if misses[-1] < REACH:
                return
        raise ConfigError(
            f"{no_reach(robot.config, robot.files.model.name, robot.moves)}: with the cup in the hand it "
            f"misses its way to the lips by {min(misses):.2f} m or touches the person"
        )

    def pose(self, rim: Vector, way: Vector, tilt: float) -> Pose:
        """Return where the cup is when it is held like this; see `Cup.pouring`."""
        return self._cup.pouring(rim, way, tilt, self.handle)

    def _miss(self) -> float:
        """Return by how much the robot misses the way to the lips [m]; infinite if it touches somebody."""
        robot, home, posture, worst = self._robot, self._robot.arm.positions(), None, 0.0
        for share, tilt in WAYPOINTS:
            rim = self._start + share * (self._lips - self._start)
            tool = self.pose(rim, self._way, tilt) @ self._cup.in_tool.inverse()
            found = robot.solve_ik(tool, seed=posture)
            posture = found.posture
            worst = max(worst, found.distance + REACH_TURN * found.angle)
            if worst >= REACH:
                break
            robot.set_posture(posture)
            gap = self._world.separation(robot.body, self._person.body, within=2 * CLEAR)
            if gap < CLEAR:
                worst = math.inf
                break
        robot.set_posture(home)
        return worst


__all__ = ["CupHold"]
