"""Leaves of behaviour trees for people.

A leaf gets the person and what it must know through its constructor, never through py_trees' blackboard,
which is one dictionary for the whole process, and it tells time by the simulation, never by py_trees'
timers, which run on the wall clock.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from rcare_marl.errors import ConfigError

from ..human import Human
from .cue import Instruction

# Our own choices; muscles hold a posture less exactly than a skeletal drive does.
WELL_ENOUGH = 0.15  # [rad] from what is wished, to call it reached
PATIENCE = 6.0  # [s] after which what a sentence asks for cannot be done
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
        tolerance: float = WELL_ENOUGH,
    ) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            person: Who moves.
            intent: Shared with the policy; this leaf writes its wishes into it.
            wish: Returns the wished angle of each movable DoF that matters here [rad].
            tolerance: How near counts as reached [rad].
        """
        super().__init__(name)
        self._person, self._intent, self._wish, self._tolerance = person, intent, wish, tolerance
        self._index = {dof: i for i, dof in enumerate(person.movable)}

    def update(self) -> Status:
        wish = self._wish()
        self._intent.update(wish)
        return Status.SUCCESS if self.is_near(wish) else Status.RUNNING

    def is_near(self, wish: Mapping[str, float]) -> bool:
        """Return whether what is wished [rad] counts as reached."""
        here, index = self._person.positions, self._index
        return all(abs(here[index[dof]] - a) < self._tolerance for dof, a in wish.items())


class Settle(Pursue):
    """Moves DoFs towards wished angles; succeeds when near, or when time is up."""

    def __init__(
        self,
        name: str,
        person: Human,
        intent: Intent,
        wish: Callable[[], Mapping[str, float]],
        clock: Callable[[], float],
        *,
        patience: float,
        judged: Collection[str],
    ) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            person: Who moves.
            intent: Shared with the policy.
            wish: Returns the wished angle of each movable DoF that matters here [rad].
            clock: Returns the simulated time [s].
            patience: How long to go on at most [s].
            judged: DoFs that have to come near; the others move along.
        """
        super().__init__(name, person, intent, wish)
        self._clock, self._patience, self._judged = clock, patience, frozenset(judged)
        self._since = 0.0

    def initialise(self) -> None:
        self._since = self._clock()

    def is_near(self, wish: Mapping[str, float]) -> bool:
        return super().is_near({dof: a for dof, a in wish.items() if dof in self._judged})

    def update(self) -> Status:
        is_over = self._clock() - self._since >= self._patience - 1e-9
        return Status.SUCCESS if super().update() == Status.SUCCESS or is_over else Status.RUNNING


class Follow(Pursue):
    """Moves DoFs as long as one sentence is in force, else fails.

    Answers `done` when it is done, and `cannot` if that has not happened after `PATIENCE`.
    """

    def __init__(
        self,
        text: str,
        person: Human,
        intent: Intent,
        wish: Callable[[], Mapping[str, float]],
        instruction: Instruction,
        clock: Callable[[], float],
        *,
        is_done: Callable[[], bool] | None = None,
    ) -> None:
        """Prepare the leaf.

        Args:
            text: The sentence.
            person: Who follows.
            intent: Shared with the policy.
            wish: Returns the angles that it asks for [rad].
            instruction: The channel.
            clock: Returns the simulated time [s].
            is_done: Whether it is done in spite of angles that are not reached.
        """
        super().__init__(text, person, intent, wish)
        self._instruction, self._clock, self._is_done = instruction, clock, is_done
        self._since, self._count = 0.0, 0

    def initialise(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._since, self._count = self._clock(), self._instruction.count

    def is_near(self, wish: Mapping[str, float]) -> bool:
        return super().is_near(wish) or (self._is_done is not None and self._is_done())

    def update(self) -> Status:
        instruction = self._instruction
        if not instruction.is_asked(self.name):
            return Status.FAILURE
        if instruction.count != self._count:  # said once more
            self._begin()
        status = super().update()
        if status == Status.SUCCESS:
            instruction.answer = "done"
        elif instruction.answer == "trying" and self._clock() - self._since >= PATIENCE - 1e-9:
            instruction.answer = "cannot"
        return status


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


class Threshold(Behaviour):
    """Succeeds from one level on until a value has come back to a lower one, else fails.

    A stronger branch that interrupts does not make it forget that it has begun; a new episode does.
    """

    def __init__(
        self,
        name: str,
        value: Callable[[], float],
        clock: Callable[[], float],
        *,
        begins: float,
        ends: float,
    ) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            value: Returns what is compared.
            clock: Returns the simulated time [s]; when it goes back, a new episode has begun.
            begins: Level that it succeeds from.
            ends: Level that it fails below, once it has begun.

        Raises:
            ConfigError: If `ends` is above `begins`.
        """
        if ends > begins:
            raise ConfigError(f"{name!r} would end at {ends}, above {begins} where it begins")
        super().__init__(name)
        self._value, self._clock, self._begins, self._ends = value, clock, begins, ends
        self._is_on, self._time = False, -1.0

    def forget(self) -> None:
        """Begin a new episode, which may start at the very time of the last tick."""
        self._is_on = False

    def update(self) -> Status:
        now = self._clock()
        if now < self._time:
            self.forget()
        self._time = now
        self._is_on = self._value() >= (self._ends if self._is_on else self._begins)
        return Status.SUCCESS if self._is_on else Status.FAILURE


