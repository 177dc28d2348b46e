"""Who acts in a behaviour tree, its leaves, and how they are joined.

A leaf gets the actor and what it must know through its constructor, never through py_trees' blackboard,
which is one dictionary for the whole process, and it tells time by the simulation, never by py_trees'
timers, which run on the wall clock.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status
from py_trees.composites import Parallel, Selector

from rcare_marl.errors import ConfigError

from ..body.skeleton import DOF_INDEX, DOFS
from ..human import Human
from .cue import Cues

# Our own choices; muscles hold a posture less exactly than a skeletal drive does.
WELL_ENOUGH = 0.15  # [rad] from what is wished, to call it reached
LEAST_SHARE = 0.5  # of the way that a sentence asks for: less is not to have done it
LEAST_WAY = 0.1  # [rad] from where there is something to do
PATIENCE = 6.0  # [s] after which what a sentence asks for cannot be done
LEAST_RANGE = math.radians(4)  # of active movement, below which a DoF is of no use
MOVING_GRADE = 2.0  # MMT grade that moves anything: grade 1 is a flicker
Intent = dict[str, float]  # DoF -> wished angle [rad]


@dataclass
class Deed:
    """What a person does in the coming control step beside moving towards the wished angles.

    Attributes:
        says_no: Whether they say that they do not want something.
        works: Whether they do their job in the scene, in place of the wishes.
    """

    says_no: bool = False
    works: bool = False

    def clear(self) -> None:
        """Do nothing of it."""
        self.says_no = self.works = False


@dataclass(frozen=True)
class Actor:
    """What the leaves of one tree share.

    Attributes:
        person: Who acts.
        clock: Returns the simulated time [s].
        cues: What reaches the person from outside.
        intent: Wished angles [rad] that the leaves write and the policy pursues.
        deed: What the leaves do beside, which the policy puts into the action.
    """

    person: Human
    clock: Callable[[], float]
    cues: Cues = field(default_factory=Cues)
    intent: Intent = field(default_factory=dict)
    deed: Deed = field(default_factory=Deed)

    def can_move(self, dof: str) -> bool:
        """Return whether a DoF moves in the scene and the person can move it of their own will."""
        if dof not in self.person.movable:
            return False
        low, high = self.person.active[self.person.movable.index(dof)]
        return bool(high - low >= LEAST_RANGE) and max(self._grades(dof)) >= MOVING_GRADE

    def _grades(self, dof: str) -> tuple[float, float]:
        """Return the MMT grades against and along a DoF."""
        profile, row = self.person.avatar.profile, DOFS[DOF_INDEX[dof]]
        return profile.grade(row, positive=False), profile.grade(row, positive=True)

    def can_reach(self, angles: Mapping[str, float]) -> bool:
        """Return whether the person has muscles and range to go half of the way to some wishes [rad].

        The first wish of a limb counts, such as the shoulder of a raised arm, and any of the head.
        """
        return any(
            self._can_set_out(dof, angle)
            for i, (dof, angle) in enumerate(angles.items())
            if i == 0 or dof.startswith(("neck", "head"))
        )

    def _can_set_out(self, dof: str, angle: float) -> bool:
        against, along = self._grades(dof)
        start = float(self.person.angles[DOF_INDEX[dof]])
        grade = along if angle > start else against
        if not self.can_move(dof) or grade < MOVING_GRADE:
            return False
        able, way = self.able({dof: angle})[dof] - start, angle - start
        return abs(way) <= LEAST_WAY or able / way >= LEAST_SHARE

    def able(self, angles: Mapping[str, float]) -> dict[str, float]:
        """Return those wishes [rad] that the person can move towards, inside the active range."""
        index = self.person.movable.index
        return {
            dof: float(np.clip(angle, *self.person.active[index(dof)]))
            for dof, angle in angles.items()
            if self.can_move(dof)
        }

    def start(self, *prefixes: str) -> dict[str, float]:
        """Return the start posture [rad] of the DoFs whose joint begins so, where they can move."""
        return {
            dof: float(self.person.angles[DOF_INDEX[dof]])
            for dof in self.person.movable
            if dof.startswith(prefixes) and self.can_move(dof)
        }


class Condition(Behaviour):
    """Succeeds while something holds, else fails."""

    def __init__(self, name: str, holds: Callable[[], bool]) -> None:
        super().__init__(name)
        self._holds = holds

    def update(self) -> Status:
        return Status.SUCCESS if self._holds() else Status.FAILURE


class Pursue(Behaviour):
    """Moves DoFs towards wished angles; running until all are near them, then succeeds."""

    def __init__(self, name: str, actor: Actor, wish: Callable[[], Mapping[str, float]]) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            actor: Who moves.
            wish: Returns the wished angle of each movable DoF that matters here [rad].
        """
        super().__init__(name)
        self._actor, self._wish = actor, wish
        self._index = {dof: i for i, dof in enumerate(actor.person.movable)}

    def update(self) -> Status:
        wish = self._wish()
        self._actor.intent.update(wish)
        return Status.SUCCESS if self.is_near(wish) else Status.RUNNING

    def is_near(self, wish: Mapping[str, float]) -> bool:
        """Return whether what is wished [rad] counts as reached."""
        here, index = self._actor.person.positions, self._index
        return all(abs(here[index[dof]] - a) < WELL_ENOUGH for dof, a in wish.items())


