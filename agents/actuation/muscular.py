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
of the eyes, is held where the person is told to have it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rcare_marl.observable import Observable

from . import closed_loop as loop
from . import muscle_kernel as kernel
from .chain import Chain
from .disorder import Shaking
from .dynamics import (
    SCRATCH_COLUMNS,
    WEIGHT,
    packed_matrix,
    part_table,
    tree_depths,
)
from .muscle_control import MuscleController
from .muscle_model import MuscleModel
from .skeletal import (
    MAX_FREQUENCY,
    MAX_SPEED,
    STIFFNESS_PER_TORQUE,
    TISSUE_DAMPING_PER_TORQUE,
)

Array = npt.NDArray[np.float64]

# Our own choices.
LIGAMENT_ZONE = 0.05  # [rad] before the end of the passive range where ligaments tighten ...
LIGAMENT_SHARE = 0.3  # ... or this share of a narrower range
# [N·m/rad] of bending, without muscles. A lumbar segment has some 1 to 2 N·m per degree, from memory;
# one joint here stands for several in a row, stiffened by the weight on them.
DISC_STIFFNESS = {"spine1": 60.0, "spine2": 60.0, "spine3": 60.0, "neck": 6.0, "head": 6.0}
FRICTION_SHARE = 0.1  # of normal torque: less than this does not move a limb that rests
SAME_ACTION = 1e-5  # difference of excitations that are still those that were proposed
CONTROL_INTERVAL = 4  # physics steps between two looks of the controller: 60 Hz at 1/240 s


@dataclass(frozen=True, eq=False)
class _Proposal:
    """What `action_towards` found: the action, and what the drive does if it is commanded."""

    action: Array
    target: Array
    excitation: Array
    wished: list[int]


