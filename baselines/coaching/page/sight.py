"""What a session sees of the person, by headset, webcam or simulation, and how much a page may send."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from rcare_marl.agents.coaching.exercise import HEAD
from rcare_marl.agents.coaching.recognition.recogniser import Frame
from rcare_marl.agents.coaching.sources.calibration import Calibration
from rcare_marl.agents.coaching.sources.hands_source import HandsReading, HandsSource
from rcare_marl.agents.coaching.sources.landmark_source import LandmarkReading, LandmarkSource
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX, SIGN, UpperBody
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, matrix_from_quaternion, multiply, quaternion_from_matrix

from ...pages.door import Limiter as Limiter
from .message import Begin, HandJoints, Hands, Landmarks, MessageError, Mistake, Place

DELAY = 0.35  # after the coach [s]
TREMOR = 0.004  # of head and hands, standard deviation [m]
TURN_TREMOR = math.radians(1.0)
LEAN = math.radians(28)  # forward, of somebody who leans with the arms
PLANE = math.radians(60)  # how far beside the arms are in the wrong plane
SEAT = 0.55  # height of the hips [m]
FROM_WEBXR: Array = np.array(((0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
# Columns: fingers, across the palm to the left, back of the hand; in the axes of the grip.
HAND_IN_GRIP: dict[str, Array] = {
    side: np.array(((0.0, 0.0, -sign), (-1.0, 0.0, 0.0), (0.0, sign, 0.0)))
    for side, sign in SIGN.items()
}
# By how much the page's clock may gain on ours between two readings, and after how long with refused
# times only it is taken as it is from there on [s]; our own choice.
SLACK, ANEW = 1.0, 2.0
SAME_HEIGHT = 0.02  # measures are of somebody whose stature is told within this [m]; our own choice
UNSEEN = 0.7  # after so long without a frame the person counts as not seen [s]; our own choice


class SimulatedUser:
    """Follows what the coach shows, where there is neither headset nor webcam.

    They do it a little later and a little shaky, and at choice with a mistake. What comes out is what
    their headset and hands would report: recognition has nothing else to go by. All figures are our own
    choice.

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


def reading(hands: Hands, body: UpperBody) -> HandsReading:
    """Return what a headset reported as a reading in the frame x ahead, y left, z up.

    WebXR's frame is x right, y up, -z ahead (https://www.w3.org/TR/webxr, XRReferenceSpace), so x = -z',
    y = -x', z = y'. The viewer looks along its own -z', so its axes are turned likewise.

    Hands come in two ways:

    - Tracked hands (https://www.w3.org/TR/webxr-hand-input-1/): the wrist and the knuckles, joints
      `*-finger-phalanx-proximal`. The fingers' direction is from the wrist to the middle knuckle, across
      the palm lies the line of the knuckles. Of these only where the joints are is used, not how they are
      turned, in which devices differ.
    - Controllers: the grip pose, in OpenXR's meaning (specification 1.1, "Standard pose identifiers"): in
      the palm; x away from the palm on the left, into it on the right; -z through the fist from the little
      finger to the thumb. So flat fingers point along -y on both. How makers place it within the
      controller differs by degrees: that it fits is an assumption, no controller was measured.

    Args:
        hands: The report.
        body: Lengths of the person's body, for how far the palm is from the wrist.
    """
    return HandsReading(
        head=None if hands.head is None else _head(hands.head),
        left=_hand("left", hands.left, body),
        right=_hand("right", hands.right, body),
    )


def _head(place: Place) -> Pose:
    turn = FROM_WEBXR @ matrix_from_quaternion(place.quaternion) @ FROM_WEBXR.T
    return _pose(FROM_WEBXR @ np.array(place.position), turn)


def _hand(side: str, hand: HandJoints | Place | None, body: UpperBody) -> Pose | None:
    if hand is None:
        return None
    if isinstance(hand, Place):
        turn = FROM_WEBXR @ matrix_from_quaternion(hand.quaternion) @ HAND_IN_GRIP[side]
        return _pose(FROM_WEBXR @ np.array(hand.position), turn)
    wrist, index, middle, pinky = (
        FROM_WEBXR @ np.array(p) for p in (hand.wrist, hand.index, hand.middle, hand.pinky)
    )
    fingers = _unit(middle - wrist)
    across = SIGN[side] * (pinky - index)
    back = np.cross(fingers, across)
    if np.linalg.norm(back) < 1e-6:  # the knuckles in line with the wrist: no hand
        return None
    back = _unit(back)
    turn = np.column_stack((fingers, np.cross(back, fingers), back))
    return _pose(wrist + body.palm * fingers, turn)


def _pose(position: Array, turn: Array) -> Pose:
    return Pose(tuple(position.tolist()), tuple(quaternion_from_matrix(turn).tolist()))


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


