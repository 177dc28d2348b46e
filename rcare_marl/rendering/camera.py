"""A pinhole camera: where it stands, where it looks, its matrices, and where points are seen.

Pixels are counted as OpenCV and ROS count them: column u to the right and row v down, whole numbers in
the middle of a pixel, so the picture spans u from -0.5 to width - 0.5. The optical frame has z forward,
x right and y down in the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import ConfigError
from ..pose import Array, Pose, quaternion_from_matrix

_LARGEST = 8192  # [pixel], what every OpenGL 3.3 driver can draw
_OPTICAL = np.diag(
    (1.0, -1.0, -1.0)
)  # between OpenGL's x right, y up, z back and the optical frame


@dataclass(frozen=True)
class Camera:
    """A pinhole camera in the world.

    Attributes:
        eye: Where the camera stands [m], shape [3].
        target: A point straight ahead of the camera [m], shape [3].
        up: Direction that is up in the picture, shape [3].
        fov_deg: Vertical field of view [deg]; of a lens off the middle, what it would be in the middle.
        width: Width of the picture [pixel].
        height: Height of the picture [pixel].
        near: Nearest depth drawn [m].
        far: Farthest depth drawn [m].
        stretch: Horizontal over vertical focal length [1]: other than one where pixels are not square.
        center: Pixel (u, v) that `target` is seen at; None for the middle of the picture.

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
    stretch: float = 1.0
    center: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("eye", "target", "up"):
            value = getattr(self, name)
            if len(value) != 3 or not all(math.isfinite(x) for x in value):
                raise ConfigError(f"camera {name} must be 3 finite numbers, got {value!r}")
        sight = np.subtract(self.target, self.eye)
        lengths = float(np.linalg.norm(sight) * np.linalg.norm(self.up))
        if lengths == 0 or np.linalg.norm(np.cross(sight, self.up)) < 1e-6 * lengths:
            raise ConfigError(
                f"camera cannot look from {self.eye} at {self.target} with up {self.up}: "
                "the points must differ and the line of sight must not be along up"
            )
        check_lens(self.fov_deg, self.width, self.height, self.near, self.far)
        if not 0.01 <= self.stretch <= 100:
            raise ConfigError(f"camera stretch must lie in [0.01, 100], got {self.stretch}")
        if self.center is not None and not all(math.isfinite(x) for x in self.center):
            raise ConfigError(f"camera center must be 2 finite numbers, got {self.center!r}")

    @classmethod
    def at(
        cls,
        pose: Pose,
        *,
        fov_deg: float = 45.0,
        width: int = 640,
        height: int = 480,
        near: float = 0.05,
        far: float = 30.0,
    ) -> Camera:
        """Return the camera whose optical frame is at `pose` in the world."""
        eye, target, up = _sight(pose)
        return cls(eye, target, up, fov_deg, width, height, near, far)

    @classmethod
    def from_intrinsics(
        cls,
        pose: Pose,
        *,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        width: int,
        height: int,
        near: float = 0.05,
        far: float = 30.0,
    ) -> Camera:
        """Return the camera with the optical frame at `pose` and the intrinsics of a calibrated one.

        Args:
            pose: Of the optical frame in the world.
            fx: Horizontal focal length [pixel].
            fy: Vertical focal length [pixel].
            cx: Column of the principal point [pixel], counted as in OpenCV.
            cy: Row of the principal point [pixel].
            width: Width of the picture [pixel].
            height: Height of the picture [pixel].
            near: Nearest depth drawn [m].
            far: Farthest depth drawn [m].

        Raises:
            ConfigError: If a value is impossible.
        """
        if not (fx > 0 and fy > 0):
            raise ConfigError(f"focal lengths must be positive, got fx={fx} and fy={fy}")
        eye, target, up = _sight(pose)
        fov = math.degrees(2 * math.atan(0.5 * height / fy))
        return cls(eye, target, up, fov, width, height, near, far, fx / fy, (cx, cy))

    @property
    def focal(self) -> tuple[float, float]:
        """Horizontal and vertical focal length [pixel]."""
        vertical = 0.5 * self.height / math.tan(math.radians(self.fov_deg) / 2)
        return vertical * self.stretch, vertical

    @property
    def principal(self) -> tuple[float, float]:
        """Pixel (u, v) of the principal point."""
        if self.center is not None:
            return self.center
        return 0.5 * (self.width - 1), 0.5 * (self.height - 1)

    @property
    def K(self) -> Array:  # noqa: N802  (the field's own name)
        """Intrinsic matrix [pixel], shape [3, 3]."""
        (fx, fy), (cx, cy) = self.focal, self.principal
        return np.array(((fx, 0, cx), (0, fy, cy), (0, 0, 1)), np.float64)

    @property
    def pose(self) -> Pose:
        """Extrinsics: pose of the optical frame in the world."""
        turn = quaternion_from_matrix(self.axes().T @ _OPTICAL)
        return Pose(tuple(map(float, self.eye)), tuple(turn.tolist()))

    def shifted(self, u: float, v: float) -> Camera:
        """Return a camera that sees everything `u` pixels farther right and `v` farther down."""
        at_u, at_v = self.principal
        return replace(self, center=(at_u + u, at_v + v))

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
        (fx, fy), (cx, cy) = self.focal, self.principal
        near, far = self.near, self.far
        return np.array(
            (
                (2 * fx / self.width, 0, 1 - 2 * (cx + 0.5) / self.width, 0),
                (0, 2 * fy / self.height, 2 * (cy + 0.5) / self.height - 1, 0),
                (0, 0, (far + near) / (near - far), 2 * far * near / (near - far)),
                (0, 0, -1, 0),
            )
        )

    def project(self, points: npt.ArrayLike) -> Array:
        """Return where points in the world are seen.

        Args:
            points: Points [m], shape [..., 3].

        Returns:
            Column and row [pixel] and depth [m], shape [..., 3]; column and row are not numbers
            (nan) for what is not in front of the camera.
        """
        local = (np.asarray(points, np.float64) - self.eye) @ self.axes().T @ _OPTICAL
        depth = np.where(local[..., 2] > 0, local[..., 2], np.nan)[..., None]
        seen = local[..., :2] / depth * self.focal + self.principal
        return np.concatenate((seen, local[..., 2:]), axis=-1)

    def rays(self) -> Array:
        """Return what one metre of depth is for each pixel, in the optical frame, [height, width, 3]."""
        (fx, fy), (cx, cy) = self.focal, self.principal
        out = np.ones((self.height, self.width, 3))
        out[:, :, 0] = (np.arange(self.width) - cx) / fx
        out[:, :, 1] = ((np.arange(self.height) - cy) / fy)[:, None]
        return out

    def unproject(self, depth: npt.NDArray[Any]) -> Array:
        """Return the points in the world that a picture of depths [m] shows.

        Args:
            depth: Along the optical axis [m], shape [height, width].

        Returns:
            Points [m], shape [height, width, 3]; nan where a depth is not finite.

        Raises:
            ConfigError: If the picture has another shape than the camera's.
        """
        if depth.shape != (self.height, self.width):
            raise ConfigError(
                f"depth must have shape {(self.height, self.width)}, got {depth.shape}"
            )
        known = np.where(np.isfinite(depth), depth, np.nan).astype(np.float64)
        return (self.rays() * known[:, :, None]) @ _OPTICAL @ self.axes() + self.eye


def check_lens(fov_deg: float, width: int, height: int, near: float, far: float) -> None:
    """Raise ConfigError if no camera can have these values; see `Camera`."""
    if not 1 <= fov_deg <= 170:
        raise ConfigError(f"camera fov_deg must lie in [1, 170], got {fov_deg}")
    for name, size in (("width", width), ("height", height)):
        if int(size) != size or not 1 <= size <= _LARGEST:
            raise ConfigError(
                f"camera {name} must be a whole number in [1, {_LARGEST}], got {size}"
            )
    if not 0 < near < far or not math.isfinite(far):
        raise ConfigError(f"camera needs 0 < near < far, got near={near} and far={far}")


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


Triple = tuple[float, float, float]


def _sight(pose: Pose) -> tuple[Triple, Triple, Triple]:
    """Return eye, a point one metre ahead, and up, of an optical frame."""
    matrix = pose.matrix()
    eye, ahead, up = matrix[:3, 3], matrix[:3, 3] + matrix[:3, 2], -matrix[:3, 1]
    return _triple(eye), _triple(ahead), _triple(up)


def _triple(values: Array) -> Triple:
    return float(values[0]), float(values[1]), float(values[2])
