"""Bullet's motors and contacts as rows of MuJoCo's solver.

Bullet solves each physics step for the speeds at its end: a motor's row is its wished speed within an
impulse, a contact's row leaves a share of the overlap and gives way by its softness. MuJoCo's rows say
`J a + R f = aref`, with dry friction `|f| <= frictionloss`. So a motor is dry friction against something
that moves at its wished speed, and with `a = (v' - v) / dt`

- motor: aref = (wished - v) / dt, R about 0;
- contact of stiffness k [N/m] and damping c [N·s/m]: aref = (k overlap / (dt k + c) - v) / dt and
  R = 1 / (dt (dt k + c)), as of a spring and a damper at the end of the step;
- bond or joint limit: aref = (-0.2 error / dt - v) / dt, R about 0; a gear has a share of its own, and
  what is farther than 0.04 past a limit is stopped, not moved back;
- rigid contact: aref = (0.08 overlap / dt - v) / dt, R about 0, with Bullet's share of 0.08.

The rows are solved as Bullet solves them, by projected Gauss-Seidel over accelerations with the same number
of sweeps, from nothing in each step. That is no detail: in thirty sweeps Bullet's forces on a pressed
mouth stay a fifth below what they converge to, since the bond between hand and spoon is slow to solve.
What can reach each other by touches and bonds is an island, and what is so near that its boxes overlap with
it. As in Bullet each is solved by itself, until a sweep changes no row's speed by more than `SETTLED`.

The force of a motor is then what really acted in the step, as Bullet tells it.

To hand a function of compiled code many arrays takes some 0.7 us, so several of those that are called once
in a step are written into their callers (`inline`).
"""

from __future__ import annotations

import numba
import numpy as np

from rcare_marl.pose import Array
from rcare_marl.tree.least_squares import put

from . import native
from .caps import cut_speeds
from .contacts import GIVE, write_contacts
from .frictions import place_frictions
from .manifolds import keep_points
from .native import CONTACT_ROW, EQUALITY_ROW, FRICTION_ROW, LIMIT_ROW, call, real, whole, word
from .neighbours import keep_list

ERP = 0.2  # share of the error of bonds and joint limits that Bullet removes in a physics step
# [rad or m] past its limit from where on Bullet stops a joint, but moves it back no more.
FAR_PAST = -0.04
SETTLED = 1e-7**0.5  # [m/s or rad/s] PyBullet's threshold of a residual, which Bullet squares
LANES = 8  # how many numbers compiled code takes at once, our own choice
PLAIN, FIRST, SECOND, TURNING = range(4)  # what limits the force of a row: numbers, or a cone


def motor_table(count: int) -> Array:
    """Return motors at rest, shape [count, 4].

    Columns: target [rad or m], wished speed there, share of the error removed in a physics step,
    greatest speed.
    """
    table = np.zeros((count, 4))
    table[:, 3] = np.inf
    return table


