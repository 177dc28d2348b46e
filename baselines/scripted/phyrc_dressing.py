"""A hand-written robot for the dressing challenge: take the gown by its seam, and pull the sleeve up the arm.

It dresses the left arm: one gripper has no way to lead the gown behind the back and into the other
sleeve. It needs a gripper that moves.
"""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.envs.phyrc.dressing_score import ITEMS
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.tasks.phyrc_dressing import PhyrcDressing
from rcare_marl.pose import Array

from .tool_script import ToolScript, turning

# All our own choices.
GAIN = 3.0  # [1/s]
FAST, SLOW, PULL = 0.20, 0.06, 0.07  # [m/s] through the air, at the seam, with the sleeve
NEAR, NEARER = 0.03, 0.012  # [m] that count as there: on the way, and at the seam
OVER_SEAM = 0.08  # [m] where the hand lines up
# [m] from places over the arm to where the sleeve is led: out along the arm, to the robot's side, and up.
# The best of 17 ways in 40 episodes each, rounded, and so are the figures of easing: docs/phyrc.md.
BEFORE_FIST, OVER_WRIST, OVER_ELBOW = (0.1, 0.02, 0.0), (-0.015, 0.015, 0.035), (0.0, 0.025, 0.005)
BESIDE_NECK = 0.04  # [m] before the shoulder, where the fingers stop
YIELDING, SLOWEST = (20.0, 36.0), 0.25  # [N] on the person: where it gets slower, and slowest
HEADWAY, STUCK = 0.01, 10  # [m] that are to be made in so many steps, or the sleeve is caught
CAUGHT_FORCE = 32.0  # [N] on the person, above which it is too
ARRIVED = 0.06  # [m] from the shoulder, from where on it is not
BACK, ASIDE, UP = 0.085, 0.05, 0.03  # [m] that the hand goes back then, in the same directions
BACK_STEPS = 20  # at most
MORE, MOST = 0.3, 2.0  # of the way back that each further one is longer, times at most
TIRED, ABOUT = 25, 2.5  # steps after which so many times `NEAR` or `NEARER` do
BEYOND, OUTSIDE = -0.04, 0.12  # [m] before the shoulder, as far in and out as the fingers then go
CREEP = 0.004  # [m] of that in a step
TOO_MUCH = 24.0  # [N] on the person, above which they go no farther in
UPWARDS = np.array((0.0, 0.0, 1.0))


