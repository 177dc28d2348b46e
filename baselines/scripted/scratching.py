"""A hand-written robot that scratches: come over the itch, press softly, go to and fro over it.

It presses by what the tool feels, and lifts at once from who does not want it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.tasks.scratching import TAKEN_AWAY, Scratching
from rcare_marl.pose import Array

from .offering import Offering
from .tool_script import ToolScript, limited, turning

# All our own choices.
PRESS, TOUCH = 1.5, 0.2  # [N] that it presses with, and that count as contact
HOVER = 0.03  # [m] over the skin, before it presses
REACHED, LEVEL = 0.012, 0.3  # [m], [rad] from there
STROKE, RATE = 0.01, 0.8  # [m] each way, [1/s] of its strokes
GAIN, TURN_GAIN = 2.5, 2.0  # [1/s]
YIELD = 0.008  # [m/s] into the skin for each newton that is lacking
FAST, AWAY, SINK, ALONG = (
    0.15,
    0.25,
    0.03,
    0.06,
)  # [m/s] through the air, off, onto the skin, along it


@register_policy("scratching", "robot", "scripted")
class ScriptedScratching(ToolScript[Scratching]):
    """Comes over where it itches, presses until it feels 1.5 N, and strokes; sees everything but the itch."""

    KIND = Scratching

    def _begin(self) -> None:
        self._offering, self._is_down, self._since = Offering(), False, 0.0
        self._phase = 0.0  # of its strokes [rad]

    def act(self) -> Array:
        task, seen = self._task, self._task.state
        out = seen.out
        turn = turning(task.tool_quaternion(out), seen.turn, TURN_GAIN)
        away = seen.said + HOVER * out - seen.tip
        if not self._offering.goes_on(seen.refusal, seen.time):
            self._is_down = False
            away = away + (TAKEN_AWAY + 0.015 - HOVER) * out
            return self._about(seen.tip, limited(4 * GAIN * away, AWAY), turn)
        is_there = np.linalg.norm(away) < REACHED and np.linalg.norm(turn) < LEVEL * TURN_GAIN
        if not self._is_down and is_there:
            self._is_down, self._since = True, seen.time
        if not self._is_down:
            return self._about(seen.tip, limited(GAIN * away, FAST), turn)
        first = np.cross(out, (0.0, 1.0, 0.0))
        first = first / np.linalg.norm(first)
        phase = self._phase = 2 * math.pi * RATE * (seen.time - self._since)
        goal = seen.said + STROKE * math.sin(phase) * first - seen.tip
        along = GAIN * (goal - (goal @ out) * out)
        along = along + 2 * math.pi * RATE * STROKE * math.cos(phase) * first
        into = YIELD * (PRESS - seen.press) if seen.press > TOUCH else SINK
        linear = limited(along, ALONG) - float(np.clip(into, -SINK, SINK)) * out
        return self._about(seen.tip, linear, turn)

    def memory(self) -> tuple[Sequence[object], Array]:
        stroke = np.array((math.sin(self._phase), math.cos(self._phase)))
        return (self._offering.is_on, self._is_down), stroke