@numba.njit(cache=True, nogil=True, error_model="numpy")
def physics_step(places, state, inertia, rules, near, kept, felt, touched) -> None:  # type: ignore[no-untyped-def]
    """Advance a scene by one physics step.

    Args:
        places: See `native.addresses`.
        state: `qpos`, `qvel`, `qfrc_applied`, `qacc_smooth`, `qacc`, `qfrc_constraint`; and what the motor of
            each degree of freedom did, shape [nv], written.
        inertia: The factors of the mass matrix: `qLD`, `qLDiagInv`, `M_rownnz`, `M_rowadr`, `M_colind`; then
            the tree of each degree of freedom, and the first and the number of those of each tree.
        rules: Physics step [s]; sweeps of the solver, shape [1]; where in `qpos` the joint of a degree of
            freedom is, shape [nv]; see `motor_table`; greatest forces of motors by degree of freedom, and of
            bonds by equality; share of the error of each equality that is removed in a physics step;
            friction, stiffness (0 if rigid), damping, rounding [m] and whether it is a box of each geom,
            shape [ngeom, 5]; the number of its body, of its link, and of its tree of degrees of freedom,
            -1 if it cannot move; how each degree of freedom turns and moves, `cdof`; greatest speed of each;
            the place in Bullet's order of each motor, end of a joint and equality, shapes [nv], [njnt] and
            [neq], and which equalities are gears; how geoms are turned, shape [ngeom, 9], where
            they are [m] and how large [m], shapes [ngeom, 3].
        near: See `Neighbours.compiled`.
        kept: See `Manifolds.compiled`.
        felt: Whether to work out what joints transmit, shape [1]; `subtree_com`, `xpos` and `xmat`, and
            where to keep what they are in this step.
        touched: Of each body, whether it touches something, written.
    """
    model, data = places[native.MODEL], places[native.DATA]
    qpos, qvel, _, smooth, acceleration, pushes, acted = state
    dt, sweeps, joints, motors, greatest, strengths, shares = rules[:7]
    surfaces, owners, _, bearers, ways, caps, ranks, _ = rules[7:]
    _find_contacts(places, rules, near, kept)
    for stage in range(native.ROWS, native.ACCELERATION + 1):
        call(places[stage], model, data)
    cut_speeds(qvel, smooth, caps, dt)
    put(smooth, acceleration)
    pushes[:] = acted[:] = 0.0
    touched[:] = False
    count = whole(data + places[native.NEFC], 1)[0]
    if count > 0:
        kinds = whole(word(data + places[native.EFC_TYPE]), count)
        ids = whole(word(data + places[native.EFC_ID]), count)
        sizes = whole(word(data + places[native.J_ROWNNZ]), count)
        starts = whole(word(data + places[native.J_ROWADR]), count)
        filled = starts[count - 1] + sizes[count - 1]
        columns = whole(word(data + places[native.J_COLIND]), filled)
        jacobian = real(word(data + places[native.EFC_J]), filled)
        errors = real(word(data + places[native.EFC_POS]), count)
        speeds = real(word(data + places[native.EFC_VEL]), count)
        gives = real(word(data + places[native.EFC_DIAG]), count)
        forces = real(word(data + places[native.EFC_FORCE]), count)
        wished, soft, most = np.empty(count), np.zeros(count), np.full(count, np.inf)
        first = (kinds, ids, errors, speeds, gives)
        _write_joints(
            dt, qpos, qvel, joints, motors, (greatest, strengths), shares, first, wished, soft, most
        )
        rows = sizes, starts, columns, jacobian
        place_frictions(places, rows, (kinds, speeds), surfaces, inertia[5], bearers, ways, qvel)
        touching = kinds, speeds, gives
        contacts = write_contacts(dt, places, touching, surfaces, owners, wished, soft, touched)
        wants = soft, wished, most, smooth
        told, nearby = (kinds, ids, ranks), near[-1][2]
        _solve_islands(
            sweeps[0], dt, inertia, nearby, told, rows, wants, contacts, forces, acceleration
        )
        _push(rows, (kinds, ids), forces, pushes, acted)
    cut_speeds(qvel, acceleration, caps, dt)
    feels, present, past = felt
    if feels[0]:
        call(places[native.RNE], model, data)
        for k in range(len(past)):
            np.multiply(present[k], 1.0, past[k])
    call(places[native.EULER], model, data)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def touch(places, state, inertia, rules, near, kept, felt, touched) -> None:  # type: ignore[no-untyped-def]
    """Find what touches where the scene is now, and do nothing else. See `physics_step`."""
    _find_contacts(places, rules, near, kept)


@numba.njit(cache=True, error_model="numpy", inline="always")
def _find_contacts(places, rules, near, kept) -> None:  # type: ignore[no-untyped-def]
    """Find where all is, and what touches."""
    call(places[native.KINEMATICS], places[native.MODEL], places[native.DATA])
    keep_list(near)
    for stage in range(native.COM, native.ROWS):
        call(places[stage], places[native.MODEL], places[native.DATA])
    keep_points(places, rules[-1], rules[7], rules[9], near, kept)


