"""What recognition looks at in a frame, and what a right repetition of an exercise looks like.

Directions of arms, head and trunk have no jumps; a template has the ways of these, and how long they take.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rcare_marl.pose import Array

from ...people.motion.trajectory import PEAK
from ..exercise import SMALLEST, Exercise
from ..upper_body import ARM, FOREARM, SIDES, UPPER_ARM

MOVING = (
    "left_arm",
    "right_arm",
    "head",
)  # parts that an exercise may ask for; the trunk's are faults
RATE = 30.0  # frames a second at which ways are compared
PATH_POINTS = 40
UPRIGHT = 0.5  # length of a unit vector along a way below which it is nowhere on it; our own choice
OVERDONE = math.radians(45)  # going further than shown is no other direction
STARTED = 0.2  # share of the greatest excursion at which a movement counts as begun; our own choice


# Seven vectors in the frame of the trunk (the trunk's own: in that of the hips), then three angles [rad].
VECTORS = ("left_arm", "right_arm", "head", "crown", "trunk", "left_wrist", "right_wrist")
ANGLES = ("left_elbow", "right_elbow", "trunk_rotation")
COLUMN = {name: slice(3 * i, 3 * i + 3) for i, name in enumerate(VECTORS)}
ANGLE_COLUMN = {name: 3 * len(VECTORS) + i for i, name in enumerate(ANGLES)}
SIZE = 3 * len(VECTORS) + len(ANGLES)
NEARLY_STRAIGHT, CLEARLY_BENT = math.radians(60), math.radians(90)  # of elbows; our own choice
# Who is never asked to straighten an elbow further cannot: the forearm hangs as it may. Our own choice.
NEVER_STRAIGHT = math.radians(25)
_UPPER_SHARE = UPPER_ARM / (UPPER_ARM + FOREARM)


def feature(angles: Array, bent: tuple[bool, bool] = (False, False)) -> Array:
    """Return the features of one frame, shape [24]; NaN where they are unknown.

    Head and trunk are unit vectors as of `upper_body.directions`. So are arms, but an arm that is nearly
    straight points to its wrist: a source that takes an arm for too long sees it bent, and its upper arm
    elsewhere, but knows where the wrist is. A wrist is where it is from its shoulder, as a share of the arm.

    Args:
        angles: Angles of `MOTIONS` [rad], shape [16].
        bent: Whether left and right elbow cannot be straightened: the arm points as its upper arm does, for
            a weak shoulder lets the forearm hang.
    """
    a = angles.tolist()  # in plain numbers: arrays this short take ten times as long
    left, left_wrist = _arm(1.0, bent[0], *a[6:10])
    right, right_wrist = _arm(-1.0, bent[1], *a[11:15])
    flexion, lateral = a[0], a[1]
    trunk = (
        math.sin(flexion) * math.cos(lateral),
        math.sin(lateral),
        math.cos(flexion) * math.cos(lateral),
    )
    nose, crown = _head(a[3], a[4], a[5])
    angle = (a[9], a[14], a[2])
    return np.array((*left, *right, *nose, *crown, *trunk, *left_wrist, *right_wrist, *angle))


_Vector = tuple[float, float, float]


def _arm(
    sign: float, hangs: bool, elevation: float, plane: float, rotation: float, elbow: float
) -> tuple[_Vector, _Vector]:
    """Return where the arm points, and where its wrist is as a share of the arm's length."""
    ce, se, cp, sp = math.cos(elevation), math.sin(elevation), math.cos(plane), math.sin(plane)
    upper = (se * sp, sign * se * cp, -ce)
    # The forearm in the hanging arm, then swung up as in `upper_body.swing`.
    bend = math.sin(elbow)
    fx, fy, fz = bend * math.cos(rotation), -sign * bend * math.sin(rotation), -math.cos(elbow)
    px, py = fx * cp - sign * fy * sp, sign * fx * sp + fy * cp
    qy, qz = ce * py - sign * se * fz, sign * se * py + ce * fz
    fore = (px * cp + sign * qy * sp, -sign * px * sp + qy * cp, qz)
    share = _UPPER_SHARE
    x, y, z = (share * u + (1 - share) * f for u, f in zip(upper, fore, strict=True))
    bent = (elbow - NEARLY_STRAIGHT) / (CLEARLY_BENT - NEARLY_STRAIGHT)
    if hangs or bent >= 1.0 or not math.isfinite(x):  # a source may not know the forearm
        return upper, (x, y, z)
    bent, length = max(bent, 0.0), math.sqrt(x * x + y * y + z * z)
    points = [bent * u + (1 - bent) * w / length for u, w in zip(upper, (x, y, z), strict=True)]
    size = math.sqrt(sum(value * value for value in points))
    return (points[0] / size, points[1] / size, points[2] / size), (x, y, z)


