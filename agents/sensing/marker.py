"""ArUco markers as things in the scene: thin printed plates on people, robots, devices and walls.

A marker is drawn and nothing else: it touches nothing, and where it is follows from the link that
carries it each time somebody asks. So it can neither lag behind, nor be left behind by a `rewind`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, WorldError, check_name
from rcare_marl.pose import Array, Pose, quaternion_from_matrix, quaternion_from_rpy
from rcare_marl.world import World

from ..agent import Agent
from ..people.body.skeleton import JOINT_INDEX, JOINTS, PARENTS, SIDES
from ..people.body.skin import PersonSkin
from ..people.human import Human
from .marker_print import DICTIONARIES, THICKNESS, dictionary_size, plate_edge, plate_urdf

WORLD = "world"
SMALLEST, LARGEST = 0.005, 1.0  # [m]
# Share of the bone where a spot is that nobody chose; our own choice.
_ALONG = {"shoulder": 0.35, "elbow": 0.25}
_ELSEWHERE = 0.5
_ARM = ("collar", "shoulder", "elbow", "wrist")
_NEAR = 0.03  # [m]; skin farther above or below a plate is not what it lies on
_GAP = 0.0005  # [m] between the skin and what lies on it, so that neither is drawn into the other

Ints = npt.NDArray[np.int64]


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
        super().__init__(world, body.uid, body.name, body.source)
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


def lie_on_skin(
    world: World,
    person: Human,
    joint: str,
    at: tuple[float, float, float] | None,
    edge: float,
) -> tuple[int, Pose]:
    """Return the link that carries a spot on the skin, and the pose of a plate's back there.

    A ray from the bone through `at` finds the outermost skin. The plate lies on it as a stiff one
    would, touching the highest point below it. Its z points out of the skin, its y along the bone
    towards the joint.

    Args:
        world: Where the person is.
        person: A spawned person, as they sit or lie now.
        joint: SMPL-X joint of the segment.
        at: A point in the frame of the joint [m], or None for the outer side of a limb or the
            front of the trunk and the head.
        edge: Edge of the plate [m].

    Raises:
        UnknownNameError: If there is no such joint.
        ConfigError: If `at` lies on the bone, or no skin is there.
    """
    check_name("segment of a person", joint, JOINTS)
    index = JOINT_INDEX[joint]
    skin = next(s for s in world.skins if s.body is person.body and isinstance(s, PersonSkin))
    rotations, positions = skin.joint_transforms()
    surface = person.model.posed(rotations, positions).astype(np.float64)
    bone = _bone(index, positions)
    start, ray = _ray(joint, at, positions[index], rotations[index], bone)
    faces = _faces_of(person, index)
    hit = _outermost(surface[faces], start, ray)
    if hit is None:
        where = "where markers go by themselves" if at is None else f"on the ray through {at}"
        raise ConfigError(
            f"segment {joint!r} has no skin of its own {where}: say another `at`, or choose a "
            "segment next to it"
        )
    turn = _turned(surface[faces], hit, ray, bone, edge)
    local = (surface[np.unique(faces)] - hit) @ turn
    under = (np.abs(local[:, :2]) < edge / 2).all(axis=1) & (np.abs(local[:, 2]) < _NEAR)
    height = float(local[under, 2].max(initial=0.0)) + _GAP
    place = hit + height * turn[:, 2]
    pose = Pose(tuple(place.tolist()), tuple(quaternion_from_matrix(turn).tolist()))
    return person.frames[index].link, pose


def _bone(index: int, positions: Array) -> Array:
    """Return the way from a joint to the end of its segment [m], shape [3]."""
    children = [child for child, parent in enumerate(PARENTS) if parent == index]
    if not children:  # a finger tip, an eye: on as before
        return positions[index] - positions[PARENTS[index]]
    return positions[children].mean(axis=0) - positions[index]


def _ray(
    joint: str,
    at: tuple[float, float, float] | None,
    origin: Array,
    rotation: Array,
    bone: Array,
) -> tuple[Array, Array]:
    """Return a point on the bone [m] and the direction in which to look for skin, in the world."""
    along = bone / np.linalg.norm(bone)
    if at is None:
        side, _, rest = joint.partition("_")
        share = _ALONG.get(rest, _ELSEWHERE)
        if side not in SIDES:
            out = rotation[:, 2]
        elif rest in _ARM:  # what is above in the T-pose is outside of a hanging arm
            out = rotation[:, 1]
        else:
            out = rotation[:, 0] * (1.0 if side == "left" else -1.0)
        start = origin + share * bone
    else:
        point = rotation @ np.asarray(at)
        start = origin + (point @ along) * along
        out = origin + point - start
    out = out - (out @ along) * along
    if np.linalg.norm(out) < 1e-4:
        raise ConfigError(f"a spot on the skin of {joint!r} cannot lie on its bone, as {at} does")
    return start, out / np.linalg.norm(out)


def _faces_of(person: Human, index: int) -> Ints:
    """Return the faces of the skin of a segment and its neighbours, shape [m, 3]."""
    near = {index, PARENTS[index], *(c for c, parent in enumerate(PARENTS) if parent == index)}
    faces = person.model.faces.astype(np.int64)
    return faces[np.isin(person.model.owner[faces], list(near)).all(axis=1)]


def _outermost(corners: Array, start: Array, ray: Array) -> Array | None:
    """Return where a ray last meets triangles of `corners` [m], shape [m, 3, 3].

    By Möller and Trumbore (1997).
    """
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(ray, second)
    volume = np.einsum("ij,ij->i", first, across)
    volume[np.abs(volume) < 1e-15] = np.inf  # seen from the edge
    away = start - corners[:, 0]
    u = np.einsum("ij,ij->i", away, across) / volume
    over = np.cross(away, first)
    v = over @ ray / volume
    distance = np.einsum("ij,ij->i", second, over) / volume
    hits = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    if not hits.any():
        return None
    return start + distance[hits].max() * ray


def _turned(corners: Array, hit: Array, ray: Array, bone: Array, edge: float) -> Array:
    """Return the axes of a plate on the skin at `hit` as columns, shape [3, 3]."""
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    close = np.linalg.norm(corners.mean(axis=1) - hit, axis=1) < edge / 2
    outside = areas @ ray > 0
    normal = areas[close & outside].sum(axis=0)
    if not normal.any():  # a plate smaller than the triangles of the skin
        normal = ray
    z = normal / np.linalg.norm(normal)
    y = -bone + (bone @ z) * z
    y /= np.linalg.norm(y)
    return np.column_stack((np.cross(y, z), y, z))