class Freeze(Behaviour):
    """Keeps DoFs at the angles that they have when it begins; always running."""

    def __init__(self, name: str, person: Human, intent: Intent, dofs: Sequence[str]) -> None:
        """Take what is shown in pictures, who keeps still, the shared wishes, and which DoFs."""
        super().__init__(name)
        self._person, self._intent, self._dofs = person, intent, tuple(dofs)

    def initialise(self) -> None:
        self._intent.update({dof: self._person.angle(dof) for dof in self._dofs})

    def update(self) -> Status:
        return Status.RUNNING


class LetGo(Behaviour):
    """Wishes nothing any more: muscles go slack, a skeletal drive stays where it is; always running."""

    def __init__(self, name: str, intent: Intent) -> None:
        """Take what is shown in pictures and the shared wishes."""
        super().__init__(name)
        self._intent = intent

    def update(self) -> Status:
        self._intent.clear()
        return Status.RUNNING


class Pulse(Behaviour):
    """Bends and straightens DoFs some times, as in a cough, then calls back and succeeds."""

    def __init__(
        self,
        name: str,
        person: Human,
        intent: Intent,
        depth: Mapping[str, float],
        clock: Callable[[], float],
        *,
        count: int,
        period: float,
        after: Callable[[], None],
    ) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            person: Who moves.
            intent: Shared with the policy.
            depth: How far each DoF goes from where it is [rad]; it stays inside the active range.
            clock: Returns the simulated time [s].
            count: Number of pulses.
            period: Length of a pulse [s]; the first half bends.
            after: Called once at the end.
        """
        super().__init__(name)
        self._person, self._intent, self._depth, self._clock = person, intent, dict(depth), clock
        self._count, self._period, self._after = count, period, after
        self._since, self._rest = 0.0, dict.fromkeys(depth, 0.0)

    def initialise(self) -> None:
        self._since = self._clock()
        self._rest = {dof: self._person.angle(dof) for dof in self._depth}

    def update(self) -> Status:
        pulse = (self._clock() - self._since) / self._period
        is_over = pulse >= self._count - 1e-9
        bend = 1.0 if not is_over and pulse % 1.0 < 0.5 else 0.0
        for dof, rest in self._rest.items():
            self._intent[dof] = rest + bend * self._depth[dof]
        if not is_over:
            return Status.RUNNING
        self._after()
        return Status.SUCCESS


class Withdraw(Behaviour):
    """Moves away the segment that hurts; running as long as it is ticked, fails if nothing can move."""

    def __init__(
        self,
        name: str,
        person: Human,
        intent: Intent,
        retreat: Callable[[str | None], Mapping[str, float]],
    ) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            person: Who hurts.
            intent: Shared with the policy.
            retreat: Returns by how much each DoF moves [rad] to take a segment away; None for pain
                that no contact makes.
        """
        super().__init__(name)
        self._person, self._intent, self._retreat = person, intent, retreat
        self._goal: dict[str, float] = {}
        self._segment: str | None = None

    def initialise(self) -> None:
        self._take(self._person.physiology.pain_segment)

    def _take(self, segment: str | None) -> None:
        moves = self._retreat(segment)
        self._segment = segment
        self._goal = {dof: self._person.angle(dof) + by for dof, by in moves.items()}

    def update(self) -> Status:
        segment = self._person.physiology.pain_segment
        if segment is not None and segment != self._segment:
            self._take(segment)
        if not self._goal:
            return Status.FAILURE
        self._intent.update(self._goal)
        return Status.RUNNING


class Act(Behaviour):
    """Calls a function once a tick and succeeds."""

    def __init__(self, name: str, act: Callable[[], None]) -> None:
        """Take what is shown in pictures and what to do."""
        super().__init__(name)
        self._act = act

    def update(self) -> Status:
        self._act()
        return Status.SUCCESS