def _head(flexion: float, lateral: float, rotation: float) -> tuple[_Vector, _Vector]:
    """Return where the nose and the top of the head point."""
    cf, sf, cr, sr = math.cos(flexion), math.sin(flexion), math.cos(rotation), math.sin(rotation)
    cl, sl = math.cos(lateral), math.sin(lateral)
    nose = (cr * cf, sr * cf, -sf)
    crown = (cr * sf * cl - sr * sl, sr * sf * cl + cr * sl, cf * cl)
    return nose, crown


def features(angles: Array, bent: tuple[bool, bool] = (False, False)) -> Array:
    """Return the features of frames of angles [n, 16], shape [n, 24]; `bent` as for `feature`."""
    return np.array([feature(row, bent) for row in angles])


@dataclass(frozen=True, eq=False)
class Phase:
    """The way of one part from one key pose to the next.

    Attributes:
        start: Direction at its beginning, shape [3].
        end: Direction at its end, shape [3].
        across: Unit vector in the plane of the way, a right angle on from its beginning, shape [3].
        angle: Its length [rad].
        scale: What counts as all of it: its length, or how far its end is from rest if that is less [rad].
    """

    start: Array
    end: Array
    across: Array
    angle: float
    scale: float

    def share(self, directions: Array, scale: float | None = None) -> Array:
        """Return how much of the way directions [..., 3] have gone: 0 not begun, 1 all, more beyond.

        A direction that stands nearly upright on the way is nowhere on it: 0.

        Args:
            directions: Unit vectors, shape [..., 3].
            scale: What counts as all of it [rad]; its own if None.
        """
        scale = self.scale if scale is None else scale
        x, y = directions @ self.start, directions @ self.across
        gone = np.arctan2(y, x)
        # What lies opposite the beginning is beyond the end or before the beginning, whichever is nearer.
        gone = np.where(gone < 0.5 * self.angle - math.pi, gone + 2 * math.pi, gone)
        return np.where(np.hypot(x, y) > UPRIGHT, 1.0 - (self.angle - gone) / scale, 0.0)

    def beyond(self) -> Array:
        """Return directions on its way on beyond its end, as far as somebody may overdo it, shape [6, 3]."""
        gone = self.angle + np.linspace(0.0, OVERDONE, 7)[1:, None]
        return np.asarray(np.cos(gone) * self.start + np.sin(gone) * self.across)

    def scale_from(self, rest: Array) -> float:
        """Return what counts as all of it [rad] for somebody who rests with the part along `rest` [3]."""
        own = min(self.angle, float(between(rest, self.end)))
        return min(max(own, 0.6 * self.scale), 1.2 * self.scale)


@dataclass(frozen=True, eq=False)
class Way:
    """What one part does in an exercise.

    Attributes:
        part: Which, of `MOVING`.
        rest: Its direction at rest, shape [3].
        phases: Its ways out; the way back to rest is none.
        path: Directions all along, then those beyond the ends of its phases, shape [points, 3].
        excursion: How far it gets from rest [rad].
    """

    part: str
    rest: Array
    phases: tuple[Phase, ...]
    path: Array
    excursion: float

    @property
    def passes_rest(self) -> bool:
        """Whether the way from one key pose to the next comes near rest."""
        ways = [arc(phase.start, phase.end) for phase in self.phases[1:]]
        return any(float(between(way, self.rest).min()) < 0.4 * self.excursion for way in ways)


