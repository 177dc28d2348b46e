"""A robot's camera that watches synthetic people who wear marker bands: what it finds of their corners.

The corners come from a body and a pinhole camera, not from drawn pictures, which would take hours. How
exactly they are found in drawn pictures, by the same source, `experiments/coaching_camera.py` measures. What
hides a card is the rest of the body, as capsules, and how far the card is turned away.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from rcare_marl.agents.coaching.recognition.recogniser import Frame
from rcare_marl.agents.coaching.sources.camera_source import CameraSource, Seen
from rcare_marl.agents.coaching.sources.marker_band import SEGMENTS, band_set
from rcare_marl.agents.coaching.upper_body import ARM, MOTIONS, SIDES, SIGN, turn_z
from rcare_marl.pose import Array
from rcare_marl.rendering.camera import Camera

from .noise import NoiseModel, own_lift, sampled
from .performance import Performance, at_rest
from .synthetic_user import RESTS, SyntheticUser

CALIBRATION = 1.3  # how long a person sits still before the camera [s]
SETTLING = 1.5  # how long they take to lay their hands where they rest [s]; our own choice
DISTANCE, EYE_HEIGHT, LOOK_HEIGHT = (
    1.5,
    0.75,
    0.53,
)  # from the hips of somebody of 1.7 m [m]; our own choice
FOV_DEG, SIZE = 47.6, (640, 480)  # NAO V6's upper camera: vertical field of view, pixels
MOST_TURNED = 65.0  # of a card from the line of sight, to be read [deg]; measured in drawn pictures
SMALLEST = 12.0  # edge of a card that is read [pixel]; likewise
SLIP, TWIST_DEG = 0.005, 3.0  # how carelessly bands are put on [m], [deg]; our own choice
# What hides cards behind it: its ends, of which frame, and how thick [m]; our own choice.
CAPSULES = (
    ("trunk", "pelvis", "neck", 0.11),
    ("head", "head", "head", 0.09),
    *(
        (f"{side}_{part}", f"{side}_{start}", f"{side}_{end}", radius)
        for side in SIDES
        for part, start, end, radius in (
            ("upper_arm", "shoulder", "elbow", 0.042),
            ("forearm", "elbow", "wrist", 0.035),
        )
    ),
)


@dataclass(frozen=True, eq=False)
class CameraSight:
    """What one picture shows: corners by number of the marker [pixel], shape [4, 2] each, and the camera."""

    seen: dict[int, Array]
    camera: Seen


class CornerSource:
    """Makes frames of corners that somebody else has found.

    Attributes:
        source: What does it.
    """

    def __init__(self) -> None:
        self.source = CameraSource()

    def update(self, raw: CameraSight, time: float) -> Frame | None:
        """Return what is known at a time [s]; None during the calibration and while nothing is seen."""
        return self.source.follow(raw.seen, raw.camera, time)


class CameraSensor:
    """A camera before people who wear `band_set()`."""

    def __init__(self, noise: NoiseModel) -> None:
        self._noise = noise
        self._bands = band_set()
        faces = [(i, face) for i, band in enumerate(self._bands) for face in band.faces]
        self._numbers = [face.id for _, face in faces]
        self._band = np.array([i for i, _ in faces])
        self._corners = np.array([face.corners() for _, face in faces])  # [cards, 4, 3]
        self._segment = np.array([SEGMENTS.index(band.segment) for band in self._bands])

    def source(self, user: SyntheticUser, rng: np.random.Generator) -> CornerSource:
        """Return a source that has seen a person sit still, arms hanging their own way, and settle."""
        self._dress(user, rng)
        source = CornerSource()
        still, moving = (math.ceil(s * self._noise.rate) for s in (CALIBRATION, SETTLING))
        angles = np.zeros((still + moving, len(MOTIONS)))
        for side in SIDES:
            hanging = np.array(RESTS["hanging"]) + rng.normal(0, (3.0, 8.0, 4.0, 6.0, 6.0))
            angles[:, ARM[side]] = np.radians(hanging)
        angles[:, 3:6] = np.radians(rng.normal(0, 2, size=3))
        share = (1 - np.cos(np.linspace(0, np.pi, moving)))[:, None] / 2
        angles[still:] += share * (at_rest(user) - angles[still:])
        times = (np.arange(len(angles)) - len(angles)) / self._noise.rate
        for time, sight in zip(times, self._sights(user, angles, rng), strict=True):
            source.update(sight, float(time))
        return source

    def readings(
        self, user: SyntheticUser, performance: Performance, rng: np.random.Generator
    ) -> Iterator[tuple[float, float, CameraSight]]:
        """Yield what is found in each picture."""
        taken, told = self._noise.times(float(performance.times[-1]), rng)
        yield from zip(
            taken, told, self._sights(user, sampled(performance, taken), rng), strict=True
        )

    def _dress(self, user: SyntheticUser, rng: np.random.Generator) -> None:
        """Put the bands on, not quite as they should be, and the robot before the person."""
        count, tall = len(self._bands), user.height / 1.7
        self._places = np.array([band.place_on(user.height) for band in self._bands])
        self._places += rng.normal(0, SLIP, size=(count, 3))
        self._turns = Rotation.from_rotvec(
            np.radians(rng.normal(0, TWIST_DEG, size=(count, 3)))
        ).as_matrix()
        self._seat = np.array((0.0, 0.0, rng.uniform(0.4, 0.6)))
        eye = np.array((DISTANCE * tall, 0.0, EYE_HEIGHT)) + rng.normal(0, (0.05, 0.1, 0.05))
        look = np.array((0.0, 0.0, LOOK_HEIGHT * tall))
        eye, look = (self._seat + point for point in (eye, look))
        self._camera = Camera(
            tuple(eye.tolist()),
            tuple(look.tolist()),
            width=SIZE[0],
            height=SIZE[1],
            fov_deg=FOV_DEG,
        )

    def _sights(
        self, user: SyntheticUser, angles: Array, rng: np.random.Generator
    ) -> Iterator[CameraSight]:
        """Yield what is seen of postures [n, 16]."""
        count, cards = len(angles), len(self._numbers)
        corners = self._placed(user, angles)
        pixels = self._camera.project(corners.reshape(-1, 3))[:, :2].reshape(count, cards, 4, 2)
        is_seen = (
            self._facing(corners) & self._inside(pixels) & ~self._hidden(user, angles, corners)
        )
        is_seen &= ~self._noise.lost(count, cards, rng)
        pixels = pixels + rng.normal(0, self._noise.pixel, size=pixels.shape)
        for k in range(count):
            seen = {self._numbers[i]: pixels[k, i] for i in np.flatnonzero(is_seen[k])}
            yield CameraSight(seen, self._camera)

    def _placed(self, user: SyntheticUser, angles: Array) -> Array:
        """Return the corners of all cards in the world [m], shape [n, cards, 4, 3]."""
        points, turns = user.body.points(angles), user.body.turns(angles)
        up = turns["trunk"][..., 2]
        frames = {
            "trunk": (points["neck"], turns["trunk"]),
            "head": (points["neck"] + up * user.body.neck, turns["head"]),
        }
        for side in SIDES:
            arm = ARM[side]
            rise = (turns["trunk"] @ own_lift(user, side, angles)[..., None])[..., 0]
            pronated = turn_z(-SIGN[side] * angles[:, arm.start + 4])
            fore = turns[f"{side}_forearm"] @ pronated
            frames[f"{side}_upper_arm"] = (
                points[f"{side}_shoulder"] + rise,
                turns[f"{side}_upper_arm"],
            )
            frames[f"{side}_forearm"] = points[f"{side}_elbow"] + rise, fore
        origins = np.stack([frames[name][0] for name in SEGMENTS], axis=1)
        rotations = np.stack([frames[name][1] for name in SEGMENTS], axis=1)
        worn = np.einsum("cij,ckj->cki", self._turns[self._band], self._corners)
        worn += self._places[self._band][:, None]
        own = self._segment[self._band]
        moved = np.einsum("ncij,ckj->ncki", rotations[:, own], worn)
        return np.asarray(self._seat + origins[:, own][:, :, None] + moved)

    def _facing(self, corners: Array) -> npt.NDArray[np.bool_]:
        """Return which cards show their print to the camera, shape [n, cards]."""
        normal = np.cross(
            corners[..., 1, :] - corners[..., 0, :], corners[..., 0, :] - corners[..., 3, :]
        )
        sight = np.array(self._camera.eye) - corners.mean(axis=2)
        cosine = (normal * sight).sum(axis=-1)
        cosine /= np.linalg.norm(normal, axis=-1) * np.linalg.norm(sight, axis=-1)
        return np.asarray(cosine > math.cos(math.radians(MOST_TURNED)))

    @staticmethod
    def _inside(pixels: Array) -> npt.NDArray[np.bool_]:
        """Return which cards are large enough and wholly in the picture, shape [n, cards]."""
        inside = ((pixels > 1) & (pixels < np.array(SIZE) - 2)).all(axis=(2, 3))
        edges = np.linalg.norm(pixels - np.roll(pixels, 1, axis=2), axis=-1)
        return np.asarray(inside & (edges.max(axis=2) > SMALLEST))

    def _hidden(self, user: SyntheticUser, angles: Array, corners: Array) -> npt.NDArray[np.bool_]:
        """Return which cards are behind the body, shape [n, cards]."""
        points = user.body.points(angles)
        eye, middle = np.array(self._camera.eye), corners.mean(axis=2)
        way = eye - middle
        length = np.linalg.norm(way, axis=-1, keepdims=True)
        out = np.zeros(middle.shape[:2], bool)
        carrier = np.array(SEGMENTS)[self._segment[self._band]]
        for name, start, end, radius in CAPSULES:
            # The nearest of a few points along the axis stands for the capsule.
            for share in (0.0,) if start == end else np.linspace(0.1, 0.9, 6):
                point = self._seat + (1 - share) * points[start] + share * points[end]
                to = point[:, None] - middle
                along = (to * way).sum(axis=-1, keepdims=True) / length
                away = np.linalg.norm(to - along * way / length, axis=-1)
                before = (along[..., 0] > 0) & (along[..., 0] < length[..., 0])
                out |= before & (away < radius) & (carrier != name)
        return out
