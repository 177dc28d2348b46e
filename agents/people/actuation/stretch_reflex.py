"""The stretch reflex of spastic muscle groups, by Modified Ashworth grade.

Each spastic direction of a degree of freedom answers its stretch of some 30 ms ago: in proportion to its
speed, above a threshold that falls as the muscle grows longer (a catch), and at high grades with tone at any
speed. With a delay in the loop a strong reflex can beat by itself, as clonus does. The same in both drives:
what it gives is a share of the group's normal strength. Figures, sources: `assets/clinical/spasticity.yaml`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np
import numpy.typing as npt

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array
from rcare_marl.tree.joint_tree import Ints

from ..body.skeleton import DOF_INDEX, DOFS
from ..profile import ASHWORTH, clinical_norms
from .muscle_model import MuscleModel

# Columns of the table, one row a DoF and direction of torque (against the axis, then along it).
LOWEST, PER_RANGE, SIGN, ONSET, LEAST_SPEED, GAIN, TONE, MOST = 0, 1, 2, 3, 4, 5, 6, 7
COLUMNS = 8
SAMPLES = 7  # angles of a range at which muscles are asked for their strength
LEAST_RANGE = 0.6  # [rad] that a speed is a share of: joints that hardly turn are hardly stretched


@dataclass(frozen=True)
class ReflexGrade:
    """The reflex of one Ashworth grade.

    Attributes:
        onset: Stretch above which `least_speed` is answered [1].
        least_speed: Below it no stretch is answered [1/s].
        gain: Share of strength by speed [s].
        tone: Share of strength by stretch [1].
        most: Greatest share of strength.
    """

    onset: float
    least_speed: float
    gain: float
    tone: float
    most: float


@dataclass(frozen=True)
class Spasticity:
    """The stretch reflex (`assets/clinical/spasticity.yaml`).

    Attributes:
        delay: Of the reflex [s].
        rise: Time constant of activation where no muscle has its own [s].
        per_stretch: By how much the threshold of speed falls with stretch [1/s].
        most_acceleration: Of the limb by its reflex [rad/s²].
        most_acceleration_by_muscle: Likewise with muscles.
        grades: By Ashworth grade; absent is none.
    """

    delay: float
    rise: float
    per_stretch: float
    most_acceleration: float
    most_acceleration_by_muscle: float
    grades: dict[str, ReflexGrade]

    def __post_init__(self) -> None:
        if set(self.grades) != set(ASHWORTH[1:]):
            raise ConfigError(
                f"grades of the reflex are {', '.join(ASHWORTH[1:])}, got {', '.join(self.grades)}"
            )
        if min(self.delay, self.rise) < 0:
            raise ConfigError("delay and rise of the reflex must not be negative")


@lru_cache(maxsize=1)
def spasticity() -> Spasticity:
    """Return what the reflex is like."""
    return load(Spasticity, assets.find("clinical", "spasticity"))


def reflex_paths(model: MuscleModel, posture: Array) -> Ints:
    """Return which reflex excites which muscle: rows of muscle, DoF and direction, shape [p, 3].

    A muscle answers the stretch of the motions that its clinical group makes, where it makes them too.
    """
    motions, arms, out = clinical_norms().motions, model.moment_arms(posture), []
    for m, unit in enumerate(model.units):
        for i in np.flatnonzero(arms[m]):
            dof = DOFS[DOF_INDEX[model.dofs[i]]]
            motion = dof.positive if arms[m, i] > 0 else dof.negative
            if motions[motion].group == unit.clinical_group and dof.side == unit.side:
                out.append((m, int(i), int(arms[m, i] > 0)))
    return np.array(out, np.int64).reshape(-1, 3)


def reflex_capacity(model: MuscleModel, posture: Array, passive: Array, paths: Ints) -> Array:
    """Return what the muscles of each reflex give at full excitation [N·m], shape [n, 2].

    It is the greatest over the passive range of the DoF, the others as in a posture.

    Args:
        model: The muscles.
        posture: Angles [rad], shape [n].
        passive: Passive range [rad], shape [n, 2].
        paths: See `reflex_paths`.
    """
    out, full = np.zeros((len(posture), 2)), np.ones(len(model.units))
    for i, k in {(int(i), int(k)) for _, i, k in paths}:
        mine = paths[(paths[:, 1] == i) & (paths[:, 2] == k), 0]
        pulls = []
        for at in np.linspace(passive[i, 0], passive[i, 1], SAMPLES):
            angles = posture.copy()
            angles[i] = at
            arms = (1.0 if k else -1.0) * model.moment_arms(angles)[mine, i]
            pulls.append(float(arms @ model.isometric_forces(angles, full)[mine]))
        out[i, k] = max(*pulls, 0.0)
    return out


class StretchReflex:
    """The reflexes of n DoFs in both directions.

    Attributes:
        share: What they give now, of normal strength, against and along the axis, shape [n, 2].
        is_silent: Whether nobody is spastic.
        compiled: What `answer_stretch` takes.
    """

    def __init__(
        self,
        grades: list[tuple[str, str]],
        *,
        passive: Array,
        strength: Array,
        inertia: Array,
        physics_dt: float,
        by_muscle: bool = False,
    ) -> None:
        """Prepare the table.

        Args:
            grades: Ashworth grade of the muscles that pull against and along each axis, n pairs.
            passive: Passive range [rad], shape [n, 2].
            strength: Normal torque against and along the axis [N·m], shape [n, 2].
            inertia: Of what hangs on each DoF [kg·m²], shape [n].
            physics_dt: Physics step [s].
            by_muscle: Whether muscles answer: they take their own time. See `excite_by`.
        """
        known, count = spasticity(), len(grades)
        self.is_silent = all(grade == "0" for pair in grades for grade in pair)
        table = np.zeros((count, 2, COLUMNS))
        width = np.maximum(passive[:, 1] - passive[:, 0], LEAST_RANGE)
        table[:, :, PER_RANGE] = 1.0 / width[:, None]
        # What pulls along the axis is shortest at the upper end of the range.
        table[:, 0, SIGN], table[:, 1, SIGN] = 1.0, -1.0
        table[:, 0, LOWEST], table[:, 1, LOWEST] = passive[:, 0], passive[:, 1]
        limit = known.most_acceleration_by_muscle if by_muscle else known.most_acceleration
        strongest = max(row.most for row in known.grades.values())
        for i, pair in enumerate(grades):
            for k, grade in enumerate(pair):
                if grade == "0":
                    continue
                row = known.grades[grade]
                bound = limit * inertia[i] / max(strength[i, k], 1e-9)
                light = min(bound / strongest, 1.0)
                table[i, k, ONSET], table[i, k, LEAST_SPEED] = row.onset, row.least_speed
                table[i, k, GAIN : MOST + 1] = light * np.array((row.gain, row.tone, row.most))
        self._table, self._strength = table, strength
        self._per_stretch = known.per_stretch
        self._pace = 1.0 if by_muscle else 1.0 - float(np.exp(-physics_dt / known.rise))
        self.share, self._pull = np.zeros((count, 2)), np.zeros(count)
        self._late = np.zeros((max(round(known.delay / physics_dt), 1), count, 2))
        self._next = np.zeros(1, np.int64)
        figures = np.array((self._per_stretch, self._pace))
        past = figures, self._late, self._next
        self.compiled = table, *past, self.share, strength, self._pull

    @property
    def answers(self) -> npt.NDArray[np.bool_]:
        """Which DoFs answer stretch, against and along the axis, shape [n, 2]."""
        return self._table[:, :, MOST] > 0.0

    def excite_by(self, capacity: Array) -> None:
        """Make shares of normal strength excitations of muscles.

        Args:
            capacity: Torque of each direction's spastic muscles at full excitation [N·m], shape [n, 2].
        """
        scale = np.where(capacity > 0.0, self._strength / np.maximum(capacity, 1e-9), 1.0)
        self._table[:, :, GAIN : MOST + 1] *= scale[:, :, None]
        self._table[:, :, MOST] = np.minimum(self._table[:, :, MOST], 1.0)

    def reset(self) -> None:
        """Forget what was felt."""
        self._late[:], self.share[:], self._pull[:], self._next[:] = 0.0, 0.0, 0.0, 0

    def torques(self) -> Array:
        """Return what they pull with now, at normal strength [N·m], shape [n]."""
        return self._pull

    def feel(self, positions: Array, velocities: Array) -> None:
        """Take the angles [rad] and rates [rad/s] of this physics step, and find `share`."""
        if self.is_silent:
            return
        answer_stretch(self.compiled, positions, velocities)


# Of who has no reflexes, for `answer_stretch`.
SILENT = (
    *(np.zeros((0, 2, COLUMNS)), np.zeros(2), np.zeros((1, 0, 2)), np.zeros(1, np.int64)),
    *(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)),
)


@numba.njit(cache=True, error_model="numpy")
def excite(paths, share, voluntary, excitation, told, involuntary) -> None:  # type: ignore[no-untyped-def]
    """Write what muscles are told by will and reflex, and which part of it is a reflex's, each [m]."""
    for m in range(told.shape[0]):
        told[m] = voluntary[m] * excitation[m]
    for p in range(paths.shape[0]):
        m, answer = paths[p, 0], share[paths[p, 1], paths[p, 2]]
        willed = voluntary[m] * excitation[m]
        if answer > told[m] - willed:  # the strongest answer of several
            told[m] = willed + answer
            involuntary[m] = answer / told[m]
        elif willed > 0.0 and told[m] == willed:
            involuntary[m] = 0.0


@numba.njit(cache=True, error_model="numpy")
def answer_stretch(reflex, positions, velocities) -> None:  # type: ignore[no-untyped-def]
    """Follow what was felt long ago, and put what is felt now in its place.

    Args:
        reflex: See `StretchReflex.compiled`.
        positions: Angles [rad], shape [n].
        velocities: Rates [rad/s], shape [n].
    """
    table, figures, past, now, share, strength, pull = reflex
    per_stretch, pace = figures[0], figures[1]
    late = past[now[0]]
    now[0] = (now[0] + 1) % len(past)
    for i in range(table.shape[0]):
        for k in range(2):
            row = table[i, k]
            if row[MOST] == 0.0:
                continue
            share[i, k] += pace * (late[i, k] - share[i, k])
            turn = row[SIGN] * row[PER_RANGE]
            stretch = turn * (positions[i] - row[LOWEST])
            least = max(per_stretch * (row[ONSET] - stretch), row[LEAST_SPEED])
            given = row[GAIN] * max(turn * velocities[i] - least, 0.0)
            given += row[TONE] * max(stretch - row[ONSET], 0.0)
            late[i, k] = min(given, row[MOST])
        pull[i] = share[i, 1] * strength[i, 1] - share[i, 0] * strength[i, 0]
