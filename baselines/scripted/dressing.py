"""A hand-written robot that pulls shorts up a leg.

It keeps the waistband over the shank while the caregiver lifts the leg, pulls it along the leg to the hip
until the hem is past the target, and lets go. It pulls towards the other leg, where the rest of the shorts
hangs, and sways when the hem catches: a pull in one line draws a caught ring only tighter. If that does not
free it, or it presses too much, it eases back and pulls again, farther off the leg.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.dressing_state import EASE
from rcare_marl.envs.scenes.hanging_shorts import hold_start, tip
from rcare_marl.envs.tasks.dressing import REACH, Dressing
from rcare_marl.pose import Array

from .tool_script import ToolScript, limited, turning

# All our own choices.
GAIN = 3.0  # [1/s]
FAST = 0.25  # [m/s] of the tool
PULL = 0.12  # [m/s] along the leg
LAG = 0.07  # [m] that the tool may be behind before the pull goes on
CAUGHT = 0.05  # [m] that the tool is behind when the hem has caught
INWARD = (0.0, 0.04)  # [m] to the other leg, from the knee on: it sways between the two
SWAY = 1.5  # [s] there and back
SPARE = 0.03  # [m] that it pulls beyond where the task expects it to need to
OFF = (0.0, 0.02, 0.04, 0.06)  # [m] off the leg: another after each stall, and from the first again
MOST_OFF = 0.06  # [m] off the leg for its thigh
BENT, UP = 0.03, 0.015  # [m] from the thigh, while the leg is bent and when it is up
SHY = 8.0  # [1/s] to keep that
YIELDING = (0.5, 0.8)  # of the force limit: where the pull gets slower, and where it goes back
AWAY = (0.05, 0.0, 0.06)  # [m] that the open hand goes


@register_policy("dressing", "robot", "scripted")
class ScriptedDressing(ToolScript[Dressing]):
    """Follows the leg, pulls once it is up, and lets go when the hem is past its target."""

    KIND = Dressing

    def _begin(self) -> None:
        # The gripper, if it is commanded.
        self._others = self._robot.action_size - self._robot.control.size
        self._start = hold_start(self._task.leg)
        self._along, self._left = self._start, False
        self._caught = 0.0  # [s] in all
        self._stalls = 0
        self._shy = 0.0  # [m] farther off the leg, for its thigh
        self._turn = np.array(self._robot.tool_pose().quaternion)
        self._out = np.zeros(3)

    def act(self) -> Array:
        tool = self._robot.tool_pose()
        here = np.array(tool.position)
        goal = self._goal(here)
        wished = limited(GAIN * (goal - here), FAST)
        action = self._robot.tool_action(wished, turning(self._turn, tool.quaternion))
        return np.concatenate((action, np.full(self._others, -1.0 if self._left else 0.0)))

    def memory(self) -> tuple[Sequence[object], Array]:
        whole = self._task.leg.shank + REACH + SPARE
        values = (self._along / whole, self._shy / MOST_OFF)
        off = OFF[self._stalls % len(OFF)] / OFF[-1]
        swings = 2.0 * math.pi * self._caught / SWAY
        sway = (math.cos(swings), math.sin(swings))
        return (self._left,), np.array((*np.clip((*values, off), 0.0, 1.0), *sway))

    def _goal(self, here: Array) -> Array:
        """Return where the tool goes [m], shape [3]."""
        task = self._task
        if task.state.is_past and not self._left:
            self._left, self._out = True, here + AWAY
        if self._left:
            return self._out
        is_up = task.state.is_up
        self._keep_off(is_up)
        off = OFF[self._stalls % len(OFF)] + self._shy
        goal = tip(task.leg, self._along) + off * task.leg.front(self._along)
        lag = float(np.linalg.norm(goal - here))
        if is_up and lag < LAG:
            low, high = (share * task.force_limit for share in YIELDING)
            eager = min(max((high - task.state.force) / (high - low), -1.0), 1.0)
            step = PULL * eager * task.control_dt
            self._along = min(self._along + step, task.leg.shank + REACH + SPARE)
        if task.state.stalls > self._stalls:
            self._stalls = task.state.stalls
            self._along = max(self._along - EASE, self._start)
        if is_up and lag > CAUGHT:
            self._caught += task.control_dt
        return goal + (0.0, -task.outward * self._inward(), 0.0)

    def _keep_off(self, is_up: bool) -> None:
        """Go farther off the leg where its thigh comes near, and back again; the more while it is bent."""
        wanted = UP if is_up else BENT
        self._shy += SHY * (wanted - self._task.state.thigh_gap) * self._task.control_dt
        self._shy = min(max(self._shy, 0.0), MOST_OFF)

    def _inward(self) -> float:
        """Return how far to the other leg it pulls [m]: all the way until the hem catches."""
        share = (self._along - self._start) / (self._task.leg.shank - self._start)
        near, far = INWARD
        swayed = near + 0.5 * (far - near) * (1.0 + math.cos(2.0 * math.pi * self._caught / SWAY))
        return min(max(share, 0.0), 1.0) * swayed
