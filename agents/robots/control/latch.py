"""Holds joints that are told nothing where they came to rest."""

from __future__ import annotations

import numpy as np

from rcare_marl.pose import Array

from ..joint_group import JointGroup, Mask

IDLE = 1e-6  # an action below it is none


class Latch:
    """Where idle joints came to rest.

    A motor that is told no more than to stand still gives way a little in every physics step, since
    the solver only comes near to no speed. One that is told where to stand comes back.
    """

    def __init__(self, group: JointGroup, leash: float) -> None:
        """Make a latch that lets go as soon as a joint is more than `leash` [rad or m] away."""
        self._group, self._leash = group, leash
        self.reset()

    def reset(self) -> None:
        """Take the present posture as the one to hold."""
        self._targets = self._group.positions()
        self._was_idle: Mask = np.ones(len(self._group), np.bool_)
        self._is_held = self._was_idle

    def update(self, idle: Mask) -> Mask:
        """Return which joints to hold, shape [n]: those that were `idle` for a control step.

        Until then they only brake, so that they do not come back by the way that they took for it.
        """
        positions = self._group.positions()
        held: Mask = idle & self._was_idle
        fresh = held & ~self._is_held
        near = np.clip(self._targets, positions - self._leash, positions + self._leash)
        self._targets = np.where(fresh | ~held, positions, near)
        self._was_idle, self._is_held = idle, held
        return held

    def hold(self, held: Mask, forces: Array, duration: float) -> None:
        """Drive the joints that are `held` back to where they were in `duration` [s]."""
        if held.any():
            group = self._group
            way = np.abs(self._targets - group.positions())
            group.drive_to(self._targets, group.speeds_for(way, duration), forces, only=held)
