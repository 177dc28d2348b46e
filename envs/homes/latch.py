"""Latches, which hold doors shut until their handles are turned."""

from __future__ import annotations

from dataclasses import dataclass

from rcare_marl.body import Body
from rcare_marl.contact import Contact
from rcare_marl.world import World

LOOK = 8  # physics steps between two looks at a latch: nobody turns a handle and back within 33 ms
PLAY = 0.002  # [rad] that a latched door can be moved; own choice
CATCH = 0.004  # [rad] from shut within which the bolt falls into its hole; own choice


@dataclass
class Latch:
    """The latch of a hinged door.

    Attributes:
        body: The door.
        hinge: Index of the joint that it holds.
        handle: Index of the joint that draws the bolt, either way.
        release: How far the handle is turned when the bolt is out of its hole [rad].
        swing: How far the door opens [rad].
        is_latched: Whether it holds the door.
    """

    body: Body
    hinge: int
    handle: int
    release: float
    swing: float
    is_latched: bool = True

    def set(self, is_latched: bool) -> None:
        """Let the bolt in or out."""
        self.is_latched = is_latched
        # Limits hold against any force, and cost nothing while the door does not press on them.
        self.body.limit_joint(self.hinge, -PLAY, PLAY if is_latched else self.swing)

    def look(self) -> None:
        """Let the bolt follow the handle; its slanted face lets a shutting door push it back."""
        (angle, turn), _ = self.body.joint_states((self.hinge, self.handle))
        if self.is_latched:
            if abs(turn) >= self.release:
                self.set(False)
        elif angle < CATCH and abs(turn) < self.release:
            self.set(True)


class Latches:
    """All latches of a world; it steps, marks and rewinds them."""

    def __init__(self) -> None:
        self._latches: list[Latch] = []
        self._marked: list[bool] = []
        self._countdown = LOOK
        self._marked_countdown = LOOK

    @staticmethod
    def of(world: World) -> Latches:
        """Return the latches of a world; they come into being when they are first asked for."""
        for matter in world.matter:
            if isinstance(matter, Latches):
                return matter
        made = Latches()
        world.matter.append(made)
        return made

    def add(self, latch: Latch) -> None:
        """Put a latch into the world, as it stands."""
        self._latches.append(latch)
        latch.set(latch.is_latched)

    def step(self) -> None:
        """Look at all latches now and then."""
        self._countdown -= 1
        if self._countdown == 0:
            self._countdown = LOOK
            for latch in self._latches:
                latch.look()

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return nothing: latches touch nobody."""
        return []

    def mark(self) -> None:
        """Remember which doors are latched."""
        self._marked = [latch.is_latched for latch in self._latches]
        self._marked_countdown = self._countdown

    def rewind(self) -> None:
        """Return to what was marked."""
        for latch, is_latched in zip(self._latches, self._marked, strict=True):
            latch.set(is_latched)
        self._countdown = self._marked_countdown
