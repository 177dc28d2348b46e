"""What a session sees of the person, from whichever source they chose."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.coaching.recognition.recogniser import Frame
from rcare_marl.agents.coaching.sources.hands_source import HandsReading, HandsSource
from rcare_marl.agents.coaching.sources.landmark_source import LandmarkReading, LandmarkSource
from rcare_marl.agents.coaching.upper_body import UpperBody

from .clock import PageClock
from .message import Begin, Hands, Landmarks, MessageError
from .simulated_user import SimulatedUser
from .webxr import reading

Array = npt.NDArray[np.float64]

UNSEEN = 0.7  # after so long without a frame the person counts as not seen [s]; our own choice


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
