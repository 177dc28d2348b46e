"""A hand-written robot that bathes: come over the shoulder, press softly, wipe to the elbow, lift.

It presses by what the sponge feels, and lifts at once from who does not want it.
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
PRESS = 4.0  # [N], within PhyRC's 1 to 6 N of comfort, and gentle to who then says no
HOVER = 0.03  # [m] over the skin, before it presses
NEAR = 0.02  # [m] from a place, and
LEVEL = 0.3  # [rad], that counts as there: some hands cannot lay it flat
GAIN, TURN_GAIN = 2.5, 2.5  # [1/s]
YIELD = 0.006  # [m/s] into the skin for each newton that is lacking
FAST, SINK, WIPE = 0.20, 0.04, 0.06  # [m/s] through the air, onto the skin, along it
BEYOND = 0.01  # [m] past the target, before another pass is made
TOUCH = 0.5  # [N] that count as contact
PHASES = ("approach", "press", "wipe", "lift")


@register_policy("bathing", "robot", "scripted")
class ScriptedBathing(ToolScript[Bathing]):
    """Comes over the shoulder, presses until it feels 4 N, wipes to the target, and lifts."""

    KIND = Bathing

    def _begin(self) -> None:
        self._phase, self._offering = "approach", Offering()

    def act(self) -> Array:
        task, skin, seen = self._task, self._task.skin, self._task.state
        face = seen.face
        share = skin.progress(face)
        end, angle = task.target_on_arm()
        done = min(max((share - START_SHARE) / (end - START_SHARE), 0.0), 1.0)
        top, out = skin.place(
            START_SHARE + done * (end - START_SHARE), START_ANGLE + done * (angle - START_ANGLE)
        )
        way = skin.direction()
        turn = turning(task.wiping_quaternion(out, way), seen.turn, 1.0)
        start = skin.place(START_SHARE, START_ANGLE)[0]
        height, force = float((face - top) @ out), float(-seen.push @ out)
        ahead = float((seen.target - face) @ way)
        self._phase = self._next(start, out, turn, ahead, height, force)
        if not self._offering.goes_on(seen.refusal, seen.time):
            self._phase = "approach"
            linear = limited(GAIN * (TAKEN_AWAY + HOVER - height) * out, FAST)
        elif self._phase in ("approach", "lift"):
            goal = start if self._phase == "approach" else top
            linear = limited(GAIN * (goal + HOVER * out - face), FAST)
        else:
            aside = float((top - face) @ np.cross(out, way))
            into = YIELD * (PRESS - force) if force > TOUCH else SINK
            along = WIPE if self._phase == "wipe" else 0.0
            linear = along * way + GAIN * aside * np.cross(out, way)
            linear = linear - float(np.clip(into, -SINK, SINK)) * out
        return self._about(face, linear, TURN_GAIN * turn)  # so that turning does not wipe

    def memory(self) -> tuple[Sequence[object], Array]:
        return (self._offering.is_on, *(self._phase == name for name in PHASES)), np.zeros(0)

    def _next(
        self, start: Array, out: Array, turn: Array, ahead: float, height: float, force: float
    ) -> str:
        """Return what to do now."""
        there = start + HOVER * out - self._task.state.face
        if self._phase == "approach":
            is_there = np.linalg.norm(there) < NEAR and np.linalg.norm(turn) < LEVEL
            return "press" if is_there else "approach"
        if self._phase == "press":
            return "wipe" if force > 0.6 * PRESS else "press"
        if self._phase == "wipe":
            return "lift" if ahead < -BEYOND else "wipe"
        return "approach" if height > 0.8 * HOVER else "lift"
