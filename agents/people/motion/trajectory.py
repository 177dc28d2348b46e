"""Smooth motion to a posture: minimum-jerk trajectories of the joints, sampled by simulated time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Array

if TYPE_CHECKING:
    from ..human import Human


SPEED = 0.8  # [rad/s] of the fastest joint; our own choice: an unhurried movement
PEAK = 1.875  # greatest speed of a minimum-jerk movement, in its mean speed: 15 / 8


def minimum_jerk(share: float) -> float:
    """Return how far a movement has come at a `share` of its time, both in [0, 1].

    T. Flash & N. Hogan, "The coordination of arm movements", J. Neuroscience 1985: 10 s³ - 15 s⁴ + 6 s⁵.
    """
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10 - 15 * s + 6 * s * s)


class Trajectory:
    """A movement of some DoFs through postures, at rest in each of them.

    Attributes:
        dofs: The DoFs that move.
        knots: Their angles in each posture [rad], shape [k, n].
        times: When each posture is reached [s], shape [k]; the first at zero.
    """

    def __init__(self, dofs: Sequence[str], knots: Array, times: Sequence[float]) -> None:
        """Take a trajectory as it is; `to` and `through` find the times.

        Raises:
            ConfigError: If shapes differ, angles are not finite, or times do not begin at zero and
                grow.
        """
        self.dofs = tuple(dofs)
        self.knots = np.array(knots, np.float64)
        self.times = np.array(times, np.float64)
        if self.knots.shape != (len(self.times), len(self.dofs)) or not len(self.times):
            raise ConfigError(
                f"knots must have shape {(len(self.times), len(self.dofs))}, got {self.knots.shape}"
            )
        if not np.isfinite(self.knots).all():
            raise ConfigError("the angles of a trajectory must be finite")
        if self.times[0] != 0 or not (np.diff(self.times) > 0).all():
            raise ConfigError(f"times must begin at zero and grow, got {list(times)}")

    @classmethod
    def through(
        cls,
        start: Mapping[str, float],
        postures: Sequence[Mapping[str, float]],
        *,
        speed: float = SPEED,
        duration: float | None = None,
    ) -> Trajectory:
        """Return a trajectory from one posture through others, each movement as quick as allowed.

        Args:
            start: Angle of each DoF that moves [rad].
            postures: Angles to go to [rad]; a DoF that one does not name keeps its angle.
            speed: Greatest speed of any joint [rad/s].
            duration: Time for each movement [s]; as the speed allows if None.

        Raises:
            ConfigError: If the speed or duration is not positive, or the duration asks for more
                than the speed.
            UnknownNameError: If a posture names a DoF that `start` does not.
        """
        for name, value in (("speed", speed), ("duration", 1.0 if duration is None else duration)):
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"the {name} of a trajectory must be positive, got {value}")
        dofs, knots, times = tuple(start), [dict(start)], [0.0]
        for posture in postures:
            for dof in posture:
                if dof not in start:
                    raise UnknownNameError("degree of freedom of the trajectory", dof, dofs)
            knots.append(knots[-1] | dict(posture))
            farthest = max((abs(knots[-1][d] - knots[-2][d]) for d in dofs), default=0.0)
            least = PEAK * farthest / speed
            if not math.isfinite(least):
                raise ConfigError("the angles of a trajectory must be finite")
            if duration is not None and duration < least * (1 - 1e-9):
                raise ConfigError(
                    f"a movement in {duration:g} s would need {PEAK * farthest / duration:.3g} rad/s; "
                    f"at {speed:g} rad/s it takes {least:.3g} s"
                )
            times.append(times[-1] + (max(least, 1e-3) if duration is None else duration))
        return cls(dofs, np.array([[k[d] for d in dofs] for k in knots]), times)

    @classmethod
    def to(
        cls,
        person: Human,
        angles: Mapping[str, float],
        *,
        speed: float = SPEED,
        duration: float | None = None,
    ) -> Trajectory:
        """Return a trajectory of a spawned person from the present angles to `angles` [rad].

        Args:
            person: Who moves.
            angles: Where to, by DoF [rad]; each is kept inside the person's active range.
            speed: Greatest speed of any joint [rad/s].
            duration: Time for the movement [s]; as the speed allows if None.

        Raises:
            UnknownNameError: If a DoF does not move.
        """
        limits = dict(zip(person.movable, person.active.tolist(), strict=True))
        for dof in angles:
            if dof not in limits:
                raise UnknownNameError("movable degree of freedom", dof, person.movable)
        start = {dof: person.angle(dof) for dof in angles}
        goal = {}
        for dof, angle in angles.items():
            low, high = limits[dof]  # widened to where the person is: nobody is thrown back
            goal[dof] = min(max(angle, min(low, start[dof])), max(high, start[dof]))
        return cls.through(start, [goal], speed=speed, duration=duration)

    @property
    def duration(self) -> float:
        """When the last posture is reached [s]."""
        return float(self.times[-1])

    def _place(self, time: float) -> tuple[int, float]:
        """Return the movement that a time falls into, and the share of it that has passed."""
        k = int(np.searchsorted(self.times, time, side="right"))
        k = min(max(k, 1), max(len(self.times) - 1, 1))
        if len(self.times) == 1:
            return 0, 1.0
        before, after = self.times[k - 1], self.times[k]
        return k - 1, float((time - before) / (after - before))

    def sample(self, time: float) -> dict[str, float]:
        """Return the angle of each DoF [rad] at a time [s]; before and after it rests at the ends."""
        k, share = self._place(time)
        last = min(k + 1, len(self.knots) - 1)
        values = self.knots[k] + minimum_jerk(share) * (self.knots[last] - self.knots[k])
        return dict(zip(self.dofs, values.tolist(), strict=True))
