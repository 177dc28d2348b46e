"""Recognition by rules: the constraints that a therapist would name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rcare_marl.pose import Array

from ..exercise import Exercise, load_exercises
from .assessment import ATTEMPTED
from .recogniser import ERRORS, Frame, Judgement, Repetition
from .segmenter import Segmenter
from .template import COLUMN, Template, off_path
from .verdict import judge

# All our own choice.
WRONG_FOR = 0.3  # what is wrong so long closes the green window [s]
MENDED_FOR = 1.0  # and what is right again so long opens it [s]
PRAISED_FOR = 2.0  # the window stays green after a right repetition [s]
UNEVEN = 0.45  # difference of the arms' progress that closes it
BEGUN = 0.2  # progress from which the window may open


class RuleRecogniser:
    """Judges repetitions by predefined constraints on range, direction, symmetry, tempo and compensation."""

    def __init__(self, *, known: Sequence[Exercise] | None = None) -> None:
        """Prepare recognition.

        Args:
            known: Exercises that a movement may be taken for; all there are if None.
        """
        exercises = load_exercises() if known is None else known
        self._known = {exercise.name: Template(exercise) for exercise in exercises}
        self._segmenter = Segmenter()
        self._template: Template | None = None

    def begin_anew(self) -> None:
        """Drop half a repetition: expect the same exercise, at the same tempo, from now on."""
        assert self._template is not None  # one has begun
        self.begin(self._template.exercise)

    def begin(self, exercise: Exercise) -> None:
        """Expect an exercise from now on."""
        self._template = Template(exercise)
        self._others = {name: t for name, t in self._known.items() if name != exercise.name}
        self._segmenter.begin(self._template)
        self._patience = exercise.duration + exercise.judged.patience_s
        self._restart()
        self._praised_until = -math.inf

    def _restart(self) -> None:
        assert self._template is not None
        self._phase = dict.fromkeys(self._template.ways, 0)
        self._share = dict.fromkeys(self._template.ways, 0.0)
        self._now = dict.fromkeys(
            self._template.ways, 0.0
        )  # share of the present phase at this moment
        self._tried = dict.fromkeys(
            self._template.ways, 0
        )  # key poses of which some of the way was gone
        self._wrong_since: float | None = None
        self._is_wrong, self._fault, self._fault_at = False, "", -math.inf

    def update(self, frame: Frame) -> Judgement:
        """Take the next frame.

        Raises:
            RuntimeError: Before `begin`.
        """
        if self._template is None:
            raise RuntimeError("update of a recogniser came before begin")
        time = float(frame.time)
        moved_at = self._segmenter.moved_at
        complete, holds = self._has_reached(self._share), self._has_reached(self._now)
        segment = self._segmenter.update(
            frame, complete=complete, amid=self._is_amid(), holds=holds
        )
        if segment is not None:
            repetition = judge(self._template, self._others, segment)
            self._restart()
            if repetition is None:  # the time without a movement goes on
                self._segmenter.moved_at = moved_at
                return Judgement(time < self._praised_until)
            self._praised_until = time + PRAISED_FOR if repetition.right else -math.inf
            return Judgement(repetition.right, 1.0, repetition, repetition.words)
        if not self._segmenter.moving:
            return self._at_rest(time)
        self._watch(time)
        progress = self._progress()
        follows = not self._is_wrong and (progress > BEGUN or time < self._praised_until)
        return Judgement(follows, progress, None, ERRORS[self._fault] if self._is_wrong else "")

    def _watch(self, time: float) -> None:
        """Close the window on what is wrong for a while, open it on what is right for longer."""
        fault = self._follow(self._segmenter.now)
        if fault:
            self._fault, self._fault_at = fault, time
            self._wrong_since = time if self._wrong_since is None else self._wrong_since
            self._is_wrong = self._is_wrong or time - self._wrong_since > WRONG_FOR
        else:
            self._wrong_since = None
            self._is_wrong = self._is_wrong and time - self._fault_at < MENDED_FOR

    def _at_rest(self, time: float) -> Judgement:
        since = self._segmenter.moved_at
        if since is not None and time - since > self._patience:
            self._segmenter.moved_at = time
            lost = [
                p for p in self._ways() if not np.isfinite(self._segmenter.now[COLUMN[p]]).all()
            ]
            error = "not_seen" if lost else "no_movement"
            nothing = Repetition(since, time, False, (error,), 0.0)
            return Judgement(False, 0.0, nothing, ERRORS[error])
        return Judgement(time < self._praised_until)

    def _ways(self) -> tuple[str, ...]:
        return tuple(self._template.ways) if self._template else ()

    def _has_reached(self, shares: Mapping[str, float]) -> bool:
        """Return whether shares of the present phases are enough of the last ones."""
        assert self._template is not None
        least = self._template.exercise.judged.range_share
        return all(
            self._phase[part] == len(way.phases) - 1 and shares[part] >= least
            for part, way in self._template.ways.items()
            if way.phases
        )

    def _is_amid(self) -> bool:
        """Return whether some of the way to one key pose has been gone, and not to each."""
        assert self._template is not None
        ways = self._template.ways.items()
        return any(self._tried.values()) and any(
            self._tried[part] < len(way.phases) for part, way in ways
        )

    def _progress(self) -> float:
        """Return how far the present repetition is on its way out, by the part that lags most."""
        assert self._template is not None
        return min(
            (
                (self._phase[part] + min(max(self._share[part], 0.0), 1.0)) / len(way.phases)
                for part, way in self._template.ways.items()
                if way.phases
            ),
            default=0.0,
        )

    def _follow(self, row: Array) -> str:
        """Follow the key poses; return what is wrong at this moment, empty if nothing is."""
        assert self._template is not None
        demand = self._template.exercise.judged
        fault = ""
        for part, way in self._template.ways.items():
            direction = row[COLUMN[part]]
            if not way.phases or not math.isfinite(direction[0]):
                continue
            k = self._phase[part]
            share = float(way.phases[k].share(direction))
            self._now[part], self._share[part] = share, max(self._share[part], share)
            t = self._tried[part]
            if t < len(way.phases) and float(way.phases[t].share(direction)) >= ATTEMPTED:
                self._tried[part] = t + 1
            if self._share[part] >= 0.85 and k + 1 < len(way.phases):
                self._phase[part], self._share[part] = k + 1, 0.0
            allowed = min(math.radians(demand.plane_deg), max(0.6 * way.excursion, 0.2))
            length = math.sqrt(float(direction @ direction)) or 1.0
            if float(off_path(direction / length, way.path)) > allowed:
                fault = "direction"
        progress = [self._phase[part] + min(self._share[part], 1.0) for part in self._template.arms]
        if len(progress) == 2 and abs(progress[0] - progress[1]) > UNEVEN:
            fault = "asymmetric"
        trunk, rest = row[COLUMN["trunk"]], self._segmenter.rest[COLUMN["trunk"]]
        if float(np.linalg.norm(trunk - rest)) > math.radians(demand.lean_deg):
            fault = "trunk_lean"
        return fault
