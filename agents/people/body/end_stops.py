"""The ends of a person's joints. Bullet's stop a joint in the step after it has passed them."""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np

from rcare_marl.body import Body
from rcare_marl.pose import Array

PLAY = 0.01  # [rad] by which a joint may pass its end; our own choice
FLUNG = 2.0  # [rad/s] above which a joint past its end was flung there, not forced; our own choice
TOP_SPEED = 20.0  # [rad/s] of a joint, as its URDF states it


class EndStops:
    """What keeps joints inside the passive range when something hits the limb.

    A hand that is stopped by the trunk flings light fingers on: within a single step they would be far
    past the ends of their range, and back only after several. They are put back to the end, at rest. What
    somebody slowly forces beyond its end stays there, and counts as harm.

    Attributes:
        ends: Where the joints end [rad], shape [n, 2].
    """

    def __init__(self, body: Body, joints: Sequence[int], limits: Array) -> None:
        """Watch joints.

        Args:
            body: The person.
            joints: Indices of the n joints.
            limits: Where they end [rad], shape [n, 2].
        """
        self._body, self._joints = body, joints
        self._ends = limits.tolist()
        self._watched = (limits + np.array((-PLAY, PLAY))).tolist()
        self.ends = limits
        body.limit_speed(TOP_SPEED)

    def joint_states(self) -> tuple[list[float], list[float]]:
        """Return angles [rad] and rates [rad/s] of the joints, none of them past its end."""
        angles, rates = self._body.joint_states(self._joints)
        for i, (angle, (low, high)) in enumerate(zip(angles, self._watched, strict=True)):
            if (angle < low or angle > high) and abs(rates[i]) > FLUNG:
                angles[i], rates[i] = self._ends[i][int(angle > high)], 0.0
                self._body.set_joints([self._joints[i]], [angles[i]])
        return angles, rates


@numba.njit(cache=True, error_model="numpy")
def stop(ends, angles, rates) -> None:  # type: ignore[no-untyped-def]
    """Put joints back that were flung past their ends, as `EndStops.joint_states`, in place.

    Args:
        ends: Where joints end [rad], shape [n, 2].
        angles: Of the joints [rad], shape [n].
        rates: Of the joints [rad/s], shape [n].
    """
    for i in range(len(angles)):
        low, high = ends[i]
        if (angles[i] < low - PLAY or angles[i] > high + PLAY) and abs(rates[i]) > FLUNG:
            angles[i] = high if angles[i] > high + PLAY else low
            rates[i] = 0.0
