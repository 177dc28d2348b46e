"""A way with times along it, within limits of speed and acceleration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from .search import dense

SPACING = 0.05  # [rad or m] between the points through which a path is led; own choice
SAMPLING = 0.01  # [s] between the points of a path


@dataclass(frozen=True, eq=False)
class Path:
    """Where joints are at which time, from rest to rest.

    Attributes:
        joints: Their names.
        times: From the start [s], shape [k]; 0 first.
        positions: Of the joints [rad or m], shape [k, n].
        planning_s: How long it took to plan [s].
        way: Its corners before times were given [rad or m], shape [m, n].
        is_straight: Whether it goes straight, all joints at once.
    """

    joints: tuple[str, ...]
    times: Array
    positions: Array
    planning_s: float
    way: Array
    is_straight: bool
    _holds: Callable[[Array], bool] = field(repr=False)
    _again: Callable[[], Path] = field(repr=False)

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.times[-1])

    def at(self, time: float) -> Array:
        """Return where the joints are at a time [s], shape [n]; at the ends before and after it."""
        columns = self.positions.T
        return np.array([np.interp(time, self.times, column) for column in columns])

    def is_clear(self, after: float = 0.0) -> bool:
        """Return whether what is left of it is clear of everything as it stands now.

        Args:
            after: What of it is past [s].
        """
        left = self.positions[self.times >= after]
        return self._holds(left if len(left) else self.positions[-1:])

    def renewed(self, after: float = 0.0) -> Path:
        """Return it if what is left is clear, else a new path from where the joints are now.

        Args:
            after: What of it is past [s].

        Raises:
            PlanningError: If there is none.
        """
        return self if self.is_clear(after) else self._again()


def timed(
    way: Array,
    velocity: Array,
    acceleration: Array,
    effort: Callable[[Array, Array], float] | None = None,
) -> tuple[Array, Array]:
    """Return times [s], shape [k], and places [rad or m], shape [k, n], from rest to rest.

    By time-optimal path parameterisation: H. Pham and Q.-C. Pham, A New Approach to Time-Optimal Path
    Parameterization Based on Reachability Analysis, IEEE Transactions on Robotics 34 (2018).

    Args:
        way: Corners, shape [m, n].
        velocity: Greatest speeds [rad/s or m/s], shape [n].
        acceleration: Greatest accelerations [rad/s² or m/s²], shape [n].
        effort: Returns what accelerations at places need of what motors have left, as a share; each of shape
            [k, n]. All of the way is slowed until it is 1 at most.

    Raises:
        ConfigError: If the way cannot be timed.
    """
    if len(way) < 2 or np.abs(way - way[0]).max() < 1e-9:
        return np.zeros(1), way[:1]
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    points = dense(way, SPACING)
    lengths = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    keep = np.concatenate(([True], np.diff(lengths) > 1e-9))
    spline = toppra.SplineInterpolator(lengths[keep], points[keep])
    limits = [
        constraint.JointVelocityConstraint(np.column_stack((-velocity, velocity))),
        constraint.JointAccelerationConstraint(np.column_stack((-acceleration, acceleration))),
    ]
    grid = np.linspace(0.0, lengths[-1], max(4 * len(points), 50) + 1)
    made = algorithm.TOPPRA(limits, spline, gridpoints=grid, parametrizer="ParametrizeConstAccel")
    trajectory = made.compute_trajectory()
    if trajectory is None:
        raise ConfigError("no times can be given to a way within its limits of acceleration")
    # Limits hold at the points of the grid. Between them, and from point to point of the path, a little may
    # be missing.
    times = np.linspace(0.0, trajectory.duration, max(int(trajectory.duration / SAMPLING), 2) + 1)
    positions, asked = np.asarray(trajectory(times)), np.asarray(trajectory(times, 2))
    speeds = np.diff(positions, axis=0) / times[1]
    fast = (np.abs(np.concatenate((trajectory(times, 1), speeds))) / velocity).max()
    changes = np.diff(speeds, axis=0) / times[1]
    hard = (np.abs(np.concatenate((asked, changes))) / acceleration).max()
    share = 0.0 if effort is None else effort(positions, asked)
    slower = max(float(fast), float(max(hard, share)) ** 0.5, 1.0)
    return times * slower, positions