class PageClock:
    """Turns times of the page into times that only grow, and not faster than ours."""

    def __init__(self) -> None:
        self._page: float | None = None  # the last time that was taken, on the page's clock
        self._ours = 0.0  # when that was
        self._time = 0.0  # and what came out
        self._refused_at: float | None = None

    def take(self, page: float, now: float) -> float:
        """Return the time of a reading [s], counted from the first one.

        Args:
            page: On the page's clock [s].
            now: On ours [s], which only grows.

        Raises:
            MessageError: If the page's clock ran backwards, or far ahead of ours. Where it goes on so for
                two seconds its new time is taken from then on.
        """
        if self._page is None:
            self._page, self._ours = page, now
            return self._time
        gone, ours = page - self._page, now - self._ours
        if not 0 < gone <= ours + SLACK:
            if self._refused_at is None:
                self._refused_at = now
            if now - self._refused_at < ANEW:
                raise MessageError(
                    "the time of readings has to grow" if gone <= 0 else "that time lies ahead"
                )
            gone = max(ours, 1e-3)
        self._refused_at = None
        self._page, self._ours, self._time = page, now, self._time + gone
        return self._time


class Sight:
    """Takes readings as they come, and makes at most one frame of them a step.

    Attributes:
        user: The simulated person, where the source is one.
        calibration: The one that was asked for, over or not; None if none was.
    """

    def __init__(self, begin: Begin, *, seed: int = 0) -> None:
        """Prepare for a session.

        Raises:
            ConfigError: If a calibration or its outcome is asked for that cannot be.
        """
        self._begin = begin
        self.calibration: Calibration | None = None
        if begin.source == "landmarks" and (begin.measure or begin.body is not None):
            raise ConfigError("a webcam sees how you are built: only hands are calibrated")
        if begin.body is not None and abs(begin.body.height - begin.height_m) > SAME_HEIGHT:
            raise ConfigError(
                f"these measures are of somebody of {begin.body.height:.2f} m, not {begin.height_m:.2f} m"
            )
        if begin.measure:
            lift = (begin.lift_left_deg, begin.lift_right_deg)
            self.calibration = Calibration(begin.height_m, lift=lift)
        self._fit = begin.body
        self.user: SimulatedUser | None = None
        if begin.source == "simulated":
            self.user = SimulatedUser(begin.height_m, seed=seed, mistake=begin.mistake)
        self._clock = PageClock()
        self._stature = UpperBody.of_height(begin.height_m)
        self._seen_at: float | None = None
        self.recentre()

    @property
    def is_measuring(self) -> bool:
        """Whether a calibration is on."""
        return self.calibration is not None and not self.calibration.is_over

    @property
    def note(self) -> str:
        """What the person should know of how they are seen; empty if there is nothing."""
        if self._begin.source == "landmarks" or self.is_measuring:
            return ""
        said = "" if self.calibration is None else self.calibration.words
        if not said and not self._hands.fit.is_measured:
            said = "You are not measured, so I judge more leniently."
        swapped = "Left and right hand are swapped: I take them the other way round."
        return f"{said} {swapped if self._hands.is_swapped else ''}".strip()

    def recentre(self) -> None:
        """Learn anew how the person sits; how they are built is kept."""
        if self.calibration is not None:
            self.calibration.begin_anew(whole=True)
        self._hands = HandsSource(self._begin.height_m, fit=self._fit)
        self._landmarks = LandmarkSource(monocular=True)
        self._reading: tuple[HandsReading | LandmarkReading, float] | None = None

    def take(self, message: Hands | Landmarks, now: float) -> None:
        """Take what the page sent.

        Raises:
            MessageError: If it is not of the chosen source, or its time is impossible.
        """
        wanted = {"hands": Hands, "landmarks": Landmarks}.get(self._begin.source)
        if wanted is None or not isinstance(message, wanted):
            raise MessageError(f"the source of this session is {self._begin.source}")
        time = self._clock.take(message.time, now)
        if isinstance(message, Hands):
            self._reading = (reading(message, self._stature), time)
        else:
            seen = LandmarkReading(np.array(message.points), np.array(message.visibility))
            self._reading = (seen, time)

    def frame(self, shown: Array, rest: Array, now: float) -> Frame | None:
        """Return what was seen since the last step, None if nothing new was.

        Args:
            shown: What the coach shows, for a simulated person [rad], shape [16].
            rest: Where the exercise begins and ends, likewise.
            now: On our clock [s].
        """
        if self.user is not None:
            self._reading = (self.user.follow(shown, rest, now), now)
        if self._reading is None:
            return None
        raw, time = self._reading
        self._reading = None
        if self.is_measuring and isinstance(raw, HandsReading):
            self._measure(raw, time, now)
            return None
        if isinstance(raw, HandsReading):
            frame = self._hands.update(raw, time)
        else:
            frame = self._landmarks.update(raw, time)
        if frame is not None:
            self._seen_at = now
        return frame

    def _measure(self, raw: HandsReading, time: float, now: float) -> None:
        assert self.calibration is not None
        self.calibration.update(raw, time)
        if raw.head is not None:
            self._seen_at = now
        if self.calibration.fit is not None:
            self._hands, self._fit = self.calibration.source, self.calibration.fit

    def sees(self, now: float) -> bool:
        """Return whether the person has been seen lately."""
        return self._seen_at is not None and now - self._seen_at < UNSEEN
