"""In which order Bullet solves motors, ends of joints, gears and bonds.

Bullet keeps one list of them. A body adds the ends of its joints and then their motors as it is loaded,
gears and bonds come as they are made, and what goes leaves its place to the last. In each physics step a copy
is sorted by island, with a quicksort that is not stable: equal rows come out in an order that depends on how
many there are. All that is awake is one island (see `World`), so that the order is the same in each step. The
sweeps do not converge, so it shows: in a resting arm that holds a sponge by 0.1 N·m after the first step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from rcare_marl.bullet import bullet

if TYPE_CHECKING:
    from rcare_marl.body import Body

    from .native import Ints

END, MOTOR, GEAR, BOND, TIE = "end", "motor", "gear", "bond", "tie"
Row = tuple[str, Any, int]  # which of these, of which body or bond, of which joint


class RowOrder:
    """Bullet's list of the motors, ends of joints, gears and bonds of a world."""

    def __init__(self) -> None:
        """Begin with none."""
        self._rows: list[Row] = []

    def __contains__(self, row: Row) -> bool:
        return row in self._rows

    def load(self, body: Body, client: int) -> None:
        """Add what a body that was just loaded into the physics `client` brings along."""
        joints = sorted(joint.index for joint in body.joints.values())
        ranges = {i: bullet.getJointInfo(body.uid, i, client)[8:10] for i in joints}
        self._rows += [(END, body, i) for i in joints if ranges[i][0] <= ranges[i][1]]
        self._rows += [(MOTOR, body, i) for i in joints]

    def add(self, row: Row) -> None:
        """Add one that was made."""
        self._rows.append(row)

    def remove(self, row: Row) -> None:
        """Remove one; the last takes its place."""
        place = self._rows.index(row)
        self._rows[place] = self._rows[-1]
        self._rows.pop()

    def sorted(self, is_apart: Callable[[Row], bool]) -> list[Row]:
        """Return them in the order in which Bullet solves them.

        Args:
            is_apart: Whether a row is of furniture that may sleep, in an island of its own. (While somebody
                touches that, Bullet has it in the others' island; this order does not know.)
        """
        keys = np.array([is_apart(row) for row in self._rows], np.int64)
        order = np.arange(len(keys))
        if len(keys) > 1:
            quicksort(keys, order)
        return [self._rows[i] for i in order]


@numba.njit(cache=True)
def quicksort(keys: Ints, order: Ints) -> None:
    """Sort `order` by `keys` as Bullet's arrays do, which swap what is equal as well."""
    ranges, count = np.empty((len(order) + 1, 2), np.int64), 1
    ranges[0, 0], ranges[0, 1] = 0, len(order) - 1
    while count > 0:
        count -= 1
        low, high = ranges[count, 0], ranges[count, 1]
        i, j = low, high
        middle = keys[order[(low + high) // 2]]
        while i <= j:
            while keys[order[i]] < middle:
                i += 1
            while middle < keys[order[j]]:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        for begin, end in ((low, j), (i, high)):
            if begin < end:
                ranges[count, 0], ranges[count, 1] = begin, end
                count += 1
