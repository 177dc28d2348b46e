"""A left arm that hangs beside a wheelchair: where it rests, clear of the chair, and who can bear it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

from rcare_marl.agents.people.human import Human
from rcare_marl.world import GRAVITY

from ..devices import Wheelchair
from ..feasibility import FEASIBLE, Feasibility
from ..task import Task

OUTWARDS = "left_shoulder_abduction"
SWING = {  # of the arm out of where it hangs, forward and outward
    OUTWARDS: math.radians(10),
    "left_shoulder_flexion": math.radians(15),
    "left_elbow_flexion": math.radians(25),
}
# [m] along and across from the pad's middle, where it is tried to lie; a hand at the thigh pushes outward.
LAID = tuple(itertools.product((0.0, -0.03, -0.06, -0.09, -0.12), (0.0, -0.015)))
SETTLE_STEPS = 1440  # physics steps that the arm gets to come to rest, each time
ASIDE = math.radians(1)  # a step outwards; our own choice


def can_bear(person: Human, limit: float) -> Feasibility:
    """Return whether a cradle may bear the whole arm, as it does where shoulder and elbow are slack.

    Args:
        person: Whose arm.
        limit: Force with which the cradle may press [N].
    """
    weight = arm_weight(person)
    if weight < limit:
        return FEASIBLE
    reason = (
        f"the arm weighs {weight:.0f} N and may rest on the cradle with all of it, which may press "
        f"with {limit:.0f} N at most"
    )
    return Feasibility(False, reason)


def arm_weight(person: Human) -> float:
    """Return what the left arm weighs, hand and all [N]."""
    parts = (person.segments[f"left_{name}"] for name in ("shoulder", "elbow", "wrist"))
    return GRAVITY * sum(part.mass for part in parts)


def come_to_rest(task: Task, person: Human) -> None:
    """Let the arm of somebody who does nothing come to rest, while all others hold still."""
    for _ in range(SETTLE_STEPS // 24):
        person.command(person.slack_action(task.control_dt), task.control_dt)
        task.settle(24)
    person.sense()


def gap_to(chair: Wheelchair, person: Human, links: Sequence[int], within: float) -> float:
    """Return how far links of a person are from the frame of a chair [m], `within` at most."""
    gap = person.world.separation
    return min(gap(person.body, chair.body, within=within, links=(k, -1)) for k in links)


def swing_out_of(
    chair: Wheelchair,
    person: Human,
    angles: Mapping[str, float],
    links: Sequence[int],
    within: float,
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
