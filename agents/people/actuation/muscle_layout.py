"""The paths of a person's muscles laid out over the moving parts, so that a physics step visits no more.

A degree of freedom changes the length of a path through the segments of which it carries one end and not
the other, and through the pulleys that it turns halfway. A shoulder blade follows the humerus: to a DoF of
the shoulder it is a body of its own, between collar and humerus.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array
from rcare_marl.tree.joint_tree import Ints, JointTree, ancestors

from ..body.skeleton import (
    CARRIER_INDEX,
    DOFS_OF,
    JOINT_INDEX,
    JOINTS,
    SCAPULAE,
    carrier_joint,
    carrier_origin,
)
from .muscle_unit import MuscleUnit, PathPoint, t_pose_position
from .muscle_wrap import CENTRE, IS_CYLINDER, TURN, WRAP_COLUMNS, WRAP_RADIUS, surface_frame

# Columns of `PathLayout.pulleys`: arm in the frame of the carrying part and of the part before it.
ARM, ARM_BEFORE, RADIUS = 0, 3, 6
PULLEY_COLUMNS = 7
FIXED = -2  # in place of the part before: no pulley

# Columns of `PathLayout.scapulae`: rows of the frames of collar and humerus, of its own first frame, of the
# first and the second DoF that turn it (0: none), and 1 of the left or -1.
COLLAR, HUMERUS, FIRST_ROW, FIRST_DOF, SECOND_DOF, SIDE = 0, 1, 2, 3, 4, 5
# Columns of `PathLayout.blades`: the collar in its part; of the humerus in its part centre and direction;
# from there to where the blade turns, in the collar.
COLLAR_TURN, SHOULDER, SHAFT, AWAY = 0, 9, 12, 15
# Frames of a scapula; each has an axis: as it turns by either DoF, and as the humerus turns against it.
BLADE_ROWS = 4
_HALFWAY = 0.5  # of a scapula: a DoF of the shoulder takes it along, but not as far as the humerus
_LED_BY = 2  # DoFs of a shoulder, the first ones: the third turns the humerus about itself


class PathLayout(NamedTuple):
    """The paths of m muscles over n moving parts; a row is one of the frames, 0 for the pelvis.

    Attributes:
        points: Each point, or the centre of its pulley, in the frame of its part [m], shape [p, 3].
        rows: Row of the part of each point, shape [p].
        pulleys: Geometry of each pulley [m], shape [k, 7]; the columns are named in this module.
        pulley_spots: Point of each pulley, the rows of its part and the part before, and whether a
            segment comes from the point before and one goes on, shape [k, 5].
        wraps: Geometry of each surface [m], shape [w, 14]; the columns are named in `muscle_wrap.py`.
        wrap_spots: First of the two spots of each surface, and the row of its part, shape [w, 2].
        scapulae: Rows of each shoulder blade, shape [s, 6]; the columns are named in this module.
        blades: Geometry of the same, shape [s, 18].
        starts: First point and first crossing of each muscle, and the ends, shape [m + 1, 2].
        crossed: DoF of each crossing of a muscle and a DoF, shape [c].
        cuts: Segments whose ends do not move together: the point where each ends, and a spot on the line
            of its pull, shape [s, 2].
        entries: What changes length: crossing; cut, or s and the number of a pulley; +1 or -1 if its end
            or its start is carried; and the row whose axis it turns about; shape [e, 4].
        is_branched: Whether a muscle crosses DoFs that do not lie on one branch of the tree, [m].
    """

    points: Array
    rows: Ints
    pulleys: Array
    pulley_spots: Ints
    wraps: Array
    wrap_spots: Ints
    scapulae: Ints
    blades: Array
    starts: Ints
    crossed: Ints
    cuts: Ints
    entries: Ints
    is_branched: npt.NDArray[np.bool_]


class _Carriage:
    """Which DoF carries which part, and about which row's axis one part turns against another."""

    def __init__(self, chain: JointTree, joints: Array) -> None:
        count = len(chain.names)
        self._above = [frozenset(ancestors(chain.arrays.parents, i)) for i in range(count)]
        self._led: dict[int, list[int]] = {}  # by the part of a scapula: the DoFs that turn it
        scapulae, blades = [], []
        for number, scapula in enumerate(SCAPULAE):
            first = count + 1 + BLADE_ROWS * number
            shoulder = carrier_joint(scapula)
            j, c = JOINT_INDEX[shoulder], JOINT_INDEX[shoulder.replace("shoulder", "collar")]
            names = [dof.name for dof in DOFS_OF[shoulder][:_LED_BY]]
            led = [chain.names.index(name) for name in names if name in chain.names]
            rows = [dof + 1 for dof in led] + [0] * (_LED_BY - len(led))
            side = 1 if scapula.startswith("left") else -1
            parts = chain.frame_parts[[c, j]] + 1
            scapulae.append((*parts, first, *rows, side))
            turn = chain.frame_rotations[j]
            blades.append(
                (
                    *chain.frame_rotations[c].ravel(),
                    *chain.frame_offsets[j],
                    *side * turn[:, 0],
                    *(carrier_origin(scapula, joints) - joints[j]),
                )
            )
            self._led[first - 1] = led
            collar = int(chain.frame_parts[c])
            self._above.extend([self._above[collar] if collar >= 0 else frozenset()] * BLADE_ROWS)
        self.scapulae, self.blades = np.array(scapulae, np.int64), np.array(blades)

    def place(self, carrier: str, chain: JointTree) -> tuple[int, Array, Array]:
        """Return the part, rotation and offset [m] of a carrier."""
        if carrier in SCAPULAE:
            first = int(self.scapulae[SCAPULAE.index(carrier), FIRST_ROW])
            return first - 1, np.eye(3), np.zeros(3)
        j = CARRIER_INDEX[carrier]
        return int(chain.frame_parts[j]), chain.frame_rotations[j], chain.frame_offsets[j]

    def above(self, part: int) -> frozenset[int]:
        """Return the DoFs that carry a part."""
        return self._above[part] | frozenset(self._led.get(part, ())) if part >= 0 else frozenset()

    def motion(self, part: int) -> tuple[frozenset[int], bool]:
        """Return what two parts share that never move against each other."""
        return self.above(part), bool(self._led.get(part))

    def turn(self, dof: int, before: int, after: int) -> tuple[int, int]:
        """Return which end of a segment a DoF carries, +1, -1 or 0 for none or both, and the row."""
        states = [self._state(dof, part) for part in (before, after)]
        if states == [_HALFWAY, _HALFWAY] and before != after:
            raise ConfigError("a path cannot go from a scapula to a blade: they are one bone")
        if states[0] == states[1]:
            return 0, 0
        sign = 1 if states[1] > states[0] else -1
        for part in (before, after):
            led = self._led.get(part, [])
            if dof in led:
                is_humerus = 1.0 in states
                return sign, part + 1 + led.index(dof) + (_LED_BY if is_humerus else 0)
        return sign, dof + 1

    def _state(self, dof: int, part: int) -> float:
        """Return how far a DoF takes a part along: 0, 1 or a half of a scapula."""
        if dof in self._led.get(part, ()):
            return _HALFWAY
        return float(dof in self.above(part))

    def is_branch(self, dofs: Sequence[int]) -> bool:
        """Return whether DoFs lie on one branch, each above the next."""
        return all(a in self._above[b] for a, b in zip(dofs, dofs[1:], strict=False))


