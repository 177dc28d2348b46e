"""Exercises: key poses with a tempo, what is demanded, and what they become for one person."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load, read_yaml
from rcare_marl.errors import ConfigError, UnknownNameError, check_name
from rcare_marl.pose import Array

from .upper_body import ARM, ARM_MOTIONS, MOTION_INDEX, MOTIONS, SIDES, directions

PARTS = ("left_arm", "right_arm", "head", "trunk")
ARMS = PARTS[:2]
HEAD, TRUNK = slice(3, 6), slice(0, 3)
COLUMNS = {"left_arm": ARM["left"], "right_arm": ARM["right"], "head": HEAD, "trunk": TRUNK}
SMALLEST = math.radians(8)  # a part that moves less is no part of an exercise; our own choice
SMALLEST_SHARE = 0.15  # nor is one that can do less of what was asked of it; our own choice


@dataclass(frozen=True)
class KeyPose:
    """Where the body is to be, and how long it takes to get there.

    Attributes:
        angles_deg: Angles by motion [deg]; without a side both sides are meant. What is not named is as in
            the rest of the exercise.
        move_s: Time from the pose before [s].
        hold_s: How long the pose is held [s].
    """

    angles_deg: dict[str, float]
    move_s: float
    hold_s: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.move_s) and self.move_s > 0):
            raise ConfigError(f"move_s of a key pose must be positive, got {self.move_s}")
        if not (math.isfinite(self.hold_s) and self.hold_s >= 0):
            raise ConfigError(f"hold_s of a key pose must not be negative, got {self.hold_s}")
        object.__setattr__(self, "angles_deg", both_sides(self.angles_deg))


@dataclass(frozen=True)
class Demand:
    """What makes a repetition right. All defaults are our own choice.

    Attributes:
        range_share: Least share of the way to each key pose.
        least_goal: Down to which share of what is shown a goal may be somebody's own range; 1: not at all.
        plane_deg: How far a part may leave the path that was shown [deg].
        beyond_deg: How far a part may go beyond a key pose [deg].
        tempo: Least and greatest duration against the one shown.
        symmetry: By which share one arm may fall behind the other.
        lag_s: How much later one arm may be than the other [s].
        elbow_deg: How much more than shown an elbow may be bent [deg].
        lean_deg: How far the trunk may lean [deg].
        turn_deg: How far the trunk may turn [deg].
        head_deg: How far the head may nod or tilt where it has no part in the exercise [deg].
        gaze_deg: How far it may turn there [deg]; people look at their hand, or at the coach.
        still_deg: How far an arm may move that has no part in it [deg].
        patience_s: After how long without a movement a person counts as standing still, over the duration of
            a repetition [s].
    """

    range_share: float = 0.8
    least_goal: float = 1.0
    plane_deg: float = 28.0
    beyond_deg: float = 45.0
    tempo: tuple[float, float] = (0.5, 2.2)
    symmetry: float = 0.22
    lag_s: float = 0.8
    elbow_deg: float = 25.0
    lean_deg: float = 10.0
    turn_deg: float = 15.0
    head_deg: float = 18.0
    gaze_deg: float = 75.0
    still_deg: float = 40.0
    patience_s: float = 2.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            for number in value if isinstance(value, tuple) else (value,):
                if not (math.isfinite(number) and number > 0):
                    raise ConfigError(f"{name} must be positive, got {number}")
        if self.tempo[0] >= self.tempo[1]:
            raise ConfigError(f"tempo is [least, greatest], got {list(self.tempo)}")
        for name in ("range_share", "least_goal"):
            if getattr(self, name) > 1:
                raise ConfigError(f"{name} is a share of at most 1, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class Reach:
    """What a person can do by themselves.

    Attributes:
        low: Least angle of each of `MOTIONS` [rad], shape [16].
        high: Greatest angle [rad], shape [16]; of the elevation of an arm: to the side.
        front: Greatest elevation to the front of left and right arm [rad]; as to the side if None.
        straightens: Whether they straighten both elbows; how bent elbows are is not judged else.
        sweeps: Whether left and right arm, once raised, go from the side to the front.
    """

    low: Array
    high: Array
    front: tuple[float, float] | None = None
    straightens: bool = True
    sweeps: tuple[bool, bool] = (True, True)

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, value)
            if value.shape != (len(MOTIONS),) or not np.isfinite(value).all():
                raise ConfigError(f"{name} of a reach must be {len(MOTIONS)} finite angles")
        if (self.low > self.high).any():
            worst = MOTIONS[int(np.argmax(self.low - self.high))]
            raise ConfigError(f"a reach has low beyond high in {worst}")

    def clip(self, angles: Array) -> Array:
        """Return the nearest angles that this person reaches [rad], shape [..., 16]."""
        out = np.clip(angles, self.low, self.high)
        for i, side in enumerate(SIDES):
            at, plane = ARM[side].start, out[..., ARM[side].start + 1]
            side_most, front_most = self.high[at], self.front[i] if self.front else self.high[at]
            # Between side and front the limit goes over evenly with the direction; our own choice.
            ahead = np.sin(np.clip(plane, 0, np.pi / 2)) ** 2
            most = side_most + (front_most - side_most) * ahead
            out[..., at] = np.clip(angles[..., at], np.minimum(self.low[at], most), most)
        return np.asarray(out)


@dataclass(frozen=True)
class Exercise:
    """An exercise of the upper body: from rest through key poses and back to rest.

    Attributes:
        name: Its name, that of its file.
        title: What it is called on the page.
        say: What the coach says before it is shown.
        about: What it is good for, in one plain sentence.
        poses: The key poses in their order.
        rest: Angles where it begins and ends [deg]; 0 where not named.
        return_s: Time from the last pose back to rest [s].
        repetitions: How often it is to be done.
        judged: What is demanded.
        source: Where the exercise and its figures come from.
    """

    name: str
    title: str
    say: str
    about: str
    poses: tuple[KeyPose, ...]
    rest: dict[str, float]
    return_s: float
    repetitions: int = 5
    judged: Demand = field(default_factory=Demand)
    source: str = "our own choice"

    def __post_init__(self) -> None:
        object.__setattr__(self, "rest", both_sides(self.rest))
        if self.repetitions < 1:
            raise ConfigError(f"repetitions must be at least 1, got {self.repetitions}")
        if not (math.isfinite(self.return_s) and self.return_s > 0):
            raise ConfigError(f"return_s must be positive, got {self.return_s}")

    @cached_property
    def keys(self) -> Array:
        """Rest, the key poses, and rest again [rad], shape [poses + 2, 16]."""
        rows = [self.rest, *({**self.rest, **pose.angles_deg} for pose in self.poses), self.rest]
        return np.radians([[row.get(motion, 0.0) for motion in MOTIONS] for row in rows])

    @cached_property
    def _starts(self) -> Array:
        """When each move begins, and the end [s], shape [poses + 2]."""
        spans = [pose.move_s + pose.hold_s for pose in self.poses]
        return np.concatenate(([0.0], np.cumsum([*spans, self.return_s])))

    @cached_property
    def _moves(self) -> Array:
        return np.array([*(pose.move_s for pose in self.poses), self.return_s])

    @property
    def duration(self) -> float:
        """Time of one repetition [s]."""
        return float(self._starts[-1])

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """What has to move, of `PARTS`."""
        excursions = self.excursions(self.keys)
        return tuple(part for part in PARTS if excursions[part] >= SMALLEST)

    @cached_property
    def _swept(self) -> tuple[str, ...]:
        """Arms that go from the side to the front while they are raised."""
        found = []
        for side, part in zip(SIDES, ARMS, strict=True):
            elevation, plane = self.keys[1:-1, ARM[side]][:, :2].T
            closes = np.diff(plane) >= SMALLEST
            is_up = np.minimum(elevation[:-1], elevation[1:]) - self.keys[0, ARM[side].start]
            if (closes & (is_up >= SMALLEST)).any():
                found.append(part)
        return tuple(found)

    @property
    def can_do(self) -> bool:
        """Whether there is anything to do in it."""
        return bool(self.parts)

    def excursions(self, angles: Array) -> dict[str, float]:
        """Return how far each part gets from rest on a path of angles [frames, 16] [rad]."""
        found, rest = directions(angles), directions(self.keys[0])
        return {part: float(_between(found[part], rest[part]).max()) for part in PARTS}

    def angles(self, time: float | Array) -> Array:
        """Return the angles [rad], shape [..., 16], at times since the beginning [s], shape [...].

        The way from one key pose to the next is one of least jerk (Flash & Hogan 1985, J. Neurosci. 5,
        1688-1703). Before the beginning and after the end it is rest.
        """
        t = np.asarray(time, dtype=np.float64)
        k = np.clip(np.searchsorted(self._starts, t, side="right") - 1, 0, len(self._moves) - 1)
        share = np.clip((t - self._starts[k]) / self._moves[k], 0.0, 1.0)
        share = share**3 * (10 + share * (6 * share - 15))
        return np.asarray(self.keys[k] + share[..., None] * (self.keys[k + 1] - self.keys[k]))

    def path(self, rate: float = 30.0) -> Array:
        """Return one repetition at `rate` frames a second [rad], shape [frames, 16]."""
        return self.angles(np.arange(int(self.duration * rate) + 1) / rate)

    def faster(self, factor: float) -> Exercise:
        """Return this exercise shown `factor` times as fast."""
        if not (math.isfinite(factor) and factor > 0):
            raise ConfigError(f"an exercise goes a positive factor faster, got {factor}")
        poses = tuple(
            replace(p, move_s=p.move_s / factor, hold_s=p.hold_s / factor) for p in self.poses
        )
        return replace(self, poses=poses, return_s=self.return_s / factor)

    def adapted(self, reach: Reach) -> Exercise:
        """Return what this exercise is for one person: no goal goes beyond their reach.

        What they can do next to nothing of is left out, and an arm that cannot take part in every key pose it
        has one in; see `can_do` for whether anything is left.
        """
        keys = reach.clip(self.keys)
        goals, own = directions(self.keys), directions(keys)
        for part in self.parts:
            asked = _between(goals[part], goals[part][0]) >= SMALLEST
            way = _between(goals[part], own[part][0])
            nearer = way - _between(goals[part], own[part])
            lost = nearer < np.maximum(SMALLEST, SMALLEST_SHARE * way)
            is_beyond = lost[asked].any() if part.endswith("arm") else lost[asked].all()
            if is_beyond or part in self._swept and not reach.sweeps[ARMS.index(part)]:
                keys[:, COLUMNS[part]] = keys[0, COLUMNS[part]]
        judged = self.judged if reach.straightens else replace(self.judged, elbow_deg=180.0)
        return replace(self._with_keys(keys), judged=judged)

    def with_own_goal(self, share: float) -> Exercise:
        """Return this exercise with goals of somebody who gets so far, as far as it allows that.

        Args:
            share: Share of the way to the key poses that they reach, such as the median of what repetitions
                measured as `<part>_range`; not below `judged.least_goal`.

        Raises:
            ConfigError: If the share is not positive.
        """
        if not (math.isfinite(share) and share > 0):
            raise ConfigError(f"somebody's own range is a positive share, got {share}")
        share = min(max(share, self.judged.least_goal), 1.0)
        return self._with_keys(self.keys[0] + share * (self.keys - self.keys[0]))

    def one_sided(self, side: str) -> Exercise:
        """Return the half of this exercise that one side does; of the head, what goes to that side."""
        check_name("side", side, SIDES)
        keys = self.keys.copy()
        other = SIDES[1 - SIDES.index(side)]
        keys[:, ARM[other]] = keys[0, ARM[other]]
        bounds = (0.0, np.inf) if side == "left" else (-np.inf, 0.0)
        for motion in MOTIONS[:6]:
            if motion.endswith("_left"):
                column = MOTION_INDEX[motion]
                keys[:, column] = np.clip(keys[:, column], *bounds)
        return self._with_keys(keys)

    def _with_keys(self, keys: Array) -> Exercise:
        """Return this exercise through other keys, without those that no longer move anything."""
        poses: list[KeyPose] = []
        before = keys[0]
        for pose, key in zip(self.poses, keys[1:-1], strict=True):
            if np.abs(key - before).max() > 1e-9:
                poses.append(replace(pose, angles_deg=_named(key)))
                before = key
        while poses and np.abs(before - keys[0]).max() <= 1e-9:  # ends at rest already
            poses.pop()
            if poses:
                before = np.radians([poses[-1].angles_deg[motion] for motion in MOTIONS])
        return replace(self, poses=tuple(poses), rest=_named(keys[0]))


def _between(a: Array, b: Array) -> Array:
    """Return the angles between unit vectors [..., 3] [rad], shape [...]."""
    return np.asarray(np.arccos(np.clip((a * b).sum(axis=-1), -1, 1)))


def _named(angles: Array) -> dict[str, float]:
    return dict(zip(MOTIONS, np.degrees(angles).tolist(), strict=True))


def both_sides(angles_deg: dict[str, float]) -> dict[str, float]:
    """Return angles by the names of `MOTIONS`, those of an arm without a side given to both.

    Raises:
        UnknownNameError: If a name is no motion.
        ConfigError: If an angle is not within 200 degrees of 0, or is given twice.
    """
    out: dict[str, float] = {}
    for name, value in angles_deg.items():
        if name not in MOTION_INDEX and name not in ARM_MOTIONS:
            raise UnknownNameError("motion", name, (*MOTIONS, *ARM_MOTIONS))
        if not (math.isfinite(value) and abs(value) <= 200):
            raise ConfigError(f"{name} must lie in -200..200 deg, got {value}")
        named = (name,) if name in MOTION_INDEX else tuple(f"{side}_{name}" for side in SIDES)
        for motion in named:
            if motion in out:
                raise ConfigError(f"{motion} is given twice, for both sides and for its own")
            out[motion] = value
    return out


def exercise_names() -> tuple[str, ...]:
    """Return the names of all exercises there are."""
    return assets.names("exercises")


def load_exercise(name: str | Path) -> Exercise:
    """Return an exercise, by its name or from a YAML file of your own.

    Raises:
        UnknownNameError: If there is none of that name; or the file names an unknown motion.
        ConfigError: If the file is no exercise, or nothing moves in it.
    """
    is_file = isinstance(name, Path) or name.endswith((".yaml", ".yml"))
    path = Path(name) if is_file else assets.find("exercises", str(name))
    return exercise_of(path.stem, read_yaml(path), str(path))


def exercise_of(name: str, fields: Mapping[str, Any], where: str) -> Exercise:
    """Return the exercise of a name whose YAML says these fields; `where` it is from is for messages.

    Raises:
        ConfigError: If it is no exercise, or nothing moves in it.
    """
    exercise = load(Exercise, {"name": name, **fields}, where=where)
    if not exercise.can_do:
        raise ConfigError(f"{where}: nothing moves in this exercise")
    return exercise


def load_exercises(names: Iterable[str] | None = None) -> Sequence[Exercise]:
    """Return several exercises; all there are if None."""
    return tuple(load_exercise(name) for name in (exercise_names() if names is None else names))
