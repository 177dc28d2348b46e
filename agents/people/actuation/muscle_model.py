"""The muscles of a person as a model: lengths, moment arms, forces and torques, for one or for many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numba
import numpy as np

from rcare_marl.errors import ActionError, ConfigError, check_name
from rcare_marl.pose import Array
from rcare_marl.tree.dynamics import PART_COLUMNS, part_table, place_frames
from rcare_marl.tree.joint_tree import JointTree

from . import muscle_kernel as kernel
from .hill import RESTING_ACTIVATION, SHORTEST, inverse_tendon_force, passive_offset
from .muscle_layout import make_layout
from .muscle_path import find_arms, gather_frames, release_scapulae
from .muscle_unit import MuscleUnit

Tendon = Literal["rigid", "quasi_static", "implicit"]
TENDONS: tuple[Tendon, ...] = get_args(Tendon)


class MuscleModel:
    """Muscles over the moving parts of a person.

    Attributes:
        units: The muscles, m of them.
        names: Their names.
        dofs: The n moving DoFs.
        tendon: `rigid`, `quasi_static` (stretched by the force of the step before) or `implicit`
            (the fibre length is a state, carried on by backward Euler).
        table: Figures of the units for the kernels, shape [m, UNIT_COLUMNS].
        kernel_muscles: What the kernels know of them, and their room to work in.
    """

    def __init__(
        self,
        units: Sequence[MuscleUnit],
        joints: Array,
        chain: JointTree,
        *,
        tendon: Tendon = "quasi_static",
        strength: Array | None = None,
    ) -> None:
        """Lay the muscles over the moving parts.

        Args:
            units: The muscles, fitted to the person.
            joints: The person's joint centres in the T-pose [m], shape [55, 3].
            chain: The moving parts.
            tendon: How the tendon yields.
            strength: Share of full excitation that reaches each unit, shape [m]; 1 if None.

        Raises:
            ConfigError: If there is no muscle, or two of one name.
            UnknownNameError: If the tendon mode does not exist.
        """
        check_name("tendon mode", tendon, TENDONS)
        if not units:
            raise ConfigError("a muscle model needs at least one muscle")
        self.units, self.tendon = tuple(units), tendon
        self.names = tuple(unit.name for unit in self.units)
        self._index = {name: m for m, name in enumerate(self.names)}
        if len(self._index) != len(self.names):
            raise ConfigError("two muscles have one name")
        self.dofs = chain.names
        self.mode = TENDONS.index(tendon)
        self.layout = make_layout(self.units, joints, chain)
        self.parents = chain.arrays.parents
        self.parts = part_table(chain.arrays, PART_COLUMNS)
        self.table = _unit_table(self.units, strength)
        self.kernel_muscles = kernel.make_muscles(self.parts, self.parents, self.layout, self.table)

    def index(self, name: str) -> int:
        """Return the place of a muscle; UnknownNameError if there is none of that name."""
        check_name("muscle", name, self.names)
        return self._index[name]

    def new_state(self) -> Array:
        """Return the state of muscles at rest, shape [STATE_ROWS, m]; give it to `step`."""
        state = np.zeros((kernel.STATE_ROWS, len(self.units)))
        state[kernel.ACTIVATION] = self.table[:, kernel.LEAST]
        state[kernel.TENDON] = 1.0 if self.tendon == "implicit" else 0.0
        return state

    def new_states(self, people: int) -> Array:
        """Return the states of k people's muscles at rest, shape [k, STATE_ROWS, m]."""
        return np.repeat(self.new_state()[None], people, axis=0)

    def settled_state(self, q: Array) -> Array:
        """Return the state of muscles that have rested at `q` [rad] for long, shape [STATE_ROWS, m]."""
        state = self._still(q, self.table[:, kernel.LEAST])
        if self.tendon == "implicit":
            state[kernel.TENDON] = self.fibre_lengths(q, self.table[:, kernel.LEAST])
        return state

    def step(
        self, q: Array, qd: Array, excitation: Array, state: Array, dt: float, out: Array
    ) -> Array:
        """Carry muscles on by one step and return the torques in `out` [N·m], shape [n].

        Args:
            q: Joint angles [rad], shape [n].
            qd: Joint rates [rad/s], shape [n].
            excitation: In [0, 1], shape [m].
            state: From `new_state`; it is changed.
            dt: Time step [s].
            out: Where to write.

        Raises:
            ConfigError: If an array has another shape.
        """
        count, muscles = len(self.dofs), len(self.units)
        wanted = {"q": (q, count), "qd": (qd, count), "out": (out, count)}
        for name, (values, size) in (wanted | {"excitation": (excitation, muscles)}).items():
            _sized(values, size, name)
        _step(self.kernel_muscles, q, qd, excitation, state, dt, self.mode, out)
        return out

    def step_many(
        self, q: Array, qd: Array, excitation: Array, state: Array, dt: float, out: Array
    ) -> Array:
        """Carry the muscles of k people of this body on by one step, without any physics engine.

        People come one after the other in one thread: their frames and paths then stay in the cache of
        one core, and processes side by side, as learning has them, do not fight for the others.

        Args:
            q: Joint angles [rad], shape [k, n].
            qd: Joint rates [rad/s], shape [k, n].
            excitation: In [0, 1], shape [k, m]; it is not checked.
            state: From `new_states`, shape [k, STATE_ROWS, m]; it is changed.
            dt: Time step [s].
            out: Where to write the torques [N·m], shape [k, n].

        Raises:
            ActionError: If an array has a wrong shape.
        """
        people, count, muscles = len(q), len(self.dofs), len(self.units)
        given = {
            "q": (q, (people, count)),
            "qd": (qd, (people, count)),
            "excitation": (excitation, (people, muscles)),
            "state": (state, (people, kernel.STATE_ROWS, muscles)),
            "out": (out, (people, count)),
        }
        for name, (values, shape) in given.items():
            if values.shape != shape:  # the kernel would read beyond the end
                raise ActionError(f"{name} must have shape {shape}, got {values.shape}")
        _step_many(self.kernel_muscles, q, qd, excitation, state, dt, self.mode, out)
        return out

    def lengths(self, q: Array) -> Array:
        """Return the length of each muscle and its tendons at joint angles `q` [rad] [m], shape [m]."""
        return self._at(q)[0]

    def moment_arms(self, q: Array) -> Array:
        """Return -dL/dq of each muscle and DoF at joint angles `q` [rad] [m], shape [m, n]."""
        return self._at(q)[1]

    def glenohumeral_arms(self, q: Array) -> Array:
        """Return `moment_arms` with the shoulder blades held where they are: of specimens, [m, n]."""
        self._at(q)
        muscles = self.kernel_muscles
        release_scapulae(muscles)
        return self._laid_out(muscles.arms)

    def _at(self, q: Array) -> tuple[Array, Array]:
        q = _sized(q, len(self.dofs), "q")
        state, muscles = self.new_state(), self.kernel_muscles
        place_frames(self.parts, self.parents, q, muscles.work)
        gather_frames(muscles)
        find_arms(muscles, np.zeros(len(q)), state)
        return state[kernel.LENGTH].copy(), self._laid_out(muscles.arms)

    def _laid_out(self, crossings: Array) -> Array:
        """Return the moment arms of the crossings by muscle and DoF [m], shape [m, n]."""
        arms = np.zeros((len(self.units), len(self.dofs)))
        owner = np.repeat(np.arange(len(self.units)), np.diff(self.layout.starts[:, 1]))
        arms[owner, self.layout.crossed] = crossings
        return arms

    def isometric_forces(self, q: Array, activation: Array | float) -> Array:
        """Return the tension of each muscle held still at `q` [rad] [N], shape [m].

        The tendon is in balance with the fibres, whichever of the elastic modes the model has.

        Raises:
            ActionError: If an activation lies outside [0, 1].
        """
        return self._still(q, activation)[[kernel.ACTIVE, kernel.PASSIVE]].sum(axis=0)

    def steady_forces(self, q: Array, qd: Array, activation: Array | float) -> Array:
        """Return the tension of each muscle while joints turn steadily, in passing `q` [N], shape [m].

        The tendon is in balance with the fibres and keeps its length, as in an isokinetic test.

        Args:
            q: Joint angles [rad], shape [n].
            qd: Joint rates [rad/s], shape [n].
            activation: In [0, 1], of all or of each, shape [m].

        Raises:
            ActionError: If an activation lies outside [0, 1].
        """
        rates = -self.moment_arms(q) @ _sized(qd, len(self.dofs), "qd")
        return self._still(q, activation, rates)[[kernel.ACTIVE, kernel.PASSIVE]].sum(axis=0)

    def isometric_torques(self, q: Array, activation: Array | float) -> Array:
        """Return the torque about each DoF of muscles held still at `q` [rad] [N·m], shape [n]."""
        return self.moment_arms(q).T @ self.isometric_forces(q, activation)

    def fibre_lengths(self, q: Array, activation: Array | float = 0.0) -> Array:
        """Return the fibre lengths held still at `q` [rad] [optimal lengths], shape [m]."""
        tension = self.isometric_forces(q, activation) / self.table[:, kernel.FORCE]
        stretch = np.ones(len(tension))
        if self.tendon != "rigid":
            stretch = inverse_tendon_force(tension)
        along = self.lengths(q) - self.table[:, kernel.SLACK] * stretch
        along = np.maximum(along / self.table[:, kernel.FIBRE], SHORTEST)
        return np.hypot(along, self.table[:, kernel.PENNATION_SINE])

    def _still(self, q: Array, activation: Array | float, rates: Array | float = 0.0) -> Array:
        state = self.new_state()
        state[kernel.RATE] = rates
        state[kernel.ACTIVATION] = checked_excitation(
            np.broadcast_to(np.asarray(activation, np.float64), (len(self.units),)), self.names
        )
        state[kernel.TENDON] = 0.0
        state[kernel.LENGTH] = self.lengths(q)
        if self.tendon == "rigid":
            kernel.pull(self.table, state, 0.0, kernel.RIGID)
        else:
            kernel.balance(self.table, state)
        return state


