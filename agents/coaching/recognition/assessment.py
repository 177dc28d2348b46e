"""Measures one repetition: how far, which way, how even, how fast, and what else moved."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d  # type: ignore[import-untyped]

from rcare_marl.pose import Array

from ...people.motion.clip import rotation_between
from ..exercise import Demand
from ..upper_body import ARM, SIDES
from .segmenter import Segment
from .template import (
    ANGLE_COLUMN,
    COLUMN,
    MOVING,
    RATE,
    STARTED,
    VECTORS,
    Template,
    Way,
    arc,
    between,
    off_path,
)

# All our own choice.
MOSTLY = 92  # percentile that stands for the greatest of something that may be noisy
BEST_FRAMES = 4  # so many frames must have got as far
SMOOTHED = 5  # frames of the running mean
ATTEMPTED = 0.3  # share of the way below which a key pose was not tried
MUCH_MORE_ALIKE = 0.25  # by so much a movement that is another exercise is more like it
SEEN = 0.5  # share of frames in which a part has to be seen
ALL = 1.05  # share of the way from which it was gone
OUT = 0.6  # share of the greatest excursion from which a movement is out
ON_THE_WAY = (0.25, 0.5, 0.7)  # where arms are compared: who is late is so all along
WIDTH = math.radians(50)  # of the path in a likeness
GENTLE = (
    0.6  # a movement that leaves the path by less than this share of what is allowed keeps to it
)

# Columns of a row that a source sees or misses together: upper arms, wrists and elbows, head, trunk.
PARTS_OF_ROW = (
    *(np.r_[COLUMN[f"{side}_arm"]] for side in ("left", "right")),
    *(np.r_[COLUMN[f"{side}_wrist"], ANGLE_COLUMN[f"{side}_elbow"]] for side in ("left", "right")),
    np.r_[COLUMN["head"], COLUMN["crown"]],
    np.r_[COLUMN["trunk"]],
    np.r_[ANGLE_COLUMN["trunk_rotation"]],
)


@dataclass(frozen=True, eq=False)
class Motion:
    """A segment at an even rate, smoothed; of each vector its directions [n, 3], NaN if it was not seen."""

    vectors: Mapping[str, Array]
    angles: Mapping[str, Array]
    rest: Mapping[str, Array]
    rest_angles: Mapping[str, float]
    unsure: Array

    @classmethod
    def of(cls, segment: Segment) -> Motion:
        """Return the motion of a segment."""
        times = np.arange(segment.times[0], segment.times[-1] + 0.5 / RATE, 1 / RATE)
        rows = np.full((len(times), segment.rows.shape[1]), np.nan)
        known = np.isfinite(segment.rows)
        for columns in PARTS_OF_ROW:  # what is seen together is missing together
            seen = known[:, columns].all(axis=1)
            if seen.mean() < SEEN:
                continue
            for column in columns:
                rows[:, column] = np.interp(times, segment.times[seen], segment.rows[seen, column])
        rows = _smooth(rows)
        vectors = {}
        for name in VECTORS:
            values = rows[:, COLUMN[name]]
            if not name.endswith("wrist"):
                values = values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-9)
            vectors[name] = values
        rest = {}
        for name in VECTORS:
            value = segment.rest[COLUMN[name]]
            is_unit = not name.endswith("wrist") and np.isfinite(value).all()
            rest[name] = value / max(float(np.linalg.norm(value)), 1e-9) if is_unit else value
        angles = {name: rows[:, column] for name, column in ANGLE_COLUMN.items()}
        at_rest = {name: float(segment.rest[column]) for name, column in ANGLE_COLUMN.items()}
        return cls(vectors, angles, rest, at_rest, segment.unsure)

    def seen(self, part: str) -> bool:
        """Return whether a part was seen."""
        return bool(np.isfinite(self.vectors[part]).all() and np.isfinite(self.rest[part]).all())

    def excursion(self, part: str) -> Array:
        """Return how far a part was from rest [rad], shape [n]; 0 if it was not seen."""
        if not self.seen(part):
            return np.zeros(len(self.vectors[part]))
        return between(self.vectors[part], self.rest[part])

    def wrist_excursion(self, side: str) -> float:
        """Return how far a wrist went from rest as a share of the arm's length; 0 if it was not seen."""
        gap = self.vectors[f"{side}_wrist"] - self.rest[f"{side}_wrist"]
        return most(np.linalg.norm(gap, axis=1)) if np.isfinite(gap).all() else 0.0


