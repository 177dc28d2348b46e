"""The angles of an upper body from where the corners of its bands are seen: a model fitted to pixels.

One estimate is carried on from frame to frame, an iterated extended Kalman filter in information form (Bell &
Cathey 1993, IEEE Trans. Automat. Contr. 38, 294-297): all corners of all bands together pull at the same
angles, so that a forearm that is seen tells where a hidden elbow is. What a calibration cannot
know is estimated along with the angles: where neck, shoulders and elbows turn, and how each band sits.
These do not change, so they are learned from movement. Rotations are turned by small vectors on their left;
so an arm that hangs or points up straight is nothing special.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from rcare_marl.pose import Array

from ..upper_body import (
    ARM,
    MOTIONS,
    SIDES,
    SIGN,
    UpperBody,
    arm_angles,
    neck_turn,
    swing,
    trunk_turn,
    turn_y,
    turn_z,
)
from .marker_band import SEGMENTS, Band

# All our own choice.
PIXEL = 0.6  # standard deviation of a corner [pixel]
TRUSTED = 3.0  # a corner off by more of these counts less (Huber 1964, Ann. Math. Stat. 35, 73-101)
STRANGE = 12.0  # a card whose corners are off by more of these is taken for another
STEPS, STILL = 5, 2e-3  # iterations of a frame at most, and the step [rad or m] that is the last
FASTEST = (
    1.5,
    4.0,
    5.0,
    8.0,
    8.0,
    0.1,
)  # trunk, head, shoulders, elbows, forearms [rad/s]; pelvis [m/s]
SMALLEST = 30.0  # area of a card that may be found [pixel^2]
UNSURE = math.radians(14)  # standard deviation beyond which an angle is not known
# Standard deviations before anything is seen: how far a person is from the posture of the calibration [rad],
# places of joints [m], and how bands sit [m, rad].
PRIOR = {
    "trunk": math.radians(0.7),
    "head": math.radians(2.0),
    "shoulder": math.radians(6.0),
    "elbow": math.radians(8.0),
    "forearm": math.radians(8.0),
    "pelvis": 0.05,
    "joint": 0.03,
    "place": 0.02,
    "turn": math.radians(5.0),
    "loose": math.radians(15.0),
}


Indices = npt.NDArray[np.intp]


class Layout:
    """Which number of a vector means what.

    Small turns [rad] of trunk (0:3), head (3:6) and shoulders (6:9, 9:12), elbow flexion (12, 13), pronation
    (14, 15), pelvis (16:19), where the neck turns (19:22), shoulders (22:28) and elbows (28:34) [m];
    then for each band its turn [rad] and its place [m].

    Attributes:
        bands: The bands.
        first: Where those of the bands begin.
        size: How many numbers there are.
    """

    first = 34

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
        trunk: Turn of the trunk in the frame of the body, shape [3, 3].
        head: Turn of the head in that of the trunk.
        shoulders: Turns of the upper arms there, shape [2, 3, 3].
        elbows: Elbow flexions [rad], shape [2].
        forearms: Pronations [rad], shape [2].
        pelvis: Where the hips are, shape [3].
        neck: Where the head turns, from the middle of the shoulder line, shape [3].
        roots: The shoulders from there, shape [2, 3].
        hinges: The elbows in the frames of the upper arms, shape [2, 3].
        turns: How bands are turned on their segments, shape [n, 3, 3].
        places: Where they are there, shape [n, 3].
    """

    layout: Layout
    trunk_length: float
    trunk: Array
    head: Array
    shoulders: Array
    elbows: Array
    forearms: Array
    pelvis: Array
    neck: Array
    roots: Array
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
            np.eye(3),
            np.eye(3),
            np.tile(np.eye(3), (2, 1, 1)),
            np.zeros(2),
            np.zeros(2),
            np.zeros(3),
            np.array((0.0, 0.0, body.neck)),
            np.array([(0.0, SIGN[side] * body.shoulder, 0.0) for side in SIDES]),
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
        out.hinges = self.hinges + step[28:34].reshape(2, 3)
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
                worn.ravel(),
            )
        )

    def frames(self) -> tuple[Array, Array, Array]:
        """Return turns [6, 3, 3] and origins [6, 3] of `SEGMENTS`, and elbows' and forearms' axes [4, 3]."""
        trunk = self.trunk
        middle = self.pelvis + trunk[:, 2] * self.trunk_length
        upper = trunk @ self.shoulders
        roots = middle + self.roots @ trunk.T
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
        _slopes(
            points,
            segment,
            bands,
            on_band,
            self.pelvis,
            origins,
            turns,
            axes,
            self.layout.first,
            out,
        )
        return points, out


