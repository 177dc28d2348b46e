"""A person who learns exercises from a coach: watches, imitates after a while, errs, tires and drifts off.

What kind of learner it is, is data (`learner_kind.py`); what makes them a particular one comes from the
generator of the episode. All figures are our own choice; none is measured on people.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Literal, Protocol

import numpy as np

from rcare_marl.agents.coaching.imitation import SHOULDER, Imitation
from rcare_marl.agents.coaching.session import Session, Word
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX, SIDES
from rcare_marl.agents.people.actuation.actuation import MAX_SPEED
from rcare_marl.agents.people.actuation.muscular import MuscleDrive
from rcare_marl.agents.people.body.skeleton import DOF_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array

from .learner_kind import LearnerKind

Mistake = Literal["none", "half", "one arm", "other plane"]

HALF, ANOTHER_PLANE = 0.5, math.radians(55.0)
BEGINS = math.radians(3.0)  # from rest, up to which a demonstration counts as just begun
LOOKS_AWAY = math.radians(25.0)
# Chance that a word sets a misunderstanding right, and that it brings attention back.
MENDS: Mapping[Word, float] = {
    "nothing": 0.0,
    "explain": 0.3,
    "encourage": 0.15,
    "praise": 0.0,
    "hint": 0.7,
}
CALLS: Mapping[Word, float] = {
    "nothing": 0.0,
    "explain": 0.9,
    "encourage": 0.9,
    "praise": 0.6,
    "hint": 0.9,
}
SEEN_AGAIN = 0.2  # chance that one more demonstration does it
WEARY_FROM, WEARY_SIZE = (
    0.5,
    0.7,
)  # fatigue from which movements shrink, and to what share at the worst
# With muscles: who feels that a limb hangs back behind what they mean means more, by so much of what is
# missing each second [1/s], and by so much at most [rad].
MEANS_MORE, MOST_MORE = 2.0, math.radians(15.0)

# Elevation of an arm up to which it hangs as it did at the start, clear of wheels and cushion, and from which
# it is as shown; both are less where it is to rise less.
HANGS, IS_CLEAR = math.radians(25.0), math.radians(50.0)
BARELY = math.radians(1.0)  # an arm that is to rise less hangs


class Shown(Protocol):
    """What a learner sees and hears of a coach."""

    @property
    def count(self) -> int:
        """Repetitions that have been shown to their end, of the present exercise."""

    @property
    def angles(self) -> Array:
        """What is shown now [rad], shape [16]."""

    @property
    def word(self) -> Word:
        """What is being said."""

    @property
    def is_speaking(self) -> bool:
        """Whether it is still being said."""


class Instruction(Protocol):
    """What a learner knows of a lesson.

    Attributes:
        session: Which exercise is on, and the clock.
    """

    session: Session

    @property
    def kind(self) -> LearnerKind:
        """Which kind of learner this episode asks for."""

    @property
    def demonstration(self) -> Shown:
        """What the coach shows and says."""


class Learner:
    """A policy that imitates a coach.

    Attributes:
        mistake: How the present exercise is misunderstood.
        is_attentive: Whether the coach is being watched.
        waits: Whether the learner waits for the next demonstration to begin, to join in there.
    """

    def __init__(self, person: Human, lesson: Instruction, control_dt: float) -> None:
        """Prepare the policy.

        Args:
            person: Who learns.
            lesson: What they see and hear.
            control_dt: Length of a control step [s].
        """
        self._person, self._lesson, self._control_dt = person, lesson, control_dt
        self._limits: dict[str, tuple[float, float]] = dict(
            zip(person.movable, map(tuple, person.active.tolist()), strict=True)
        )
        self._imitation = Imitation(self._limits)
        self._index = {dof: i for i, dof in enumerate(person.movable)}

    def reset(self, rng: np.random.Generator) -> None:
        self._rng, self._kind = rng, self._lesson.kind
        self._delay = float(rng.uniform(*self._kind.delay))
        self._size = float(rng.uniform(*self._kind.size))
        self._drifts_after = float(rng.uniform(*self._kind.drifts_after))
        self._away = LOOKS_AWAY * (1.0 if rng.random() < 0.5 else -1.0)
        self.is_attentive, self.waits = True, True
        self.mistake: Mistake = "none"
        self._exercise, self._seen_count, self._was_speaking = -1, 0, False
        self._memory: deque[tuple[float, Array]] = deque()
        self._imitation.reset()
        self._more = np.zeros(len(self._index))
        slow, fast = self._kind.speed
        self._most = self._control_dt * (float(rng.uniform(slow, fast)) if slow < fast else slow)
        self._followed: Array | None = None  # what was shown, as fast as it is followed

    def act(self) -> Array:
        session, shown = self._lesson.session, self._lesson.demonstration
        self._begin_exercise(session)
        self._listen(shown)
        self._drift()
        self._memory.append((session.time, shown.angles))
        while len(self._memory) > 1 and self._memory[1][0] <= session.time - self._delay:
            self._memory.popleft()
        rest = session.exercise.angles(0.0)
        shown_then = self._follow(self._memory[0][1])
        at_rest = float(np.abs(shown_then - rest).max()) < BEGINS
        self.waits = not self.is_attentive or (self.waits and not at_rest)
        wished = rest.copy() if self.waits else self._understood(shown_then, rest)
        if not self.is_attentive and "head" not in session.exercise.parts:
            wished[MOTION_INDEX["neck_rotation_left"]] += self._away
        dofs = self._imitation(wished)
        self._hang(wished, dofs)
        if isinstance(self._person.drive, MuscleDrive):
            self._mean_more(dofs)
        self._keep_together(dofs)
        return self._person.action_towards(dofs, self._control_dt)

    def _follow(self, shown: Array) -> Array:
        """Return how far somebody of this speed has come of what was shown [rad], shape [16]."""
        before = shown if self._followed is None else self._followed
        self._followed = before + np.clip(shown - before, -self._most, self._most)
        return self._followed

    def _begin_exercise(self, session: Session) -> None:
        if session.index == self._exercise:
            return
        self._exercise, self._seen_count, self.waits = session.index, 0, True
        self.mistake = "none"
        if self._rng.random() < self._kind.slips:
            arms = [part for part in session.exercise.parts if part.endswith("arm")]
            kinds: list[Mistake] = ["half"]
            kinds += ["one arm"] if len(arms) == 2 else []
            kinds += ["other plane"] if arms else []
            self.mistake = kinds[int(self._rng.integers(len(kinds)))]

    def _listen(self, shown: Shown) -> None:
        """Hear a word when it begins, and see one more demonstration when it ends."""
        begins = shown.is_speaking and not self._was_speaking
        self._was_speaking = shown.is_speaking
        if begins:
            if self._rng.random() < self._kind.heeds * MENDS[shown.word]:
                self.mistake = "none"
            if self._rng.random() < CALLS[shown.word]:
                self.is_attentive = True
        if shown.count > self._seen_count:
            self._seen_count = shown.count
            if self.is_attentive and self._rng.random() < self._kind.heeds * SEEN_AGAIN:
                self.mistake = "none"

    def _drift(self) -> None:
        after = self._drifts_after if self.is_attentive else self._kind.returns_after
        if self._rng.random() < self._control_dt / after:
            self.is_attentive = not self.is_attentive

    def _understood(self, shown: Array, rest: Array) -> Array:
        """Return what the learner means to do when that is shown [rad], shape [16]."""
        weary = (self._lesson.session.fatigue - WEARY_FROM) / (1.0 - WEARY_FROM)
        size = self._size * (1.0 - (1.0 - WEARY_SIZE) * min(max(weary, 0.0), 1.0))
        size *= max(1.0 - self._kind.flinches * self._person.physiology.pain, HALF)
        if self.mistake == "half":
            size *= HALF
        meant: Array = rest + size * (shown - rest)
        if self.mistake == "one arm":
            meant[ARM["left"]] = rest[ARM["left"]]
        elif self.mistake == "other plane":
            for side in SIDES:
                plane = ARM[side].start + 1
                turn = -ANOTHER_PLANE if rest[plane] + shown[plane] > math.pi / 2 else ANOTHER_PLANE
                meant[plane] += turn
        return meant

    def _hang(self, wished: Array, dofs: dict[str, float]) -> None:
        """Let arms hang as they did at the start when they are meant to hang, the less the more they rise."""
        person = self._person
        keys = self._lesson.session.exercise.keys
        hung = Imitation(self._limits)(keys[0])
        for side in SIDES:
            elevations = keys[:, ARM[side].start]
            risen = elevations[elevations > elevations[0] + BARELY]
            high = min(IS_CLEAR, float(risen.min())) if len(risen) else elevations[0] + BARELY
            low = min(HANGS, 0.5 * (float(elevations[0]) + high))
            up = (float(wished[ARM[side].start]) - low) / (high - low)
            share = 1.0 - min(max(up, 0.0), 1.0)
            for dof in (name for name in dofs if name.startswith(side)):
                own = float(person.angles[DOF_INDEX[dof]]) - hung[dof]
                angle = dofs[dof] + share * own
                dofs[dof] = min(max(angle, self._limits[dof][0]), self._limits[dof][1])

    def _mean_more(self, dofs: dict[str, float]) -> None:
        """Aim beyond what is meant where muscles have long stayed behind it."""
        gain = MEANS_MORE * self._control_dt
        for dof, angle in dofs.items():
            i = self._index[dof]
            more = self._more[i] + gain * (angle - self._person.positions[i])
            self._more[i] = min(max(more, -MOST_MORE), MOST_MORE)
            dofs[dof] += float(self._more[i])

    def _keep_together(self, dofs: dict[str, float]) -> None:
        """Let abduction and flexion of a shoulder arrive together, or the arm would swing about."""
        target = self._person.drive.target
        most = MAX_SPEED * self._control_dt
        for side in SIDES:
            pair = [f"{side}_{name}" for name in SHOULDER[:2]]
            if pair[0] not in dofs:
                continue
            ways = {dof: dofs[dof] - float(target[self._index[dof]]) for dof in pair}
            share = min(1.0, most / max(*map(abs, ways.values()), 1e-9))
            for dof, way in ways.items():
                dofs[dof] -= (1.0 - share) * way
