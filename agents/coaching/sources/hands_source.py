"""Poses from a headset and two gloves or controllers, by inverse kinematics of the upper limbs.

What a headset and two hands do not show is not made up: how the trunk is turned shows only in how both
hands lie (and not at all while they are held still on something), and a head pushed forward looks like a
trunk that leans.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d  # type: ignore[import-untyped]
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose

from ..recognition.recogniser import Frame
from ..upper_body import ARM, MOTIONS, SIDES, Sex, UpperBody, turn_z
from .arm_pose import arm_motion, axes_of, trunk_axes
from .body_fit import BodyFit, Seen
from .elbow_posterior import elbow_posterior
from .one_euro import OneEuro

# All our own choice.
SETTLING = 1.0  # without a calibration what is seen so long counts as sitting upright [s]
LOOK, FIT_EVERY, MOST_SEEN = 0.1, 0.5, 200  # how the body is learnt: [s], [s], arms kept
AVERAGED = 7  # frames of a calibration
# How much straighter an elbow may be is asked at so many standard deviations of its bend, and for that at so
# many of the distance: lengths err more than a fit says. Chosen on three people of `development`.
FAR, FAR_OFF = 3.0, 4.0
HANGS = 0.94  # share of its length from which an arm at rest counts as hanging
LEFT_HOME = 0.2  # a hand so far from where it was first is not at rest [m]
TURN_TIME = 0.15  # time constant of the trunk's turn [s]
# By so much of what hands at rest say is the body turned aside from the nose, up to an angle [rad].
BY_HANDS, GREATEST_ASIDE = 0.5, math.radians(45)
GREATEST_TURN = math.radians(60)
ABOUT = {  # standard deviations [rad]: what a headset does not tell of the trunk, and hands of arms
    "lean": math.radians(2.5),
    "turn": math.radians(12),
    "head": math.radians(3),
    "rotation": math.radians(25),
}


@dataclass(frozen=True)
class HandsReading:
    """What a headset and two hands report at one time, in any frame with z up; None where tracking is lost.

    Attributes:
        head: Of the eyes, x where the nose points, z up.
        left: Of the middle of the left palm, x along the fingers, z out of the back of the hand.
        right: Of the right one.
    """

    head: Pose | None
    left: Pose | None
    right: Pose | None


class HandsSource:
    """Makes frames of head and hand poses.

    Attributes:
        fit: What is known of the person's body; keep it, and their next session begins with it.
        is_swapped: Whether the left hand's device is held in the right hand, as the calibration saw; frames
            are of the hands as they are.
    """

    def __init__(
        self, height: float, *, sex: Sex | None = None, fit: BodyFit | None = None
    ) -> None:
        """Prepare a source.

        Args:
            height: Stature of the person [m].
            sex: Whose proportions to begin with; the mean of both if None.
            fit: What an earlier session found out of the same person.
        """
        self.is_swapped = False
        usual = BodyFit.of(UpperBody.of_height(height, sex=sex), height)
        self.fit = usual if fit is None else replace(fit, aside=0.0)  # that is of one sitting
        self._filter = OneEuro(cutoff=2.5, beta=np.repeat((6.0, 3.0), (9, 12)))
        self._base: tuple[Array, Array, Array] | None = None
        self._settling: list[HandsReading] = []
        self._settled_at: float | None = None
        self._quaternions = np.full((3, 4), np.nan)
        self._rotation = dict.fromkeys(SIDES, 0.0)
        self._raised = dict.fromkeys(SIDES, (0.0, 0.0))
        self._turn, self._turned_at = 0.0, -math.inf
        self._home: dict[str, Array] = {}  # where each hand was first
        self._known, self._arms = self.fit, list[Seen]()
        self._every, self._looked_at, self._fitted_at = LOOK, -math.inf, -math.inf

    @property
    def body(self) -> UpperBody:
        """Lengths of the person's body, as far as they are known."""
        return self.fit.body

    def calibrate(self, readings: Sequence[HandsReading]) -> None:
        """Learn where a person sits, how the headset sits on them, and how they are built.

        Args:
            readings: Of a person who sits upright and looks ahead, and then, best, moves straight arms: down,
                forward, to the sides, round. The first tenth, a second at least, is taken for upright.

        Raises:
            ConfigError: If the head is in none of them, or what arms reach does not fit the stature.
        """
        heads = [r.head for r in readings if r.head is not None]
        if not heads:
            raise ConfigError("a calibration needs readings in which the head is seen")
        first = heads[: max(30, len(heads) // 10)]
        eyes = np.median([head.position for head in first], axis=0)
        turn = Rotation.from_quat([head.quaternion for head in first]).mean().as_matrix()
        gaze = math.atan2(turn[1, 0], turn[0, 0])
        self.is_swapped = self._crossed(readings, gaze)
        readings = [self._sorted(raw) for raw in readings]
        aside = self._aside(readings, gaze)
        to_body = turn_z(-gaze - aside)
        worn = (turn_z(-gaze) @ turn).T  # takes out how the headset is tilted on the head
        body = self.body
        upright = turn_z(-aside) @ np.array((body.eyes, 0.0, body.head))
        upright[2] += body.trunk + body.neck
        self._base = (to_body, upright - to_body @ eyes, worn)
        self._arms = self._seen(readings)
        self.fit = self._known.refined(self._arms)
        self._home = {}

    def _crossed(self, readings: Sequence[HandsReading], gaze: float) -> bool:
        """Return whether what is called the left hand is well to the right of the other."""
        apart = [
            math.cos(gaze) * (r.left.position[1] - r.right.position[1])
            - math.sin(gaze) * (r.left.position[0] - r.right.position[0])
            for r in readings
            if r.left is not None and r.right is not None
        ]
        return bool(apart) and float(np.median(apart)) < -self.body.shoulder

    def _sorted(self, raw: HandsReading) -> HandsReading:
        return HandsReading(raw.head, raw.right, raw.left) if self.is_swapped else raw

    def _aside(self, readings: Sequence[HandsReading], gaze: float) -> float:
        """Return how much further to the left than the nose the body looks, by its hands at rest [rad]."""
        pairs = [
            np.subtract(r.left.position, r.right.position)
            for r in readings[: max(30, len(readings) // 10)]
            if r.left is not None and r.right is not None
        ]
        if not pairs:
            return 0.0
        x, y, z = np.median(pairs, axis=0)
        if math.hypot(x, y) < self.body.shoulder or abs(z) > 0.5 * self.body.shoulder:
            return 0.0
        turn = math.remainder(math.atan2(-x, y) - gaze, 2 * math.pi)
        return BY_HANDS * turn if abs(turn) < GREATEST_ASIDE else 0.0

    def _seen(self, readings: Sequence[HandsReading]) -> list[Seen]:
        """Return wrists and hands in the frame of the trunk, of readings in which the head is seen.

        Noise is averaged out first: of noisy arms the furthest count, which look longer than they are.
        """
        found = [self._in_body(raw) for raw in readings if raw.head is not None]
        positions, turns = (_averaged(np.array([each[k] for each in found])) for k in (0, 1))
        step = max(1, len(readings) // 120)
        each = zip(positions[::step], turns[::step], strict=True)
        return [one for position, turn in each for one in self._arms_of(position, turn)]

    def _arms_of(self, positions: Array, turns: Array) -> list[Seen]:
        """Return palms and fingers in the frame of the trunk, of places and axes in that of the body."""
        shoulders, leaned, _, _ = self._trunk(positions[0], turns[0])
        return [
            (side, (positions[i] - shoulders) @ leaned, turns[i][:, 0] @ leaned)
            for i, side in enumerate(SIDES, start=1)
            if np.isfinite(positions[i]).all()
        ]

    def update(self, raw: HandsReading, time: float) -> Frame | None:
        """Return what is known at a time [s]; None while the head is not seen or nothing is calibrated."""
        if self._base is None and not self._settle(raw, time):
            return None
        raw = self._sorted(raw)
        positions, turns = self._filtered(raw, time)
        if not np.isfinite(positions[0]).all():
            return None
        if time - self._looked_at >= self._every:
            self._note_reach(positions, turns, time)
        angles, unsure = np.full(len(MOTIONS), np.nan), np.full(len(MOTIONS), np.nan)
        head, body = turns[0], self.body
        shoulders, leaned, flexion, lateral = self._trunk(positions[0], head)
        wrists = {}
        for i, side in enumerate(SIDES, start=1):
            if np.isfinite(positions[i]).all():
                wrists[side] = (positions[i] - turns[i][:, 0] * body.palm - shoulders) @ leaned
        if len(wrists) == 2:
            self._note_turn(wrists["left"], wrists["right"], time)
        trunk = trunk_axes(flexion, lateral, self._turn)
        angles[:3] = flexion, lateral, self._turn
        unsure[:3] = ABOUT["lean"], ABOUT["lean"], ABOUT["turn"]
        angles[3:6] = _neck(trunk.T @ head)
        unsure[3:6] = ABOUT["head"]
        untwist = trunk.T @ leaned
        for i, side in enumerate(SIDES, start=1):
            if side in wrists:
                arm = ARM[side]
                angles[arm], unsure[arm] = self._arm(
                    side, untwist @ wrists[side], trunk.T @ turns[i]
                )
        return Frame(time, angles, unsure)

    def _note_reach(self, positions: Array, turns: Array, time: float) -> None:
        """Keep what arms show of the body, evenly over the session, and fit the body to it now and then."""
        self._looked_at = time
        # What lies at rest tells little, and a body that is fitted to it would move while nobody does.
        found = self._arms_of(positions, turns)
        self._arms += [each for each in found if self._has_left(each[0], each[1])]
        if len(self._arms) > MOST_SEEN:
            del self._arms[::2]
            self._every *= 2
        if time - self._fitted_at >= FIT_EVERY:
            self._fitted_at = time
            self.fit = self._known.refined(self._arms)

    def _has_left(self, side: str, palm: Array) -> bool:
        """Return whether a hand is away from where it rests, both hanging.

        Where an arm that lies bent is thought to be depends on lengths so much that it would seem to move
        with them.
        """
        if len(self._home) < 2 or math.dist(palm, self._home[side]) < LEFT_HOME:
            return False
        length = self.body.upper_arm + self.body.forearm
        homes = [self._home[each] - self.fit.shoulder(each, 0.0, 0.0) for each in SIDES]
        return all(math.hypot(*home.tolist()) > HANGS * length for home in homes)

    def _trunk(self, eyes: Array, head: Array) -> tuple[Array, Array, float, float]:
        """Return the middle of the shoulders [m], the axes of the trunk, its flexion and lateral flexion."""
        body = self.body
        neck = eyes - head @ np.array((body.eyes, 0.0, body.head))
        x, y, z = (neck / math.sqrt(float(neck @ neck))).tolist()
        flexion, lateral = math.atan2(x, z), math.asin(y)
        leaned = trunk_axes(flexion, lateral, 0.0)
        at = np.array((self.fit.forward, self.fit.aside, body.trunk))
        return leaned @ at, leaned, flexion, lateral

    def _settle(self, raw: HandsReading, time: float) -> bool:
        """Take the first second for sitting upright; return whether it is over."""
        if raw.head is not None:
            self._settling.append(raw)
            self._settled_at = time + SETTLING if self._settled_at is None else self._settled_at
        if self._settled_at is None or time < self._settled_at:
            return False
        self.calibrate(self._settling)
        return True

    def _in_body(self, raw: HandsReading) -> tuple[Array, Array]:
        """Return positions [3, 3] and axes [3, 3, 3] of head and hands in the frame of the body."""
        assert self._base is not None
        to_body, offset, worn = self._base
        positions, turns = np.full((3, 3), np.nan), np.full((3, 3, 3), np.nan)
        for i, pose in enumerate((raw.head, raw.left, raw.right)):
            if pose is not None and _is_sound(pose):
                positions[i] = to_body @ np.array(pose.position) + offset
                turns[i] = to_body @ axes_of(pose.quaternion)
        turns[0] = turns[0] @ worn
        return positions, turns

    def _filtered(self, raw: HandsReading, time: float) -> tuple[Array, Array]:
        """Return smoothed positions [3, 3] and axes [3, 3, 3] of head and hands in the frame of the body."""
        values = np.full(21, np.nan)
        positions, quaternions = values[:9].reshape(3, 3), values[9:].reshape(3, 4)
        for i, pose in enumerate((raw.head, raw.left, raw.right)):
            if pose is None or not _is_sound(pose):
                continue  # what a device reports that has lost its way
            positions[i] = pose.position
            quaternions[i] = np.array(pose.quaternion) / math.hypot(*pose.quaternion)
        flipped = (quaternions * self._quaternions).sum(axis=1) < 0
        quaternions[flipped] *= -1
        known = np.isfinite(quaternions[:, 0])
        self._quaternions[known] = quaternions[known]
        values = self._filter.update(values, time)
        poses = [
            Pose(tuple(values[3 * i : 3 * i + 3].tolist()), tuple(values[9 + 4 * i :][:4].tolist()))
            if known[i]
            else None
            for i in range(3)
        ]
        return self._in_body(HandsReading(*poses))

    def _note_turn(self, left: Array, right: Array, time: float) -> None:
        """Learn how the trunk is turned from two wrists in the frame of the trunk that is not turned [m].

        Where the hands do not lie alike about a turned body, it is taken for not turned.
        """
        width = self.body.shoulder
        across = (left - right).tolist()
        middle = (0.5 * (left + right)).tolist()
        turn = math.atan2(-across[0], across[1])
        half = 0.5 * math.hypot(across[0], across[1])
        # About a body that is turned so, how far the middle of the hands is ahead and to the side.
        ahead = abs(middle[0] * math.cos(turn) + middle[1] * math.sin(turn))
        aside = abs(middle[1] * math.cos(turn) - middle[0] * math.sin(turn))
        alike = 1.0 - _beyond(aside / (half + ahead + 1e-9), 0.06, 0.18)
        alike *= 1.0 - _beyond(abs(across[2]) / width, 0.3, 1.2)
        alike *= min(half / (0.75 * width), 1.0)
        # One hand that moves alone is no turn of the trunk.
        hands = {"left": left, "right": right}
        if not self._home:
            self._home = {side: hand.copy() for side, hand in hands.items()}
        moved = [math.dist(hands[side], self._home[side]) + 0.03 for side in SIDES]
        alike *= _beyond(min(moved) / max(moved), 0.2, 0.5)
        turn = min(max(alike * turn, -GREATEST_TURN), GREATEST_TURN)
        dt, self._turned_at = time - self._turned_at, time
        self._turn += (1 - math.exp(-dt / TURN_TIME)) * (turn - self._turn)

    def _arm(self, side: str, wrist: Array, hand: Array) -> tuple[Array, Array]:
        """Return the angles of an arm and how unsure they are [rad], shape [5] each.

        Args:
            side: Which.
            wrist: From the middle of the shoulders in the frame of the trunk [m].
            hand: Axes of the hand there.
        """
        body = self.body
        at = self.fit.shoulder(side, *self._raised[side])
        upper, fore, bend = elbow_posterior(
            side, wrist - at, body.upper_arm, body.forearm, hand[:, 0], self.fit.of_reach
        )
        out = arm_motion(side, upper, fore, hand, rotation=self._rotation[side])
        self._rotation[side], self._raised[side] = out[2], out[:2]
        about = math.hypot(self.fit.of_direction, 0.25 * bend)
        # An arm that is taken for too long by so much looks bent by this, the less the more it is bent.
        straighter = min(math.cos(0.5 * out[3]) + FAR_OFF * self.fit.of_reach, 1.0)
        bend = max(bend, (out[3] - 2 * math.acos(straighter)) / FAR)
        sine = max(math.sin(out[0]), 0.2)
        unsure = (about, about / sine, ABOUT["rotation"] + bend, bend, ABOUT["rotation"])
        return np.array(out), np.array(unsure)


def _averaged(values: Array) -> Array:
    """Return the running mean of `AVERAGED` frames of values [n, ...]; NaN where they are."""
    known = np.isfinite(values)
    size, kept = min(AVERAGED, len(values)), np.where(known, values, 0.0)
    total, count = (uniform_filter1d(each, size, axis=0) for each in (kept, known.astype(float)))
    return np.where(known, total / np.maximum(count, 1e-9), np.nan)


def _is_sound(pose: Pose) -> bool:
    """Return whether a device reports a place and a turn at all."""
    return 0.5 < math.hypot(*pose.quaternion) < 2.0 and math.isfinite(sum(pose.position))


def _beyond(value: float, low: float, high: float) -> float:
    """Return 0 up to `low`, 1 from `high` on, evenly between."""
    return min(max((value - low) / (high - low), 0.0), 1.0)


def _neck(turn: Array) -> tuple[float, float, float]:
    """Return flexion, lateral flexion and rotation of a head turned so against the trunk [rad]."""
    rotation = math.atan2(turn[1, 0], turn[0, 0])
    flexion = math.asin(min(max(-turn[2, 0], -1.0), 1.0))
    lateral = -math.atan2(turn[2, 1], turn[2, 2])
    return flexion, lateral, rotation
