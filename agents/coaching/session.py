"""A session of exercises: what is asked, what has been done, and what the coach does next."""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from rcare_marl.errors import ConfigError

from .body import CoachBody
from .exercise import Exercise, Reach
from .recognition.recogniser import Frame, Judgement, Recogniser, Repetition
from .style import Style
from .upper_body import MOTION_INDEX, directions

Act = Literal["stand", "show", "next", "rest"]
Word = Literal["nothing", "explain", "encourage", "praise", "hint"]
ACTS: tuple[Act, ...] = get_args(Act)
WORDS: tuple[Word, ...] = get_args(Word)

SPEECH = 0.35  # [s] a word, 170 words a minute: slow, clear speech; our own choice
SILENCE = 0.6  # [s] after a sentence; our own choice
TEMPO = (0.5, 2.0)  # a demonstration's, against that of the exercise; our own choice
LEAVING = (
    1.0  # [s] that an order to go on must last where an exercise is not done yet; our own choice
)
# Fatigue from which a repetition that falls short is taken for one that was too much; our own choice.
SPENT = 0.12
SHORT = frozenset(("range", "asymmetric", "one_side", "part_missing", "bent_elbows"))
AWAY = math.radians(
    18
)  # of the face, from which somebody looks away from the coach; our own choice
FACING = [MOTION_INDEX[name] for name in ("trunk_rotation_left", "neck_rotation_left")]
SAME_TEMPO = 1.2  # factor up to which another tempo is judged as the same; our own choice
CHEERS = ("Well done.", "Very good.", "That was right.")
CALLS = ("Come on, together with me.", "You can do it. Watch me.", "Let us try once more, slowly.")


@dataclass(frozen=True)
class Order:
    """What the coach does in the coming step.

    Attributes:
        act: Stands and watches, shows the exercise over and over, goes on to the next one, or rests. To
            leave an exercise that is not done takes `LEAVING` seconds of this order.
        word: What is said with it; nothing while something is still being said.
        tempo: Of what is shown, against the tempo of the exercise.
    """

    act: Act = "stand"
    word: Word = "nothing"
    tempo: float = 1.0


def programme(exercises: Sequence[Exercise], reach: Reach, *, speed: float) -> tuple[Exercise, ...]:
    """Return what exercises are for one person: within reach, and no faster than they can follow.

    Exercises of which nothing is left are left out.

    Args:
        exercises: What everybody is asked.
        reach: What the person can do.
        speed: How fast an arm or the head goes at most [rad/s].

    Raises:
        ConfigError: If nothing is left at all.
    """
    out = []
    for exercise in (e.adapted(reach) for e in exercises):
        if exercise.can_do:
            out.append(exercise.faster(min(1.0, speed / top_speed(exercise))))
    if not out:
        names = ", ".join(e.name for e in exercises)
        raise ConfigError(f"this person can do none of the exercises {names}: choose others")
    return tuple(out)


def top_speed(exercise: Exercise, rate: float = 60.0) -> float:
    """Return how fast the fastest arm or the head turns when it is shown [rad/s]."""
    found = directions(exercise.path(rate))
    most = 0.0
    for part in exercise.parts:
        if part != "trunk":
            most = max(most, float(np.linalg.norm(np.diff(found[part], axis=0), axis=-1).max()))
    return most * rate


