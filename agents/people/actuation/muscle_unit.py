"""One muscle-tendon unit: its architecture and the path that it takes over the skeleton.

A path is a polyline through points that move with the SMPL-X joints. A wrapping surface would cost
a search in every step; instead a point can be a pulley of constant radius at a joint's centre, which
keeps its distance from the joint however far the joint turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.pose import Array

from ..body.skeleton import JOINT_INDEX

Side = Literal["left", "right", "axial"]


@dataclass(frozen=True)
class PathPoint:
    """A point of a muscle's path.

    Attributes:
        joint: SMPL-X joint whose segment carries the point.
        parent: None, or for a pulley the joint of the segment before `joint`: the point then stands
            at the distance |offset| from the centre of `joint`, in the direction halfway between
            the offsets as the two segments carry them.
        reference: Joint from which the offset is measured in the T-pose; `joint` for a pulley.
        offset: From the reference joint [m], in T-pose axes (x left, y up, z forward).
    """

    joint: str
    parent: str | None
    reference: str
    offset: tuple[float, float, float]


@dataclass(frozen=True)
class MuscleUnit:
    """A muscle, or the part of one that acts as one.

    Attributes:
        name: Unique name; a pair ends in `_l` and `_r`.
        side: Side whose clinical profile grades it; `axial` for trunk, neck and jaw.
        region: Part of the body, such as `leg`.
        clinical_group: Muscle group under which manual muscle testing grades it
            (`assets/clinical/motions.yaml`).
        max_isometric_force: Greatest isometric force of the fibres [N].
        optimal_fiber_length: Fibre length of that force [m].
        tendon_slack_length: Length of the unloaded tendon [m].
        pennation: Angle between fibres and tendon at the optimal fibre length [rad].
        passive_strain: Fibre strain at which the passive force reaches the greatest isometric one.
        path: At least two points, from origin to insertion.
        source: Where architecture and geometry come from, and what was checked.
        action_group: Units that a person uses together, with the side: the smaller action space.
            If empty, the clinical group with its side.
    """

    name: str
    side: Side
    region: str
    clinical_group: str
    max_isometric_force: float
    optimal_fiber_length: float
    tendon_slack_length: float
    pennation: float
    passive_strain: float
    path: tuple[PathPoint, ...]
    source: str
    action_group: str = ""


def t_pose_position(point: PathPoint, joints: Array) -> Array:
    """Return where a point is in the T-pose [m], shape [3], for joint centres [55, 3]."""
    return np.asarray(joints[JOINT_INDEX[point.reference]] + point.offset)


def t_pose_length(path: Sequence[PathPoint], joints: Array) -> float:
    """Return the length of a path in the T-pose [m], for joint centres [55, 3]."""
    points = np.array([t_pose_position(point, joints) for point in path])
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def path_lengths(
    paths: Sequence[Sequence[PathPoint]], joints: Array, rotations: Array, positions: Array
) -> Array:
    """Return the lengths of paths in a posture [m], shape [n].

    Args:
        paths: The points of each path.
        joints: Joint centres in the T-pose [m], shape [55, 3].
        rotations: Global rotations of the joints in the posture, shape [55, 3, 3].
        positions: Joint centres in the posture [m], shape [55, 3].
    """
    points = [point for path in paths for point in path]
    carriers = np.array([JOINT_INDEX[point.joint] for point in points])
    arms = np.array([t_pose_position(point, joints) for point in points]) - joints[carriers]
    parents = np.array([JOINT_INDEX[point.parent or point.joint] for point in points])
    # Halfway between what both segments carry; where both are the same it is what that one carries.
    between = np.einsum("pab,pb->pa", rotations[carriers] + rotations[parents], arms)
    shrunk = np.linalg.norm(between, axis=1)
    carried = between * (np.linalg.norm(arms, axis=1) / np.maximum(shrunk, 1e-12))[:, None]
    steps = np.linalg.norm(np.diff(positions[carriers] + carried, axis=0), axis=1)
    ends = np.cumsum([len(path) for path in paths])
    steps[ends[:-1] - 1] = 0.0  # from the last point of a path to the first of the next
    return np.add.reduceat(np.append(steps, 0.0), np.append(0, ends[:-1]))
