"""ArUco markers as things in the scene: thin printed plates on people, robots, devices and walls.

A marker is drawn and nothing else: it touches nothing, and where it is follows from the link that
carries it each time somebody asks. So it can neither lag behind, nor be left behind by a `rewind`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, WorldError, check_name
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.world import World

from ..agent import Agent
from ..people.human import Human
from .marker_print import DICTIONARIES, THICKNESS, dictionary_size, plate_edge, plate_urdf
from .skin_spot import lie_on_skin

WORLD = "world"
SMALLEST, LARGEST = 0.005, 1.0  # [m]


@dataclass(frozen=True)
class MarkerConfig:
    """A marker and where it is.

    The marker's frame has its origin in the middle of the print, x to the right in the print, y up
    and z out of it towards the viewer.

    Attributes:
        id: Number of the marker in its dictionary.
        on: Link of a robot or a device, SMPL-X joint of a person's segment (`left_shoulder` is the
            upper arm), or `world`.
        size: Edge of the black square [m]; the plate has a white margin of one cell more.
        dictionary: One of `DICTIONARIES`, OpenCV's names without `DICT_` and in small letters.
        at: Middle of the print in the frame of the link, or in the world [m]. On a person: a point
            in the frame of the joint (axes of the T-pose: x left, y up, z forward) that says on
            which side; the marker lies on the skin there, y along the bone to the joint. None is
            the outer side of a person's limb, the front of the trunk, or the origin of a link.
        rpy_deg: Turn of the marker there, roll, pitch, yaw [degrees]; on a person, of the marker
            that lies on the skin.
    """

    id: int
    on: str
    size: float = 0.05
    dictionary: str = "4x4_50"
    at: tuple[float, float, float] | None = None
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not SMALLEST <= self.size <= LARGEST:
            raise ConfigError(
                f"marker {self.id}: size must lie in [{SMALLEST}, {LARGEST}] m, got {self.size}"
            )
        if not all(map(math.isfinite, (*self.rpy_deg, *(self.at or ())))):
            raise ConfigError(f"marker {self.id}: at and rpy_deg must be finite")
        check_name("dictionary of markers", self.dictionary, DICTIONARIES)
        count = dictionary_size(self.dictionary)
        if not 0 <= self.id < count:
            raise ConfigError(
                f"dictionary {self.dictionary!r} has markers 0 to {count - 1}, got {self.id}"
            )


class Plate(Body):
    """The body of a marker: Bullet holds its shapes, the carrier decides where they are.

    Attributes:
        carrier: The body that carries it; None in the world.
        link: Index of the link that carries it.
        offset: Pose of the marker in the frame of that link, or in the world.
    """

    def __init__(
        self, world: World, body: Body, carrier: Body | None, link: int, offset: Pose
    ) -> None:
        """Stand in for `body`, which was loaded for this."""
        super().__init__(world, body.uid, body.name)
        self.carrier, self.link, self.offset = carrier, link, offset

    def base_pose(self) -> Pose:
        if self.carrier is None:
            return self.offset
        return self.carrier.link_pose(self.link) @ self.offset

    def centre_pose(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        pose = self.base_pose()
        return pose.position, pose.quaternion

    def link_pose(self, index: int) -> Pose:
        return self.base_pose()

    def link_poses(self) -> tuple[Array, Array]:
        pose, count = self.base_pose(), self.link_count + 1
        return np.tile(pose.position, (count, 1)), np.tile(pose.quaternion, (count, 1))

    def set_base(self, pose: Pose) -> None:
        """Raise WorldError: a marker is where its carrier is."""
        raise WorldError(f"{self.name!r} is fastened: move what carries it")


@dataclass(frozen=True, eq=False)
class Marker:
    """A marker in a world.

    Attributes:
        config: What it is.
        body: Its plate, which the renderers draw.
    """

    config: MarkerConfig
    body: Plate

    def pose(self) -> Pose:
        """Return the true pose of the marker's frame in the world, at this moment."""
        return self.body.base_pose()

    def corners(self) -> Array:
        """Return the corners of the black square in the world [m], shape [4, 3].

        In OpenCV's order: clockwise from the upper left, as one looks at the print.
        """
        turn, half = self.pose().matrix(), self.config.size / 2
        signs = np.array(((-1, 1), (1, 1), (1, -1), (-1, -1)))
        return half * signs @ turn[:3, :2].T + turn[:3, 3]


def fasten(world: World, to: Agent | Body | None, config: MarkerConfig) -> Marker:
    """Put a marker into the world and fasten it to a link, or in the world.

    Call it when everybody is spawned, so that bodies are numbered alike with markers and without, and
    before `world.mark_start()`. A robot's link must be one of its own then, not melted into its
    carrier.

    Args:
        world: Where to.
        to: Whose link `config.on` names; None, or `on="world"`, fixes the marker in the world.
        config: What and where.

    Raises:
        UnknownNameError: If there is no such link, or no such segment of a person.
        ConfigError: If the segment has no skin at that place, or a link is named and nothing has links.
    """
    turn = tuple(quaternion_from_rpy(*map(math.radians, config.rpy_deg)).tolist())
    carrier, link = None, -1
    if to is None or config.on == WORLD:
        if config.on != WORLD:
            raise ConfigError(f"marker {config.id}: {config.on!r} is a link, but of whom?")
        offset = Pose(config.at or (0.0, 0.0, 0.0), turn)
    elif isinstance(to, Human):
        carrier = to.body
        edge = plate_edge(config.dictionary, config.size)
        try:
            link, spot = lie_on_skin(world, to, config.on, config.at, edge)
        except ConfigError as error:
            raise ConfigError(f"marker {config.id} on {to.name!r}: {error}") from error
        offset = carrier.link_pose(link).inverse() @ spot @ Pose((0.0, 0.0, THICKNESS), turn)
    else:
        carrier = to.body if isinstance(to, Agent) else to
        link = carrier.link_index(config.on)
        offset = Pose(config.at or (0.0, 0.0, 0.0), turn)
    here = offset if carrier is None else carrier.link_pose(link) @ offset
    loaded = world.load_urdf(
        plate_urdf(config.dictionary, config.id, config.size), here, name=f"marker_{config.id}"
    )
    plate = Plate(world, loaded, carrier, link, offset)
    world.bodies[world.bodies.index(loaded)] = plate
    return Marker(config, plate)
