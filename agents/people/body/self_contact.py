"""Which parts of a person can meet each other: limbs with trunk, head and other limbs.

Neighbours at a joint, and an upper arm and the chest beside it, always overlap: their shapes are fitted to
one skin. Fingers meet what their palm meets only where they do not move.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations, product

import numpy as np

from rcare_marl.pose import Array

from .segment import Segment, least_gap, shape_row
from .skeleton import (
    DOF_INDEX,
    FINGERS,
    JOINT_INDEX,
    JOINTS,
    PARENTS,
    SIDES,
    forward_kinematics,
)

# Our own choices.
CLEARANCE = 0.004  # [m] between an arm and the body at the start
_STEP, _STEPS = np.radians(2.0), 40
_TURNED = ("shoulder_abduction", "shoulder_flexion", "shoulder_external_rotation", "elbow_flexion")
_TRUNK = ("pelvis", "spine1", "spine2", "spine3")
_ARM, _LEG = ("elbow", "wrist"), ("hip", "knee", "ankle")
_ARM_ENDS = (*_ARM, *(f"{finger}{k}" for finger in FINGERS for k in (1, 2, 3)))


def meeting_segments() -> frozenset[tuple[str, str]]:
    """Return the pairs of segments that can meet, in the order of the skeleton."""
    pairs: set[frozenset[str]] = set()
    legs = _legs()
    for side, other in (SIDES, SIDES[::-1]):
        upper = f"{side}_shoulder"
        for part in (f"{side}_{name}" for name in _ARM):
            met = (*_TRUNK, "neck", "head", *legs, f"{other}_shoulder")
            pairs |= {frozenset((part, thing)) for thing in met}
            pairs |= {frozenset((part, f"{other}_{name}")) for name in _ARM}
        pairs |= {frozenset((upper, thing)) for thing in ("spine1", "pelvis")}
        pairs |= {
            frozenset((f"{side}_{own}", f"{other}_{theirs}")) for own in _LEG for theirs in _LEG
        }
    order = JOINTS.index
    return frozenset(tuple(sorted(pair, key=order)) for pair in pairs)  # type: ignore[misc]


def meeting_links(
    parts: Mapping[int, Sequence[str]], *, legs: bool = True
) -> list[tuple[int, int]]:
    """Return the pairs of links that can meet.

    Args:
        parts: The segments that each link carries; several where joints between them do not move.
        legs: Whether legs meet anything.
    """
    wanted = {p for p in meeting_segments() if legs or not any(s.endswith(_LEG) for s in p)}
    found = []
    for a, b in combinations(sorted(parts), 2):
        pairs = [tuple(sorted((s, t), key=JOINTS.index)) for s in parts[a] for t in parts[b]]
        if any(pair in wanted for pair in pairs) and not any(map(_overlaps, pairs)):
            found.append((a, b))
    return found


def _overlaps(pair: Iterable[str]) -> bool:
    """Return whether two segments, in the order of the skeleton, are neighbours or nearly so."""
    first, second = pair
    if JOINTS[PARENTS[JOINTS.index(second)]] == first:
        return True
    return second.endswith("_shoulder") and first in ("spine2", "spine3", "neck")


def clear_arms(
    sides: Iterable[str],
    angles: Array,
    segments: Mapping[str, Segment],
    rest: Array,
    limits: Mapping[str, tuple[float, float]],
) -> Array:
    """Return angles [rad] by which forearms and hands are outside the rest of the body.

    A posture is written for nobody's body. An arm that would be inside the trunk, the head or a leg is
    turned out of it at shoulder and elbow by steps of `_STEP`, each the one that helps most.

    Args:
        sides: Whose arms, of `left` and `right`.
        angles: Angle of every DoF [rad], shape [112].
        segments: The segments of the body, by joint.
        rest: Joint centres in the T-pose [m], shape [55, 3].
        limits: Limits by DoF [rad].
    """
    out = angles.copy()
    solid = [joint for joint in (*_TRUNK, "neck", "head", *_legs()) if segments[joint].shapes]
    for side in sides:
        chosen = [DOF_INDEX[f"{side}_{name}"] for name in _TURNED]
        low, high = np.array([limits[f"{side}_{name}"] for name in _TURNED]).T
        depth = _depth(side, out, segments, rest, solid)
        for _ in range(_STEPS):
            if depth <= 0.0:
                break
            found: list[tuple[float, int, Array]] = []
            for k, sign in product(range(len(chosen)), (1.0, -1.0)):
                trial = out.copy()
                trial[chosen[k]] = np.clip(trial[chosen[k]] + sign * _STEP, low[k], high[k])
                found.append((_depth(side, trial, segments, rest, solid), len(found), trial))
            best = min(found, key=lambda each: each[:2])
            if best[0] >= depth:
                break
            depth, out = best[0], best[2]
    return out


def _depth(
    side: str, angles: Array, segments: Mapping[str, Segment], rest: Array, solid: Sequence[str]
) -> float:
    """Return how deep a forearm and hand are in other parts of the body [m]; negative if they are clear."""
    rotations, positions = forward_kinematics(rest, angles)

    def rows(joints: Iterable[str]) -> Array:
        return np.array(
            [
                shape_row(shape, rotations[JOINT_INDEX[j]], positions[JOINT_INDEX[j]])
                for j in joints
                for shape in segments[j].shapes
            ]
        )

    arm = [j for j in JOINTS if j.startswith(side) and j.endswith(_ARM_ENDS)]
    points, radii = [], []
    for row in rows(arm):
        centre, axes = row[4:7], row[7:16].reshape(3, 3)  # rows of `axes` are those of the shape
        if row[0] == 1.0:
            corners = np.array(list(product((-0.5, 0.5), repeat=3))) * row[1:4]
            points += list(centre + corners @ axes)
            radii += [0.0] * len(corners)
        else:
            along = np.linspace(-0.5, 0.5, 7)[:, None] * row[1] * axes[2]
            points += list(centre + along)
            radii += [float(row[2])] * len(along)
    body = rows(solid)
    gaps = [least_gap(body, point) - r for point, r in zip(points, radii, strict=True)]
    return CLEARANCE - min(gaps)


def _legs() -> list[str]:
    return [f"{side}_{part}" for side in SIDES for part in _LEG]
