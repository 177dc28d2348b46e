"""A hand-written robot for the bathing challenge: take the sponge, dip it, wash what it reaches, gently.

It shows what the scoring gives a robot with perfect perception, presses by what the sponge feels, and
needs a gripper that moves.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rcare_marl.contact import Contact
from rcare_marl.envs.phyrc.bath_scene import FACE_DOWN
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.wiped_skin import WipedSkin
from rcare_marl.envs.tasks.phyrc_bathing import PhyrcBathing
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose

from .tool_script import ToolScript, limited, turning, unit

# All our own choices.
PRESS = 3.5  # [N], in the middle of the 1 to 6 N that score
PEAK = 0.5  # of the greatest force in a control step that counts like the mean
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
STEEP = 0.7  # rise of the skin, from where on a level sponge does not lie on it
CHEST = 0.38  # of the way along an upper arm, before which a sponge would touch the chest
# Limb, and angles about it at which a stroke is made: the sponge is as broad as an arm.
STROKES = (
    ("left_elbow", (0.0,)),
    ("left_shoulder", (0.0,)),
    ("left_hip", (0.5, -0.5, 0.0)),
    ("right_hip", (-0.5, 0.0, 0.5)),
    ("left_knee", (0.0,)),
)
TIMES, MORE = 2, 8  # strokes in each place, there and back: first over all, then again for longer
SLOWER = 0.025  # [m] over the skin, from where it sinks slowly
TRIES = 3  # rounds over all that is near, where one is in the way of the other
LEAST_SHARES = 3  # of `SHARES` that a stroke is worth
LOST = 0.06  # [m] over the skin, where a stroke is given up
KEEP = 0.012  # [m] that plate, handle and robot keep from the person: only foam touches
SIGHT = KEEP + FAST / GAIN  # [m], from where they slow down
PATIENCE = 10.0  # [s] to come to where a stroke begins, before it is left out
STUCK = 0.3  # of the speed that it wanted, below which something is in the way


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
        self._near = self._see_near()
        if self._phase in ("travel", "press", "wipe", "lift"):
            linear = self._wash()
        else:
            linear = self._spared(self._fetch())
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

    def _see_near(self) -> list[Contact]:
        """Return where something hard is near the person."""
        task, world = self._task, self._task.world
        hard = [self._robot.body, *([task.scene.sponge.body] if task.state.is_held else [])]
        person = task.recipient.body
        return [near for body in hard for near in world.nearest(body, person, within=SIGHT)]

    def _spared(self, velocity: Array) -> Array:
        """Return a velocity [m/s], shape [3], with which nothing hard comes to the person."""
        for near in self._near * TRIES:
            normal = np.array(near.normal)
            least = GAIN * (KEEP - near.distance)
            velocity = velocity + max(least - velocity @ normal, 0.0) * normal
        return limited(velocity, FAST)

    # ---- wash

    def _wash(self) -> Array:
        """Return the velocity of the face [m/s], shape [3], on and over the skin."""
        task = self._task
        if self._phase in ("travel", "press") and task.state.time > self._began + PATIENCE:
            self._next_stroke()
        stroke, face = self._stroke, task.state.face
        assert stroke is not None  # a phase of washing has one
        skin = task.limbs.limbs[stroke.limb]
        if self._phase == "travel":
            goal = skin.place(stroke.start, stroke.angle)[0] + (0.0, 0.0, HOVER)
            flat = goal - face
            is_above = np.linalg.norm(flat[:2]) < 2 * NEAR
            if not is_above:  # first above, then down
                flat[2] = max(flat[2], 0.0)
            wanted = limited(GAIN * flat, FAST)
            out = self._spared(wanted)
            is_stuck = bool(out @ unit(wanted) < STUCK * np.linalg.norm(wanted))
            if np.linalg.norm(flat) < 2 * NEAR or (is_above and is_stuck):
                self._phase = "press"
            elif is_stuck:  # over what is in the way
                out = self._spared(wanted + (0.0, 0.0, FAST))
            return out
        share = min(max(skin.progress(face), 0.0), 1.0)
        top = skin.place(share, stroke.angle)[0]
        sign = float(np.sign(stroke.end - stroke.start))
        way = skin.direction() * sign
        # Somebody may shake: what counts is the mean of a control step, or so much of its peak.
        force = max(task.state.push, PEAK * float(task.state.force))
        height = float(face[2] - top[2])
        if self._phase == "lift":
            if height > HOVER:
                self._next_stroke()
            return self._spared(np.array((0.0, 0.0, FAST)))
        if self._phase == "press" and force > 0.5 * PRESS:
            self._phase = "wipe"
        is_over = (share - stroke.end) * sign > 0
        if is_over or (self._phase == "wipe" and height > LOST):
            self._next_stroke(on_skin=True)
        into = YIELD * (PRESS - force)
        if force <= TOUCH:
            into = SINK + GAIN * max(height - SLOWER, 0.0)
        along = np.zeros(3)
        if self._phase == "wipe":  # slower where it does not press as it should
            eager = 1.0 - (abs(force - PRESS) - SPARE) / SPARE
            speed = WIPE * float(np.clip(eager, SLOWEST, 1.0))
            along = speed * sign * _slope(skin, share, stroke.angle)
        across = np.cross((0.0, 0.0, 1.0), way)
        aside = float((top - face) @ across)
        out = along + limited(GAIN * aside * across, WIPE)
        out[2] -= float(np.clip(into, -SINK, 2 * SINK))
        spared = self._spared(out)
        if self._phase == "wipe" and spared @ way < STUCK * (out @ way):
            self._next_stroke(on_skin=True)
        elif self._phase == "press" and force <= TOUCH and spared[2] > STUCK * out[2]:
            spared = self._spared(out + WIPE * way)  # down where nothing is in the way
        return spared

    def _next_stroke(self, *, on_skin: bool = False) -> None:
        """Choose what to wash next; the way back on the same line needs no lifting."""
        before, self._began = self._stroke, self._task.state.time
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
        strokes = self._reached(STEEP) or self._reached(1.0)
        if not strokes:
            raise ConfigError("the scripted washer reaches no limb of the person")
        for times in itertools.chain((TIMES,), itertools.repeat(MORE)):
            for stroke in strokes:
                for k in range(times):
                    ends = (stroke.start, stroke.end)
                    start, end = ends if k % 2 == 0 else ends[::-1]
                    yield Stroke(stroke.limb, stroke.angle, start, end)

    def _reached(self, steep: float) -> list[Stroke]:
        """Return the strokes over all that the robot reaches where the skin rises less than `steep`."""
        found = []
        for limb, angles in STROKES:
            for angle in angles:
                run = self._reachable(limb, angle, steep)
                if len(run) >= LEAST_SHARES:
                    found.append(Stroke(limb, angle, run[0], run[-1]))
        return found

    def _reachable(self, limb: str, angle: float, steep: float) -> list[float]:
        """Return the longest run of shares of a limb that the sponge can come to, and lies on."""
        task, skin = self._task, self._task.limbs.limbs[limb]
        edge = task.scene.edge() + BESIDE_TABLE
        best: list[float] = []
        run: list[float] = []
        shares = [s for s in SHARES.tolist() if s > CHEST or "shoulder" not in limb]
        for share in shares:
            point, rise = skin.place(share, angle)[0], _slope(skin, share, angle)[2]
            found = self._robot.solve_ik(task.tool_for(task.scene.over(point)))
            is_fit = point[0] > edge and abs(rise) < steep and found.is_within(0.015, 0.4)
            run = [*run, share] if is_fit else []
            best = max(best, run, key=len)
        return best


def _slope(skin: WipedSkin, share: float, angle: float) -> Array:
    """Return where the skin goes there, away from the body, a unit vector, shape [3]."""
    first, last = (skin.place(share + k * AHEAD, angle)[0] for k in (-0.5, 0.5))
    return unit(last - first)