@numba.njit(cache=True)
def _slopes(  # type: ignore[no-untyped-def]
    points, segments, bands, on_band, pelvis, origins, turns, axes, first, out
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
            slope[:, 22 + 3 * i : 25 + 3 * i] = turns[0]
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


@dataclass(frozen=True, eq=False)
class View:
    """How a camera sees the body.

    Attributes:
        lens: Intrinsic matrix [pixel], shape [3, 3].
        rotation: From the frame of the body to the camera's (x right, y down, z forward), shape [3, 3].
        offset: Origin of the body's frame in the camera's [m], shape [3].
    """

    lens: Array
    rotation: Array
    offset: Array

    def project(self, points: Array) -> tuple[Array, Array]:
        """Return pixels [n, 2] of points [m] [n, 3], and how they change with these, [n, 2, 3]."""
        local = points @ self.rotation.T + self.offset
        depth = np.maximum(local[:, 2], 0.05)
        focal = np.array((self.lens[0, 0], self.lens[1, 1]))
        flat = local[:, :2] / depth[:, None]
        pixels = flat * focal + self.lens[:2, 2]
        slope = self.rotation[None, :2] - flat[:, :, None] * self.rotation[2]
        return pixels, slope * (focal[:, None] / depth[:, None, None])


class BandTracker:
    """Follows the sixteen angles of a person who wears bands.

    Attributes:
        pose: The estimate.
    """

    def __init__(self, bands: Sequence[Band], height: float) -> None:
        """Prepare for a person of a stature [m]; the body is `UpperBody.of_height`."""
        self.layout = Layout(bands)
        self.body = UpperBody.of_height(height)
        self.pose = BandPose.of(self.layout, self.body, height)
        self._corners = {
            face.id: (i, face.corners()) for i, band in enumerate(bands) for face in band.faces
        }
        self._information = np.diag(1.0 / self._prior() ** 2)
        self._covariance = np.diag(self._prior()[:16] ** 2)
        self.used: tuple[int, ...] = ()

    def _prior(self) -> Array:
        layout, out = self.layout, np.zeros(self.layout.size)
        out[0:3], out[3:6], out[6:12] = PRIOR["trunk"], PRIOR["head"], PRIOR["shoulder"]
        out[12:14], out[14:16], out[16:19] = PRIOR["elbow"], PRIOR["forearm"], PRIOR["pelvis"]
        out[19 : layout.first] = PRIOR["joint"]
        for i, band in enumerate(layout.bands):
            start = layout.first + 6 * i
            # A card on cloth may sit anyhow; a cuff is held by its limb.
            turn = "loose" if band.segment in ("trunk", "head") else "turn"
            out[start : start + 3], out[start + 3 : start + 6] = PRIOR[turn], PRIOR["place"]
        return out

    def settle(self, seen: Mapping[int, Array], view: View, angles: Array) -> float:
        """Learn how bands sit from corners [pixel] of somebody in a known posture.

        Args:
            seen: Corners by number of the marker, shape [4, 2] each.
            view: Of the camera.
            angles: The posture, angles of `MOTIONS` [rad], shape [16].

        Returns:
            Root mean square of what is left [pixel]; NaN if no band was seen.
        """
        self.pose.set_angles(angles)
        return self._fit(seen, view, steps=25)

    def update(self, seen: Mapping[int, Array], view: View, passed: float) -> Array:
        """Return the angles of `MOTIONS` [rad], shape [16], NaN where nothing tells them.

        Args:
            seen: Corners by number of the marker [pixel], shape [4, 2] each.
            view: Of the camera.
            passed: Time since the last frame [s].
        """
        self._forget(min(max(passed, 1e-3), 0.5))
        self._fit(seen, view, steps=STEPS)
        return self.known(self.pose.angles())

    def expected(self, view: View) -> dict[int, Array]:
        """Return where cards that face the camera should be: corners [pixel] by number, shape [4, 2]."""
        bands = np.repeat([i for i, _ in self._corners.values()], 4)
        points = self.pose.place(bands, np.concatenate([c for _, c in self._corners.values()]))
        squares = view.project(points)[0].reshape(-1, 4, 2)
        across, along = squares[:, 2] - squares[:, 0], squares[:, 3] - squares[:, 1]
        areas = 0.5 * (across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0])
        return {
            number: square
            for number, square, area in zip(self._corners, squares, areas, strict=True)
            if area > SMALLEST
        }

    def known(self, angles: Array) -> Array:
        """Return angles [rad], shape [16], with NaN for those that are not sure enough."""
        out, variance = angles.copy(), self._covariance
        for rows, columns in ((slice(0, 3), slice(0, 3)), (slice(3, 6), slice(3, 6))):
            if np.linalg.eigvalsh(variance[rows, rows])[-1] > UNSURE**2:
                out[columns] = np.nan
        for i, side in enumerate(SIDES):
            arm = ARM[side].start
            block = variance[6 + 3 * i : 9 + 3 * i, 6 + 3 * i : 9 + 3 * i]
            bone = self.pose.shoulders[i][:, 2]
            across = np.linalg.svd(bone[None])[2][1:]
            if np.linalg.eigvalsh(across @ block @ across.T)[-1] > UNSURE**2:
                out[arm : arm + 3] = np.nan
            elif bone @ block @ bone > UNSURE**2:
                out[arm + 2] = np.nan
            for k, place in ((12 + i, arm + 3), (14 + i, arm + 4)):
                if variance[k, k] > UNSURE**2:
                    out[place] = np.nan
        return out

    def _forget(self, passed: float) -> None:
        """Let the estimate grow less sure as time passes [s]."""
        trunk, head, shoulder, elbow, forearm, pelvis = FASTEST
        spread = (
            np.repeat(
                (trunk, head, shoulder, shoulder, elbow, forearm, pelvis), (3, 3, 3, 3, 2, 2, 3)
            )
            * passed
        )
        moving = len(spread)
        rows = self._information[:, :moving]
        inner = np.diag(1.0 / spread**2) + self._information[:moving, :moving]
        left = self._information - rows @ np.linalg.solve(inner, rows.T)
        self._information = 0.5 * (left + left.T)

    def _fit(self, seen: Mapping[int, Array], view: View, *, steps: int) -> float:
        """Move the estimate to where it fits the corners best, and return what is left [pixel]."""
        usable = [number for number in seen if number in self._corners]
        before, information = self.pose, self._information
        normal, rest = information, np.zeros(0)
        if usable:
            bands = np.repeat([self._corners[number][0] for number in usable], 4)
            local = np.concatenate([self._corners[number][1] for number in usable])
            pixels = np.concatenate([seen[number] for number in usable])
            pose = before.copy()
            for _ in range(steps):
                points, slopes = pose.look(bands, local)
                found, change = view.project(points)
                rest = pixels - found
                weights = self._weights(rest)
                jacobian = np.einsum("nij,njk->nik", change, slopes).reshape(2 * len(points), -1)
                weighted = jacobian * (np.repeat(weights, 2) / PIXEL**2)[:, None]
                normal = information + weighted.T @ jacobian
                pull = weighted.T @ rest.ravel() - information @ pose.minus(before)
                step = np.linalg.solve(normal, pull)
                size = float(np.abs(step[:16]).max())
                pose = pose.plus(step * min(1.0, 0.5 / max(size, 1e-9)))
                if size < STILL:
                    break
            self.pose = pose
            kept = self._weights(rest).reshape(-1, 4).min(axis=1) > TRUSTED / STRANGE
            self.used = tuple(n for n, k in zip(usable, kept, strict=True) if k)
        else:
            self.used = ()
        self._information = np.asarray(0.5 * (normal + normal.T), np.float64)
        moving = np.eye(len(normal))[:, :16]
        self._covariance = np.asarray(np.linalg.solve(self._information, moving)[:16], np.float64)
        return float(np.sqrt(np.mean(rest**2))) if len(rest) else math.nan

    @staticmethod
    def _weights(rest: Array) -> Array:
        """Return how much each corner counts, by what its card is off; four corners share a weight."""
        off = np.sqrt((rest**2).sum(axis=1).reshape(-1, 4).mean(axis=1)) / PIXEL
        return np.asarray(
            np.repeat(np.minimum(1.0, TRUSTED / np.maximum(off, 1e-9)), 4), np.float64
        )