class MuscleDrive:
    """Torques of a person's moving DoFs from excitations of muscles: an `Actuation`.

    An action is one excitation in [0, 1] for each muscle that crosses a moving DoF, or for each named
    group of such muscles. `action_towards` proposes excitations that pursue joint angles; where these
    are then commanded, a loop through the spine goes on improving them between control steps. So an
    action that a policy proposed is more than the same numbers from elsewhere, which are just held.

    Attributes:
        names: The moving DoFs.
        target: Angle that each DoF pursues where the person is told to [rad], shape [n].
        model: The muscles, m of them.
        state: Their state, shape [STATE_ROWS, m]; rows are named in `muscle_kernel.py`.
        excitation: What each muscle is told now, shape [m].
    """

    action_low = 0.0

    def __init__(
        self,
        chain: Chain,
        model: MuscleModel,
        *,
        groups: Mapping[str, Sequence[int]] | None,
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
            groups: Muscles of each named group, where an action is by group.
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
        table = part_table(chain, loop.COLUMNS)
        table[:, loop.STIFFNESS] = np.minimum(
            STIFFNESS_PER_TORQUE * normal_strength, inertia * MAX_FREQUENCY**2
        )
        table[:, loop.DAMPING] = 2 * np.sqrt(table[:, loop.STIFFNESS] * inertia)
        table[:, loop.TISSUE] = TISSUE_DAMPING_PER_TORQUE * normal_strength
        uncrossed = np.ones(count, np.bool_)
        uncrossed[model.layout.crossings[:-1, 0]] = False
        self._uncrossed = np.flatnonzero(uncrossed & willed)
        held = supported | uncrossed
        table[:, loop.SUPPORT], table[:, loop.CARRIED] = held, carried & ~held
        table[:, loop.LOWEST], table[:, loop.HIGHEST] = limits.T
        table[:, loop.POSTURE], table[:, loop.INERTIA] = posture, inertia
        _tighten(table, passive, normal_strength, model, posture)
        self._table = table
        self.target, self._posture = posture.copy(), posture.copy()
        self._index = {dof: i for i, dof in enumerate(chain.names)}
        self._groups = [np.array(members, np.int64) for members in (groups or {}).values()]
        self.action_names = tuple(f"{name} [excitation]" for name in (groups or model.names))
        self._is_grouped = groups is not None
        self.excitation = np.zeros(len(model.units))
        self._rested = model.table[:, kernel.VOLUNTARY].copy()
        self._start = model.settled_state(posture)
        self.state = self._start.copy()
        self._grip = np.where(resting & ~held, FRICTION_SHARE * normal_strength, 0.0)
        self._elastic = np.array([DISC_STIFFNESS.get(n.split("_")[0], 0.0) for n in chain.names])
        table[:, loop.ELASTIC] = self._elastic
        # What rests on furniture does not drift by the tension of resting muscles.
        table[:, loop.SLACK] = model.isometric_torques(posture, model.table[:, kernel.LEAST])
        self._controller = MuscleController(
            model, inertia, normal_strength=normal_strength, limits=limits
        )
        axial = ("spine", "neck", "head")
        self._is_axial = np.array([name.startswith(axial) for name in chain.names], np.bool_)
        self._laid, self._resting = resting, resting.copy()
        self._carried = self._bears = table[:, loop.CARRIED].copy()
        self._beyond = _descendants(chain.parents)
        self._proposal: _Proposal | None = None
        self._is_pursuing, self._is_raw = True, False  # until the first command they hold still
        self._tick = 0
        self._make_room(chain)

    def _make_room(self, chain: Chain) -> None:
        """Set up what the kernel writes into."""
        count, layout = len(chain.names), self.model.layout
        self._measured = np.zeros((2, count))
        self._work = np.zeros((count, SCRATCH_COLUMNS))
        self._frames = np.zeros((count + 1, kernel.FRAME_COLUMNS))
        self._frames[0, :9] = np.eye(3).ravel()
        self._spots = np.zeros((layout.longest, kernel.SPOT_COLUMNS))
        self._arms = np.zeros(len(layout.crossings) - 1)
        self._torques = np.zeros((6, count))
        self._depths = tree_depths(chain.parents)
        self._matrix = packed_matrix(chain.parents)
        self._out = np.zeros(count)

    def reset(self, rng: np.random.Generator, gravity: Array) -> None:
        self.target[:] = self._table[:, loop.POSTURE] = self._posture
        self._table[:, loop.GRIP] = self._grip
        self._resting[:] = self._laid
        self.state[:] = self._start
        self.excitation[:] = 0.0
        self._proposal, self._tick = None, 0
        self._is_pursuing, self._is_raw = True, False
        if self._shaking is not None:
            self._shaking.reset(rng)
        self._look(gravity)
        self._table[:, loop.BORNE] = borne = self._work[:, WEIGHT]
        # A backrest pushes forwards only.
        self._bears = np.where(self._is_axial & (borne <= 0.0), 0.0, self._carried)
        self._table[:, loop.CARRIED] = self._bears

    def lay(self, index: int, angle: float) -> None:
        self.target[index] = self._table[index, loop.POSTURE] = angle

    def command(self, action: Array, duration: float) -> None:
        """Excite the muscles, each value in [0, 1].

        An action that `action_towards` has just proposed is pursued by the loop through the spine.
        """
        proposal, self._proposal = self._proposal, None
        self._is_pursuing = proposal is not None and bool(
            np.abs(action - proposal.action).max(initial=0.0) < SAME_ACTION
        )
        self._is_raw = not self._is_pursuing
        if self._is_raw or proposal is None:
            self._excite(action)
            return
        self.target[:] = proposal.target
        self.excitation[:] = proposal.excitation
        for i in proposal.wished:
            self._lift(i)
        self._table[self._uncrossed, loop.POSTURE] = self.target[self._uncrossed]

    def _lift(self, dof: int) -> None:
        """Let a limb and what hangs on it leave the furniture: from now on muscles hold it."""
        beyond = self._beyond[dof]
        if self._resting[beyond].any():
            self._resting[beyond] = False
            self._table[beyond, loop.GRIP] = self._table[beyond, loop.CARRIED] = 0.0
            self._table[dof, loop.CARRIED] = self._bears[dof]

    def _excite(self, action: Array) -> None:
        if not self._is_grouped:
            self.excitation[:] = action
            return
        for value, members in zip(action, self._groups, strict=True):
            self.excitation[members] = value

    def action_towards(self, angles: Mapping[str, float], duration: float) -> Array:
        # Who has moved otherwise in between sets out from where they are.
        target = self._measured[0].copy() if self._is_raw else self.target.copy()
        wished = [self._index[dof] for dof in angles]
        reach = MAX_SPEED * duration
        for i, angle in zip(wished, angles.values(), strict=True):
            target[i] += min(max(angle - target[i], -reach), reach)
        np.clip(target, self._table[:, loop.LOWEST], self._table[:, loop.HIGHEST], out=target)
        resting, excitation = self._resting.copy(), self.excitation.copy()
        for i in wished:
            resting[self._beyond[i]] = False
        self._pursue(target, resting, excitation)
        action = excitation.copy()
        if self._is_grouped:
            action = np.array([excitation[members[0]] for members in self._groups])
        self._proposal = _Proposal(action, target, excitation, wished)
        return action.copy()

    def _pursue(self, target: Array, resting: npt.NDArray[np.bool_], excitation: Array) -> None:
        """Improve excitations that pursue a target, from what the last physics step found."""
        self._controller.solve(
            target, self._measured[0], self._measured[1], self._work[:, WEIGHT] *
            (1.0 - self._work[:, loop.HELD]), self._arms, self.state,
            self._torques[1] - self._elastic * self._measured[0], resting,
            excitation,
        )  # fmt: skip
        for members in self._groups:
            excitation[members] = excitation[members].mean()

    @property
    def strength(self) -> Array:
        """Greatest torque against and along each DoF in the start posture [N·m], shape [n, 2]."""
        pull = self._start[kernel.CAPACITY] * self._rested
        arms = self.model.moment_arms(self._posture)
        return np.column_stack((np.maximum(-arms, 0.0).T @ pull, np.maximum(arms, 0.0).T @ pull))

    def muscle_torques(self) -> Array:
        """Return what the muscles willed in the last physics step [N·m], shape [n]."""
        return self._torques[2].copy()

    def weaken(self, fresh: Array) -> None:
        layout = self.model.layout
        starts, dofs = layout.starts[:-1, 1], layout.crossings[:-1, 0]
        # The tiredest region that a muscle crosses tells.
        self.model.table[:, kernel.VOLUNTARY] = self._rested * np.minimum.reduceat(
            fresh[dofs], starts
        )

    def observables(self) -> Sequence[Observable]:
        state, count = self.state, len(self.model.units)
        return [
            Observable("muscle_activation", "1", count, lambda: state[kernel.ACTIVATION]),
            Observable("muscle_length", "m", count, lambda: state[kernel.LENGTH]),
            Observable(
                "muscle_force", "N", count, lambda: state[kernel.ACTIVE] + state[kernel.PASSIVE]
            ),
        ]

    def _look(self, gravity: Array) -> None:
        """Find lengths, moment arms and weights in the start posture, without any time passing."""
        self._measured[0], self._measured[1] = self._posture, 0.0
        layout = self.model.layout
        loop.observe(
            self._table, self.model.parents, self._depths, layout.points, layout.pulleys, layout.carriers,
            layout.starts, layout.crossings, layout.entries, self.model.table, self._measured,
            self.excitation, gravity, self.state, 0.0, self.model.mode, self._work, self._frames,
            self._spots, self._arms, self._torques, self._matrix,
        )  # fmt: skip

    def torques(
        self, positions: list[float], velocities: list[float], gravity: Array
    ) -> list[float]:
        self._measured[0], self._measured[1] = positions, velocities
        if self._is_pursuing and self._tick % CONTROL_INTERVAL == 0:
            self._pursue(self.target, self._resting, self.excitation)
        self._tick += 1
        excitation = self.excitation
        if self._shaking is not None:
            excitation = np.clip(excitation + self._shaking.after(self._dt), 0.0, 1.0)
        layout = self.model.layout
        loop.drive(
            self._table, self.model.parents, self._depths, layout.points, layout.pulleys, layout.carriers,
            layout.starts, layout.crossings, layout.entries, layout.is_branched, self.model.table,
            self._measured, excitation, gravity, self.state, self._dt, self.model.mode, self._work,
            self._frames, self._spots, self._arms, self._torques, self._matrix, self._out,
        )  # fmt: skip
        result: list[float] = self._out.tolist()
        return result


def _tighten(
    table: Array, passive: Array, normal_strength: Array, model: MuscleModel, posture: Array
) -> None:
    """Write where ligaments tighten, and to what."""
    table[:, loop.LEAST], table[:, loop.MOST] = passive.T
    width = np.maximum(passive[:, 1] - passive[:, 0], 1e-3)
    table[:, loop.ZONE] = np.minimum(LIGAMENT_ZONE, LIGAMENT_SHARE * width)
    pulls = np.abs(model.moment_arms(posture)).T @ model.table[:, kernel.FORCE]
    table[:, loop.LIGAMENT] = np.maximum(normal_strength, pulls)


def _descendants(parents: npt.NDArray[np.int64]) -> list[list[int]]:
    """Return for each part itself and all that hangs on it."""
    out: list[list[int]] = [[i] for i in range(len(parents))]
    for i in range(len(parents) - 1, -1, -1):
        if parents[i] >= 0:
            out[parents[i]].extend(out[i])
    return out