class Template:
    """An exercise as its recogniser compares it.

    Attributes:
        exercise: The exercise.
        ways: What each part does that has to move.
        moving_time: From where it has begun to where it is nearly back [s].
        slowest_move: Greatest speed of any part on the way from one key pose to the next, of the move where
            that is least [rad/s]; infinite where nothing moves.
        elbows: Greatest flexion of left and right elbow at the key poses [rad].
        bent: Whether left and right elbow are never asked to be straight.
    """

    def __init__(self, exercise: Exercise) -> None:
        self.exercise = exercise
        least = exercise.keys[:, [ARM[side].start + 3 for side in SIDES]].min(axis=0)
        self.bent = (bool(least[0] > NEVER_STRAIGHT), bool(least[1] > NEVER_STRAIGHT))
        rows = features(exercise.path(RATE), self.bent)
        keys = features(exercise.keys, self.bent)
        self.ways = {
            part: _way(part, keys[:, COLUMN[part]], rows[:, COLUMN[part]])
            for part in MOVING
            if part in exercise.parts
        }
        spread = [
            between(rows[:, COLUMN[p]], way.rest) / way.excursion for p, way in self.ways.items()
        ]
        moved = np.flatnonzero(np.max(spread, axis=0) > STARTED) if spread else np.zeros(1)
        self.slowest_move = _slowest_move(exercise, keys)
        self.moving_time = max(float(moved[-1] - moved[0]) / RATE, 1 / RATE)
        self.elbows = {
            side: float(keys[1:-1, ANGLE_COLUMN[f"{side}_elbow"]].max(initial=0.0))
            for side in ("left", "right")
        }

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms that have to move."""
        return tuple(part for part in self.ways if part != "head")


def _slowest_move(exercise: Exercise, keys: Array) -> float:
    """Return the greatest speed of any part on the slowest move [rad/s]; `keys` are its features."""
    columns = [COLUMN[part] for part in MOVING]
    ways = np.max([between(keys[1:, c], keys[:-1, c]) for c in columns], axis=0)
    times = np.array([*(pose.move_s for pose in exercise.poses), exercise.return_s])
    return float((PEAK * ways / times)[ways >= SMALLEST].min(initial=math.inf))


def _way(part: str, keys: Array, path: Array) -> Way:
    rest = keys[0]
    phases = []
    for start, end in zip(keys[:-2], keys[1:-1], strict=True):
        angle = float(between(start, end))
        if angle < SMALLEST:
            continue
        across = end - (end @ start) * start
        length = float(np.linalg.norm(across))
        if length < 1e-6:  # half a turn: any way is as short
            continue
        far = float(between(rest, end))
        scale = min(angle, far) if far >= SMALLEST else angle
        phases.append(Phase(start, end, across / length, angle, scale))
    beyond = [phase.beyond() for phase in phases]
    picked = path[np.linspace(0, len(path) - 1, min(PATH_POINTS, len(path))).round().astype(int)]
    excursion = float(between(path, rest).max())
    return Way(part, rest, tuple(phases), np.concatenate((picked, *beyond)), excursion)


def between(a: Array, b: Array) -> Array:
    """Return the angle between unit vectors [..., 3] [rad], shape [...]."""
    return np.asarray(np.arccos(np.clip((a * b).sum(axis=-1), -1.0, 1.0)))


def arc(start: Array, end: Array, count: int = 12) -> Array:
    """Return directions on the shortest way from one to another, shape [count, 3]."""
    angle = float(between(start, end))
    if angle < 1e-6:
        return np.tile(start, (count, 1))
    share = np.linspace(0.0, 1.0, count)[:, None]
    mixed = np.sin((1 - share) * angle) * start + np.sin(share * angle) * end
    return np.asarray(mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-9))


def off_path(directions: Array, path: Array) -> Array:
    """Return how far directions [..., 3] are from the nearest point of a path [points, 3] [rad]."""
    return np.asarray(np.arccos(np.clip((directions @ path.T).max(axis=-1), -1.0, 1.0)))
