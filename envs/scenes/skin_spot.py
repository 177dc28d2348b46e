"""A spot on somebody's skin, which moves with the segment under it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcare_marl.agents.people.behaviour.subtree import AVERT
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, conjugate, rotate

FAR = 0.3  # [m] from which skin is looked for
NEAR = 1e-4  # [m] from it, where it is found
# [rad] from the top of a limb to its outside, the first where nothing else of the person comes so near [m]
# to the way out: a thumb that is up lies over the top of its hand. Our own choices.
OUTWARD, FREE = tuple(math.radians(a) for a in (0, 20, 40, 60, 80)), 0.015
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

    def room(self, heights: Sequence[float]) -> float:
        """Return how far the way out of it stays from the person's other segments [m], where it is looked at.

        Args:
            heights: Over the skin [m].
        """
        place, out = self.in_world()
        points, gaps = [place + height * out for height in heights], [np.inf]
        for joint, segment in self.person.segments.items():
            if joint != self.joint and segment.shapes:
                seen = [replace(self, joint=joint).seen_from(point) for point in points]
                gaps += [shape.distance(point) for shape in segment.shapes for point in seen]
        return float(min(gaps))


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


def free_side(
    person: Human,
    joint: str,
    end: str,
    shares: Sequence[float],
    about: float,
    heights: Sequence[float],
) -> float:
    """Return how far from the top of a limb nothing else of the person is over it, if anywhere [rad].

    Args:
        person: Whose limb it is; spawned.
        joint: SMPL-X joint that it moves with.
        end: The joint at its far end.
        shares: Of the way there, the least and the most.
        about: How far each way about the limb it has to be free [rad].
        heights: Over the skin, where that is looked at [m].
    """
    outward = 1.0 if joint.startswith("right") else -1.0
    corners = list(itertools.product(shares, (-about, about)))

    def room(up: float) -> float:
        spots = (limb_spot(person, joint, end, share, up + tilt) for share, tilt in corners)
        return min(FREE, *(spot.room(heights) for spot in spots))

    return max((outward * tilt for tilt in OUTWARD), key=room)


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


def averted(person: Human, dofs: Sequence[str]) -> Iterator[bool]:
    """Turn somebody's face to either side, as far as that is possible, and ahead again at the end.

    Args:
        person: Who.
        dofs: Those of `dofs` that turn the face do; if there are none, it stays ahead.

    Yields:
        Whether the face is turned: first it is not.
    """
    yield False
    turns = [dof for dof in dofs if dof.endswith("rotation_left")]
    ahead = {dof: person.angle(dof) for dof in turns}
    able = {dof: person.active[person.movable.index(dof)] for dof in turns}
    for turn in (AVERT, -AVERT) if turns else ():
        person.set_angles({dof: float(np.clip(turn, *able[dof])) for dof in turns})
        yield True
    person.set_angles(ahead)
