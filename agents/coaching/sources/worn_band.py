"""Bands on a simulated person: cards that are drawn and that nothing touches."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from rcare_marl.pose import Array, rpy_from_matrix
from rcare_marl.world import World

from ...people.body.skeleton import JOINT_INDEX
from ...people.human import Human
from ...sensing.marker import Marker, MarkerConfig, fasten
from ..upper_body import SIDES
from .joints_source import TO_BODY
from .marker_band import DICTIONARY, Band

# Joint whose frame a segment moves with, and the joint at the end of its bone.
_CARRIER = {"trunk": "spine3", "head": "head", "upper_arm": "shoulder", "forearm": "elbow"}
_END = {"upper_arm": "elbow", "forearm": "wrist"}


def wear(
    world: World,
    person: Human,
    bands: Sequence[Band],
    *,
    rng: np.random.Generator | None = None,
    slip: float = 0.0,
    twist_deg: float = 0.0,
) -> list[Marker]:
    """Put bands on a person who is in the world, and return their markers.

    Args:
        world: Where the person is.
        person: A spawned person.
        bands: What they put on.
        rng: For how carelessly they do; needed for the other two.
        slip: Standard deviation of where a band sits, along each axis [m].
        twist_deg: That of how it is turned about each axis [deg].
    """
    out = []
    for band in bands:
        link, place = segment_on_link(person, band.segment)
        worn = np.eye(4)
        worn[:3, 3] = band.place_on(person.avatar.height_m)
        if rng is not None:
            worn[:3, 3] += slip * rng.standard_normal(3)
            turn = math.radians(twist_deg) * rng.standard_normal(3)
            worn[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
        for face in band.faces:
            offset = place @ worn @ face.place
            rpy = tuple(math.degrees(angle) for angle in rpy_from_matrix(offset[:3, :3]))
            config = MarkerConfig(
                face.id,
                person.body.link_names[link],
                face.size,
                DICTIONARY,
                (offset[0, 3], offset[1, 3], offset[2, 3]),
                (rpy[0], rpy[1], rpy[2]),
            )
            out.append(fasten(world, person.body, config))
    return out


def segment_on_link(person: Human, segment: str) -> tuple[int, Array]:
    """Return the link that carries a segment of `marker_band`, and the segment's frame there, [4, 4]."""
    joints = person.model.joints
    on_joint = np.eye(4)
    if segment in ("trunk", "head"):
        carrier = _CARRIER[segment]
        on_joint[:3, :3] = TO_BODY.T  # axes of the upper body in those of the T-pose
        if segment == "trunk":
            shoulders = [joints[JOINT_INDEX[f"{side}_shoulder"]] for side in SIDES]
            on_joint[:3, 3] = np.mean(shoulders, axis=0) - joints[JOINT_INDEX[carrier]]
    else:
        side, _, part = segment.partition("_")
        carrier = f"{side}_{_CARRIER[part]}"
        bone = joints[JOINT_INDEX[f"{side}_{_END[part]}"]] - joints[JOINT_INDEX[carrier]]
        z = -bone / np.linalg.norm(bone)
        forward = np.array((0.0, 0.0, 1.0))  # of the hanging arm, which the T-pose holds out
        x = forward - forward @ z * z
        x /= np.linalg.norm(x)
        on_joint[:3, :3] = np.column_stack((x, np.cross(z, x), z))
    frame = person.frames[JOINT_INDEX[carrier]]
    on_link = np.eye(4)
    on_link[:3, :3], on_link[:3, 3] = frame.rotation, frame.offset
    return frame.link, np.asarray(on_link @ on_joint)
