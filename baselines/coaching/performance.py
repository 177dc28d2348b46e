"""How synthetic people do an exercise: right, or wrong in one of many ways, by far or at the limit.

A performance is motion of a kinematic body that is moved by its own rules: limbs swing from direction to
direction by several overlapping sub-movements of uneven speed, with corrections, bulges, pauses and
fatigue. Nothing of it comes from a recogniser, nor from the curve that an exercise is shown by. All
figures are our own choice.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcare_marl.agents.coaching.exercise import Exercise, KeyPose, load_exercise
from rcare_marl.agents.coaching.upper_body import (
    ARM,
    MOTION_INDEX,
    MOTIONS,
    SIDES,
)
from rcare_marl.errors import UnknownNameError, check_name
from rcare_marl.pose import Array

from .kinematics import DEGREE, ELBOW, ELEVATION, PLANE, RATE, advance, alive, between, swung
from .synthetic_user import PACE, RANGE, SyntheticUser

BEFORE, AFTER = 1.2, 1.5  # rest before and after [s]


@dataclass(frozen=True, eq=False)
class Performance:
    """What somebody did.

    Attributes:
        asked: What they were asked to do.
        kind: `right`, or what is wrong with it; `idle` without an exercise.
        times: [s], shape [n].
        angles: [rad], shape [n, 16].
        spans: Beginning and end of each repetition [s].
        used: How much of its limit it was made to use, where that was asked for.
    """

    asked: Exercise
    kind: str
    times: Array
    angles: Array
    spans: tuple[tuple[float, float], ...]
    used: float | None = None


@dataclass
class Attempt:
    """One repetition as it is going to be done; each kind of mistake changes some of it.

    Attributes:
        exercise: What is done.
        keys: Key poses with rest before and after [rad], shape [poses + 2, 16].
        share: Share of the range of left arm, right arm and head.
        pace: Duration against the one shown.
        hold: Of the poses, likewise.
        lag: How much later the right arm is than the left [s]; negative: earlier.
        trunk: How far the trunk moves along with it [rad], shape [3].
        head: How far the head nods and tilts along [rad], shape [2].
    """

    exercise: Exercise
    keys: Array
    share: Array
    pace: float
    hold: float
    lag: float
    trunk: Array
    head: Array


def _attempt(
    user: SyntheticUser, exercise: Exercise, rng: np.random.Generator, tired: float = 0.0
) -> Attempt:
    """Return a right repetition in the way of a person, who is tired by so much, 0 to 1."""
    keys = exercise.keys.copy()
    rest = keys[0].copy()
    for i, side in enumerate(SIDES):
        moves = np.abs(keys[:, ARM[side]] - keys[0, ARM[side]]).max(axis=1) > 1e-6
        keys[~moves, ARM[side]] = user.rest[i]
        plane = keys[:, ARM[side].start + PLANE]  # where a sweep ends is a matter of range
        alike = moves & (np.abs(plane - plane[1]) < 20 * DEGREE)
        plane[alike] += user.plane[i] + rng.normal(0, 2 * DEGREE)
        keys[moves, ARM[side].start + ELBOW] += user.elbow[i]
        rest[ARM[side]] = user.rest[i] + rng.normal(0, 3 * DEGREE, size=5)  # not quite where it lay
    keys[0] = keys[-1] = rest
    base = np.clip(user.range - tired * user.tires + rng.normal(0, 0.02, size=3), *RANGE)
    other = 1 - SIDES.index(user.handed)
    base[other] = max(base[other] - user.weaker, RANGE[0])
    return Attempt(
        exercise=exercise,
        keys=keys,
        share=base,
        pace=float(np.clip(user.pace * (1 + 0.2 * tired) * rng.uniform(0.85, 1.15), *PACE)),
        hold=user.hold,
        lag=user.lag if other == 1 else -user.lag,
        trunk=user.sway * rng.uniform(-1, 1, size=3),
        head=np.zeros(2),
    )


def _scaled(attempt: Attempt) -> Array:
    """Return the key poses with the shares of the range applied [rad]."""
    keys, asked = attempt.keys, attempt.keys.copy()
    for i, side in enumerate(SIDES):
        e, p = ARM[side].start + ELEVATION, ARM[side].start + PLANE
        asked[1:-1, e] = keys[0, e] + attempt.share[i] * (keys[1:-1, e] - keys[0, e])
        for k in range(2, len(keys) - 1):  # a sweep is a share of the way from the pose before it
            if keys[k - 1, e] > math.radians(45):
                asked[k, p] = asked[k - 1, p] + attempt.share[i] * (keys[k, p] - keys[k - 1, p])
    asked[1:-1, 3:6] = attempt.share[2] * keys[1:-1, 3:6]
    asked[1:-1, 3:5] += attempt.head
    return asked


Change = Callable[[Attempt, SyntheticUser, np.random.Generator], Attempt | None]


def _is_head(attempt: Attempt) -> bool:
    return attempt.exercise.parts == ("head",)


def _one_arm(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    side = int(rng.integers(2))
    if _is_head(attempt):  # to one side only
        column = MOTION_INDEX["neck_rotation_left"]
        bounds = (0.0, np.inf) if side == 0 else (-np.inf, 0.0)
        attempt.keys[:, column] = np.clip(attempt.keys[:, column], *bounds)
    else:
        attempt.keys[:, ARM[SIDES[side]]] = user.rest[side]
    return attempt


def _half_range(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    attempt.share = np.full(3, rng.uniform(0.35, 0.55))
    return attempt


def _wrong_plane(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    keys, name = attempt.keys, attempt.exercise.name
    if _is_head(attempt):  # nods or tilts in place of turning
        way = MOTION_INDEX[str(rng.choice(["neck_flexion", "neck_lateral_flexion_left"]))]
        keys[:, way] = 0.65 * keys[:, MOTION_INDEX["neck_rotation_left"]]
        keys[:, MOTION_INDEX["neck_rotation_left"]] = 0.0
        return attempt
    off = rng.uniform(50, 80) * DEGREE
    up = rng.choice((-1, 1)) * rng.uniform(45, 60) * DEGREE
    if name == "upper_lift":  # by the side, in place of the front
        side = attempt.keys[1].copy()
        for arm in ARM.values():
            side[arm.start + ELEVATION] = np.pi / 2
        poses = attempt.exercise.poses
        half = replace(poses[0], move_s=poses[0].move_s / 2, hold_s=0.0)
        poses = (half, replace(half, hold_s=poses[0].hold_s), half)
        attempt.exercise = replace(attempt.exercise, poses=poses, return_s=half.move_s)
        attempt.keys = keys = np.stack((keys[0], side, keys[1], side, keys[2]))
    for side in SIDES:
        e, p = ARM[side].start + ELEVATION, ARM[side].start + PLANE
        if name == "lateral_raise":
            keys[1:-1, p] += off
        elif name == "chest_expansion":  # too high or too low
            keys[1:-1, e] += up
        else:
            keys[1:-1, p] -= off
    return attempt


def _too_fast(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    attempt.pace, attempt.hold = float(rng.uniform(0.18, 0.3)), min(attempt.hold, 0.5)
    return attempt


def _asymmetric(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    less = rng.uniform(0.4, 0.6)
    if _is_head(attempt):
        column = MOTION_INDEX["neck_rotation_left"]
        values = attempt.keys[:, column]
        attempt.keys[:, column] = np.where(values * rng.choice((-1, 1)) > 0, less, 1.0) * values
    else:
        attempt.share[int(rng.integers(2))] *= less
    return attempt


def _one_after_other(
    attempt: Attempt, user: SyntheticUser, rng: np.random.Generator
) -> Attempt | None:
    if _is_head(attempt):
        return None
    attempt.lag = float(rng.choice((-1, 1)) * rng.uniform(1.6, 2.5))
    return attempt


def _head_only(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    if _is_head(attempt):  # the arms only
        turned = attempt.keys[:, MOTION_INDEX["neck_rotation_left"]] != 0
        attempt.keys[:, 3:6] = 0.0
        for i, side in enumerate(SIDES):
            attempt.keys[turned, ARM[side]] = user.rest[i] + np.array((60, 0, 0, 0, 0)) * DEGREE
        return attempt
    way = int(rng.integers(3, 6))
    size = rng.uniform(25, 45) * DEGREE * rng.choice((-1, 1))
    for i, side in enumerate(SIDES):
        attempt.keys[:, ARM[side]] = user.rest[i]
    attempt.keys[1:-1, way] = size
    return attempt


def _trunk_lean(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    way, size = int(rng.integers(2)), rng.uniform(20, 35) * DEGREE
    # Back there is the backrest.
    attempt.trunk[way] = size if way == 0 else size * rng.choice((-1, 1))
    return attempt


def _trunk_turn(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    size = rng.uniform(28, 45) * DEGREE
    if _is_head(attempt):  # the shoulders turn along, the neck does the rest
        column = MOTION_INDEX["neck_rotation_left"]
        turned = attempt.keys[:, column]
        attempt.keys[:, 2] = np.sign(turned) * size
        attempt.keys[:, column] = np.sign(turned) * np.maximum(np.abs(turned) - size, 0.0)
    else:
        attempt.trunk[2] = size * rng.choice((-1, 1))
    return attempt


def _bent_elbows(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt | None:
    if _is_head(attempt):
        return None
    for side in SIDES:
        attempt.keys[1:-1, ARM[side].start + ELBOW] = rng.uniform(85, 110) * DEGREE
    return attempt


def _unknown(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    """Some gesture of every day: waving, drinking, scratching the head, boxing with one hand."""
    gestures = {
        "wave": ((60, 20, -60, 110, 0), (60, 20, -20, 70, 0), (60, 20, -70, 110, 0)),
        "drink": ((40, 70, 20, 120, 30), (55, 70, 30, 135, 60), (50, 70, 25, 130, 60)),
        "scratch": ((95, 50, -30, 130, 0), (105, 45, -35, 140, 0), (95, 55, -30, 130, 0)),
        "box": ((30, 60, 0, 120, 80), (75, 85, 0, 15, 80), (30, 60, 0, 125, 80)),
    }
    name = str(rng.choice(list(gestures)))
    keys = np.repeat(attempt.keys[:1], 5, axis=0)
    keys[:, 3:6] = 0.0
    used = [SIDES.index(user.handed)] if name == "box" or rng.random() < 0.7 else [0, 1]
    for i in used:
        keys[1:4, ARM[SIDES[i]]] = np.array(gestures[name]) * DEGREE
    pose = KeyPose({}, float(rng.uniform(0.7, 1.2)))
    attempt.exercise = replace(attempt.exercise, poses=(pose, pose, pose), return_s=1.0)
    attempt.keys, attempt.share = keys, np.ones(3)
    return attempt


def _right(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    return attempt


def _by_range(attempt: Attempt, used: float) -> None:
    attempt.share = np.full(3, 1.0 - used * (1.0 - attempt.exercise.judged.range_share))


def _by_lean(attempt: Attempt, used: float) -> None:
    attempt.trunk = np.array((used * attempt.exercise.judged.lean_deg * DEGREE, 0.0, 0.0))


def _by_elbows(attempt: Attempt, used: float) -> None:
    for side in SIDES:
        shown = attempt.exercise.keys[1:-1, ARM[side].start + ELBOW]
        bent = shown + used * attempt.exercise.judged.elbow_deg * DEGREE
        attempt.keys[1:-1, ARM[side].start + ELBOW] = bent


def _by_nod(attempt: Attempt, used: float) -> None:
    attempt.head = np.array((used * attempt.exercise.judged.head_deg * DEGREE, 0.0))


def _by_tempo(attempt: Attempt, used: float) -> None:
    attempt.pace, attempt.hold = attempt.exercise.judged.tempo[0] ** used, 1.0


# What can be done at every distance from its limit, and what of it makes no sense for the head alone.
GRADED: dict[str, Callable[[Attempt, float], None]] = {
    "range": _by_range,
    "trunk_lean": _by_lean,
    "bent_elbows": _by_elbows,
    "head_moved": _by_nod,
    "too_fast": _by_tempo,
}
_NOT_OF_THE_HEAD = ("bent_elbows", "head_moved")
USED = (0.3, 0.6, 0.8, 0.9, 1.1, 1.2, 1.4, 1.7, 2.0)  # shares of a limit

# Besides these: `wrong_arm`, asked for one side and done on the other; `other_exercise`; `standing_still`.
CHANGES: dict[str, Change] = {
    "right": _right,
    "one_arm": _one_arm,
    "half_range": _half_range,
    "wrong_plane": _wrong_plane,
    "too_fast": _too_fast,
    "asymmetric": _asymmetric,
    "one_after_other": _one_after_other,
    "head_only": _head_only,
    "trunk_lean": _trunk_lean,
    "trunk_turn": _trunk_turn,
    "bent_elbows": _bent_elbows,
    "unknown_movement": _unknown,
}
WRONG = (*(k for k in CHANGES if k != "right"), "wrong_arm", "other_exercise", "standing_still")


def perform(
    user: SyntheticUser,
    exercise: Exercise,
    kind: str,
    rng: np.random.Generator,
    *,
    others: Sequence[str] = (),
    repetitions: int = 1,
) -> Performance | None:
    """Return how a person does an exercise; None if it cannot be done wrong in that way.

    Args:
        user: Who.
        exercise: What they are asked to do.
        kind: `right` or one of `WRONG`.
        rng: Of what varies from time to time.
        others: Exercises to do in its place, for `other_exercise`.
        repetitions: How often.
    """
    asked, done = exercise, exercise
    if kind == "wrong_arm":
        side = int(rng.integers(2))
        asked, done = exercise.one_sided(SIDES[side]), exercise.one_sided(SIDES[1 - side])
    elif kind == "other_exercise":
        done = load_exercise(str(rng.choice([name for name in others if name != exercise.name])))
    elif kind not in (*CHANGES, "standing_still"):
        raise UnknownNameError("kind of performance", kind, ("right", *WRONG))
    attempts = []
    for k in range(0 if kind == "standing_still" else repetitions):
        attempt = _attempt(user, done, rng, tired=k / 10)
        changed = CHANGES.get(kind, _right)(attempt, user, rng)
        if changed is None:
            return None
        attempts.append(changed)
    return _performance(user, asked, kind, attempts, rng)


def perform_at(
    user: SyntheticUser, exercise: Exercise, kind: str, used: float, rng: np.random.Generator
) -> Performance | None:
    """Return one repetition that uses so much of one limit and is right otherwise; None if it makes no sense.

    Args:
        user: Who.
        exercise: What they are asked to do.
        kind: Which limit, of `GRADED`.
        used: How much of it: 1 is at the limit.
        rng: Of what varies from time to time.
    """
    check_name("limit", kind, GRADED)
    if exercise.parts == ("head",) and kind in _NOT_OF_THE_HEAD:
        return None
    attempt = _attempt(user, exercise, rng)
    attempt.share, attempt.trunk = np.maximum(attempt.share, 0.95), 0.3 * attempt.trunk
    attempt.pace = float(np.clip(attempt.pace, 0.8, 1.3))
    GRADED[kind](attempt, used)
    return replace(_performance(user, exercise, kind, [attempt], rng), used=used)


def _performance(
    user: SyntheticUser,
    asked: Exercise,
    kind: str,
    attempts: Sequence[Attempt],
    rng: np.random.Generator,
) -> Performance:
    """Return somebody who does one attempt after the other."""
    parts: list[tuple[Array, Array]] = []
    spans, now = [], BEFORE
    for attempt in attempts:
        times, angles = _repetition(attempt, user, rng)
        parts.append((now + times, angles))
        spans.append((now, now + float(times[-1])))
        now = spans[-1][1] + float(rng.uniform(0.0, 0.1) if user.hurries else rng.uniform(0.7, 1.5))
    end = spans[-1][1] + AFTER if spans else 0.0
    if kind != "right":  # a coach waits for a while before they say that nothing happens
        end = max(end, BEFORE + asked.duration + 4.0)
    grid = np.arange(int(end * RATE)) / RATE
    whole = _laid(grid, parts, at_rest(user))
    turns_head = np.ptp(whole[:, 3:6], axis=0).max() > 20 * DEGREE  # who does looks nowhere else
    calm = replace(user, gaze=0.3 * user.gaze) if turns_head else user
    return Performance(asked, kind, grid, alive(calm, grid, whole, rng), tuple(spans))


def _laid(grid: Array, parts: Sequence[tuple[Array, Array]], rest: Array) -> Array:
    """Return angles at all times: parts of motion, and in between how the last one left it, shape [n, 16]."""
    whole = np.repeat(rest[None], len(grid), axis=0)
    for k, (times, angles) in enumerate(parts):
        first = int(round(times[0] * RATE))
        count = min(len(angles), len(whole) - first)
        whole[first : first + count] = angles[:count]
        after = parts[k + 1][1][0] if k + 1 < len(parts) else angles[-1]
        until = int(round(parts[k + 1][0][0] * RATE)) if k + 1 < len(parts) else len(whole)
        share = np.linspace(0, 1, max(until - first - count, 0))[:, None]
        whole[first + count : until] = angles[-1] + share * (after - angles[-1])
        if k == 0:
            lead = np.linspace(0, 1, first)[:, None] ** 3
            whole[:first] = rest + lead * (angles[0] - rest)
    return whole


def idle(
    user: SyntheticUser, exercise: Exercise, rng: np.random.Generator, *, seconds: float
) -> Performance:
    """Return somebody who was asked and does something else: looks about, shifts, uses a hand.

    Args:
        user: Who.
        exercise: What they were asked to do.
        rng: Of what varies from time to time.
        seconds: For how long.
    """
    grid = np.arange(int(seconds * RATE)) / RATE
    parts: list[tuple[Array, Array]] = []
    now = float(rng.uniform(0.5, 2.0))
    while now < seconds - 8.0:
        attempt = _attempt(user, exercise, rng)
        which = rng.integers(3)
        attempt = (_unknown, _head_only, _half_shift)[which](attempt, user, rng)
        times, angles = _repetition(attempt, user, rng)
        parts.append((now + times, angles))
        now += float(times[-1] + rng.uniform(0.5, 3.0))
    whole = _laid(grid, parts, at_rest(user))
    return Performance(exercise, "idle", grid, alive(user, grid, whole, rng), ())


def _half_shift(attempt: Attempt, user: SyntheticUser, rng: np.random.Generator) -> Attempt:
    """Shift in the seat: the trunk moves, the arms hardly."""
    attempt.share = np.full(3, 0.1)
    attempt.trunk = rng.uniform(-12, 12, size=3) * DEGREE
    return attempt


def at_rest(user: SyntheticUser) -> Array:
    """Return how a person sits who does nothing [rad], shape [16]."""
    angles = np.zeros(len(MOTIONS))
    for i, side in enumerate(SIDES):
        angles[ARM[side]] = user.rest[i]
    return angles


def _repetition(
    attempt: Attempt, user: SyntheticUser, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return times since its beginning [s] and angles [rad] of one repetition."""
    keys = _scaled(attempt)
    poses, pace = attempt.exercise.poses, attempt.pace
    moves = [pace * pose.move_s for pose in poses] + [pace * attempt.exercise.return_s]
    holds = [pace * attempt.hold * pose.hold_s for pose in poses] + [0.0]
    progress, rates = [np.zeros(1)], np.clip(rng.normal(1.0, 0.1, size=len(moves)), 0.8, 1.25)
    if attempt.pace < PACE[0]:  # who hurries does neither stop nor correct
        user, rates = replace(user, jerky=0.0, pauses=0.0), np.ones(len(moves))
    for k, (move, hold) in enumerate(zip(moves, holds, strict=True)):
        went = advance(move * rates[k], user, rng)
        progress.append(k + went)
        progress.append(np.full(int(hold * RATE), k + went[-1]))
    gone = np.concatenate(progress)
    late = int(abs(attempt.lag) * RATE)
    lagging = SIDES[1 if attempt.lag > 0 else 0]
    ahead = np.concatenate((gone, np.full(late, gone[-1])))
    behind = np.concatenate((np.zeros(late), gone))
    angles = np.empty((len(ahead), len(MOTIONS)))
    angles[:, :6] = between(keys[:, :6], ahead)
    bulge = rng.normal(0, 2.5 * DEGREE, size=(2, len(moves)))
    for i, side in enumerate(SIDES):
        own = behind if side == lagging else ahead
        angles[:, ARM[side]] = swung(side, keys[:, ARM[side]], own, bulge[i])
    # The trunk goes along as far as the movement has gone.
    far = np.abs(angles - angles[0]).sum(axis=1)
    angles[:, :3] += (far / max(float(far.max()), 1e-9))[:, None] * attempt.trunk
    return np.arange(len(angles)) / RATE, angles
