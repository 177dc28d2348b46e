"""A guided calibration: ten seconds in which somebody with a headset shows how they are built.

They are told what to do now, shown it, and told what was wrong with it and asked again where they did
something else. What comes out is a `HandsSource` that knows the person's body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from ...people.motion.trajectory import minimum_jerk
from ..upper_body import ARM, MOTIONS, SIDES, arm_direction, turn_z
from .body_fit import BodyFit
from .hands_source import HandsReading, HandsSource

# All our own choice.
MOVE = 2.0  # how long somebody has to come to where a part begins [s]
MOST_AGAIN = 4  # so often something is asked again; then it goes on without measures
HANGING = 40.0  # an arm raised by less hangs [deg]
LEAST_LIFT = 40.0  # who lifts an arm by less is not asked to [deg]
NEAR = 35.0  # a raised arm so near to what is shown is where it should be [deg]
HELD = 0.4  # share of a part's readings in which it has to be there
CIRCLE = 0.35  # standard deviation of a circle's directions across its narrow side, of its width
SEEN = 0.6  # share of a part's readings in which head and hands have to be seen


@dataclass(frozen=True)
class Part:
    """One part of a calibration.

    Attributes:
        say: What to do.
        seconds: How long, once there [s].
        at: Elevation and plane of both arms where it begins [deg].
        width: Of the circle that the arms draw [deg]; 0 where they are held still.
    """

    say: str
    seconds: float
    at: tuple[float, float]
    width: float = 0.0


PARTS = (
    Part("Sit upright, look ahead, and let both arms hang.", 1.5, (8.0, 30.0)),
    Part("Hold both arms out to the front, straight.", 2.5, (85.0, 85.0)),
    Part("Hold both arms out to the sides, straight.", 2.5, (85.0, 5.0)),
    Part("Draw one big circle with both straight arms.", 3.5, (85.0, 5.0), 35.0),
)
SECONDS = sum(part.seconds for part in PARTS)


class Calibration:
    """Leads one person through it.

    Attributes:
        index: Which of `PARTS` is on; their number once all are done.
        trouble: What was wrong when something had to be asked again; empty if nothing was.
        source: A source that knows the person, once all parts are done; until then the stature alone.
        angles_seen: Of the person now [rad], shape [16]; NaN where they are not known.
        fit: What was found out; None until all parts are done.
        is_over: Whether it is done, or was given up.
    """

    def __init__(self, height: float, *, lift: tuple[float, float] = (180.0, 180.0)) -> None:
        """Prepare for somebody of a stature.

        Args:
            height: Stature [m].
            lift: How far left and right arm can be raised [deg]; one that hardly can is not asked to.

        Raises:
            ConfigError: If neither arm can be raised far enough to measure it.
        """
        self._lift = dict(zip(SIDES, lift, strict=True))
        self._sides = tuple(side for side in SIDES if self._lift[side] >= LEAST_LIFT)
        if not self._sides:
            raise ConfigError(
                f"to be measured an arm must rise by at least {LEAST_LIFT:g} degrees, got "
                f"{lift[0]:g} (left) and {lift[1]:g} (right)"
            )
        self._height, self._again, self._kept = height, 0, list[HandsReading]()
        self.trouble, self.is_over, self.source = "", False, HandsSource(height)
        self.fit: BodyFit | None = None
        self.angles_seen = np.full(len(MOTIONS), np.nan)
        self._begin(0)

    def _begin(self, index: int) -> None:
        self.index, self._since, self._gone = index, math.nan, 0.0
        self._readings: list[HandsReading] = []
        self._seen: list[Array] = []  # angles [16] of each reading

    def begin_anew(self, *, whole: bool = False) -> None:
        """Begin the present part anew, or the whole of it."""
        if whole:
            self._kept = []
        if not self.is_over:
            self._begin(0 if whole else self.index)

    def give_up(self) -> None:
        """Go on without measures."""
        self.is_over = True

    @property
    def say(self) -> str:
        """What the person is to do now; empty once it is over."""
        return "" if self.is_over else PARTS[self.index].say

    @property
    def left(self) -> float:
        """How long it takes yet if nothing goes wrong [s]."""
        if self.is_over:
            return 0.0
        return sum(part.seconds + MOVE for part in PARTS[self.index :]) - self._gone

    @property
    def words(self) -> str:
        """What came out, in plain words; empty until it is over."""
        if not self.is_over:
            return ""
        if self.fit is None:
            return "You are not measured, so I judge more leniently."
        body = self.fit.body
        return (
            f"I have measured you: {100 * body.reach:.0f} cm from shoulder to palm, "
            f"{200 * body.shoulder:.0f} cm from shoulder to shoulder."
        )

    @property
    def angles(self) -> Array:
        """What is to be shown now [rad], shape [16]."""
        k = min(self.index, len(PARTS) - 1)
        share = minimum_jerk(min(self._gone / MOVE, 1.0))
        turn = 2 * math.pi * min(max(self._gone - MOVE, 0.0) / PARTS[k].seconds, 1.0)
        out = np.zeros(len(MOTIONS))
        for side, arm in ARM.items():
            before, (at, width) = self._way(side, max(k - 1, 0))[0], self._way(side, k)
            circle = width * np.array((math.sin(turn), 1.0 - math.cos(turn)))
            out[arm.start : arm.start + 2] = before + share * (at - before) + circle
        return out

    def _way(self, side: str, index: int) -> tuple[Array, float]:
        """Return where an arm is held in a part, elevation and plane, and the width of its circle [rad]."""
        part, lift = PARTS[index if side in self._sides else 0], self._lift[side]
        width = min(part.width, lift / 3)
        elevation, plane = part.at
        return np.radians((min(elevation, lift - width), plane)), math.radians(width)

    def update(self, reading: HandsReading, time: float) -> None:
        """Take what headset and hands report at a time [s], which only grows."""
        if self.is_over:
            return
        if math.isnan(self._since):
            self._since = time
        self._gone = time - self._since
        if self.index:
            self._look(reading, time)
        if self._gone < MOVE:
            return
        self._readings.append(reading)
        if self._gone >= MOVE + PARTS[self.index].seconds:
            self._judge(time)

    def _look(self, reading: HandsReading, time: float) -> None:
        frame = self._probe.update(reading, time)
        self.angles_seen = np.full(len(MOTIONS), np.nan) if frame is None else frame.angles
        if self._gone >= MOVE:
            self._seen.append(self.angles_seen)

    def _judge(self, time: float) -> None:
        """Go on to the next part, or ask again for what was not done."""
        try:
            if self.index == 0:
                self._probe = HandsSource(self._height)
                self._probe.calibrate(self._readings)
                for k, reading in enumerate(self._readings):
                    self._look(reading, time + 1e-3 * (k - len(self._readings)))
            wrong = self._wrong()
        except ConfigError:  # the head was never seen
            wrong = "I could not see your head."
        if wrong:
            self._ask_again(wrong, self.index)
            return
        self.trouble = ""
        self._kept += self._readings
        if self.index + 1 < len(PARTS):
            self._begin(self.index + 1)
            return
        try:
            self.source.calibrate(self._kept)
            wrong = "" if self.source.fit.is_measured else "Your arms did not look straight."
        except ConfigError as error:
            wrong = f"I cannot make sense of it: {error}."
        if wrong:
            self.source, self._kept = HandsSource(self._height), []
            self._ask_again(wrong, 0)
        else:
            self.is_over, self.fit = True, self.source.fit

    def _ask_again(self, wrong: str, index: int) -> None:
        self._again += 1
        self.is_over = self._again > MOST_AGAIN
        self.trouble = wrong if self.is_over else f"{wrong} Once more, please."
        self._begin(index)

    def _wrong(self) -> str:
        """Return what was wrong with the present part; empty if nothing was."""
        part, seen = PARTS[self.index], np.array(self._seen)
        if np.isfinite(seen[:, 0]).mean() < SEEN:
            return "I could not see your head."
        for side in SIDES if self.index == 0 else self._sides:
            arm = ARM[side].start
            own = seen[np.isfinite(seen[:, arm])]
            if len(own) < SEEN * len(seen):
                return f"I could not see your {side} hand."
            elevation, plane = own[:, arm], own[:, arm + 1]
            # One hand that is elsewhere than the other looks like a trunk that turns: taken out again.
            way = arm_direction(side, elevation, plane)[:, None] @ np.swapaxes(
                turn_z(own[:, 2]), 1, 2
            )
            way = way[:, 0]
            if self.index == 0:
                if (elevation < math.radians(HANGING)).mean() < SEEN:
                    return f"Your {side} arm did not hang."
            elif part.width:
                spread = np.linalg.svd(way - way.mean(axis=0), compute_uv=False)
                if spread[1] < CIRCLE * self._way(side, self.index)[1] * math.sqrt(len(way)):
                    return f"Your {side} arm did not go round."
            else:
                shown = arm_direction(side, *self._way(side, self.index)[0])
                if (way @ shown > math.cos(math.radians(NEAR))).mean() < HELD:
                    where = "to the front" if self.index == 1 else "to the side"
                    return f"Your {side} arm was not held out {where}."
        return ""
