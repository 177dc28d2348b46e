"""A pinhole camera: where it stands, where it looks, and its matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError
from ..pose import Array

_LARGEST = 8192  # [pixel], what every OpenGL 3.3 driver can draw


@dataclass(frozen=True)
class Camera:
    """A pinhole camera in the world.

    Attributes:
        eye: Where the camera stands [m], shape [3].
        target: The point in the middle of the picture [m], shape [3].
        up: Direction that is up in the picture, shape [3].
        fov_deg: Vertical field of view [deg].
        width: Width of the picture [pixel].
        height: Height of the picture [pixel].
        near: Nearest distance drawn [m].
        far: Farthest distance drawn [m].

    Raises:
        ConfigError: If a value is impossible, or the camera looks along `up`.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov_deg: float = 45.0
    width: int = 640
    height: int = 480
    near: float = 0.05
    far: float = 30.0

    def __post_init__(self) -> None:
        for name in ("eye", "target", "up"):
            value = getattr(self, name)
            if len(value) != 3 or not all(math.isfinite(x) for x in value):
                raise ConfigError(f"camera {name} must be 3 finite numbers, got {value!r}")
        if not 1 <= self.fov_deg <= 170:
            raise ConfigError(f"camera fov_deg must lie in [1, 170], got {self.fov_deg}")
        for name in ("width", "height"):
            size = getattr(self, name)
            if int(size) != size or not 1 <= size <= _LARGEST:
                raise ConfigError(
                    f"camera {name} must be a whole number in [1, {_LARGEST}], got {size}"
                )
        if not 0 < self.near < self.far or not math.isfinite(self.far):
            raise ConfigError(
                f"camera needs 0 < near < far, got near={self.near} and far={self.far}"
            )
        sight = np.subtract(self.target, self.eye)
        lengths = float(np.linalg.norm(sight) * np.linalg.norm(self.up))
        if lengths == 0 or np.linalg.norm(np.cross(sight, self.up)) < 1e-6 * lengths:
            raise ConfigError(
                f"camera cannot look from {self.eye} at {self.target} with up {self.up}: "
                "the points must differ and the line of sight must not be along up"
            )

    @property
    def aspect(self) -> float:
        """Width over height of the picture [1]."""
        return self.width / self.height

    def axes(self) -> Array:
        """Return the camera's right, up and backward axes in the world as rows, shape [3, 3]."""
        back = np.subtract(self.eye, self.target)
        back = back / np.linalg.norm(back)
        right = np.cross(self.up, back)
        right = right / np.linalg.norm(right)
        return np.array((right, np.cross(back, right), back))

    def view(self) -> Array:
        """Return the transform from world to camera (x right, y up, z back), shape [4, 4]."""
        return look(self.axes(), self.eye)

    def projection(self) -> Array:
        """Return OpenGL's perspective projection, shape [4, 4]."""
        scale = 1 / math.tan(math.radians(self.fov_deg) / 2)
        near, far = self.near, self.far
        return np.array(
            (
                (scale / self.aspect, 0, 0, 0),
                (0, scale, 0, 0),
                (0, 0, (far + near) / (near - far), 2 * far * near / (near - far)),
                (0, 0, -1, 0),
            )
        )


def look(axes: Array, eye: tuple[float, float, float] | Array) -> Array:
    """Return the transform into a frame with rows `axes` and origin `eye`, shape [4, 4]."""
    out = np.eye(4)
    out[:3, :3] = axes
    out[:3, 3] = -axes @ np.asarray(eye, np.float64)
    return out


def orthographic(half_width: float, near: float, far: float) -> Array:
    """Return OpenGL's orthographic projection of a square, shape [4, 4]."""
    out = np.diag((1 / half_width, 1 / half_width, -2 / (far - near), 1.0))
    out[2, 3] = -(far + near) / (far - near)
    return out


__all__ = ["Camera", "look", "orthographic"]
