"""A padded cradle with which a robot lifts a forearm."""

from __future__ import annotations

import math

import numpy as np

from rcare_marl.pose import Array, Pose, quaternion_from_matrix

from .device import Device

# How it lifts a forearm best; our own choices. Where, from elbow to wrist: level, and hanging.
HOOK_SHARE, HOOK_SHARE_HANGING = 0.75, 0.5
# Of the plate's tip towards the forearm, beyond lying along it, so that the forearm rolls against the wall.
TILT, MOST_TILT = math.radians(12), math.radians(55)
WALL_ROOM = 0.008  # [m] between forearm and wall


class ArmCradle(Device):
    """A plate with a wall at its root and a handle behind the wall: origin at the grip, z along the handle.

    A forearm lies across the plate and rolls against the wall while the tip is held higher. Level, the
    plate slides out from under the arm, away from the tip.

    It fits a robot's tool frame: held straight, its pose in the tool is `in_tool`.

    Frames, all but the first with z along the plate to its tip and x up out of it: `grip`, `seat`
    (middle of the plate's top), `corner` (middle of where plate and wall meet), `tip` (middle of the
    free edge). Figures: `plate_length`, from the wall to the tip, and `plate_width`, along the forearm.
    """

    in_tool = Pose()

    def __init__(self, source: str = "arm_cradle") -> None:
        """Make the cradle of that name or YAML file; UnknownNameError if it lacks one of the figures."""
        super().__init__(source)
        self._length, self._width = map(self.model.figure, ("plate_length", "plate_width"))

    def under(
        self, elbow: Array, wrist: Array, radius: float, share: float | None = None
    ) -> tuple[Array, Array]:
        """Return where the middle of the plate lifts a left forearm [m], and how it is turned then.

        The plate lies behind a forearm that hangs, and below one that is level; along x of the world, its
        tip to the right and raised.

        Args:
            elbow: One end of the forearm's axis [m], shape [3].
            wrist: The other end.
            radius: Radius of the forearm [m].
            share: Which point of it, 0 at the elbow, 1 at the wrist; the best one if None.
        """
        forearm = wrist - elbow
        x, y, z = (forearm / math.sqrt(float(forearm @ forearm))).tolist()
        aslant = math.atan2(-z * (math.hypot(x, y) - x), max(y, 1e-6))  # lying along the forearm
        tilt = min(TILT + max(aslant, 0.0), MOST_TILT)
        z = min(z, 0.0)  # never beyond level: few wrists of robots bend so far
        out = np.array((-z, 0.0, math.sqrt(1 - z * z)))  # of a plate as steep as the forearm
        inward = np.array((0.0, -1.0, 0.0))
        up = math.cos(tilt) * out - math.sin(tilt) * inward
        tip = math.cos(tilt) * inward + math.sin(tilt) * out
        turned = np.column_stack((up, _cross(tip, up), tip))
        # A forearm that lies askew needs more of the plate before it meets the wall.
        _, across, skew = (turned.T @ forearm).tolist()
        slope = abs(skew / across) if across else 0.0
        length, half = self._length, 0.5 * self._width
        room = radius * math.hypot(1.0, slope) + half * slope + WALL_ROOM
        aside = min(room, 0.85 * length) - 0.5 * length
        if share is None:
            share = HOOK_SHARE + (HOOK_SHARE_HANGING - HOOK_SHARE) * z * z
        return elbow + share * forearm - radius * up - aside * tip, quaternion_from_matrix(turned)

    def lift_way(
        self, elbow: Array, wrist: Array, middle: Array, radius: float
    ) -> list[tuple[Array, Array]]:
        """Return places and turns of the plate on the way of a left arm that hangs, up onto an armrest.

        They are those of `under` behind the arm, ahead of it, beside the armrest, over it and on it, and
        last where the plate is drawn out.

        Args:
            elbow: Where the elbow is [m], shape [3].
            wrist: Where the wrist is.
            middle: Where the middle of the forearm is to lie.
            radius: Radius of the forearm [m].
        """
        length = math.dist(elbow, wrist)
        shift = middle - (0.5 * length, 0.0, 0.0) - elbow
        forearms = [  # share of the elbow's way, its rise [m], direction of the forearm; own choice
            (0.0, 0.0, (wrist - elbow) / length),
            (0.8, 0.03, np.array((0.6, 0.35, -0.7))),
            (1.0, 0.04, np.array((0.93, 0.35, 0.1))),
            (1.0, 0.05, np.array((0.95, 0.0, 0.3))),
            (1.0, 0.0, np.array((1.0, 0.0, 0.0))),
        ]
        starts = [elbow + share * shift + (0.0, 0.0, rise) for share, rise, _ in forearms]
        out = [
            self.under(start, start + length * along, radius)
            for start, (_, _, along) in zip(starts, forearms, strict=True)
        ]
        place, turn = out[-1]
        return [*out, (place + (0.0, 2.0 * self._length, 0.0), turn)]


def _cross(a: Array, b: Array) -> Array:
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))
