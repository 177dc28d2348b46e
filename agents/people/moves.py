"""What actions of a person do beside moving the joints: `walk`, `kneel`, `grasp` and `speak`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rcare_marl.errors import check_name
from rcare_marl.observable import Observable
from rcare_marl.pose import Array
from rcare_marl.world import World

from .body.ik import arm_dofs
from .body.skeleton import SIDES
from .hand import Hand
from .motion.legs import KNEEL_NAMES, WALK_NAMES, Legs

if TYPE_CHECKING:
    from .human import Human

MOVES = ("walk", "kneel", "grasp", "speak")
SPOKEN = 0.5  # value of an action from which somebody says no
SPEAK_NAMES = ("says no, from 0.5 on [1]",)


def expand_moves(names: Sequence[str]) -> tuple[str, ...]:
    """Return the moves in the order of an action; UnknownNameError if there is no such one."""
    for name in names:
        check_name("move of a person", name, MOVES)
    return tuple(name for name in MOVES if name in names)


class Moves:
    """Splits the actions of a person: values for joints first, then for each of `MOVES`.

    Attributes:
        action_names: What each action value moves, with its unit.
        entries: Where the values of each move are in an action.
        legs: What walks and kneels, if anything.
        hands: What grasps, by side: each hand whose arm can move.
        says_no: Whether the person said no in the last control step: by voice, or by the eyes or a
            switch where there is no voice.
    """

    def __init__(self, person: Human, world: World) -> None:
        """Take a spawned person in the posture of the start.

        Raises:
            ConfigError: If the person cannot walk or kneel.
        """
        moves, self._person = person.moves, person
        self.says_no = False
        walks = "walk" in moves or "kneel" in moves
        self.legs = Legs(person, world.physics_dt) if walks else None
        sides = [s for s in SIDES if "grasp" in moves and arm_dofs(person, s, trunk=False)]
        self.hands = {side: Hand(person, side, world) for side in sides}
        names = list(person.drive.action_names)
        if self.legs is not None:
            dofs = enumerate(person.movable)
            self._joints = [i for i, dof in dofs if dof not in self.legs.dofs]
            names = [names[i] for i in self._joints]
        self._count = len(names)  # of joints
        self.entries: dict[str, slice] = {}
        grips = [hand.action_name for hand in self.hands.values()]
        for move, values in zip(MOVES, (WALK_NAMES, KNEEL_NAMES, grips, SPEAK_NAMES), strict=True):
            if move in moves:
                self.entries[move] = slice(len(names), len(names) + len(values))
                names += values
        self.action_names = tuple(names)

    def reset(self) -> None:
        """Stand still with open hands, silent."""
        self.says_no = False
        if self.legs is not None:
            self.legs.reset()
        for hand in self.hands.values():
            hand.open()

    def split(self, action: Array) -> Array:
        """Command legs, hands and voice, and return what is left for the drive."""
        joints = action[: self._count]
        if self.legs is not None:
            joints = np.zeros(len(self._person.movable))
            joints[self._joints] = action[: self._count]
            walk, kneel = (self.entries.get(move, slice(0, 0)) for move in ("walk", "kneel"))
            self.legs.command(action[walk], action[kneel])
        grips = action[self.entries.get("grasp", slice(0, 0))].tolist()
        for hand, value in zip(self.hands.values(), grips, strict=True):
            hand.command(value)
        self.says_no = bool((action[self.entries.get("speak", slice(0, 0))] >= SPOKEN).any())
        return joints

    def joined(self, joints: Array) -> Array:
        """Return the action of an action of the drive: legs and hands do nothing, nothing is said."""
        action = np.zeros(len(self.action_names))
        action[: self._count] = joints if self.legs is None else joints[self._joints]
        return action

    def observables(self) -> list[Observable]:
        """Return what the person senses of legs and hands."""
        legs = [] if self.legs is None else self.legs.observables(self._person.moves)
        return legs + [seen for hand in self.hands.values() for seen in hand.observables()]