def _smooth(rows: Array) -> Array:
    """Return the running mean of `SMOOTHED` frames of a running median of three."""
    middle = median_filter(rows, (3, 1), mode="nearest")
    return np.asarray(uniform_filter1d(middle, SMOOTHED, axis=0, mode="nearest"))


def most(values: Array) -> float:
    """Return nearly the greatest of values, such that a few bad frames do not count."""
    if not len(values):
        return 0.0
    k = int(MOSTLY / 100 * (len(values) - 1))
    return float(np.partition(values, k)[k])


@dataclass(frozen=True)
class WayMeasure:
    """What one part made of its way.

    Attributes:
        shares: Of the way to each key pose.
        away: How far it left the path [rad].
        allowed: How far it may [rad].
        reached: When it was at each of `ON_THE_WAY` to the first key pose, in frames; empty if it never was.
        excursion: How far it got from its rest [rad].
        against: How far it went the other way, as a share of the first phase.
        scale: What counts as all of the shortest way to a key pose [rad].
        beyond: How far it went beyond a key pose [rad].
    """

    shares: tuple[float, ...]
    away: float
    allowed: float
    reached: tuple[int, ...]
    excursion: float
    against: float
    scale: float = 1.0
    beyond: float = 0.0

    @property
    def least(self) -> float:
        """The share of the key pose that was reached worst."""
        return min(self.shares, default=1.0)

    @property
    def greatest(self) -> float:
        """The share of the key pose that was reached best."""
        return max(self.shares, default=1.0)

    @property
    def likeness(self) -> float:
        """How much it was like the way asked for, 0 to 1."""
        went = float(np.mean([min(max(share, 0.0), 1.0) for share in self.shares] or [1.0]))
        return went * math.exp(-((self.away / WIDTH) ** 2))


def measure_way(way: Way, motion: Motion, demand: Demand) -> WayMeasure:
    """Measure what a part made of its way."""
    directions, rest = motion.vectors[way.part], motion.rest[way.part]
    if way.part == "head":  # where somebody looks at rest is ahead
        directions, rest = directions @ rotation_between(rest, way.rest).T, way.rest
    shares: list[float] = []
    # Only the first way begins at a person's own rest.
    scales = [p.scale if k else p.scale_from(rest) for k, p in enumerate(way.phases)]
    reached, against, since = tuple[int, ...](), 0.0, 0
    for k, phase in enumerate(way.phases):
        if shares and shares[-1] < ATTEMPTED:
            shares.append(0.0)  # without the key pose before it, it was not tried
            continue
        share, first = _attained(phase.share(directions[since:], scales[k]))
        if k == 0:
            # Who rests with an arm forward is on the way already.
            begun = float(np.clip(phase.share(rest), 0.0, 0.8))
            gone = phase.share(directions)
            at = [np.flatnonzero(gone >= begun + on * (1.0 - begun)) for on in ON_THE_WAY]
            reached = tuple(int(each[0]) for each in at) if len(at[-1]) else ()
            against = most(-phase.share(directions))
        shares.append(share)
        since += first
    # Everybody comes from their own rest and goes back to it: they join the path a third of the way out.
    out = np.flatnonzero(between(way.path, way.rest) >= 0.35 * way.excursion)
    ends = (way.path[out[0]], way.path[out[-1]]) if len(out) else (way.rest, way.rest)
    path = np.concatenate((way.path, arc(rest, ends[0]), arc(ends[1], rest)))
    moving = motion.excursion(way.part)
    away = most(off_path(directions[moving > 0.3 * moving.max(initial=0.0)], path))
    allowed = min(math.radians(demand.plane_deg), max(0.6 * way.excursion, math.radians(12)))
    return WayMeasure(
        tuple(shares),
        away,
        allowed,
        reached,
        float(moving.max(initial=0.0)),
        against,
        min(scales, default=1.0),
        max(((share - 1.0) * x for share, x in zip(shares, scales, strict=True)), default=0.0),
    )


