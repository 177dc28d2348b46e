"""How synthetic people do an exercise: right, or wrong in one of many ways.

A performance is motion of a kinematic body. What is wrong is wrong by far, what is right is right as a
therapist would have it; nothing here comes from a recogniser. All figures are our own choice.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcare_marl.agents.coaching.exercise import Exercise, KeyPose, load_exercise
from rcare_marl.agents.coaching.upper_body import ARM, MOTION_INDEX, MOTIONS, SIDES
from rcare_marl.errors import UnknownNameError
from rcare_marl.pose import Array

from .synthetic_user import PACE, RANGE, SyntheticUser

RATE = 120.0  # at which motion is made; sensors sample it [1/s]
BEFORE, AFTER = 1.2, 1.5  # rest before and after [s]
ELEVATION, PLANE, ELBOW = 0, 1, 3  # within an arm
DEGREE = math.pi / 180


@dataclass(frozen=True, eq=False)
class Performance:
    """What somebody did.

    Attributes:
        asked: What they were asked to do.
        kind: `right`, or what is wrong with it; `idle` without an exercise.
        times: [s], shape [n].
        angles: [rad], shape [n, 16].
        spans: Beginning and end of each repetition [s].
    """

    asked: Exercise
    kind: str
    times: Array
    angles: Array
    spans: tuple[tuple[float, float], ...]


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
    """

    exercise: Exercise
    keys: Array
    share: Array
    pace: float
    hold: float
    lag: float
    trunk: Array


