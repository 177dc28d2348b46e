"""A hand-written robot that bathes: come over the shoulder, press softly, wipe to the elbow, lift.

It presses by what the sponge feels, and lifts at once from who does not want it. What it does next it tells
by where the sponge is and what it feels; it keeps in mind only whether it offers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.tasks.bathing import START_ANGLE, START_SHARE, TAKEN_AWAY, Bathing
from rcare_marl.pose import Array

from .offering import Offering
from .tool_script import ToolScript, limited, turning

# All our own choices.
HOVER, CLEAR = 0.03, 0.024  # [m] over the skin, before it presses, and from where it goes back
NEAR = 0.02  # [m] from a place, and
LEVEL = 0.3  # [rad], that counts as there: some hands cannot lay it flat
GAIN, TURN_GAIN = 2.5, 2.5  # [1/s]
YIELD = 0.006  # [m/s] into the skin for each newton that is lacking
FAST, WIPE = 0.20, 0.06  # [m/s] through the air, along the skin
BEYOND = 0.01  # [m] past the target, before another pass is made
TOUCH = 0.5  # [N] that count as contact
# [m] from the trunk, from where it wipes farther outside, and by how much at most [rad].
BESIDE, MOST_ROUND = 0.01, 0.5
# [N] aside from which the sponge gives way, for how many more the faster; [m/s] for each.
FREE, SQUEEZED, GIVE = 1.5, 2.0, 0.015
LOW = 0.01  # [m] over the skin, where it goes on with what it began


@register_policy("bathing", "robot", "scripted")
class ScriptedBathing(ToolScript[Bathing]):
    """Comes over the shoulder, presses until it feels 4 N, wipes to the target, and lifts.

    Attributes:
        PRESS: What it presses with [N], within PhyRC's 1 to 6 N of comfort, and gentle to who then says no.
        ENOUGH: With what it wipes at full speed, and slower with less [N].
        SINK: Onto the skin, and off it while it feels it [m/s].
    """

    KIND = Bathing
    PRESS, ENOUGH, SINK = 4.0, 2.4, 0.04

    def _begin(self) -> None:
        self._offering = Offering()

    def act(self) -> Array:
        task, skin, seen = self._task, self._task.skin, self._task.state
        face = seen.face
        share = skin.progress(face)
        end, angle = task.target_on_arm()
        done = min(max((share - START_SHARE) / (end - START_SHARE), 0.0), 1.0)
        top, out = skin.place(
            START_SHARE + done * (end - START_SHARE),
            START_ANGLE + done * (angle - START_ANGLE) - self._round(),
        )
        way = skin.direction()
        turn = turning(task.wiping_quaternion(out, way), seen.turn, 1.0)
        start = skin.place(START_SHARE, START_ANGLE)[0]
        height, force = float((face - top) @ out), float(-seen.push @ out)
        ahead = float((seen.target - face) @ way)
        to_start = start - face
        is_over = np.linalg.norm(to_start - (to_start @ out) * out) < NEAR
        is_over &= np.linalg.norm(turn) < LEVEL
        if not self._offering.goes_on(seen.refusal, seen.time):
            linear = limited(GAIN * (TAKEN_AWAY + HOVER - height) * out, FAST)
        elif ahead < -BEYOND and height < CLEAR:
            linear = limited(GAIN * (HOVER - height) * out, FAST)
        elif ahead > -BEYOND and (is_over or height < LOW):
            side = np.cross(out, way)
            across = self._across(GAIN * float((top - face) @ side), float(-seen.push @ side))
            into = YIELD * (self.PRESS - force) if force > TOUCH else self.SINK
            along = WIPE * min(max((force - TOUCH) / (self.ENOUGH - TOUCH), 0.0), 1.0)
            linear = along * way + across * side
            linear = linear - float(np.clip(into, -self.SINK, self.SINK)) * out
        else:
            linear = limited(GAIN * (to_start + HOVER * out), FAST)
        return self._about(face, linear, TURN_GAIN * turn)  # so that turning does not wipe

    def _round(self) -> float:
        """Return how much farther round the arm it wipes [rad], where the trunk is near."""
        return MOST_ROUND * min(max(1.0 - self._task.state.trunk_gap / BESIDE, 0.0), 1.0)

    def _across(self, speed: float, push: float) -> float:
        """Return how fast it goes across its way [m/s], from what it wishes and what the sponge feels [N]."""
        return speed

    def memory(self) -> tuple[Sequence[object], Array]:
        return (self._offering.is_on,), np.zeros(0)


@register_policy("bathing", "robot", "gentle")
class GentleBathing(ScriptedBathing):
    """As `scripted`, but lands more slowly, presses with 2.6 N, and gives way to a trunk beside the arm."""

    PRESS, ENOUGH, SINK = 2.6, 1.6, 0.03

    def _across(self, speed: float, push: float) -> float:
        beyond = float(np.clip(abs(push) - FREE, 0.0, SQUEEZED)) * (1.0 if push > 0 else -1.0)
        if speed * beyond < 0:
            speed *= 1.0 - abs(beyond) / SQUEEZED
        return speed + GIVE * beyond
