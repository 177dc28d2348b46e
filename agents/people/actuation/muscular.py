"""The muscular drive: joint torques from excitations of Hill muscles.

Each physics step finds paths, activations and tensions, and the torques that they make by virtual work.
Muscles are stiff and damp strongly for the light parts of a body, so tension is taken at the end of
the coming step: it is continued with the rate and the acceleration of each path's length, and the
accelerations are found with the mass matrix of all moving parts, as in `skeletal.py`. (A linearly
implicit step; so 1/240 s is stable for a finger under full contraction.)

Discs of the spine resist bending. Ligaments tighten over the last few degrees of the passive range, to
what the muscles can pull with at its end; the hard stop there is the physics engine's.

What a person wills ends at the limit of each motion, which its grade of strength sets whichever muscles
make it (`graded.py`), and at the active range: the net willed torque that would lead further out fades over
the last few degrees. Passive movement by others goes on to the end of the passive range. Reflexes know
neither end.

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

import numpy as np
import numpy.typing as npt

from rcare_marl.observable import Observable
from rcare_marl.pose import Array
from rcare_marl.tree.dynamics import WEIGHT, part_table
from rcare_marl.tree.joint_tree import JointTree

from . import muscle_dynamics as dynamics
from . import muscle_kernel as kernel
from .actuation import MAX_SPEED, Shaking, TargetAngles
from .joint_tissue import damping_beside_muscles, joint_damping
from .muscle_control import DAMPING_RATIO, FREQUENCY, Felt, MuscleController
from .muscle_model import MuscleModel
from .skeletal import BRACING, impedance
from .stretch_reflex import StretchReflex, excite, reflex_capacity, reflex_paths

# Our own choices.
LIGAMENT_ZONE = 0.05  # [rad] before the end of the passive range where ligaments tighten ...
LIGAMENT_SHARE = 0.3  # ... or this share of a narrower range
# [N·m/rad] of bending, without muscles. A lumbar segment has some 1 to 2 N·m per degree, from memory;
# one joint here stands for several in a row, stiffened by the weight on them.
DISC_STIFFNESS = {"spine1": 60.0, "spine2": 60.0, "spine3": 60.0, "neck": 6.0, "head": 6.0}
# [N·m/rad]: atlas on axis turns 56.7° from side to side (Panjabi et al. 2001) by 1 N·m to either (from
# memory), and the joints below it together about as much (from memory).
TURNING_STIFFNESS = {"neck_rotation_left": 2.0, "head_rotation_left": 2.0}
FRICTION_SHARE = 0.1  # of normal torque: less than this does not move a limb that rests
# Of the model's resting activation: a relaxed muscle is silent (the model's is a habit of solvers).
RELAXED = 0.1
CONTROL_INTERVAL = 4  # physics steps between two looks of the controller: 60 Hz at 1/240 s
# [s] by which muscles follow what they are told. Damping of what was felt is held to what this delay allows:
# more would throw light parts about, and an arm that hangs against its girdle: both turn about one axis.
LAG = 0.03
LIFTED = 1e-3  # [rad] of a pursued angle from where the limb was laid: the person wants to move it
REST_REACH = 0.05  # [rad] from where a limb was laid down: further away it rests no longer
# [rad] from where a limb is to where excitations alone should bring it: at this the spring of the
# controller moves it with about MAX_SPEED.
LEAD = MAX_SPEED * 2 * DAMPING_RATIO / FREQUENCY

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
        motion_limits: Array | None = None,
        reflex: StretchReflex | None = None,
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
            motion_limits: Greatest net torque that is willed against and along each axis [N·m], and the share
                of passive resistance that is overcome besides, shape [2, n, 2]; none if None.
            reflex: What answers stretch; nothing if None.
            shaking: Involuntary excitation of the muscles.
        """
        count = len(chain.names)
        self.names, self.model = chain.names, model
        self._dt, self._shaking = physics_dt, shaking
        inertia = np.diag(chain.mass_matrix(posture))
        table = part_table(chain.arrays, dynamics.COLUMNS)
        model.table[:, kernel.LEAST] *= RELAXED
        table[:, dynamics.STIFFNESS : dynamics.DAMPING + 1] = impedance(normal_strength, inertia)
        damping = joint_damping(chain.names, normal_strength, inertia)
        damping = damping_beside_muscles(model, posture, damping)
        self._most = _set_motion_limits(table, motion_limits)
        part = np.minimum(self._most.min(axis=1) / normal_strength, 1.0) ** 0.25 * willed
        self._relaxed, self._braced = damping, damping + BRACING * normal_strength * part
        uncrossed = np.ones(count, np.bool_)
        uncrossed[model.layout.crossed] = False
        self._uncrossed = np.flatnonzero(uncrossed & willed)
        held = supported | uncrossed
        table[:, dynamics.SUPPORT], table[:, dynamics.CARRIED] = held, carried & ~held
        table[:, dynamics.LOWEST], table[:, dynamics.HIGHEST] = limits.T
        table[:, dynamics.POSTURE], table[:, dynamics.INERTIA] = posture, inertia
        _set_ligaments(table, passive, normal_strength, model, posture)
        self._table = table
        self._targets = TargetAngles(chain.names, posture.copy(), limits)
        self._posture, self.target = posture.copy(), self._targets.values
        self._take_actions(excitation, groups)
        self.excitation = np.zeros(len(model.units))
        self._take_will(reflex, passive)
        self._grip = np.where(resting & ~held, FRICTION_SHARE * normal_strength, 0.0)
        self._elastic = table[:, dynamics.ELASTIC].copy()
        self._controller = MuscleController(
            model, inertia, self._voluntary, normal_strength=normal_strength, limits=limits
        )
        self._lie_down(resting)
        self._beyond = _descendants(chain.arrays.parents)
        # Until the first command they hold still.
        self._is_slack, self._is_pursuing, self._tick = False, True, 0
        self._muscles = kernel.make_muscles(table, chain.arrays.parents, model.layout, model.table)
        self._measured, self._out = np.zeros((2, count)), np.zeros(count)
        self._gravity, self._look = np.zeros(3), CONTROL_INTERVAL * physics_dt + LAG

    def _lie_down(self, resting: npt.NDArray[np.bool_]) -> None:
        """Set up what lies on furniture, and what that bears."""
        axial = ("spine", "neck", "head")
        self._is_axial = np.array([name.startswith(axial) for name in self.names], np.bool_)
        self._laid, self._resting = resting, resting.copy()
        self._carried = self._bears = self._table[:, dynamics.CARRIED].copy()

    def _take_will(self, reflex: StretchReflex | None, passive: Array) -> None:
        """Set up how will and reflexes excite; will is scaled here, to the kernel all muscles obey."""
        model = self.model
        self._rested = model.table[:, kernel.VOLUNTARY].copy()
        self._voluntary = self._rested.copy()
        model.table[:, kernel.VOLUNTARY] = 1.0
        self._reflex = reflex
        paths = reflex_paths(model, self._posture)
        self._reflex_paths = paths[:0]
        if reflex is not None:
            self._reflex_paths = paths = paths[reflex.answers[paths[:, 1], paths[:, 2]]]
            reflex.excite_by(reflex_capacity(model, self._posture, passive, paths))
        self._told, self._involuntary = np.zeros((2, len(model.units)))
        self._no_share = np.zeros((len(self.names), 2))
        self._start = model.settled_state(self._posture)
        self.state = self._start.copy()

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
        self.target[:] = self._table[:, dynamics.POSTURE] = self._posture
        self._table[:, dynamics.GRIP] = self._grip
        self._resting[:] = self._laid
        self.state[:] = self._start
        self.excitation[:] = 0.0
        self._is_pursuing, self._tick = True, 0
        self._involuntary[:] = 0.0
        if self._shaking is not None:
            self._shaking.reset(rng)
        if self._reflex is not None:
            self._reflex.reset()
        self._is_slack = False
        self._brace()
        # Lengths, moment arms and weights in the start posture, without any time passing.
        self._measured[0], self._measured[1] = self._posture, 0.0
        self._muscles.work[:, dynamics.HELD] = 0.0  # nor what the last episode's furniture held
        self._gravity[:] = gravity
        step = gravity, self.state, 0.0, self.model.mode
        dynamics.observe(self._muscles, self._measured, self._told, *step)
        self._table[:, dynamics.BORNE] = borne = self._muscles.work[:, WEIGHT]
        # A backrest pushes forwards only.
        self._bears = np.where(self._is_axial & (borne <= 0.0), 0.0, self._carried)
        self._table[:, dynamics.CARRIED] = self._bears

    def lay(self, index: int, angle: float) -> None:
        self.target[index] = self._table[index, dynamics.POSTURE] = angle

    def command(self, action: Array, duration: float) -> None:
        self._is_pursuing = self._is_posture
        if self._is_slack and self._is_posture:  # whoever begins to move again begins here
            self.target[:] = self._measured[0]
        self._is_slack = False
        self._brace()
        if not self._is_posture:
            self.excitation[:] = action[self._source]
            return
        self._targets.move(action, duration)
        wanted = np.abs(self.target - self._table[:, dynamics.POSTURE]) > LIFTED
        for i in np.flatnonzero(wanted & self._resting):
            self._lift(int(i))
        self._table[self._uncrossed, dynamics.POSTURE] = self.target[self._uncrossed]

    def _brace(self) -> None:
        """Let the joints of whoever pursues angles damp, as without muscles."""
        self._table[:, dynamics.TISSUE] = self._braced if self._is_posture else self._relaxed

    def relax(self) -> None:
        self._is_slack, self._is_pursuing = True, False
        self._table[:, dynamics.TISSUE] = self._relaxed
        self.excitation[:] = 0.0

    def _lift(self, dof: int) -> None:
        """Let a limb and what hangs on it leave the furniture: from now on muscles hold it."""
        beyond = self._beyond[dof]
        if self._resting[beyond].any():
            self._resting[beyond] = False
            self._table[beyond, dynamics.GRIP] = self._table[beyond, dynamics.CARRIED] = 0.0
            self._table[dof, dynamics.CARRIED] = self._bears[dof]

    def action_towards(self, angles: Mapping[str, float], duration: float) -> Array:
        if self._is_posture:
            return self._targets.action_towards(angles, duration)
        felt = self._feel(duration)
        target = felt.positions.copy()
        for dof, angle in angles.items():
            i = self.names.index(dof)
            target[i] += min(max(angle - target[i], -LEAD), LEAD)
            felt.resting[self._beyond[i]] = False
        excitation = self.excitation.copy()
        self._controller.solve(target, felt, excitation)
        count = np.bincount(self._source)
        return np.bincount(self._source, weights=excitation) / count

    def slack_action(self, duration: float) -> Array:
        if not self._is_posture:
            return np.zeros(len(self.action_names))
        felt = self._feel(self._look)
        give = self._controller.slack_target(felt, duration) - self.target
        action = np.clip(give / (MAX_SPEED * duration), -1.0, 1.0)
        return np.where(felt.resting, 0.0, action)

    def _feel(self, ahead: float) -> Felt:
        """Return the body after the last physics step; what it does takes effect in `ahead` [s]."""
        muscles, (positions, velocities) = self._muscles, self._measured
        damped = velocities.copy()
        dynamics.damped_rates(muscles, self._gravity, self._controller.damping, ahead, damped)
        moved = np.abs(positions - self._table[:, dynamics.POSTURE])
        passive = muscles.torques[1] - self._elastic * positions
        load = muscles.work[:, WEIGHT] * (1.0 - muscles.work[:, dynamics.HELD]) - passive
        resting = self._resting & (moved < REST_REACH)
        most = self._table[:, dynamics.MOST_AGAINST : dynamics.MOST_ALONG + 1]
        over = self._table[:, dynamics.OVER_AGAINST : dynamics.OVER_ALONG + 1]
        able = np.maximum(most + over * np.column_stack((passive, -passive)), 0.0)
        return Felt(positions, velocities, damped, load, muscles.arms, self.state, resting, able)

    @property
    def strength(self) -> Array:
        """Greatest torque against and along each DoF in the start posture [N·m], shape [n, 2]."""
        pull = self._start[kernel.CAPACITY] * self._rested
        arms = self.model.moment_arms(self._posture)
        return np.column_stack((np.maximum(-arms, 0.0).T @ pull, np.maximum(arms, 0.0).T @ pull))

    def compiled(self, gravity: Array) -> None:
        """Return None: excitations are found in Python."""

    def muscle_torques(self) -> Array:
        """Return what the muscles willed in the last physics step [N·m], shape [n]."""
        return self._muscles.torques[2].copy()

    def weaken(self, fresh: Array) -> None:
        layout = self.model.layout
        starts, dofs = layout.starts[:-1, 1], layout.crossed
        # The tiredest region that a muscle crosses tells.
        self._voluntary[:] = self._rested * np.minimum.reduceat(fresh[dofs], starts)
        at_grade_5 = np.isinf(self._most)
        most = np.where(at_grade_5, np.inf, np.where(at_grade_5, 0.0, self._most) * fresh[:, None])
        self._table[:, dynamics.MOST_AGAINST : dynamics.MOST_ALONG + 1] = most

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
        self._gravity[:] = gravity
        if self._is_pursuing and self._tick % CONTROL_INTERVAL == 0:
            self._controller.solve(self.target, self._feel(self._look), self.excitation)
        self._tick += 1
        excitation = self.excitation
        if self._shaking is not None:
            excitation = np.clip(excitation + self._shaking.after(self._dt), 0.0, 1.0)
        share = self._no_share
        if self._reflex is not None:
            self._reflex.feel(*self._measured)
            share = self._reflex.share
        told = self._told, self._involuntary
        excite(self._reflex_paths, share, self._voluntary, excitation, *told)
        step = gravity, self.state, self._dt, self.model.mode, self._out
        dynamics.drive(self._muscles, self._measured, *told, *step)
        return self._out.tolist()


