"""The way of a wheelchair through a door, with the person and the robot on it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array
from rcare_marl.world import World

from ..devices import PoweredWheelchair
from .step_peak import StepPeak

if TYPE_CHECKING:
    from ..place import Door

SPARE = 0.02  # [m] that a door must be wider than what passes, each side; our own choice
ARM = 0.06  # [m] from the middle of the base of an arm to its side; our own choice


@dataclass(frozen=True, eq=False)
class WayState:
    """How far a wheelchair is through a door."""

    place: Array  # where the chair is: x, y [m], and its heading from y on, to the left [rad]; shape [3]
    left: float  # how far the last of the chair is from being past the wall [m]; 0 or less then
    share: float  # what is done of the way, 0 to 1
    force: float  # greatest summed force on the chair in the control step [N]
    peak: float  # that of the episode


class WayThrough:
    """Measures how far the chair is through, and what stops it.

    The origin is the door's frame, y through it and away from where the chair starts.

    Attributes:
        chair: The chair.
    """

    def __init__(self, world: World, door: Door, chair: PoweredWheelchair, person: Human) -> None:
        """Prepare for a chair that stands before the door.

        Args:
            world: The world.
            door: The door.
            chair: The chair, with its riders on it.
            person: Who sits in it.

        Raises:
            ConfigError: If the door is too narrow.
        """
        self.chair = chair
        self._pushing = StepPeak(partial(world.contact_force, chair.body))
        half = 0.5 * chair.model.figure("width")
        elbows = 0.5 * float(np.subtract(*person.body.bounds()[::-1])[0])  # the chair faces along y
        wide = max(elbows, half) + max(elbows, half, chair.frame("mount_left").position[1] + ARM)
        clear = door.clear_width
        if wide + 2 * SPARE > clear:
            raise ConfigError(
                f"the wheelchair with person and robot is {wide:.2f} m wide, and {door.name!r} "
                f"leaves {clear:.2f} m: take a door of a higher level, or on a bare floor a wider one, "
                f"options={{'clear_width': {wide + 0.1:.2f}}}"
            )
        self._far = 0.5 * door.thickness
        rear = chair.model.figure("rear")
        self._corners = [(rear, half), (rear, -half)]
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self._pushing.take()
        self._start = self._look()[1]

    def after_substep(self) -> None:
        """Look at the contacts of a physics step."""
        self._pushing.after_substep()

    def _look(self) -> tuple[Array, float]:
        """Return where the chair is, and how far it is from being through."""
        pose = self.chair.pose
        (x, y, _), (_, _, qz, qw) = pose.position, pose.quaternion
        heading = math.remainder(2 * math.atan2(qz, qw) - 0.5 * math.pi, 2 * math.pi)
        ahead, aside = math.cos(heading), math.sin(heading)
        left = self._far - min(y + a * ahead + b * aside for a, b in self._corners)
        return np.array((x, y, heading)), left

    def read(self, before: WayState | None) -> WayState:
        """Return how far it is, once a control step; `before` is None at the start of an episode."""
        (place, left), force = self._look(), self._pushing.take()
        share = min(max(1.0 - left / self._start, 0.0), 1.0)
        peak = max(force, 0.0 if before is None else before.peak)
        return WayState(place, left, share, force, peak)
