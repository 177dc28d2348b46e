"""What of a wrench in a joint comes of the body itself: its weight, and the change of its momentum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .body import Body
from .body_part import State
from .pose import Array, Pose, conjugate, matrix_from_quaternion, rotate
from .world import GRAVITY

States = Sequence[State]


class OwnWeight:
    """The weight of what links carry of their own body, as those joints would feel it at rest."""

    def __init__(self, body: Body, links: Sequence[int]) -> None:
        """Read the masses of all that `links` carry."""
        self._body, self._links = body, tuple(links)
        self._carried = [body.carried_by(link) for link in links]
        self._all = sorted({index for carried in self._carried for index in carried})
        self._masses = {index: body.mass(index) for index in self._all}

    def wrenches(self) -> Array:
        """Return force [N] and torque [N·m] on each link in its frame, at its origin, shape [n, 6]."""
        centres = dict(zip(self._all, self._body.link_centres(self._all), strict=True))
        out = np.empty((len(self._links), 6))
        for row, link, carried in zip(out, self._links, self._carried, strict=True):
            pose = self._body.link_pose(link)
            mass = sum(self._masses[index] for index in carried)
            moment = sum((self._masses[i] * centres[i] for i in carried), np.zeros(3))
            weight = np.array((0.0, 0.0, -GRAVITY))
            arm = moment - mass * np.asarray(pose.position)
            back = conjugate(pose.quaternion)
            row[:3] = rotate(back, mass * weight)
            row[3:] = rotate(back, np.cross(arm, weight))
        return out


class OwnMotion:
    """What the motion of links needs: the change of their momentum over the last physics step."""

    def __init__(self, body: Body, links: Sequence[int]) -> None:
        """Read masses and inertias of `links`."""
        self._body, self._links = body, list(links)
        read = [body.mass_and_inertia(link) for link in links]
        self._masses = np.array([mass for mass, _ in read])
        self._inertias = np.array([inertia for _, inertia in read])
        self.reset()

    def reset(self) -> None:
        """Begin at rest."""
        self._before: States | None = None
        self._now: States | None = None

    def after_substep(self) -> None:
        """Remember how the links move after a physics step."""
        self._before, self._now = self._now, self._body.centre_states(self._links)

    def wrench(self, at: Pose, dt: float) -> Array:
        """Return the force [N] and torque [N·m] that it needs, in the frame `at`, shape [6].

        Args:
            at: The frame; the torque is about its origin.
            dt: Length of a physics step [s].
        """
        change = (self._momentum(self._now) - self._momentum(self._before)) / dt
        force, torque = change[:3], change[3:] - np.cross(at.position, change[:3])
        back = conjugate(at.quaternion)
        return np.concatenate((rotate(back, force), rotate(back, torque)))

    def _momentum(self, states: States | None) -> Array:
        """Return momentum [kg·m/s] and angular momentum about the world's origin, shape [6]."""
        if states is None:
            return np.zeros(6)
        rows = np.array(states)
        places, linear, angular = rows[:, :3], rows[:, 7:10], rows[:, 10:]
        turns = np.array([matrix_from_quaternion(s[3:7]) for s in states])
        momenta = self._masses[:, None] * linear
        spins = np.einsum("lba,lb->la", turns, angular) * self._inertias
        spin = np.cross(places, momenta) + np.einsum("lab,lb->la", turns, spins)
        return np.concatenate((momenta.sum(axis=0), spin.sum(axis=0)))
