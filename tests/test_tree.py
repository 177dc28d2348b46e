"""The core's joint tree: kinematics, dynamics and bounded search, on one that branches, turns and slides."""

from __future__ import annotations

import numpy as np
import pytest

from rcare_marl.pose import Array, axis_rotation
from rcare_marl.tree import dynamics
from rcare_marl.tree.inverse_kinematics import GOAL_COLUMNS, POSITION, IkProblem, search
from rcare_marl.tree.joint_tree import (
    Frames,
    JointTree,
    Tree,
    gravity_torques,
    jacobian,
    new_frames,
    place,
)
from rcare_marl.world import GRAVITY

PARENTS = np.array((-1, 0, 1, 1, 3, 4))
N, TIP = len(PARENTS), np.array((0.1, -0.05, 0.2))


def some_tree(rng: np.random.Generator, slides: tuple[int, ...] = (0, 3)) -> JointTree:
    axes = rng.normal(size=(N, 3))
    turns = [
        axis_rotation((1.0, 0.0, 0.0), a) @ axis_rotation((0.0, 1.0, 0.0), a) for a in range(N)
    ]
    inertias = np.array([np.diag(rng.uniform(0.01, 0.02, 3)) for _ in range(N)])
    arrays = Tree(
        parents=PARENTS,
        slides=np.isin(np.arange(N), slides),
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        rotations=np.array(turns),
        offsets=rng.normal(size=(N, 3)) * 0.3,
        masses=rng.uniform(0.5, 2, N),
        centres=rng.normal(size=(N, 3)) * 0.1,
        inertias=inertias,
        lags=np.zeros(N),
    )
    none = np.zeros((0, 3))
    names = tuple(f"joint{i}" for i in range(N))
    return JointTree(names, arrays, np.zeros(0, np.int64), np.zeros((0, 3, 3)), none)


def placed(tree: Tree, q: Array) -> Frames:
    frames: Frames = new_frames(N)
    place(tree, np.arange(N), q, frames)
    return frames


def centres(tree: Tree, q: Array) -> Array:
    frames = placed(tree, q)
    out: Array = frames.points + np.einsum("iab,ib->ia", frames.turns, tree.centres)
    return out


def test_kernels_and_plain_numpy_place_parts_alike() -> None:
    rng = np.random.default_rng(0)
    tree = some_tree(rng)
    q = rng.uniform(-1, 1, N)
    frames, (turns, points) = placed(tree.arrays, q), tree.place(q)
    np.testing.assert_allclose(frames.turns, turns, atol=1e-14)
    np.testing.assert_allclose(frames.points, points, atol=1e-14)


def test_a_jacobian_is_that_of_finite_differences_and_leaves_other_branches_out() -> None:
    rng, h = np.random.default_rng(1), 1e-6
    tree = some_tree(rng).arrays
    q = rng.uniform(-1, 1, N)

    def tip(at: Array) -> Array:
        frames = placed(tree, at)
        out: Array = frames.points[5] + frames.turns[5] @ TIP
        return out

    found = jacobian(tree, placed(tree, q), 5, tip(q))
    slopes = [(tip(q + h * row) - tip(q - h * row)) / (2 * h) for row in np.eye(N)]
    np.testing.assert_allclose(found[:3].T, slopes, atol=1e-8)
    assert not found[:, 2].any()


def test_gravity_torques_are_the_slopes_of_the_potential_energy() -> None:
    rng, h = np.random.default_rng(2), 1e-6
    tree = some_tree(rng).arrays
    q = rng.uniform(-1, 1, N)

    def energy(at: Array) -> float:
        return GRAVITY * float(tree.masses @ centres(tree, at)[:, 2])

    slopes = [(energy(q + h * row) - energy(q - h * row)) / (2 * h) for row in np.eye(N)]
    found = gravity_torques(tree, q, placed(tree, q), GRAVITY)
    np.testing.assert_allclose(found, slopes, atol=1e-6)


def test_the_mass_matrix_gives_the_kinetic_energy() -> None:
    rng, h = np.random.default_rng(3), 1e-6
    tree = some_tree(rng)
    q, rate = rng.uniform(-1, 1, (2, N))
    arrays = tree.arrays
    speeds = (centres(arrays, q + h * rate) - centres(arrays, q - h * rate)) / (2 * h)
    before, now, after = (placed(arrays, q + k * h * rate).turns for k in (-1, 0, 1))
    energy = 0.0
    for i in range(N):
        skew = now[i].T @ (after[i] - before[i]) / (2 * h)
        spin = np.array((skew[2, 1], skew[0, 2], skew[1, 0]))
        energy += 0.5 * arrays.masses[i] * speeds[i] @ speeds[i]
        energy += 0.5 * spin @ arrays.inertias[i] @ spin
    assert 0.5 * rate @ tree.mass_matrix(q) @ rate == pytest.approx(energy, rel=1e-7)


def test_the_packed_dynamics_of_a_physics_step_agree_with_the_plain_ones() -> None:
    rng = np.random.default_rng(4)
    tree = some_tree(rng, slides=())
    arrays, q, wanted = tree.arrays, rng.uniform(-1, 1, N), rng.normal(size=N)
    down = np.array((0.0, 0.0, -GRAVITY))
    weights = gravity_torques(arrays, q, placed(arrays, q), GRAVITY)
    np.testing.assert_allclose(dynamics.holding_torques(arrays, q, down), weights, atol=1e-12)
    depths, packed = dynamics.tree_depths(PARENTS), dynamics.packed_matrix(PARENTS)
    table, work = dynamics.part_table(arrays), np.zeros((N, dynamics.SCRATCH_COLUMNS))
    dynamics.place_frames(table, PARENTS, q, work)
    dynamics.place_masses(table, work)
    dynamics.mass_matrix(PARENTS, depths, down, work, packed)
    matrix = tree.mass_matrix(q)
    np.testing.assert_allclose(packed[np.arange(N), depths], np.diag(matrix), atol=1e-12)
    found = wanted.copy()
    dynamics.solve(PARENTS, depths, packed, found)
    np.testing.assert_allclose(matrix @ found, wanted, atol=1e-11)


def test_the_search_reaches_a_point_within_the_limits_or_ends_on_them() -> None:
    rng = np.random.default_rng(5)
    tree = some_tree(rng).arrays
    q = rng.uniform(-0.5, 0.5, N)
    frames = placed(tree, q)
    numbers = np.zeros((1, GOAL_COLUMNS))
    numbers[0, 0], numbers[0, 1:4] = 1.0, TIP
    numbers[0, 4:7] = frames.points[5] + frames.turns[5] @ TIP
    everything = np.arange(N)
    problem = IkProblem(
        order=everything,
        columns=everything,
        kinds=np.array((POSITION,)),
        parts=np.array((5,)),
        numbers=numbers,
        polygon=np.zeros((0, 2)),
        lower=np.full(N, -0.6),
        upper=np.full(N, 0.6),
        rest=np.zeros(N),
        pull=np.full(N, 1e-8),
    )
    found, residual, _, _ = search(tree, problem, np.zeros(N), 60)
    assert np.linalg.norm(residual) < 1e-4 and np.abs(found).max() <= 0.6
    far = problem._replace(numbers=numbers + 5.0 * (np.arange(GOAL_COLUMNS) >= 4))
    found, residual, _, _ = search(tree, far, np.zeros(N), 60)
    assert np.linalg.norm(residual) > 1.0 and np.abs(found).max() == 0.6
