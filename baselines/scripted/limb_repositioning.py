"""A hand-written robot that lays an arm on the armrest with a cradle.

It goes behind the forearm from outside, lifts it in an arc about the elbow, carries it over the armrest,
lowers it and draws the plate out from under it.
"""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.envs.devices import HOOK_SHARE, HOOK_SHARE_HANGING
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.tasks.limb_repositioning import LimbRepositioning
from rcare_marl.pose import Array, Pose, quaternion_from_matrix, rotate

from .tool_script import ToolScript, limited, turning

# All our own choices.
GAIN, TURN_GAIN = 3.0, 3.0  # [1/s]
FAST, SLOW = 0.2, 0.1  # [m/s] freely, and near or under the arm
ACCELERATION = 0.8  # [m/s²]
NEAR = 0.02  # [m] from a place that counts as reached
STILL = 0.03  # [m/s] of the wrist of an arm that hangs still
SWEEP = 0.5  # [rad/s] of the forearm on its arc
FREE = 0.03  # [m] of the elbow before the armrest's rear end, when the forearm is free of it
PRESS = 0.015  # [m] that the plate aims into the arm as it slides along it
HOLDING = ("free", "slide", "lift", "carry")
LEAD = 0.4  # [rad] that the wished arc is ahead of the forearm at most
# Where the forearm points when it is up: while the elbow is behind the armrest, and beside it.
OUTWARD = np.array((0.58, 0.8, 0.1))
RAISED = 0.2  # [rad] of the wrist above the elbow, so that a drooping hand clears the armrest
SETTLING = np.array((0.01, 0.0, 0.0))  # [m] that the forearm goes back when it is let go
RISE = 0.03  # [m] of the elbow over its place, while the forearm is lifted
CLEAR = 0.04  # [m] of the wrist over its place, before it goes over the armrest
SINK = 0.4  # [rad/s] of the forearm on its way down
UNDER = 0.012  # [m] of plate and room between pad and forearm, when it is let go
AWAY = 0.2  # [m] that the plate is drawn out
LOST = 0.08  # [m] from the plate to where it should be: the arm has slipped off


