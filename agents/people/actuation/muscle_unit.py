"""One muscle-tendon unit: its architecture and the path that it takes over the skeleton.

A path goes through points that move with the segments, and round surfaces between them
(`muscle_wrap.py`). A point can also be a pulley of constant radius at a joint's centre, which keeps its
distance from the joint however far the joint turns: it serves small joints with several axes.

A degree of freedom changes the length of a path through the segments of which it carries one end and not
the other, and through the pulleys that it turns halfway; `muscle_layout.py` finds both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.pose import Array

from ..body.skeleton import CARRIER_INDEX, JOINT_INDEX, carrier_origin, with_carriers
from .hill import MAX_SPEED
from .muscle_wrap import Surface, surface_frame, wrapped

Side = Literal["left", "right", "axial"]


@dataclass(frozen=True)
class PathPoint:
    """A point of a muscle's path, or a surface that it goes round.

    Attributes:
        joint: Joint whose segment carries the point, an ulna, a scapula or a blade (`CARRIERS`).
        parent: None, or for a pulley the joint of the segment before `joint`: the point then stands
            at the distance |offset| from the centre of `joint`, in the direction halfway between
            the offsets as the two segments carry them.
        reference: Joint from which the offset is measured in the T-pose; `joint` for a pulley.
        offset: From the reference joint [m], in T-pose axes (x left, y up, z forward).
        surface: What the path goes round, its centre at the offset; None for a point.
    """

    joint: str
    parent: str | None
    reference: str
    offset: tuple[float, float, float]
    surface: Surface | None = None


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
        max_speed: At which the fibres shorten without load [optimal fibre lengths/s].
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
    max_speed: float = MAX_SPEED


def t_pose_position(point: PathPoint, joints: Array) -> Array:
    """Return where a point is in the T-pose [m], shape [3], for joint centres [55, 3]."""
    return np.asarray(joints[JOINT_INDEX[point.reference]] + point.offset)


def t_pose_length(path: Sequence[PathPoint], joints: Array) -> float:
    """Return the length of a path in the T-pose [m], for joint centres [55, 3]."""
    return float(path_lengths([path], joints, np.tile(np.eye(3), (len(joints), 1, 1)), joints)[0])


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
    turns, places = with_carriers(rotations, positions)
    points = [point for path in paths for point in path]
    starts = np.array([carrier_origin(point.joint, joints) for point in points])
    arms = np.array([t_pose_position(point, joints) for point in points]) - starts
    carriers = np.array([CARRIER_INDEX[point.joint] for point in points])
    parents = np.array([CARRIER_INDEX[point.parent or point.joint] for point in points])
    # Halfway between what both segments carry; where both are the same it is what that one carries.
    between = np.einsum("pab,pb->pa", turns[carriers] + turns[parents], arms)
    size = np.linalg.norm(arms, axis=1) / np.maximum(np.linalg.norm(between, axis=1), 1e-12)
    spots = places[carriers] + between * size[:, None]
    out, first = np.zeros(len(paths)), 0
    for m, path in enumerate(paths):
        own = list(spots[first : first + len(path)])
        for k in reversed(range(len(path))):
            surface = path[k].surface
            if surface is not None:
                frame = surface_frame(np.array(surface.axis)) @ turns[carriers[first + k]].T
                before, after = (frame @ (own[n] - own[k]) for n in (k - 1, k + 1))
                figures = (*before, *after, surface.radius, surface.kind == "cylinder")
                found = wrapped(*figures)
                if found[6] < 0.0:
                    del own[k]
                    continue
                own[k : k + 1] = [own[k] + found[a : a + 3] @ frame for a in (0, 3)]
                out[m] += found[6]
        first += len(path)
        out[m] += np.linalg.norm(np.diff(own, axis=0), axis=1).sum()
    return out
