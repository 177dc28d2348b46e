"""The skin of a limb that is washed: which of its vertices were wiped, and how wet they are."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.body.skeleton import JOINT_INDEX
from rcare_marl.agents.body.skin import PersonSkin
from rcare_marl.agents.human import Human
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Array, conjugate, matrix_from_quaternion, rotate
from rcare_marl.world import World

Floats = npt.NDArray[np.float32]

# Our own choices.
FROM, TO = 0.2, 0.95  # of the way from joint to joint: what counts as the limb's skin
UPPER = math.radians(60)  # from the top, each way: what is washed of a limb that lies
REACH = 0.012  # [m] from a point of contact, within which skin is wiped: half a cell of a sponge
SOAK = 0.2  # [s] of contact, after which skin is wet through
WET_RGB, WET_SHARE = (96, 150, 190), 0.6  # how wet skin is painted


class WipedSkin:
    """What has been wiped of the upper side of a limb that is a capsule between two joints.

    Skin bulges over the rigid shape that stands for the limb. So vertices are compared with points of
    contact on that shape: each at the foot of its normal.

    Attributes:
        vertices: Vertices of the person's skin that are to be wiped, shape [n].
        is_wiped: Which of them were, shape [n].
        wetness: Of each vertex of the whole skin, 0 dry to 1 wet through, shape [v].
        length: From joint to joint [m].
        radius: Of the rigid shape [m].
    """

    def __init__(self, person: Human, world: World, joint: str, end: str) -> None:
        """Take the upper side of a limb as a person has it now.

        Args:
            person: Who is washed; spawned.
            world: Where.
            joint: SMPL-X joint that the limb moves with.
            end: The joint at its far end.

        Raises:
            UnknownNameError: If there is no such joint.
            ConfigError: If the limb is not one rigid capsule.
        """
        for name in (joint, end):
            if name not in JOINT_INDEX:
                raise UnknownNameError("joint", name, JOINT_INDEX)
        if person.tissue is not None and joint in person.tissue.bodies:
            raise ConfigError(
                f"a sponge does not feel flesh, and {joint!r} of {person.name!r} has some: "
                "cast a recipient without tissue there"
            )
        shapes = person.segments[joint].shapes
        if len(shapes) != 1 or shapes[0].kind != "capsule":
            raise ConfigError(f"{joint!r} is not one capsule that could be wiped along")
        self._person, self._joint = person, joint
        self._paint = next(
            s for s in world.skins if isinstance(s, PersonSkin) and s.body is person.body
        )
        self._dry = self._paint.colors
        model, number = person.model, JOINT_INDEX[joint]
        way = model.joints[JOINT_INDEX[end]] - model.joints[number]
        axis = shapes[0].rotation[:, 2] * np.sign(shapes[0].rotation[:, 2] @ way)
        self._axis, self.length, self.radius = axis, float(way @ axis), shapes[0].size[1]
        self._foot = shapes[0].centre - (shapes[0].centre @ axis) * axis
        half, middle = 0.5 * shapes[0].size[0], float(shapes[0].centre @ axis)
        self._straight = (middle - half, middle + half)
        up = rotate(conjugate(person.joint_pose(joint).quaternion), (0.0, 0.0, 1.0))
        self._up = _unit(up - (up @ axis) * axis)
        self._side = np.cross(axis, self._up)
        self._choose(model.vertices[model.owner == number] - model.joints[number])
        own = np.flatnonzero(model.owner == number)
        self._near, self.vertices = own[self._is_near], own[self._is_near][self._is_upper]
        self._wetness = np.zeros(len(model.vertices), np.float32)
        self.reset()

    def _choose(self, local: Floats) -> None:
        """Find which vertices lie between the ends, which of them above, and where they are held."""
        along = local @ self._axis
        share = along / self.length
        self._is_near = (share > FROM) & (share < TO)
        kept, along = local[self._is_near], along[self._is_near]
        out = kept - self._foot - along[:, None] * self._axis
        angles = np.arctan2(out @ self._side, out @ self._up)
        self._is_upper = np.abs(angles) < UPPER
        self._spots = np.array(
            [self._spot(s, a)[0] for s, a in zip(along.tolist(), angles.tolist(), strict=True)]
        )

    def _spot(self, along: float, angle: float) -> tuple[Array, Array]:
        """Return a point on the rigid shape and the way out, in the frame of the joint."""
        low, high = self._straight
        beyond = max(low - along, along - high, 0.0)
        radius = math.sqrt(max(self.radius**2 - beyond**2, 0.0))
        out = math.cos(angle) * self._up + math.sin(angle) * self._side
        return self._foot + along * self._axis + radius * out, out

    def reset(self) -> None:
        """Let all of it be dry and unwiped."""
        self.is_wiped = np.zeros(len(self.vertices), np.bool_)
        self._wetness[:] = 0.0
        self._paint.colors = self._dry

    @property
    def wetness(self) -> Floats:
        """How wet each vertex of the whole skin is, 0 to 1, shape [v]."""
        return self._wetness

    @property
    def coverage(self) -> float:
        """Share of the vertices to be wiped that were."""
        return float(self.is_wiped.mean())

    def wipe(self, points: Array, duration: float) -> None:
        """Wipe where something wet touches for `duration` [s].

        Args:
            points: Points of contact in the world [m], shape [n, 3].
            duration: How long [s].
        """
        if not len(points):
            return
        pose = self._person.joint_pose(self._joint)
        local = (points - pose.position) @ matrix_from_quaternion(pose.quaternion)
        gaps = np.linalg.norm(self._spots[:, None] - local[None], axis=2).min(axis=1)
        touched = gaps < REACH
        if not touched.any():
            return
        self.is_wiped |= touched[self._is_upper]
        wet = self._near[touched]
        if (self._wetness[wet] < 1.0).any():
            self._wetness[wet] = np.minimum(self._wetness[wet] + duration / SOAK, 1.0)
            share = WET_SHARE * self._wetness[:, None]
            mixed = (1.0 - share) * self._dry + share * np.array(WET_RGB)
            self._paint.colors = mixed.astype(np.uint8)

    def place(self, share: float, angle: float = 0.0) -> tuple[Array, Array]:
        """Return a point on the limb and the way out of it in the world, each of shape [3].

        Args:
            share: Of the way from joint to joint.
            angle: About the limb, from its top to the side that is left of the way to its end [rad].
        """
        point, out = self._spot(share * self.length, angle)
        pose = self._person.joint_pose(self._joint)
        return rotate(pose.quaternion, point) + pose.position, rotate(pose.quaternion, out)

    def direction(self) -> Array:
        """Return the way from joint to joint, a unit vector in the world, shape [3]."""
        return rotate(self._person.joint_pose(self._joint).quaternion, self._axis)

    def progress(self, point: Array) -> float:
        """Return how far along the limb a point in the world [m] is, as a share of its length."""
        pose = self._person.joint_pose(self._joint)
        local = rotate(conjugate(pose.quaternion), point - np.array(pose.position))
        return float(local @ self._axis) / self.length


def _unit(vector: Array) -> Array:
    return vector / float(np.linalg.norm(vector))


__all__ = ["FROM", "TO", "WipedSkin"]