@register_policy("limb_repositioning", "robot", "scripted")
class ScriptedRepositioning(ToolScript[LimbRepositioning]):
    """Goes behind the forearm, lifts, carries and lowers it, and draws the plate out; sees everything."""

    KIND = LimbRepositioning

    def _begin(self) -> None:
        self._velocity = np.zeros(3)
        self.phase = "approach"
        self._wrist = np.zeros(3)

    def act(self) -> Array:
        seat = self._task.seat_pose()
        place = np.array(seat.position)
        if self.phase in HOLDING and self._is_lost(place):
            self.phase = "approach"
        goal, turn, limit = getattr(self, "_" + self.phase)(place)
        return self._towards(seat, goal, turn, limit)

    def _approach(self, seat: Array) -> tuple[Array, Array, float]:
        """Stand behind the forearm, outside of it."""
        place, turn = self._task.hook()
        wrist = self._task.state.wrist
        is_still = math.dist(wrist, self._wrist) < STILL * self._task.control_dt
        self._wrist = wrist
        if not is_still:  # it may swing back into the way
            return seat, turn, SLOW
        inward = rotate(turn, (0.0, 0.0, 1.0))
        back = rotate(turn, (-1.0, 0.0, 0.0))
        goal = place - 0.11 * inward + 0.03 * back
        if math.dist(seat, goal) < NEAR:
            self.phase = "reach"
        return goal, turn, FAST

    def _reach(self, seat: Array) -> tuple[Array, Array, float]:
        """Slide the plate behind the forearm."""
        place, turn = self._task.hook()
        goal = place + 0.015 * rotate(turn, (-1.0, 0.0, 0.0))
        if math.dist(seat, goal) < 1.5 * NEAR:
            self.phase, self._forearm = "free", self._direction()
        return goal, turn, SLOW

    def _direction(self) -> Array:
        along = self._task.state.wrist - self._task.state.elbow
        return np.asarray(along / np.linalg.norm(along))

    def _turn_to(self, towards: Array) -> None:
        """Turn the wished direction of the forearm a step on."""
        towards = towards / np.linalg.norm(towards)
        left = math.acos(min(max(float(towards @ self._forearm), -1.0), 1.0))
        part = min(1.0, SWEEP * self._task.control_dt / max(left, 1e-6))
        wished = (1 - part) * self._forearm + part * towards
        self._forearm = wished / np.linalg.norm(wished)

    def _ahead(self, share: float, towards: Array) -> tuple[Array, Array, float]:
        """Push the forearm at `share` of its length towards a direction."""
        task = self._task
        place, turn = task.hook(share)
        ahead = math.acos(min(max(float(self._direction() @ self._forearm), -1.0), 1.0))
        if ahead < LEAD:
            self._turn_to(towards)
        forearm = float(np.linalg.norm(task.state.wrist - task.state.elbow))
        return place + share * forearm * (self._forearm - self._direction()), turn, SLOW

    def _free(self, seat: Array) -> tuple[Array, Array, float]:
        """Push the forearm out from behind the armrest."""
        task = self._task
        pad = task.chair.frame_in_world("armrest_left").position[0]
        if task.state.elbow[0] > pad - 0.5 * task.chair.armrest_size[0] + FREE:
            self.phase = "slide"
        return self._ahead(HOOK_SHARE_HANGING, OUTWARD)

    def _slide(self, seat: Array) -> tuple[Array, Array, float]:
        """Slide the plate towards the wrist."""
        place, turn = self._task.hook(HOOK_SHARE)
        goal = place + PRESS * rotate(turn, (1.0, 0.0, 0.0))
        if abs(float((goal - seat) @ self._direction())) < NEAR:
            self.phase, self._forearm = "lift", self._direction()
        return goal, turn, SLOW

    def _lift(self, seat: Array) -> tuple[Array, Array, float]:
        """Swing the forearm up, in an arc about where the elbow is to be, and stay below it."""
        task = self._task
        self._turn_to(np.array((0.93, 0.35, math.tan(RAISED))))
        is_clear = task.state.wrist[2] > task.state.target[2] + CLEAR
        if self._forearm[2] > math.sin(RAISED) - 0.02 and is_clear:
            self.phase = "carry"
        forearm = task.state.wrist - task.state.elbow
        length = math.sqrt(float(forearm @ forearm))
        elbow = task.state.elbow.copy()
        elbow[2] = task.state.target[2] + RISE
        goal, turn = task.cradle.under(
            elbow, elbow + length * self._forearm, task.radius, HOOK_SHARE
        )
        goal[1] = min(float(goal[1]), float(task.hook(HOOK_SHARE)[0][1]))
        return goal, turn, SLOW

    def _is_lost(self, seat: Array) -> bool:
        """Return whether the forearm has slipped off the plate."""
        task = self._task
        forearm = task.state.wrist - task.state.elbow
        share = float((seat - task.state.elbow) @ forearm / (forearm @ forearm))
        return math.dist(task.hook(share)[0], seat) > LOST

    def _over(self, pitch: float) -> tuple[Array, Array]:
        """Return where the plate holds a forearm over the pad whose wrist is raised by `pitch` [rad]."""
        task = self._task
        length = float(np.linalg.norm(task.state.wrist - task.state.elbow))
        along = np.array((math.cos(pitch), 0.0, math.sin(pitch)))
        up = np.array((-along[2], 0.0, along[0]))
        elbow = task.state.target + SETTLING + (-0.5 * length, 0.0, RISE * pitch / RAISED)
        level = np.column_stack(((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)))
        turn = quaternion_from_matrix(level)
        return elbow + HOOK_SHARE * length * along - (task.radius - UNDER) * up, turn

    def _carry(self, seat: Array) -> tuple[Array, Array, float]:
        """Bring the raised forearm over the armrest."""
        goal, _ = self._over(RAISED)
        if abs(float((goal - seat)[1])) < NEAR:
            self.phase, self._pitch = "lower", RAISED
        return goal, self._task.hook()[1], SLOW

    def _lower(self, seat: Array) -> tuple[Array, Array, float]:
        """Lower it, and level the plate."""
        self._pitch = max(self._pitch - SINK * self._task.control_dt, 0.0)
        goal, turn = self._over(self._pitch)
        if self._pitch == 0.0 and math.dist(goal, seat) < NEAR:
            self.phase, self._flat = "leave", turn
            self._out = seat + (0.0, AWAY, 0.0)
        return goal, turn, SLOW

    def _leave(self, seat: Array) -> tuple[Array, Array, float]:
        """Draw the plate out, and stay away."""
        return self._out, self._flat, FAST

    def _towards(self, seat: Pose, goal: Array, turn: Array, limit: float) -> Array:
        wished = limited(GAIN * (goal - seat.position), limit)
        most = ACCELERATION * self._task.control_dt * (3.0 if self.phase == "leave" else 1.0)
        self._velocity = self._velocity + limited(wished - self._velocity, most)
        middle = np.array(seat.position)  # of the plate, about which it turns
        return self._about(middle, self._velocity, turning(turn, seat.quaternion, TURN_GAIN))
