"""How well a recogniser tells right from wrong over synthetic people: shares, confusions, latency."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import numpy as np

from rcare_marl.agents.coaching.exercise import Exercise, exercise_names, load_exercises
from rcare_marl.agents.coaching.recognition.recogniser import Recogniser, Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.errors import ConfigError, check_name

from ..evaluation.evaluate import wilson_interval
from ..workers import run_all
from .camera_sensor import CameraSensor
from .landmark_sensor import LandmarksSensor
from .noise import HandsSensor, JointsSensor, NoiseModel, Sensor
from .performance import GRADED, USED, WRONG, Performance, idle, perform, perform_at
from .synthetic_user import SPLITS, SyntheticUser, draw_person

RIGHT_REPETITIONS = 3  # of each exercise by each person
IDLE_TIME = 20.0  # of each person with each exercise [s]
LATE = 0.75  # a verdict later than this after the end of a repetition is none [s]
REMINDERS = frozenset(("no_movement", "not_seen"))
UNSEEN = "nothing"

SENSORS: Mapping[str, Callable[[NoiseModel], Sensor]] = {
    "hands": HandsSensor,
    "joints": JointsSensor,
    "landmarks": LandmarksSensor,
    "camera": CameraSensor,
}
# [1/s] A NAO's camera gives thirty pictures of this size at best, over a network about half; our own choice.
RATES: Mapping[str, float] = {"camera": 15.0}


def usual_noise(source: str) -> NoiseModel:
    """Return the noise that a source is evaluated with; a camera's has 15 pictures a second."""
    return NoiseModel(rate=RATES.get(source, NoiseModel.rate))


def make_sensor(source: str, noise: NoiseModel) -> Sensor:
    """Return the sensors of a source of poses.

    Raises:
        UnknownNameError: If there is no such source.
    """
    check_name("source of poses", source, SENSORS)
    return SENSORS[source](noise)


@dataclass(frozen=True)
class Trial:
    """One performance and what was made of it.

    Attributes:
        user: Number of the person.
        exercise: What was asked.
        kind: How it was done.
        recognised: Right repetitions that were recognised; of a wrong performance, whether it was detected.
        count: Right repetitions there were; 1 of a wrong performance.
        verdicts: What was said, in its order: `right` or the error named first.
        latencies: From the end of each repetition to its verdict [s].
        false_alarms: Wrong verdicts on somebody who does right; `right` on somebody who does nothing.
        seconds: How long it went on [s].
        used: How much of the limit `kind` it was made to use; None if it was not made at a distance.
    """

    user: int
    exercise: str
    kind: str
    recognised: int
    count: int
    verdicts: tuple[str, ...]
    latencies: tuple[float, ...]
    false_alarms: int
    seconds: float
    used: float | None = None


