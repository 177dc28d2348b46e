"""A hold of a link on cloth."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..body import Body
from ..pose import matrix_from_quaternion
from . import cloth_kernel as kernel
from .kernel import line_point

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

STIFFNESS = 2000.0  # [N/m] of a whole hold: a light finger at 1/240 s stays at rest; our own choice
FORCE = 60.0  # [N] of a whole hold: a firm grip, our own choice
_MORE = 1.5
SLIP = 0.03  # [m] beyond what its spring yields, where a particle has slipped out; our own choice


class Grip:
    """Particles of a cloth that a link holds by springs, which together pull no harder than a hold can.

    Attributes:
        body: What holds.
        link: Index of the link that holds.
        particles: What is held, shape [p]; fewer when cloth has slipped out.
        force: Greatest force of the whole hold [N].
        pull: Force on the link in the last physics step, in the world [N], shape [3].
    """

    def __init__(
        self,
        body: Body,
        link: int,
        particles: Indices,
        points: Array,
        state: Array,
        *,
        force: float,
        stiffness: float,
    ) -> None:
        """Hold particles where they are.

        Args:
            body: What holds.
            link: Index of its link.
            particles: What is held, shape [p].
            points: Where they are in the world [m], shape [p, 3].
            state: Of the link, see `collider`.
            force: Greatest force [N].
            stiffness: Of the whole hold [N/m].
        """
        self.body, self.link, self.force = body, link, force
        self.particles = particles
        self.pull = np.zeros(3)
        self._local = (points - state[:3]) @ matrix_from_quaternion(state[3:7])
        self._pins = np.zeros((len(particles), kernel.PIN))
        self._pins[:, :3] = points
        self._pins[:, kernel.PIN_SOFTNESS] = max(len(particles), 1) / stiffness
        self._pins[:, kernel.PIN_LIMIT] = force / max(len(particles), 1)

    @property
    def is_active(self) -> bool:
        """Whether it still holds anything."""
        return len(self.particles) > 0

    @property
    def load(self) -> float:
        """Size of the force on the link in the last physics step [N]."""
        return float(np.linalg.norm(self.pull))

    def lead(self, state: Array, period: float, substeps: int) -> Array:
        """Return the pins, on their way to where the link will be at the end of the step."""
        arms = self._local @ matrix_from_quaternion(state[3:7]).T
        turn = state[10:]
        spun = arms[:, [2, 0, 1]] * turn[[1, 2, 0]] - arms[:, [1, 2, 0]] * turn[[2, 0, 1]]
        ahead = state[:3] + arms + period * (state[7:10] + spun)
        self._pins[:, kernel.WAY : kernel.WAY + 3] = (ahead - self._pins[:, :3]) / substeps
        self._pins[:, kernel.PULL :] = 0
        return self._pins

    def settle(self, pins: Array, x: Array, period: float) -> Array | None:
        """Take the pins back after a step and let go of what slipped.

        Returns:
            A point of the line of action of `pull` [m], shape [3]; None if there is no pull.
        """
        self._pins[:] = pins
        forces, points = -pins[:, kernel.PULL :] / period, x[self.particles, :3]
        self.pull = forces.sum(axis=0)
        point = None
        if self.pull @ self.pull > 1e-18:
            point, moment = np.empty(3), np.cross(points, forces).sum(axis=0)
            line_point(self.pull, moment, points.mean(axis=0), point)
        sizes = np.linalg.norm(forces, axis=1)
        self._share_out(sizes)
        beyond = np.linalg.norm(points - pins[:, :3], axis=1) - sizes * pins[:, kernel.PIN_SOFTNESS]
        kept = beyond < SLIP
        if not kept.all():
            self.particles, self._pins = self.particles[kept], self._pins[kept]
            self._local = self._local[kept]
        if not len(self.particles):
            self.let_go()
        return point

    def _share_out(self, sizes: Array) -> None:
        """Let each particle pull a little harder than it does, and all together as hard as they can.

        Fingers press on all of it: what one corner does not need, another may have.
        """
        total = max(float(sizes.sum()), 1e-9)
        limits = sizes * min(_MORE, self.force / total)
        self._pins[:, kernel.PIN_LIMIT] = np.maximum(
            limits, self.force / max(len(sizes), 1) / _MORE
        )

    def let_go(self) -> None:
        """Hold nothing any more."""
        self.particles, self._pins = self.particles[:0], self._pins[:0]
        self._local, self.pull = self._local[:0], np.zeros(3)

    def save(self) -> tuple[Any, ...]:
        """Return a snapshot of everything that changes."""
        return (self.particles, self._pins.copy(), self._local, self.pull)

    def restore(self, snapshot: tuple[Any, ...]) -> None:
        """Return to a snapshot, bit for bit."""
        particles, pins, local, pull = snapshot
        self.particles, self._pins = particles, pins.copy()
        self._local, self.pull = local, pull
