"""One session of one person at the page: messages in, what the page shows out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from rcare_marl.agents.coaching.exercise import Exercise, load_exercises
from rcare_marl.agents.coaching.recognition.recogniser import ERRORS, Frame, Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import PRAISED_FOR, RuleRecogniser
from rcare_marl.agents.coaching.session import Session, programme
from rcare_marl.agents.coaching.sources.calibration import PARTS
from rcare_marl.agents.coaching.tree import Coach
from rcare_marl.agents.coaching.upper_body import MOTIONS
from rcare_marl.errors import ConfigError, RcareError, check_name
from rcare_marl.pose import Array

from .editor import points_of, reach_of
from .message import Begin, Command, Consent, Hands, Landmarks, MessageError, Simulate, Wanted
from .recording import Recorder, Step
from .sight import Sight

Phase = Literal[
    "waiting", "measuring", "settling", "explaining", "exercising", "paused", "resting", "over"
]

STEP = 1 / 30  # of a session [s]
LONGEST_STEP = 0.2  # where the computer was busy [s]
NOTHING_SEEN = "I cannot see you. Please check the headset, the hands or the camera."


class PageBody:
    """Keeps what the page has to show and to say.

    Attributes:
        angles: What is shown [rad], shape [16].
        rest: How it stands still [rad], shape [16].
        said: What was said last; empty before.
        count: How often something was said.
    """

    def __init__(self, rest: Array | None = None) -> None:
        """Stand at rest [rad], shape [16]; with hanging arms if None."""
        self.rest = np.zeros(len(MOTIONS)) if rest is None else rest
        self.angles = self.rest
        self.said, self.count = "", 0

    def show(self, angles: Array) -> None:
        self.angles = angles

    def say(self, text: str) -> None:
        self.said, self.count = text, self.count + 1

    def stand_still(self) -> None:
        self.angles = self.rest


class Room:
    """A session: begun, watched, interrupted and ended by messages of one page.

    Attributes:
        recorder: Keeps the session once the person consented; None where recording is off.
    """

    def __init__(
        self,
        *,
        recorder: Recorder | None = None,
        exercises: Sequence[Exercise] = (),
    ) -> None:
        """Take what records, and the exercises on offer: all that ship if none are given."""
        self.recorder = recorder
        shipped = load_exercises()
        self._offered = {exercise.name: exercise for exercise in exercises or shipped}
        self._known = tuple({each.name: each for each in (*shipped, *exercises)}.values())
        self._session: Session | None = None
        self._number = 0  # of the session, counted from 1
        self._user: dict[str, Any] | None = None

    @property
    def is_on(self) -> bool:
        """Whether a session is on: begun, and not over."""
        return self._session is not None and not self._session.is_over

    def receive(self, message: Wanted, now: float) -> None:
        """Take a message of the page at a time [s] of our clock.

        Raises:
            MessageError: If it does not fit what is going on.
        """
        if isinstance(message, Begin):
            self._begin(message, now)
        elif isinstance(message, Consent):
            if self.recorder is None:
                raise MessageError("recording is off: start the coach with --record FOLDER")
            if self._session is None:
                raise MessageError("no session has begun")
            self.recorder.consent(given=message.given)
        elif self._session is None:
            raise MessageError("no session has begun")
        elif isinstance(message, (Hands, Landmarks)):
            self._sight.take(message, now)
        elif isinstance(message, Simulate):
            if self._sight.user is None:
                raise MessageError("this session has no simulated person")
            self._sight.user.mistake = message.mistake
        else:
            self._obey(message, self._session)

    def _begin(self, begin: Begin, now: float) -> None:
        try:
            for name in begin.exercises:
                check_name("exercise", name, self._offered)
            chosen = [self._offered[name] for name in begin.exercises]
            exercises = programme(chosen, reach_of(begin), speed=math.inf)
            sight = Sight(begin)
        except RcareError as error:
            raise MessageError(str(error)) from error
        exercises = tuple(exercise.faster(begin.tempo) for exercise in exercises)
        recogniser = RuleRecogniser(known=self._known)
        session = Session(exercises, recogniser, repetitions=begin.repetitions)
        if self.recorder is not None:
            self.recorder.begin(begin, exercises)
        self._session, self._sight, self._recogniser = session, sight, recogniser
        self._number += 1
        self._body = PageBody(exercises[0].angles(0.0))
        self._coach = Coach(session, self._body)
        self._began, self._led_since, self._stepped = now, now, now - STEP
        self._watches, self._settled, self._user, self._trouble = False, False, None, ""
        self._unwatched = 0.0  # taken out of the clock of frames [s]
        self._frame_at: float | None = None  # time of the last one [s]
        self._last: Repetition | None = None
        self._praised_until = -math.inf

    def _obey(self, command: Command, session: Session) -> None:
        wish = command.wish
        if wish == "stop":
            session.must_stop = True
        elif wish == "pause":
            session.must_pause = True
        elif wish == "rest":
            session.must_rest = True
        elif wish == "resume":
            session.must_pause = session.must_rest = False
        elif wish == "skip" and self._sight.is_measuring and self._sight.calibration is not None:
            self._sight.calibration.give_up()
        elif wish == "skip":
            session.must_skip = True
            session.must_pause = session.must_rest = False
        else:
            self._sight.recentre()
            self._recogniser.begin_anew()  # half a repetition as seen from elsewhere would be judged
            self._settled, self._user = False, None

    def step(self, now: float) -> dict[str, Any]:
        """Go on to a time [s] of our clock; return what the page shows, ready for JSON."""
        session = self._session
        if session is None:
            return {"type": "state", "phase": "waiting", "session": 0, **self._recording()}
        duration = min(now - self._stepped, LONGEST_STEP)
        self._stepped = now
        if not session.is_over:
            self._go_on(session, now, duration)
        return self._state(session, now)

    def _go_on(self, session: Session, now: float, duration: float) -> None:
        if self._sight.is_measuring:
            self._led_since = now
            self._measure(now, is_paused=session.must_pause)
            return
        self._body.rest = session.exercise.angles(0.0)
        try:
            frame = self._sight.frame(self._body.angles, self._body.rest, now)
        except ConfigError as error:  # what was seen while it settled fits no body: again
            self._sight.recentre()
            frame, self._trouble = None, f"{error}. Please sit upright and look ahead."
        if frame is not None:
            self._settled, self._trouble = True, ""
            self._user = points_of(frame.angles)
        elif not self._sight.sees(now):
            self._user = None
        if not self._settled:  # the coach waits until it knows how the person sits
            self._led_since = now
            return
        watched = self._watched(frame)
        before, count = session.index, len(session.repetitions)
        if watched is not None:
            exercise = session.exercise
        order = self._coach.step(watched, now - self._led_since, duration)
        self._watches = order.act == "show"
        # The judgement itself is gone where the coach has gone on to the next exercise.
        found = session.repetitions[-1] if len(session.repetitions) > count else None
        if found is not None:
            self._last = found
            self._praised_until = now + PRAISED_FOR if found.right else -math.inf
        if session.index != before:
            self._last = None if found is None else found
        if watched is not None and self.recorder is not None:
            green = self._is_green(session, now) or (found is not None and found.right)
            progress = session.judgement.progress
            self.recorder.add(
                Step(now - self._began, exercise.name, watched.angles, green, progress, found)
            )

    def _measure(self, now: float, *, is_paused: bool) -> None:
        """Lead the person through the calibration, or let it wait."""
        calibration = self._sight.calibration
        assert calibration is not None
        before = (calibration.index, calibration.trouble)
        if not self._body.count:
            self._body.say(calibration.say)
        if is_paused:
            calibration.begin_anew()
            return
        self._body.show(calibration.angles)
        self._sight.frame(self._body.angles, self._body.rest, now)
        seen = calibration.angles_seen
        self._user = points_of(seen) if np.isfinite(seen).any() else None
        if calibration.is_over:
            self._body.stand_still()
            self._body.say(calibration.words)
        elif (calibration.index, calibration.trouble) != before:
            self._body.say(f"{calibration.trouble} {calibration.say}".strip())

    def _watched(self, frame: Frame | None) -> Frame | None:
        """Return the frame as the recogniser gets it: none of the time in which nothing is asked.

        That time is taken out of its clock, or a pause would count as standing still.
        """
        if frame is None:
            return None
        if not self._watches:
            if self._frame_at is not None:
                self._unwatched += frame.time - self._frame_at
            self._frame_at = frame.time
            return None
        self._frame_at = frame.time
        return replace(frame, time=frame.time - self._unwatched)

    def _phase(self, session: Session) -> Phase:
        if session.is_over:
            return "over"
        if session.must_pause:
            return "paused"
        if self._sight.is_measuring:
            return "measuring"
        if self._coach.demonstration.is_resting:
            return "resting"
        if not self._settled:
            return "settling"
        return "exercising" if self._watches else "explaining"

    def _state(self, session: Session, now: float) -> dict[str, Any]:
        k = min(session.index, len(session.exercises) - 1)
        last = self._last
        sees = self._sight.sees(now) or session.is_over
        return {
            "type": "state",
            "session": self._number,
            "phase": self._phase(session),
            "time": round(now - self._began, 2),
            "exercise": {
                "name": session.exercise.name,
                "title": session.exercise.title,
                "number": k + 1,
                "of": len(session.exercises),
            },
            "right": session.right[k],
            "wrong": session.wrong[k],
            "wanted": session.wanted[k],
            "following": self._is_green(session, now) and sees,
            "progress": round(session.judgement.progress, 2),
            "last": None if last is None else _told(last, len(session.repetitions)),
            "said": self._body.said,
            "count": self._body.count,
            "hint": self._hint(session, sees=sees),
            "seen": sees,
            "note": self._sight.note,
            "calibration": self._calibration(),
            "coach": points_of(self._body.angles),
            "user": self._user,
            "over": _summary(session) if session.is_over else None,
            **self._recording(),
        }

    def _is_green(self, session: Session, now: float) -> bool:
        """Return whether the window is green: the way has been gone as far as it counts, without a fault.

        The recogniser's `following` opens as soon as the way out is begun; half of it would turn green, too.
        """
        judgement = session.judgement
        if not (judgement.following and self._watches):
            return False
        far = judgement.progress >= session.exercise.judged.range_share
        return far or now < self._praised_until

    def _calibration(self) -> dict[str, Any] | None:
        found = self._sight.calibration
        if found is None:
            return None
        return {
            "say": found.say,
            "part": min(found.index + 1, len(PARTS)),
            "of": len(PARTS),
            "left_s": round(found.left, 1),
            "trouble": found.trouble,
            "words": found.words,
            "body": None if found.fit is None else found.fit.to_dict(),
        }

    def _hint(self, session: Session, *, sees: bool) -> str:
        if self._trouble:
            return self._trouble
        if self._sight.is_measuring and self._sight.calibration is not None:
            return self._sight.calibration.trouble if sees else NOTHING_SEEN
        return session.hint if sees or not self._settled else NOTHING_SEEN

    def _recording(self) -> dict[str, Any]:
        if self.recorder is None:
            return {"recording": None}
        report = self.recorder.report
        return {
            "recording": {
                "folder": str(self.recorder.folder),
                "consent": self.recorder.has_consent,
                "report": None if report is None else str(report),
            }
        }


def _told(repetition: Repetition, number: int) -> dict[str, Any]:
    return {
        "number": number,
        "right": repetition.right,
        "score": round(100 * repetition.score),
        "errors": list(repetition.errors),
        "why": ERRORS[repetition.errors[0]] if repetition.errors else "",
    }


def _summary(session: Session) -> dict[str, Any]:
    return {
        "complete": session.is_complete,
        "exercises": [
            {"title": exercise.title, "right": right, "wanted": wanted, "wrong": wrong}
            for exercise, right, wanted, wrong in zip(
                session.exercises, session.right, session.wanted, session.wrong, strict=True
            )
        ],
    }