@dataclass(frozen=True)
class CoachEvaluation:
    """What came of all trials.

    Attributes:
        source: Where poses came from.
        seed: Of the people.
        split: Of the people.
        users: How many.
        noise: Of the sensors.
        trials: Each trial.
        frame_ms: Mean and 99th percentile of the time that a frame took [ms]; differs from run to run.
    """

    source: str
    seed: int
    split: str
    users: int
    noise: NoiseModel
    trials: tuple[Trial, ...]
    frame_ms: tuple[float, float] = field(default=(0.0, 0.0), compare=False)

    @property
    def right_recognised(self) -> float:
        """Share of right repetitions that were recognised."""
        return _share(self._of("right"))[0]

    @property
    def wrong_detected(self) -> float:
        """Share of wrong performances that were detected."""
        return _share(self._of(*WRONG))[0]

    def _of(self, *kinds: str) -> list[Trial]:
        return [trial for trial in self.trials if trial.kind in kinds and trial.used is None]

    def by_distance(self) -> list[dict[str, Any]]:
        """Return how often a repetition was called right that used so much of one limit, by that share."""
        out = []
        for used in sorted({trial.used for trial in self.trials if trial.used is not None}):
            found = [trial for trial in self.trials if trial.used == used]
            of_each = {kind: [t for t in found if t.kind == kind] for kind in GRADED}
            row = {"used": used, **_summary(found)}
            row["limits"] = {kind: _summary(own) for kind, own in of_each.items() if own}
            out.append(row)
        return out

    def confusion(self) -> dict[str, dict[str, int]]:
        """Return how often each kind of performance got each verdict first, by kind."""
        out: dict[str, Counter[str]] = {}
        for trial in self.trials:
            if trial.kind == "idle" or trial.used is not None:
                continue
            counts = out.setdefault(trial.kind, Counter())
            if trial.kind == "right":
                counts.update(trial.verdicts or (UNSEEN,))
            else:
                counts[trial.verdicts[0] if trial.verdicts else UNSEEN] += 1
        return {kind: dict(counts.most_common()) for kind, counts in out.items()}

    def latency(self, *kinds: str) -> dict[str, float]:
        """Return median, 95th percentile and greatest time from an end to its verdict [s].

        Args:
            kinds: Of which performances; of all if none are given.
        """
        trials = self._of(*kinds) if kinds else self.trials
        found = [value for trial in trials for value in trial.latencies]
        if not found:
            return {}
        low, high = np.percentile(found, (50, 95))
        return {
            "median_s": round(float(low), 3),
            "p95_s": round(float(high), 3),
            "greatest_s": round(max(found), 3),
            "within_half_a_second": round(float(np.mean(np.array(found) <= 0.5)), 5),
        }

    def false_alarms(self) -> dict[str, float]:
        """Return wrong verdicts a minute of right exercise, and right verdicts a minute of idling."""
        out = {}
        for name, kind in (("while_right", "right"), ("while_idle", "idle")):
            trials = self._of(kind)
            minutes = sum(trial.seconds for trial in trials) / 60
            alarms = sum(trial.false_alarms for trial in trials)
            out[f"{name}_per_minute"] = round(alarms / minutes, 4) if minutes else 0.0
        return out

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        exercises = sorted({trial.exercise for trial in self.trials})
        by_exercise = {
            name: {
                "right_recognised": _summary(t for t in self._of("right") if t.exercise == name),
                "wrong_detected": _summary(t for t in self._of(*WRONG) if t.exercise == name),
            }
            for name in exercises
        }
        return {
            **{n: getattr(self, n) for n in ("source", "seed", "split", "users")},
            "noise": dict(vars(self.noise)),
            "right_recognised": self.right_recognised,
            "right": _summary(self._of("right")),
            "wrong_detected": self.wrong_detected,
            "wrong": _summary(self._of(*WRONG)),
            "exercises": by_exercise,
            "kinds": {kind: _summary(self._of(kind)) for kind in WRONG if self._of(kind)},
            "distance": self.by_distance(),
            "confusion": self.confusion(),
            "latency": self.latency(),
            "latency_of_right": self.latency("right"),
            "false_alarms": self.false_alarms(),
            "frame_ms": {"mean": round(self.frame_ms[0], 3), "p99": round(self.frame_ms[1], 3)},
        }


def _share(trials: Iterable[Trial]) -> tuple[float, int, int]:
    found = list(trials)
    recognised, count = sum(t.recognised for t in found), sum(t.count for t in found)
    return (recognised / count if count else 0.0), recognised, count


def _summary(trials: Iterable[Trial]) -> dict[str, Any]:
    """Return a share with its 95 % interval of Wilson."""
    share, recognised, count = _share(trials)
    low, high = wilson_interval(recognised, count) if count else (0.0, 1.0)
    return {
        "share": round(share, 5),
        "of": count,
        "interval": [round(low, 5), round(high, 5)],
    }


def judge_performance(
    performance: Performance,
    user: SyntheticUser,
    sensor: Sensor,
    recogniser: Recogniser,
    rng: np.random.Generator,
    *,
    frame_times: list[float] | None = None,
) -> list[tuple[float, Repetition]]:
    """Return when each verdict fell [s, when its frame was taken], and the verdict.

    Args:
        performance: What is done.
        user: By whom.
        sensor: What sees it.
        recogniser: Who judges.
        rng: Of the sensors.
        frame_times: Where to add what each frame took [s].
    """
    source = sensor.source(user, rng)
    recogniser.begin(performance.asked)
    verdicts = []
    for taken, told, raw in sensor.readings(user, performance, rng):
        begun = time.perf_counter()
        frame = source.update(raw, float(told))
        judgement = recogniser.update(frame) if frame is not None else None
        if frame_times is not None:
            frame_times.append(time.perf_counter() - begun)
        if judgement is not None and judgement.finished is not None:
            verdicts.append((float(taken), judgement.finished))
    return verdicts


def score_trial(
    number: int, performance: Performance, verdicts: Sequence[tuple[float, Repetition]]
) -> Trial:
    """Return what the verdicts on a performance are worth."""
    said = tuple("right" if r.right else r.errors[0] for _, r in verdicts)
    latencies, recognised, false_alarms = [], 0, 0
    for start, end in performance.spans:
        of_it = [(at, r) for at, r in verdicts if r.start < end and r.end > start]
        own = [(at, r) for at, r in of_it if at <= end + LATE]
        # That nothing moved is no verdict on a repetition.
        judged = [at - end for at, r in own or of_it[:1] if not REMINDERS.intersection(r.errors)]
        latencies += judged[-1:]
        recognised += bool(own) and all(r.right for _, r in own)
    total = len(performance.spans)
    if performance.kind == "right":
        false_alarms = sum(verdict != "right" for verdict in said)
    elif performance.used is None:
        false_alarms = sum(verdict == "right" for verdict in said)
        recognised, total = int(bool(said) and "right" not in said), 1
    return Trial(
        user=number,
        exercise=performance.asked.name,
        kind=performance.kind,
        recognised=recognised,
        count=total,
        verdicts=said,
        latencies=tuple(latencies),
        false_alarms=false_alarms,
        seconds=float(performance.times[-1]),
        used=performance.used,
    )


