"""One muscle-tendon unit: its architecture and the path that it takes over the skeleton.

A path goes through points that move with the segments, and round surfaces between them
(`muscle_wrap.py`). A point can also be a pulley of constant radius at a joint's centre, which keeps its
distance from the joint however far the joint turns: it serves small joints with several axes.

A degree of freedom changes the length of a path through the segments of which it carries one end and not
the other, and through the pulleys that it turns halfway. `make_layout` finds both once, so that a physics
step visits nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array
from rcare_marl.tree.joint_tree import Ints, JointTree, ancestors

from ..body.skeleton import (
    CARRIER_INDEX,
    JOINT_INDEX,
    carrier_joint,
    with_ulnae,
)
from .hill import MAX_SPEED
from .muscle_wrap import (
    CENTRE,
    IS_CYLINDER,
    TURN,
    WRAP_COLUMNS,
    WRAP_RADIUS,
    Surface,
    surface_frame,
    wrapped,
)

Side = Literal["left", "right", "axial"]

# Columns of `PathLayout.pulleys`: arm in the frame of the carrying part and of the part before it.
ARM, ARM_BEFORE, RADIUS = 0, 3, 6
PULLEY_COLUMNS = 7
FIXED = -2  # in place of the part before: no pulley
FIRST_WRAP = (
    -2
)  # in the last column of `PathLayout.carriers`, less the number of the surface: a spot on one
LEAVES = -2  # in the column before: the second spot of a surface
TURNS = 0  # kind of an entry: a pulley; the others are the sign of a cut segment


@dataclass(frozen=True)
class PathPoint:
    """A point of a muscle's path, or a surface that it goes round.

    Attributes:
        joint: Joint whose segment carries the point, or an ulna (`CARRIERS`).
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
    turns, places = with_ulnae(rotations, positions)
    points = [point for path in paths for point in path]
    starts = [JOINT_INDEX[carrier_joint(point.joint)] for point in points]
    arms = np.array([t_pose_position(point, joints) for point in points]) - joints[starts]
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


class PathLayout(NamedTuple):
    """The paths of m muscles over n moving parts.

    Attributes:
        points: Each point, or the centre of its pulley, in the frame of its part [m], shape [p, 3].
        pulleys: Geometry of each pulley [m], shape [k, 7]; the columns are named in this module.
        wraps: Geometry of each surface [m], shape [w, 14]; the columns are named in `muscle_wrap.py`.
        carriers: Row in the frames of the part of each point, 0 for the pelvis; the pulley and the row
            of the part before it, or -1 and -1, or of both spots of surface w: -1 or `LEAVES`, and
            `FIRST_WRAP` - w; shape [p, 3].
        starts: First point and first crossing of each muscle, and the ends, shape [m + 1, 2].
        crossings: DoF and first entry of each crossing of a muscle and a DoF, and the ends, shape
            [c + 1, 2].
        entries: What changes length there: (point of the path, kind), shape [e, 2]. Kind +1 or -1: the
            segment that ends in the point is carried at its end, or at its start; +2 or -2: the same
            of a segment on to a surface, whose pull goes through its start; `TURNS`: the pulley of the
            point turns.
        longest: Points of the longest path.
        is_branched: Whether a muscle crosses DoFs that do not lie on one branch of the tree, [m].
    """

    points: Array
    pulleys: Array
    wraps: Array
    carriers: Ints
    starts: Ints
    crossings: Ints
    entries: Ints
    is_branched: npt.NDArray[np.bool_]
    longest: int


