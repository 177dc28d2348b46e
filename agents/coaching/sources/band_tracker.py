"""The angles of an upper body from where the corners of its bands are seen: a model fitted to pixels.

One estimate is carried on from frame to frame, an iterated extended Kalman filter in information form (Bell &
Cathey 1993, IEEE Trans. Automat. Contr. 38, 294-297): all corners of all bands together pull at the same
angles, so that a forearm that is seen tells where a hidden elbow is. What a calibration cannot know is
estimated along with the angles: where neck, shoulders and elbows turn, how far shoulders move as arms are
raised, and how each band sits. These do not change, so they are learned from movement.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.pose import Array

from ..upper_body import ARM, SIDES, UpperBody
from .band_pose import BandPose, Layout
from .marker_band import Band

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
# places of joints [m], how far shoulders move with arms against the average, and how bands sit [m, rad].
PRIOR = {
    "trunk": math.radians(0.7),
    "head": math.radians(2.0),
    "shoulder": math.radians(6.0),
    "elbow": math.radians(8.0),
    "forearm": math.radians(8.0),
    "pelvis": 0.05,
    "joint": 0.03,
    "lift": 0.4,
    "place": 0.02,
    "turn": math.radians(5.0),
    "loose": math.radians(15.0),
}


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
        out[19:34], out[34] = PRIOR["joint"], PRIOR["lift"]
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