@numba.njit(cache=True, error_model="numpy", inline="always")
def _write_joints(  # type: ignore[no-untyped-def]
    dt, positions, velocities, joints, motors, limits, shares, rows, wished, soft, most
) -> None:
    """Write what motors, bonds, gears and ends of joints want, how they give way, and their limits."""
    kinds, ids, errors, speeds, gives = rows
    greatest, strengths = limits
    for row in range(len(kinds)):
        if kinds[row] == EQUALITY_ROW or kinds[row] == LIMIT_ROW:
            share = shares[ids[row]] if kinds[row] == EQUALITY_ROW else ERP
            if kinds[row] == LIMIT_ROW and errors[row] < FAR_PAST:
                share = 0.0
            wished[row] = (-share * errors[row] / dt - speeds[row]) / dt
            soft[row] = GIVE * gives[row]
            if kinds[row] == EQUALITY_ROW:
                most[row] = strengths[ids[row]]
        elif kinds[row] == FRICTION_ROW:
            dof = ids[row]
            target, speed, gain, fastest = motors[dof]
            if gain > 0.0:
                speed += gain * (target - positions[joints[dof]]) / dt
            speed = min(max(speed, -fastest), fastest)
            wished[row] = (speed - velocities[dof]) / dt
            soft[row] = GIVE * gives[row]
            most[row] = greatest[dof]


@numba.njit(cache=True, error_model="numpy", inline="always")
def _islands(rows, trees, near):  # type: ignore[no-untyped-def]
    """Sort rows by what they can reach through each other, or through what is `near`.

    Returns:
        The rows, those of an island one after the other and as they were within it, shape [nefc]; and the
            ends of islands among them, the same twice where there is none.
    """
    sizes, starts, columns, _ = rows
    count = len(sizes)
    joined, homes = near.copy(), np.zeros(count, np.int64)
    for row in range(count):
        for k in range(starts[row], starts[row] + sizes[row]):
            tree = trees[columns[k]]
            if k == starts[row]:
                homes[row] = tree
            one, other = joined[homes[row]], joined[tree]
            if one != other:
                for each in range(len(joined)):
                    if joined[each] == other:
                        joined[each] = one
    order, ends = np.empty(count, np.int64), np.zeros(len(joined) + 1, np.int64)
    for row in range(count):
        homes[row] = joined[homes[row]]
        ends[homes[row] + 1] += 1
    for number in range(len(joined)):
        ends[number + 1] += ends[number]
    for row in range(count):  # then each end is where the one before it was
        order[ends[homes[row]]] = row
        ends[homes[row]] += 1
    return order, ends[:-1]


@numba.njit(cache=True, error_model="numpy", inline="always")
def _solve_islands(  # type: ignore[no-untyped-def]
    sweeps, dt, inertia, near, told, rows, wants, contacts, forces, acceleration
) -> None:
    """Solve all rows, island by island; write their forces, and add what these do to accelerations."""
    soft, wished, most, smooth = wants
    order, ends = _islands(rows, inertia[5], near)
    begin, own = 0, np.zeros(len(order), np.int64)
    for end in ends:
        if begin == end:
            continue
        island = order[begin:end]
        for place in range(end - begin):
            own[island[place]] = place
        geared = _geared(told, island)
        answers, moved = _answers(inertia, rows, island, geared)
        solver = _coupling(rows, island, geared, answers, soft, wished, smooth)
        steps = _steps(island, own, told, contacts)
        solved = _solve(sweeps, dt, island, steps, told[0], most, solver)
        for place in range(end - begin):
            forces[island[place]] = solved[place]
        for tree in range(len(moved)):
            for place in range(end - begin if moved[tree] else 0):
                for i in range(inertia[6][tree], inertia[6][tree] + inertia[7][tree]):
                    acceleration[i] += answers[i, place] * solved[place]
        begin = end


@numba.njit(cache=True, error_model="numpy", inline="always")
def _geared(told, island):  # type: ignore[no-untyped-def]
    """Return which rows of an island are gears, by their places."""
    kinds, ids, (_, _, _, gears) = told
    found, count = np.empty(len(island), np.int64), 0
    for place in range(len(island)):
        row = island[place]
        if kinds[row] == EQUALITY_ROW and gears[ids[row]]:
            found[count] = place
            count += 1
    return found[:count]


