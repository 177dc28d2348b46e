"""The way of a wheelchair through a door, with the person and the robot on it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rcare_marl.agents.human import Human
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Array
from rcare_marl.world import World

from ..devices.powered_wheelchair import PoweredWheelchair
from ..homes.door import Door

SPARE = 0.02  # [m] that a door must be wider than what passes, each side; our own choice
ARM = 0.06  # [m] from the middle of the base of an arm to its side; our own choice


class WayThrough:
    """Measures how far the chair is through, and what stops it.

    The origin is the door's frame, y through it and away from where the chair starts.

    Attributes:
        chair: The chair.
        left: How far the last of the chair is from being past the wall [m]; 0 or less once it is.
        share: What is done of the way, 0 to 1.
        place: Where the chair is: x, y [m], and its heading from y on, to the left [rad]; shape [3].
        force: Greatest summed force on the chair in the last control step [N].
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
        self._world, self.chair = world, chair
        half = 0.5 * chair.config.width
        elbows = 0.5 * float(np.subtract(*person.body.bounds()[::-1])[0])  # the chair faces along y
        wide = max(elbows, half) + max(elbows, half, chair.config.mount[1] + ARM)
        clear = door.opening.clear_width
        if wide + 2 * SPARE > clear:
            raise ConfigError(
                f"the wheelchair with person and robot is {wide:.2f} m wide, and {door.opening.name!r} "
                f"leaves {clear:.2f} m: take a door of a higher level, or on a bare floor a wider one, "
                f"options={{'clear_width': {wide + 0.1:.2f}}}"
            )
        self._far = 0.5 * door.opening.thickness
        self._corners = [(chair.rear, half), (chair.rear, -half)]
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self.force = self.peak = self._step_force = 0.0
        self.look()
        self._start = self.left
        self.share = 0.0

    def after_substep(self) -> None:
        """Look at the contacts of a physics step."""
        force = self._world.contact_force(self.chair.body)
        if force > self._step_force:
            self._step_force = force

    def look(self) -> None:
        """See where the chair is at the end of a control step."""
        pose = self.chair.pose
        (x, y, _), (_, _, qz, qw) = pose.position, pose.quaternion
        heading = math.remainder(2 * math.atan2(qz, qw) - 0.5 * math.pi, 2 * math.pi)
        self.place: Array = np.array((x, y, heading))
        ahead, aside = math.cos(heading), math.sin(heading)
        self.left = self._far - min(y + a * ahead + b * aside for a, b in self._corners)

    def after_step(self) -> None:
        """Update the memory once a control step."""
        self.look()
        self.share = min(max(1.0 - self.left / self._start, 0.0), 1.0)
        self.force, self._step_force = self._step_force, 0.0
        self.peak = max(self.peak, self.force)

    def observables(self) -> Sequence[Observable]:
        """Return what is seen of it."""
        return [
            Observable("chair_place", "m or rad", 3, lambda: self.place),
            Observable("way_left", "m", 1, lambda: (self.left,)),
            Observable("chair_force", "N", 1, lambda: (self.force,)),
        ]

    def metrics(self) -> Mapping[str, float]:
        """Return what is reported of it."""
        return {
            "way_through_m": -self.left,
            "chair_force_n": self.force,
            "peak_chair_force_n": self.peak,
        }


__all__ = ["WayThrough"]
