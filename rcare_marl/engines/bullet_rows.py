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

The rows are solved as Bullet solves them, by projected Gauss-Seidel with the same number of iterations,
from nothing in each step. That is no detail: in thirty iterations Bullet's forces on a pressed mouth stay a
fifth below what they converge to, since the bond between hand and spoon is slow to solve.

The force of a motor is then what really acted in the step, as Bullet tells it.
"""

from __future__ import annotations

import numba
import numpy as np

from rcare_marl.pose import Array

ERP = 0.2  # share of the error of bonds and joint limits that Bullet removes in a physics step
FAR_PAST = (
    -0.04
)  # [rad or m] past its limit from where on Bullet stops a joint, but moves it back no more
CONTACT_ERP = 0.08  # the same of the overlap of rigid bodies
SLOP = 1e-5  # [m] of overlap that Bullet leaves
MOTOR_GIVE = 1e-4  # R of a motor or bond as a share of what its joint alone gives way by
CONTACT_GIVE = 1e-3  # the same for rigid contacts and friction
EQUALITY_ROW, FRICTION_ROW, LIMIT_ROW, CONTACT_ROW = 0, 1, 3, 7  # MuJoCo's mjtConstraint


def motor_table(count: int) -> Array:
    """Return motors at rest, shape [count, 4].

    Columns: target [rad or m], wished speed there, share of the error removed in a physics step,
    greatest speed.
    """
    table = np.zeros((count, 4))
    table[:, 3] = np.inf
    return table


@numba.njit(cache=True)
def write_rows(  # type: ignore[no-untyped-def]
    dt,
    positions,
    velocities,
    places,
    motors,
    gears,
    surfaces,
    owners,
    rows,
    dual,
    contacts,
    touched,
):
    """Write motors and contacts into the rows of a step, and which bodies touch something.

    Args:
        dt: Physics step [s].
        positions: MuJoCo's `qpos`.
        velocities: Of each degree of freedom, shape [nv].
        places: Where in `positions` the joint of a degree of freedom is, shape [nv].
        motors: See `motor_table`.
        gears: Share of the error of each equality that is removed in a physics step.
        surfaces: Friction, stiffness (0 if rigid), damping and rounding [m] of each geom, shape [ngeom, 4].
        owners: Number of the body of each geom.
        rows: `efc_type`, `efc_id`, `efc_pos`, `efc_vel`, `efc_diagA`, `efc_aref`, `efc_R`.
        dual: `efc_AR`, whose diagonal has R in it.
        contacts: `geom`, `dist`, `efc_address`, `dim`, `friction` of each contact.
        touched: Of each body, written.
    """
    kinds, ids, errors, speeds, gives, aref, soft = rows
    count = len(kinds)
    for row in range(count):
        dual[row, row] -= soft[row]
    for row in range(count):
        if kinds[row] == EQUALITY_ROW or kinds[row] == LIMIT_ROW:
            share = gears[ids[row]] if kinds[row] == EQUALITY_ROW else ERP
            if kinds[row] == LIMIT_ROW and errors[row] < FAR_PAST:
                share = 0.0
            aref[row] = (-share * errors[row] / dt - speeds[row]) / dt
            soft[row] = MOTOR_GIVE * gives[row]
        if kinds[row] != FRICTION_ROW:
            continue
        dof = ids[row]
        target, wished, gain, most = motors[dof]
        if gain > 0.0:
            wished += gain * (target - positions[places[dof]]) / dt
        wished = min(max(wished, -most), most)
        aref[row] = (wished - velocities[dof]) / dt
        soft[row] = MOTOR_GIVE * gives[row]
    geoms, gaps, addresses, sizes, frictions = contacts
    touched[:] = False
    for i in range(len(gaps)):
        row = addresses[i]
        if row < 0 or kinds[row] != CONTACT_ROW:
            continue
        one, other = geoms[i, 0], geoms[i, 1]
        touched[owners[one]] = touched[owners[other]] = True
        near = gives[row]
        first, second = surfaces[one, 1], surfaces[other, 1]
        gap = gaps[i] - surfaces[one, 3] - surfaces[other, 3] + SLOP
        give = CONTACT_GIVE * near
        wished = -gap / dt if gap > 0.0 else -CONTACT_ERP * gap / dt
        if first > 0.0 or second > 0.0:
            spring = first + second
            if first > 0.0 and second > 0.0:
                spring = first * second / spring
            whole = dt * spring + surfaces[one, 2] + surfaces[other, 2]
            give = 1.0 / (dt * whole)
            if gap <= 0.0:
                wished = -gap * spring / whole
        aref[row] = (wished - speeds[row]) / dt
        soft[row] = give
        for k in range(1, sizes[i]):
            aref[row + k] = -speeds[row + k] / dt
            soft[row + k] = CONTACT_GIVE * near
        frictions[i, 0] = frictions[i, 1] = surfaces[one, 0] * surfaces[other, 0]
    for row in range(count):
        dual[row, row] += soft[row]


@numba.njit(cache=True, inline="always")  # a call costs more than the row
def _solve_row(row, least, most, dual, left, forces) -> None:  # type: ignore[no-untyped-def]
    wanted = forces[row] - left[row] / dual[row, row]
    _set_force(row, min(max(wanted, least), most), dual, left, forces)


@numba.njit(cache=True, inline="always")
def _set_force(row, force, dual, left, forces) -> None:  # type: ignore[no-untyped-def]
    change = force - forces[row]
    if change != 0.0:
        forces[row] = force
        for k in range(len(left)):
            left[k] += dual[row, k] * change


@numba.njit(cache=True)
def solve_rows(  # type: ignore[no-untyped-def]
    iterations, kinds, ids, limits, dual, jacobian, aref, free, contacts, forces, pushes
):
    """Solve the rows in Bullet's order, from nothing, and write what they push joints with.

    In each sweep motors and limits come first and bonds after them, the other way round in every other
    sweep; then the normals of all contacts, then their friction, within the cone of the normal forces.

    Args:
        iterations: Sweeps.
        kinds: `efc_type`.
        ids: `efc_id`.
        limits: Greatest forces of motors by degree of freedom, and of bonds by equality.
        dual: `efc_AR`.
        jacobian: `efc_J`.
        aref: `efc_aref`.
        free: Acceleration without constraints, shape [nv].
        contacts: `efc_address`, `dim`, `friction` of each contact.
        forces: `efc_force`, written.
        pushes: What the rows push each degree of freedom with, shape [nv], written.
    """
    count, width = len(kinds), len(free)
    motors, bonds = limits
    addresses, sizes, frictions = contacts
    left = np.empty(count)  # b + A f
    order = np.empty(count, np.int64)
    most = np.full(count, np.inf)
    others = 0
    for row in range(count):
        total = -aref[row]
        for dof in range(width):
            total += jacobian[row, dof] * free[dof]
        left[row] = total
        forces[row] = 0.0
        if kinds[row] == FRICTION_ROW:
            most[row] = motors[ids[row]]
        if kinds[row] == EQUALITY_ROW:
            most[row] = bonds[ids[row]]
        elif kinds[row] < CONTACT_ROW:
            order[others] = row
            others += 1
    for row in range(count):
        if kinds[row] == EQUALITY_ROW:
            order[others] = row
            others += 1
    for sweep in range(iterations):
        for k in range(others):
            row = order[k] if sweep % 2 else order[others - 1 - k]
            least = 0.0 if kinds[row] > FRICTION_ROW else -most[row]
            _solve_row(row, least, most[row], dual, left, forces)
        for i in range(len(addresses)):
            if addresses[i] >= 0:
                _solve_row(addresses[i], 0.0, np.inf, dual, left, forces)
        for i in range(len(addresses)):
            row = addresses[i]
            if row < 0 or forces[row] <= 0.0:
                continue
            for k in range(3, sizes[i]):
                reach = frictions[i, k - 1] * forces[row]
                _solve_row(row + k, -reach, reach, dual, left, forces)
            if sizes[i] < 3:
                continue
            first = forces[row + 1] - left[row + 1] / dual[row + 1, row + 1]
            second = forces[row + 2] - left[row + 2] / dual[row + 2, row + 2]
            reach, size = frictions[i, 0] * forces[row], np.sqrt(first * first + second * second)
            share = reach / size if size > reach else 1.0
            _set_force(row + 1, share * first, dual, left, forces)
            _set_force(row + 2, share * second, dual, left, forces)
    pushes[:] = 0.0
    for row in range(count):
        if forces[row] != 0.0:
            for dof in range(width):
                pushes[dof] += jacobian[row, dof] * forces[row]
