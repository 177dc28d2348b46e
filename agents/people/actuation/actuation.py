"""What drives the joints of a person, the angles that a person pursues, and what shakes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from rcare_marl.observable import Observable
from rcare_marl.pose import Array

MAX_SPEED = 0.8  # [rad/s] of a target angle at full action; our own choice: an unhurried movement
# [1/s]; Parkinsonian rest tremor lies at 4 to 6 (Deuschl et al. 1998, from memory).
TREMOR_FREQUENCY = 5.0
TREMOR_SPREAD = 0.15  # of the frequency among muscle groups; our own choice
DYSKINESIA_FREQUENCIES = (0.6, 1.1, 1.9, 2.7)  # [1/s]; irregular movement below 3 (our own choice)


class TargetAngles:
    """Pursued angles. An action has one value in [-1, 1] for each, and moves it by that times `MAX_SPEED`.

    Attributes:
        values: The angles [rad], shape [n]; active movement ends at the active range.
        action_names: What each action value moves, with its unit.
    """

    def __init__(self, names: Sequence[str], values: Array, limits: Array) -> None:
        """Take the DoFs, room for their angles [rad], shape [n], and their range [rad], shape [n, 2]."""
        self.values = values
        self._lowest, self._highest = np.ascontiguousarray(limits.T)
        self._index = {dof: i for i, dof in enumerate(names)}
        self.action_names = tuple(f"{dof} [{MAX_SPEED} rad/s]" for dof in names)

    def move(self, action: Array, duration: float) -> None:
        """Follow an action for a control step of `duration` [s]."""
        values = self.values
        values += action * (MAX_SPEED * duration)
        np.maximum(values, self._lowest, out=values)
        np.minimum(values, self._highest, out=values)

    def action_towards(self, angles: Mapping[str, float], duration: float) -> Array:
        """Return the action that moves some targets towards `angles` [rad]; the others stay."""
        action = np.zeros(len(self.values))
        for dof, angle in angles.items():
            i = self._index[dof]
            action[i] = (angle - self.values[i]) / (MAX_SPEED * duration)
        return np.clip(action, -1.0, 1.0)


class Actuation(Protocol):
    """Turns the actions of a person into joint torques, and wishes into actions.

    Attributes:
        names: The n moving DoFs.
        target: Angle that each DoF pursues [rad], shape [n].
        action_low: Least value of an action, 0 or -1; the greatest is 1.
        action_names: What each action value moves, with its unit.
    """

    names: tuple[str, ...]
    target: Array
    action_low: float
    action_names: tuple[str, ...]

    @property
    def strength(self) -> Array:
        """Greatest torque against and along each DoF when rested [N·m], shape [n, 2]."""

    def reset(self, rng: np.random.Generator, gravity: Array) -> None:
        """Begin an episode in the start posture, with nothing commanded.

        Args:
            rng: Source of all that is random.
            gravity: Gravity in the frame of the pelvis [m/s²], shape [3].
        """

    def lay(self, index: int, angle: float) -> None:
        """Let a DoF pursue `angle` [rad], and furniture hold it there, until the next `reset`."""

    def command(self, action: Array, duration: float) -> None:
        """Accept an action for the coming control step of `duration` [s].

        What follows is a function of the action and of the state, of nothing else that was called.
        """

    def action_towards(self, angles: Mapping[str, float], duration: float) -> Array:
        """Return the action that pursues `angles` [rad] of some DoFs, the others staying as they are.

        It changes nothing: only to `command` the action does.
        """

    def relax(self) -> None:
        """Let all muscles go until the next command, as who is examined is asked to."""

    def slack_action(self, duration: float) -> Array:
        """Return the action by which the muscles slacken; it changes nothing."""

    def torques(
        self, positions: list[float], velocities: list[float], gravity: Array
    ) -> list[float]:
        """Return joint torques for the coming physics step [N·m], length n.

        Args:
            positions: Joint angles [rad], length n.
            velocities: Joint rates [rad/s], length n.
            gravity: Gravity in the frame of the pelvis [m/s²], shape [3].
        """

    def compiled(self, gravity: Array) -> tuple[Any, ...] | None:
        """Return what `skeletal.torques_of` takes; None of a drive that it is not enough for.

        Args:
            gravity: In the frame of the pelvis [m/s²], shape [3], kept up to date by its owner.
        """

    def muscle_torques(self) -> Array:
        """Return what the muscles willed in the last physics step [N·m], shape [n]."""

    def weaken(self, fresh: Array) -> None:
        """Leave each DoF's muscles a share of their strength, in [0, 1], shape [n]; 1 is rested."""

    def observables(self) -> Sequence[Observable]:
        """Return what a person senses of the drive."""


class Shaking:
    """Involuntary drive of several parts: a tremor as one sine each, a dyskinesia as several.

    Parts with one `rhythm` share frequency and phases, so that agonist and antagonist alternate.
    """

    def __init__(
        self, *, tremor: Array, dyskinesia: Array, signs: Array, rhythm: npt.NDArray[np.int64]
    ) -> None:
        """Prepare the parts.

        Args:
            tremor: Amplitude of each part, shape [m].
            dyskinesia: Likewise, shape [m].
            signs: +1 or -1 for agonists and antagonists, shape [m].
            rhythm: Which rhythm moves each part, from 0 on, shape [m].
        """
        self._tremor, self._dyskinesia = tremor * signs, dyskinesia * signs
        self._rhythm = rhythm
        count = int(rhythm.max()) + 1 if len(rhythm) else 0
        self._phases = np.zeros((count, 1 + len(DYSKINESIA_FREQUENCIES)))
        self._rates = np.zeros_like(self._phases)
        self._time = 0.0

    def reset(self, rng: np.random.Generator) -> None:
        """Draw new phases and tremor frequencies, and begin at time 0."""
        self._phases[:] = rng.uniform(0, 2 * np.pi, self._phases.shape)
        spread = rng.uniform(-TREMOR_SPREAD, TREMOR_SPREAD, len(self._phases))
        self._rates[:, 0] = 2 * np.pi * TREMOR_FREQUENCY * (1 + spread)
        self._rates[:, 1:] = 2 * np.pi * np.array(DYSKINESIA_FREQUENCIES)
        self._time = 0.0

    def after(self, dt: float) -> Array:
        """Return the drive of each part `dt` [s] later, in its amplitude's unit, shape [m]."""
        self._time += dt
        waves = np.sin(self._phases + self._rates * self._time)
        slow = waves[:, 1:].mean(axis=1)
        return self._tremor * waves[self._rhythm, 0] + self._dyskinesia * slow[self._rhythm]
