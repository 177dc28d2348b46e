"""Finds repetitions in a stream of frames, on line: where one begins and where it ends."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from rcare_marl.pose import Array

from ..upper_body import MOTIONS
from .recogniser import Frame
from .template import COLUMN, VECTORS, Template, feature

# All our own choice.
QUICK, SLOW = 0.06, 0.2  # time constants of two running means [s]
BACK = 0.15  # the speed is what the quick one has changed since then [s]
STILL = math.radians(28)  # slower than this nothing moves [rad/s]
SLOWEST = 0.45  # nor slower than this share of the slowest move that is shown, where that is less
DWELL = 0.1  # how long rest must last at the end [s]
DWELL_AMID, NEAR_AMID = 0.15, 0.6  # and before the last key pose [s], and so much nearer to rest
# So near to rest, as a share of what is near, nothing but a speed so many times as great is a movement.
AT_REST, TREMBLES = 0.5, 2.0
# Who lays an arm down elsewhere than it was is back, too: after so long without a movement [s], no further
# from rest than this share of the way they went. A pause of a second half way is none of these.
LAID, LAID_FOR = 0.35, 0.4
ELSEWHERE, ELSEWHERE_FOR = 0.55, 1.2
BACK_SHARE = 0.45
# Who turns round near rest, or gets so much further away again, has begun the next one: shares of the way.
TURNED, LEFT_AGAIN = 0.4, 0.15
STUCK = 3.5  # who stays so much longer than shown away from rest is done [s]
KEPT = 2.0  # frames kept from before a beginning [s]
LOST = 0.7  # a part that is not seen for so long is unknown [s]
SAME = math.radians(8)  # so near to rest is rest [rad]
# Who pauses no longer [s] and is as near to rest as since then, but for so much [rad], is on the way back.
PAUSED, STILL_BACK = 2.0, math.radians(3)
SETTLING = 1.0  # after a repetition arms may settle for so long [s]
LOOKED = 0.6  # after `begin` it is looked so long how the person rests [s]
ANYWHERE = math.radians(100)  # from the rest shown, where an arm may lie that has no part
LOOKS_AWAY = math.radians(75)  # who looks elsewhere at the end is back all the same
FAR_OUT = 0.8  # share of the way from which it counts how unsure a source is of elbows
NOTED, NOTED_OUT = 0.05, 0.15  # of running means over frames
ELBOWS = np.array([motion.endswith("elbow_flexion") for motion in MOTIONS])
HEAD = np.array([name in ("head", "crown") for name in VECTORS])
LIES = math.radians(
    28
)  # hands that lie in a lap or on an armrest have the arm so much elsewhere than shown
ARMS = np.array([name.endswith(("arm", "wrist")) for name in VECTORS])
WRIST_COLUMNS = [COLUMN["left_wrist"].start, COLUMN["right_wrist"].start]
GREATEST_STEP = 0.5  # a clock that jumps further counts as a break [s]


@dataclass(frozen=True, eq=False)
class Segment:
    """What a repetition was made of.

    Attributes:
        times: Of its frames [s], shape [n].
        rows: Features, shape [n, 24], NaN where unknown.
        rest: Features at rest before it, shape [24].
        start: When it began [s].
        end: When it ended [s].
        returned: Whether it ended at rest; else the person stayed away from it too long.
        unsure: How unsure the source was of each of `MOTIONS`, of elbows far out [rad], shape [16].
    """

    times: Array
    rows: Array
    rest: Array
    start: float
    end: float
    returned: bool
    unsure: Array = field(default_factory=lambda: np.zeros(len(MOTIONS)))


class Segmenter:
    """Finds where repetitions begin and end.

    Attributes:
        moving: Whether a repetition is under way.
        rest: Features at rest, shape [24].
        now: Smoothed features of the last frame, shape [24]; NaN where a part is lost.
        moved_at: When something last moved, or `begin` was [s]; None before the first frame.
    """

    def __init__(self) -> None:
        self._clear()
        self.rest = np.full(0, np.nan)

    def begin(self, template: Template) -> None:
        """Look for repetitions of an exercise from now on."""
        exercise = template.exercise
        self._bent = template.bent
        nominal = feature(exercise.keys[0], template.bent)
        is_known = len(self.rest) > 0
        self._nominal = nominal
        self.rest = self.rest if is_known else nominal.copy()
        asked = {part: way.excursion for part, way in template.ways.items()}
        smallest = min(asked.values(), default=1.0)
        self._begins = min(max(0.35 * smallest, math.radians(6)), math.radians(15))
        self._weights, self._close, self._usual = _limits(asked)
        self._asked = np.array([name in asked for name in VECTORS])
        # Arms that have no part tremble and count less.
        idle = [ARMS[i] and n.replace("wrist", "arm") not in asked for i, n in enumerate(VECTORS)]
        self._counts = np.where(idle, 0.5, 1.0)
        # Else its way leaves rest once: nearer to rest again, it is over.
        self._passes_rest = any(way.passes_rest for way in template.ways.values())
        hold = max((pose.hold_s for pose in exercise.poses), default=0.0)
        self._stuck = STUCK + exercise.judged.tempo[1] * hold
        self._patience = exercise.judged.tempo[1] * exercise.duration + 3.0
        self._still = min(STILL, SLOWEST * template.slowest_move)
        self._clear()

    def _clear(self) -> None:
        self.moving = False
        self._away = False  # done, but not back at rest yet
        self._unsure = np.zeros(len(MOTIONS))
        self._times: list[float] = []
        self._rows: list[Array] = []
        self._quick = self._slow = self.now = np.full(0, np.nan)
        self._seen = np.full(0, -np.inf)
        self._recent: deque[tuple[float, Array]] = deque()
        self._calm_since: float | None = None
        self._still_since: float | None = None
        self._began = 0.0
        self._fast_frames = 0
        self._furthest, self._most, self._nearest = 0.0, 0.0, (math.inf, 0.0)
        self._nearest_before = math.inf
        self._finished = -math.inf
        self._learnt = False
        self.moved_at: float | None = None

    def update(
        self, frame: Frame, *, complete: bool, amid: bool = True, holds: bool = False
    ) -> Segment | None:
        """Take a frame; return a repetition when it has ended.

        Args:
            frame: The next frame.
            complete: Whether the last key pose has been reached.
            amid: Whether some of the way to one key pose has been gone, and not to all: rest may be on the
                way.
            holds: Whether the last key pose is held now, which is no place to lay an arm down.
        """
        row, time = feature(frame.angles, self._bent), float(frame.time)
        if self._times and not 0 < time - self._times[-1] <= GREATEST_STEP:
            if time <= self._times[-1]:
                return None  # twice the same, or late: nothing to learn from it
            if time - self._times[-1] > KEPT:
                self._clear()  # a break
        dt = time - self._times[-1] if self._times else 0.0
        self._times.append(time)
        self._rows.append(row)
        self._smooth(row, time, dt)
        if self.moved_at is None:
            self.moved_at = time
        gap = self._distances(self.rest)
        far = float(gap[self._asked].max(initial=0.0))
        self._note_unsure(frame.unsure, far)
        distance = self._near(gap)
        speed = self._speed()
        self._note_still(speed, time)
        share = float((distance / self._near_now(complete=complete)).max())
        passes = self._passes_rest and amid
        # Whoever is back at rest is so though a sensor trembles.
        is_slow = self._fast_frames < (1 if self._calm_since is None else 3)
        is_slow |= not passes and share < AT_REST and speed < TREMBLES * self._still
        self._calm_since = (
            (time if self._calm_since is None else self._calm_since)
            if share <= 1.0 and is_slow
            else None
        )
        if self._away:
            self._wait_for_rest(distance, time)
            return None
        if not self.moving:
            self._look_for_start(distance, speed, time)
            return None
        self._holds = holds
        return self._look_for_end(far, distance, time, complete=complete, passes=passes)

    def _smooth(self, row: Array, time: float, dt: float) -> None:
        if not len(self._quick):
            self._quick, self._slow = row.copy(), row.copy()
            self._seen = np.where(np.isfinite(row), time, -np.inf)
        known = np.isfinite(row)
        fresh = known & ((time - self._seen > LOST) | ~np.isfinite(self._quick))
        self._seen[known] = time
        for mean, constant in ((self._quick, QUICK), (self._slow, SLOW)):
            mean[known] += (1 - math.exp(-dt / constant)) * (row[known] - mean[known])
            mean[fresh] = row[fresh]
        self._recent.append((time, self._quick.copy()))
        self.now = np.where(time - self._seen <= LOST, self._quick, np.nan)

    def _note_unsure(self, unsure: Array | None, far: float) -> None:
        """Note how unsure the source is: of elbows far out, where they are judged, else all the way."""
        if unsure is None:
            return
        is_out = not self.moving or far >= FAR_OUT * self._most
        gap = np.where(ELBOWS, NOTED_OUT * is_out, NOTED) * (unsure - self._unsure)
        self._unsure += np.where(np.isfinite(gap), gap, 0.0)

    def _distances(self, reference: Array) -> Array:
        """Return how far each vector is from a reference [rad], nearly; 0 where it is unknown."""
        gap = (self.now - reference)[: 3 * len(VECTORS)].reshape(-1, 3)
        far = np.sqrt((gap * gap).sum(axis=1))
        far[far != far] = 0.0
        return np.asarray(far)

    def _near(self, gap: Array) -> Array:
        """Return how far each vector is from rest of gaps to it [rad]: of an arm what it or its wrist says.

        Whether an elbow looks straight or bent turns an arm, and not its wrist; of who cannot straighten it
        the wrist hangs as it may.
        """
        out = gap.copy()
        known = np.isfinite(self.now[WRIST_COLUMNS]) & ~np.array(self._bent)
        out[:2] = np.where(known, np.minimum(gap[:2], gap[5:]), gap[:2])
        return out

    def _speed(self) -> float:
        """Return how fast the fastest part moves [rad/s]."""
        while len(self._recent) > 2 and self._recent[-1][0] - self._recent[1][0] >= BACK:
            self._recent.popleft()
        (past, before), (time, now) = self._recent[0], self._recent[-1]
        gap = (now - before)[: 3 * len(VECTORS)].reshape(-1, 3)
        fast = np.sqrt((gap * gap).sum(axis=1)) * self._counts
        return float(np.nanmax(fast, initial=0.0)) / max(time - past, 0.02)

    def _note_still(self, speed: float, time: float) -> None:
        self._fast_frames = self._fast_frames + 1 if speed >= self._still else 0
        if self._fast_frames > 1:  # one alone is noise
            self._still_since = None
        elif self._still_since is None:
            self._still_since = time

    def _still_for(self, time: float) -> float:
        return 0.0 if self._still_since is None else time - self._still_since

    def _near_now(self, *, complete: bool) -> Array:
        """Return how near to rest each vector must be for the movement to be over [rad]."""
        out = self._close.copy()
        if self.moving and not complete:
            out[self._asked] *= NEAR_AMID
        if self._furthest > self._begins:
            out[~self._asked & HEAD] = LOOKS_AWAY
            # Who rests near the goal goes a short way, and is back only when most of it is undone.
            out[self._asked] = np.minimum(out[self._asked], BACK_SHARE * self._furthest)
        return out

    def _wait_for_rest(self, distance: Array, time: float) -> None:
        if self._calm_since is not None and time - self._calm_since >= DWELL:
            self._away = False
            self._forget(time)

    def _look_for_start(self, distance: Array, speed: float, time: float) -> None:
        if not self._learnt:
            if time - self._times[0] < LOOKED:
                return
            self._learnt = True
            self._learn_rest(at_once=True)
            distance = self._near(self._distances(self.rest))
        goes_on = self._goes_on_back(time)
        if float((distance * self._weights).max()) > self._begins and (
            speed >= self._still or self._still_for(time) < 0.5
        ):
            if goes_on:
                self.rest = self._rest_before.copy()
                return
            self.moving, self._began, self._calm_since = True, time, None
            self._furthest, self._most, self._nearest = 0.0, 0.0, (math.inf, time)
            return
        if self._still_for(time) > 0.3:
            self._learn_rest(after_return=time - self._finished < SETTLING)
        self._forget(time)

    def _goes_on_back(self, time: float) -> bool:
        """Return whether what moves is still on its way to where it rested before: a pause was no end."""
        if time - self._finished > PAUSED:
            return False
        gap = self._near(self._distances(self._rest_before))
        before = float((gap * self._weights).max())
        self._nearest_before = min(self._nearest_before, before)
        return before <= self._nearest_before + STILL_BACK

    def _learn_rest(self, *, at_once: bool = False, after_return: bool = False) -> None:
        """Take how the person is now for rest, if it is near enough to what is shown.

        Only little by little, else a slow movement would become rest itself; arms that just came back may lie
        elsewhere than before.
        """
        is_same = self._distances(self.rest) <= SAME
        allowed = np.full(len(VECTORS), True) if at_once else is_same
        if after_return:
            allowed |= ARMS
        close = allowed & (self._distances(self._nominal) <= self._usual)
        known = np.repeat(close, 3) & np.isfinite(self._slow[: 3 * len(VECTORS)])
        gap = np.abs(self._slow - self.rest)[3 * len(VECTORS) :]
        angles = np.isfinite(gap) if at_once else gap <= SAME
        columns = np.flatnonzero(np.concatenate((known, angles)))
        rate = 1.0 if at_once else 0.1
        self.rest[columns] += rate * (self._slow[columns] - self.rest[columns])

    def _forget(self, time: float) -> None:
        old = 0
        while old < len(self._times) and time - self._times[old] > KEPT:
            old += 1
        if old > 15:  # not in every frame
            del self._times[:old], self._rows[:old]

    def _look_for_end(
        self, far: float, distance: Array, time: float, *, complete: bool, passes: bool
    ) -> Segment | None:
        # One may pass rest on the way from one key pose to the next.
        amid = ELSEWHERE_FOR if passes and self._furthest > self._begins else DWELL_AMID
        dwell = DWELL if complete else amid
        if self._calm_since is not None and time - self._calm_since >= dwell:
            return self._finish(self._calm_since, time)
        near = float(distance[self._asked].max(initial=0.0))
        self._furthest, self._most = max(self._furthest, near), max(self._most, far)
        still, share = self._still_for(time), far / max(self._most, 1e-6)
        if self._furthest > self._begins:
            return self._look_for_turn(near, share, still, time, complete=complete)
        return self._look_for_too_long(still, time)

    def _look_for_turn(
        self, near: float, share: float, still: float, time: float, *, complete: bool
    ) -> Segment | None:
        """Return a repetition that ended where an arm was laid down, or where it turned into the next."""
        is_laid = share <= LAID and complete and still >= LAID_FOR
        is_elsewhere = share <= ELSEWHERE and still >= ELSEWHERE_FOR and not self._holds
        if is_laid or is_elsewhere:
            return self._finish(time - still, time)
        if complete or not self._passes_rest:
            if near < self._nearest[0] and near <= TURNED * self._furthest:
                self._nearest = (near, time)
            elif near > self._nearest[0] + LEFT_AGAIN * self._furthest:
                return self._finish_at_turn(self._nearest[1], time)
        return self._look_for_too_long(still, time)

    def _look_for_too_long(self, still: float, time: float) -> Segment | None:
        if still > self._stuck or time - self._began > self._patience:
            self._away = True
            return self._finish(time, time)
        return None

    def _finish_at_turn(self, turn: float, time: float) -> Segment:
        """End a repetition where it turned into the next one [s], and begin that."""
        kept = [(t, row) for t, row in zip(self._times, self._rows, strict=True) if t >= turn]
        cut = len(self._times) - len(kept)
        del self._times[cut:], self._rows[cut:]
        segment = self._finish(turn, turn)
        self._times, self._rows = [t for t, _ in kept], [row for _, row in kept]
        self.moving, self._began, self.moved_at = True, turn, time
        self._furthest, self._most, self._nearest = 0.0, 0.0, (math.inf, time)
        return segment

    def _finish(self, end: float, time: float) -> Segment:
        self.moving, self.moved_at, self._finished = False, time, time
        self._rest_before, self._nearest_before = self.rest.copy(), math.inf
        times, rows = np.array(self._times), np.array(self._rows)
        start = self._start(times, rows)
        chosen = times >= start
        segment = Segment(
            times[chosen],
            rows[chosen],
            self.rest.copy(),
            start,
            end,
            not self._away,
            self._unsure.copy(),
        )
        self._calm_since = None
        del self._times[:-1], self._rows[:-1]
        return segment

    def _start(self, times: Array, rows: Array) -> float:
        """Return when the movement left rest [s]."""
        before = np.flatnonzero(times <= self._began)
        gap = (rows[before] - self.rest)[:, : 3 * len(VECTORS)].reshape(len(before), -1, 3)
        far = np.nan_to_num(np.sqrt((gap * gap).sum(axis=2))) * self._weights
        quiet = np.flatnonzero(far.max(axis=1) < 0.4 * self._begins)
        return float(times[quiet[-1]] if len(quiet) else times[0])


def _limits(asked: dict[str, float]) -> tuple[Array, Array, Array]:
    """Return limits of each vector.

    Args:
        asked: How far each part goes that an exercise asks for [rad].

    Returns:
        How much it counts at a beginning, how near to rest it must come back [rad], and how far from the rest
        shown it may be at rest [rad].
    """
    weights, near, usual = (np.empty(len(VECTORS)) for _ in range(3))
    for i, name in enumerate(VECTORS):
        part = name.replace("wrist", "arm").replace("crown", "head")
        if name == "trunk":
            weights[i], near[i] = 0.9, math.radians(14)
        elif part in asked:
            far = min(max(0.35 * asked[part], math.radians(6)), math.radians(28))
            weights[i], near[i] = 1.0, far if name == part else max(far, math.radians(25))
        else:
            # A head that turns does nothing wrong; one that nods may.
            weights[i] = 0.3 if name == "head" else 0.5
            near[i] = math.radians(25)
        if name.endswith("wrist"):
            weights[i], near[i] = 0.6, math.radians(42)
        usual[i] = near[i] + (LIES if ARMS[i] else math.radians(10))
        if ARMS[i] and part not in asked:  # an arm without a part lies anywhere
            usual[i] = ANYWHERE
    return weights, near, usual
