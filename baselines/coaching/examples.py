"""Repetitions of synthetic people with what they were, for a network to learn from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.coaching.exercise import Exercise, Reach, exercise_names, load_exercises
from rcare_marl.agents.coaching.recognition.recogniser import Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.recognition.segmenter import Segment
from rcare_marl.agents.coaching.recognition.template import Template
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX, MOTIONS, SIDES

from ..workers import run_all
from .encoding import Floats, encode
from .evaluation import judge_performance, make_sensor, usual_noise
from .learned_recogniser import CLASSES
from .performance import WRONG, Performance, idle, perform
from .synthetic_user import SPLITS, SyntheticUser, draw_person

ERROR_OF = {
    "one_arm": "one_side",
    "half_range": "range",
    "wrong_plane": "direction",
    "too_fast": "too_fast",
    "asymmetric": "asymmetric",
    "one_after_other": "asymmetric",
    "trunk_lean": "trunk_lean",
    "trunk_turn": "trunk_turn",
    "bent_elbows": "bent_elbows",
    "unknown_movement": "unknown_movement",
    "wrong_arm": "wrong_side",
    "other_exercise": "other_exercise",
}
WRONG_SOMEHOW = -1  # something else than the exercise, of no kind
# All our own choice.
RIGHT_REPETITIONS = 8
IDLE_TIME = 12.0  # [s]
ADAPTED = 0.4  # share of the exercises that are adapted to a reach and shown faster or slower
NOISES = (0.5, 1.6)  # of the sensors, times the usual


@dataclass(frozen=True, eq=False)
class Examples:
    """Repetitions and what they were.

    Attributes:
        sequences: Shape [n, 96, 48].
        facts: Shape [n, 13].
        labels: Of `CLASSES`, or `WRONG_SOMEHOW`, shape [n].
        people: Who did it, shape [n].
    """

    sequences: Floats
    facts: Floats
    labels: npt.NDArray[np.int64]
    people: npt.NDArray[np.int64]


class _Watcher(RuleRecogniser):
    """Recognition by rules that keeps what it judged."""

    def begin(self, exercise: Exercise) -> None:
        super().begin(exercise)
        self.kept: list[tuple[float, float, Floats, Floats]] = []

    def _judged(self, template: Template, segment: Segment) -> Repetition | None:
        found = super()._judged(template, segment)
        if found is not None and found.errors[:1] != ("not_seen",):
            self.kept.append((segment.start, segment.end, *encode(segment, template)))
        return found


def _reach(rng: np.random.Generator) -> Reach:
    """Return what somebody with stiff joints reaches: of some, part of what an exercise asks for."""
    low, high = np.full(len(MOTIONS), -np.pi), np.full(len(MOTIONS), np.pi)
    for side in SIDES:
        high[ARM[side].start] = np.radians(rng.uniform(60, 170))
    turn = np.radians(rng.uniform(25, 60))
    column = MOTION_INDEX["neck_rotation_left"]
    low[column], high[column] = -turn, turn
    return Reach(low, high)


def _exercises(rng: np.random.Generator) -> Iterator[Exercise]:
    for exercise in load_exercises():
        if rng.random() < ADAPTED:
            changed = exercise.adapted(_reach(rng)).faster(float(rng.uniform(0.6, 1.3)))
            yield changed if changed.can_do else exercise
        else:
            yield exercise


def _performances(
    user: SyntheticUser, exercise: Exercise, rng: np.random.Generator
) -> Iterator[tuple[Performance, int]]:
    """Yield what a person does with an exercise, and what that is of `CLASSES`."""
    names = exercise_names()
    for kind in ("right", *WRONG):
        if kind == "standing_still":
            continue
        often = RIGHT_REPETITIONS if kind == "right" else 1
        done = perform(user, exercise, kind, rng, others=names, repetitions=often)
        if done is None:
            continue
        is_head = exercise.parts == ("head",)
        error = "arms_only" if is_head else "head_only"
        yield done, CLASSES.index("right" if kind == "right" else ERROR_OF.get(kind, error))
    yield idle(user, exercise, rng, seconds=IDLE_TIME), WRONG_SOMEHOW


def examples_of(number: int, source: str, seed: int) -> Examples:
    """Return the repetitions of one person of the development split, seen by one source."""
    user = draw_person(number, seed=seed, split="development")
    rng = np.random.default_rng((SPLITS.index("development"), seed, number, 2))
    level = float(rng.uniform(*NOISES))
    noise = usual_noise(source).scaled(level, "position", "angle_deg", "dropout", "pixel")
    sensor, watcher = make_sensor(source, noise), _Watcher()
    found: list[tuple[Floats, Floats, int]] = []
    for exercise in _exercises(rng):
        for performance, label in _performances(user, exercise, rng):
            judge_performance(performance, user, sensor, watcher, rng)
            for start, end, sequence, facts in watcher.kept:
                belongs = any(start < b and end > a for a, b in performance.spans)
                if belongs or label == WRONG_SOMEHOW:
                    found.append((sequence, facts, label))
    return Examples(
        np.stack([sequence for sequence, _, _ in found]),
        np.stack([facts for _, facts, _ in found]),
        np.array([label for *_, label in found]),
        np.full(len(found), number),
    )


def gather(
    people: dict[str, int], *, seed: int, processes: int, progress: Callable[[int], None]
) -> Examples:
    """Return the repetitions of many people, so many of each source; the same for the same seed."""
    wanted = [(source, i) for source, many in people.items() for i in range(many)]
    numbered = [(number, source) for number, (source, _) in enumerate(wanted)]
    calls = [partial(examples_of, number, source, seed) for number, source in numbered]
    finished = count(1)
    done = run_all(calls, processes, lambda _: progress(next(finished)))
    return Examples(
        *(
            np.concatenate([getattr(each, name) for each in done])
            for name in ("sequences", "facts", "labels", "people")
        )
    )
