"""How limbs of synthetic people move: several strokes of uneven speed, great circles with bulges, tremor."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.agents.coaching.upper_body import ARM, SIDES, arm_angles, arm_direction
from rcare_marl.pose import Array

from .synthetic_user import SyntheticUser

RATE = 120.0  # at which motion is made; sensors sample it [1/s]
ELEVATION, PLANE, ELBOW = 0, 1, 3  # within an arm
DEGREE = math.pi / 180


def advance(seconds: float, user: SyntheticUser, rng: np.random.Generator) -> Array:
    """Return how much of a move is done over its time, from 0 to 1: sub-movements, corrections, pauses."""
    count = 1 + int(rng.random() < user.jerky) + int(rng.random() < 0.5 * user.jerky)
    sizes = rng.dirichlet(np.full(count, 4.0))
    grid = np.linspace(0.0, 1.0, max(int(seconds * RATE), 2))
    out = np.zeros(len(grid))
    length = 1.0 if count == 1 else 1.5 / count
    starts = np.linspace(0.0, 1.0 - length, count)
    for size, start in zip(sizes, starts, strict=True):
        out += size * _stroke((grid - start) / length, user.skew * rng.uniform(0.9, 1.1))
    if rng.random() < user.jerky:  # too far first, then put right
        out += rng.uniform(0.0, 0.04) * _stroke((grid - 0.5) / 0.3, 1.0)
        out /= out[-1]
        out += rng.uniform(0.0, 0.05) * np.sin(np.pi * np.clip((grid - 0.6) / 0.4, 0, 1)) ** 2
    if rng.random() < user.pauses:
        at = int(np.searchsorted(out, rng.uniform(0.3, 0.7)))
        out = np.insert(
            out, at, np.full(int(rng.uniform(0.2, 1.0) * RATE), out[min(at, len(out) - 1)])
        )
    return out


def _stroke(share: Array, skew: float) -> Array:
    """Return how far a stroke has gone over its time: bell-shaped in speed, early or late by `skew`."""
    tau = np.clip(share, 0.0, 1.0) ** skew
    return np.asarray(tau - np.sin(2 * np.pi * tau) / (2 * np.pi))


def between(keys: Array, gone: Array) -> Array:
    """Return values between those at key poses, `gone` counted in key poses."""
    at = np.arange(len(keys))
    inner = np.column_stack([np.interp(gone, at, column) for column in keys.T])
    over = gone - np.clip(gone, 0, len(keys) - 1)
    return np.asarray(inner + over[:, None] * (keys[-1] - keys[-2]))


def swung(side: str, keys: Array, gone: Array, bulge: Array) -> Array:
    """Return the five angles of an arm that swings from direction to direction on great circles, with bulges.

    Args:
        side: Which.
        keys: Its angles at key poses [rad], shape [poses, 5].
        gone: Counted in key poses, shape [n].
        bulge: How far it leaves each great circle at its middle [rad], shape [poses - 1].
    """
    out = between(keys, gone)
    ends = arm_direction(side, keys[:, ELEVATION], keys[:, PLANE])
    k = np.clip(gone.astype(int), 0, len(keys) - 2)
    share = (gone - k)[:, None]
    start, end = ends[k], ends[k + 1]
    angle = np.arccos(np.clip((start * end).sum(axis=1), -1, 1))[:, None]
    is_far = angle[:, 0] > 1 * DEGREE
    sine = np.maximum(np.sin(angle), 1e-6)
    at = (np.sin((1 - share) * angle) * start + np.sin(share * angle) * end) / sine
    aside = np.cross(start, end) / sine
    hump = np.sin(np.pi * np.clip(share, 0, 1)) ** 2 * np.sin(np.minimum(angle, 1.5))
    at = at + bulge[k][:, None] * hump * aside
    elevation, plane = arm_angles(
        side, at / np.maximum(np.linalg.norm(at, axis=1, keepdims=True), 1e-9)
    )
    out[is_far, ELEVATION], out[is_far, PLANE] = elevation[is_far], plane[is_far]
    return out


def alive(user: SyntheticUser, times: Array, angles: Array, rng: np.random.Generator) -> Array:
    """Return angles with tremor, breathing and a gaze that wanders."""
    out = angles.copy()
    for i, side in enumerate(SIDES):
        start = ARM[side].start
        for column, size in ((ELEVATION, 1.0), (PLANE, 0.7), (ELBOW, 1.0)):
            phase = rng.uniform(0, 2 * np.pi)
            wave = np.sin(2 * np.pi * user.tremor_rate * times + phase)
            out[:, start + column] += size * user.tremor[i] * wave
            out[:, start + column] += 1.0 * DEGREE * _wander(times, rng)
    for j in range(3):
        out[:, 3 + j] += user.gaze[j] * _wander(times, rng)
        wave = np.sin(2 * np.pi * user.tremor_rate * times + rng.uniform(0, 2 * np.pi))
        out[:, 3 + j] += user.tremor[2] * wave
        out[:, j] += 0.7 * DEGREE * _wander(times, rng)
    return out


def _wander(times: Array, rng: np.random.Generator) -> Array:
    """Return a slow irregular wave of about unit size, shape [n]."""
    rates, phases = rng.uniform(0.05, 0.35, size=3), rng.uniform(0, 2 * np.pi, size=3)
    waves = np.sin(2 * np.pi * rates[:, None] * times + phases[:, None])
    return np.asarray(waves.sum(axis=0) / math.sqrt(3.0))