class Lesson(abc.ABC):
    """Exercises that a coach leads one after the other, with one person or with several.

    What the coach's tree and its body know of a lesson.

    Attributes:
        exercises: What is shown, in this order.
        index: Which exercise is on; their number once the lesson is over.
        judgement: What was seen last: `following` is the green window.
        time: Since the beginning [s].
        begun_at: When the present exercise began [s].
        right_at: When the last right repetition was done, or the exercise began [s].
        hint: What there is to correct; empty if nothing is.
        is_explained: Whether the present exercise has been explained.
        must_stop: Set it to end the lesson at once.
        must_pause: Set it to pause as long as it is set.
        must_skip: Set it to leave the present exercise; cleared then.
        must_rest: Set it to rest as long as it is set.
        is_resting: Whether people are invited to rest: nothing they do then counts.
        fatigue: How tired people say that they are, 0 to 1.
        away_for: How long the person has looked away for [s]; 0 where the exercise turns the head.
        shown: How far the repetition is that is being shown, 0 to 1; the body of the coach tells.
        silent_at: When what is being said is over [s]; likewise.
        style: How the coach leads, as far as that is left open.
    """

    def __init__(self, exercises: Sequence[Exercise]) -> None:
        """Take the exercises.

        Raises:
            ConfigError: If there are none.
        """
        if not exercises:
            raise ConfigError("a session needs at least one exercise")
        self.exercises = tuple(exercises)

    def _restart(self) -> None:
        """Begin anew, with the first exercise."""
        self.index, self.time, self.fatigue, self.away_for = 0, 0.0, 0.0, 0.0
        self.shown, self.silent_at, self.style = 0.0, 0.0, Style()
        self.must_stop = self.must_pause = self.must_skip = self.must_rest = False
        self.is_resting = False
        self.begin_exercise()

    def begin_exercise(self) -> None:
        """Expect the present exercise from now on."""
        self.hint = ""
        self.begun_at = self.right_at = self.time
        self.judgement, self.is_explained = Judgement(), False

    @property
    def is_over(self) -> bool:
        """Whether all exercises are done or left, or the lesson was stopped."""
        return self.index >= len(self.exercises) or self.must_stop

    @property
    def exercise(self) -> Exercise:
        """The exercise that is on; the last one once the lesson is over."""
        return self.exercises[min(self.index, len(self.exercises) - 1)]

    @property
    def is_speaking(self) -> bool:
        """Whether something is still being said."""
        return self.time < self.silent_at

    @property
    def since_right(self) -> float:
        """Time since the last right repetition, or since the exercise began [s]."""
        return self.time - self.right_at

    @property
    @abc.abstractmethod
    def is_complete(self) -> bool:
        """Whether everything was done as often as it was asked for."""

    @property
    @abc.abstractmethod
    def is_done(self) -> bool:
        """Whether the present exercise has been done as often as it was asked for."""

    def go_on(self) -> None:
        """Go on to the next exercise."""
        if self.index < len(self.exercises):
            self.index += 1
            self.must_skip = False
            self.begin_exercise()

    @property
    @abc.abstractmethod
    def is_spent(self) -> bool:
        """Whether somebody who is tired has just fallen short."""

    @abc.abstractmethod
    def keep_tempo(self, tempo: float) -> None:
        """Judge people by another tempo from now on, where it differs enough to matter."""

    @abc.abstractmethod
    def address(self, word: Word) -> tuple[str | None, str]:
        """Return to whom a word is said, None for everybody, and the sentence that is said for it."""


class Session(Lesson):
    """The lesson of one person, as the recogniser sees it.

    Attributes:
        wanted: How many right repetitions of each are asked for.
        right: Right repetitions of each so far.
        wrong: Wrong ones of each so far.
        skipped: Exercises that were left before they were done.
        repetitions: All repetitions so far.
    """

    def __init__(
        self,
        exercises: Sequence[Exercise],
        recogniser: Recogniser,
        *,
        repetitions: int | None = None,
    ) -> None:
        """Begin a session.

        Args:
            exercises: Those that this person can do, see `programme`.
            recogniser: Judges what the person does.
            repetitions: Right repetitions asked of each; as each exercise says if None.

        Raises:
            ConfigError: If there are no exercises, or no repetitions are asked for.
        """
        super().__init__(exercises)
        if repetitions is not None and repetitions < 1:
            raise ConfigError(f"repetitions must be at least 1, got {repetitions}")
        self._recogniser = recogniser
        self.wanted = [repetitions or exercise.repetitions for exercise in exercises]
        self.reset()

    def reset(self, recogniser: Recogniser | None = None) -> None:
        """Begin anew, with a fresh recogniser where one is given: they may know the person of before."""
        self._recogniser = recogniser or self._recogniser
        count = len(self.exercises)
        self.right, self.wrong, self.skipped = [0] * count, [0] * count, [False] * count
        self.repetitions: list[Repetition] = []
        self._restart()

    def begin_exercise(self) -> None:
        super().begin_exercise()
        self._next_tempo = 1.0
        if not self.is_over:
            self._begin(1.0)

    @property
    def is_complete(self) -> bool:
        return all(r >= w for r, w in zip(self.right, self.wanted, strict=True))

    @property
    def is_done(self) -> bool:
        return self.index < len(self.right) and self.right[self.index] >= self.wanted[self.index]

    @property
    def is_spent(self) -> bool:
        found = self.judgement.finished
        is_short = found is not None and bool(found.errors) and SHORT.issuperset(found.errors)
        return is_short and self.fatigue > SPENT

    @property
    def right_count(self) -> int:
        """Right repetitions so far, of each exercise no more than asked for."""
        return sum(min(r, w) for r, w in zip(self.right, self.wanted, strict=True))

    def see(self, frame: Frame | None, time: float) -> None:
        """Take what a source saw of the person at a time [s], None where it saw nothing."""
        self._look(frame, time - self.time)
        self.time = time
        if self.is_resting:
            self._rests = True
            self.judgement = Judgement()
            return
        if frame is None or self.index >= len(self.exercises):
            return
        if self._rests:  # what was begun before the rest is not gone on with
            self._begin(self._tempo)
        self.judgement = judgement = self._recogniser.update(frame)
        self._take_tempo()
        if judgement.hint:
            self.hint = judgement.hint
        found = judgement.finished
        if found is not None:
            self.repetitions.append(found)
            if found.right:
                self.right[self.index] += 1
                self.hint, self.right_at = "", time
            else:
                self.wrong[self.index] += 1

    def _look(self, frame: Frame | None, duration: float) -> None:
        """Note for how long the face has been turned away, in the `duration` [s] that has passed."""
        if frame is not None:
            turned = np.nan_to_num(frame.angles[FACING]).sum()
            is_away = abs(turned) > AWAY and "head" not in self.exercise.parts
            self.away_for = self.away_for + duration if is_away else 0.0

    def go_on(self) -> None:
        """Go on to the next exercise; the present one counts as skipped if it is not done."""
        if self.index < len(self.exercises):
            self.skipped[self.index] = not self.is_done
        super().go_on()

    def keep_tempo(self, tempo: float) -> None:
        is_other = max(tempo / self._tempo, self._tempo / tempo) > SAME_TEMPO
        self._next_tempo = tempo if is_other else self._tempo
        self._take_tempo()

    def _take_tempo(self) -> None:
        """Judge by the tempo asked for as soon as no repetition is under way: that would be cut in two."""
        under_way = self.judgement.progress > 0 and self.judgement.finished is None
        if self._next_tempo != self._tempo and not under_way and not self.is_over:
            self._begin(self._next_tempo)

    def _begin(self, tempo: float) -> None:
        """Look for repetitions at a tempo, with none under way."""
        self._tempo, self._rests = tempo, False
        self._recogniser.begin(self.exercise.faster(tempo))

    def address(self, word: Word) -> tuple[str | None, str]:
        return None, self.sentence(word)

    def sentence(self, word: Word) -> str:
        """Return what is said for a word: an explanation, a hint of the recogniser, and so on."""
        if word == "explain":
            return self.exercise.say
        if word == "hint":
            return self.hint or CALLS[0]
        sentences = {"nothing": ("",), "praise": CHEERS, "encourage": CALLS}[word]
        return sentences[len(self.repetitions) % len(sentences)]


