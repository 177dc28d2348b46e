"""Leaves of behaviour trees for people.

A leaf gets the person and what it must know through its constructor, never through py_trees' blackboard,
which is one dictionary for the whole process, and it tells time by the simulation, never by py_trees'
timers, which run on the wall clock.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from ..human import Human

Intent = dict[str, float]  # DoF -> wished angle [rad]


class Condition(Behaviour):
    """Succeeds while something holds, else fails."""

    def __init__(self, name: str, holds: Callable[[], bool]) -> None:
        super().__init__(name)
        self._holds = holds

    def update(self) -> Status:
        return Status.SUCCESS if self._holds() else Status.FAILURE


class Pursue(Behaviour):
    """Moves DoFs towards wished angles; running until all are within a tolerance, then succeeds."""

    def __init__(
        self,
        name: str,
        person: Human,
        intent: Intent,
        wish: Callable[[], Mapping[str, float]],
        *,
        tolerance: float = 0.05,
    ) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            person: Who moves.
            intent: Shared with the policy; this leaf writes its wishes into it.
            wish: Returns the wished angle of each DoF that matters here [rad].
            tolerance: How near counts as reached [rad].
        """
        super().__init__(name)
        self._person, self._intent, self._wish, self._tolerance = person, intent, wish, tolerance

    def update(self) -> Status:
        wish = self._wish()
        self._intent.update(wish)
        near = all(abs(self._person.angle(d) - a) < self._tolerance for d, a in wish.items())
        return Status.SUCCESS if near else Status.RUNNING


class Wait(Behaviour):
    """Runs for a span of simulated time, then succeeds."""

    def __init__(self, name: str, duration: float, clock: Callable[[], float]) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            duration: How long to wait [s].
            clock: Returns the simulated time [s].
        """
        super().__init__(name)
        self._duration, self._clock = duration, clock
        self._since = 0.0

    def initialise(self) -> None:
        self._since = self._clock()

    def update(self) -> Status:
        is_over = self._clock() - self._since >= self._duration
        return Status.SUCCESS if is_over else Status.RUNNING