@register_policy("phyrc_dressing", "robot", "scripted")
class ScriptedPhyrcDressing(ToolScript[PhyrcDressing]):
    """Lines up over the seam, closes on it, waits, and pulls the sleeve to the shoulder.

    A sleeve that is caught it eases back and to the side, and pulls again: back to before the fist where
    this is not through the cuff yet, since the edge of the armhole then hangs over its knuckles.
    """

    KIND, WITH_GRIPPER = PhyrcDressing, True

    def _begin(self) -> None:
        self._phase, self._leg = "line up", 0
        self._nearest, self._still = math.inf, 0  # [m] to the shoulder, and steps without headway
        self._side, self._steps, self._back = -1.0, 0, np.zeros(3)
        self._waited, self._eased = 0, 0  # steps in a phase, and times that it went back
        self._before, self._best = (
            BESIDE_NECK,
            0.0,
        )  # [m] from the shoulder, and the most that was covered

    def act(self) -> Array:
        task, pose = self._task, self._robot.tool_pose()
        tool = np.array(pose.position)
        linear = self._velocity(tool)
        arm = self._robot.tool_action(linear, turning(task.turn, pose.quaternion))
        return np.append(arm, -1.0 if self._phase in ("line up", "reach") else 1.0)

    def _velocity(self, tool: Array) -> Array:
        """Return the velocity of the tool [m/s], shape [3]."""
        task = self._task
        self._waited += 1
        patient = 1.0 if self._waited < TIRED else ABOUT
        if self._phase == "line up":
            goal = task.state.seam + (0.0, 0.0, OVER_SEAM)
            if np.linalg.norm(goal - tool) < patient * NEAR:
                self._phase, self._waited = "reach", 0
            return _towards(goal - tool, FAST)
        if self._phase == "reach":
            if np.linalg.norm(task.state.seam - tool) < patient * NEARER:
                self._phase = "close"
            return _towards(task.state.seam - tool, SLOW)
        if self._phase == "close":
            if task.state.is_held:
                self._phase = "pull"
            return np.zeros(3)
        if self._phase == "ease":
            self._steps -= 1
            if self._steps == 0 or np.linalg.norm(self._back - tool) < NEAR:
                self._phase, self._nearest, self._still = "pull", math.inf, 0
            return _towards(self._back - tool, FAST)
        way = self._way()
        if self._is_caught(float(np.linalg.norm(way[-1] - tool))):
            back = BACK * min(1.0 + MORE * self._eased, MOST)
            if not self._is_through():
                back = max(back, float((way[0] - tool) @ self._offset(1.0, 0.0, 0.0)))
            self._eased += 1
            up = UP if self._eased % 2 else -UP  # the lower rim comes free where the fingers sink
            self._back = tool + self._offset(back, self._side * ASIDE, up)
            self._phase, self._steps, self._side = "ease", BACK_STEPS, -self._side
        if np.linalg.norm(way[self._leg] - tool) < NEAR and self._leg < len(way) - 1:
            self._leg += 1
        if self._leg == len(way) - 1 and np.linalg.norm(way[-1] - tool) < ARRIVED:
            self._finish()
        return _towards(way[self._leg] - tool, PULL * self._eagerness())

    def _eagerness(self) -> float:
        """Return the share of its speed with which it pulls, less the more it presses."""
        low, high = YIELDING
        return min(max((high - self._task.state.force) / (high - low), SLOWEST), 1.0)

    def _finish(self) -> None:
        """At the shoulder: go on until cloth lies over it, then back if the sleeve left the forearm."""
        state = self._task.state
        covered = float(state.covered[0])
        self._best = max(self._best, covered)
        if not state.points[ITEMS.index("left_shoulder")]:
            if state.force < TOO_MUCH:
                self._before = max(self._before - CREEP, BEYOND)
        elif covered < self._best:
            self._before = min(self._before + CREEP, OUTSIDE)

    def _is_through(self) -> bool:
        """Return whether the cuff is past the wrist."""
        state = self._task.state
        return float((state.cuff - state.arm[0]) @ self._offset(1.0, 0.0, 0.0)) < 0.0

    def _is_caught(self, gap: float) -> bool:
        """Return whether the sleeve has stopped on its way, or hurts; gap [m] to where it is to go."""
        if gap < self._nearest - HEADWAY:
            self._nearest, self._still = gap, 0
        else:
            self._still += 1
        is_stopped = self._still >= STUCK or self._task.state.force > CAUGHT_FORCE
        return is_stopped and gap > ARRIVED

    def _way(self) -> list[Array]:
        """Return where the fingers go: before the fist, over wrist and elbow, to the shoulder [m]."""
        wrist, elbow, shoulder = self._task.way()
        along = (elbow - shoulder) / np.linalg.norm(elbow - shoulder)
        return [
            wrist + self._offset(*BEFORE_FIST),
            wrist + self._offset(*OVER_WRIST),
            elbow + self._offset(*OVER_ELBOW),
            shoulder + self._before * along,
        ]

    def _offset(self, out: float, aside: float, up: float) -> Array:
        """Return lengths out along the forearm, to the robot's side and up from it [m], shape [3]."""
        wrist, elbow, _ = self._task.state.arm
        way = (wrist - elbow) / np.linalg.norm(wrist - elbow)
        left = np.cross(UPWARDS, way)
        left /= np.linalg.norm(left)
        return np.asarray(out * way + aside * left + up * np.cross(way, left))


def _towards(way: Array, most: float) -> Array:
    speed = GAIN * float(np.linalg.norm(way))
    return GAIN * way * min(1.0, most / max(speed, 1e-9))
