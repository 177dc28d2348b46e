"""The joints of a person as a tree: of the parts that move in a scene, and of a whole body in the world."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from rcare_marl.pose import Array, axis_rotation
from rcare_marl.tree.joint_tree import JointTree, Tree

from .segment import LEAST_INERTIA, Segment, combined
from .skeleton import DOF_INDEX, DOFS, DOFS_OF, JOINTS, PARENTS

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


def person_tree(
    segments: Mapping[str, Segment], joints: Array, posture: Array, movable: Sequence[str]
) -> JointTree:
    """Return the moving parts of a person, rooted in the pelvis; its frames are the 55 SMPL-X joints.

    Args:
        segments: The 55 segments by joint.
        joints: Joint centres in the T-pose [m], shape [55, 3].
        posture: Angle of every DoF [rad], shape [112]; those that do not move stay there.
        movable: Names of the moving DoFs.
    """
    moving: list[tuple[str, int, tuple[float, ...], Array, Array]] = []  # DoF, parent, axis, frame
    flesh: list[list[tuple[float, Array, Array]]] = []  # of each part: masses, centres, inertias
    frames: list[
        tuple[int, Array, Array]
    ] = []  # of each SMPL-X joint: part, rotation, offset in it
    for j, joint in enumerate(JOINTS):
        part, rotation, offset = (-1, np.eye(3), np.zeros(3))
        if j:
            part, rotation, before = frames[PARENTS[j]]
            offset = before + rotation @ (joints[j] - joints[PARENTS[j]])
        for dof in DOFS_OF[joint]:
            if dof.name not in movable:
                rotation = rotation @ axis_rotation(dof.axis, float(posture[DOF_INDEX[dof.name]]))
                continue
            moving.append((dof.name, part, dof.axis, rotation, offset))
            flesh.append([])
            part, rotation, offset = len(moving) - 1, np.eye(3), np.zeros(3)
        frames.append((part, rotation, offset))
        if part >= 0:
            segment = segments[joint]
            centre = offset + rotation @ segment.centre
            flesh[part].append((segment.mass, centre, rotation @ segment.inertia @ rotation.T))
    n = len(moving)
    sliver = (
        0.0,
        np.zeros(3),
        LEAST_INERTIA * np.eye(3),
    )  # links of an axis alone, see body/urdf.py
    bodies = [combined(parts) if parts else sliver for parts in flesh]
    names, parents, axes, rotations, offsets = zip(*moving, strict=True) if n else ((),) * 5
    masses, centres, inertias = zip(*bodies, strict=True) if n else ((),) * 3
    frame_parts, frame_rotations, frame_offsets = zip(*frames, strict=True)
    tree = Tree(
        parents=np.array(parents, np.int64),
        slides=np.zeros(n, np.bool_),
        axes=np.array(axes, np.float64).reshape(n, 3),
        rotations=np.array(rotations, np.float64).reshape(n, 3, 3),
        offsets=np.array(offsets, np.float64).reshape(n, 3),
        masses=np.array(masses, np.float64),
        centres=np.array(centres, np.float64).reshape(n, 3),
        inertias=np.array(inertias, np.float64).reshape(n, 3, 3),
        lags=np.zeros(n),
    )
    return JointTree(
        names, tree, np.array(frame_parts), np.array(frame_rotations), np.array(frame_offsets)
    )


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