class Demonstration:
    """Carries out orders with a body: shows, speaks, rests.

    Attributes:
        angles: What is shown now [rad], shape [16].
        phase: How far the repetition is that is being shown, 0 to 1; 0 where none is.
        is_showing: Whether one is being shown.
        is_resting: Whether the coach invites to rest.
        tempo: Of what is being shown, against that of the exercise.
        shown_for: How far into the repetition, at the tempo of the exercise [s]; 0 where none is shown.
        word: What is being said; `nothing` if nothing is.
        spoken_to: To whom, by name; None for everybody.
        count: Repetitions that have been shown to their end, of the present exercise.
    """

    def __init__(self, session: Lesson, body: CoachBody) -> None:
        self._session, self._body = session, body
        self.reset()

    def reset(self) -> None:
        """Begin anew, with nothing shown or said."""
        self.is_showing = self.is_resting = False
        self.word: Word = "nothing"
        self.spoken_to: str | None = None
        self._of = 0
        self._stop()
        self.count, self._leaving = 0, 0.0

    def _stop(self) -> None:
        self.is_showing, self.shown_for, self.phase, self.tempo = False, 0.0, 0.0, 1.0
        self.angles, self._session.shown = self._session.exercise.angles(0.0), 0.0

    @property
    def is_speaking(self) -> bool:
        """Whether something is being said."""
        return self._session.is_speaking

    def perform(self, order: Order, duration: float) -> None:
        """Carry out an order for the coming step of `duration` [s]."""
        session = self._session
        if session.is_over:
            order = Order()
        self._speak(order.word)
        self._leaving = self._leaving + duration if order.act == "next" else 0.0
        if order.act == "next" and (session.is_done or self._leaving > LEAVING - 1e-9):
            session.go_on()
            self._leaving = 0.0
        self.is_resting = session.is_resting = order.act == "rest"
        if session.index != self._of:  # another exercise
            self._of, self.count = session.index, 0
            self._stop()
        if order.act != "show" or session.is_over:
            self._stop()
            self._body.stand_still()
            return
        if not self.is_showing:
            self.tempo = min(max(order.tempo, TEMPO[0]), TEMPO[1])
            session.keep_tempo(self.tempo)
            self.is_showing = True
        exercise = session.exercise
        self.shown_for += self.tempo * duration
        if self.shown_for >= exercise.duration + session.style.pause:
            self.count += 1
            self._stop()
        self.phase = session.shown = min(self.shown_for / exercise.duration, 1.0)
        self.angles = exercise.angles(self.shown_for)
        self._body.show(self.angles)

    def _speak(self, word: Word) -> None:
        if self.is_speaking:
            return
        if word == "hint" and not self._session.hint:
            word = "encourage"  # there is nothing to correct
        self.word = word
        if word != "nothing":
            self.spoken_to, text = self._session.address(word)
            self._session.is_explained |= word == "explain"
            self._body.say(text)
            self._session.silent_at = self._session.time + SPEECH * len(text.split()) + SILENCE
