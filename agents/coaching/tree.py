"""The coach's behaviour tree, after the RCareWorld paper.

One exercise after the other; in each of them the coach demonstrates and observes side by side, until the
person has followed often enough.

    ? coach                       the first branch that does not fail, asked anew at every tick
    ├── → stop                    asked to stop: stands still, whatever was going on
    ├── → pause                   asked to pause: stands still
    ├── → rest                    the person is tired: says how the last one was, and lets them rest
    └── → programme               for each exercise
        └── ? <exercise>
            ├── done              was followed often enough, or left
            ├── → skip            asked to skip it
            └── → do it
                ├── explain       says once what comes
                └── ⇉ coach it
                    ├── demonstrate   shows it, over and over
                    ├── observe       until enough were right; praises each, says what was wrong with others
                    └── ? encourage   if none has been right for long: slower, with a hint

What the leaves find is written into one `Order`, which a `Demonstration` carries out. What has been done
stands in the `Session`, so a branch that interrupts loses nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status
from py_trees.composites import Parallel

from ..people.behaviour.leaves import Condition, first_of, when
from .body import CoachBody
from .recognition.recogniser import Frame
from .session import SPENT, Demonstration, Lesson, Order, Session, Word

# All our own choices.
PATIENCE = 2.5  # repetitions as shown, without a right one, after which the coach encourages
RECOVERS = 0.6  # who falls short for being tired rests so much longer, as a share of what is left
LONGEST_REST = 45.0  # [s]: who is still tired then does not recover by resting, and is led on
MORE_TIRED = 0.1  # and rests again when they are so much more tired
AGAIN = 8.0  # [s] between two encouragements
SLOWER = 0.75  # tempo while it encourages
LET = 1.5  # repetitions as shown that somebody is left to join before one is begun anew again
UNMOVED = 0.05  # progress up to which nobody has joined a repetition


class Intent:
    """What the leaves of a tick want done, and what they remember.

    Attributes:
        order: What it comes to.
        slow_for: Index of the exercise that is shown more slowly; -1 for none.
        called_at: When it last encouraged [s].
        calls: How often it did.
        rests: Whether it lets the person rest.
        more: Fatigue from which it rests where resting did not help; 0 where the style says.
        rests_to: Fatigue until which it does.
        rested_from: When it began to [s].
        eased: Index of the exercise in which somebody tired fell short, -1 for none, and the fatigue until
            which they rest after each repetition of it.
        reminded_at: When something was wrong last, or the hint to it was said [s].
        anew_at: When a repetition was begun anew [s].
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self.order = Order()
        self.slow_for, self.called_at, self.calls = -1, -np.inf, 0
        self.rests, self.more, self.rests_to, self.rested_from = False, 0.0, 0.0, 0.0
        self.eased = (-1, 1.0)
        self.reminded_at, self.anew_at = np.inf, -np.inf

    def stand(self) -> None:
        """Stand still."""
        self.order = replace(self.order, act="stand")

    def say(self, word: Word) -> None:
        """Say a word, unless a branch before had something to say."""
        if self.order.word == "nothing":
            self.order = replace(self.order, word=word)


class Do(Behaviour):
    """Does something at each tick, and reports what it says."""

    def __init__(self, name: str, act: Callable[[], Status]) -> None:
        super().__init__(name)
        self._act = act

    def update(self) -> Status:
        return self._act()


class Encourage(Behaviour):
    """Speaks after so long without a right repetition, in turn with the hint of the recogniser, and shows
    the exercise more slowly from then on until one is right."""

    def __init__(self, session: Lesson, intent: Intent) -> None:
        super().__init__("long without: slower, with the hint")
        self._session, self._intent = session, intent

    def update(self) -> Status:
        session, intent = self._session, self._intent
        patience = PATIENCE * session.exercise.duration
        if session.since_right < patience:
            if intent.slow_for == session.index and session.right_at > session.begun_at:
                intent.slow_for = -1
            return Status.FAILURE
        intent.slow_for = session.index
        if session.time - intent.called_at >= AGAIN:
            intent.called_at, intent.calls = session.time, intent.calls + 1
            intent.say("hint" if session.hint and intent.calls % 2 else "encourage")
        return Status.RUNNING


class CoachTree:
    """The tree of a session, and what it orders.

    Attributes:
        root: The tree.
        session: What it coaches.
    """

    def __init__(self, session: Lesson) -> None:
        """Build the tree for a session, of one person or of a group."""
        self.session = session
        self._intent = Intent()
        self.root = coach_tree(session, self._intent)

    def reset(self) -> None:
        """Begin anew."""
        self.root.stop(Status.INVALID)
        self._intent.clear()

    def tick(self) -> Order:
        """Return what the coach does in the coming step."""
        session, intent = self.session, self._intent
        slow = intent.slow_for == session.index
        intent.order = Order(tempo=(SLOWER if slow else 1.0) * session.style.tempo)
        self.root.tick_once()
        return intent.order


