"""What a session sees of the person, from whichever source they chose, and how much a page may send."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from rcare_marl.agents.coaching.recognition.recogniser import Frame
from rcare_marl.agents.coaching.sources.hands_source import HandsReading, HandsSource
from rcare_marl.agents.coaching.sources.landmark_source import LandmarkReading, LandmarkSource
from rcare_marl.agents.coaching.upper_body import UpperBody
from rcare_marl.pose import Array

from .message import Begin, Hands, Landmarks, MessageError
from .simulated_user import SimulatedUser
from .webxr import reading

SLACK = (
    1.0  # by how much the page's clock may gain on ours between two readings [s]; our own choice
)
ANEW = 2.0  # after so long with refused times only, it is taken as it is from there on [s]; our own choice
RATE = 120.0  # messages a second in the long run: a headset of 90 Hz, and then some
BURST = 120.0  # at once
UNSEEN = 0.7  # after so long without a frame the person counts as not seen [s]; our own choice


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


class Limiter:
    """Lets so many messages through a second, and drops the rest.

    Attributes:
        dropped: How many were dropped so far.
    """

    def __init__(self, *, rate: float = RATE, burst: float = BURST) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._at = burst, 0.0
        self.dropped = 0

    def lets(self, now: float) -> bool:
        """Return whether a message at a time [s] may pass; it counts as one."""
        self._left = min(self._burst, self._left + self._rate * (now - self._at))
        self._at = now
        if self._left < 1:
            self.dropped += 1
            return False
        self._left -= 1
        return True


class Camera(Protocol):
    """A webcam with something that finds landmarks, of this computer."""

    def newest(self) -> tuple[LandmarkReading, float] | None:
        """Return what was found since the last call, and when [s]; None if nothing was."""


class Sight:
    """Takes readings as they come, and makes at most one frame of them a step.

    Attributes:
        body: Lengths of the person's body, for drawing it.
        user: The simulated person, where the source is one.
    """

    def __init__(self, begin: Begin, camera: Camera | None, *, seed: int = 0) -> None:
        """Prepare for a session.

        Raises:
            MessageError: If a webcam is asked for that is not there.
        """
        if begin.source == "webcam" and camera is None:
            raise MessageError("there is no webcam: start the coach with --webcam MODEL")
        self._begin, self._camera = begin, camera if begin.source == "webcam" else None
        self.user: SimulatedUser | None = None
        if begin.source == "simulated":
            self.user = SimulatedUser(begin.height_m, seed=seed, mistake=begin.mistake)
        self._clock = PageClock()
        self._stature = UpperBody.of_height(begin.height_m)
        self._seen_at: float | None = None
        self.recentre()

    def recentre(self) -> None:
        """Learn anew how the person sits."""
        self._hands = HandsSource(self._begin.height_m)
        self._landmarks = LandmarkSource()
        self._reading: tuple[HandsReading | LandmarkReading, float] | None = None

    @property
    def body(self) -> UpperBody:
        return self._hands.body

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
        elif self._camera is not None:
            self._reading = self._camera.newest()
        if self._reading is None:
            return None
        raw, time = self._reading
        self._reading = None
        if isinstance(raw, HandsReading):
            frame = self._hands.update(raw, time)
        else:
            frame = self._landmarks.update(raw, time)
        if frame is not None:
            self._seen_at = now
        return frame

    def sees(self, now: float) -> bool:
        """Return whether the person has been seen lately."""
        return self._seen_at is not None and now - self._seen_at < UNSEEN