@numba.njit(cache=True, error_model="numpy")
def _answers(inertia, rows, island, geared):  # type: ignore[no-untyped-def]
    """Return how joints answer a unit force of each row of an island.

    Returns:
        Accelerations, shape [nv, n or a little more]: compiled code takes `LANES` at once. Those to the first
            joint's force of each gear follow, then zeros; and of each tree whether a row moves it.
    """
    factors, inverse, lengths, begins, others, trees, firsts, numbers = inertia
    sizes, starts, columns, jacobian = rows
    wide = -(-(len(island) + len(geared)) // LANES) * LANES
    answers, moved = np.zeros((len(inverse), wide)), np.zeros(len(firsts), np.bool_)
    for place in range(len(island)):
        row = island[place]
        for k in range(starts[row], starts[row] + sizes[row]):
            answers[columns[k], place] = jacobian[k]
            moved[trees[columns[k]]] = True
    for i in range(len(geared)):
        first = starts[island[geared[i]]]
        answers[columns[first], len(island) + i] = jacobian[first]
    for tree in range(len(moved)):
        if not moved[tree]:
            continue
        low, high = firsts[tree], firsts[tree] + numbers[tree]
        for i in range(high - 1, low - 1, -1):  # of L^T D L
            for k in range(begins[i], begins[i] + lengths[i] - 1):
                factor, mine, theirs = factors[k], answers[i], answers[others[k]]
                for place in range(wide):
                    theirs[place] -= factor * mine[place]
        for i in range(low, high):
            mine = answers[i]
            for place in range(wide):
                mine[place] *= inverse[i]
            for k in range(begins[i], begins[i] + lengths[i] - 1):
                factor, theirs = factors[k], answers[others[k]]
                for place in range(wide):
                    mine[place] -= factor * theirs[place]
    return answers, moved


@numba.njit(cache=True, error_model="numpy")
def _coupling(rows, island, geared, answers, soft, wished, acceleration):  # type: ignore[no-untyped-def]
    """Return by how much force each row of an island is changed by a unit force of another.

    Bullet leaves out of a gear's own acceleration how its two joints move each other. So a gear's force falls
    short of, or goes beyond, what it wants, and wants the rest in the next sweep.

    Returns:
        The change in every row by a force in one, shape [n, n]; the force that each row wants while the
            others have none; and its acceleration by a unit force of its own, shape [n]. The last axis is as
            wide as that of `answers`.
    """
    sizes, starts, columns, jacobian = rows
    count, wide = len(island), answers.shape[1]
    coupling, wanted, scales = np.zeros((count, wide)), np.zeros(wide), np.ones(wide)
    for place in range(count):
        row = island[place]
        mine, miss = coupling[place], -wished[row]
        for k in range(starts[row], starts[row] + sizes[row]):
            share, column = jacobian[k], answers[columns[k]]
            miss += share * acceleration[columns[k]]
            for other in range(wide):
                mine[other] += share * column[other]
        mine[place] += soft[row]
        scales[place] = mine[place]
        for i in range(len(geared)):
            if geared[i] == place:
                last = starts[row] + sizes[row] - 1
                scales[place] -= 2 * jacobian[last] * answers[columns[last], count + i]
        wanted[place] = -miss / scales[place]
    inverse = 1.0 / scales
    for place in range(count):  # what row does to others is what others do to it
        mine = coupling[place]
        for other in range(wide):
            mine[other] *= inverse[other]
        mine[place] -= 1.0  # 0 but for gears
    return coupling, wanted, scales


@numba.njit(cache=True, error_model="numpy", inline="always")
def _steps(island, places, told, contacts):  # type: ignore[no-untyped-def]
    """Write two sweeps of an island: joints and bonds by rank, the normals of contacts, then their friction.

    Returns:
        Of each step the place of its row and that of the contact's normal, shape [2, n + 1, 2]: in the first
            sweep joints and bonds go the other way round. The last steps only stand there. Then which of
            the constants above each step is, and its friction, shape [n + 1].
    """
    count, found, (held, frictions) = len(island), 0, contacts
    # Unsigned: of a signed place compiled code would look whether it is negative.
    both = np.zeros((2, count + 1, 2), np.uint64)
    sorts, rubs = np.zeros(count + 1, np.int64), np.zeros(count + 1)
    steps = both[1]
    kinds, ids, (motors, ends, equalities, _) = told
    ranks = np.empty(count, np.int64)
    for place in range(count):
        row = island[place]
        kind, number = kinds[row], ids[row]
        if kind >= CONTACT_ROW:
            continue
        if kind == EQUALITY_ROW:
            rank = equalities[number]
        else:
            rank = motors[number] if kind == FRICTION_ROW else ends[number]
        step = found
        while step > 0 and ranks[step - 1] > rank:
            steps[step, 0], ranks[step] = steps[step - 1, 0], ranks[step - 1]
            step -= 1
        steps[step, 0], ranks[step] = place, rank
        found += 1
    for step in range(found):
        both[0, step, 0] = steps[found - 1 - step, 0]
    others, normals = found, np.full(len(held), -1)
    for i in range(len(held)):
        row = held[i, 0]
        if row >= 0 and places[row] < count and island[places[row]] == row:
            steps[found, 0] = normals[i] = places[row]
            found += 1
    for i in range(len(held)):
        size = held[i, 1]
        if normals[i] < 0 or size < 3:
            continue
        for k in range(3, size + 2):  # turning before sliding
            steps[found, 0] = normals[i] + (k if k < size else k - size + 1)
            steps[found, 1] = normals[i]
            sorts[found] = TURNING if k < size else FIRST + k - size
            rubs[found] = frictions[i, min(k - 2, 2) if k < size else 0]
            found += 1
    for step in range(others, found):
        both[0, step, 0], both[0, step, 1] = steps[step, 0], steps[step, 1]
    return both, sorts, rubs


@numba.njit(cache=True, error_model="numpy")
def _solve(sweeps, dt, island, order, kinds, most, own):  # type: ignore[no-untyped-def]
    """Solve an island's rows in Bullet's order, from nothing, and return their forces.

    What a row changes in the others is written here once and in no function: numba would count its arrays
    at each call, which takes ten times as long. What the next row wants is worked out beside it, since to
    read what was just written takes as long as the rest of a row.
    """
    (both, sorts, rubs), (coupling, wanted, scales) = order, own
    count, wide = len(island), len(wanted)
    solved, least, greatest = np.zeros(count), np.zeros(count), np.empty(count)
    for place in range(count):
        greatest[place] = most[island[place]]
        if kinds[island[place]] <= FRICTION_ROW:
            least[place] = -greatest[place]
    for sweep in range(sweeps):
        steps = both[sweep % 2]
        change = before = second = 0.0
        ahead = wanted[steps[0, 0]]
        for step in range(count):
            place, kind, following = steps[step, 0], sorts[step], steps[step + 1, 0]
            force, ahead = ahead, wanted[following]
            if kind == PLAIN:
                force = min(max(force, least[place]), greatest[place])
            elif kind == SECOND:
                force = second
            else:
                normal = solved[steps[step, 1]]
                reach = rubs[step] * normal
                if kind == TURNING:
                    if normal <= 0.0:
                        continue
                    force = min(max(force, -reach), reach)
                elif normal <= 0.0:  # what it rubbed with in the sweep before is gone
                    force = second = 0.0
                else:
                    second = wanted[place + np.uint64(1)]
                    length = np.sqrt(force**2 + second**2)
                    if length > reach:
                        force *= reach / length
                        second *= reach / length
            moved = force - solved[place]
            if moved != 0.0:
                solved[place] = force
                ahead -= coupling[place, following] * moved
                for other in range(wide):
                    wanted[other] -= coupling[place, other] * moved
            moved *= scales[place]
            if kind == FIRST:
                before = moved
                continue
            change = max(change, abs(moved + before if kind == SECOND else moved))
        if dt * change <= SETTLED:
            break
    return solved


@numba.njit(cache=True, error_model="numpy", inline="always")
def _push(rows, told, forces, pushes, acted) -> None:  # type: ignore[no-untyped-def]
    """Add what the forces of the rows do to forces of joints; tell what motors did."""
    sizes, starts, columns, jacobian = rows
    kinds, ids = told
    for row in range(len(kinds)):
        force = forces[row]
        if kinds[row] == FRICTION_ROW:
            acted[ids[row]] = force
        if force != 0.0:
            for k in range(starts[row], starts[row] + sizes[row]):
                pushes[columns[k]] += jacobian[k] * force
