"""Somebody who follows the coach where there is neither headset nor webcam.

They see what the coach shows, do it a little later and a little shaky, and at choice with a mistake. What
comes out is what their headset and hands would report: recognition has nothing else to go by. All figures
are our own choice.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from rcare_marl.agents.coaching.exercise import HEAD
from rcare_marl.agents.coaching.sources.hands_source import HandsReading
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX, UpperBody
from rcare_marl.pose import Array, Pose, multiply

from .message import Mistake

DELAY = 0.35  # after the coach [s]
TREMOR = 0.004  # of head and hands, standard deviation [m]
TURN_TREMOR = math.radians(1.0)
LEAN = math.radians(28)  # forward, of somebody who leans with the arms
PLANE = math.radians(60)  # how far beside the arms are in the wrong plane
SEAT = 0.55  # height of the hips [m]


class SimulatedUser:
    """Follows what the coach shows.

    Attributes:
        mistake: What they do wrong.
    """

    def __init__(self, height: float, *, seed: int = 0, mistake: Mistake = "none") -> None:
        """Prepare somebody of a stature [m]."""
        self.mistake = mistake
        self._body = UpperBody.of_height(height)
        self._rng = np.random.default_rng(seed)
        self._seen: deque[tuple[float, Array]] = deque()
        self._rest: Array | None = None
        self._doing: Array | None = None

    def follow(self, shown: Array, rest: Array, time: float) -> HandsReading:
        """Return what their headset and hands report at a time [s].

        Args:
            shown: What the coach shows now [rad], shape [16].
            rest: Where the exercise begins and ends [rad], shape [16].
            time: It only grows [s].
        """
        self._seen.append((time, shown))
        doing = self._doing if self._doing is not None else rest
        while self._seen and self._seen[0][0] <= time - DELAY:
            doing = self._seen.popleft()[1]
        self._doing = doing
        poses = self._body.poses(self._with_mistake(doing, rest))
        return HandsReading(
            *(self._shaken(*poses[name]) for name in ("head", "left_hand", "right_hand"))
        )

    def _with_mistake(self, angles: Array, rest: Array) -> Array:
        """Return what they do in place of `angles`, coming and going with how far these are from rest."""
        out = np.array(angles)
        if self.mistake == "still":
            return np.array(rest)
        if self.mistake == "half_range":
            return np.asarray(rest + 0.5 * (angles - rest))
        if self.mistake == "one_side":
            out[ARM["right"]] = rest[ARM["right"]]
            out[HEAD] = np.maximum(out[HEAD], rest[HEAD])
            return out
        raised = min(float(np.abs(angles - rest).max()) / math.radians(60), 1.0)
        if self.mistake == "trunk_lean":
            out[MOTION_INDEX["trunk_flexion"]] += LEAN * raised
        if self.mistake == "wrong_plane":
            for arm in ARM.values():
                plane = arm.start + 1
                out[plane] += raised * (PLANE if out[plane] < math.pi / 4 else -PLANE)
            out[HEAD] = rest[HEAD] + np.roll(
                angles[HEAD] - rest[HEAD], 1
            )  # tilts, and does not turn
        return out

    def _shaken(self, position: Array, quaternion: Array) -> Pose:
        position = position + self._rng.normal(0, TREMOR, 3) + (0.0, 0.0, SEAT)
        x, y, z = self._rng.normal(0, TURN_TREMOR / 2, 3)
        turned = multiply(quaternion, (x, y, z, math.sqrt(1 - x * x - y * y - z * z)))
        return Pose(tuple(position.tolist()), tuple(turned.tolist()))
