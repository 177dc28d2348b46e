"""The joints of a person as one tree in the world, for whole-body inverse kinematics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np
import numpy.typing as npt

from ..actuation.chain import make_chain
from .segment import Segment
from .skeleton import DOF_INDEX, DOFS, DOFS_OF, JOINTS
from .solver import Tree

Array = npt.NDArray[np.float64]
Base = Literal["fixed", "planar", "free"]

# The pelvis: slides in the world, yaw about the vertical, pitch and roll about its own x and z axes.
BASE_DOFS = ("base_x", "base_y", "base_z", "base_yaw", "base_pitch", "base_roll")
BASE_COLUMNS: dict[Base, tuple[int, ...]] = {
    "fixed": (),
    "planar": (0, 1, 2, 3),
    "free": (0, 1, 2, 3, 4, 5),
}
BASE_REACH = (0.5, 0.5, 0.4, math.pi, 0.6, 0.6)  # [m] and [rad] each way; our own choice
FIRST = len(BASE_DOFS)  # of the anatomical joints in the tree
PELVIS = FIRST - 1


def part_of(joint: str) -> int:
    """Return the joint of the tree whose frame is that of an SMPL-X joint."""
    if joint == JOINTS[0]:
        return PELVIS
    return FIRST + DOF_INDEX[DOFS_OF[joint][-1].name]


def make_tree(joints: Array, segments: Mapping[str, Segment]) -> Tree:
    """Return the tree of a person: the six joints of the pelvis, then the 112 DoFs.

    Args:
        joints: Joint centres in the T-pose [m], shape [55, 3].
        segments: The 55 segments by joint.
    """
    chain = make_chain(segments, joints, np.zeros(len(DOFS)), [dof.name for dof in DOFS])
    n, pelvis = FIRST + len(DOFS), segments[JOINTS[0]]
    parents = np.concatenate((np.arange(-1, PELVIS), chain.parents + FIRST))
    parents[FIRST:][chain.parents < 0] = PELVIS
    axes = np.zeros((n, 3))
    axes[:FIRST] = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1), (1, 0, 0), (0, 0, 1)]
    axes[FIRST:] = chain.axes
    rotations = np.concatenate((np.tile(np.eye(3), (FIRST, 1, 1)), chain.rotations))
    offsets = np.concatenate((np.zeros((FIRST, 3)), chain.offsets))
    masses, centres = np.zeros(n), np.zeros((n, 3))
    masses[FIRST:], centres[FIRST:] = chain.masses, chain.centres
    masses[PELVIS], centres[PELVIS] = pelvis.mass, pelvis.centre
    carries = np.eye(n, dtype=np.bool_)
    for j in range(1, n):  # parents come first
        carries[:, j] |= carries[:, parents[j]]
    slides = np.arange(n) < 3
    return Tree(
        parents.astype(np.int64), slides, axes, rotations, offsets, masses, centres, carries
    )
