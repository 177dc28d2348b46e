"""Cameras on robots, on people or in the room: colours, depths, normals, segmentation, points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Pose
from rcare_marl.rendering.camera import Camera, check_lens
from rcare_marl.rendering.shot import Light, Look, Output, Picture, Shot
from rcare_marl.rendering.studio import Studio, Viewpoint
from rcare_marl.world import World

from ..agent import Agent
from ..robots.robot import Robot
from ..robots.robot_config import ZERO, CameraMount, Triple
from .sensor import Channel, Place, Sensor, SensorConfig, find_place, kept_links

CameraOutput = Literal["rgb", "depth", "normals", "segmentation", "points"]
Readings = Sequence[npt.NDArray[Any]]

FOV = 45.0  # [deg], of a camera that the user places; our own choice
VERTICAL = (
    1e-5  # greatest slope of a line of sight that counts as straight up or down, our own choice
)


@dataclass(frozen=True)
class LensConfig(SensorConfig):
    """Options of what a sensor sees with.

    It is a camera of the robot, by its name in the robot's YAML file, or stands on a `link`, or in the
    room at `eye`: upright, or with the world's y up in the picture if it looks straight up or down.

    Attributes:
        camera: A camera of the robot; its first if nothing says otherwise.
        link: A robot's link or a person's segment that carries the camera instead.
        at: Where on that link [m].
        rpy_deg: Turn of the camera in it, fixed-axis roll, pitch, yaw [degrees]; z is forward, x right and
            y down in the picture.
        eye: Where in the world the camera stands instead [m].
        target: What it looks at from there [m].
        width: Width of the picture [pixel].
        height: Height of the picture [pixel].
        fov_deg: Vertical field of view [degrees]; that of the robot's camera, or 45, if None.
        near: Least depth that is seen [m].
        far: Greatest depth that is seen [m].
        look: Of colours: `plain`, or `full` with shadows and smooth edges, several times as slow.
    """

    camera: str = ""
    link: str = ""
    at: Triple = ZERO
    rpy_deg: Triple = ZERO
    eye: Triple | None = None
    target: Triple | None = None
    width: int = 64
    height: int = 48
    fov_deg: float | None = None
    near: float = 0.02
    far: float = 10.0
    look: Look = "plain"

    def __post_init__(self) -> None:
        super().__post_init__()
        where = f"sensor {self.name!r}"
        if (self.eye is None) != (self.target is None):
            raise ConfigError(f"{where}: eye and target belong together")
        if sum((bool(self.camera), bool(self.link), self.eye is not None)) > 1:
            raise ConfigError(f"{where}: only one of camera, link, and eye with target")
        if not self.link and (self.at, self.rpy_deg) != (ZERO, ZERO):
            raise ConfigError(f"{where}: at and rpy_deg need a link")
        fov_deg = FOV if self.fov_deg is None else self.fov_deg
        try:
            check_lens(fov_deg, self.width, self.height, self.near, self.far)
        except ConfigError as error:
            raise ConfigError(f"{where}: {error}") from error
        if self.eye is not None and self.eye == self.target:
            raise ConfigError(f"{where}: eye and target must differ, got {self.eye} for both")

    def pose_in_room(self) -> Pose | None:
        """Return the pose in the world that `eye` and `target` say, None without them."""
        if self.eye is None or self.target is None:
            return None
        x, y, z = np.abs(np.subtract(self.target, self.eye)).tolist()
        is_upright = math.hypot(x, y) > VERTICAL * z
        return Camera(
            self.eye, self.target, (0.0, 0.0, 1.0) if is_upright else (0.0, 1.0, 0.0)
        ).pose


@dataclass(frozen=True)
class CameraConfig(LensConfig):
    """Options of `camera`. `noise` [m] is that of depths, and so of points.

    Attributes:
        outputs: What it gives: `rgb`, `depth`, `normals`, `segmentation`, `points`.
        noise_growth: Whether `noise` is the same at every depth, or `quadratic`: `noise` is then that at
            1 m and grows with the square of the depth, as for stereo cameras.
    """

    outputs: tuple[CameraOutput, ...] = ("rgb",)
    noise_growth: Literal["constant", "quadratic"] = "constant"

    def __post_init__(self) -> None:
        super().__post_init__()
        where = f"sensor {self.name!r}"
        if not self.outputs or len(set(self.outputs)) != len(self.outputs):
            raise ConfigError(f"{where}: outputs must name some, each once, got {self.outputs}")
        if self.noise and not {"depth", "points"} & set(self.outputs):
            raise ConfigError(f"{where}: noise is for depth and points, which it does not give")

    @property
    def read(self) -> tuple[Output, ...]:
        """What to read of the renderer."""
        wanted = ["depth" if output == "points" else output for output in self.outputs]
        return tuple(dict.fromkeys(wanted))


class CameraSensor(Sensor):
    """A camera. All cameras of a world share a renderer and are read together.

    Channels, each an array: `rgb` uint8 [height, width, 3]; `depth` [m] float32 [height, width] along the
    optical axis, 0 where nothing is seen within near and far; `normals` float32 [height, width, 3] in
    the optical frame, 0 where nothing is seen; `segmentation` int32 [height, width], the keys of
    `labels`, -1 for what belongs to no body; `points` [m] float32 [height * width, 3], row by row, in
    the frame of the robot's base or the person's pelvis, 0 where nothing is seen, with `valid` uint8
    [height * width], 1 where something is.

    Attributes:
        base: Link of the robot's base or the person's pelvis, once bound.
    """

    Config = CameraConfig
    config: CameraConfig

    def __init__(self, config: CameraConfig) -> None:
        self.config = config
        self._error, self._light = Pose(), Light()
        self._viewpoint: Viewpoint | None = None

    def links(self, agent: Agent) -> Sequence[str]:
        if self.config.eye is not None:
            return ()
        return kept_links(agent, self.config.link or self._mount(agent).link)

    def bind(self, world: World, agent: Agent) -> None:
        config = self.config
        self._world, self._body = world, agent.body
        turn = agent.body.joints.get("base_turn")  # the base of a robot that drives is behind it
        self.base = -1 if turn is None else turn.index
        self._fov = FOV if config.fov_deg is None else config.fov_deg
        self._place: Place | None = None
        if config.link:
            self._place = find_place(agent, config.link, config.at, config.rpy_deg)
        elif config.eye is None:
            mount = self._mount(agent)
            if config.fov_deg is None:
                self._fov = mount.fov_deg
            self._place = Place(agent.body.link_index(mount.link), mount.pose)
        self._viewpoint = Studio.of(world).enter(self.aim, config.rate)

    @property
    def fov_deg(self) -> float:
        """Vertical field of view [degrees], once bound."""
        return self._fov

    def _mount(self, agent: Agent) -> CameraMount:
        """Return the robot's own camera that is asked for."""
        mounts = agent.config.cameras if isinstance(agent, Robot) else {}
        if not mounts:
            raise ConfigError(
                f"sensor {self.config.name!r}: {agent.name!r} has no camera of its own; "
                "say link, or eye and target"
            )
        name = self.config.camera or next(iter(mounts))
        check_name(f"camera of {agent.name!r}", name, mounts)
        return mounts[name]

    @property
    def view(self) -> Camera:
        """The camera as it is believed to stand now: `K`, `pose`, `project`, `unproject`; once bound."""
        return self._standing(Pose())

    def misplace(self, error: Pose, light: Light) -> bool:
        self._error, self._light = error, light
        return True

    def _standing(self, error: Pose) -> Camera:
        config = self.config
        pose = config.pose_in_room()
        if pose is None:
            assert self._place is not None
            pose = self._body.link_pose(self._place.link) @ self._place.pose
        return Camera.at(
            pose @ error,
            fov_deg=self._fov,
            width=config.width,
            height=config.height,
            near=config.near,
            far=config.far,
        )

    @property
    def labels(self) -> dict[int, tuple[str, str]]:
        """Name of body and link by their number in `segmentation`; once bound."""
        return Studio.of(self._world).labels()

    def aim(self) -> Shot:
        """Return the picture to take now, from where the camera truly stands; once bound."""
        config = self.config
        return Shot(self._standing(self._error), config.read, config.look, self._light)

    def channels(self) -> Sequence[Channel]:
        config = self.config
        size = (config.height, config.width)
        count = config.height * config.width
        known = {
            "rgb": Channel("rgb", "1", (*size, 3), True, "uint8", 0, 255, False),
            "depth": Channel("depth", "m", size, True, low=0, high=config.far),
            "normals": Channel("normals", "1", (*size, 3), True, low=-1, high=1, is_noisy=False),
            "segmentation": Channel("segmentation", "1", size, True, "int32", -1, is_noisy=False),
            "points": Channel("points", "m", (count, 3), True),
        }
        out = [known[output] for output in config.outputs]
        if "points" in config.outputs:
            out.append(Channel("valid", "1", (count,), True, "uint8", 0, 1, False))
        return out

    def measure(self) -> Readings:
        assert self._viewpoint is not None
        shot, picture = self._viewpoint.read()
        if "depth" in picture:
            depth = picture["depth"]
            seen = (depth >= self.config.near) & (depth <= self.config.far)
            picture["depth"] = np.where(seen, depth, np.float32(0))
        self._camera, self._base_pose = shot.camera, self._body.link_pose(self.base)
        self._picture = picture
        return self._readings(picture)

    def _readings(self, picture: Picture) -> Readings:
        out = []
        for output in self.config.outputs:
            out.append(self._points(picture["depth"]) if output == "points" else picture[output])
        if "points" in self.config.outputs:
            out.append((picture["depth"] > 0).ravel().astype(np.uint8))
        return out

    def _points(self, depth: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return the points of a picture of depths [m] in the frame of the base, shape [n, 3]."""
        believed = self._camera.pose @ self._error.inverse()
        camera_in_base: Pose = self._base_pose.inverse() @ believed
        matrix = camera_in_base.matrix()
        points = (self._camera.rays() * depth[:, :, None]) @ matrix[:3, :3].T + matrix[:3, 3]
        points[depth == 0] = 0.0
        return points.reshape(-1, 3).astype(np.float32)

    def disturb(self, readings: Readings, rng: np.random.Generator) -> Readings:
        """Return the last readings with noise on what was seen; points follow the depths."""
        if not self.config.noise:
            return readings
        depth = self._picture["depth"]
        spread = self.config.noise * (depth**2 if self.config.noise_growth == "quadratic" else 1)
        noisy = depth + spread * rng.standard_normal(depth.shape)
        noisy = np.where(depth > 0, np.clip(noisy, self.config.near, self.config.far), 0)
        return self._readings({**self._picture, "depth": noisy.astype(np.float32)})

    def close(self) -> None:
        if self._viewpoint is not None:
            self._viewpoint.leave()
