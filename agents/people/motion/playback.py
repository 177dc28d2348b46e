"""Clips played back: by the person's own drive, or, for pictures, as a puppet that physics does not move."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rcare_marl.pose import Array

from ..body.skeleton import DOF_INDEX
from ..human import Human
from .clip import Clip, Motion


def fitted(clip: Clip | Motion, person: Human) -> Motion:
    """Return what a spawned person makes of a clip; a motion is returned as it is."""
    if isinstance(clip, Motion):
        return clip
    return clip.fit(person.model, person.avatar.profile)


class Playback:
    """A policy that pursues the angles of a clip with the person's own strength.

    The pelvis stays where it is, and what the person cannot do stays undone. A DoF that does not
    move is left out.
    """

    def __init__(
        self,
        person: Human,
        motion: Motion,
        clock: Callable[[], float],
        control_dt: float,
        *,
        is_looped: bool = False,
    ) -> None:
        """Prepare the policy; `play` is the shorter way.

        Args:
            person: Who moves.
            motion: The motion.
            clock: Returns the simulated time [s].
            control_dt: Length of a control step [s].
            is_looped: Whether to begin again at the end.
        """
        self.motion = motion.resampled(control_dt)
        self._person, self._clock, self._dt, self._is_looped = person, clock, control_dt, is_looped

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to begin: the episode's clock tells the place in the clip."""

    def act(self) -> Array:
        time = self._clock() + self._dt
        if self._is_looped and self.motion.duration > 0:
            time %= self.motion.duration
        wish = self.motion.wish(time)
        return self._person.action_towards(
            {dof: wish[dof] for dof in self._person.movable}, self._dt
        )


def play(
    clip: Clip | Motion,
    person: Human,
    clock: Callable[[], float],
    control_dt: float,
    *,
    is_looped: bool = False,
) -> Playback:
    """Return a policy that plays a clip on a spawned person; see `Playback`."""
    return Playback(person, fitted(clip, person), clock, control_dt, is_looped=is_looped)


class Puppet:
    """A motion that moves a person in place of the drive, for pictures: no part of an environment.

    Call `advance` in place of `Human.actuate` before every physics step. Nothing that touches the person
    changes it: it is a body that knows no force. Its joints report no velocity.

    Attributes:
        is_over: Whether the motion has come to its end.
    """

    def __init__(self, person: Human, motion: Motion, clock: Callable[[], float]) -> None:
        """Prepare the motion; it begins when it is first asked.

        Args:
            person: Who is moved, spawned.
            motion: The motion.
            clock: Returns the simulated time [s].
        """
        self.motion, self._person, self._clock = motion, person, clock
        self._since: float | None = None
        self.is_over = False

    def advance(self) -> None:
        """Put pelvis and every movable DoF where the coming physics step wants them."""
        if self._since is None:
            self._since = self._clock()
        time, person = self._clock() - self._since, self._person
        angles, pelvis = self.motion.at(time)
        low, high = person.passive.T
        chosen = np.clip(angles[[DOF_INDEX[dof] for dof in person.movable]], low, high)
        person.place(pelvis)
        person.body.set_joints(person.body.indices(person.movable), chosen)
        person.drive.target[:] = chosen
        self.is_over = time >= self.motion.duration
