"""The skeletal drive: joint torques that pursue target angles, within a person's strength and range.

The torque of a degree of freedom is the sum of

* muscle: holds the limb against gravity and pulls towards the target (a stable proportional-
  derivative law), but never beyond the strength of the muscles on that side of the joint: net
  torque, as a dynamometer measures it, together with what tissue gives;
* support: where a posture rests a limb on furniture and the muscles are too weak to hold it, the
  furniture carries its weight and holds it in the posture by the same law, without a limit; the
  muscles pull against it with what strength they have;
* reflex: spastic muscles answer their stretch, whoever wills what (`stretch_reflex.py`); tremor shakes;
* tissue: damping everywhere, and at joints of limbs that swing a pull away from the ends of the range
  (`joint_tissue.py`). The passive range ends at a hard stop, which is the physics engine's.

Stiffness and damping act at the end of the coming step (Tan, Liu & Turk, "Stable proportional-
derivative controllers", IEEE CG&A 2011): each step solves for the accelerations that they will meet,
with the mass matrix of all moving parts (`dynamics.py`). So the law stays stable at 1/240 s for a
trunk as for a fingertip, and where two axes of a shoulder align.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from rcare_marl.observable import Observable
from rcare_marl.pose import Array
from rcare_marl.tree.dynamics import (
    PART_COLUMNS,
    WEIGHT,
    mass_matrix,
    packed_matrix,
    part_table,
    place_frames,
    place_masses,
    solve,
    tree_depths,
)
from rcare_marl.tree.joint_tree import JointTree
from rcare_marl.tree.least_squares import put

from .actuation import MAX_SPEED, Shaking, TargetAngles
from .joint_tissue import (
    HIGH_TORQUE,
    HIGH_WIDTH,
    LOW_TORQUE,
    LOW_WIDTH,
    end_tissue,
    joint_damping,
)
from .stretch_reflex import SILENT, StretchReflex, answer_stretch

# Our own choices; no measurement of everyday joint impedance covers all 112 degrees of freedom.
STIFFNESS_PER_TORQUE = 2.5  # [1/rad]: full strength answers an error of 0.4 rad
# [s/rad] Whoever is awake braces: muscles that hold damp, by normal torque and the fourth root of the share
# of it that is left, so what is weak braces nearly as hard. A relaxed or paralysed limb has its tissue only.
# Our own choice.
BRACING = 0.02
# [rad/s] of a joint on its own stiffness: a finger's strength is not its stiffness.
MAX_FREQUENCY = 40.0

# [N·m/rad] by which a target is moved so that its muscle slackens: more than the stiffness of most joints,
# so that it does not overshoot; our own choice.
SLACKENING = 200.0

# Columns of the kernel's table after those of the parts, one row a DoF.
_STIFFNESS, _DAMPING, _TISSUE = PART_COLUMNS, PART_COLUMNS + 1, PART_COLUMNS + 2
_STRENGTH_AGAINST, _STRENGTH_ALONG, _SUPPORT, _TISSUE_AGAINST, _TISSUE_ALONG = 31, 32, 33, 34, 35
_ENDS = 36  # four columns, see `end_tissue`; then ends of the passive range
_LEAST, _MOST = 40, 41
_COLUMNS = 42
# Of the scratch: 0, or the sign of the strength that is spent; pull of the tissue and its stiffness; greatest
# torques of the muscles here and now.
_CLIPPED, _PULL, _STIFF, _MOST_AGAINST, _MOST_ALONG = 32, 33, 34, 35, 36
_SCRATCH = 37
# Places in what `torques_of` takes, and rows of its state.
STATE, OUT, ANGLES, RATES = 3, 8, 0, 1


class SkeletalDrive:
    """Torques of a person's moving DoFs from target angles: an `Actuation`.

    An action moves the target angles, see `TargetAngles`.

    Attributes:
        names: The moving DoFs.
        target: Angle that each DoF pursues [rad], shape [n]; write it to command the person.
    """

    action_low = -1.0

    def __init__(
        self,
        chain: JointTree,
        *,
        strength: Array,
        normal_strength: Array,
        supported: npt.NDArray[np.bool_],
        posture: Array,
        limits: Array,
        passive: Array,
        physics_dt: float,
        overcoming: Array | None = None,
        reflex: StretchReflex | None = None,
        shaking: Shaking | None = None,
    ) -> None:
        """Prepare the table of the kernel.

        Args:
            chain: The moving parts, n of them.
            strength: Greatest torque against and along the axis [N·m], shape [n, 2], both >= 0.
            normal_strength: Torque of a healthy person, the scale of stiffness [N·m], shape [n].
            supported: Whether furniture holds the limb, shape [n].
            posture: Angles where furniture holds, and where damping is critical [rad], shape [n].
            limits: Where active movement ends [rad], shape [n, 2].
            passive: Where passive movement ends [rad], shape [n, 2].
            physics_dt: Physics step [s].
            overcoming: Share of the tissue's resistance that muscles overcome beside their strength, against
                and along the axis, shape [n, 2]; all of it if None.
            reflex: What answers stretch; nothing if None.
            shaking: Involuntary torque [N·m].
        """
        count = len(chain.names)
        self.names = chain.names
        self._dt = physics_dt
        inertia = np.diag(chain.mass_matrix(posture))
        table = part_table(chain.arrays, _COLUMNS)
        table[:, _STIFFNESS : _DAMPING + 1] = impedance(normal_strength, inertia)
        table[:, _TISSUE] = joint_damping(chain.names, normal_strength, inertia)
        table[:, _STRENGTH_AGAINST], table[:, _STRENGTH_ALONG] = strength.T
        table[:, _SUPPORT] = supported
        table[:, _TISSUE_AGAINST : _TISSUE_ALONG + 1] = 1.0 if overcoming is None else overcoming
        table[:, _ENDS : _ENDS + 4] = end_tissue(chain.names, inertia)
        table[:, _LEAST], table[:, _MOST] = passive.T
        self._table, self._rested = table, strength.copy()
        self._fresh, self._is_slack = np.ones(count), False
        self._normal, self._relaxed = normal_strength, table[:, _TISSUE].copy()
        self._shaking, self._reflex = shaking, reflex
        # Angles, rates, targets, start; torques: involuntary, of muscles in the last step.
        self._state = np.zeros((6, count))
        self._posture = posture.copy()
        self._state[3] = posture
        self.target = self._state[2]
        self.target[:] = posture
        self._targets = TargetAngles(chain.names, self.target, limits)
        self.action_names = self._targets.action_names
        parents = chain.arrays.parents
        self._tree = table, parents, tree_depths(parents)
        self._tell_strength()
        self._out = np.zeros(count)
        matrices = np.stack([packed_matrix(parents)] * 2)
        self._room = np.zeros((count, _SCRATCH)), matrices, self._out

    @property
    def strength(self) -> Array:
        return self._rested

    @property
    def normal_strength(self) -> Array:
        """Torque of a healthy person [N·m], shape [n]."""
        return self._normal

    def reset(self, rng: np.random.Generator, gravity: Array) -> None:
        self.target[:] = self._state[3] = self._posture
        self._is_slack = False
        self._tell_strength()
        self._room[0][:, _CLIPPED] = 0.0
        if self._shaking is not None:
            self._shaking.reset(rng)
        if self._reflex is not None:
            self._reflex.reset()
        self._state[4:] = 0.0

    def lay(self, index: int, angle: float) -> None:
        self.target[index] = self._state[3, index] = angle

    def command(self, action: Array, duration: float) -> None:
        if self._is_slack:  # whoever begins to move again begins here
            self._is_slack = False
            self._tell_strength()
            self.target[:] = self._state[0]
        self._targets.move(action, duration)

    def relax(self) -> None:
        self._is_slack = True
        self._tell_strength()

    def action_towards(self, angles: Mapping[str, float], duration: float) -> Array:
        return self._targets.action_towards(angles, duration)

    def slack_action(self, duration: float) -> Array:
        return np.clip(-self.muscle_torques() / (SLACKENING * (MAX_SPEED * duration)), -1.0, 1.0)

    def muscle_torques(self) -> Array:
        """Return what the muscles gave in the last physics step [N·m], shape [n]."""
        return self._state[5]

    def weaken(self, fresh: Array) -> None:
        self._fresh[:] = fresh
        self._tell_strength()

    def _tell_strength(self) -> None:
        share = 0.0 if self._is_slack else self._fresh[:, None]
        strength = self._rested * share
        self._table[:, _STRENGTH_AGAINST : _STRENGTH_ALONG + 1] = strength
        part = np.minimum(strength.max(axis=1) / self._normal, 1.0)
        self._table[:, _TISSUE] = self._relaxed + BRACING * self._normal * part**0.25

    def observables(self) -> Sequence[Observable]:
        return [Observable("joint_target", "rad", len(self.names), lambda: self.target)]

    def torques(
        self, positions: list[float], velocities: list[float], gravity: Array
    ) -> list[float]:
        self._state[0] = positions
        self._state[1] = velocities
        if self._shaking is not None:
            self._state[4] = self._shaking.after(self._dt)
        if self._reflex is not None:
            self._reflex.feel(self._state[0], self._state[1])
            if self._shaking is None:
                self._state[4] = self._reflex.torques()
            else:
                self._state[4] += self._reflex.torques()
        _torques(*self._tree, self._state, gravity, self._dt, *self._room)
        return self._out.tolist()

    def compiled(self, gravity: Array) -> tuple[Any, ...] | None:
        if self._shaking is not None:
            return None
        silent = self._reflex is None or self._reflex.is_silent
        reflex = SILENT if silent or self._reflex is None else self._reflex.compiled
        return *self._tree, self._state, gravity, self._dt, *self._room, reflex


def impedance(normal_strength: Array, inertia: Array) -> Array:
    """Return stiffness [N·m/rad] and critical damping [N·m·s/rad] of a pursuit, shape [n, 2].

    Args:
        normal_strength: Torque of a healthy person [N·m], shape [n].
        inertia: Of what hangs on each DoF [kg·m²], shape [n].
    """
    stiffness = np.minimum(STIFFNESS_PER_TORQUE * normal_strength, inertia * MAX_FREQUENCY**2)
    return np.column_stack((stiffness, 2 * np.sqrt(stiffness * inertia)))


@numba.njit(cache=True, error_model="numpy")
def torques_of(person) -> None:  # type: ignore[no-untyped-def]
    """Write torques into the last array of a person but the reflex, from angles and rates in the state.

    Args:
        person: See `SkeletalDrive.compiled`.
    """
    table, parents, depths, state, gravity, dt, work, matrices, out, reflex = person
    if len(reflex[0]) > 0:
        answer_stretch(reflex, state[0], state[1])
        put(reflex[6], state[4])
    _torques(table, parents, depths, state, gravity, dt, work, matrices, out)


@numba.njit(cache=True, error_model="numpy")
def _torques(table, parents, depths, state, gravity, dt, work, matrices, out) -> None:  # type: ignore[no-untyped-def]
    """Write the torque of each DoF into `out`."""
    count = table.shape[0]
    place_frames(table, parents, state[0], work)
    place_masses(table, work)
    mass_matrix(parents, depths, gravity, work, matrices[0])
    for i in range(count):
        row = table[i]
        _tighten(row, work[i], state[0, i])
        if row[_STRENGTH_ALONG] == 0.0 and row[_STRENGTH_AGAINST] == 0.0:
            work[i, _CLIPPED] = 1.0
    # A muscle at the end of its strength pulls with that strength, whatever the stiffness. Which ones are
    # is taken from the last step; when others are, or no longer are, the accelerations are found once
    # more, until no more muscles are.
    is_first = is_new = True
    while is_new:
        for i in range(count):
            row = table[i]
            for a in range(depths[i] + 1):
                matrices[1, i, a] = matrices[0, i, a]
            velocity = state[1, i]
            ahead = state[0, i] + dt * velocity
            stiffness, damping, support = row[_STIFFNESS], row[_DAMPING], row[_SUPPORT]
            out[i] = support * (stiffness * (state[3, i] - ahead) - damping * velocity)
            tissue = row[_TISSUE]
            out[i] += state[4, i] - tissue * velocity
            implicit = dt * (tissue + support * (damping + dt * stiffness))
            if work[i, _CLIPPED] == 0.0:
                out[i] += stiffness * (state[2, i] - ahead) - damping * velocity
                implicit += dt * (damping + dt * stiffness)
            else:  # the muscle does not give what would carry weight and tissue, unless furniture does
                loose = (1 - support) * work[i, _STIFF]
                out[i] += _spent(work[i]) - dt * loose * velocity
                out[i] += (1 - support) * (work[i, _PULL] - work[i, WEIGHT])
                implicit += dt * dt * loose
            matrices[1, i, depths[i]] += implicit
        solve(parents, depths, matrices[1], out)
        is_new = False
        for i in range(count):
            row, support, weight = table[i], table[i, _SUPPORT], work[i, WEIGHT]
            after = state[1, i] + dt * out[i]
            there = state[0, i] + dt * after
            held = weight + row[_STIFFNESS] * (state[3, i] - there) - row[_DAMPING] * after
            was, muscle = work[i, _CLIPPED], 0.0
            if is_first or was == 0.0:
                muscle = row[_STIFFNESS] * (state[2, i] - there) - row[_DAMPING] * after
                muscle += (1 - support) * (weight - work[i, _PULL])
                along, against = work[i, _MOST_ALONG], work[i, _MOST_AGAINST]
                now = 1.0 if muscle > along else -1.0 if muscle < -against else 0.0
                if now != was and (row[_STRENGTH_ALONG] > 0.0 or row[_STRENGTH_AGAINST] > 0.0):
                    work[i, _CLIPPED], is_new = now, True
            if work[i, _CLIPPED] != 0.0:
                muscle = _spent(work[i])
            state[5, i] = muscle
            out[i] = muscle + support * held + state[4, i] - row[_TISSUE] * after
            out[i] += (1 - support) * work[i, _PULL]
            if work[i, _CLIPPED] != 0.0:
                out[i] -= (1 - support) * dt * work[i, _STIFF] * after
        is_first = False


@numba.njit(cache=True, error_model="numpy")
def _spent(mine):  # type: ignore[no-untyped-def]
    """Return the torque of a muscle at the end of its strength."""
    return mine[_MOST_ALONG] if mine[_CLIPPED] > 0 else -mine[_MOST_AGAINST]


@numba.njit(cache=True, error_model="numpy")
def _tighten(row, mine, position) -> None:  # type: ignore[no-untyped-def]
    """Find what tissue pulls with here, how stiff it is, and what muscles can give against it."""
    pull = stiffness = 0.0
    if row[_ENDS + LOW_TORQUE] > 0.0:
        near = max((position - row[_LEAST]) / row[_ENDS + LOW_WIDTH], 0.0)
        here = row[_ENDS + LOW_TORQUE] * np.exp(-near)
        pull, stiffness = pull + here, stiffness + here / row[_ENDS + LOW_WIDTH]
    if row[_ENDS + HIGH_TORQUE] > 0.0:
        near = max((row[_MOST] - position) / row[_ENDS + HIGH_WIDTH], 0.0)
        here = row[_ENDS + HIGH_TORQUE] * np.exp(-near)
        pull, stiffness = pull - here, stiffness + here / row[_ENDS + HIGH_WIDTH]
    mine[_PULL], mine[_STIFF] = pull, stiffness
    against, along = row[_STRENGTH_AGAINST], row[_STRENGTH_ALONG]
    if along > 0.0:
        along = max(along - row[_TISSUE_ALONG] * pull, 0.0)
    if against > 0.0:
        against = max(against + row[_TISSUE_AGAINST] * pull, 0.0)
    mine[_MOST_AGAINST], mine[_MOST_ALONG] = against, along
