"""A scripted robot that lifts the lid of a toilet."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.tasks.toileting import Toileting
from rcare_marl.pose import Array, quaternion_from_rpy

from .tool_script import ToolScript, limited, turning

# All our own choices.
PAD = np.array(
    (-0.004, 0.0, 0.006)
)  # [m] from Stretch's tool to the slope of its rubber cups, level
EDGE, DEEP = (
    0.479,
    0.36,
)  # [m] from the hinge, where the lid is pushed: by its lip, and when it is up
BELOW = 0.02  # [m] under the lip, where the hand comes in
APPROACH = np.array((0.06, 0.0, -0.03))  # [m] from the lip, where it lines up
LINED_UP = 0.012  # [m] across or up that it may be off as it goes under the lip
NEAR = 0.003  # [m] from there it begins to lift
SLIPPED = 0.012  # [m] over the lip of a shut lid: the hand missed it
LEAD = math.radians(12)  # that the hand is ahead of the lid
STARTED = math.radians(1.5)  # from where on the lid follows
GAIN = 3.0  # [1/s]
FINGERS = 0.027  # [m] that those of Stretch reach ahead of its tool, as it starts
FAST, SLOW = 0.20, 0.06  # [m/s] on the way, and under the lip
AHEAD = quaternion_from_rpy(0.0, -0.5 * math.pi, 0.0)  # z at the toilet, x up


@register_policy("toileting", "robot", "scripted")
class ScriptedToileting(ToolScript[Toileting]):
    """Puts the fingers under the lip, and pushes the lid along its arc until it is open."""

    KIND = Toileting

    def _begin(self) -> None:
        longer = max(self._task.fingers - FINGERS, 0.0)
        self._pad, self._approach = (
            at + (sign * longer, 0, 0) for at, sign in ((PAD, -1), (APPROACH, 1))
        )

    def act(self) -> Array:
        pose = self._robot.tool_pose()
        goal, most = self._goal(np.array(pose.position))
        wished = limited(GAIN * (goal - pose.position), most)
        return self._robot.tool_action(wished, turning(AHEAD, pose.quaternion))

    def _goal(self, tool: Array) -> tuple[Array, float]:
        """Return where the tool is to go [m], shape [3], and how fast at most [m/s]."""
        task, angle = self._task, self._task.state.angle
        if angle > STARTED:
            share = min(angle / math.radians(60), 1.0)
            along = EDGE + share * (DEEP - EDGE)
            return task.lip_at(angle + LEAD, along) - self._pad, FAST
        lip, under = task.lip_at(0.0), task.lip_at(0.0, EDGE) - self._pad
        across, up = np.abs(tool - lip - self._approach)[1:]
        ahead, risen = tool[0] - under[0], max(tool[2] - under[2] + BELOW, 0.0)
        # Seen, not kept in mind, so that who imitates it need not remember; the lid pushes the hand ahead.
        if ahead < NEAR + risen and across < LINED_UP and tool[2] < lip[2] + SLIPPED:
            return task.lip_at(LEAD, EDGE) - self._pad, SLOW
        if max(across, up) < LINED_UP:
            return under - (0.0, 0.0, BELOW), FAST
        return lip + self._approach, FAST
