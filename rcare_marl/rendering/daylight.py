"""Soft light: a picture as the mean of pictures under many lights."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .shot import Light, Picture, Shot

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))  # [rad]; points turned by it spread evenly over a disc
# Steps within a pixel from picture to picture: Roberts' R2 sequence, from memory.
STEPS = (0.7548776662, 0.5698402910)


BRIGHT = 96.0  # [%] of the pixels are not too bright; own choice
GAINS = (0.7, 1.8)  # least and most that an exposure changes the light; own choice


class _Reader(Protocol):
    def read(self, shots: Sequence[Shot]) -> list[Picture]: ...


def dome(light: Light, count: int, *, spread: float = 0.95) -> list[Light]:
    """Return lights that together are like a sky, by cosine of the angle from overhead.

    Args:
        light: What each is like but for its direction.
        count: How many.
        spread: Sine of the widest angle from overhead, below 1.
    """
    out = []
    for i in range(count):
        sine, turn = spread * math.sqrt((i + 0.5) / count), GOLDEN_ANGLE * i
        towards = sine * math.cos(turn), sine * math.sin(turn), math.sqrt(1 - sine * sine)
        out.append(dataclasses.replace(light, direction=towards))
    return out


def disc(light: Light, count: int, *, radius: float = 0.03) -> list[Light]:
    """Return lights that together are like a light as wide as `radius` [rad]."""
    right, up, middle = light.axes()
    out = []
    for i in range(count):
        away, turn = radius * math.sqrt((i + 0.5) / count), GOLDEN_ANGLE * i
        x, y, z = (middle + away * (math.cos(turn) * right + math.sin(turn) * up)).tolist()
        out.append(dataclasses.replace(light, direction=(x, y, z)))
    return out


def exposed(
    renderer: _Reader,
    camera: Camera,
    lights: Sequence[Light],
    *,
    brightest: float | None = None,
) -> npt.NDArray[np.uint8]:
    """Return the mean of the pictures under each light, shape [height, width, 3].

    Each is taken from elsewhere within a pixel, so that edges come out smooth even if the renderer takes
    one sample a pixel.

    Args:
        renderer: What takes the pictures.
        camera: Where from.
        lights: The lights.
        brightest: How bright nearly all of the picture is at most, in (0, 1], as a camera would expose
            it; as the lights make it if None.
    """
    total = np.zeros((camera.height, camera.width, 3))
    for i, light in enumerate(lights):
        moved = camera.shifted(*(step * i % 1 - 0.5 for step in STEPS))
        seen = renderer.read([Shot(moved, light=light)])[0]["rgb"] / 255
        total += seen * seen  # the mean of light, not of its encoding
    mean = total / len(lights)
    if brightest is not None:
        now = float(np.percentile(mean.max(axis=2), BRIGHT))
        mean *= np.clip(brightest**2 / max(now, 1e-6), *GAINS)
    return np.round(255 * np.sqrt(np.minimum(mean, 1.0))).astype(np.uint8)
