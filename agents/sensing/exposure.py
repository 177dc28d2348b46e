"""Pictures whose pixels gather light over their whole area, as a real sensor's do.

A renderer looks at one or four points of a pixel. Where an edge runs along a row, a column or a diagonal
that makes the same mistake in each pixel, up to an eighth of one. The mean of several pictures, each
shifted by a part of a pixel, comes nearer to the truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array
from rcare_marl.rendering import Renderer
from rcare_marl.rendering.camera import Camera
from rcare_marl.rendering.shot import Look, Shot

# Of each pixel that the shifts cover: `full` pictures have four points in a pixel already. Of 0.25, 0.5
# and 1, half a pixel gave the least errors.
_SPREAD = {"plain": 1.0, "full": 0.5}
# Shifts that fill a square evenly however many there are: the sequence R2 of Roberts (2018).
_R2 = np.array((0.7548776662466927, 0.5698402909980532))


def exposures(camera: Camera, look: Look, count: int) -> list[Shot]:
    """Return the shots, shifted by parts of a pixel, whose mean is one picture; the first is not."""
    shifts = _shifts(count, look).tolist()
    cameras = [camera, *(camera.shifted(*shift) for shift in shifts[1:])]
    return [Shot(each, ("rgb",), look) for each in cameras]


def developed(
    images: Sequence[npt.NDArray[Any]], camera: Camera, look: Look
) -> tuple[npt.NDArray[np.uint8], Camera]:
    """Return the mean of exposures, uint8 as they are, and the camera that would see it so.

    Args:
        images: Pictures of the shots that `exposures` returned, all of the same shape.
        camera: What `exposures` was given.
        look: And what look.
    """
    if len(images) == 1:
        return np.asarray(images[0], np.uint8), camera
    mean = np.rint(np.mean(images, axis=0, dtype=np.float32)).astype(np.uint8)
    return mean, camera.shifted(*_shifts(len(images), look).mean(axis=0).tolist())


def photograph(
    renderer: Renderer, camera: Camera, *, look: Look = "full", count: int = 2
) -> tuple[npt.NDArray[np.uint8], Camera]:
    """Return a picture of `count` exposures, [height, width, 3], and the camera that sees it so."""
    pictures = renderer.read(exposures(camera, look, count))
    return developed([picture["rgb"] for picture in pictures], camera, look)


def _shifts(count: int, look: Look) -> Array:
    """Return shifts of a picture [pixel], shape [count, 2], the first one none."""
    even = (0.5 + _R2 * np.arange(count)[:, None]) % 1.0 - 0.5
    return np.asarray(_SPREAD[look] * even, np.float64)
