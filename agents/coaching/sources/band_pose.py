"""Where an upper body and its bands are, as numbers that can be fitted, and how points follow these.

Rotations are turned by small vectors on their left; so an arm that hangs or points up straight is nothing
special.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from rcare_marl.pose import Array

from ..upper_body import (
    ARM,
    MOTIONS,
    SHOULDER_HALF_WIDTH,
    SIDES,
    SIGN,
    UpperBody,
    arm_angles,
    girdle,
    neck_turn,
    swing,
    trunk_turn,
    turn_y,
    turn_z,
)
from .marker_band import SEGMENTS, Band

TURNED = 1e-4  # [rad] by which an arm is turned to see how its shoulder moves

Indices = npt.NDArray[np.intp]


class Layout:
    """Which number of a vector means what.

    Small turns [rad] of trunk (0:3), head (3:6) and shoulders (6:9, 9:12), elbow flexion (12, 13), pronation
    (14, 15), pelvis (16:19), where the neck turns (19:22), shoulders (22:28) and elbows (28:34) [m], how
    far shoulders move with arms (34); then for each band its turn [rad] and its place [m].

    Attributes:
        bands: The bands.
        first: Where those of the bands begin.
        size: How many numbers there are.
    """

    first = 35

    def __init__(self, bands: Sequence[Band]) -> None:
        """Take the bands of one person."""
        self.bands = tuple(bands)
        self.size = self.first + 6 * len(self.bands)
        self.segment = np.array([SEGMENTS.index(band.segment) for band in self.bands])


@dataclass(eq=False)
class BandPose:
    """Where an upper body and its bands are. Rotations are matrices, places in metres.

    Attributes:
        layout: What numbers mean.
        trunk_length: From the hips to the middle of the shoulder line [m].
        stature: By which the average shoulder's way with its arm is multiplied [m].
        trunk: Turn of the trunk in the frame of the body, shape [3, 3].
        head: Turn of the head in that of the trunk.
        shoulders: Turns of the upper arms there, shape [2, 3, 3].
        elbows: Elbow flexions [rad], shape [2].
        forearms: Pronations [rad], shape [2].
        pelvis: Where the hips are, shape [3].
        neck: Where the head turns, from the middle of the shoulder line, shape [3].
        roots: The shoulders from there, arms hanging, shape [2, 3].
        lift: How far shoulders move as arms are raised, against the average.
        hinges: The elbows in the frames of the upper arms, shape [2, 3].
        turns: How bands are turned on their segments, shape [n, 3, 3].
        places: Where they are there, shape [n, 3].
    """

    layout: Layout
    trunk_length: float
    stature: float
    trunk: Array
    head: Array
    shoulders: Array
    elbows: Array
    forearms: Array
    pelvis: Array
    neck: Array
    roots: Array
    lift: float
    hinges: Array
    turns: Array
    places: Array

    @classmethod
    def of(cls, layout: Layout, body: UpperBody, height: float) -> BandPose:
        """Return somebody `height` [m] tall who sits upright with hanging arms and bands in their places."""
        bands = layout.bands
        return cls(
            layout,
            body.trunk,
            body.shoulder / SHOULDER_HALF_WIDTH,
            np.eye(3),
            np.eye(3),
            np.tile(np.eye(3), (2, 1, 1)),
            np.zeros(2),
            np.zeros(2),
            np.zeros(3),
            np.array((0.0, 0.0, body.neck)),
            np.array([(0.0, SIGN[side] * body.shoulder, 0.0) for side in SIDES]),
            1.0,
            np.tile((0.0, 0.0, -body.upper_arm), (2, 1)),
            np.tile(np.eye(3), (len(bands), 1, 1)),
            np.array([band.place_on(height) for band in bands]),
        )

    def copy(self) -> BandPose:
        """Return another that can be changed."""
        return copy.copy(self)

    def set_angles(self, angles: Array) -> None:
        """Take a posture, angles of `MOTIONS` [rad], shape [16]."""
        self.trunk, self.head = trunk_turn(*angles[:3]), neck_turn(*angles[3:6])
        arms = [angles[ARM[side]] for side in SIDES]
        self.shoulders = np.array(
            [
                swing(side, arm[0], arm[1]) @ turn_z(-SIGN[side] * arm[2])
                for side, arm in zip(SIDES, arms, strict=True)
            ]
        )
        self.elbows = np.array([arm[3] for arm in arms])
        self.forearms = np.array([arm[4] for arm in arms])

    def angles(self) -> Array:
        """Return the posture, angles of `MOTIONS` [rad], shape [16]."""
        out, trunk, head = np.empty(len(MOTIONS)), self.trunk, self.head
        # trunk_turn is turn_y(flexion) turn_x(-lateral) turn_z(rotation), neck_turn z, y, x.
        out[0] = np.arctan2(trunk[0, 2], trunk[2, 2])
        out[1] = np.arcsin(np.clip(trunk[1, 2], -1, 1))
        out[2] = np.arctan2(trunk[1, 0], trunk[1, 1])
        out[3] = np.arcsin(np.clip(-head[2, 0], -1, 1))
        out[4] = -np.arctan2(head[2, 1], head[2, 2])
        out[5] = np.arctan2(head[1, 0], head[0, 0])
        for i, side in enumerate(SIDES):
            arm, turn = ARM[side].start, self.shoulders[i]
            elevation, plane = arm_angles(side, -turn[:, 2])
            twist = swing(side, elevation, plane).T @ turn
            out[arm], out[arm + 1] = elevation, plane
            out[arm + 2] = -SIGN[side] * np.arctan2(twist[1, 0], twist[0, 0])
            out[arm + 3], out[arm + 4] = self.elbows[i], self.forearms[i]
        return out

    def plus(self, step: Array) -> BandPose:
        """Return this pose moved by a vector of `Layout`."""
        out, count = self.copy(), len(self.places)
        worn = step[self.layout.first :].reshape(count, 6)
        turned = Rotation.from_rotvec(
            np.concatenate((step[:12].reshape(4, 3), worn[:, :3]))
        ).as_matrix()
        out.trunk, out.head = turned[0] @ self.trunk, turned[1] @ self.head
        out.shoulders, out.turns = turned[2:4] @ self.shoulders, turned[4:] @ self.turns
        out.elbows, out.forearms = self.elbows + step[12:14], self.forearms + step[14:16]
        out.pelvis, out.neck = self.pelvis + step[16:19], self.neck + step[19:22]
        out.roots = self.roots + step[22:28].reshape(2, 3)
        out.hinges, out.lift = self.hinges + step[28:34].reshape(2, 3), self.lift + step[34]
        out.places = self.places + worn[:, 3:]
        return out

    def minus(self, other: BandPose) -> Array:
        """Return the vector of `Layout` that moves another pose to this one."""
        turns = np.concatenate(
            ((self.trunk, self.head), self.shoulders, self.turns)
        ) @ np.concatenate(((other.trunk, other.head), other.shoulders, other.turns)).transpose(
            0, 2, 1
        )
        vectors = Rotation.from_matrix(turns).as_rotvec()
        worn = np.concatenate((vectors[4:], self.places - other.places), axis=1)
        return np.concatenate(
            (
                vectors[:4].ravel(),
                self.elbows - other.elbows,
                self.forearms - other.forearms,
                self.pelvis - other.pelvis,
                self.neck - other.neck,
                (self.roots - other.roots).ravel(),
                (self.hinges - other.hinges).ravel(),
                np.array((self.lift - other.lift,)),
                worn.ravel(),
            )
        )

    def lifts(self, directions: Array) -> Array:
        """Return how far the average person's shoulders move with arms that point somewhere [m].

        Args:
            directions: In the frame of the trunk, left and right, shape [2, ..., 3].
        """
        return self.stature * np.array(
            [
                girdle(side, *arm_angles(side, pointing))
                for side, pointing in zip(SIDES, directions, strict=True)
            ]
        )

    def frames(self) -> tuple[Array, Array, Array]:
        """Return turns [6, 3, 3] and origins [6, 3] of `SEGMENTS`, and elbows' and forearms' axes [4, 3]."""
        trunk = self.trunk
        middle = self.pelvis + trunk[:, 2] * self.trunk_length
        upper = trunk @ self.shoulders
        lifted = self.roots + self.lift * self.lifts(-self.shoulders[:, :, 2])
        roots = middle + lifted @ trunk.T
        hinges = roots + np.einsum("aij,aj->ai", upper, self.hinges)
        bent = upper @ turn_y(-self.elbows)
        signs = np.array([SIGN[side] for side in SIDES])
        fore = bent @ turn_z(-signs * self.forearms)
        turns = np.concatenate(((trunk, trunk @ self.head), upper, fore))
        head = middle + trunk @ self.neck
        origins = np.concatenate(((middle, head), roots, hinges))
        axes = np.concatenate((-upper[:, :, 1], -signs[:, None] * bent[:, :, 2]))
        return turns, origins, axes

    def place(self, bands: Indices, local: Array) -> Array:
        """Return where points [m], [n, 3], of bands [n] are in the frame of the body [m], shape [n, 3]."""
        turns, origins, _ = self.frames()
        segment = self.layout.segment[bands]
        on_segment = np.einsum("nij,nj->ni", self.turns[bands], local) + self.places[bands]
        return np.asarray(origins[segment] + np.einsum("nij,nj->ni", turns[segment], on_segment))

    def look(self, bands: Indices, local: Array) -> tuple[Array, Array]:
        """Return where points of bands are in the frame of the body, and how that changes.

        Args:
            bands: Which band each belongs to, shape [n].
            local: Points in the frames of the bands [m], shape [n, 3].

        Returns:
            Points [m], shape [n, 3], and their derivatives by the vector of `Layout`, [n, 3, size].
        """
        turns, origins, axes = self.frames()
        segment = self.layout.segment[bands]
        here = turns[segment]
        on_band = np.einsum("nij,nj->ni", self.turns[bands], local)
        points = origins[segment] + np.einsum("nij,nj->ni", here, on_band + self.places[bands])
        out = np.zeros((len(points), 3, self.layout.size))
        down = -self.shoulders[:, None, :, 2]
        lifts = self.lifts(
            np.concatenate((down, down + TURNED * np.cross(np.eye(3), down)), axis=1)
        )
        ways = self.lift * (lifts[:, 1:] - lifts[:, :1]) / TURNED
        _slopes(
            points,
            segment,
            bands,
            on_band,
            self.pelvis,
            origins,
            turns,
            axes,
            lifts[:, 0] @ turns[0].T,
            ways @ turns[0].T,
            self.layout.first,
            out,
        )
        return points, out


@numba.njit(cache=True)
def _slopes(  # type: ignore[no-untyped-def]
    points, segments, bands, on_band, pelvis, origins, turns, axes, lifts, ways, first, out
) -> None:
    """Write how points change with the vector of `Layout`."""
    for n in range(len(points)):
        segment, slope = segments[n], out[n]
        _turning(points[n] - pelvis, np.eye(3), slope[:, 0:3])
        for k in range(3):
            slope[k, 16 + k] = 1.0
        if segment == 1:
            _turning(points[n] - origins[1], turns[0], slope[:, 3:6])
            slope[:, 19:22] = turns[0]
        elif segment > 1:
            i = segment % 2
            _turning(points[n] - origins[2 + i], turns[0], slope[:, 6 + 3 * i : 9 + 3 * i])
            slope[:, 6 + 3 * i : 9 + 3 * i] += ways[i].T
            slope[:, 22 + 3 * i : 25 + 3 * i] = turns[0]
            slope[:, 34] = lifts[i]
            if segment > 3:
                away = points[n] - origins[4 + i]
                slope[:, 12 + i] = np.cross(axes[i], away)
                slope[:, 14 + i] = np.cross(axes[2 + i], away)
                slope[:, 28 + 3 * i : 31 + 3 * i] = turns[2 + i]
        start = first + 6 * bands[n]
        here = turns[segment]
        for k in range(3):
            axis = np.zeros(3)
            axis[k] = 1.0
            turned = np.cross(axis, on_band[n])
            for j in range(3):
                slope[j, start + k] = (
                    here[j, 0] * turned[0] + here[j, 1] * turned[1] + here[j, 2] * turned[2]
                )
        slope[:, start + 3 : start + 6] = here


@numba.njit(cache=True)
def _turning(away, frame, out) -> None:  # type: ignore[no-untyped-def]
    """Write how a point `away` from a centre moves as it turns about the axes of a frame."""
    for k in range(3):
        x, y, z = frame[0, k], frame[1, k], frame[2, k]
        out[0, k] = y * away[2] - z * away[1]
        out[1, k] = z * away[0] - x * away[2]
        out[2, k] = x * away[1] - y * away[0]
