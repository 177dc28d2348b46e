"""A hand-written robot for the dressing challenge: take the gown by its seam, and pull the sleeve up the arm.

It dresses the left arm: one gripper has no way to lead the gown behind the back and into the other
sleeve. It needs a gripper that moves.
"""

from __future__ import annotations

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
BEFORE_FIST, OVER_WRIST, OVER_ELBOW = (0.1, 0.02, 0.04), (-0.015, 0.015, 0.035), (0.0, 0.025, 0.005)
BESIDE_NECK = 0.04  # [m] before the shoulder, where the fingers stop
YIELDING = 20.0, 36.0  # [N] on the person: where it gets slower, and stops
BACK = -0.5  # of its speed that it goes back with at most
ARRIVED = 0.06  # [m] from the shoulder, where the sleeve is nearly up
TIRED, ABOUT = 25, 2.5  # steps after which so many times `NEAR` or `NEARER` do
BEYOND, OUTSIDE = -0.04, 0.12  # [m] before the shoulder, as far in and out as the fingers then go
CREEP = 0.004  # [m] of that in a step
TOO_MUCH = 24.0  # [N] on the person, above which they go no farther in
UPWARDS = np.array((0.0, 0.0, 1.0))


@register_policy("phyrc_dressing", "robot", "scripted")
class ScriptedPhyrcDressing(ToolScript[PhyrcDressing]):
    """Lines up over the seam, closes, and pulls the sleeve to the shoulder, slower where it presses."""

    KIND, WITH_GRIPPER = PhyrcDressing, True

    def _begin(self) -> None:
        self._phase, self._leg = "line up", 0
        self._waited = 0  # steps in a phase
        self._before, self._best = BESIDE_NECK, 0.0  # [m] from the shoulder; most that was covered

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
        way = self._way()
        if np.linalg.norm(way[self._leg] - tool) < NEAR and self._leg < len(way) - 1:
            self._leg += 1
        if self._leg == len(way) - 1 and np.linalg.norm(way[-1] - tool) < ARRIVED:
            self._finish()
        return _towards(way[self._leg] - tool, PULL * self._eagerness())

    def _eagerness(self) -> float:
        """Return the share of its speed with which it pulls, by how it presses; below 0 it goes back."""
        low, high = YIELDING
        return min(max((high - self._task.state.force) / (high - low), BACK), 1.0)

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
