"""Whether a task can be done for the people of its cast at all: said before an episode, with the reason."""

from __future__ import annotations

from typing import NamedTuple

from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from rcare_marl.pose import Array
from rcare_marl.world import GRAVITY


class Feasibility(NamedTuple):
    """Whether a task can be done for a cast.

    Attributes:
        holds: Whether it can.
        reason: Why not; empty if it can.
    """

    holds: bool
    reason: str


FEASIBLE = Feasibility(True, "")


def can_bear(mass: float, limit: float) -> Feasibility:
    """Return whether a cradle may bear a whole arm, as it does where shoulder and elbow are slack.

    Args:
        mass: Of the arm [kg].
        limit: Force with which the cradle may press [N].
    """
    weight = GRAVITY * mass
    if weight < limit:
        return FEASIBLE
    reason = (
        f"the arm weighs {weight:.0f} N and may rest on the cradle with all of it, which may press "
        f"with {limit:.0f} N at most"
    )
    return Feasibility(False, reason)


def girth_along(points: Array) -> float:
    """Return the least girth of a sleeve [m] that passes along x over points [m], shape [n, 3]."""
    return float(ConvexHull(points[:, 1:]).area)  # in the plane the perimeter
