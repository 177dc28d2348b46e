"""From wished joint angles to excitations: static optimisation around a posture.

The wished torque of a DoF is that of a damped spring towards its target, and what holds the
limb against gravity. Of all excitations in [0, 1] those are chosen that come nearest to the wished
torques and are small (R. D. Crowninshield & R. A. Brand, "A physiologically based criterion of muscle
force prediction in locomotion", J. Biomechanics 14, 1981, with the sum of squares of activations): a
bounded least-squares problem, solved by coordinate descent from the last solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from rcare_marl.pose import Array

from . import muscle_kernel as kernel
from .muscle_model import MuscleModel

# Our own choices.
FREQUENCY = 6.0  # [rad/s] of the spring; activation lags by 10 to 40 ms
DAMPING_RATIO = 1.5
LEAST_STIFFNESS = 0.4  # [1/rad] of the normal torque: light parts need more than their inertia does
EFFORT_WEIGHT = 2e-4  # of squared excitations against squared shares of normal torque
NARROW = 0.35  # [rad]: a DoF with less active range than this is left to ligaments, mostly
NARROW_WEIGHT = 0.02
TOGETHER = 0.8  # of a spine's error, that all of its joints mend together: they share their muscles
END_ZONE = 0.05  # [rad] before an end of the active range
END_WEIGHT = 0.05
REST_WEIGHT = 0.03  # of a limb that rests on furniture
SWEEPS = 6


class Felt(NamedTuple):
    """What the controller knows of the body after a physics step.

    Attributes:
        positions: Angles [rad], shape [n].
        velocities: Rates [rad/s], shape [n].
        damped: Rates that the controller's damping leaves before what it asks is done [rad/s], shape [n].
        load: Torques that hold the limbs against gravity and passive tension [N·m], shape [n].
        arms: Moment arm of each crossing [m].
        state: State of the muscles, shape [STATE_ROWS, m].
        resting: Whether a limb lies on something: then no torque is best, shape [n].
        able: Greatest torques that can be willed against and along each axis [N·m], shape [n, 2].
    """

    positions: Array
    velocities: Array
    damped: Array
    load: Array
    arms: Array
    state: Array
    resting: npt.NDArray[np.bool_]
    able: Array


class MuscleController:
    """Finds excitations that pursue joint angles, for the posture and speed of the moment.

    Attributes:
        damping: Of the springs [N·m·s/rad], shape [n].
    """

    def __init__(
        self,
        model: MuscleModel,
        inertia: Array,
        voluntary: Array,
        *,
        normal_strength: Array,
        limits: Array,
    ) -> None:
        """Prepare the springs.

        Args:
            model: The muscles, m of them, over n DoFs.
            inertia: Of what hangs on each DoF [kg·m²], shape [n].
            voluntary: Share of an excitation that reaches each muscle, shape [m]; the caller changes it.
            normal_strength: Torque of a healthy person [N·m], shape [n].
            limits: Active range [rad], shape [n, 2].
        """
        self._model, self._voluntary = model, voluntary
        stiffness = np.maximum(FREQUENCY**2 * inertia, LEAST_STIFFNESS * normal_strength)
        damping = 2 * DAMPING_RATIO * np.sqrt(stiffness * inertia)
        self.damping = damping
        self._stiffness = stiffness
        width = limits[:, 1] - limits[:, 0]
        share = np.where(width < NARROW, NARROW_WEIGHT, 1.0)
        self._weights = share / normal_strength**2
        self._columns = _columns(model.dofs)
        self._middle, self._half = limits.mean(axis=1), width / 2
        self._now = np.zeros(len(inertia))
        self._left = np.zeros(len(inertia))

    def solve(self, target: Array, felt: Felt, excitation: Array) -> None:
        """Improve `excitation` in place, shape [m].

        Args:
            target: Wished angles [rad], shape [n].
            felt: The body now.
            excitation: Where to begin and to write.
        """
        positions = felt.positions
        error, rate = target - positions, felt.damped.copy()
        for column in self._columns:
            for values in (error, rate):
                values[column] += TOGETHER * (values[column].mean() - values[column])
        self._left[:] = self._stiffness * error - self.damping * rate
        self._left += felt.load
        # To want more than a motion can would only strain others in vain.
        np.clip(self._left, -felt.able[:, 0], felt.able[:, 1], out=self._left)
        self._left[felt.resting] = 0.0
        # At an end of the range what is too much does no harm to who wants to stay there.
        side = np.sign(positions - self._middle)
        at_end = np.minimum(positions * side, target * side) > (
            self._middle * side + self._half - END_ZONE
        )
        np.multiply(self._weights, np.where(at_end, END_WEIGHT, 1.0), out=self._now)
        self._now[felt.resting] *= REST_WEIGHT
        layout, felt_now = self._model.layout, (felt.arms, felt.state, self._voluntary)
        _descend(layout.starts, layout.crossed, felt_now, self._now, self._left, excitation)

    def slack_target(self, felt: Felt, ahead: float) -> Array:
        """Return the angles [rad] that ask nothing of the muscles over the next `ahead` [s], shape [n]."""
        forward = felt.positions + 0.5 * ahead * felt.velocities
        return np.asarray(forward + (self.damping * felt.damped - felt.load) / self._stiffness)


def _columns(dofs: Sequence[str]) -> list[list[int]]:
    """Return the DoFs of the spine by axis."""
    motions: dict[str, list[int]] = {}
    for i, dof in enumerate(dofs):
        joint, _, motion = dof.partition("_")
        if joint.startswith("spine"):
            motions.setdefault(motion, []).append(i)
    return [found for found in motions.values() if len(found) > 1]


@numba.njit(cache=True, error_model="numpy")
def _descend(starts, crossed, felt, weights, left, excitation) -> None:  # type: ignore[no-untyped-def]
    """Coordinate descent over excitations; `left` is the wished torque not yet made."""
    count, (arms, state, voluntary) = starts.shape[0] - 1, felt
    for m in range(count):
        force = state[kernel.CAPACITY, m] * voluntary[m] * excitation[m]
        for c in range(starts[m, 1], starts[m + 1, 1]):
            left[crossed[c]] -= arms[c] * force
    for _ in range(SWEEPS):
        for m in range(count):
            capacity = state[kernel.CAPACITY, m] * voluntary[m]
            if capacity <= 0.0:
                excitation[m] = 0.0
                continue
            slope, curve = -EFFORT_WEIGHT * excitation[m], EFFORT_WEIGHT
            for c in range(starts[m, 1], starts[m + 1, 1]):
                i, torque = crossed[c], arms[c] * capacity
                slope += weights[i] * torque * left[i]
                curve += weights[i] * torque * torque
            after = min(max(excitation[m] + slope / curve, 0.0), 1.0)
            change = (after - excitation[m]) * capacity
            excitation[m] = after
            for c in range(starts[m, 1], starts[m + 1, 1]):
                left[crossed[c]] -= arms[c] * change