def _set_motion_limits(table: Array, motion_limits: Array | None) -> Array:
    """Write what can be willed about each DoF, and return a copy of the greatest torques, shape [n, 2]."""
    most = table[:, dynamics.MOST_AGAINST : dynamics.MOST_ALONG + 1]
    most[:] = np.inf
    if motion_limits is not None:
        most[:], table[:, dynamics.OVER_AGAINST : dynamics.OVER_ALONG + 1] = motion_limits
    return np.array(most)


def _set_ligaments(
    table: Array, passive: Array, normal_strength: Array, model: MuscleModel, posture: Array
) -> None:
    """Write where ligaments tighten, and to what; how discs resist; what resting muscles pull with."""
    table[:, dynamics.LEAST], table[:, dynamics.MOST] = passive.T
    width = np.maximum(passive[:, 1] - passive[:, 0], 1e-3)
    table[:, dynamics.ZONE] = np.minimum(LIGAMENT_ZONE, LIGAMENT_SHARE * width)
    discs = {n: DISC_STIFFNESS.get(n.split("_")[0], 0.0) for n in model.dofs} | TURNING_STIFFNESS
    table[:, dynamics.ELASTIC] = [discs[n] for n in model.dofs]
    # What rests on furniture does not drift by the tension of resting muscles.
    table[:, dynamics.SLACK] = model.isometric_torques(posture, model.table[:, kernel.LEAST])
    pulls = np.abs(model.moment_arms(posture)).T @ model.table[:, kernel.FORCE]
    table[:, dynamics.LIGAMENT] = np.maximum(normal_strength, pulls)


def _descendants(parents: npt.NDArray[np.int64]) -> list[list[int]]:
    """Return for each part itself and all that hangs on it."""
    out: list[list[int]] = [[i] for i in range(len(parents))]
    for i in range(len(parents) - 1, -1, -1):
        if parents[i] >= 0:
            out[parents[i]].extend(out[i])
    return out
