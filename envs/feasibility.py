"""Whether a task can be done for the people of its cast at all: said before an episode, with the reason."""

from __future__ import annotations

from typing import NamedTuple

from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from rcare_marl.pose import Array


class Feasibility(NamedTuple):
    """Whether a task can be done for a cast.

    Attributes:
        holds: Whether it can.
        reason: Why not; empty if it can.
    """

    holds: bool
    reason: str


FEASIBLE = Feasibility(True, "")


def girth_along(points: Array) -> float:
    """Return the least girth of a sleeve [m] that passes along x over points [m], shape [n, 3]."""
    return float(ConvexHull(points[:, 1:]).area)  # in the plane the perimeter
