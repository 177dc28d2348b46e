"""A spot on somebody's skin, which moves with the segment under it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, conjugate, rotate

FAR = 0.3  # [m] from which skin is looked for
NEAR = 1e-4  # [m] from it, where it is found
FACING = 0.5  # how far the way out of a cheek looks ahead, for one to the side; our own choice


@dataclass(frozen=True, eq=False)
class SkinSpot:
    """A place on a segment and the way out of it, in the frame of its joint.

    Attributes:
        person: Whose skin it is.
        joint: SMPL-X joint that the segment moves with.
        place: The place [m], shape [3].
        out: Out of the skin, a unit vector, shape [3].
    """

    person: Human
    joint: str
    place: Array
    out: Array

    def in_world(self) -> tuple[Array, Array]:
        """Return the place [m] and the way out of it in the world, each of shape [3]."""
        pose = self.person.joint_pose(self.joint)
        turn = pose.quaternion
        return rotate(turn, self.place) + pose.position, rotate(turn, self.out)

    def seen_from(self, point: Array) -> Array:
        """Return a point of the world in the frame of the joint [m], shape [3]."""
        pose = self.person.joint_pose(self.joint)
        return rotate(conjugate(pose.quaternion), np.subtract(point, pose.position))


def spot_on(person: Human, joint: str, inner: Array, out: Array) -> SkinSpot:
    """Return where the surface of a segment is met on the way in to a point of it.

    Args:
        person: Whose segment it is.
        joint: Its SMPL-X joint.
        inner: The point inside, in the frame of the joint [m], shape [3].
        out: The way out of it there, shape [3].

    Raises:
        ConfigError: If the point is beside the segment.
    """
    out = out / np.linalg.norm(out)
    point, shapes = inner + FAR * out, person.segments[joint].shapes
    for _ in range(100):
        gap = min(shape.distance(point) for shape in shapes)
        if gap < NEAR:
            return SkinSpot(person, joint, point, out)
        point = point - gap * out
    raise ConfigError(
        f"{joint!r} of {person.name!r} has no surface on the way in to {inner.round(3)}"
    )


def limb_spot(person: Human, joint: str, end: str, share: float, tilt: float) -> SkinSpot:
    """Return a spot on the side of a limb that is up now.

    Args:
        person: Whose limb it is; spawned.
        joint: SMPL-X joint that it moves with.
        end: The joint at its far end.
        share: Of the way there.
        tilt: About the limb, from the top [rad].
    """
    joints = person.model.joints
    way = joints[JOINT_INDEX[end]] - joints[JOINT_INDEX[joint]]
    axis = way / np.linalg.norm(way)
    up = rotate(conjugate(person.joint_pose(joint).quaternion), (0.0, 0.0, 1.0))
    up = up - (up @ axis) * axis
    up = up / np.linalg.norm(up)
    out = np.cos(tilt) * up + np.sin(tilt) * np.cross(axis, up)
    return spot_on(person, joint, share * way, out)


def cheek_spot(person: Human, side: str, shift: Array) -> SkinSpot:
    """Return a spot on a cheek, over the jaw: higher up the rigid shape of a face has no side.

    Args:
        person: Whose cheek it is.
        side: `left` or `right`.
        shift: Of the spot up and ahead [m], shape [2].
    """
    aside = 1.0 if side == "left" else -1.0
    inner = person.segments["jaw"].shapes[0].centre + (0.0, *shift)
    return spot_on(person, "jaw", inner, np.array((aside, 0.0, FACING)))
