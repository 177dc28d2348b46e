"""What dressing reads, and when its hem counts as stalled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcare_marl.pose import Array

from ..state import State

# [m] that the hem has to make in so many [s], or it counts as stalled, and [m] that it is eased back then;
# our own choices.
HEADWAY, STALLED, EASE = 0.03, 2.0, 0.08
# [m] of the ankle from where it is when the leg is up: a heavy one hangs a little, and more [m] if it goes no
# farther, or not faster than so [m/s]; our own choices.
LIFTED, HANGING, STILL = 0.1, 0.14, 0.02


@dataclass(frozen=True, eq=False)
class DressingState(State):
    """What dressing reads."""

    hem: Array  # middle of the hem [m], shape [3]
    gap: Array  # from there to its target [m], shape [3]
    distance: float  # length of that [m]
    along: float  # how far from the ankle the leg goes through the hem [m]
    target_along: float  # how far it is to go [m]
    begun: float  # how far it was as the episode began [m]
    stalled: float  # since when, with the leg up, the hem has not come `HEADWAY` farther [s]
    stalls: int  # how often that came to `STALLED`
    reached: float  # from where it is to come so much farther [m]
    is_around: bool  # whether the hem goes round the leg, once
    is_held: bool  # whether the robot still holds the waistband
    is_past: bool  # whether the hem has been at its target, round the leg
    tool: Array  # where the robot's tool is [m], shape [3]
    joints: Array  # ankle, knee and hip [m], shape [3, 3]
    to_lifted: Array  # from the ankle to where it is when the leg is up [m], shape [3]
    is_up: bool  # whether the leg is up, see `is_lifted`
    trunk_gap: float  # from the robot to trunk and arms [m], `SEEN` at most
    thigh_gap: float  # from the robot to the thigh [m], `SEEN` at most
    raised: float  # from where the foot is to where it stood [m]
    cloth_force: float  # with which the shorts press on the recipient now, summed [N]
    cloth_peak: float  # the greatest of the episode [N]
    strain: float  # greatest strain of the cloth in the episode


def is_lifted(to_lifted: Array, before: DressingState | None, dt: float) -> bool:
    """Return whether a leg is up: where it is to be, or held still not much lower, as tight muscles have it.

    Args:
        to_lifted: From the ankle to where it is to be [m], shape [3].
        before: What was read before.
        dt: Since then [s].
    """
    left = float(np.linalg.norm(to_lifted))
    if before is None or left < LIFTED:
        return left < LIFTED
    moved = float(np.linalg.norm(to_lifted - before.to_lifted))
    return left < HANGING and moved < STILL * dt


def headway(along: float, before: DressingState | None, elapsed: float) -> tuple[float, int, float]:
    """Return how long the hem has stalled [s], how often it came to that, from where it is to come on [m].

    Args:
        along: How far the hem has come [m].
        before: What was read before.
        elapsed: Since then, with the leg up [s]; 0 while it is not.
    """
    if before is None:
        return 0.0, 0, along
    if not elapsed or along > before.reached + HEADWAY:
        return 0.0, before.stalls, along
    stalled = before.stalled + elapsed
    if stalled > STALLED:
        return 0.0, before.stalls + 1, along - EASE
    return stalled, before.stalls, before.reached
