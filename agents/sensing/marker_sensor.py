"""Where markers are, as a robot's own camera sees it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, Pose, rotation_vector
from rcare_marl.rendering import Renderer
from rcare_marl.rendering.camera import Camera
from rcare_marl.rendering.shot import Light, Look, Shot
from rcare_marl.rendering.studio import Studio, Viewpoint
from rcare_marl.world import World

from ..agent import Agent
from ..robots.robot import Robot
from .camera import CameraConfig, CameraSensor, LensConfig
from .marker_print import DICTIONARIES, dictionary_size
from .sensor import Channel, Sensor

# Of each pixel that the shifts cover: `full` pictures have four points in a pixel already. Of 0.25, 0.5
# and 1, half a pixel gave the least errors.
_SPREAD = {"plain": 1.0, "full": 0.5}
# Shifts that fill a square evenly however many there are: the sequence R2 of Roberts (2018).
_R2 = np.array((0.7548776662466927, 0.5698402909980532))
MOST_EXPOSURES = 64


def exposures(camera: Camera, look: Look, count: int) -> list[Shot]:
    """Return the shots, shifted by parts of a pixel, whose mean is one picture; the first is not.

    A renderer looks at one or four points of a pixel, where a real sensor gathers light over its whole
    area. Where an edge runs along a row, a column or a diagonal that makes the same mistake in each
    pixel, up to an eighth of one. The mean of several pictures comes nearer to the truth.
    """
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


@dataclass(frozen=True)
class MarkerSensorConfig(LensConfig):
    """Options of `markers`; in `plain` pictures edges are jagged, which is faster and less exact.

    `noise` is on positions [m] and rotations [rad] alike.

    Attributes:
        ids: Numbers of the markers to look for.
        size: Edge of the black square of each [m].
        sizes: Edge of the black square by number, of those that are not of `size` [m].
        dictionary: Which family of markers, one of `marker_print.DICTIONARIES`.
        frame: In which frame poses are given: of the robot's `base`, its `tool`, the `camera` (z
            forward, x right and y down in the picture) or the `world`.
        exposures: Pictures, shifted by parts of a pixel, whose mean is looked at; see `exposures`.
    """

    ids: tuple[int, ...] = (0,)
    size: float = 0.05
    sizes: dict[int, float] = field(default_factory=dict)
    dictionary: str = "4x4_50"
    frame: Literal["base", "camera", "world", "tool"] = "base"
    width: int = 640
    height: int = 480
    look: Look = "full"
    exposures: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        where = f"sensor {self.name!r}"
        check_name("dictionary of markers", self.dictionary, DICTIONARIES)
        if not self.ids or len(set(self.ids)) != len(self.ids):
            raise ConfigError(f"{where}: ids must name markers, each once, got {self.ids}")
        count = dictionary_size(self.dictionary)
        if not all(0 <= number < count for number in self.ids):
            raise ConfigError(
                f"{where}: dictionary {self.dictionary!r} has markers 0 to {count - 1}, got {self.ids}"
            )
        for number in self.sizes:
            if number not in self.ids:
                raise ConfigError(f"{where}: a size for marker {number}, but ids are {self.ids}")
        if not all(size > 0 for size in (self.size, *self.sizes.values())):
            raise ConfigError(f"{where}: sizes must be positive, got {self.size}, {self.sizes}")
        if not 1 <= self.exposures <= MOST_EXPOSURES:
            raise ConfigError(
                f"{where}: exposures must lie in [1, {MOST_EXPOSURES}], got {self.exposures}"
            )
        if self.latency > 0 and self.rate == 0:
            raise ConfigError(f"{where}: pictures with a latency need a rate too")

    def lens(self) -> CameraConfig:
        """Return the options of the camera."""
        shared = {option.name: getattr(self, option.name) for option in fields(LensConfig)}
        return CameraConfig(**shared | {"latency": 0.0, "noise": 0.0})

    def edges(self) -> dict[int, float]:
        """Return the edge of the black square of each marker [m]."""
        return {number: self.sizes.get(number, self.size) for number in self.ids}


class MarkerSensor(Sensor):
    """Finds markers in pictures of a camera; it knows nothing of where they truly are.

    Channels, for each of `ids`: `<id>_position` [m] and `<id>_rotation`, axis times angle [rad], of
    the marker's frame (x right and y up in the print, z out of it), and `<id>_seen`, 1 or 0. While a
    marker is not seen its last pose is held, zeros before it was ever seen.
    """

    Config = MarkerSensorConfig
    config: MarkerSensorConfig

    def __init__(self, config: MarkerSensorConfig) -> None:
        self.config = config
        self._camera = CameraSensor(config.lens())
        self._others: list[Viewpoint] = []
        self.reset()

    def links(self, agent: Agent) -> Sequence[str]:
        return self._camera.links(agent)

    def bind(self, world: World, agent: Agent) -> None:
        config = self.config
        if config.frame == "tool":
            if not isinstance(agent, Robot):
                raise ConfigError(f"sensor {config.name!r}: {agent.name!r} has no tool")
            agent.tool_pose()  # raises where no arm moves
        self._agent = agent
        self._camera.bind(world, agent)
        studio = Studio.of(world)
        for number in range(1, config.exposures):
            self._others.append(studio.enter(partial(self._exposure, number), config.rate))

    def _exposure(self, number: int) -> Shot:
        config, first = self.config, self._camera.aim()
        shots = exposures(first.camera, config.look, config.exposures)
        return dataclasses.replace(shots[number], light=first.light)

    def misplace(self, error: Pose, light: Light) -> bool:
        return self._camera.misplace(error, light)

    def channels(self) -> Sequence[Channel]:
        out = []
        for number in self.config.ids:
            out.append(Channel(f"{number}_position", "m", (3,)))
            out.append(Channel(f"{number}_rotation", "rad", (3,)))
            out.append(Channel(f"{number}_seen", "1", (1,), low=0, high=1, is_noisy=False))
        return out

    def reset(self) -> None:
        self._held = {number: np.zeros(6) for number in self.config.ids}
        self._seen: set[int] = set()

    def measure(self) -> Sequence[npt.NDArray[Any]]:
        from .marker_detector import detect  # OpenCV takes a tenth of a second to load

        config = self.config
        image, camera = self.picture()
        origin = self._origin(camera).inverse() @ camera.pose
        self._seen = set()
        for found in detect(image, camera, config.edges(), dictionary=config.dictionary):
            pose = origin @ found.pose
            self._held[found.id] = np.append(pose.position, rotation_vector(pose.quaternion))
            self._seen.add(found.id)
        return self._readings()

    @property
    def view(self) -> Camera:
        """The camera as it stands now; once bound."""
        return self._camera.view

    def picture(self) -> tuple[npt.NDArray[np.uint8], Camera]:
        """Return what is looked at now, shape [height, width, 3], and the camera that sees it so."""
        images = [self._camera.measure()[0], *(view.read()[1]["rgb"] for view in self._others)]
        return developed(images, self._camera.view, self.config.look)

    def disturb(
        self, readings: Sequence[npt.NDArray[Any]], rng: np.random.Generator
    ) -> Sequence[npt.NDArray[Any]]:
        """Return the last readings with noise on what was seen; it stays while that is held."""
        if self.config.noise:
            for number in self.config.ids:
                noise = rng.normal(0.0, self.config.noise, 6)
                if number in self._seen:
                    self._held[number] = self._held[number] + noise
        return self._readings()

    def _readings(self) -> list[npt.NDArray[Any]]:
        out: list[npt.NDArray[Any]] = []
        for number in self.config.ids:
            held = self._held[number]
            out += [held[:3], held[3:], np.array([float(number in self._seen)])]
        return out

    def _origin(self, camera: Camera) -> Pose:
        """Return the frame in which poses are given, in the world."""
        if self.config.frame == "camera":
            return camera.pose
        if self.config.frame == "base":
            return self._agent.body.link_pose(self._camera.base)
        if self.config.frame == "tool":
            assert isinstance(self._agent, Robot)
            return self._agent.tool_pose()
        return Pose()

    def close(self) -> None:
        self._camera.close()
        for view in self._others:
            view.leave()
