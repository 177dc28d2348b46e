"""Poses from a headset and two gloves or controllers, by inverse kinematics of the upper limbs.

What a headset and two hands do not show is not made up: how the trunk is turned shows only in how both
hands lie (and not at all while they are held still on something), and a head pushed forward looks like a
trunk that leans.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, matrix_from_quaternion

from ..recognition.recogniser import Frame
from ..upper_body import ARM, MOTIONS, SIDES, SIGN, UpperBody
from .arm_pose import arm_motion, axes_of, elbow_at, trunk_axes
from .one_euro import OneEuro

# All our own choice.
SETTLING = 1.0  # without a calibration what is seen so long counts as sitting upright [s]
SPREAD = 0.75  # hands further apart than this share of the stature are spread
# An arm that is nearly as far out as it is long counts as straight: by so much its length is not known, as a
# share of it, from the stature alone and from spread arms.
SLACK_OF_STATURE, SLACK_OF_SPAN, NOT_STRAIGHT = 0.05, 0.02, 0.85
HAND_HINT = 0.7  # weight of the hand in where the elbow is; the rest is that elbows hang
TURN_TIME = 0.15  # time constant of the trunk's turn [s]
GREATEST_TURN = math.radians(60)


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
        body: Lengths of the person's body.
    """

    def __init__(self, height: float) -> None:
        """Prepare a source for a person of a stature [m]."""
        self.body, self._height = UpperBody.of_height(height), height
        self._filter = OneEuro(cutoff=2.5, beta=np.repeat((6.0, 3.0), (9, 12)))
        self._slack = SLACK_OF_STATURE
        self._base: tuple[Array, Array] | None = None
        self._settling: list[HandsReading] = []
        self._settled_at: float | None = None
        self._quaternions = np.full((3, 4), np.nan)
        self._rotation = dict.fromkeys(SIDES, 0.0)
        self._turn, self._turned_at = 0.0, -math.inf

    def calibrate(self, readings: Sequence[HandsReading]) -> None:
        """Learn where a person sits and how long their arms are.

        Args:
            readings: Of a person who sits upright and looks ahead, best with both arms spread to the sides,
                which shows how long they are.

        Raises:
            ConfigError: If the head is in none of them, or spread arms do not fit the stature.
        """
        heads = [r.head for r in readings if r.head is not None]
        if not heads:
            raise ConfigError("a calibration needs readings in which the head is seen")
        eyes = np.mean([head.position for head in heads], axis=0)
        noses = np.mean([matrix_from_quaternion(head.quaternion)[:, 0] for head in heads], axis=0)
        yaw = math.atan2(noses[1], noses[0])
        cosine, sine = math.cos(yaw), math.sin(yaw)
        to_body = np.array(((cosine, sine, 0.0), (-sine, cosine, 0.0), (0.0, 0.0, 1.0)))
        body = self.body
        upright = np.array((body.eyes, 0.0, body.trunk + body.neck + body.head))
        self._base = (to_body, upright - to_body @ eyes)
        spans = [
            math.dist(r.left.position, r.right.position) for r in readings if r.left and r.right
        ]
        if spans and float(np.median(spans)) > SPREAD * self._height:
            self.body = UpperBody.of_height(self._height).with_arm_span(float(np.median(spans)))
            self._slack = SLACK_OF_SPAN

    def update(self, raw: HandsReading, time: float) -> Frame | None:
        """Return what is known at a time [s]; None while the head is not seen or nothing is calibrated."""
        if self._base is None and not self._settle(raw, time):
            return None
        positions, turns = self._filtered(raw, time)
        if not np.isfinite(positions[0]).all():
            return None
        angles = np.full(len(MOTIONS), np.nan)
        head = turns[0]
        body = self.body
        neck = positions[0] - head @ np.array((body.eyes, 0.0, body.head))
        x, y, z = (neck / np.linalg.norm(neck)).tolist()
        flexion, lateral = math.atan2(x, z), math.asin(y)
        leaned = trunk_axes(flexion, lateral, 0.0)
        shoulders = leaned[:, 2] * body.trunk
        wrists = {}
        for i, side in enumerate(SIDES, start=1):
            if np.isfinite(positions[i]).all():
                wrists[side] = (positions[i] - turns[i][:, 0] * body.palm - shoulders) @ leaned
        if len(wrists) == 2:
            self._note_turn(wrists["left"], wrists["right"], time)
        trunk = trunk_axes(flexion, lateral, self._turn)
        angles[:3] = flexion, lateral, self._turn
        angles[3:6] = _neck(trunk.T @ head)
        untwist = trunk.T @ leaned
        for i, side in enumerate(SIDES, start=1):
            if side in wrists:
                angles[ARM[side]] = self._arm(side, untwist @ wrists[side], trunk.T @ turns[i])
        return Frame(time, angles)

    def _settle(self, raw: HandsReading, time: float) -> bool:
        """Take the first second for sitting upright; return whether it is over."""
        if raw.head is not None:
            self._settling.append(raw)
            self._settled_at = time + SETTLING if self._settled_at is None else self._settled_at
        if self._settled_at is None or time < self._settled_at:
            return False
        self.calibrate(self._settling)
        return True

    def _filtered(self, raw: HandsReading, time: float) -> tuple[Array, Array]:
        """Return smoothed positions [3, 3] and axes [3, 3, 3] of head and hands in the frame of the body."""
        assert self._base is not None
        to_body, offset = self._base
        values = np.full(21, np.nan)
        positions, quaternions = values[:9].reshape(3, 3), values[9:].reshape(3, 4)
        for i, pose in enumerate((raw.head, raw.left, raw.right)):
            if pose is None:
                continue
            length = math.hypot(*pose.quaternion)
            if not (0.5 < length < 2.0 and math.isfinite(sum(pose.position))):
                continue  # what a device reports that has lost its way
            positions[i] = to_body @ np.array(pose.position) + offset
            quaternions[i] = np.array(pose.quaternion) / length
        flipped = (quaternions * self._quaternions).sum(axis=1) < 0
        quaternions[flipped] *= -1
        known = np.isfinite(quaternions[:, 0])
        self._quaternions[known] = quaternions[known]
        values = self._filter.update(values, time)
        positions, quaternions = values[:9].reshape(3, 3), values[9:].reshape(3, 4)
        turns = np.full((3, 3, 3), np.nan)
        for i in np.flatnonzero(known).tolist():
            turns[i] = to_body @ axes_of(quaternions[i].tolist())
        return positions, turns

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
        turn = min(max(alike * turn, -GREATEST_TURN), GREATEST_TURN)
        dt, self._turned_at = time - self._turned_at, time
        self._turn += (1 - math.exp(-dt / TURN_TIME)) * (turn - self._turn)

    def _arm(
        self, side: str, wrist: Array, hand: Array
    ) -> tuple[float, float, float, float, float]:
        """Return the angles of an arm from wrist [m] and hand in the frame of the trunk [rad]."""
        body, sign = self.body, SIGN[side]
        wrist = wrist - np.array((0.0, sign * body.shoulder, 0.0))
        share = math.sqrt(float(wrist @ wrist)) / (body.upper_arm + body.forearm)
        if share > NOT_STRAIGHT:
            stretch = (1 - NOT_STRAIGHT) / (1 - self._slack - NOT_STRAIGHT)
            wrist = wrist * (min(NOT_STRAIGHT + (share - NOT_STRAIGHT) * stretch, 1.0) / share)
        by_hand = wrist - body.forearm * hand[:, 0]
        hanging = body.upper_arm * np.array((-0.2, 0.4 * sign, -0.9))
        hint = HAND_HINT * by_hand + (1 - HAND_HINT) * hanging
        upper, fore = elbow_at(wrist, body.upper_arm, body.forearm, hint)
        out = arm_motion(side, upper, fore, hand, rotation=self._rotation[side])
        self._rotation[side] = out[2]
        return out


def _beyond(value: float, low: float, high: float) -> float:
    """Return 0 up to `low`, 1 from `high` on, evenly between."""
    return min(max((value - low) / (high - low), 0.0), 1.0)


def _neck(turn: Array) -> tuple[float, float, float]:
    """Return flexion, lateral flexion and rotation of a head turned so against the trunk [rad]."""
    rotation = math.atan2(turn[1, 0], turn[0, 0])
    flexion = math.asin(min(max(-turn[2, 0], -1.0), 1.0))
    lateral = -math.atan2(turn[2, 1], turn[2, 2])
    return flexion, lateral, rotation
