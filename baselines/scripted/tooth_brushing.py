"""A hand-written robot that brushes teeth: wait before the mouth, go in by the cheek, press softly, stroke.

It presses by what the brush feels, and comes out again for each quadrant, and from who does not want it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.meal import OPEN_MOUTH, TAKEN_AWAY
from rcare_marl.envs.tasks.tooth_brushing import BEFORE, CLEAR, ToothBrushing
from rcare_marl.pose import Array

from .offering import Offering
from .tool_script import Beat, ToolScript, limited, unit

# All our own choices.
PRESS, TOUCH = 1.3, 0.1  # [N] that it presses with, and that count as contact
REACHED, LEVEL = 0.018, 0.2  # [m], [rad] from where it waits, before it goes in
ENOUGH = 0.6  # [N] with which it strokes at full speed, less with less
STROKE, STROKING = 0.007, 0.04  # [m] each way at most, [m/s] of its strokes
GAIN, TURN_GAIN, BACK = 3.0, 2.5, 1.5  # [1/s], the last of a stroke to its middle
YIELD = 0.014  # [m/s] into the teeth for each newton that is lacking
FAST, AWAY, SLOW = 0.15, 0.25, 0.06  # [m/s] before the face, off, within the mouth
# [m] from the lips for who just said no; beyond where it counts as taken away
ASK, FURTHER = 0.20, 0.03
# Of the face below where it was at rest, along z, from which its brush would come from the lap; [m] ahead of
# the mouth and above it, where it leads a head that is so bowed: eyes follow what is beyond 15 cm
BOWED, LEAD, ABOVE = 0.14, 0.19, 0.07
# [m] past where it waits: a brush that is not between the lips there has missed them
MISSED = 0.045
# [m] beside its way to the teeth, farther than which a brush in the mouth is at others
BESIDE = 0.04
NEAR = 0.006  # [m] beyond a stroke from its place at the teeth along the brush, where it presses and strokes
LEANT = 3.0  # [N] on its way in, from which it comes out again
DEEP, MOST = 0.01, 2.4  # [m] into the teeth, [N]: then it is not they that it feels
EDGE = 0.004  # [m] above or below its place, from which it keeps off the teeth until it is level with it
FOLLOW, GIVE = 0.3, 0.02  # [m/s] with the head, and for each newton on its way out
# [m] beside the line of the brush: goes in at its full speed, no further
STRAIGHT, ASTRAY = 0.01, 0.02
SINK, ALONG = 0.02, 0.08  # [m/s] onto the teeth, along them


@register_policy("tooth_brushing", "robot", "scripted")
class ScriptedToothBrushing(ToolScript[ToothBrushing]):
    """Brushes quadrant after quadrant with 1.3 N; sees everything."""

    KIND = ToothBrushing

    def _begin(self) -> None:
        self._offering, self._beat = Offering(), Beat()
        self._mouth: Array | None = None
        self._place: Array | None = None
        self._quadrant = -1
        self._face = np.array((1.0, 0.0, 0.0))

    def act(self) -> Array:
        task, seen = self._task, self._task.state
        offers = self._offering.goes_on(seen.refusal, seen.time)
        self._way = self._beat.next()
        left = np.flatnonzero(~np.asarray(task.is_clean(seen.brushed)))
        if self._mouth is None or (offers and not seen.refusal.turned):  # nobody is chased
            self._mouth, self._face = seen.mouth, seen.face
        quadrant = int(left[0]) if len(left) else self._quadrant
        place, outward, into = task.aim(quadrant)
        moved = place - (place if self._place is None else self._place)
        if quadrant != self._quadrant:  # out, and in again
            self._quadrant, moved = quadrant, np.zeros(3)
        self._place = place
        goes_on = offers and not seen.refusal.is_no
        goes_in = goes_on and seen.jaw >= OPEN_MOUTH and len(left) > 0
        before = place + CLEAR * outward - BEFORE * into - seen.bristles
        turn = TURN_GAIN * seen.to_turn
        is_deep = seen.is_inside or float(before @ into) < -MISSED  # in the mouth, or beside it
        if goes_on and seen.bowed > BOWED and not is_deep:  # eyes and head follow the brush up
            ahead = unit(seen.face * (1.0, 1.0, 0.0))
            before = seen.mouth + LEAD * ahead + (0.0, 0.0, ABOVE) - seen.bristles
            return self._about(seen.bristles, limited(GAIN * before, FAST), 0.0 * turn)
        if goes_in and self._may_go_in(before, into):
            return self._about(seen.bristles, self._brush(place, outward, into), turn)
        if is_deep:  # straight out, going along with a head that turns, and yielding
            linear = limited(moved / task.control_dt, FOLLOW) + limited(GIVE * seen.push, AWAY)
            return self._about(seen.bristles, linear - AWAY * seen.axis, 0.0 * turn)
        if not goes_on:
            ahead = unit(self._face * (1.0, 1.0, 0.0))
            turn = 0.0 * turn
            before = self._mouth + (TAKEN_AWAY + FURTHER) * ahead - seen.bristles
        if offers and seen.refusal.is_no:
            before = seen.mouth + ASK * unit(seen.bristles - seen.mouth) - seen.bristles
        return self._about(seen.bristles, limited(GAIN * before, FAST), turn)

    def memory(self) -> tuple[Sequence[object], Array]:
        return (self._offering.is_on, *self._beat.flags), np.zeros(0)

    def recall(self, holds: Sequence[bool]) -> None:
        self._beat.flags = (holds[1], holds[2], holds[3])

    def _may_go_in(self, before: Array, into: Array) -> bool:
        """Return whether the brush is on its way to these teeth, from the way to where it waits [m].

        It is turned for them, no deeper than they are, and beside its line by no more than what the lips
        leave. That is seen, and nothing has to be kept in mind: of a memory that is wrong now and then a
        network that imitates it stays between lips and teeth.
        """
        seen = self._task.state
        ahead = float(before @ into)  # to where it waits; negative beyond it
        beside = float(np.linalg.norm(before - ahead * into))
        if np.linalg.norm(seen.to_turn) > LEVEL or ahead > REACHED:
            return False
        if ahead < -MISSED and not seen.is_inside:
            return False
        if seen.press > LEANT and not self._is_at_teeth():  # on a lip
            return False
        return beside < (BESIDE if seen.is_inside else REACHED)

    def _is_at_teeth(self) -> bool:
        """Return whether it is beside its teeth, in reach of a stroke along the brush."""
        seen = self._task.state
        place, _, into = self._task.aim(self._quadrant)
        return seen.is_inside and abs(float((seen.bristles - place) @ into)) < STROKE + NEAR

    def _brush(self, place: Array, outward: Array, into: Array) -> Array:
        """Return the velocity of the bristles [m/s]: into the mouth along the brush, then onto the teeth."""
        off = self._task.state.bristles - place
        if self._is_at_teeth():
            return self._stroke(off, outward, into)
        way = CLEAR * outward - off
        ahead = float(way @ into)
        aside = way - ahead * into
        astray = (float(np.linalg.norm(aside)) - STRAIGHT) / (ASTRAY - STRAIGHT)
        share = 1.0 - float(np.clip(astray, 0.0, 1.0)) if ahead > 0 else 1.0
        return limited(GAIN * aside, SLOW) + limited(GAIN * share * ahead * into, SLOW)

    def _stroke(self, off: Array, outward: Array, into: Array) -> Array:
        """Return the velocity to and fro along the brush [m/s], from where the bristles are beside [m]."""
        seen = self._task.state
        along = unit(into - (into @ outward) * outward)
        at = float(off @ along)
        aside = off - at * along
        press = float(seen.cleaning[self._quadrant])
        to_and_fro = self._way * STROKING * min(press / ENOUGH, 1.0)  # once it presses
        linear = (to_and_fro - BACK * at) * along
        linear = linear - GAIN * (aside - (aside @ outward) * outward)
        is_beyond = float(off @ outward) < -DEEP
        level = float(np.linalg.norm(aside - (aside @ outward) * outward))
        inward = YIELD * (PRESS - press) if press > TOUCH else SINK
        if press <= TOUCH and level > EDGE:  # or it comes to lie under the edge of the teeth
            inward = GAIN * (float(off @ outward) - CLEAR)
        if seen.press > MOST or (press <= TOUCH and is_beyond):  # something else is in the way
            inward = -SINK
        return limited(linear, ALONG) - float(np.clip(inward, -SINK, SINK)) * outward
