"""What limb repositioning reads."""

from __future__ import annotations

from dataclasses import dataclass

from rcare_marl.pose import Array

from ..state import State

LAP_SEEN = 0.03  # [m] of room between cradle and lap that is observed, at most; our own choice


@dataclass(frozen=True, eq=False)
class LimbRepositioningState(State):
    """What limb repositioning reads."""

    elbow: Array  # where the left elbow is [m], shape [3]
    wrist: Array  # likewise
    target: Array  # where the middle of the forearm belongs, above the pad [m], shape [3]
    gap: Array  # from the middle of the forearm to there [m], shape [3]
    distance: float  # length of that [m]
    hook: Array  # where the middle of the cradle's plate lifts the forearm [m], shape [3]
    plate: Array  # where that is [m], shape [3]
    plate_turn: Array  # how the plate is turned, a quaternion, shape [4]
    plate_up: Array  # out of its top, a unit vector, shape [3]
    plate_inward: Array  # to its tip, a unit vector, shape [3]
    reach: float  # from plate to hook [m]
    past_end: float  # how far the elbow is before the armrest's rear end [m]
    lap_gap: float  # from the cradle to belly and thighs [m], `LAP_SEEN` at most
    arm_weight: float  # of the whole arm [N]
    pad_force: float  # how forearm and hand weigh on the pad [N]
    beyond: float  # most that a joint was beyond its passive range [rad]
    earlier: Array  # where the middle of the forearm was at the look before [m], shape [3]
    rested: float  # for how long the forearm has rested [s]