def make_layout(units: Sequence[MuscleUnit], joints: Array, chain: JointTree) -> PathLayout:
    """Return the layout of paths over the moving parts of a person.

    Args:
        units: The muscles, their offsets measured on this person.
        joints: The person's joint centres in the T-pose [m], shape [55, 3].
        chain: The moving parts.
    """
    carriage = _Carriage(chain, joints)
    points: list[Array] = []
    rows: list[int] = []
    pulleys: list[Array] = []
    pulley_spots: list[tuple[int, ...]] = []
    wraps: list[Array] = []
    wrap_spots: list[tuple[int, int]] = []
    starts: list[tuple[int, int]] = []
    crossed: list[int] = []
    cuts: list[tuple[int, int]] = []
    entries: list[tuple[int, int, int, int]] = []
    branched: list[bool] = []
    for unit in units:
        first = len(points)
        starts.append((first, len(crossed)))
        ends: list[tuple[int, int]] = []
        onto: set[int] = set()
        turning: dict[int, int] = {}
        for point in unit.path:
            place, pulley, part, before = _point(point, joints, chain, carriage)
            if point.surface is not None:
                onto.add(len(ends))
                wrap_spots.append((len(points), part + 1))
                turn = carriage.place(point.joint, chain)[1]
                wraps.append(_wrap(point, place, turn))
            if pulley is not None:
                joined = len(ends) > 0, point is not unit.path[-1]
                pulley_spots.append((len(points), part + 1, before + 1, *map(int, joined)))
                turning[len(ends)] = len(pulleys)
                pulleys.append(pulley)
            for _ in range(1 if point.surface is None else 2):
                points.append(place)
                rows.append(part + 1)
                ends.append((part, before))
        found = _crossings(ends, carriage)
        own = sorted({k for _, pulls in found for k, sign, _ in pulls if sign})
        cut = {k: len(cuts) + n for n, k in enumerate(own)}
        # On to a surface the pull goes through the start.
        cuts.extend((first + k, first + k - (k in onto)) for k in own)
        for dof, pulls in found:
            for k, sign, row in pulls:
                pulled = cut[k] if sign else -1 - turning[k]
                entries.append((len(crossed), pulled, sign or 1, row))
            crossed.append(dof)
        branched.append(not carriage.is_branch([dof for dof, _ in found]))
    starts.append((len(points), len(crossed)))
    table = np.array(entries, np.int64).reshape(-1, 4)
    table[:, 1] = np.where(table[:, 1] < 0, len(cuts) - 1 - table[:, 1], table[:, 1])
    return PathLayout(
        np.array(points).reshape(-1, 3),
        np.array(rows, np.int64),
        np.array(pulleys).reshape(-1, PULLEY_COLUMNS),
        np.array(pulley_spots, np.int64).reshape(-1, 5),
        np.array(wraps).reshape(-1, WRAP_COLUMNS),
        np.array(wrap_spots, np.int64).reshape(-1, 2),
        carriage.scapulae,
        carriage.blades,
        np.array(starts, np.int64),
        np.array(crossed, np.int64),
        np.array(cuts, np.int64).reshape(-1, 2),
        table,
        np.array(branched, np.bool_),
    )