def performances(
    user: SyntheticUser, number: int, exercises: Sequence[Exercise], rng: np.random.Generator
) -> Iterator[Performance]:
    """Yield all that one person does: each exercise right, wrong in every way, at limits, and not at all.

    How much of a limit is used goes round by the person's `number`, so that over nine people all shares of
    all limits come alike often.
    """
    names = exercise_names()
    for i, exercise in enumerate(exercises):
        for kind in ("right", *WRONG):
            often = RIGHT_REPETITIONS if kind == "right" else 1
            done = perform(user, exercise, kind, rng, others=names, repetitions=often)
            if done is not None:
                yield done
        for k, kind in enumerate(GRADED):
            used = USED[(number + 2 * i + 3 * k) % len(USED)]
            graded = perform_at(user, exercise, kind, used, rng)
            if graded is not None:
                yield graded
        yield idle(user, exercise, rng, seconds=IDLE_TIME)


@dataclass(frozen=True)
class _Lesson:
    """All that one synthetic person does before one source."""

    source: str
    number: int
    seed: int
    split: str
    noise: NoiseModel
    exercises: tuple[Exercise, ...]

    def run(self) -> tuple[list[Trial], list[float]]:
        """Return the trials, and what each frame took [s]."""
        user = draw_person(self.number, seed=self.seed, split=self.split)
        rng = np.random.default_rng((SPLITS.index(self.split), self.seed, self.number, 1))
        sensor, judge = make_sensor(self.source, self.noise), RuleRecogniser()
        trials, frame_times = [], list[float]()
        for performance in performances(user, self.number, self.exercises, rng):
            verdicts = judge_performance(
                performance, user, sensor, judge, rng, frame_times=frame_times
            )
            trials.append(score_trial(self.number, performance, verdicts))
        return trials, frame_times


def evaluate_coach(
    *,
    source: str = "hands",
    users: int = 40,
    seed: int = 0,
    split: str = "test",
    noise: NoiseModel | None = None,
    exercises: Sequence[Exercise] | None = None,
    processes: int = 1,
    progress: Callable[[int], None] | None = None,
) -> CoachEvaluation:
    """Evaluate a recogniser over synthetic people; the same arguments give the same trials.

    Args:
        source: Where poses come from, of `SENSORS`.
        users: How many people.
        seed: Of the people and all they do.
        split: `development` or `test`: nobody is in both.
        noise: Of the sensors; `usual_noise` if None.
        exercises: What is done; all there are if None.
        processes: How many people at once; the trials are the same whatever it is.
        progress: Told how many people are done.

    Raises:
        UnknownNameError: If there is no such source.
        ConfigError: If nobody is to be evaluated, or there is no such split.
    """
    if users < 1:
        raise ConfigError(f"an evaluation needs at least one person, got {users}")
    if split not in SPLITS:
        raise ConfigError(f"split is one of {', '.join(SPLITS)}, got {split!r}")
    make_sensor(source, NoiseModel())  # refuses what is unknown before anything is begun
    noise = usual_noise(source) if noise is None else noise
    chosen = tuple(load_exercises() if exercises is None else exercises)
    lessons = [_Lesson(source, i, seed, split, noise, chosen) for i in range(users)]
    finished = count(1)
    tell = progress or (lambda _: None)
    done = run_all([each.run for each in lessons], processes, lambda _: tell(next(finished)))
    taken = 1e3 * np.array([value for _, times in done for value in times])
    return CoachEvaluation(
        source=source,
        seed=seed,
        split=split,
        users=users,
        noise=noise,
        trials=tuple(trial for trials, _ in done for trial in trials),
        frame_ms=(float(taken.mean()), float(np.percentile(taken, 99))),
    )


def noise_levels(source: str, levels: Sequence[float]) -> Mapping[float, NoiseModel]:
    """Return noise that grows: every figure of a source's usual noise but the rate, times each level.

    Args:
        source: Where poses come from.
        levels: Factors of 1 cm, 2 degrees, 0.6 pixels, 4 ms and 3 ms of clocks, and 5 % drop-outs.

    Raises:
        ConfigError: If a level is not positive.
    """
    usual = usual_noise(source)
    for level in levels:
        if not (np.isfinite(level) and level > 0):
            raise ConfigError(f"a level of noise must be positive, got {level}")
    return {level: usual.scaled(level, *usual.GROWING) for level in levels}
