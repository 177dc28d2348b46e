"""The skin of a limb that is washed: which of its vertices were wiped, and how wet they are."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.body.skin import PersonSkin
from rcare_marl.agents.people.body.tissue import load_tissue
from rcare_marl.agents.people.human import Human
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, conjugate, matrix_from_quaternion, rotate
from rcare_marl.soft.soft_body import vertex_areas
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.world import World

Floats = npt.NDArray[np.float32]
Colours = npt.NDArray[np.uint8]

# Our own choices.
FROM, TO = 0.25, 0.95  # of the way from joint to joint: what is to be wiped
BARE = 0.04  # of that way, from where a sleeve is pushed up
UPPER = math.radians(60)  # from the top, each way: what is to be wiped of a limb that lies
REACH = 0.012  # [m] along the skin from a point of the sponge: half a cell of its face
LIFT = 0.004  # [m] from skin to sponge, within which it still wets: hair, foam, the film of water
SOAK = 0.2  # [s] of contact, after which skin is wet through
WET_RGB, WET_SHARE = (110, 140, 170), 0.55  # how wet skin is painted


class WipedSkin:
    """What has been wiped of the upper side of a limb that is a rigid capsule between two joints.

    Skin bulges over the rigid shape in places, and falls short of it in others. So points of a sponge
    are compared with it along and around the limb, and wipe where they are as deep as skin or shape.

    Attributes:
        vertices: Vertices of the person's skin that are to be wiped, shape [n].
        is_wiped: Which of them were, shape [n].
        length: From joint to joint [m].
    """

    def __init__(
        self,
        person: Human,
        world: World,
        joint: str,
        end: str,
        *,
        bare: float = BARE,
        like: str | None = None,
    ) -> None:
        """Take the upper side of a limb as a person has it now, and bare the limb.

        Limbs of one person may be washed one beside the other.

        Args:
            person: Who is washed; spawned.
            world: Where.
            joint: SMPL-X joint that the limb moves with.
            end: The joint at its far end.
            bare: From where on it is bared, as a share of the way to the far end.
            like: The joint whose part of the body has the colour of its skin; `end` if None.

        Raises:
            UnknownNameError: If there is no such joint.
            ConfigError: If the limb is not one rigid capsule.
        """
        for name in (joint, end, like or end):
            check_name("joint", name, JOINT_INDEX)
        if person.tissue is not None and joint in person.tissue.bodies:
            raise ConfigError(
                f"a sponge does not feel flesh, and {joint!r} of {person.name!r} has some: "
                "cast a recipient without tissue there"
            )
        shapes = person.segments[joint].shapes
        if len(shapes) != 1 or shapes[0].kind != "capsule":
            raise ConfigError(f"{joint!r} is not one capsule that could be wiped along")
        self._person, self._joint, self._shape = person, joint, shapes[0]
        model, number = person.model, JOINT_INDEX[joint]
        way = model.joints[JOINT_INDEX[end]] - model.joints[number]
        axis = shapes[0].rotation[:, 2] * np.sign(shapes[0].rotation[:, 2] @ way)
        self._axis, self.length = axis, float(way @ axis)
        self._foot = shapes[0].centre - (shapes[0].centre @ axis) * axis
        up = rotate(conjugate(person.joint_pose(joint).quaternion), (0.0, 0.0, 1.0))
        up = up - (up @ axis) * axis
        self._up = up / np.linalg.norm(up)
        self._side = np.cross(axis, self._up)
        self._find_vertices(number, JOINT_INDEX[end])
        self._paint = next(
            s for s in world.skins if isinstance(s, PersonSkin) and s.body is person.body
        )
        self._dry = self._bared(number, JOINT_INDEX[end], JOINT_INDEX[like or end], bare)
        self._wetness = np.zeros(len(model.vertices), np.float32)
        self.follow()
        self.reset()

    def _find_vertices(self, number: int, end: int) -> None:
        """Find the vertices of the limb, and which of them are to be wiped."""
        model = self._person.model
        own = np.flatnonzero(np.isin(model.owner, (number, end)))
        along, angle, depth = self._polar(model.vertices[own] - model.joints[number])
        share = along / self.length
        near = (share > FROM) & (share < TO)
        self._near, self._along, self._angle = own[near], along[near], angle[near]
        # What is washed first is what sticks out most: skin or shape.
        self._depth = np.maximum(depth[near], self._radius_at(self._along))
        self._is_upper = np.abs(self._angle) < UPPER
        self.vertices = self._near[self._is_upper]
        self._areas = vertex_areas(model.vertices.astype(np.float64), model.faces)[self.vertices]

    def _bared(self, number: int, end: int, like: int, bare: float) -> Colours:
        """Return the colours of the person with a bare limb: a sleeve is not washed."""
        model = self._person.model
        skin = np.median(model.colors[model.owner == like], axis=0)
        own = np.flatnonzero(np.isin(model.owner, (number, end)))
        along, _, _ = self._polar(model.vertices[own] - model.joints[number])
        out = self._paint.colors.copy()
        is_own = (model.owner[own] == number) | (along < self.length)
        bared = own[(along > bare * self.length) & is_own]
        out[bared, :3] = skin
        self._shown = np.union1d(bared, self._near)
        return out

    def _polar(self, local: Array | Floats) -> tuple[Array, Array, Array]:
        """Return how far points are along the limb [m], around it [rad] and from its axis [m]."""
        along = local @ self._axis
        out = local - self._foot - along[:, None] * self._axis
        angle = np.arctan2(out @ self._side, out @ self._up)
        return along, angle, np.linalg.norm(out, axis=1)

    def _radius_at(self, along: Array) -> Array:
        """Return how far the surface of the rigid shape is from its axis [m]; zero beyond its ends."""
        middle, (length, radius) = float(self._shape.centre @ self._axis), self._shape.size
        beyond = np.maximum(np.abs(along - middle) - 0.5 * length, 0.0)
        return np.asarray(np.sqrt(np.maximum(radius**2 - beyond**2, 0.0)))

    def follow(self) -> None:
        """Take the limb to be where it is now: `place`, `direction` and `progress` tell of then."""
        pose = self._person.joint_pose(self._joint)
        self._origin, self._turn = np.array(pose.position), matrix_from_quaternion(pose.quaternion)

    def reset(self) -> None:
        """Let all of it be dry and unwiped."""
        self.is_wiped = np.zeros(len(self.vertices), np.bool_)
        self._wetness[:] = 0.0
        colours = self._paint.colors.copy()
        colours[self._shown] = self._dry[self._shown]
        self._paint.colors = colours

    @property
    def wetness(self) -> Floats:
        """How wet each vertex of the whole skin is, 0 dry to 1 wet through, shape [v]."""
        return self._wetness

    @property
    def area(self) -> float:
        """Area to be wiped [m²]."""
        return float(self._areas.sum())

    @property
    def coverage(self) -> float:
        """Share of the area to be wiped that was."""
        return float(self._areas @ self.is_wiped / self._areas.sum())

    def wipe(self, points: Array, duration: float) -> None:
        """Wipe where points of something wet lie on the skin for `duration` [s].

        Args:
            points: Points of its face, which presses, in the world [m], shape [n, 3].
            duration: How long [s].
        """
        if not len(points):
            return
        along, angle, depth = self._polar((points - self._origin) @ self._turn)
        turn = np.abs(self._angle[:, None] - angle)
        around = self._depth[:, None] * np.minimum(turn, 2 * math.pi - turn)
        touches = (self._along[:, None] - along) ** 2 + around**2 < REACH**2
        touched = (touches & (depth < self._depth[:, None] + LIFT)).any(axis=1)
        if not touched.any():
            return
        self.is_wiped |= touched[self._is_upper]
        wet = self._near[touched]
        if (self._wetness[wet] < 1.0).any():
            self._wetness[wet] = np.minimum(self._wetness[wet] + duration / SOAK, 1.0)
            mixed = self._paint.colors.copy()
            share = WET_SHARE * self._wetness[self._near, None]
            dry = self._dry[self._near, :3]
            mixed[self._near, :3] = (1 - share) * dry + share * np.array(WET_RGB)
            self._paint.colors = mixed

    def place(self, share: float, angle: float = 0.0) -> tuple[Array, Array]:
        """Return a point on the skin and the way out of the limb in the world, each of shape [3].

        Args:
            share: Of the way from joint to joint.
            angle: About the limb, from its top to the right of who looks along it [rad].
        """
        along = share * self.length
        gaps = (self._along - along) ** 2 + (self._depth * (self._angle - angle)) ** 2
        near = np.argsort(gaps, kind="stable")[:4]  # the nearest vertices
        out = math.cos(angle) * self._up + math.sin(angle) * self._side
        point = self._foot + along * self._axis + float(self._depth[near].mean()) * out
        return self._turn @ point + self._origin, self._turn @ out

    def direction(self) -> Array:
        """Return the way from joint to joint, a unit vector in the world, shape [3]."""
        return np.asarray(self._turn @ self._axis)

    def progress(self, point: Array) -> float:
        """Return how far along the limb a point in the world [m] is, as a share of its length."""
        return float((point - self._origin) @ self.direction()) / self.length


def pad(person: Human, world: World, joints: Sequence[str]) -> None:
    """Let limbs yield to soft matter as flesh over bone, without simulating the flesh.

    It is an elastic foundation of the stiffness E / ((1 - nu²) h): the flesh of `assets/tissue/flesh.yaml`
    in plane strain, as thick as from its core to the surface of the limb's capsule. Against the simulated
    flesh of a forearm (docs/tissue.md, a sphere of 20 mm, 5 mm deep) it gives three quarters of the force.

    Args:
        person: Whose.
        world: Where.
        joints: SMPL-X joints of limbs that are one capsule.
    """
    tissue = load_tissue()
    modulus, ratio = tissue.material.youngs_modulus_pa, tissue.material.poissons_ratio
    for joint in joints:
        (shape,) = person.segments[joint].shapes
        core = tissue.segments[joint.split("_", 1)[1]].core
        thickness = (1.0 - core) * shape.size[1]
        link = person.frames[JOINT_INDEX[joint]].link
        stiffness = modulus / ((1.0 - ratio**2) * thickness)
        SoftWorld.of(world).set_foundation(person.body, link, stiffness)