def crossing(units: Sequence[MuscleUnit], chain: JointTree) -> list[int]:
    """Return which of the muscles some DoF of the chain can change in length."""
    carriage = _Carriage(chain, np.zeros((len(JOINTS), 3)))  # where is of no concern
    found = []
    for m, unit in enumerate(units):
        carriers = {j for point in unit.path for j in (point.joint, point.parent) if j}
        parts = {carriage.place(carrier, chain)[0] for carrier in carriers}
        if len({carriage.motion(part) for part in parts}) > 1:
            found.append(m)
    return found


def _point(
    point: PathPoint, joints: Array, chain: JointTree, carriage: _Carriage
) -> tuple[Array, Array | None, int, int]:
    """Return where a point is in its part, its pulley if it turns, its part and the part before."""
    part, turn, centre = carriage.place(point.joint, chain)
    arm = t_pose_position(point, joints) - carrier_origin(point.joint, joints)
    if point.parent is None:
        return centre + turn @ arm, None, part, FIXED
    b = JOINT_INDEX[point.parent]
    before, turn_before = int(chain.frame_parts[b]), chain.frame_rotations[b]
    radius = float(np.linalg.norm(arm))
    if before == part:  # the joint does not move: the pulley has stopped for good
        between = (turn + turn_before) @ arm
        return centre + between * (radius / np.linalg.norm(between)), None, part, FIXED
    return centre, np.concatenate((turn @ arm, turn_before @ arm, [radius])), part, before


def _wrap(point: PathPoint, centre: Array, turn: Array) -> Array:
    """Return the row of a surface in `PathLayout.wraps`."""
    assert point.surface is not None
    row = np.zeros(WRAP_COLUMNS)
    row[TURN : TURN + 9] = (surface_frame(np.array(point.surface.axis)) @ turn.T).ravel()
    row[CENTRE : CENTRE + 3] = centre
    row[WRAP_RADIUS] = point.surface.radius
    row[IS_CYLINDER] = point.surface.kind == "cylinder"
    return row


def _crossings(
    ends: Sequence[tuple[int, int]], carriage: _Carriage
) -> list[tuple[int, list[tuple[int, int, int]]]]:
    """Return each crossed DoF with what it changes, proximal first: spot, sign (0: a pulley) and row.

    Args:
        ends: Part of each spot of a path, and the part before if it is a pulley.
        carriage: Which DoF carries which part.
    """
    # The parts that carry the spots as rigid bodies would.
    whole = [part if before == FIXED else before for part, before in ends]
    found = []
    for dof in sorted(frozenset().union(*(carriage.above(part) for part, _ in ends))):
        pulls = []
        for k, (part, before) in enumerate(ends):
            sign, row = carriage.turn(dof, whole[k - 1], whole[k]) if k else (0, 0)
            if sign:
                pulls.append((k, sign, row))
            if before != FIXED and dof in carriage.above(part) - carriage.above(before):
                pulls.append((k, 0, dof + 1))
        if pulls:
            found.append((dof, pulls))
    return found