def checked_excitation(excitation: Array, names: Sequence[str]) -> Array:
    """Return an excitation or activation whose every value lies in [0, 1].

    Raises:
        ActionError: If one does not, with its name.
    """
    outside = ~((excitation >= 0.0) & (excitation <= 1.0))
    if outside.any():
        m = int(np.flatnonzero(outside)[0])
        raise ActionError(
            f"excitation of {names[m]!r} is {excitation[m]}: excitations lie in [0, 1]"
        )
    return excitation


def _sized(values: Array, count: int, name: str) -> Array:
    values = np.asarray(values, np.float64)
    if values.shape != (count,):
        raise ConfigError(f"{name} must have shape ({count},), got {values.shape}")
    return values


def _unit_table(units: Sequence[MuscleUnit], strength: Array | None) -> Array:
    table = np.zeros((len(units), kernel.UNIT_COLUMNS))
    for m, unit in enumerate(units):
        table[m, kernel.FORCE] = unit.max_isometric_force
        table[m, kernel.FIBRE] = unit.optimal_fiber_length
        table[m, kernel.SLACK] = unit.tendon_slack_length
        table[m, kernel.PENNATION_SINE] = np.sin(unit.pennation)
        table[m, kernel.STRAIN] = unit.passive_strain
        table[m, kernel.SPEED] = unit.max_speed
        table[m, kernel.OFFSET] = passive_offset(unit.passive_strain)
    table[:, kernel.VOLUNTARY] = 1.0 if strength is None else strength
    table[:, kernel.LEAST] = RESTING_ACTIVATION * table[:, kernel.VOLUNTARY]
    table[:, kernel.REFLEX_THRESHOLD] = np.inf
    return table


@numba.njit(cache=True, error_model="numpy")
def _step(muscles, q, qd, excitation, state, dt, mode, out) -> None:  # type: ignore[no-untyped-def]
    kernel.advance(muscles, q, qd, excitation, state, dt, mode)
    for i in range(out.shape[0]):
        out[i] = muscles.torques[0, i] + muscles.torques[1, i]


@numba.njit(cache=True, error_model="numpy")
def _step_many(muscles, q, qd, excitation, state, dt, mode, out) -> None:  # type: ignore[no-untyped-def]
    for k in range(q.shape[0]):
        _step(muscles, q[k], qd[k], excitation[k], state[k], dt, mode, out[k])
