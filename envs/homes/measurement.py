"""What an audit measures in a home, and the free floor as seen from what stands on it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal

from rcare_marl.pose import Pose

from ..rectangle import Rectangle
from .care_home import CareHome
from .occupancy import Obstacle, Occupancy

FAR = 5.0  # [m]; what is free further than this is not measured


@dataclass(frozen=True)
class Measurement:
    """Something measured that a rule is about.

    Attributes:
        rule: Name of the rule.
        room: Name of the room; empty for what belongs to none.
        what: What was measured, such as `bedroom_2.bed`.
        value: In the unit of the rule, or the word for what is there; None for nothing of the kind.
    """

    rule: str
    room: str
    what: str
    value: float | str | None


class Surroundings:
    """What stands round a place, seen in its frame, which is turned by quarter turns.

    Attributes:
        inside: The floor of the room between its walls [m].
    """

    def __init__(
        self,
        home: CareHome,
        room: str,
        pose: Pose,
        *,
        but: Collection[str] = (),
        kinds_but: Collection[str] = (),
    ) -> None:
        """Look round.

        Args:
            home: The home.
            room: Name of the room.
            pose: Of the frame in the house.
            but: Names of furniture to look through.
            kinds_but: Kinds of furniture to look through.
        """
        area = home.plan.room(room).inside
        back = pose.inverse()
        self.inside = area.moved(back)
        through = set(but) | {p.name for p in home.placed if p.piece.kind in kinds_but}
        self._areas = [
            obstacle.area.moved(back)
            for obstacle in near(home.clearance, area.grown(FAR))
            if obstacle.name not in through
        ]

    def free(
        self, start: float, span: tuple[float, float], *, along: Literal["x", "y"], sign: int = 1
    ) -> float:
        """Return how far a strip is free.

        Args:
            start: Where the strip starts, on the axis that it runs along [m].
            span: Its sides, on the other axis [m].
            along: The axis.
            sign: 1 to look up the axis, -1 to look down.

        Returns:
            Length of the free strip, 0 where something reaches over its start, at most `FAR` [m].
        """
        best = FAR
        for area in self._areas:
            x, y = (area.x0, area.x1), (area.y0, area.y1)
            ahead, across = (x, y) if along == "x" else (y, x)
            if min(across[1], span[1]) - max(across[0], span[0]) <= 1e-6:
                continue
            low, high = sorted((sign * (end - start)) for end in ahead)
            if high > 1e-6:
                best = min(best, max(low, 0.0))
        return best


def near(occupancy: Occupancy, area: Rectangle) -> Iterable[Obstacle]:
    """Return the obstacles of a map that reach into `area`."""
    return (o for o in occupancy.obstacles if o.area.overlaps(area))
