"""The upper body as the coach sees it: sixteen angles, and where they put head, arms and hands.

Frame of the body: x forward, y left, z up, origin in the middle between the hips. Angles [rad]:

- Trunk, turned about the hips in the order flexion (+ forward), lateral flexion (+ to the left), rotation
  (+ to the left). Neck, against the trunk, in the order rotation, flexion, lateral flexion.
- Arms after the ISB's thorax-humerus angles (Wu et al. 2005, J. Biomech. 38, 981-992): elevation is 0 with
  the arm hanging, 90 deg horizontal, 180 deg upright. The plane of elevation is 0 to the side, 90 deg to the
  front, negative behind, on both sides alike. Shoulder rotation is + internal and counted from where the arm
  comes to when it is swung up straight from hanging, so that it has no jump where the plane loses its
  meaning: with the arm hanging and rotation 0 the elbow bends the hand forward; raised to the side it
  still does; raised to the front it bends the hand up. (The third angle of the ISB is this less the plane.)
- Elbow flexion is 0 with the arm straight. Pronation is 0 with the palm towards the thigh of the hanging
  arm (thumb up when the elbow is bent), + palm down.
- There is no wrist: the hand goes on along the forearm.

Frames of what is carried: the head's x is where the nose points, z up. A hand's x is along the fingers and
z out of its back, so that hands held forward, palms down, have the axes of the body.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array

from ..people.body.anthropometry import DE_LEVA_LENGTHS

Angle = Array | float

SIDES = ("left", "right")
SIGN = {"left": 1.0, "right": -1.0}
ARM_MOTIONS = (
    "shoulder_elevation",
    "shoulder_plane",
    "shoulder_rotation",
    "elbow_flexion",
    "forearm_pronation",
)
MOTIONS = (
    "trunk_flexion",
    "trunk_lateral_flexion_left",
    "trunk_rotation_left",
    "neck_flexion",
    "neck_lateral_flexion_left",
    "neck_rotation_left",
    *(f"{side}_{motion}" for side in SIDES for motion in ARM_MOTIONS),
)
MOTION_INDEX = {motion: i for i, motion in enumerate(MOTIONS)}
ARM = {side: slice(6 + 5 * i, 11 + 5 * i) for i, side in enumerate(SIDES)}  # an arm's five angles

# Lengths between joint centres as shares of stature, men and women: trunk (middle of the shoulders to
# middle of the hips), upper arm and forearm after de Leva 1996, table 4, as `people.body.anthropometry`
# has them. Half the width between shoulder joints: biacromial breadth of ANSUR II (2012; 416 mm of 1756,
# 365 of 1629, from memory) less 20 mm from each acromion in to the joint (our own choice). Heights of chin
# and eyes: Drillis & Contini 1966 (.870 and .936 of stature, as in Winter), hips .530.
SEXES = ("male", "female")
Sex = Literal["male", "female"]
TRUNK_OF, UPPER_ARM_OF, FOREARM_OF, HAND_OF = (
    DE_LEVA_LENGTHS[name] for name in ("trunk", "upper_arm", "forearm", "hand")
)
SHOULDER_HALF_WIDTH_OF = ((0.208 - 0.02) / 1.756, (0.1825 - 0.02) / 1.629)
HIP, CHIN_HEIGHT, EYE_HEIGHT = 0.530, 0.870, 0.936
TRUNK, UPPER_ARM, FOREARM, HAND, SHOULDER_HALF_WIDTH = (
    sum(pair) / 2 for pair in (TRUNK_OF, UPPER_ARM_OF, FOREARM_OF, HAND_OF, SHOULDER_HALF_WIDTH_OF)
)
# The collar bone turns up and back about its inner end by a quarter of what the arm is raised beyond 30 deg
# (scapulohumeral rhythm after Inman et al. 1944, Ludewig et al. 2009; rounded, from memory).
CLAVICLE, SETTING, GIRDLE_SHARE = 0.085, math.radians(30), 0.25
EYES_FORWARD = 0.05  # eyes in front of the axis of the neck, as a share of stature; our own choice
PALM = 0.5  # knuckles of the palm from the wrist, as a share of the hand; our own choice


@dataclass(frozen=True)
class UpperBody:
    """Lengths of an upper body, and where its angles put its parts.

    Attributes:
        trunk: From the hips to the line of the shoulders [m].
        shoulder: From the middle of that line to a shoulder [m].
        upper_arm: From shoulder to elbow [m].
        forearm: From elbow to wrist [m].
        palm: From the wrist to the middle of the palm [m].
        neck: From the line of the shoulders up to where the head turns [m].
        head: From there up to the level of the eyes [m].
        eyes: From the middle of the head forward to the eyes [m].
    """

    trunk: float
    shoulder: float
    upper_arm: float
    forearm: float
    palm: float
    neck: float
    head: float
    eyes: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(
                    f"the length {name} of an upper body must be positive, got {value}"
                )

    @classmethod
    def of_height(
        cls,
        height: float,
        *,
        sex: Sex | None = None,
        arm_share: float = 1.0,
        trunk_share: float = 1.0,
    ) -> UpperBody:
        """Return a body of average proportions.

        Args:
            height: Stature [m].
            sex: Whose proportions; the mean of both if None.
            arm_share: Length of the arms against the average of that stature.
            trunk_share: Length of the trunk likewise.
        """
        if not (math.isfinite(height) and 0.5 <= height <= 2.5):
            raise ConfigError(f"a stature must lie in 0.5..2.5 m, got {height}")
        if sex is not None:
            check_name("sex", sex, SEXES)
        pairs = (TRUNK_OF, SHOULDER_HALF_WIDTH_OF, UPPER_ARM_OF, FOREARM_OF, HAND_OF)
        trunk, shoulder, upper_arm, forearm, hand = (
            sum(pair) / 2 if sex is None else pair[SEXES.index(sex)] for pair in pairs
        )
        # The head turns halfway between shoulders and chin; our own choice.
        neck = 0.5 * (CHIN_HEIGHT - HIP - trunk)
        return cls(
            trunk=trunk * height * trunk_share,
            shoulder=shoulder * height,
            upper_arm=upper_arm * height * arm_share,
            forearm=forearm * height * arm_share,
            palm=PALM * hand * height * arm_share,
            neck=neck * height,
            head=(EYE_HEIGHT - HIP - trunk - neck) * height,
            eyes=EYES_FORWARD * height,
        )

    @property
    def reach(self) -> float:
        """From a shoulder to the palm of the straight arm [m]."""
        return self.upper_arm + self.forearm + self.palm

    def points(self, angles: Array) -> dict[str, Array]:
        """Return where the parts are [m], each of shape [..., 3].

        Names: `pelvis`, `neck` (middle of the shoulder line), `head`, `eyes`, and of each side
        `<side>_shoulder`, `_elbow`, `_wrist` and `_hand` (middle of the palm).

        Args:
            angles: Angles of `MOTIONS` [rad], shape [..., 16]; what depends on an unknown one is NaN.
        """
        return self._place(np.asarray(angles, dtype=np.float64))[0]

    def poses(self, angles: Array) -> dict[str, tuple[Array, Array]]:
        """Return position [m], [..., 3], and quaternion, [..., 4], of `head` (at the eyes) and hands.

        Args:
            angles: Angles of `MOTIONS` [rad], shape [..., 16].
        """
        points, turns = self._place(np.asarray(angles, dtype=np.float64))
        ends = {"head": "eyes", "left_hand": "left_hand", "right_hand": "right_hand"}
        return {name: (points[end], quaternions(turns[name])) for name, end in ends.items()}

    def turns(self, angles: Array) -> dict[str, Array]:
        """Return rotation matrices, each of shape [..., 3, 3], in the frame of the hips.

        Names: `trunk`, `head`, and of each side `<side>_upper_arm`, `_forearm` (z up along the bone of the
        hanging arm, not turned by pronation) and `_hand`.

        Args:
            angles: Angles of `MOTIONS` [rad], shape [..., 16]; what depends on an unknown one is NaN.
        """
        return self._place(np.asarray(angles, dtype=np.float64))[1]

    def _place(self, angles: Array) -> tuple[dict[str, Array], dict[str, Array]]:
        if angles.shape[-1:] != (len(MOTIONS),):
            raise ConfigError(f"angles must have shape [..., {len(MOTIONS)}], got {angles.shape}")
        a = np.moveaxis(angles, -1, 0)
        trunk = trunk_turn(a[0], a[1], a[2])
        head = trunk @ neck_turn(a[3], a[4], a[5])
        neck = trunk[..., 2] * self.trunk
        pivot = neck + trunk[..., 2] * self.neck
        middle = pivot + head[..., 2] * self.head
        points = {
            "pelvis": np.zeros_like(neck),
            "neck": neck,
            "head": middle,
            "eyes": middle + head[..., 0] * self.eyes,
        }
        turns = {"trunk": trunk, "head": head}
        for side in SIDES:
            elevation, plane, rotation, elbow, pronation = a[ARM[side]]
            sign = SIGN[side]
            upper = trunk @ swing(side, elevation, plane) @ turn_z(-sign * rotation)
            fore = upper @ turn_y(-elbow)
            lift = girdle(side, elevation, plane) * self.shoulder / SHOULDER_HALF_WIDTH
            at = lift + np.array((0.0, sign * self.shoulder, 0.0))
            points[f"{side}_shoulder"] = neck + (trunk @ at[..., None])[..., 0]
            points[f"{side}_elbow"] = points[f"{side}_shoulder"] - upper[..., 2] * self.upper_arm
            points[f"{side}_wrist"] = points[f"{side}_elbow"] - fore[..., 2] * self.forearm
            points[f"{side}_hand"] = points[f"{side}_wrist"] - fore[..., 2] * self.palm
            turns[f"{side}_upper_arm"], turns[f"{side}_forearm"] = upper, fore
            turns[f"{side}_hand"] = fore @ turn_z(-sign * pronation) @ HAND_IN_FOREARM[side]
        return points, turns


def girdle(side: str, elevation: Angle, plane: Angle) -> Array:
    """Return how far a shoulder moves as its arm is raised, as a share of stature, shape [..., 3].

    The collar bone turns up and back about its inner end; an arm that is raised to the front draws it back
    the less the more it is to the front.

    Args:
        side: `left` or `right`.
        elevation: Of the arm [rad].
        plane: Its plane [rad].
    """
    raised = GIRDLE_SHARE * np.maximum(np.asarray(elevation) - SETTING, 0.0)
    back = raised * np.cos(np.clip(plane, 0.0, np.pi / 2))
    x, y, z = -np.sin(back) * np.cos(raised), np.cos(back) * np.cos(raised) - 1.0, np.sin(raised)
    return CLAVICLE * np.stack(np.broadcast_arrays(x, SIGN[side] * y, z), axis=-1)


# Columns: fingers, across the palm, back of the hand; in the axes of a hanging forearm, palm to the thigh.
HAND_IN_FOREARM: Mapping[str, Array] = {
    side: np.array(((0.0, -sign, 0.0), (0.0, 0.0, sign), (-1.0, 0.0, 0.0)))
    for side, sign in SIGN.items()
}


def turn_x(angle: Angle) -> Array:
    """Return rotations about x [rad], shape [..., 3, 3]."""
    return _turn(angle, 1, 2)


def turn_y(angle: Angle) -> Array:
    """Return rotations about y [rad], shape [..., 3, 3]."""
    return _turn(angle, 2, 0)


def turn_z(angle: Angle) -> Array:
    """Return rotations about z [rad], shape [..., 3, 3]."""
    return _turn(angle, 0, 1)


def _turn(angle: Angle, i: int, j: int) -> Array:
    angle = np.asarray(angle, dtype=np.float64)
    out = np.zeros((*angle.shape, 3, 3))
    cosine, sine = np.cos(angle), np.sin(angle)
    out[..., 3 - i - j, 3 - i - j] = 1.0
    out[..., i, i] = out[..., j, j] = cosine
    out[..., i, j], out[..., j, i] = -sine, sine
    return out


def trunk_turn(flexion: Angle, lateral: Angle, rotation: Angle) -> Array:
    """Return how the trunk is turned against the hips, shape [..., 3, 3]."""
    return turn_y(flexion) @ turn_x(-np.asarray(lateral)) @ turn_z(rotation)


def neck_turn(flexion: Angle, lateral: Angle, rotation: Angle) -> Array:
    """Return how the head is turned against the trunk, shape [..., 3, 3]."""
    return turn_z(rotation) @ turn_y(flexion) @ turn_x(-np.asarray(lateral))


def swing(side: str, elevation: Angle, plane: Angle) -> Array:
    """Return the least turn that brings the hanging arm of a `side` up, shape [..., 3, 3]."""
    sign = SIGN[side]
    plane = np.asarray(plane)
    up = turn_x(sign * np.asarray(elevation))
    return turn_z(-sign * plane) @ up @ turn_z(sign * plane)


def arm_direction(side: str, elevation: Angle, plane: Angle) -> Array:
    """Return where the upper arm points in the frame of the trunk, a unit vector [..., 3]."""
    sine = np.sin(elevation)
    x, y = sine * np.sin(plane), SIGN[side] * sine * np.cos(plane)
    return np.stack(np.broadcast_arrays(x, y, -np.cos(elevation)), axis=-1)


def arm_angles(side: str, direction: Array) -> tuple[Array, Array]:
    """Return elevation and plane of elevation [rad] of upper arms that point along `direction` [..., 3]."""
    x, y, z = np.moveaxis(np.asarray(direction, dtype=np.float64), -1, 0)
    elevation = np.arctan2(np.hypot(x, y), -z)
    return elevation, np.arctan2(x, SIGN[side] * y)


def directions(angles: Array) -> dict[str, Array]:
    """Return where each part points, unit vectors [..., 3]; angles have no jumps in these.

    `left_arm` and `right_arm`: the upper arm in the frame of the trunk; `head`: the nose in the frame of the
    trunk; `crown`: the top of the head there; `trunk`: from hips to shoulders in the frame of the body.

    Args:
        angles: Angles of `MOTIONS` [rad], shape [..., 16].
    """
    a = np.moveaxis(np.asarray(angles, dtype=np.float64), -1, 0)
    arms = {f"{side}_arm": arm_direction(side, a[ARM[side]][0], a[ARM[side]][1]) for side in SIDES}
    head = neck_turn(a[3], a[4], a[5])
    trunk = trunk_turn(a[0], a[1], np.zeros_like(a[2]))
    return {**arms, "head": head[..., 0], "crown": head[..., 2], "trunk": trunk[..., 2]}


def quaternions(turns: Array) -> Array:
    """Return the quaternions (x, y, z, w) of rotation matrices [..., 3, 3], NaN where those are."""
    flat = turns.reshape(-1, 3, 3)
    out = np.full((len(flat), 4), np.nan)
    known = np.isfinite(flat).all(axis=(1, 2))
    if known.any():
        out[known] = Rotation.from_matrix(flat[known]).as_quat()
    return out.reshape(*turns.shape[:-2], 4)
