"""A hand-written robot that scratches: come over the itch, press softly, go to and fro over it.

It presses by what the tool feels, and lifts at once from who does not want it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.tasks.scratching import TAKEN_AWAY, Scratching
from rcare_marl.pose import Array

from .offering import Offering
from .tool_script import Beat, ToolScript, limited, unit

# All our own choices.
TOUCH = 0.2  # [N] that count as contact
HOVER = 0.03  # [m] over the skin, while it is not over the itch
REACHED = 0.012  # [m] along the skin that it may be off to press; as far again it hovers
LEVEL = 0.3  # [rad] that the tool may be turned otherwise to press
UNDER = 0.01  # [m] under the skin, where it goes until it feels it
GAIN, TURN_GAIN = 2.5, 2.0  # [1/s]
YIELD = 0.008  # [m/s] into the skin for each newton that is lacking
FAST, AWAY, ALONG = 0.15, 0.25, 0.1  # [m/s]: in the air, off, along the skin


@register_policy("scratching", "robot", "scripted")
class ScriptedScratching(ToolScript[Scratching]):
    """Comes over where it itches, presses until it feels 1.5 N, and strokes; sees everything but the itch.

    Attributes:
        PRESS: What it presses with [N].
        SINK: Onto the skin, and off it, while it feels it [m/s].
        STROKING: Of its strokes [m/s].
    """

    KIND = Scratching
    PRESS, SINK, STROKING = 1.5, 0.03, 0.06

    def _begin(self) -> None:
        self._offering, self._beat = Offering(), Beat()

    def act(self) -> Array:
        seen = self._task.state
        out, off = seen.out, seen.tip - seen.said
        turn, way = TURN_GAIN * seen.to_turn, self._beat.next()
        if not self._offering.goes_on(seen.refusal, seen.time):
            away = (TAKEN_AWAY + 0.015) * out - off
            return self._about(seen.tip, limited(4 * GAIN * away, AWAY), turn)
        height = float(off @ out)
        aside = off - height * out
        over = min(max(2.0 - float(np.linalg.norm(aside)) / REACHED, 0.0), 1.0)
        if np.linalg.norm(seen.to_turn) > LEVEL:
            over = 0.0
        goal = over * -UNDER + (1 - over) * HOVER
        rise = GAIN * (goal - height)
        if height < HOVER:
            rise = max(rise, -self.SINK)
        if over > 0 and seen.press > TOUCH:
            rise = float(np.clip(YIELD * (seen.press - self.PRESS), -self.SINK, self.SINK))
        along = limited(-GAIN * aside, FAST)
        if over > 0 and height < HOVER / 2:
            first = unit(np.cross(out, (0.0, 1.0, 0.0)))
            along = limited(way * self.STROKING * first - GAIN * aside, ALONG)
        return self._about(seen.tip, limited(along + rise * out, FAST), turn)

    def memory(self) -> tuple[Sequence[object], Array]:
        return (self._offering.is_on, *self._beat.flags), np.zeros(0)

    def recall(self, holds: Sequence[bool]) -> None:
        self._beat.flags = (holds[1], holds[2], holds[3])


@register_policy("scratching", "robot", "gentle")
class GentleScratching(ScriptedScratching):
    """As `scripted`, but lands more slowly and strokes at half the speed: skin that curves pushes back less.

    `learned` imitates it, see docs/scratching.md; the values are our own choice.
    """

    PRESS, SINK, STROKING = 1.3, 0.02, 0.03
