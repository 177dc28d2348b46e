"""A scripted robot that works doors, turning, pressing or pushing, and drives the chair through."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.agents.robots.control import ToolDelta
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.way_through import WayState
from rcare_marl.envs.tasks.ambulating import Ambulating
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from .tool_script import ToolScript, limited, turning

# All our own choices.
OFF = 0.06  # [m] beside the handle, where the hand comes in
OUT = 0.10  # [m] before it, where it lines up
LEAD = 0.05  # [m] that the hand is ahead of what it pushes
DEEP = 0.005  # [m] that the tool goes past the middle of a knob
SHY = 0.024  # [m] that the tool stays out from a bar at first, while the wall is beside it
MISSED, BOLDER = 0.008, 0.012  # [m] that a panel is open if the hand passed the bar; nearer then
PATIENCE = 3.0  # [s] of pushing a panel in vain
DEEPER = 0.10  # [m] that a panel is open where there is room for the whole finger beside its bar
PAST = 0.02  # [m] beyond the handle: the hand slipped off it
NEAR = 0.015  # [m] from its way in that it may be; as far again it keeps out
BESIDE = {"lever": 0.03, "slider": 0.02}  # [m] from the line along which it pushes
TAKEN, LOST = 0.022, 0.045  # [m] from the middle of a knob: it closes its hand; it has it no more
SQUEEZE = 30.0  # [N] on a knob from which on it turns at full speed
GAIN = 3.0  # [1/s]
FAST, SLOW = 0.20, 0.10  # [m/s] on the way, and in contact
TURNING = 0.5  # [rad/s] of a knob
# On the way through:
LETTING_GO, BACKING = 0.7, 0.8  # [s]
BEHIND = 0.046  # [m] from the axis of the hinges to the near face of a leaf
AJAR = {"lever": 0.06, "knob": 0.2}  # [rad] that a leaf is open when the hand lets go of its handle
PRESS = 0.09  # [m] that the hand is ahead of a leaf that it pushes
OPENED = 1.48  # [rad] that a leaf is open when the hand leaves it
ALONG, ABOVE = 0.60, 0.14  # [m] from the hinges to where it is pushed, and above the handle
ARM_LENGTH = 0.62  # [m] from the robot's base to the hand while it pushes
PANEL = 0.84  # [m] that a panel is open for the chair
TUCKED = (0.55, -0.1, 0.45)  # [m] of the hand from the base: along the chair, to its left, up
WITHIN = 0.2  # [m] aside from there that the hand may be while the chair goes on
CRUISE = 0.6  # share of the speed of the chair, so that the hand can go along
STEER, HEADING_GAIN, STEEPEST = 1.5, 2.5, 0.3  # [rad/m], [1/s], [rad]


@register_policy("ambulating", "robot", "scripted")
class ScriptedAmbulating(ToolScript[Ambulating]):
    """Goes beside the handle and pushes it, or round a knob and turns it."""

    KIND = Ambulating
    _lane: float | None

    def __init__(self, env: CareEnv, role: str) -> None:
        """Take the environment and the robot's role.

        Raises:
            ConfigError: If the task is not ambulating, or the robot has another control mode, or no
                gripper that moves for a knob.
        """
        super().__init__(env, role)
        task = self._task
        self._has_gripper = any("gripper" in name for name in task.robot.action_names)
        if task.hardware == "knob" and not self._has_gripper:
            raise ConfigError("the scripted opener of doors needs a gripper to turn a knob")
        self._is_knob, self._is_hinged = task.hardware == "knob", task.hardware != "slider"
        self._size = task.door.size
        self._through = task.way
        self._turn_speed = task.way.chair.drive.turn if task.way is not None else 1.0

    def _begin(self) -> None:
        self._holds = self._pushes = False  # it has a knob in hand, or pushes
        self._wait = 0.0  # [s] since it let go
        self._phase = 0  # 1: it lets go of the handle, 2: it swings the leaf, 3: it drives on
        self._shy, self._lane = SHY, None
        self._farthest = self._idle = 0.0

    def act(self) -> Array:
        pose = self._robot.tool_pose()
        tool, way = np.array(pose.position), self._task.state.way
        if way is not None and self._is_past_handle():
            goal, most = self._lead(tool, way)
        else:
            goal, most = self._at_handle(tool)
        wished = GAIN * (goal - tool)
        if way is not None and self._phase == 3:  # where it goes comes along with the chair
            wished += self._chair_velocity(way)
        share = self._turns()
        turn = (1 - share) * turning(self._task.facing, pose.quaternion)
        turn = turn + (0.0, share * TURNING, 0.0)
        action = self._robot.tool_action(limited(wished, most), turn)
        if self._has_gripper:
            is_open = self._is_knob and (not self._holds or self._phase > 0)
            action = np.append(action, -1.0 if is_open else 1.0)
        return action if way is None else np.append(action, self._steer(way))

    def memory(self) -> tuple[Sequence[object], Array]:
        times = (self._idle / PATIENCE, self._shy / SHY)
        return (self._holds,), np.clip(times, -1.0, 1.0)

    def _turns(self) -> float:
        """Return how much of its speed the hand turns a knob with now: as it is squeezed."""
        if not self._is_knob or self._phase > 0 or not self._holds:
            return 0.0
        if self._through is not None and not self._task.state.is_latched:
            return 0.0
        return min(self._task.state.push / SQUEEZE, 1.0)

    def _at_handle(self, tool: Array) -> tuple[Array, float]:
        """Return where the tool goes to free the door."""
        goal, most = self._knob(tool) if self._is_knob else self._push(tool)
        if self._through is not None and self._is_hinged and not self._task.state.is_latched:
            goal = goal + (0.0, PRESS, 0.0)
        return goal, most

    def _is_past_handle(self) -> bool:
        """Return whether the handle is done with and the chair is on its way through."""
        opening = self._task.state.opening
        if self._phase == 0 and opening > AJAR.get(self._task.hardware, PANEL):
            self._phase, self._wait = (1, 0.0) if self._is_hinged else (3, 0.0)
        if self._phase > 0 and self._task.state.is_latched:  # it fell shut: once more
            self._wait, self._phase = 0.0, 0
        return self._phase > 0

    def _lead(self, tool: Array, way: WayState) -> tuple[Array, float]:
        """Return where the tool goes to swing the leaf ahead of the chair, and then before it."""
        angle, size = self._task.state.opening, self._size
        if self._phase == 1:  # let go
            self._wait += self._task.control_dt
            if self._wait < (LETTING_GO if self._is_knob else 0.0):
                return tool, SLOW
            if self._wait < LETTING_GO + BACKING:
                out = (0.0, -OUT, 0.0) if self._is_knob else (0.0, -0.03, OUT)
                return tool + out, SLOW
            self._phase = 2
        if self._phase == 2 and angle > OPENED:
            self._phase = 3
        if self._phase == 2:
            along = np.array((-size.side * math.cos(angle), math.sin(angle), 0.0))
            ahead = np.array((size.side * math.sin(angle), math.cos(angle), 0.0))
            height = size.handle[1] + ABOVE
            at = np.array((*size.pivot, height)) + ALONG * along
            return at + (PRESS - BEHIND) * ahead, FAST
        return self._tucked(way), ToolDelta.SPEED

    def _tucked(self, way: WayState) -> Array:
        """Return where the hand is on the way through [m], shape [3]: before the chair."""
        base, heading = self._robot.body.base_pose().position, way.place[2]
        forward, left, up = TUCKED
        x = base[0] - forward * math.sin(heading) - left * math.cos(heading)
        y = base[1] + forward * math.cos(heading) - left * math.sin(heading)
        return np.array((x, y, base[2] + up))

    def _chair_velocity(self, way: WayState) -> Array:
        """Return how fast the chair goes [m/s], shape [3]."""
        assert self._through is not None
        heading, forward = way.place[2], self._through.chair.base.velocity()[0]
        return forward * np.array((-math.sin(heading), math.cos(heading), 0.0))

    def _steer(self, way: WayState) -> Array:
        """Return forward and turning speed of the chair, as shares of the greatest."""
        x, _, heading = way.place
        if self._lane is None:
            self._lane = float(x)
        wished = min(max(STEER * (x - self._lane), -STEEPEST), STEEPEST)
        turn = HEADING_GAIN * (wished - heading) / self._turn_speed
        return np.clip((self._forward(way), turn), -1.0, 1.0)

    def _forward(self, way: WayState) -> float:
        """Return how fast to go on, as a share of the greatest speed."""
        tool, base = self._robot.tool_pose().position, self._robot.body.base_pose().position
        if self._phase == 3:
            return CRUISE if abs(tool[0] - self._tucked(way)[0]) < WITHIN else 0.0
        if self._phase == 2:  # as far behind the leaf as the arm is long
            return max(3.0 * (math.dist(tool[:2], base[:2]) - ARM_LENGTH) / 0.3, -0.2)
        if not self._is_hinged and self._phase == 0 and self._task.state.opening > 0.4:
            return 0.3
        return 0.0

    def _push(self, tool: Array) -> tuple[Array, float]:
        """Return where the tool goes to push a lever down, or a panel aside by its bar."""
        at, beside = self._task.state.handle, np.array((0.0, 0.0, 1.0))
        if self._task.hardware == "slider":
            beside = np.array((-self._task.approach.slides_along, 0.0, 0.0))
            # Where the wall is beside the bar no longer, there is room for the whole finger.
            at = at - (0.0, 0.0 if self._task.state.opening > DEEPER else self._shy, 0.0)
        off = tool - at
        along = float(off @ beside)
        aside = off - along * beside
        has_passed, self._pushes = self._pushes and along < -PAST, False
        if has_passed and self._task.state.opening < MISSED:  # its fingers end before the bar
            self._shy = max(self._shy - BOLDER, 0.0)
        if (
            along > -PAST
            and np.linalg.norm(aside) < BESIDE[self._task.hardware]
            and not self._is_stuck()
        ):
            self._pushes = True
            return at + max(-LEAD, along - SLOW / GAIN) * beside, SLOW
        # First before the place beside it, then in.
        out = max(OFF - along, float(np.linalg.norm(aside * (1.0, 0.0, 1.0)))) / NEAR - 1.0
        if out >= 1.0:
            self._idle = 0.0
        return at + OFF * beside - (0.0, OUT * min(max(out, 0.0), 1.0), 0.0), FAST

    def _is_stuck(self) -> bool:
        """Return whether a panel did not move for long; the hand then comes anew."""
        if self._task.hardware != "slider":
            return False
        self._idle += self._task.control_dt
        if self._task.state.opening > self._farthest + MISSED:
            self._farthest, self._idle = self._task.state.opening, 0.0
        return self._idle > PATIENCE

    def _knob(self, tool: Array) -> tuple[Array, float]:
        """Return where the tool goes to hold a knob: before it, in, and in again where it slipped off."""
        off = tool - self._task.state.handle - (0.0, DEEP, 0.0)
        self._holds = float(np.linalg.norm(off)) < (LOST if self._holds else TAKEN)
        if self._holds:
            return tool - off, SLOW
        out = math.hypot(off[0], off[2]) / NEAR - 1.0
        return tool - off - (0.0, OUT * min(max(out, 0.0), 1.0), 0.0), FAST
