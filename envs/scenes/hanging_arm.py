"""An arm that hangs beside a wheelchair, clear of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rcare_marl.agents.people.human import Human

from ..devices import Wheelchair

OUTWARDS = "left_shoulder_abduction"
ASIDE = math.radians(1)  # a step outwards; our own choice


def gap_to(chair: Wheelchair, person: Human, links: Sequence[int], within: float) -> float:
    """Return how far links of a person are from the frame of a chair [m], `within` at most."""
    gap = person.world.separation
    return min(gap(person.body, chair.body, within=within, links=(k, -1)) for k in links)


def swing_out_of(
    chair: Wheelchair, person: Human, angles: Mapping[str, float], links: Sequence[int], within: float
) -> None:
    """Give an arm angles [rad], and swing it farther outwards until its links are out of the chair.

    Args:
        chair: The chair.
        person: Whose arm.
        angles: By name, with `OUTWARDS`, which grows to the end of its passive range at most.
        links: Of the arm.
        within: How far to look [m].
    """
    tried, most = dict(angles), person.passive[person.movable.index(OUTWARDS), 1]
    person.set_angles(tried)
    while gap_to(chair, person, links, within) < 0.0 and tried[OUTWARDS] < most:
        tried[OUTWARDS] += ASIDE
        person.set_angles(tried)