def make_layout(units: Sequence[MuscleUnit], joints: Array, chain: JointTree) -> PathLayout:
    """Return the layout of paths over the moving parts of a person.

    Args:
        units: The muscles, their offsets measured on this person.
        joints: The person's joint centres in the T-pose [m], shape [55, 3].
        chain: The moving parts.
    """
    above = [frozenset(ancestors(chain.arrays.parents, i)) for i in range(len(chain.names))]
    points: list[Array] = []
    pulleys: list[Array] = []
    wraps: list[Array] = []
    carriers: list[tuple[int, int, int]] = []
    starts: list[tuple[int, int]] = []
    crossings: list[tuple[int, int]] = []
    entries: list[tuple[int, int]] = []
    branched: list[bool] = []
    for unit in units:
        starts.append((len(points), len(crossings)))
        own = [_point(point, joints, chain) for point in unit.path]
        twice = [1 if point.surface is None else 2 for point in unit.path]
        ends = [
            (part, before)
            for n, (_, _, part, before) in zip(twice, own, strict=True)
            for _ in range(n)
        ]
        onto = {sum(twice[:n]) for n, count in enumerate(twice) if count == 2}
        crossed = _crossings(ends, above, onto)
        for dof, found in crossed:
            crossings.append((dof, len(entries)))
            entries.extend(found)
        dofs = [dof for dof, _ in crossed]
        branched.append(any(a not in above[b] for a, b in zip(dofs, dofs[1:], strict=False)))
        for point, (place, pulley, part, before) in zip(unit.path, own, strict=True):
            points.append(place)
            carriers.append((part + 1, -1, -1))
            if point.surface is not None:
                points.append(place)
                number = FIRST_WRAP - len(wraps)
                carriers[-1:] = [(part + 1, -1, number), (part + 1, LEAVES, number)]
                wraps.append(_wrap(point, place, chain))
            if pulley is not None:
                carriers[-1] = (part + 1, len(pulleys), before + 1)
                pulleys.append(pulley)
    starts.append((len(points), len(crossings)))
    crossings.append((-1, len(entries)))
    return PathLayout(
        np.array(points).reshape(-1, 3),
        np.array(pulleys).reshape(-1, PULLEY_COLUMNS),
        np.array(wraps).reshape(-1, WRAP_COLUMNS),
        np.array(carriers, np.int64).reshape(-1, 3),
        np.array(starts, np.int64),
        np.array(crossings, np.int64),
        np.array(entries, np.int64).reshape(-1, 2),
        np.array(branched, np.bool_),
        max(b - a for (a, _), (b, _) in zip(starts, starts[1:], strict=False)),
    )


def crosses(unit: MuscleUnit, chain: JointTree) -> bool:
    """Return whether any DoF of the chain can change a muscle's length."""
    carriers = {int(chain.frame_parts[CARRIER_INDEX[point.joint]]) for point in unit.path}
    before = {int(chain.frame_parts[JOINT_INDEX[p.parent]]) for p in unit.path if p.parent}
    return len(carriers | before) > 1


def _point(
    point: PathPoint, joints: Array, chain: JointTree
) -> tuple[Array, Array | None, int, int]:
    """Return where a point is in its part, its pulley if it turns, its part and the part before."""
    j = CARRIER_INDEX[point.joint]
    part, turn = int(chain.frame_parts[j]), chain.frame_rotations[j]
    arm = t_pose_position(point, joints) - joints[JOINT_INDEX[carrier_joint(point.joint)]]
    centre = chain.frame_offsets[j]
    if point.parent is None:
        return centre + turn @ arm, None, part, FIXED
    b = JOINT_INDEX[point.parent]
    before, turn_before = int(chain.frame_parts[b]), chain.frame_rotations[b]
    radius = float(np.linalg.norm(arm))
    if before == part:  # the joint does not move: the pulley has stopped for good
        between = (turn + turn_before) @ arm
        return centre + between * (radius / np.linalg.norm(between)), None, part, FIXED
    return centre, np.concatenate((turn @ arm, turn_before @ arm, [radius])), part, before


def _wrap(point: PathPoint, centre: Array, chain: JointTree) -> Array:
    """Return the row of a surface in `PathLayout.wraps`."""
    assert point.surface is not None
    row = np.zeros(WRAP_COLUMNS)
    turn = chain.frame_rotations[CARRIER_INDEX[point.joint]]
    row[TURN : TURN + 9] = (surface_frame(np.array(point.surface.axis)) @ turn.T).ravel()
    row[CENTRE : CENTRE + 3] = centre
    row[WRAP_RADIUS] = point.surface.radius
    row[IS_CYLINDER] = point.surface.kind == "cylinder"
    return row


def _crossings(
    carriers: Sequence[tuple[int, int]], above: Sequence[frozenset[int]], onto: Set[int]
) -> list[tuple[int, list[tuple[int, int]]]]:
    """Return each crossed DoF with its entries (point, kind), proximal first; surfaces begin at `onto`."""
    none: frozenset[int] = frozenset()
    carried = [above[part] if part >= 0 else none for part, _ in carriers]
    whole = [
        on if before == FIXED else (above[before] if before >= 0 else none)
        for on, (_, before) in zip(carried, carriers, strict=True)
    ]  # the DoFs that carry the point as a rigid body would
    found = []
    for dof in sorted(frozenset().union(*carried)):
        entries = []
        for k, on in enumerate(whole):
            if k and (dof in on) != (dof in whole[k - 1]):
                sign = 1 if dof in on else -1
                entries.append((k, 2 * sign if k in onto else sign))
            if dof in carried[k] and dof not in on:
                entries.append((k, TURNS))
        if entries:
            found.append((dof, entries))
    return found
