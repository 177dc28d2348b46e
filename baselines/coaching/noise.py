"""What sensors make of a synthetic person: noise, drop-outs, and clocks that are not exact."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from rcare_marl.agents.coaching.recognition.recogniser import PoseSource
from rcare_marl.agents.coaching.sources.hands_source import HandsReading, HandsSource
from rcare_marl.agents.coaching.sources.joints_source import JointsSource
from rcare_marl.agents.coaching.upper_body import (
    ARM,
    MOTIONS,
    SHOULDER_HALF_WIDTH,
    SIDES,
    girdle,
    trunk_turn,
)
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose

from .performance import Performance
from .synthetic_user import SyntheticUser

DEVICES = ("head", "left_hand", "right_hand")
CALIBRATION = 10.0  # how long it takes to calibrate [s]
LOST_FRAMES = 3.0  # mean length of a drop-out; our own choice
MOUNT, MOUNT_TURN = 0.01, 3.0  # how a device sits on head or hand [m], [deg]; our own choice


@dataclass(frozen=True)
class NoiseModel:
    """How good the sensors are.

    Attributes:
        position: Standard deviation of a position along each axis [m].
        angle_deg: Of a rotation about each axis, or of a joint angle [deg].
        rate: Frames a second.
        jitter: Standard deviation of when a frame is taken [s].
        clock: Standard deviation of what its clock says of it [s].
        dropout: Share of the frames that a device misses; of a camera, that a marker is missed which is
            to be seen.
        drift_deg: By how much what is taken for ahead turns in a minute [deg]; of headset and hands alike.
        stature: Standard deviation of the stature that is told [m].
        pixel: Standard deviation of a marker's corner in a picture, along each axis [pixel].
        stature_off: By how much too tall the stature is told [m].
        slump_deg: How far somebody who sat upright at first slumps forward within ten seconds [deg].
        hand_lost: For how much of every six seconds one hand is not seen at all [s].
        swapped: Whether the devices of left and right hand are swapped: 1, or 0.
    """

    GROWING: ClassVar[tuple[str, ...]] = (
        *("position", "angle_deg", "jitter", "clock", "dropout", "drift_deg", "pixel"),
    )  # with a level of the noise; all but the rate

    position: float = 0.01
    angle_deg: float = 2.0
    rate: float = 30.0
    jitter: float = 0.004
    clock: float = 0.003
    dropout: float = 0.05
    drift_deg: float = 2.0
    stature: float = 0.015
    pixel: float = 0.6
    stature_off: float = 0.0
    slump_deg: float = 0.0
    hand_lost: float = 0.0
    swapped: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0):
                raise ConfigError(f"{name} of a noise model must not be negative, got {value}")
        if not self.rate > 0 or self.dropout >= 1:
            raise ConfigError("a noise model needs a positive rate and a drop-out below 1")

    def scaled(self, level: float, *names: str) -> NoiseModel:
        """Return noise of which some figures are larger by a factor; drop-outs stay below 0.9."""
        grown = {name: getattr(self, name) * level for name in names}
        if "dropout" in grown:
            grown["dropout"] = min(grown["dropout"], 0.9)
        return replace(self, **grown)

    def times(self, end: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return when frames are taken and what the clock says [s], up to `end`; both only grow."""
        even = np.arange(int(end * self.rate)) / self.rate
        taken = np.sort(np.clip(even + rng.normal(0, self.jitter, size=len(even)), 0.0, end))
        told = taken + rng.normal(0, self.clock, size=len(even))
        return taken, np.maximum.accumulate(told) + 1e-6 * np.arange(len(even))

    def lost(self, count: int, devices: int, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
        """Return which frames each device misses, a few in a row, shape [count, devices]."""
        out = np.zeros((count, devices), bool)
        if self.dropout == 0:
            return out
        leave = 1 / LOST_FRAMES
        enter = min(leave * self.dropout / (1 - self.dropout), 1.0)
        is_lost = rng.random(devices) < self.dropout
        for i, chance in enumerate(rng.random((count, devices))):
            is_lost = np.where(is_lost, chance > leave, chance < enter)
            out[i] = is_lost
        return out


# What may go wrong with a headset and two hands, besides noise; our own choice.
TROUBLES: Mapping[str, NoiseModel] = {
    "drift": NoiseModel(drift_deg=10.0),
    "hand_lost": NoiseModel(hand_lost=1.0),
    "swapped": NoiseModel(swapped=1.0),
    "stature": NoiseModel(stature_off=0.06),
    "slumped": NoiseModel(slump_deg=12.0),
}
HIDDEN_EVERY = 6.0  # [s] how often a hand is lost for a while
SLUMPED_AFTER = 10.0  # [s]


class Sensor(Protocol):
    """Watches performances."""

    def source(self, user: SyntheticUser, rng: np.random.Generator) -> PoseSource:
        """Return a source that is ready for a person, calibrated as a person would."""

    def readings(
        self, user: SyntheticUser, performance: Performance, rng: np.random.Generator
    ) -> Iterator[tuple[float, float, Any]]:
        """Yield of each frame when it was taken, what its clock says [s], and what was read."""


class HandsSensor:
    """A headset and two gloves or controllers."""

    def __init__(self, noise: NoiseModel) -> None:
        self._noise = noise
        self._placing: dict[int, tuple[Array, Rotation, Array, Rotation]] = {}

    def source(self, user: SyntheticUser, rng: np.random.Generator) -> HandsSource:
        """Return a source that was told a stature to the centimetre, and saw a calibration pose."""
        self._place(user, rng)
        noise = self._noise
        told = user.height + float(rng.normal(0, noise.stature)) + noise.stature_off
        source = HandsSource(round(told, 2))
        rest = np.zeros(len(MOTIONS))
        rest[3:6] = np.radians(rng.normal(0, 2, size=3))
        for i, side in enumerate(SIDES):
            rest[ARM[side]] = user.rest[i]
        if (
            user.span_known
        ):  # who can moves straight arms for ten seconds: down, forward, aside, round
            angles = _guided(rest, int(CALIBRATION * self._noise.rate), rng)
        else:
            angles = np.repeat(rest[None], int(1.0 * self._noise.rate), axis=0)
        source.calibrate([reading for reading in self._read(user, angles, rng)])
        return source

    def readings(
        self, user: SyntheticUser, performance: Performance, rng: np.random.Generator
    ) -> Iterator[tuple[float, float, HandsReading]]:
        """Yield what headset and hands report."""
        taken, told = self._noise.times(float(performance.times[-1]), rng)
        angles = sampled(performance, taken)
        turned = np.radians(self._noise.drift_deg) * rng.choice((-1, 1)) * taken / 60
        angles[:, 0] += np.radians(self._noise.slump_deg) * np.minimum(taken / SLUMPED_AFTER, 1.0)
        yield from zip(taken, told, self._read(user, angles, rng, turned), strict=True)

    def _place(self, user: SyntheticUser, rng: np.random.Generator) -> None:
        """Put the person somewhere, and the devices on them not quite as they should be."""
        seat = np.array((*rng.uniform(-1, 1, size=2), rng.uniform(0.4, 0.6)))
        facing = Rotation.from_rotvec((0, 0, rng.uniform(-np.pi, np.pi)))
        mounts = rng.normal(0, MOUNT, size=(3, 3))
        turned = Rotation.from_rotvec(np.radians(rng.normal(0, MOUNT_TURN, size=(3, 3))))
        self._placing[id(user)] = (seat, facing, mounts, turned)

    def _read(
        self,
        user: SyntheticUser,
        angles: Array,
        rng: np.random.Generator,
        drift: Array | None = None,
    ) -> Iterator[HandsReading]:
        noise, count = self._noise, len(angles)
        seat, facing, mounts, turned = self._placing[id(user)]
        if drift is not None:
            facing = Rotation.from_rotvec(drift[:, None] * (0.0, 0.0, 1.0)) * facing
        held = bent_poses(user, angles)
        lost = noise.lost(count, 3, rng)
        if noise.hand_lost and drift is not None:
            since = np.arange(count) / noise.rate + rng.uniform(0, HIDDEN_EVERY)
            lost[:, int(rng.integers(1, 3))] |= since % HIDDEN_EVERY < noise.hand_lost
        poses: list[list[Pose | None]] = []
        for i, device in enumerate(DEVICES):
            position, turn = held[device]
            position = position + turn.apply(mounts[i])
            position = (
                facing.apply(position) + seat + rng.normal(0, noise.position, size=(count, 3))
            )
            shake = Rotation.from_rotvec(
                np.radians(rng.normal(0, noise.angle_deg, size=(count, 3)))
            )
            quaternions = (facing * turn * turned[i] * shake).as_quat()
            poses.append(
                [
                    None if gone else Pose(tuple(p), tuple(q))
                    for p, q, gone in zip(
                        position.tolist(), quaternions.tolist(), lost[:, i], strict=True
                    )
                ]
            )
        if noise.swapped:
            poses[1:] = poses[:0:-1]
        for head, left, right in zip(*poses, strict=True):
            yield HandsReading(head, left, right)


def _guided(rest: Array, count: int, rng: np.random.Generator) -> Array:
    """Return the angles of a calibration as somebody does it who is told to [rad], shape [count, 16]."""
    # Elevation and plane of both arms [deg].
    keys = np.array(((8, 30), (8, 30), (85, 85), (85, 5), (130, 45), (85, 0), (8, 30)), np.float64)
    times = np.linspace(0, len(keys) - 1, count)
    out = np.repeat(rest[None], count, axis=0)
    for side in SIDES:
        arm = ARM[side].start
        own = keys + rng.normal(0, (5.0, 6.0), size=keys.shape)
        for column in (0, 1):
            out[:, arm + column] = np.radians(np.interp(times, range(len(keys)), own[:, column]))
        out[:, arm + 2 :][:, :3] = np.radians((0.0, rng.uniform(2, 18), rng.uniform(-20, 20)))
    return out


def bent_poses(user: SyntheticUser, angles: Array) -> dict[str, tuple[Array, Rotation]]:
    """Return positions [n, 3] and rotations of head and hands of a body that has wrists and shoulder blades.

    Args:
        user: Whose body.
        angles: [rad], shape [n, 16].
    """
    poses, points = user.body.poses(angles), user.body.points(angles)
    trunk = trunk_turn(angles[:, 0], angles[:, 1], angles[:, 2])
    out = {"head": (poses["head"][0], Rotation.from_quat(poses["head"][1]))}
    for i, side in enumerate(SIDES):
        palm, thumb = user.wrist[i]
        sign = 1.0 if side == "left" else -1.0
        bend = Rotation.from_euler("yz", (palm, -sign * thumb))
        turn = Rotation.from_quat(poses[f"{side}_hand"][1]) * bend
        more = own_lift(user, side, angles)
        wrist = points[f"{side}_wrist"] + (trunk @ more[..., None])[..., 0]
        out[f"{side}_hand"] = (wrist + user.body.palm * turn.apply((1.0, 0.0, 0.0)), turn)
    return out


def own_lift(user: SyntheticUser, side: str, angles: Array) -> Array:
    """Return how much more than average a shoulder moves with its arm, in the trunk's frame [m], [n, 3]."""
    arm = ARM[side].start
    usual = girdle(side, angles[:, arm], angles[:, arm + 1])
    return np.asarray((user.lift - 1.0) * usual * (user.body.shoulder / SHOULDER_HALF_WIDTH))


class JointsSensor:
    """Joint angles, as a simulator or a suit of markers gives them."""

    def __init__(self, noise: NoiseModel) -> None:
        self._noise = noise

    def source(self, user: SyntheticUser, rng: np.random.Generator) -> JointsSource:
        """Return a source of angles."""
        return JointsSource()

    def readings(
        self, user: SyntheticUser, performance: Performance, rng: np.random.Generator
    ) -> Iterator[tuple[float, float, Array]]:
        """Yield angles [16] with noise; trunk and head, left arm and right arm drop out each by itself."""
        noise = self._noise
        taken, told = noise.times(float(performance.times[-1]), rng)
        angles = sampled(performance, taken)
        angles += np.radians(rng.normal(0, noise.angle_deg, size=angles.shape))
        lost = noise.lost(len(taken), 3, rng)
        for i, columns in enumerate((slice(0, 6), ARM["left"], ARM["right"])):
            angles[lost[:, i], columns] = np.nan
        yield from zip(taken, told, angles, strict=True)


def sampled(performance: Performance, taken: Array) -> Array:
    """Return the angles of a performance when frames were taken [rad], shape [n, 16]."""
    columns = [np.interp(taken, performance.times, column) for column in performance.angles.T]
    return np.column_stack(columns)
