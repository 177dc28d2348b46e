"""Poses of WebXR as readings of head and hands.

WebXR's frame is x right, y up, -z ahead (https://www.w3.org/TR/webxr, XRReferenceSpace); ours is x
ahead, y left, z up, so x = -z', y = -x', z = y'. The viewer looks along its own -z', so its axes are turned
likewise.

Hands come in two ways:

- Tracked hands (https://www.w3.org/TR/webxr-hand-input-1/): the wrist and the knuckles, joints
  `*-finger-phalanx-proximal`. The fingers' direction is from the wrist to the middle knuckle, across the
  palm lies the line of the knuckles. Of these only where the joints are is used, not how they are turned,
  in which devices differ.
- Controllers: the grip pose, in OpenXR's meaning (specification 1.1, "Standard pose identifiers"): in the
  palm; x away from the palm on the left, into it on the right; -z through the fist from the little finger to
  the thumb. So flat fingers point along -y on both. How makers place it within the controller differs by
  degrees: that it fits is an assumption, no controller was measured.
"""

from __future__ import annotations

import numpy as np

from rcare_marl.agents.coaching.sources.hands_source import HandsReading
from rcare_marl.agents.coaching.upper_body import SIGN, UpperBody
from rcare_marl.pose import Array, Pose, matrix_from_quaternion, quaternion_from_matrix

from .message import HandJoints, Hands, Place

FROM_WEBXR: Array = np.array(((0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
# Columns: fingers, across the palm to the left, back of the hand; in the axes of the grip.
HAND_IN_GRIP: dict[str, Array] = {
    side: np.array(((0.0, 0.0, -sign), (-1.0, 0.0, 0.0), (0.0, sign, 0.0)))
    for side, sign in SIGN.items()
}


def reading(hands: Hands, body: UpperBody) -> HandsReading:
    """Return what a headset reported as a reading in the frame x ahead, y left, z up.

    Args:
        hands: The report.
        body: Lengths of the person's body, for how far the palm is from the wrist.
    """
    return HandsReading(
        head=None if hands.head is None else _head(hands.head),
        left=_hand("left", hands.left, body),
        right=_hand("right", hands.right, body),
    )


def _head(place: Place) -> Pose:
    turn = FROM_WEBXR @ matrix_from_quaternion(place.quaternion) @ FROM_WEBXR.T
    return _pose(FROM_WEBXR @ np.array(place.position), turn)


def _hand(side: str, hand: HandJoints | Place | None, body: UpperBody) -> Pose | None:
    if hand is None:
        return None
    if isinstance(hand, Place):
        turn = FROM_WEBXR @ matrix_from_quaternion(hand.quaternion) @ HAND_IN_GRIP[side]
        return _pose(FROM_WEBXR @ np.array(hand.position), turn)
    wrist, index, middle, pinky = (
        FROM_WEBXR @ np.array(p) for p in (hand.wrist, hand.index, hand.middle, hand.pinky)
    )
    fingers = _unit(middle - wrist)
    across = SIGN[side] * (pinky - index)
    back = np.cross(fingers, across)
    if np.linalg.norm(back) < 1e-6:  # the knuckles in line with the wrist: no hand
        return None
    back = _unit(back)
    turn = np.column_stack((fingers, np.cross(back, fingers), back))
    return _pose(wrist + body.palm * fingers, turn)


def head_place(position: Array, quaternion: Array) -> tuple[float, ...]:
    """Return a head's pose, of our frame, as WebXR has it: position [m] and quaternion, seven numbers."""
    turn = FROM_WEBXR.T @ matrix_from_quaternion(quaternion) @ FROM_WEBXR
    return _seven(position, turn)


def grip_place(side: str, position: Array, quaternion: Array) -> tuple[float, ...]:
    """Return a hand's pose, of our frame, as a grip of WebXR: seven numbers."""
    turn = FROM_WEBXR.T @ matrix_from_quaternion(quaternion) @ HAND_IN_GRIP[side].T
    return _seven(position, turn)


def _seven(position: Array, turn: Array) -> tuple[float, ...]:
    return (*(FROM_WEBXR.T @ position).tolist(), *quaternion_from_matrix(turn).tolist())


def _pose(position: Array, turn: Array) -> Pose:
    return Pose(tuple(position.tolist()), tuple(quaternion_from_matrix(turn).tolist()))


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