def _attempt(user: SyntheticUser, exercise: Exercise, rng: np.random.Generator) -> Attempt:
    """Return a right repetition in the way of a person."""
    keys = exercise.keys.copy()
    rest = keys[0].copy()
    for i, side in enumerate(SIDES):
        moves = np.abs(keys[:, ARM[side]] - keys[0, ARM[side]]).max(axis=1) > 1e-6
        keys[~moves, ARM[side]] = user.rest[i]
        plane = keys[:, ARM[side].start + PLANE]  # where a sweep ends is a matter of range
        alike = moves & (np.abs(plane - plane[1]) < 20 * DEGREE)
        plane[alike] += user.plane[i] + rng.normal(0, 2 * DEGREE)
        keys[moves, ARM[side].start + ELBOW] += user.elbow[i]
        rest[ARM[side]] = user.rest[i]
    keys[0] = keys[-1] = rest
    base = np.clip(user.range + rng.normal(0, 0.02, size=3), *RANGE)
    other = 1 - SIDES.index(user.handed)
    base[other] = max(base[other] - user.weaker, RANGE[0])
    return Attempt(
        exercise=exercise,
        keys=keys,
        share=base,
        pace=float(np.clip(user.pace * rng.uniform(0.92, 1.08), *PACE)),
        hold=user.hold,
        lag=user.lag if other == 1 else -user.lag,
        trunk=user.sway * rng.uniform(-1, 1, size=3),
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
    return asked


def _performed(attempt: Attempt) -> Exercise:
    """Return the attempt as an exercise of its own, whose angles are what is done."""
    keys = np.degrees(_scaled(attempt))
    poses = tuple(
        KeyPose(
            dict(zip(MOTIONS, key.tolist(), strict=True)),
            pose.move_s * attempt.pace,
            pose.hold_s * attempt.pace * attempt.hold,
        )
        for key, pose in zip(keys[1:-1], attempt.exercise.poses, strict=True)
    )
    rest = dict(zip(MOTIONS, keys[0].tolist(), strict=True))
    return replace(
        attempt.exercise, poses=poses, rest=rest, return_s=attempt.exercise.return_s * attempt.pace
    )


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
    parts: list[tuple[Array, Array]] = []  # angles and whether they belong to a repetition
    spans, now = [], BEFORE
    if kind != "standing_still":
        for _ in range(repetitions):
            attempt = CHANGES.get(kind, _right)(_attempt(user, done, rng), user, rng)
            if attempt is None:
                return None
            times, angles = _repetition(attempt)
            parts.append((now + times, angles))
            spans.append((now, now + float(times[-1])))
            now = spans[-1][1] + float(rng.uniform(0.7, 1.5))
    end = spans[-1][1] + AFTER if spans else 0.0
    if kind != "right":  # a coach waits for a while before they say that nothing happens
        end = max(end, BEFORE + exercise.duration + 4.0)
    grid = np.arange(int(end * RATE)) / RATE
    whole = np.repeat(at_rest(user)[None], len(grid), axis=0)
    for times, angles in parts:
        first = int(round(times[0] * RATE))
        count = min(len(angles), len(whole) - first)
        whole[first : first + count] = angles[:count]
    turns_head = np.ptp(whole[:, 3:6], axis=0).max() > 20 * DEGREE  # who does looks nowhere else
    calm = replace(user, gaze=0.3 * user.gaze) if turns_head else user
    return Performance(asked, kind, grid, _alive(calm, grid, whole, rng), tuple(spans))


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
    whole = np.repeat(at_rest(user)[None], len(grid), axis=0)
    now = float(rng.uniform(0.5, 2.0))
    while now < seconds - 8.0:
        attempt = _attempt(user, exercise, rng)
        which = rng.integers(3)
        attempt = (_unknown, _head_only, _half_shift)[which](attempt, user, rng)
        times, angles = _repetition(attempt)
        first = int(round(now * RATE))
        count = min(len(angles), len(whole) - first)
        whole[first : first + count] = angles[:count]
        now += float(times[-1] + rng.uniform(0.5, 3.0))
    return Performance(exercise, "idle", grid, _alive(user, grid, whole, rng), ())


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


def _repetition(attempt: Attempt) -> tuple[Array, Array]:
    """Return times since its beginning [s] and angles [rad] of one repetition."""
    exercise = _performed(attempt)
    late = abs(attempt.lag)
    times = np.arange(int((exercise.duration + late) * RATE) + 1) / RATE
    angles = exercise.angles(times)
    lagging = ARM[SIDES[1 if attempt.lag > 0 else 0]]
    angles[:, lagging] = exercise.angles(times - late)[:, lagging]
    # The trunk goes along as far as the movement has gone.
    gone = np.abs(angles - angles[0]).sum(axis=1)
    gone /= max(float(gone.max()), 1e-9)
    angles[:, :3] += gone[:, None] * attempt.trunk
    return times, angles


def _alive(user: SyntheticUser, times: Array, angles: Array, rng: np.random.Generator) -> Array:
    """Return angles with tremor, breathing and a gaze that wanders."""
    out = angles.copy()
    for i, side in enumerate(SIDES):
        start = ARM[side].start
        for column, size in ((ELEVATION, 1.0), (PLANE, 0.7), (ELBOW, 1.0)):
            phase = rng.uniform(0, 2 * np.pi)
            wave = np.sin(2 * np.pi * user.tremor_rate * times + phase)
            out[:, start + column] += size * user.tremor[i] * wave
            out[:, start + column] += 1.0 * DEGREE * _wander(times, rng)
    for j in range(3):
        out[:, 3 + j] += user.gaze[j] * _wander(times, rng)
        wave = np.sin(2 * np.pi * user.tremor_rate * times + rng.uniform(0, 2 * np.pi))
        out[:, 3 + j] += user.tremor[2] * wave
        out[:, j] += 0.7 * DEGREE * _wander(times, rng)
    return out


def _wander(times: Array, rng: np.random.Generator) -> Array:
    """Return a slow irregular wave of about unit size, shape [n]."""
    rates, phases = rng.uniform(0.05, 0.35, size=3), rng.uniform(0, 2 * np.pi, size=3)
    waves = np.sin(2 * np.pi * rates[:, None] * times + phases[:, None])
    return np.asarray(waves.sum(axis=0) / math.sqrt(3.0))