class Coach:
    """A coach: the tree, and a body that carries out what it orders. For a robot of your own.

    Attributes:
        tree: The tree.
        demonstration: What is being shown and said.
    """

    def __init__(self, session: Session, body: CoachBody) -> None:
        """Join a session and a body."""
        self._session = session
        self.tree, self.demonstration = CoachTree(session), Demonstration(session, body)

    def step(self, frame: Frame | None, time: float, duration: float) -> Order:
        """Take what is seen of the person, and act for the coming step.

        Args:
            frame: What a source saw; None where it saw nothing.
            time: Since the session began [s].
            duration: Length of the step [s].
        """
        self._session.see(frame, time)
        order = self.tree.tick()
        self.demonstration.perform(order, duration)
        return order


def coach_tree(session: Lesson, intent: Intent) -> Behaviour:
    """Return the tree of a session, whose leaves write into `intent`."""

    def still() -> Status:
        intent.stand()
        return Status.RUNNING

    def is_tired() -> bool:
        if not intent.rests:
            limit, tired = intent.more or session.style.tired, session.fatigue
            if session.is_spent:
                fresh = max(session.style.rests_to * RECOVERS * tired, SPENT)
                intent.eased = (session.index, fresh)
            is_between = session.judgement.finished is not None and not session.is_done
            is_eased = is_between and intent.eased[0] == session.index and not intent.more
            intent.rests = tired > limit or session.is_spent or is_eased and tired > intent.eased[1]
            intent.rested_from = session.time
            most = session.style.rests_to * session.style.tired
            intent.rests_to = most if tired > limit else intent.eased[1]
        elif session.fatigue <= intent.rests_to:
            intent.rests, intent.more = False, 0.0
        elif session.time - intent.rested_from > LONGEST_REST:
            intent.rests, intent.more = False, session.fatigue + MORE_TIRED
        return intent.rests or session.must_rest

    def rest() -> Status:
        _tell(session, intent)
        intent.order = replace(intent.order, act="rest")
        return Status.RUNNING

    return first_of(
        "coach",
        when(
            "stop", Condition("asked to stop", lambda: session.must_stop), Do("stand still", still)
        ),
        when("pause", Condition("asked to pause", lambda: session.must_pause), Do("wait", still)),
        when("rest", Condition("is tired", is_tired), Do("lower the arms", rest)),
        when("programme", *(_exercise(session, intent, k) for k in range(len(session.exercises)))),
    )


def _exercise(session: Lesson, intent: Intent, k: int) -> Behaviour:
    exercise = session.exercises[k]

    def leave() -> Status:
        intent.order = replace(intent.order, act="next")
        return Status.RUNNING

    def explain() -> Status:
        if session.is_explained:
            return Status.SUCCESS
        intent.stand()  # until what was said before is over
        intent.say("explain")
        return Status.RUNNING

    return first_of(
        exercise.name.replace("_", " "),
        Condition("done", lambda: session.index > k),
        when("skip", Condition("asked to skip", lambda: session.must_skip), Do("go on", leave)),
        when(
            "do it",
            Do("explain", explain),
            _beside(
                "coach it",
                Do("demonstrate", lambda: _demonstrate(session, intent)),
                Do("observe", lambda: _observe(session, intent)),
                first_of(
                    "encourage",
                    Condition("follows: green window", lambda: session.judgement.following),
                    Encourage(session, intent),
                    Do("give time", lambda: Status.SUCCESS),
                ),
            ),
        ),
    )


def _demonstrate(session: Lesson, intent: Intent) -> Status:
    is_alone = session.judgement.progress <= UNMOVED and session.judgement.finished is None
    begins_anew = is_alone and session.style.anew_from <= session.shown < 1.0
    if begins_anew and session.time - intent.anew_at > LET * session.exercise.duration:
        intent.anew_at = session.time
        intent.stand()
    else:
        intent.order = replace(intent.order, act="show")
    return Status.RUNNING


def _tell(session: Lesson, intent: Intent) -> bool:
    """Say how a repetition was that has just been finished; return whether one has."""
    found = session.judgement.finished
    if found is not None:
        intent.say("praise" if found.right else "hint")
        intent.reminded_at = np.inf if found.right else session.time
    return found is not None


def _observe(session: Lesson, intent: Intent) -> Status:
    if not _tell(session, intent) and not session.is_speaking:
        forgets = session.time - intent.reminded_at > session.style.reminds_after
        if session.away_for > session.style.calls_after or (forgets and session.hint):
            intent.say("hint" if session.hint else "encourage")
            intent.reminded_at = session.time if forgets else intent.reminded_at
    if session.is_done:  # the present one: go on to the next in the coming step
        intent.order = replace(intent.order, act="next")
        return Status.SUCCESS
    return Status.RUNNING


def _beside(name: str, *children: Behaviour) -> Parallel:
    policy = ParallelPolicy.SuccessOnSelected(children=[children[1]], synchronise=False)
    return Parallel(name, policy=policy, children=list(children))