def _attained(shares: Array) -> tuple[float, int]:
    """Return the share of a phase that was reached, and after how many frames it nearly was."""
    count = min(BEST_FRAMES, len(shares))
    best = float(np.partition(shares, len(shares) - count)[-count]) if count else 0.0
    near = np.flatnonzero(shares >= 0.9 * min(best, 1.0))
    return best, int(near[0]) if len(near) and best > ATTEMPTED else 0


@dataclass(frozen=True)
class Assessment:
    """What was measured of a repetition against one exercise.

    Attributes:
        ways: Of each part that had to move and was seen.
        unseen: Parts that had to move and were not seen.
        tempo: Duration against the one shown.
        elbow: How much more than shown an elbow was bent at worst [rad].
        lean: How far the trunk leaned [rad].
        turn: How far it turned [rad].
        head: How far the head nodded or tilted that had no part [rad].
        gaze: How far it turned [rad].
        arm: How far an arm moved that had no part [rad].
        unsure: Standard deviations of what the source told [rad]: of `arm` (where it points), `elbow`,
            `lean`, `turn` and `head`.
    """

    ways: Mapping[str, WayMeasure]
    unseen: tuple[str, ...]
    tempo: float
    elbow: float
    lean: float
    turn: float
    head: float
    gaze: float
    arm: float
    unsure: Mapping[str, float]
    demand: Demand = field(default_factory=Demand)

    @property
    def likeness(self) -> float:
        """How much the movement is like the exercise, 0 to 1."""
        found = [way.likeness for way in self.ways.values()]
        return float(np.mean(found or [0.0])) * _undisturbed(self.arm, self.demand)

    @property
    def keeps_to_path(self) -> bool:
        """Whether what moved was on the way."""
        moved = [way for way in self.ways.values() if way.greatest > ATTEMPTED]
        return bool(moved) and all(way.away < GENTLE * way.allowed for way in moved)

    def measures(self) -> dict[str, float]:
        """Return the numbers by name, angles in degrees."""
        out = {
            "tempo": self.tempo,
            "likeness": self.likeness,
            "elbow_deg": math.degrees(self.elbow),
            "lean_deg": math.degrees(self.lean),
            "turn_deg": math.degrees(self.turn),
            "head_deg": math.degrees(self.head),
            "gaze_deg": math.degrees(self.gaze),
            "arm_deg": math.degrees(self.arm),
        }
        for part, way in self.ways.items():
            out[f"{part}_range"] = way.least
            out[f"{part}_deg"] = math.degrees(way.excursion)
            out[f"{part}_away_deg"] = math.degrees(way.away)
        if len(self.ways) == 2:
            left, right = self.ways.values()
            out["uneven"] = unevenness(left.shares, right.shares)
        return out


def likeness_of(template: Template, motion: Motion) -> float:
    """Return how much a motion is like an exercise, 0 to 1."""
    if not all(motion.seen(part) for part in template.ways):
        return 0.0
    demand = template.exercise.judged
    found = [measure_way(way, motion, demand).likeness for way in template.ways.values()]
    idle = (p for p in MOVING if p != "head" and p not in template.ways)
    arm = max((most(motion.excursion(part)) for part in idle), default=0.0)
    return float(np.mean(found)) * _undisturbed(arm, demand)


