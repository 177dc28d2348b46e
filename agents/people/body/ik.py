"""Whole-body inverse kinematics: a posture of a person that meets goals within the range of motion.

Least squares from the present posture first; where that ends in a local minimum, a memetic search: a
population of postures, each improved by a few steps of least squares, that cross and mutate (the way of
P. Ruppel et al., "Cost functions to specify full-body motion and multi-goal manipulation tasks", ICRA
2018, known as bio-IK; this one is our own and simpler). What goals leave open is decided by the wish to
stay near a posture, in which a trunk counts more than an arm. Nothing here sees collisions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args

import numpy as np

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import (
    Array,
    Pose,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from rcare_marl.tree.inverse_kinematics import (
    BALANCE,
    DIRECTION,
    GAZE,
    GOAL_COLUMNS,
    ORIENTATION,
    POSITION,
    ROWS,
    IkProblem,
    Linear,
    evaluate,
    search,
)
from rcare_marl.tree.joint_tree import Frames, Tree, ancestors, new_frames, place

from ..avatar import expand_movable
from ..profile import Range
from .goal import Balance, Direction, Gaze, Goal, Orientation, Point, Position
from .person_tree import BASE_COLUMNS, BASE_REACH, FIRST, PELVIS, Base, part_of, walking_tree
from .segment import Segment
from .skeleton import DOF_INDEX, DOFS, JOINT_INDEX

if TYPE_CHECKING:
    from ..human import Human

ITERATIONS = 60  # of one search
# How much a radian away from the wished posture counts beside a metre from a goal: it decides only what
# goals leave open, and costs a goal well under a millimetre. Our own choice, the joints' shares too.
PULL = 2e-4
_HEAVY = {"spine1": 4.0, "spine2": 4.0, "spine3": 4.0, "left_collar": 3.0, "right_collar": 3.0}
_HEAVY_BASE = (20.0, 20.0, 20.0, 10.0, 10.0, 10.0)  # per metre and radian
POLISH, POLISH_ITERATIONS = 0.01, 20  # share of the pull, and steps, of the last search
# The memetic search: our own choices, tried on the caregiver and on Karan (docs/motion.md).
POPULATION, GENERATIONS, CHILD_STEPS, ELITE, ELITE_STEPS = 16, 8, 4, 2, 15
_MUTATED, _SPREAD = 3.0, 0.15  # joints that a mutation moves, and by which share of their range


@dataclass(frozen=True, eq=False)
class Solution:
    """A posture and how well it meets the goals.

    Attributes:
        angles: Angle of every DoF [rad], shape [112].
        base: Pose of the pelvis in the world.
        errors: What is left of each goal, in the order given [m or rad].
        reached: Whether each goal is within its tolerance.
        iterations: Steps of least squares, all together.
        is_memetic: Whether least squares alone had failed.
        dofs: The DoFs that were free to move.
    """

    angles: Array
    base: Pose
    errors: tuple[float, ...]
    reached: tuple[bool, ...]
    iterations: int
    is_memetic: bool
    dofs: tuple[str, ...]

    @property
    def success(self) -> bool:
        """Whether every goal is within its tolerance."""
        return all(self.reached)

    @property
    def wish(self) -> dict[str, float]:
        """Angle of each DoF that was free to move [rad], as `Human.action_towards` takes it."""
        return {dof: float(self.angles[DOF_INDEX[dof]]) for dof in self.dofs}


class WholeBodyIk:
    """Inverse kinematics of one person.

    Attributes:
        dofs: The DoFs that may move.
        lower: Lower limit of every DoF [rad], shape [112].
        upper: Upper limit of every DoF [rad], shape [112].
    """

    def __init__(
        self,
        joints: Array,
        segments: Mapping[str, Segment],
        limits: Mapping[str, tuple[float, float]],
        *,
        movable: Sequence[str] | None = None,
        base: Base = "fixed",
    ) -> None:
        """Prepare the tree of joints.

        Args:
            joints: Joint centres in the T-pose [m], shape [55, 3].
            segments: The 55 segments by joint, for the centre of mass.
            limits: Limits by DoF [rad].
            movable: DoFs, or joints for all DoFs of a joint, that may move; all 112 if None.
            base: Whether the pelvis may move: `fixed`, `planar` (along all axes, and yaw), `free`.

        Raises:
            ConfigError: If `base` is none of these.
            UnknownNameError: If there is no such joint or DoF.
        """
        if base not in BASE_COLUMNS:
            raise ConfigError(f"base must be one of {', '.join(BASE_COLUMNS)}, got {base!r}")
        self.dofs = expand_movable(movable)
        self.lower, self.upper = np.array([limits[dof.name] for dof in DOFS]).T.copy()
        self._base = BASE_COLUMNS[base]
        reach = np.array(BASE_REACH)
        self._limits = np.append(-reach, self.lower), np.append(reach, self.upper)
        self._tree = walking_tree(joints, segments)
        self._carries = np.zeros((FIRST + len(DOFS),) * 2, np.bool_)  # whether a column moves a row
        for i in range(len(self._carries)):
            self._carries[i, ancestors(self._tree.parents, i)] = True
        moving = [FIRST + DOF_INDEX[dof] for dof in self.dofs]
        self._columns = np.array([*self._base, *moving], np.int64)
        heavy = [_HEAVY.get(dof.joint, 1.0) for dof in DOFS]
        self._pull = np.array([*_HEAVY_BASE, *heavy], np.float64) * PULL

    @classmethod
    def of(
        cls,
        person: Human,
        *,
        kind: Range = "active",
        movable: Sequence[str] | None = None,
        base: Base = "fixed",
    ) -> WholeBodyIk:
        """Return the inverse kinematics of a spawned person.

        Args:
            person: Who moves.
            kind: Whether to stay within what the person reaches alone (`active`) or within what
                somebody else may move (`passive`).
            movable: DoFs or joints; those of the person if None.
            base: As in the constructor.
        """
        limits = person.avatar.profile.limits(kind)
        names = person.movable if movable is None else movable
        return cls(person.model.joints, person.segments, limits, movable=names, base=base)

    def solve(
        self,
        goals: Sequence[Goal],
        angles: Array,
        base: Pose = Pose(),
        *,
        rest: Array | None = None,
        fallback: bool = True,
        seed: int = 0,
    ) -> Solution:
        """Return a posture near `angles` that meets the goals.

        Args:
            goals: What is wanted.
            angles: Angle of every DoF at the start [rad], shape [112]. One outside the limits comes
                inside them.
            base: Pose of the pelvis in the world at the start.
            rest: Posture that is preferred where goals leave a choice [rad], shape [112]; the start
                if None.
            fallback: Whether to search memetically where least squares fails.
            seed: Of the memetic search; the same seed gives the same posture.

        Raises:
            ConfigError: If there is no goal, two goals of balance, or numbers are not finite.
        """
        start = self._start(angles, base)
        problem = self._problem(goals, start if rest is None else self._start(rest, base))
        tree = self._placed(base)
        found, residual, cost, steps = self._search(tree, problem, start)
        errors = _errors(goals, residual)
        needs = fallback and not _reached(goals, errors)
        if needs:
            found, residual, more = self._memetic(goals, tree, problem, start, found, cost, seed)
            errors, steps = _errors(goals, residual), steps + more
        return Solution(
            angles=found[FIRST:].copy(),
            base=self._base_at(found, base),
            errors=errors,
            reached=tuple(e <= g.tolerance for g, e in zip(goals, errors, strict=True)),
            iterations=steps,
            is_memetic=needs,
            dofs=self.dofs,
        )

    def linear(self, goals: Sequence[Goal], angles: Array, base: Pose = Pose()) -> Linear:
        """Return the weighted residuals of goals at a posture, three a goal, and their Jacobian.

        Its columns are what may move: the base first, then `dofs`.
        """
        q = self._start(angles, base)
        problem, rows = self._problem(goals, q), ROWS * len(goals)
        out = Linear(np.zeros(rows), np.zeros((rows, len(problem.columns))))
        evaluate(self._placed(base), problem, q, new_frames(len(q)), out, True)
        whole = np.zeros((rows, len(self._columns)))
        whole[:, np.isin(self._columns, problem.columns)] = out.jacobian
        return Linear(out.residual, whole)

    def centre_of_mass(self, angles: Array, base: Pose = Pose()) -> Array:
        """Return the centre of mass of the whole body in the world [m], shape [3]."""
        tree, q = self._placed(base), self._start(angles, base)
        frames = self._frames(tree, q, len(q))
        centres = frames.points + np.einsum("iab,ib->ia", frames.turns, tree.centres)
        return np.asarray(tree.masses @ centres / tree.masses.sum())

    def _frames(self, tree: Tree, q: Array, count: int) -> Frames:
        """Return the frames of the first `count` joints."""
        frames: Frames = new_frames(len(q))
        place(tree, np.arange(count), q, frames)
        return frames

    def _start(self, angles: Array, base: Pose) -> Array:
        values = np.asarray(angles, np.float64)
        if values.shape != (len(DOFS),) or not np.isfinite(values).all():
            raise ConfigError(f"angles must be {len(DOFS)} finite numbers, got {values.shape}")
        if not np.isfinite([*base.position, *base.quaternion]).all():
            raise ConfigError(f"the base must be a finite pose, got {base}")
        return np.concatenate((np.zeros(FIRST), values))

    def _placed(self, base: Pose) -> Tree:
        """Return the tree with the pelvis at `base`."""
        offsets, rotations = self._tree.offsets.copy(), self._tree.rotations.copy()
        offsets[0] = base.position
        rotations[PELVIS - 1] = matrix_from_quaternion(base.quaternion)
        return self._tree._replace(offsets=offsets, rotations=rotations)

    def _base_at(self, q: Array, base: Pose) -> Pose:
        if not self._base:
            return base
        frames = self._frames(self._placed(base), q, FIRST)
        turn = quaternion_from_matrix(frames.turns[PELVIS])
        return Pose(tuple(frames.points[PELVIS].tolist()), tuple(turn.tolist()))

    def _problem(self, goals: Sequence[Goal], rest: Array) -> IkProblem:
        if not goals:
            raise ConfigError("inverse kinematics needs at least one goal")
        kinds, parts = np.zeros(len(goals), np.int64), np.zeros(len(goals), np.int64)
        numbers = np.zeros((len(goals), GOAL_COLUMNS))
        polygon = np.zeros((0, 2))
        for g, goal in enumerate(goals):
            kinds[g], row = _KINDS[type(goal)], numbers[g]
            row[0] = goal.weight
            if isinstance(goal, Balance):
                if len(polygon):
                    raise ConfigError("only one goal of balance at a time: join their supports")
                polygon = np.asarray(goal.support, np.float64)
                continue
            parts[g] = part_of(goal.joint)
            if isinstance(goal, Orientation):
                row[4:13] = matrix_from_quaternion(goal.quaternion).ravel()
            else:
                row[1:4] = goal.local if isinstance(goal, Direction) else goal.offset
                row[4:7] = goal.target
        moved = self._carries[parts[kinds != BALANCE]].any(axis=0) | bool(len(polygon))
        return IkProblem(
            order=np.flatnonzero(moved),
            columns=self._columns[moved[self._columns]],
            kinds=kinds,
            parts=parts,
            numbers=numbers,
            polygon=polygon,
            lower=self._limits[0],
            upper=self._limits[1],
            rest=rest,
            pull=self._pull,
        )

    def _search(self, tree: Tree, problem: IkProblem, q: Array) -> tuple[Array, Array, float, int]:
        """Search with the wish for the posture, then almost without, to meet goals exactly."""
        rough, _, cost, a = search(tree, problem, q, ITERATIONS)
        weak = problem._replace(pull=POLISH * self._pull)
        found, residual, _, b = search(tree, weak, rough, POLISH_ITERATIONS)
        return found, residual, cost, a + b

    def _memetic(
        self,
        goals: Sequence[Goal],
        tree: Tree,
        problem: IkProblem,
        start: Array,
        found: Array,
        cost: float,
        seed: int,
    ) -> tuple[Array, Array, int]:
        """Return the best posture of a population, its residuals, and the steps that it took."""
        rng, columns = np.random.default_rng(seed), problem.columns
        low = problem.lower[columns]
        width, size = problem.upper[columns] - low, len(columns)
        pool, steps = [(cost, found)], 0

        def improve(q: Array, iterations: int) -> None:
            nonlocal steps
            better, _, value, done = search(tree, problem, q, iterations)
            steps += done
            pool.append((value, better))

        for i in range(1, POPULATION):  # from near the start to anywhere
            q, share = start.copy(), i / (POPULATION - 1)
            anywhere = low + rng.random(size) * width
            q[columns] = (1 - share) * q[columns] + share * anywhere
            improve(q, CHILD_STEPS)
        best: tuple[Array, Array] | None = None
        for _ in range(GENERATIONS):
            pool.sort(key=lambda member: member[0])
            del pool[POPULATION // 2 :]
            for _, q in pool[:ELITE]:
                improve(q, ELITE_STEPS)
            pool.sort(key=lambda member: member[0])
            q, residual, value, done = self._search(tree, problem, pool[0][1])
            steps += done
            pool[0], best = (value, q), (q, residual)
            if _reached(goals, _errors(goals, residual)):
                break
            while len(pool) < POPULATION:
                a, b = rng.integers(0, POPULATION // 2, 2)
                child, share = pool[a][1].copy(), rng.random()
                child[columns] = share * child[columns] + (1 - share) * pool[b][1][columns]
                is_mutated = rng.random(size) < _MUTATED / size
                child[columns] += is_mutated * rng.normal(0, _SPREAD, size) * width
                improve(child, CHILD_STEPS)
        assert best is not None
        return best[0], best[1], steps


_KINDS = dict(zip(get_args(Goal), (POSITION, ORIENTATION, DIRECTION, GAZE, BALANCE), strict=True))


def _errors(goals: Sequence[Goal], residual: Array) -> tuple[float, ...]:
    """Return what is left of each goal [m or rad]."""
    out = []
    for g, goal in enumerate(goals):
        size = float(np.linalg.norm(residual[ROWS * g : ROWS * (g + 1)])) / goal.weight
        if isinstance(goal, Direction | Gaze):  # the chord between two unit vectors
            size = 2 * math.asin(min(0.5 * size, 1.0))
        out.append(size)
    return tuple(out)


def _reached(goals: Sequence[Goal], errors: Sequence[float]) -> bool:
    return all(error <= goal.tolerance for goal, error in zip(goals, errors, strict=True))


def present_angles(person: Human) -> Array:
    """Return the present angle of every DoF of a spawned person [rad], shape [112]."""
    out = person.angles.copy()
    positions, _ = person.body.joint_states(person.body.indices(person.movable))
    out[[DOF_INDEX[dof] for dof in person.movable]] = positions
    return out


def grip_point(person: Human, side: str) -> Array:
    """Return where a closed hand holds: in the palm, in the frame of the wrist [m], shape [3].

    On the way to the middle knuckle, a little below the palm, which looks down in the T-pose.
    """
    wrist, knuckle = (
        person.model.joints[JOINT_INDEX[f"{side}_{name}"]] for name in ("wrist", "middle1")
    )
    return np.asarray(0.85 * (knuckle - wrist) + (0.0, -0.03, 0.0))


def arm_dofs(person: Human, side: str, *, trunk: bool = True) -> tuple[str, ...]:
    """Return the movable DoFs of collar, shoulder, elbow and wrist, and of the trunk if wished."""
    check_name("side", side, ("left", "right"))
    joints = {f"{side}_{name}" for name in ("collar", "shoulder", "elbow", "wrist")}
    if trunk:
        joints |= {"spine1", "spine2", "spine3"}
    return tuple(dof for dof in person.movable if DOFS[DOF_INDEX[dof]].joint in joints)


def reach(
    person: Human,
    side: str,
    point: Point,
    *,
    quaternion: Point | None = None,
    offset: Point | None = None,
    kind: Range = "active",
    trunk: bool = True,
    rest: Array | None = None,
    goals: Sequence[Goal] = (),
    seed: int = 0,
) -> Solution:
    """Return a posture that brings a hand of a spawned person to a point, from the present posture.

    `Solution.wish` is what `Human.action_towards` pursues.

    Args:
        person: Who reaches.
        side: `left` or `right` hand.
        point: Where to, in the world [m], shape [3].
        quaternion: How the wrist's frame is to be turned in the world; free if None.
        offset: What comes to the point, in the frame of the wrist [m]; the palm if None.
        kind: Range of motion: `active` or `passive`.
        trunk: Whether the trunk may lean.
        rest: Posture preferred where there is a choice [rad], shape [112]; the present one if None.
        goals: Further goals, such as a `Gaze`; their joints must be among the arm's and trunk's.
        seed: Of the memetic search.

    Raises:
        ConfigError: If the point is not finite, or no joint of that arm can move.
    """
    movable = arm_dofs(person, side, trunk=trunk)
    if not movable:
        raise ConfigError(f"{person.name!r} has no movable joint in the {side} arm to reach with")
    ik = WholeBodyIk.of(person, kind=kind, movable=movable)
    wrist = f"{side}_wrist"
    held = grip_point(person, side) if offset is None else offset
    wanted: list[Goal] = [Position(wrist, point, held)]
    if quaternion is not None:
        wanted.append(Orientation(wrist, quaternion))
    return ik.solve(
        [*wanted, *goals], present_angles(person), person.body.base_pose(), rest=rest, seed=seed
    )
