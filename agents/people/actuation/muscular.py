"""The muscular drive: joint torques from excitations of Hill muscles.

Each physics step finds paths, activations and tensions, and the torques that they make by virtual work.
Muscles are stiff and damp strongly for the light parts of a body, so tension is taken at the end of
the coming step: it is continued with the rate and the acceleration of each path's length, and the
accelerations are found with the mass matrix of all moving parts, as in `skeletal.py`. (A linearly
implicit step; so 1/240 s is stable for a finger under full contraction.)

Discs of the spine resist bending. Ligaments tighten over the last few degrees of the passive range, to
what the muscles can pull with at its end; the hard stop there is the physics engine's.

What a person wills ends at the active range: the net active torque that would lead further out fades
over the last few degrees. Passive movement by others goes on to the end of the passive range.

Where furniture holds a limb that is too weak, it does so as in `skeletal.py`; a limb that it carries it
keeps from sagging below the start posture. A degree of freedom that no muscle crosses, such as those
of the eyes, is held where the posture has it, or where the person wants it.

An action is an excitation for each muscle (`unit`) or for each group of muscles (`group`), held over the
control step; or the change of the angle that each degree of freedom pursues (`posture`), as with the
skeletal drive. Then a controller, which is a part of the body, finds excitations 60 times a second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numba
import numpy as np
import numpy.typing as npt

from rcare_marl.observable import Observable
from rcare_marl.pose import Array
from rcare_marl.tree.dynamics import WEIGHT, mass_matrix, part_table, place_masses, solve
from rcare_marl.tree.joint_tree import JointTree

from . import muscle_kernel as kernel
from .actuation import MAX_SPEED, Shaking, TargetAngles
from .muscle_control import DAMPING_RATIO, FREQUENCY, Felt, MuscleController
from .muscle_model import MuscleModel
from .skeletal import impedance

# Our own choices.
ACTIVE_END = 0.07  # [rad] before the end of the active range where active torque begins to fade
ACTIVE_END_DAMPING = 0.5  # [s/rad] of the torque that fades there
CARRY_GAP = 0.01  # [rad] above the posture where furniture lets go
GRIP_REACH = 0.02  # [rad] from where a limb was laid down: friction holds it no further
LIGAMENT_ZONE = 0.05  # [rad] before the end of the passive range where ligaments tighten ...
LIGAMENT_SHARE = 0.3  # ... or this share of a narrower range
# [N·m/rad] of bending, without muscles. A lumbar segment has some 1 to 2 N·m per degree, from memory;
# one joint here stands for several in a row, stiffened by the weight on them.
DISC_STIFFNESS = {"spine1": 60.0, "spine2": 60.0, "spine3": 60.0, "neck": 6.0, "head": 6.0}
FRICTION_SHARE = 0.1  # of normal torque: less than this does not move a limb that rests
CONTROL_INTERVAL = 4  # physics steps between two looks of the controller: 60 Hz at 1/240 s
LIFTED = 1e-3  # [rad] of a pursued angle from where the limb was laid: the person wants to move it
REST_REACH = 0.05  # [rad] from where a limb was laid down: further away it rests no longer
# [rad] from where a limb is to where excitations alone should bring it: at this the spring of the
# controller moves it with about MAX_SPEED.
LEAD = MAX_SPEED * 2 * DAMPING_RATIO / FREQUENCY

# Columns of the table after those of the parts, one row a DoF.
STIFFNESS, DAMPING, TISSUE, SUPPORT = 28, 29, 30, 31
LOWEST, HIGHEST, POSTURE = 32, 33, 34
LEAST, MOST, ZONE, LIGAMENT, INERTIA = 35, 36, 37, 38, 39
CARRIED, SLACK, GRIP, BORNE, ELASTIC = 40, 41, 42, 43, 44
COLUMNS = 45
HELD = 32  # of the scratch: whether furniture holds the limb in this step

# Rows of the torques: active, passive, faded active; damping at both kinds of ends; of ligaments the
# torque and the stiffness.

Excitation = Literal["unit", "group", "posture"]


class MuscleDrive:
    """Torques of a person's moving DoFs from excitations of muscles: an `Actuation`.

    An action is by `excitation`: for each muscle that crosses a moving DoF one value in [0, 1] (`unit`), or
    for each named group of such muscles (`group`), which they are told for the whole control step; or for
    each moving DoF one in [-1, 1], which moves the angle that it pursues (`posture`, see `TargetAngles`).

    Attributes:
        names: The moving DoFs.
        target: Angle that each DoF pursues [rad], shape [n]; that of the start but in `posture`.
        model: The muscles, m of them.
        state: Their state, shape [STATE_ROWS, m]; rows are named in `muscle_kernel.py`.
        excitation: What each muscle is told now, shape [m].
    """

    def __init__(
        self,
        chain: JointTree,
        model: MuscleModel,
        *,
        excitation: Excitation,
        groups: Mapping[str, Sequence[int]],
        normal_strength: Array,
        supported: npt.NDArray[np.bool_],
        carried: npt.NDArray[np.bool_],
        resting: npt.NDArray[np.bool_],
        willed: npt.NDArray[np.bool_],
        posture: Array,
        limits: Array,
        passive: Array,
        physics_dt: float,
        shaking: Shaking | None = None,
    ) -> None:
        """Prepare the tables of the kernel.

        Args:
            chain: The moving parts, n of them.
            model: The muscles that cross them.
            excitation: What an action is.
            groups: Muscles of each named group.
            normal_strength: Torque of a healthy person, the scale of stiffness [N·m], shape [n].
            supported: Whether furniture holds the limb, shape [n].
            carried: Whether it only bears it from below, shape [n].
            resting: Whether the limb lies on something until the person wishes to move it, shape [n].
            willed: Whether the person could move it at all, shape [n].
            posture: Angles of the start [rad], shape [n].
            limits: Where active movement ends [rad], shape [n, 2].
            passive: Where passive movement ends [rad], shape [n, 2].
            physics_dt: Physics step [s].
            shaking: Involuntary excitation of the muscles.
        """
        count = len(chain.names)
        self.names, self.model = chain.names, model
        self._dt, self._shaking = physics_dt, shaking
        inertia = np.diag(chain.mass_matrix(posture))
        table = part_table(chain.arrays, COLUMNS)
        table[:, STIFFNESS : TISSUE + 1] = impedance(normal_strength, inertia)
        uncrossed = np.ones(count, np.bool_)
        uncrossed[model.layout.crossings[:-1, 0]] = False
        self._uncrossed = np.flatnonzero(uncrossed & willed)
        held = supported | uncrossed
        table[:, SUPPORT], table[:, CARRIED] = held, carried & ~held
        table[:, LOWEST], table[:, HIGHEST] = limits.T
        table[:, POSTURE], table[:, INERTIA] = posture, inertia
        _set_ligaments(table, passive, normal_strength, model, posture)
        self._table = table
        self._posture = posture.copy()
        self._targets = TargetAngles(chain.names, posture.copy(), limits)
        self.target = self._targets.values
        self._take_actions(excitation, groups)
        self.excitation = np.zeros(len(model.units))
        self._rested = model.table[:, kernel.VOLUNTARY].copy()
        self._start = model.settled_state(posture)
        self.state = self._start.copy()
        self._grip = np.where(resting & ~held, FRICTION_SHARE * normal_strength, 0.0)
        self._elastic = np.array([DISC_STIFFNESS.get(n.split("_")[0], 0.0) for n in chain.names])
        table[:, ELASTIC] = self._elastic
        # What rests on furniture does not drift by the tension of resting muscles.
        table[:, SLACK] = model.isometric_torques(posture, model.table[:, kernel.LEAST])
        self._controller = MuscleController(
            model, inertia, normal_strength=normal_strength, limits=limits
        )
        axial = ("spine", "neck", "head")
        self._is_axial = np.array([name.startswith(axial) for name in chain.names], np.bool_)
        self._laid, self._resting = resting, resting.copy()
        self._carried = self._bears = table[:, CARRIED].copy()
        self._beyond = _descendants(chain.arrays.parents)
        self._is_pursuing = True  # until the first command they hold still
        self._tick = 0
        self._muscles = kernel.make_muscles(table, chain.arrays.parents, model.layout, model.table)
        self._measured, self._out = np.zeros((2, count)), np.zeros(count)

    def _take_actions(self, excitation: Excitation, groups: Mapping[str, Sequence[int]]) -> None:
        """Set up what an action is; `_source` says which of its values excites each muscle."""
        self._is_posture = excitation == "posture"
        self.action_low = -1.0 if self._is_posture else 0.0
        self.action_names = self._targets.action_names
        self._source = np.arange(len(self.model.units))
        if self._is_posture:
            return
        if excitation == "group":
            for k, members in enumerate(groups.values()):
                self._source[list(members)] = k
        names = groups if excitation == "group" else self.model.names
        self.action_names = tuple(f"{name} [excitation]" for name in names)

    def reset(self, rng: np.random.Generator, gravity: Array) -> None:
        self.target[:] = self._table[:, POSTURE] = self._posture
        self._table[:, GRIP] = self._grip
        self._resting[:] = self._laid
        self.state[:] = self._start
        self.excitation[:] = 0.0
        self._is_pursuing, self._tick = True, 0
        if self._shaking is not None:
            self._shaking.reset(rng)
        # Lengths, moment arms and weights in the start posture, without any time passing.
        self._measured[0], self._measured[1] = self._posture, 0.0
        step = gravity, self.state, 0.0, self.model.mode
        _observe(self._muscles, self._measured, self.excitation, *step)
        self._table[:, BORNE] = borne = self._muscles.work[:, WEIGHT]
        # A backrest pushes forwards only.
        self._bears = np.where(self._is_axial & (borne <= 0.0), 0.0, self._carried)
        self._table[:, CARRIED] = self._bears

    def lay(self, index: int, angle: float) -> None:
        self.target[index] = self._table[index, POSTURE] = angle

    def command(self, action: Array, duration: float) -> None:
        self._is_pursuing = self._is_posture
        if not self._is_posture:
            self.excitation[:] = action[self._source]
            return
        self._targets.move(action, duration)
        wanted = np.abs(self.target - self._table[:, POSTURE]) > LIFTED
        for i in np.flatnonzero(wanted & self._resting):
            self._lift(int(i))
        self._table[self._uncrossed, POSTURE] = self.target[self._uncrossed]

    def _lift(self, dof: int) -> None:
        """Let a limb and what hangs on it leave the furniture: from now on muscles hold it."""
        beyond = self._beyond[dof]
        if self._resting[beyond].any():
            self._resting[beyond] = False
            self._table[beyond, GRIP] = self._table[beyond, CARRIED] = 0.0
            self._table[dof, CARRIED] = self._bears[dof]

    def action_towards(self, angles: Mapping[str, float], duration: float) -> Array:
        if self._is_posture:
            return self._targets.action_towards(angles, duration)
        felt = self._feel()
        target = felt.positions.copy()
        for dof, angle in angles.items():
            i = self.names.index(dof)
            target[i] += min(max(angle - target[i], -LEAD), LEAD)
            felt.resting[self._beyond[i]] = False
        excitation = self.excitation.copy()
        self._controller.solve(target, felt, excitation, hold=duration)
        count = np.bincount(self._source)
        return np.bincount(self._source, weights=excitation) / count

    def slack_action(self, duration: float) -> Array:
        if not self._is_posture:
            return np.zeros(len(self.action_names))
        felt = self._feel()
        give = self._controller.slack_target(felt, duration) - self.target
        action = np.clip(give / (MAX_SPEED * duration), -1.0, 1.0)
        return np.where(felt.resting, 0.0, action)

    def _feel(self) -> Felt:
        """Return the body after the last physics step."""
        muscles, (positions, velocities) = self._muscles, self._measured
        moved = np.abs(positions - self._table[:, POSTURE])
        passive = muscles.torques[1] - self._elastic * positions
        load = muscles.work[:, WEIGHT] * (1.0 - muscles.work[:, HELD]) - passive
        resting = self._resting & (moved < REST_REACH)
        return Felt(positions, velocities, load, muscles.arms, self.state, resting)

    @property
    def strength(self) -> Array:
        """Greatest torque against and along each DoF in the start posture [N·m], shape [n, 2]."""
        pull = self._start[kernel.CAPACITY] * self._rested
        arms = self.model.moment_arms(self._posture)
        return np.column_stack((np.maximum(-arms, 0.0).T @ pull, np.maximum(arms, 0.0).T @ pull))

    def muscle_torques(self) -> Array:
        """Return what the muscles willed in the last physics step [N·m], shape [n]."""
        return self._muscles.torques[2].copy()

    def weaken(self, fresh: Array) -> None:
        layout = self.model.layout
        starts, dofs = layout.starts[:-1, 1], layout.crossings[:-1, 0]
        # The tiredest region that a muscle crosses tells.
        self.model.table[:, kernel.VOLUNTARY] = self._rested * np.minimum.reduceat(
            fresh[dofs], starts
        )

    def observables(self) -> Sequence[Observable]:
        state, count = self.state, len(self.model.units)
        pursued = Observable("joint_target", "rad", len(self.names), lambda: self.target)
        return [
            *([pursued] if self._is_posture else []),
            Observable("muscle_activation", "1", count, lambda: state[kernel.ACTIVATION]),
            Observable("muscle_length", "m", count, lambda: state[kernel.LENGTH]),
            Observable(
                "muscle_force", "N", count, lambda: state[kernel.ACTIVE] + state[kernel.PASSIVE]
            ),
        ]

    def torques(
        self, positions: list[float], velocities: list[float], gravity: Array
    ) -> list[float]:
        self._measured[0], self._measured[1] = positions, velocities
        if self._is_pursuing and self._tick % CONTROL_INTERVAL == 0:
            self._controller.solve(self.target, self._feel(), self.excitation)
        self._tick += 1
        excitation = self.excitation
        if self._shaking is not None:
            excitation = np.clip(excitation + self._shaking.after(self._dt), 0.0, 1.0)
        step = gravity, self.state, self._dt, self.model.mode, self._out
        _drive(self._muscles, self._measured, excitation, *step)
        return self._out.tolist()


def _set_ligaments(
    table: Array, passive: Array, normal_strength: Array, model: MuscleModel, posture: Array
) -> None:
    """Write where ligaments tighten, and to what."""
    table[:, LEAST], table[:, MOST] = passive.T
    width = np.maximum(passive[:, 1] - passive[:, 0], 1e-3)
    table[:, ZONE] = np.minimum(LIGAMENT_ZONE, LIGAMENT_SHARE * width)
    pulls = np.abs(model.moment_arms(posture)).T @ model.table[:, kernel.FORCE]
    table[:, LIGAMENT] = np.maximum(normal_strength, pulls)


def _descendants(parents: npt.NDArray[np.int64]) -> list[list[int]]:
    """Return for each part itself and all that hangs on it."""
    out: list[list[int]] = [[i] for i in range(len(parents))]
    for i in range(len(parents) - 1, -1, -1):
        if parents[i] >= 0:
            out[parents[i]].extend(out[i])
    return out


@numba.njit(cache=True, error_model="numpy")
def _observe(muscles, measured, excitation, gravity, state, dt, mode) -> None:  # type: ignore[no-untyped-def]
    """Find lengths, moment arms, tensions, torques, weights and the mass matrix after `dt` [s].

    With a `dt` of 0 no time passes: activations and the state of tendons stay.
    """
    kernel.advance(muscles, measured[0], measured[1], excitation, state, dt, mode)
    place_masses(muscles.parts, muscles.work)
    mass_matrix(muscles.parents, muscles.depths, gravity, muscles.work, muscles.matrix)


@numba.njit(cache=True, error_model="numpy")
def _drive(muscles, measured, excitation, gravity, state, dt, mode, out) -> None:  # type: ignore[no-untyped-def]
    """Write the torque of each DoF into `out`."""
    _observe(muscles, measured, excitation, gravity, state, dt, mode)
    table, work, torques = muscles.parts, muscles.work, muscles.torques
    depths, matrix = muscles.depths, muscles.matrix
    _fade(table, measured, torques)
    _tighten(table, measured, torques)
    for i in range(table.shape[0]):
        velocity, support = measured[1, i], _support(table, measured, work, i, dt)
        work[i, HELD] = support
        stiffness, damping = table[i, STIFFNESS], table[i, DAMPING]
        loose = table[i, TISSUE] + torques[3, i] + dt * torques[5, i]
        ahead = measured[0, i] + dt * velocity
        out[i] = torques[1, i] + torques[2, i] + torques[4, i] - loose * velocity
        held = stiffness * (table[i, POSTURE] - ahead) - damping * velocity - table[i, SLACK]
        out[i] += support * held
        out[i] -= (1.0 - support) * work[i, WEIGHT]
        matrix[i, depths[i]] += dt * (loose + support * (damping + dt * stiffness))
    _continue(muscles, state, out)
    solve(muscles.parents, depths, matrix, out)
    for i in range(table.shape[0]):
        torques[0, i] = out[i]  # the acceleration, for `_settle`
        support, after = work[i, HELD], measured[1, i] + dt * out[i]
        there = measured[0, i] + dt * after
        held = work[i, WEIGHT] + table[i, STIFFNESS] * (table[i, POSTURE] - there)
        held -= table[i, DAMPING] * after + table[i, SLACK]
        out[i] = torques[1, i] + torques[2, i] + torques[4, i] + support * held
        out[i] -= (table[i, TISSUE] + torques[3, i] + dt * torques[5, i]) * after
    _settle(muscles, state, out)


@numba.njit(cache=True, error_model="numpy")
def _support(table, measured, work, i, dt):  # type: ignore[no-untyped-def]
    """Return whether furniture holds a limb now: 1.0 or 0.0."""
    if table[i, SUPPORT] != 0.0:
        return 1.0
    weight, gap = work[i, WEIGHT], table[i, POSTURE] - measured[0, i] - dt * measured[1, i]
    push = weight + table[i, STIFFNESS] * gap - table[i, DAMPING] * measured[1, i]
    push -= table[i, SLACK]
    extra = push + table[i, SLACK] - table[i, BORNE]  # beyond what it has borne from the start
    if abs(extra) < table[i, GRIP] and abs(gap) < GRIP_REACH:  # friction
        return 1.0
    # What lies behind bears whom it bore at the start, not who leans to the other side.
    is_carried = table[i, CARRIED] != 0.0 and weight * table[i, BORNE] > 0.0
    sags = is_carried and weight * gap >= -abs(weight) * CARRY_GAP
    return 1.0 if sags and push * weight > 0.0 else 0.0


@numba.njit(cache=True, error_model="numpy")
def _fade(table, measured, torques) -> None:  # type: ignore[no-untyped-def]
    """Let active torque end at the active range, and damp the movement that it made."""
    for i in range(table.shape[0]):
        torque = torques[0, i]
        if torque > 0.0:
            left = (table[i, HIGHEST] - measured[0, i]) / ACTIVE_END
        else:
            left = (measured[0, i] - table[i, LOWEST]) / ACTIVE_END
        share = min(max(left, 0.0), 1.0)
        torques[2, i] = share * torque
        is_outward = measured[1, i] * torque > 0.0
        torques[3, i] = ACTIVE_END_DAMPING * (1.0 - share) * abs(torque) if is_outward else 0.0


@numba.njit(cache=True, error_model="numpy")
def _tighten(table, measured, torques) -> None:  # type: ignore[no-untyped-def]
    """Find what discs do everywhere, and ligaments near the ends of the passive range."""
    for i in range(table.shape[0]):
        zone, torques[4, i] = table[i, ZONE], -table[i, ELASTIC] * measured[0, i]
        torques[5, i] = table[i, ELASTIC]
        over = 1.0 - (table[i, MOST] - measured[0, i]) / zone
        under = 1.0 - (measured[0, i] - table[i, LEAST]) / zone
        depth = max(over, under)
        if depth <= 0.0:
            continue
        stiffness = 2.0 * table[i, LIGAMENT] * depth / zone
        torques[4, i] += table[i, LIGAMENT] * depth * depth * (-1.0 if over > under else 1.0)
        torques[5, i] += stiffness
        torques[3, i] += 2.0 * np.sqrt(stiffness * table[i, INERTIA])


@numba.njit(cache=True, error_model="numpy")
def _continue(muscles, state, out) -> None:  # type: ignore[no-untyped-def]
    """Add to the torques what tensions grow by at the present rates, and to the matrix the rest."""
    starts, crossings, arms = muscles.starts, muscles.crossings, muscles.arms
    depths, matrix = muscles.depths, muscles.matrix
    for m in range(starts.shape[0] - 1):
        growth, implicit = state[kernel.GROWTH, m], state[kernel.IMPLICIT, m]
        first, last = starts[m, 1], starts[m + 1, 1]
        reach = 0.0
        for c in range(first, last):
            i = crossings[c, 0]
            out[i] += arms[c] * growth
            reach += abs(arms[c])
        for c in range(first, last):
            i, lever = crossings[c, 0], arms[c] * implicit
            if muscles.is_branched[
                m
            ]:  # a bound, on the diagonal: the factorisation knows branches only
                matrix[i, depths[i]] += abs(lever) * reach
                continue
            for d in range(first, c + 1):
                matrix[i, depths[crossings[d, 0]]] += lever * arms[d]


@numba.njit(cache=True, error_model="numpy")
def _settle(muscles, state, out) -> None:  # type: ignore[no-untyped-def]
    """Add to the torques what tensions change by over the step."""
    starts, crossings, arms = muscles.starts, muscles.crossings, muscles.arms
    acceleration = muscles.torques[0]
    for m in range(starts.shape[0] - 1):
        first, last = starts[m, 1], starts[m + 1, 1]
        growth, implicit = state[kernel.GROWTH, m], state[kernel.IMPLICIT, m]
        bend = reach = 0.0
        for c in range(first, last):
            bend += arms[c] * acceleration[crossings[c, 0]]
            reach += abs(arms[c])
        for c in range(first, last):
            i = crossings[c, 0]
            if muscles.is_branched[m]:
                out[i] += arms[c] * growth - abs(arms[c]) * reach * implicit * acceleration[i]
            else:
                out[i] += arms[c] * (growth - implicit * bend)
