"""Poses from the 33 body landmarks that pose detectors for webcams give.

Landmarks are in the order of BlazePose (Bazarevsky et al. 2020, arXiv:2006.10204), as MediaPipe has them, in
metres: x to the right in the picture, y down, z away from the camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from ..recognition.recogniser import Frame
from ..upper_body import ARM, MOTIONS, SHOULDER_HALF_WIDTH, SIDES, girdle
from .arm_pose import arm_motion
from .one_euro import OneEuro

COUNT = 33
NOSE = 0
EAR, SHOULDER, ELBOW, WRIST, PINKY, INDEX, HIP = (
    {"left": first, "right": first + 1} for first in (7, 11, 13, 15, 17, 19, 23)
)
# All our own choice.
VISIBLE = 0.5  # a landmark less likely to be seen counts as unknown
SETTLING = 1.0  # how long a person is watched before anything is told [s]
# Standard deviations of trunk, neck and an arm's angles [rad]; how shoulders move with arms is a person's
# own.
ABOUT_TRUNK = np.radians((3.0, 3.0, 6.0, 5.0, 5.0, 5.0))
ABOUT_ARM = np.radians((4.0, 6.0, 15.0, 6.0, 20.0))
# Where one camera tells the depths, too: BlazePose bent an upright trunk by up to 26 deg and the head by 23
# when arms were raised to the sides. Chosen on clips of one rendered person, right on those of another.
ABOUT_TRUNK_IN_ONE_CAMERA = np.radians((20.0, 4.0, 8.0, 20.0, 8.0, 10.0))
STRETCHED = 1e-3  # [m]; landmarks nearer to each other show no direction


@dataclass(frozen=True, eq=False)
class LandmarkReading:
    """Landmarks of one person in one picture.

    Attributes:
        points: Where they are [m], shape [33, 3]; the origin does not matter.
        visibility: How likely each is seen, 0 to 1, shape [33].
    """

    points: Array
    visibility: Array

    def __post_init__(self) -> None:
        if np.shape(self.points) != (COUNT, 3) or np.shape(self.visibility) != (COUNT,):
            raise ConfigError(
                f"landmarks must have shapes [{COUNT}, 3] and [{COUNT}], got "
                f"{list(np.shape(self.points))} and {list(np.shape(self.visibility))}"
            )


class LandmarkSource:
    """Makes frames of body landmarks.

    For the first second the person sits upright and looks ahead: that is where trunk and head are counted
    from. Without hips in sight the trunk's leaning is unknown, and the arms are told as of an upright trunk.
    """

    def __init__(self, *, tilt: float = 0.0, monocular: bool = False) -> None:
        """Prepare a source.

        Args:
            tilt: How far the camera looks up [rad]; down is negative.
            monocular: Whether one camera told the depths: then how far somebody leans is hardly known.

        Raises:
            ConfigError: If the camera looks straight up or down.
        """
        if not abs(tilt) < math.radians(80):
            raise ConfigError(f"the camera's tilt must lie within 80 degrees, got {tilt} rad")
        cosine, sine = math.cos(tilt), math.sin(tilt)
        # Towards the camera, to the right in its picture, and up.
        self._upright = np.array(
            ((0.0, -sine, -cosine), (1.0, 0.0, 0.0), (0.0, -cosine, sine)), np.float64
        )
        self._smooth = OneEuro(cutoff=3.0, beta=8.0)
        self._first: float | None = None
        self._settling: list[Array] = []
        self._neutral: tuple[Array, Array | None, Array] | None = None
        self._rotation = dict.fromkeys(SIDES, 0.0)
        self._raised = dict.fromkeys(SIDES, (math.nan, math.nan))
        self._axes_before, self._width = np.eye(3), 0.0
        about_trunk = ABOUT_TRUNK_IN_ONE_CAMERA if monocular else ABOUT_TRUNK
        self._unsure = np.concatenate((about_trunk, *2 * [ABOUT_ARM]))

    def update(self, raw: LandmarkReading | None, time: float) -> Frame | None:
        """Return what is known at a time [s]; None in the first second, and while nobody is seen."""
        if raw is None:
            return None
        points = np.asarray(raw.points, np.float64) @ self._upright.T
        points[np.asarray(raw.visibility) < VISIBLE] = np.nan
        points = self._smooth.update(points.ravel(), time).reshape(COUNT, 3)
        if self._neutral is None and not self._settle(points, time):
            return None
        return self._frame(points, time)

    def _settle(self, points: Array, time: float) -> bool:
        """Learn how somebody sits upright, and return whether that is known now."""
        if not np.isfinite(points[list(SHOULDER.values())]).all():
            return False
        if self._first is None:
            self._first = time
        self._settling.append(points)
        if time - self._first < SETTLING:
            return False
        seen = np.array(self._settling)
        known = np.isfinite(seen).all(axis=2).mean(axis=0) > 0.5
        middle = np.full((COUNT, 3), np.nan)
        middle[known] = np.nanmedian(seen[:, known], axis=0)
        body = _axes(
            middle[SHOULDER["left"]] - middle[SHOULDER["right"]], np.array((0.0, 0.0, 1.0))
        )
        if body is None:
            return False
        trunk = _trunk(middle)
        head = _head(middle)
        across = middle[SHOULDER["left"]] - middle[SHOULDER["right"]]
        self._axes_before, self._width = body, 0.5 * float(np.linalg.norm(across))
        self._neutral = (
            body if trunk is None else trunk,
            None if head is None else body.T @ head,
            body,
        )
        return True

    def _frame(self, points: Array, time: float) -> Frame | None:
        assert self._neutral is not None
        sitting, looking, body = self._neutral
        angles = np.full(len(MOTIONS), np.nan)
        raised, points = points, self._without_girdle(points)
        trunk = _trunk(points)
        across = points[SHOULDER["left"]] - points[SHOULDER["right"]]
        if trunk is not None and np.isfinite(_trunk_known(points)):
            # What turns the trunk from how it sat upright, in the axes of the body.
            turned = body.T @ trunk @ sitting.T @ body
            angles[0] = math.atan2(turned[0, 2], turned[2, 2])
            angles[1] = math.asin(min(max(turned[1, 2], -1.0), 1.0))
            angles[2] = math.atan2(turned[1, 0], turned[1, 1])
        else:
            upright = _axes(across, np.array((0.0, 0.0, 1.0)))
            if upright is None:
                return None
            turned = body.T @ upright
            angles[2] = math.atan2(turned[1, 0], turned[0, 0])
        self._axes_before = body @ turned
        self._neck(points, body @ turned, looking, angles)
        for side in SIDES:
            self._arm(side, raised, body @ turned, angles)
            self._raised[side] = (angles[ARM[side].start], angles[ARM[side].start + 1])
        return Frame(time, angles, self._unsure) if np.isfinite(angles).any() else None

    def _without_girdle(self, points: Array) -> Array:
        """Return landmarks with shoulders where they would be with hanging arms.

        A shoulder moves up, in and back as its arm is raised, which is no turn of the trunk.
        """
        assert self._neutral is not None
        trunk = self._axes_before
        out = points.copy()
        for side in SIDES:
            elevation, plane = self._raised[side]
            if math.isfinite(elevation + plane):
                lift = girdle(side, elevation, plane) * (self._width / SHOULDER_HALF_WIDTH)
                out[SHOULDER[side]] -= trunk @ lift
        return out

    @staticmethod
    def _neck(points: Array, trunk: Array, looking: Array | None, angles: Array) -> None:
        head = _head(points)
        if head is None or looking is None:
            return
        neck = trunk.T @ head @ looking.T
        angles[3] = math.asin(min(max(-neck[2, 0], -1.0), 1.0))
        angles[4] = -math.atan2(neck[2, 1], neck[2, 2])
        angles[5] = math.atan2(neck[1, 0], neck[0, 0])

    def _arm(self, side: str, points: Array, trunk: Array, angles: Array) -> None:
        shoulder, elbow, wrist = (points[part[side]] for part in (SHOULDER, ELBOW, WRIST))
        upper, fore = _unit((elbow - shoulder) @ trunk), _unit((wrist - elbow) @ trunk)
        arm = ARM[side]
        if upper is None:
            return
        if fore is None:  # the upper arm alone
            angles[arm.start : arm.start + 2] = arm_motion(side, upper, upper, None)[:2]
            return
        index, pinky = points[INDEX[side]], points[PINKY[side]]
        # Fingers, across the palm, back of the hand.
        hand = _axes(
            (pinky - index if side == "left" else index - pinky) @ trunk,
            None,
            forward=(0.5 * (index + pinky) - wrist) @ trunk,
        )
        motion = arm_motion(side, upper, fore, hand, rotation=self._rotation[side])
        self._rotation[side] = motion[2]
        angles[arm] = motion


def _trunk_known(points: Array) -> float:
    return float(points[[*SHOULDER.values(), *HIP.values()]].sum())


def _trunk(points: Array) -> Array | None:
    """Return the axes of the trunk, from hips and shoulders, shape [3, 3]; None if some are unknown."""
    if not np.isfinite(_trunk_known(points)):
        return None
    shoulders = [points[i] for i in SHOULDER.values()]
    up = np.mean(shoulders, axis=0) - np.mean([points[i] for i in HIP.values()], axis=0)
    return _axes(shoulders[0] - shoulders[1], up)


def _head(points: Array) -> Array | None:
    """Return the axes of the head, from ears and nose, shape [3, 3]; None if some are unknown."""
    left, right = points[EAR["left"]], points[EAR["right"]]
    return _axes(left - right, None, forward=points[NOSE] - 0.5 * (left + right))


def _axes(left: Array, up: Array | None, forward: Array | None = None) -> Array | None:
    """Return axes x forward, y left, z up of which one is exact and y is as near to `left` as can be."""
    given = up if up is not None else forward
    assert given is not None
    exact = _unit(given)
    if exact is None:
        return None
    y = _unit(left - (left @ exact) * exact)
    if y is None:
        return None
    if up is not None:
        return np.column_stack((np.cross(y, exact), y, exact))
    return np.column_stack((exact, y, np.cross(exact, y)))


def _unit(vector: Array) -> Array | None:
    """Return a vector's direction; None if it is unknown or next to nothing."""
    length = float(np.linalg.norm(vector))
    return np.asarray(vector / length) if length > STRETCHED else None  # NaN is not greater