class Settle(Pursue):
    """Moves DoFs towards wished angles; succeeds when near, or when time is up."""

    def __init__(
        self,
        name: str,
        actor: Actor,
        wish: Callable[[], Mapping[str, float]],
        *,
        patience: float,
        judged: Collection[str],
    ) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            actor: Who moves.
            wish: Returns the wished angle of each movable DoF that matters here [rad].
            patience: How long to go on at most [s].
            judged: DoFs that have to come near; the others move along.
        """
        super().__init__(name, actor, wish)
        self._patience, self._judged = patience, frozenset(judged)
        self._since = 0.0

    def initialise(self) -> None:
        self._since = self._actor.clock()

    def is_near(self, wish: Mapping[str, float]) -> bool:
        return super().is_near({dof: a for dof, a in wish.items() if dof in self._judged})

    def update(self) -> Status:
        is_over = self._actor.clock() - self._since >= self._patience - 1e-9
        return Status.SUCCESS if super().update() == Status.SUCCESS or is_over else Status.RUNNING


class Follow(Pursue):
    """Moves DoFs as long as one sentence is in force, else fails.

    Answers `done` when it is done, and `cannot` if that has not happened after `PATIENCE`. It is done when
    every angle is reached well enough, and half of the way gone where there was one to go.
    """

    def __init__(
        self,
        text: str,
        actor: Actor,
        wish: Callable[[], Mapping[str, float]],
        *,
        is_done: Callable[[], bool] = lambda: False,
    ) -> None:
        """Prepare the leaf.

        Args:
            text: The sentence.
            actor: Who follows.
            wish: Returns the angles that it asks for [rad].
            is_done: Whether it is done in spite of angles that are not reached.
        """
        super().__init__(text, actor, wish)
        self._instruction, self._is_done = actor.cues.instruction, is_done
        self._since, self._count = 0.0, 0
        self._from: Sequence[float] = ()

    def initialise(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._since, self._count = self._actor.clock(), self._instruction.count
        self._from = tuple(self._actor.person.positions)

    def is_near(self, wish: Mapping[str, float]) -> bool:
        return (super().is_near(wish) and self._has_gone(wish)) or self._is_done()

    def _has_gone(self, wish: Mapping[str, float]) -> bool:
        """Return whether half of the way has been gone of every wish [rad] that was some way off.

        The joints of the spine, which share their muscles, go theirs together.
        """
        here, index = self._actor.person.positions, self._index
        ways, gone = dict[str, float](), dict[str, float]()
        for dof, angle in wish.items():
            joint, _, motion = dof.partition("_")
            key = motion if joint.startswith("spine") else dof
            start = self._from[index[dof]]
            ways[key] = ways.get(key, 0.0) + angle - start
            gone[key] = gone.get(key, 0.0) + here[index[dof]] - start
        return all(
            gone[key] / way >= LEAST_SHARE for key, way in ways.items() if abs(way) > LEAST_WAY
        )

    def update(self) -> Status:
        instruction = self._instruction
        if not instruction.is_asked(self.name):
            return Status.FAILURE
        if instruction.count != self._count:  # said once more
            self._begin()
        status = super().update()
        if status == Status.SUCCESS:
            instruction.answer = "done"
        elif instruction.answer == "trying":
            if self._actor.clock() - self._since >= PATIENCE - 1e-9:
                instruction.answer = "cannot"
        return status


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

    def __init__(self, name: str, actor: Actor, dofs: Sequence[str]) -> None:
        """Take what is shown in pictures, who keeps still, and which DoFs."""
        super().__init__(name)
        self._actor, self._dofs = actor, tuple(dofs)

    def initialise(self) -> None:
        self._actor.intent.update({dof: self._actor.person.angle(dof) for dof in self._dofs})

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
        actor: Actor,
        depth: Mapping[str, float],
        *,
        count: int,
        period: float,
        after: Callable[[], None],
    ) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            actor: Who moves.
            depth: How far each DoF goes from where it is [rad]; it stays inside the active range.
            count: Number of pulses.
            period: Length of a pulse [s]; the first half bends.
            after: Called once at the end.
        """
        super().__init__(name)
        self._actor, self._depth = actor, dict(depth)
        self._count, self._period, self._after = count, period, after
        self._since, self._rest = 0.0, dict.fromkeys(depth, 0.0)

    def initialise(self) -> None:
        self._since = self._actor.clock()
        self._rest = {dof: self._actor.person.angle(dof) for dof in self._depth}

    def update(self) -> Status:
        pulse = (self._actor.clock() - self._since) / self._period
        is_over = pulse >= self._count - 1e-9
        bend = 1.0 if not is_over and pulse % 1.0 < 0.5 else 0.0
        for dof, rest in self._rest.items():
            self._actor.intent[dof] = rest + bend * self._depth[dof]
        if not is_over:
            return Status.RUNNING
        self._after()
        return Status.SUCCESS