def _undisturbed(arm: float, demand: Demand) -> float:
    """Return 1, or less the further an arm moved [rad] that had no part in an exercise."""
    besides = max(arm - math.radians(demand.still_deg), 0.0)
    return math.exp(-((besides / WIDTH) ** 2))


def assess(template: Template, motion: Motion) -> Assessment:
    """Measure a motion against an exercise."""
    demand = template.exercise.judged
    seen = {part: way for part, way in template.ways.items() if motion.seen(part)}
    ways = {part: measure_way(way, motion, demand) for part, way in seen.items()}
    idle_arms = [p for p in MOVING if p != "head" and p not in template.ways]
    has_head = "head" in template.ways
    return Assessment(
        ways=ways,
        unseen=tuple(part for part in template.ways if part not in seen),
        tempo=_moving_time(motion, ways) / template.moving_time,
        elbow=max((_bend(template, motion, p) for p in template.arms), default=0.0),
        lean=most(motion.excursion("trunk")),
        turn=_turn(motion, ways),
        head=0.0 if has_head else most(motion.excursion("crown")),
        gaze=0.0 if has_head else most(motion.excursion("head")),
        arm=max((_arm_excursion(motion, part) for part in idle_arms), default=0.0),
        unsure=_unsure(template, motion),
        demand=demand,
    )


def _unsure(template: Template, motion: Motion) -> dict[str, float]:
    """Return how unsure the source was of each kind of angle [rad], of the arms that have to move."""
    sides = [part.removesuffix("_arm") for part in template.arms] or list(SIDES)
    sd = motion.unsure
    return {
        "arm": max(float(sd[ARM[side].start]) for side in sides),
        "elbow": max(float(sd[ARM[side].start + 3]) for side in sides),
        "lean": float(sd[:2].max()),
        "turn": float(sd[2]),
        "head": float(sd[3:6].max()),
    }


def _moving_time(motion: Motion, ways: Iterable[str]) -> float:
    """Return the time from where a movement has begun to where it is nearly back [s]."""
    excursions = [motion.excursion(part) for part in ways]
    shares = [e / e.max() for e in excursions if e.max(initial=0.0) > math.radians(8)]
    moved = np.flatnonzero(np.max(shares, axis=0) > STARTED) if shares else np.zeros(1)
    return float(moved[-1] - moved[0] + 1) / RATE


def _bend(template: Template, motion: Motion, part: str) -> float:
    """Return how much more than shown an elbow was bent where its arm was raised most [rad]."""
    side = part.removesuffix("_arm")
    flexion, raised = motion.angles[f"{side}_elbow"], motion.excursion(part)
    if not np.isfinite(flexion).all() or raised.max(initial=0.0) < math.radians(20):
        return 0.0
    return float(np.median(flexion[raised > 0.8 * raised.max()])) - template.elbows[side]


def _turn(motion: Motion, ways: Iterable[str]) -> float:
    """Return how far the trunk was turned while the movement was out, not only in passing [rad]."""
    turned = np.abs(motion.angles["trunk_rotation"] - motion.rest_angles["trunk_rotation"])
    if not np.isfinite(turned).all():
        return 0.0
    excursions = [motion.excursion(part) for part in ways]
    out = np.max(excursions, axis=0) if excursions else turned
    return float(np.percentile(turned[out >= OUT * out.max()], 75))


def _arm_excursion(motion: Motion, part: str) -> float:
    upper = most(motion.excursion(part))
    return max(upper, motion.wrist_excursion(part.removesuffix("_arm")))


def unevenness(left: tuple[float, ...], right: tuple[float, ...]) -> float:
    """Return by which share one arm fell behind the other on the way to some key pose."""
    worst = 0.0
    for a, b in zip(left, right, strict=False):
        more, less = min(max(a, b), ALL), min(a, b)  # who goes too far leaves nobody behind
        if more > ATTEMPTED:
            worst = max(worst, 1.0 - max(less, 0.0) / more)
    return worst
