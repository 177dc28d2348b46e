"""A hand-written robot that brushes teeth: wait before the mouth, go in by the cheek, press softly, stroke.

It presses by what the brush feels, and comes out again for each quadrant, and from who does not want it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.dental_arch import QUADRANTS
from rcare_marl.envs.scenes.meal import OPEN_MOUTH, TAKEN_AWAY
from rcare_marl.envs.tasks.tooth_brushing import BEFORE, CLEAR, ToothBrushing
from rcare_marl.pose import Array

from .offering import Offering
from .tool_script import ToolScript, limited, turning, unit

# All our own choices.
PRESS, TOUCH = 1.3, 0.1  # [N] that it presses with, and that count as contact
REACHED, LEVEL = 0.012, 0.15  # [m], [rad] from a place on its way
STROKE, RATE = 0.007, 0.8  # [m] each way, [1/s] of its strokes
GAIN, TURN_GAIN = 3.0, 2.5  # [1/s]
YIELD = 0.014  # [m/s] into the teeth for each newton that is lacking
FAST, AWAY, SLOW = 0.15, 0.25, 0.06  # [m/s] before the face, off, within the mouth
ASK, FURTHER = (
    0.20,
    0.03,
)  # [m] from the lips for who just said no; beyond where it counts as taken away
OUT = 0.03  # [m] further than where it waits, towards which it comes out
MISSED = 0.03  # [m] before its place at the teeth, where a brush is in the mouth that has met it
DEEP, MOST = 0.01, 2.4  # [m] into the teeth, [N]: then it is not they that it feels
OUT_GAIN, FOLLOW, GIVE = (
    8.0,
    0.3,
    0.02,
)  # [1/s], [m/s] with the head, [m/s] for each newton on its way out
ASTRAY = 0.01  # [m] beside the line of the brush, where it goes in no further
SINK, ALONG = 0.02, 0.08  # [m/s] onto the teeth, along them


@register_policy("tooth_brushing", "robot", "scripted")
class ScriptedToothBrushing(ToolScript[ToothBrushing]):
    """Brushes quadrant after quadrant with 1.3 N; sees everything."""

    KIND = ToothBrushing

    def _begin(self) -> None:
        self._offering, self._quadrant, self._since = Offering(), 0, 0.0
        self._phase = 0.0  # of its strokes [rad]
        self._is_in = self._is_down = False
        self._mouth: Array | None = None
        self._places: Array = np.zeros((0, 3))
        self._face = np.array((1.0, 0.0, 0.0))

    def act(self) -> Array:
        task, seen = self._task, self._task.state
        offers = self._offering.goes_on(seen.refusal, seen.time)
        left = np.flatnonzero(~np.asarray(task.is_clean(seen.brushed)))
        if self._mouth is None or (offers and not seen.refusal.turned):  # nobody is chased
            self._mouth, self._face = seen.mouth, seen.face
        if not seen.is_inside and len(left):
            self._quadrant = int(left[0])
        place, outward, into = task.aim(self._quadrant)
        moved = place - self._places[self._quadrant] if len(self._places) else np.zeros(3)
        self._places = seen.targets
        turn = turning(task.brush_quaternion(into), seen.turn, TURN_GAIN)
        clear = place + CLEAR * outward - seen.bristles
        before = clear - BEFORE * into
        goes_on = offers and not seen.refusal.is_no
        goes_in = goes_on and seen.jaw >= OPEN_MOUTH and self._quadrant in left
        if not goes_in:
            self._is_in = self._is_down = False
            if seen.is_inside and goes_on:  # out as it came in
                linear = self._along(before - OUT * into, into, AWAY)
                return self._about(seen.bristles, linear, turn)
            if seen.is_inside:  # straight out, going along with a head that turns, and yielding
                linear = limited(moved / task.control_dt, FOLLOW) + limited(GIVE * seen.push, AWAY)
                return self._about(seen.bristles, linear - AWAY * seen.axis, 0.0 * turn)
            if not goes_on:
                ahead = unit(self._face * (1.0, 1.0, 0.0))
                turn = turning(task.brush_quaternion(-ahead), seen.turn, TURN_GAIN)
                before = self._mouth + (TAKEN_AWAY + FURTHER) * ahead - seen.bristles
            if offers and seen.refusal.is_no:
                before = seen.mouth + ASK * unit(seen.bristles - seen.mouth) - seen.bristles
            return self._about(seen.bristles, limited(GAIN * before, FAST), turn)
        is_level = np.linalg.norm(turn) < LEVEL * TURN_GAIN
        self._is_in |= bool(is_level and np.linalg.norm(before) < REACHED)
        misses = not seen.is_inside and float(before @ into) < -(BEFORE - MISSED)
        if misses:  # beside the lips
            self._is_in = self._is_down = False
        if not self._is_in:
            return self._about(seen.bristles, limited(GAIN * before, FAST), turn)
        if not self._is_down and np.linalg.norm(clear) < CLEAR:
            self._is_down, self._since = True, seen.time
        if not self._is_down:
            return self._about(seen.bristles, self._along(clear, into, SLOW), turn)
        return self._about(seen.bristles, self._stroke(place, outward, into), turn)

    def memory(self) -> tuple[Sequence[object], Array]:
        quadrants = (self._quadrant == k for k in range(len(QUADRANTS)))
        stroke = np.array((math.sin(self._phase), math.cos(self._phase)))
        return (self._offering.is_on, self._is_in, self._is_down, *quadrants), stroke

    def _along(self, way: Array, into: Array, most: float) -> Array:
        """Return the velocity along a way [m/s], first to the line of the brush, then along that."""
        ahead = float(way @ into)
        aside = way - ahead * into
        share = max(0.0, 1.0 - float(np.linalg.norm(aside)) / ASTRAY) if ahead > 0 else 1.0
        return limited(GAIN * aside, most) + limited(GAIN * share * ahead * into, most)

    def _stroke(self, place: Array, outward: Array, into: Array) -> Array:
        """Return the velocity of a stroke to and fro along the brush [m/s]."""
        seen = self._task.state
        along = into - (into @ outward) * outward
        along = along / np.linalg.norm(along)
        phase = self._phase = 2 * math.pi * RATE * (seen.time - self._since)
        goal = place + STROKE * math.sin(phase) * along - seen.bristles
        linear = GAIN * (goal - (goal @ outward) * outward)
        linear = linear + 2 * math.pi * RATE * STROKE * math.cos(phase) * along
        press = float(seen.cleaning[self._quadrant])
        is_beyond = float((seen.bristles - place) @ outward) < -DEEP
        inward = YIELD * (PRESS - press) if press > TOUCH else SINK
        if seen.press > MOST or (press <= TOUCH and is_beyond):  # something else is in the way
            inward = -SINK
        return limited(linear, ALONG) - float(np.clip(inward, -SINK, SINK)) * outward
