"""The joints of a person as a tree: of the parts that move in a scene, and of a whole body in the world."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.pose import Array, axis_rotation
from rcare_marl.tree.joint_tree import JointTree, Tree

from .segment import LEAST_INERTIA, Segment, combined
from .skeleton import DOF_INDEX, DOFS, DOFS_OF, JOINTS, PARENTS, PRONATIONS, Dof

Place = tuple[int, Array, Array]
Mass = tuple[float, Array, Array]
Base = Literal["fixed", "planar", "free"]

# The pelvis: slides in the world, yaw about the vertical, pitch and roll about its own x and z axes.
BASE_DOFS = ("base_x", "base_y", "base_z", "base_yaw", "base_pitch", "base_roll")
_BASE_AXES = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1), (1, 0, 0), (0, 0, 1))
BASE_COLUMNS: dict[Base, tuple[int, ...]] = {
    "fixed": (),
    "planar": (0, 1, 2, 3),
    "free": (0, 1, 2, 3, 4, 5),
}
BASE_REACH = (0.5, 0.5, 0.4, math.pi, 0.6, 0.6)  # [m] and [rad] each way; our own choice
FIRST = len(BASE_DOFS)  # of the anatomical joints in the tree
PELVIS = FIRST - 1


def part_of(joint: str) -> int:
    """Return the joint of the walking tree whose frame is that of an SMPL-X joint."""
    if joint == JOINTS[0]:
        return PELVIS
    return FIRST + DOF_INDEX[DOFS_OF[joint][-1].name]


@dataclass(frozen=True, eq=False)
class Melted:
    """The n moving parts of a person; what does not move has melted into what it hangs on.

    Attributes:
        dofs: The DoF that moves each part, proximal first.
        places: Of each part: the part before it (-1 is the pelvis), rotation and offset [m] in it.
        flesh: Mass [kg], centre [m] and inertia about it [kg·m²] of what each part is made of, the
            pelvis before all; empty for the first axes of a joint.
        frames: Of each SMPL-X joint: its part, rotation and offset [m] in it.
        ulnae: The same of both ulnae: the elbows before they pronate.
    """

    dofs: list[Dof]
    places: list[Place]
    flesh: list[list[Mass]]
    frames: list[Place]
    ulnae: list[Place]


def melted(
    segments: Mapping[str, Segment], joints: Array, posture: Array, movable: Container[str]
) -> Melted:
    """Return the moving parts of a person; arguments as for `person_tree`."""
    out = Melted([], [], [[]], [], [])
    for j, joint in enumerate(JOINTS):
        part, rotation, offset = (-1, np.eye(3), np.zeros(3))
        if j:
            part, rotation, before = out.frames[PARENTS[j]]
            offset = before + rotation @ (joints[j] - joints[PARENTS[j]])
        for dof in DOFS_OF[joint]:
            if dof.name in PRONATIONS:
                out.ulnae.append((part, rotation, offset))
            if dof.name not in movable:
                rotation = rotation @ axis_rotation(dof.axis, float(posture[DOF_INDEX[dof.name]]))
                continue
            out.places.append((part, rotation, offset))
            out.dofs.append(dof)
            out.flesh.append([])
            part, rotation, offset = len(out.dofs) - 1, np.eye(3), np.zeros(3)
        out.frames.append((part, rotation, offset))
        own = segments[joint]
        centre = offset + rotation @ own.centre
        out.flesh[part + 1].append((own.mass, centre, rotation @ own.inertia @ rotation.T))
    return out


def person_tree(
    segments: Mapping[str, Segment], joints: Array, posture: Array, movable: Sequence[str]
) -> JointTree:
    """Return the moving parts of a person, rooted in the pelvis.

    Its frames are `CARRIERS` less the scapulae, which no part carries.

    Args:
        segments: The 55 segments by joint.
        joints: Joint centres in the T-pose [m], shape [55, 3].
        posture: Angle of every DoF [rad], shape [112]; those that do not move stay there.
        movable: Names of the moving DoFs.
    """
    body = melted(segments, joints, posture, movable)
    n = len(body.dofs)
    sliver = (0.0, np.zeros(3), LEAST_INERTIA * np.eye(3))  # an axis alone, see body/urdf.py
    bodies = [combined(parts) if parts else sliver for parts in body.flesh[1:]]
    parents, rotations, offsets = zip(*body.places, strict=True) if n else ((),) * 3
    masses, centres, inertias = zip(*bodies, strict=True) if n else ((),) * 3
    tree = Tree(
        parents=np.array(parents, np.int64),
        slides=np.zeros(n, np.bool_),
        axes=np.array([dof.axis for dof in body.dofs], np.float64).reshape(n, 3),
        rotations=np.array(rotations, np.float64).reshape(n, 3, 3),
        offsets=np.array(offsets, np.float64).reshape(n, 3),
        masses=np.array(masses, np.float64),
        centres=np.array(centres, np.float64).reshape(n, 3),
        inertias=np.array(inertias, np.float64).reshape(n, 3, 3),
        lags=np.zeros(n),
    )
    frames = map(np.array, zip(*body.frames, *body.ulnae, strict=True))
    return JointTree(tuple(dof.name for dof in body.dofs), tree, *frames)


def walking_tree(joints: Array, segments: Mapping[str, Segment]) -> Tree:
    """Return a whole body in the world: the six joints of the pelvis, then the 112 DoFs.

    Args:
        joints: Joint centres in the T-pose [m], shape [55, 3].
        segments: The 55 segments by joint.
    """
    names = [dof.name for dof in DOFS]
    body, pelvis = (
        person_tree(segments, joints, np.zeros(len(DOFS)), names).arrays,
        segments[JOINTS[0]],
    )
    before = Tree(
        parents=np.arange(-1, PELVIS),
        slides=np.arange(FIRST) < 3,
        axes=np.array(_BASE_AXES, np.float64),
        rotations=np.tile(np.eye(3), (FIRST, 1, 1)),
        offsets=np.zeros((FIRST, 3)),
        masses=np.zeros(FIRST),
        centres=np.zeros((FIRST, 3)),
        inertias=np.zeros((FIRST, 3, 3)),
        lags=np.zeros(FIRST),
    )
    before.masses[PELVIS], before.centres[PELVIS] = pelvis.mass, pelvis.centre
    before.inertias[PELVIS] = pelvis.inertia
    carried = body._replace(parents=body.parents + FIRST)
    carried.parents[body.parents < 0] = PELVIS
    return Tree(*(np.concatenate(pair) for pair in zip(before, carried, strict=True)))