class Withdraw(Behaviour):
    """Moves away the segment that hurts; running as long as it is ticked, fails if nothing can move."""

    def __init__(
        self,
        name: str,
        actor: Actor,
        retreat: Callable[[str | None], Mapping[str, float]],
    ) -> None:
        """Prepare the leaf.

        Args:
            name: Shown in pictures of the tree.
            actor: Who hurts.
            retreat: Returns by how much each DoF moves [rad] to take a segment away; None for pain
                that no contact makes.
        """
        super().__init__(name)
        self._actor, self._retreat = actor, retreat
        self._goal: dict[str, float] = {}
        self._segment: str | None = None

    def initialise(self) -> None:
        self._take(self._actor.person.physiology.pain_segment)

    def _take(self, segment: str | None) -> None:
        moves = self._retreat(segment)
        self._segment = segment
        self._goal = {dof: self._actor.person.angle(dof) + by for dof, by in moves.items()}

    def update(self) -> Status:
        segment = self._actor.person.physiology.pain_segment
        if segment is not None and segment != self._segment:
            self._take(segment)
        if not self._goal:
            return Status.FAILURE
        self._actor.intent.update(self._goal)
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


def when(name: str, *steps: Behaviour) -> composites.Sequence:
    """Return steps one after the other; the first may be a condition, which is asked at every tick."""
    return composites.Sequence(name, memory=False, children=list(steps))


def together(name: str, *branches: Behaviour) -> Parallel:
    """Return branches that run at the same time; they must move different DoFs."""
    policy = ParallelPolicy.SuccessOnAll(synchronise=False)
    return Parallel(name, policy=policy, children=list(branches))


def first_of(name: str, *branches: Behaviour) -> Selector:
    """Return branches of which the first that does not fail runs, chosen anew at every tick."""
    return Selector(name, memory=False, children=list(branches))
