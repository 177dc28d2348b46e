"""The scoring of the PhyRC challenges: items in a fixed order, looked at once a second."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

CHECK_EVERY = 1.0  # [s]: the challenge's scenes
PICK_UP_TIME = 3.0  # [s] that a thing is held without a break: the challenge's scenes
FULL_SCORE = 50  # points of a challenge

# What an item is worth now; None while it is not earned.
Item = Callable[[], "int | None"]


class ScoreSheet:
    """Points by item.

    Items are in order: one that is not earned yet keeps all later ones from counting, unless it is a
    loose one. What was earned stays; an item that still tells a number has that number.

    Attributes:
        points: Points of each item, 0 where it was not earned.
    """

    def __init__(self, items: Mapping[str, Item], *, loose: Collection[str] = ()) -> None:
        """Take the items by name, in their order, and the names of those that keep no other back."""
        self._items, self._loose = dict(items), frozenset(loose)
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self.points = dict.fromkeys(self._items, 0)
        self._earned: set[str] = set()
        self._checked = 0

    @property
    def stage(self) -> int:
        """How many items were earned."""
        return len(self._earned)

    @property
    def total(self) -> int:
        """Sum of the points."""
        return sum(self.points.values())

    def update(self, time: float) -> None:
        """Look at the items if a second has passed since the last look; `time` is of the episode [s]."""
        second = int(time / CHECK_EVERY + 1e-9)
        if second == self._checked:
            return
        self._checked = second
        for name, item in self._items.items():
            worth = item()
            if worth is not None:
                self._earned.add(name)
                self.points[name] = worth
            elif name not in self._earned and name not in self._loose:
                return


class Stopwatch:
    """How long something has lasted without a break [s]."""

    def __init__(self) -> None:
        self.time = 0.0

    def reset(self) -> None:
        """Begin anew."""
        self.time = 0.0

    def update(self, lasts: bool, duration: float) -> None:
        """Count `duration` [s] if it lasts, else begin anew."""
        self.time = self.time + duration if lasts else 0.0
