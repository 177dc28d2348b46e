"""The moving parts of a person as flat arrays, for the kernels that run every physics step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..body.segment import LEAST_INERTIA, Segment, combined
from ..body.skeleton import DOF_INDEX, DOFS_OF, JOINTS, PARENTS, axis_rotation

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chain:
    """A tree of single-axis joints; fixed joints have melted into the moving part before them.

    Attributes:
        names: The moving DoFs, proximal first.
        parents: Index of the DoF before each one, -1 for the pelvis, shape [n].
        axes: Unit axis in the moving part's frame, shape [n, 3].
        rotations: Frame at zero angle in the parent's frame, shape [n, 3, 3].
        offsets: Its origin in the parent's frame [m], shape [n, 3].
        masses: Mass of each moving part [kg], shape [n].
        centres: Its centre of mass in its own frame [m], shape [n, 3].
        inertias: Its inertia about the centre of mass, in its own frame [kg·m²], shape [n, 3, 3].
        joint_parts: Moving part that carries each SMPL-X joint, -1 for the pelvis, shape [55].
        joint_rotations: Frame of each SMPL-X joint in that part, shape [55, 3, 3].
        joint_offsets: Its origin in that part [m], shape [55, 3].
    """

    names: tuple[str, ...]
    parents: npt.NDArray[np.int64]
    axes: Array
    rotations: Array
    offsets: Array
    masses: Array
    centres: Array
    inertias: Array
    joint_parts: npt.NDArray[np.int64]
    joint_rotations: Array
    joint_offsets: Array

    def mass_matrix(self, angles: Array) -> Array:
        """Return the joint-space mass matrix at `angles` [rad], the pelvis held, shape [n, n]."""
        count = len(self.names)
        rotations, origins = np.empty((count, 3, 3)), np.empty((count, 3))
        matrix = np.zeros((count, count))
        for i, angle in enumerate(angles):
            parent = self.parents[i]
            before = rotations[parent] if parent >= 0 else np.eye(3)
            start = origins[parent] if parent >= 0 else np.zeros(3)
            axis = (self.axes[i, 0], self.axes[i, 1], self.axes[i, 2])
            rotations[i] = before @ self.rotations[i] @ axis_rotation(axis, float(angle))
            origins[i] = start + before @ self.offsets[i]
        axes = np.einsum("iab,ib->ia", rotations, self.axes)
        for i in range(count):
            path = [i]
            while self.parents[path[-1]] >= 0:
                path.append(int(self.parents[path[-1]]))
            centre = origins[i] + rotations[i] @ self.centres[i]
            linear = np.cross(axes[path], centre - origins[path])
            inertia = rotations[i] @ self.inertias[i] @ rotations[i].T
            block = self.masses[i] * linear @ linear.T + axes[path] @ inertia @ axes[path].T
            matrix[np.ix_(path, path)] += block
        return matrix


def make_chain(
    segments: Mapping[str, Segment], joints: Array, posture: Array, movable: Sequence[str]
) -> Chain:
    """Return the moving parts of a person.

    Args:
        segments: The 55 segments by joint.
        joints: Joint centres in the T-pose [m], shape [55, 3].
        posture: Angle of every DoF [rad], shape [112]; those that do not move stay there.
        movable: Names of the moving DoFs.
    """
    names: list[str] = []
    parents: list[int] = []
    axes, rotations, offsets = [], [], []
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
            names.append(dof.name)
            parents.append(part)
            axes.append(dof.axis)
            rotations.append(rotation)
            offsets.append(offset)
            flesh.append([])
            part, rotation, offset = len(names) - 1, np.eye(3), np.zeros(3)
        frames.append((part, rotation, offset))
        if part >= 0:
            segment = segments[joint]
            flesh[part].append(
                (
                    segment.mass,
                    offset + rotation @ segment.centre,
                    rotation @ segment.inertia @ rotation.T,
                )
            )
    count = len(names)
    sliver = (
        0.0,
        np.zeros(3),
        LEAST_INERTIA * np.eye(3),
    )  # links of an axis alone, see body/urdf.py
    bodies = [combined(parts) if parts else sliver for parts in flesh]
    return Chain(
        names=tuple(names),
        parents=np.array(parents, np.int64),
        axes=np.array(axes, np.float64).reshape(count, 3),
        rotations=np.array(rotations, np.float64).reshape(count, 3, 3),
        offsets=np.array(offsets, np.float64).reshape(count, 3),
        masses=np.array([mass for mass, _, _ in bodies]),
        centres=np.array([centre for _, centre, _ in bodies]).reshape(count, 3),
        inertias=np.array([inertia for _, _, inertia in bodies]).reshape(count, 3, 3),
        joint_parts=np.array([part for part, _, _ in frames], np.int64),
        joint_rotations=np.array([rotation for _, rotation, _ in frames]),
        joint_offsets=np.array([offset for _, _, offset in frames]),
    )
