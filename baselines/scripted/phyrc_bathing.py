"""A hand-written robot for the bathing challenge: take the sponge, dip it, wash what it reaches, gently.

It shows what the scoring gives a robot with perfect perception, presses by what the sponge feels, and
needs a gripper that moves.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rcare_marl.envs.phyrc.bath_scene import FACE_DOWN
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.wiped_skin import WipedSkin
from rcare_marl.envs.tasks.phyrc_bathing import PhyrcBathing
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose

from .tool_script import ToolScript, limited, turning

# All our own choices.
PRESS = 3.5  # [N], in the middle of the 1 to 6 N that score
TOUCH = 0.3  # [N] that count as contact
YIELD = 0.008  # [m/s] into the skin for each newton that is lacking
SINK, FAST, SLOW, WIPE = (
    0.05,
    0.22,
    0.08,
    0.10,
)  # [m/s] onto skin, through the air, at things, along
GAIN = 3.0  # [1/s]
NEAR, NEARER = 0.02, 0.008  # [m] that count as there: on the way, and at a thing
BEHIND = 0.07  # [m] from the handle, where the hand lines up
UP = 0.145  # [m] that the sponge is lifted over the table: over the rim of the basin
HOVER = 0.10  # [m] over the skin, between two limbs
BESIDE_TABLE = 0.10  # [m] from its edge to the middle of a sponge that washes
SPARE, SLOWEST = 1.0, 0.25  # [N] off that change nothing; share of its speed with which it goes on
AHEAD = 0.15  # of the limb's length, over which it sees how the skin rises
SHARES = np.linspace(0.27, 0.93, 12)  # of the way along a limb
CHEST = 0.38  # of the way along an upper arm, before which a sponge would touch the chest
# Limb, and angles about it at which a stroke is made: the sponge is as broad as an arm.
STROKES = (
    ("left_elbow", (0.0,)),
    ("left_shoulder", (0.0,)),
    ("left_hip", (0.5, -0.5, 0.0)),
    ("right_hip", (-0.5, 0.0, 0.5)),
    ("left_knee", (0.0,)),
    ("right_shoulder", (0.0,)),
    ("right_elbow", (0.0,)),
)
TIMES, MORE = 2, 8  # strokes in each place, there and back: first over all, then again for longer
SLOWER = 0.025  # [m] over the skin, from where it sinks slowly
LEAST_SHARES = 3  # of `SHARES` that a stroke is worth
LOST = 0.06  # [m] over the skin, where a stroke is given up


@dataclass(frozen=True)
class Stroke:
    """A way along a limb.

    Attributes:
        limb: SMPL-X joint that the limb moves with.
        angle: About the limb [rad].
        start: Where it begins, as a share of the limb's length.
        end: Where it ends.
    """

    limb: str
    angle: float
    start: float
    end: float


@register_policy("phyrc_bathing", "robot", "scripted")
class ScriptedPhyrcBathing(ToolScript[PhyrcBathing]):
    """Grasps, lifts, dips and washes limb after limb until the time is over."""

    KIND, WITH_GRIPPER = PhyrcBathing, True

    def _begin(self) -> None:
        self._phase = "line up"
        self._strokes: Iterator[Stroke] | None = None
        self._stroke: Stroke | None = None

    def act(self) -> Array:
        task = self._task
        if not task.state.is_held and self._phase not in ("line up", "reach", "close"):
            self._phase = "line up"  # it was lost
        closing = -1.0 if self._phase in ("line up", "reach") else 1.0
        if self._phase in ("travel", "press", "wipe", "lift"):
            linear = self._wash()
        else:
            linear = self._fetch()
        # Level as it lay; the tool turns about the face, so that turning does not wipe.
        now = self._robot.tool_pose()
        held = (now @ task.hold).quaternion
        turn = turning(FACE_DOWN, held)
        if task.state.is_held:
            linear = linear + np.cross(turn, np.subtract(now.position, task.state.face))
        return np.append(self._robot.tool_action(linear, turn), closing)

    # ---- fetch and wet

    def _fetch(self) -> Array:
        """Return the velocity of the tool [m/s], shape [3], on the way to a wet sponge."""
        task, tool = self._task, np.array(self._robot.tool_pose().position)
        if self._phase == "line up":
            goal = np.array((self._level_tool() @ Pose((0.0, 0.0, -BEHIND))).position)
            if np.linalg.norm(goal - tool) < NEAR:
                self._phase = "reach"
            return self._towards(goal, FAST)
        if self._phase == "reach":
            goal = np.array(self._level_tool().position)
            if np.linalg.norm(goal - tool) < NEARER:
                self._phase = "close"
            return self._towards(goal, SLOW)
        if self._phase == "close":
            if task.state.is_held:
                self._phase = "raise"
            return np.zeros(3)
        over = np.array(task.tool_for(task.scene.dipped()).position)
        height = float(task.scene.sponge.frame("face").position[2])  # of the handle over the face
        safe = task.scene.table.frame("top").position[2] + UP + height
        if self._phase == "raise":
            if task.state.earned >= 1 and tool[2] > safe - NEAR:
                self._phase = "carry"
            return self._towards(np.array((*tool[:2], safe)), FAST)
        over_water = np.array((*over[:2], safe))
        if self._phase == "carry":
            if np.linalg.norm(over_water - tool) < NEAR:
                self._phase = "dip"
            return self._towards(over_water, FAST)
        if self._phase == "dip":
            if task.state.earned >= 2:
                self._phase = "take out"
            return self._towards(over, SLOW)
        if tool[2] > safe - NEAR:
            self._next_stroke()
        return self._towards(over_water, FAST)

    def _level_tool(self) -> Pose:
        """Return where the tool takes the sponge that lies there."""
        return self._task.tool_for(self._task.scene.sponge.pose)

    def _towards(self, goal: Array, most: float) -> Array:
        return limited(GAIN * (goal - self._robot.tool_pose().position), most)

    # ---- wash

    def _wash(self) -> Array:
        """Return the velocity of the face [m/s], shape [3], on and over the skin."""
        stroke, task = self._stroke, self._task
        assert stroke is not None  # a phase of washing has one
        skin, face = task.limbs.limbs[stroke.limb], task.state.face
        if self._phase == "travel":
            goal = skin.place(stroke.start, stroke.angle)[0] + (0.0, 0.0, HOVER)
            flat = goal - face
            if np.linalg.norm(flat[:2]) > 2 * NEAR:  # first above, then down
                flat[2] = max(flat[2], 0.0)
            elif np.linalg.norm(flat) < 2 * NEAR:
                self._phase = "press"
            return limited(GAIN * flat, FAST)
        share = min(max(skin.progress(face), 0.0), 1.0)
        top = skin.place(share, stroke.angle)[0]
        way = skin.direction() * np.sign(stroke.end - stroke.start)
        force, height = task.state.push, float(face[2] - top[2])
        if self._phase == "lift":
            if height > HOVER:
                self._next_stroke()
            return np.array((0.0, 0.0, FAST))
        if self._phase == "press" and force > 0.5 * PRESS:
            self._phase = "wipe"
        if self._phase == "wipe":
            is_over = (share - stroke.end) * np.sign(stroke.end - stroke.start) > 0
            if is_over or height > LOST:
                self._next_stroke(on_skin=True)
        into = YIELD * (PRESS - force)
        if force <= TOUCH:
            into = SINK + GAIN * max(height - SLOWER, 0.0)
        along = np.zeros(3)
        if self._phase == "wipe":  # slower where it does not press as it should
            eager = 1.0 - (abs(force - PRESS) - SPARE) / SPARE
            along = WIPE * float(np.clip(eager, SLOWEST, 1.0)) * _slope(skin, share, stroke)
        across = np.cross((0.0, 0.0, 1.0), way)
        aside = float((top - face) @ across)
        out = along + limited(GAIN * aside * across, WIPE)
        out[2] -= float(np.clip(into, -SINK, 2 * SINK))
        return out

    def _next_stroke(self, *, on_skin: bool = False) -> None:
        """Choose what to wash next; the way back on the same line needs no lifting."""
        before = self._stroke
        if self._strokes is None:
            self._strokes = self._plan()
        self._stroke = next(self._strokes)
        same = before is not None and (before.limb, before.angle) == (
            self._stroke.limb,
            self._stroke.angle,
        )
        if on_skin and same:
            self._phase = "wipe"
        else:
            self._phase = "lift" if on_skin else "travel"

    def _plan(self) -> Iterator[Stroke]:
        """Yield strokes over all that the robot reaches, again and again."""
        strokes = []
        for limb, angles in STROKES:
            for angle in angles:
                shares = self._reachable(limb, angle)
                if len(shares) >= LEAST_SHARES:
                    strokes.append(Stroke(limb, angle, shares[0], shares[-1]))
        if not strokes:
            raise ConfigError("the scripted washer reaches no limb of the person")
        for times in itertools.chain((TIMES,), itertools.repeat(MORE)):
            for stroke in strokes:
                for k in range(times):
                    ends = (stroke.start, stroke.end)
                    start, end = ends if k % 2 == 0 else ends[::-1]
                    yield Stroke(stroke.limb, stroke.angle, start, end)

    def _reachable(self, limb: str, angle: float) -> list[float]:
        """Return the longest run of shares of a limb that the sponge can come to."""
        task, skin = self._task, self._task.limbs.limbs[limb]
        edge = task.scene.edge() + BESIDE_TABLE
        best: list[float] = []
        run: list[float] = []
        shares = [s for s in SHARES.tolist() if s > CHEST or "shoulder" not in limb]
        for share in shares:
            point = skin.place(share, angle)[0]
            found = self._robot.solve_ik(task.tool_for(task.scene.over(point)))
            run = [*run, share] if point[0] > edge and found.is_within(0.015, 0.4) else []
            best = max(best, run, key=len)
        return best


def _slope(skin: WipedSkin, share: float, stroke: Stroke) -> Array:
    """Return where a stroke goes along the skin there, a unit vector, shape [3]."""
    sign = 1.0 if stroke.end > stroke.start else -1.0
    first, last = (skin.place(share + k * AHEAD * sign, stroke.angle)[0] for k in (-0.5, 0.5))
    way = last - first
    return np.asarray(way / np.linalg.norm(way))
