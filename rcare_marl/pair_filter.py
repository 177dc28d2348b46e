"""Which pairs of links were told to collide or to pass through each other: Bullet does not tell it."""

from __future__ import annotations

from typing import TypeAlias

from rcare_marl.bullet import bullet

Place: TypeAlias = tuple[int, int]  # unique id of a body, index of a link


class PairFilter:
    """The filter of a physics client. What was said of a pair last holds.

    Attributes:
        said: Whether a pair of links collides, for each pair of which something was said.
    """

    def __init__(self, client: int) -> None:
        self._client = client
        self.said: dict[frozenset[Place], bool] = {}
        self._marked: dict[frozenset[Place], bool] = {}

    def set(self, a: Place, b: Place, enabled: bool) -> None:
        """Let two links collide, or pass through each other."""
        self.said[frozenset((a, b))] = enabled
        bullet.setCollisionFilterPair(
            a[0], b[0], a[1], b[1], int(enabled), physicsClientId=self._client
        )

    def mark(self) -> None:
        """Remember who collides."""
        self._marked = dict(self.said)

    def rewind(self) -> None:
        """Return to what was marked; bodies of which nothing had been said collide."""
        if self.said == self._marked:
            return
        for pair, collide in list(self.said.items()):
            if self._marked.get(pair) != collide:
                a, b = pair if len(pair) == 2 else 2 * tuple(pair)
                self.set(a, b, self._marked.get(pair, True))
        self.said = dict(self._marked)
